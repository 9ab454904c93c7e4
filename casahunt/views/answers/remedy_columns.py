"""What the columns of the table of remedies mean, and what the step of their price takes today."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from contextlib import suppress

from ...axis_units import quantity, word
from ...design.remedies.cures import Cures
from ...design.remedies.price import SETTLED_WITHIN, settled_within
from ...errors import NoOrbit
from ...servo.simulate import simulate
from .answer import short

DITHER_SIZE = (
    "its size is the root mean square of the velocity that the vibration has at the shaft; the torque for it, root "
    "mean square too, is the inertia times that times 2 pi times its frequency"
)
"""What to set."""


def columns_meant(found: Cures, own: Mapping[str, str], *, of_a_set: bool) -> Iterator[str]:
    """The columns; own: remedies that are numbers of the controller, and which."""
    names = [row.name for row in found.remedies if row.ends_hunting]
    if not names:
        return
    set_too, as_given = (", the worst servo of the set too", ", of the servo as given") if of_a_set else ("", "")
    more = ", or than the worst servo of the set needs" if of_a_set else ""
    yield "  ends it        the smallest size that does, or where less is more the largest"
    yield f"  choose         {100 * found.margin:g} % more of the remedy than that{more}"
    yield f"  error at rest  the largest at which the servo may stand still, with the size to choose{set_too}"
    yield f"  {word('torque'):13s}  the largest on a {found.task}, with that size{as_given}"
    small = settled_within(found.amplitude, found.step) < SETTLED_WITHIN * found.step
    within = "half of the amplitude of the hunting" if small else f"{100 * SETTLED_WITHIN:g} % of the way"
    since = "" if found.move is None else ", since its start,"
    yield f"  settles in     from then on{since} the error stays within {within}, or the error at rest"
    yield f"                 and {100 * SETTLED_WITHIN:g} % of that, along which it may creep"
    yield "  order          the cheapest first: error at rest, torque and settling time together"
    if numbers := [f"{name}: {own[name]}" for name in names if name in own]:
        yield f"  sizes          of the controller's own numbers, in place of the present ones: {', '.join(numbers)}"
    if "dither" in names:
        yield f"  dither         {DITHER_SIZE}"


def today(found: Cures, most: float | None) -> str:
    """What the present controller asks for on the step, where a torque is the limit; "" where that is not known."""
    if most is None:
        return ""
    with suppress(NoOrbit):
        time = found.period + (0.0 if found.move is None else found.move.time(found.step))
        peak = simulate(found.loop, set_point=found.step, time=time, move=found.move).peak_torque
        already = ", which is above that limit already" if peak > most else ""
        return f"; the present controller asks for {quantity(peak, 'N m', short)} on a {found.task}{already}"
    return ""
