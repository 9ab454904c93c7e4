"""What a servo file leaves to Table 1 of the report: said, since an answer is then one about another servo."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ...servo.servo import Servo

STRIBECK = "friction.stribeck_velocity"
"""Data sheets seldom have it, and much hangs on it."""
NEEDED = ("servo.inertia", "servo.motor_gain", "friction.static", "friction.coulomb", "friction.viscous")
"""Of a servo of one's own."""
CONTROLLER = "controller"
"""A table of which one number says nothing."""


def taken_from_table_1(
    servo: Servo, tables: Mapping[str, Any], given: Sequence[str], *, sought: bool
) -> Iterator[str]:
    """Sentences on what is neither in the tables of a servo file nor given by --set; none where all is.

    sought: the parameters of friction are found in records, and taken to start from.
    """
    own = {servo.units.own_name(f"{table}.{key}") for table, keys in tables.items() for key in keys}
    own |= {servo.units.own_name(text.partition("=")[0].strip()) for text in given}
    missing = [key for key in NEEDED if key not in own and not (sought and key.startswith("friction"))]
    missing += [] if any(key.startswith(f"{CONTROLLER}.") for key in own) else [CONTROLLER]
    if missing:
        yield f"not in the servo file, and taken from Table 1 of the report: {', '.join(missing)}"
    elif STRIBECK not in own and not sought:
        value = servo.friction.stribeck_velocity
        taken = f"{value:g} rad/s of Table 1 is taken, and where hunting ends hangs on it"
        how = f"try others with --set {STRIBECK}=VALUE, or find it from a record (casahunt identify)"
        yield f"{STRIBECK} is not in the servo file: {taken}; {how}"
