"""What `casahunt map` says of all cycles in a range of distances from the set point."""

from __future__ import annotations

from collections.abc import Iterator

from ...axis_units import quantity, several
from ...checks import to_absolute_error, to_error
from ...servo.event_map.data import FixedPoint, FixedPoints
from .answer import Answer, at_gain, item, known, position, short


def map_answer(seen: FixedPoints) -> Answer:
    """What is said of an event map."""
    return Answer(_plain(seen), _details(seen))


def _plain(seen: FixedPoints) -> Iterator[str]:
    stable = sum(f.stable for f in seen.fixed)
    head = "no hunting cycle was found"
    if stable:
        head = "it can hunt" if stable == 1 else f"it can hunt in {stable} ways"
    elif seen.fixed:
        head = "no hunting cycle was found that it ends in"
    yield f"switch servo {at_gain(seen.gain)}: {head}"
    for f in seen.fixed:
        yield item("stable cycle" if f.stable else "unstable cycle", _cycle(f))
    where = f"stuck {several((seen.low, seen.high), 'rad', short, ' to ')} beside the set point"
    count = f"{len(seen.points)} motions that start {where}"
    yield item("looked at", f"{count}, for cycles that reach equally to both sides")
    if not seen.conclusive:
        yield item("not certain", f"{len(seen.unresolved)} ranges between them, {len(seen.failures)} motions failed")


def _cycle(f: FixedPoint) -> str:
    size = f"amplitude {position(f.amplitude, f.error)}, period {short(f.period, f.period_error)} s"
    return size if f.stable else f"{size}: motions near it leave it"


def _details(seen: FixedPoints) -> Iterator[str]:
    yield f"  {seen.sentence()}"
    for f in seen.fixed:
        mu = to_absolute_error(f.multiplier, max(1.0, abs(f.multiplier)) * max(f.error, f.period_error), most=8)
        kind = "stable" if f.stable else "unstable"
        yield f"  fixed point  a = {known(f.amplitude, f.error)}: {kind} cycle of this amplitude,"
        yield f"               period = {to_error(f.period, f.period_error)} s, half multiplier P' = {mu}"
    for j in seen.jumps:
        across = ", across P = a: from coming nearer to going farther, with no cycle in between" if j.crosses else ""
        jump = several((j.below, j.above), "rad", by=" to ")
        yield f"  jump         a = {quantity(j.start, 'rad', '.6g')}, P from {jump}{across}"
