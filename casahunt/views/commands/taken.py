"""What of a servo file a command takes.

What it leaves to Table 1 of the report is said, since an answer is then one about another servo; and parts of a loop
for which a command has no answer are named, with the reason.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

from ...errors import InputError
from ...servo.drive import DRIVE_TABLE
from ...servo.servo import Servo

if TYPE_CHECKING:
    from ...servo.parts import Loop

STRIBECK = "friction.stribeck_velocity"
"""Data sheets seldom have it, and much hangs on it."""
NEEDED = ("servo.inertia", "servo.motor_gain", "friction.static", "friction.coulomb", "friction.viscous")
"""Of a servo of one's own."""
WITHOUT_DRIVE = ("basin", "diagram", "equilibria", "fold-curve", "fold-map", "map", "uncertainty")
"""Commands that answer for the continuous loop and have no line of their own for it, as orbit and fold have."""
CONTINUOUS = "of the continuous loop: [drive] of the servo file changes nothing here; casahunt simulate takes it in"
"""Said where a drive is described and not computed."""


def taken_from_table_1(
    servo: Servo, tables: Mapping[str, Any], given: Sequence[str], *, sought: bool
) -> Iterator[str]:
    """Sentences on what is neither in the tables of a servo file nor given by --set; none where all is.

    sought: the parameters of friction are found in records, and taken to start from.
    """
    own = {servo.units.own_name(f"{table}.{key}") for table, keys in tables.items() for key in keys}
    own |= {servo.units.own_name(text.partition("=")[0].strip()) for text in given}
    missing = [key for key in NEEDED if key not in own and not (sought and key.startswith("friction"))]
    missing += [] if any(key.startswith("controller.") for key in own) else ["controller"]  # one number says nothing
    if missing:
        yield f"not in the servo file, and taken from Table 1 of the report: {', '.join(missing)}"
    elif STRIBECK not in own and not sought:
        value = servo.friction.stribeck_velocity
        taken = f"{value:g} rad/s of Table 1 is taken, and where hunting ends hangs on it"
        how = f"try others with --set {STRIBECK}=VALUE, or find it from a record (casahunt identify)"
        yield f"{STRIBECK} is not in the servo file: {taken}; {how}"


def of_the_continuous_loop(command: str, tables: Mapping[str, Any]) -> Iterator[str]:
    """A sentence on the drive of a servo file, where the command leaves it out."""
    if DRIVE_TABLE in tables and command in WITHOUT_DRIVE:
        yield f"the answer is {CONTINUOUS}"


def servo_of_parts(what: str, loop: Loop) -> Servo:
    """The servo with rigid friction that a loop is, for `map`.  Raises InputError: it has another part."""
    from ...servo.parts.plain_loop import FRICTIONS, not_of_a_servo, servo_of_loop

    asked = servo_of_loop(loop)
    if asked is not None and asked[1] != "lugre":
        return asked[0]
    lacking = [FRICTIONS["lugre"]] if asked is not None else loop.present
    parts = " and ".join(repr(name) for name in not_of_a_servo(loop) or [part.name for part in lacking])
    raise InputError(
        f"{what}: casahunt map has no answer for {parts}: the event map has one coordinate, where one inertia with "
        "rigid friction sticks under a PID controller, and a motion from there must depend on nothing else; casahunt "
        "orbit, basin and simulate take such a loop"
    )
