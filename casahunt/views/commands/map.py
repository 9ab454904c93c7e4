"""casahunt map: the event map of the Switch servo, its fixed points and jumps."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from typing import Any

from ... import effort
from ...axis_units import quantity, several
from ...checks import to_absolute_error, to_error
from ...errors import NoOrbit, Status
from ...results import tables_of
from ...servo.event_map.data import FixedPoints
from ...servo.event_map.fixed_points import MAP_POINTS, default_range, fixed_points
from ..answers.answer import Answer, at_gain, item, known, position, short
from .arguments import Asked, add_command, count_of, positive
from .output import give
from .progress import teller


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = add_command(
        commands, "map", "the event map of the Switch servo: all its cycles", gain=True, tol=False,
        csv="fixed points and jumps", plot="the map (cobweb)",
    )  # fmt: skip
    command.add_argument("--from", dest="start", metavar="A", help="smallest stick position [rad] (1e-4 Fs/kp)")
    command.add_argument("--to", metavar="B", help="largest stick position [rad] (20 Fs/kp)")
    command.add_argument("--points", default=MAP_POINTS, help=f"motions of the first grid (default {MAP_POINTS})")


def run(options: Asked) -> int:
    """Compute and print; returns the exit code."""
    gain = options.at_gain()
    low = None if options.start is None else positive("from", options.start, "rad")
    high = None if options.to is None else positive("to", options.to, "rad")
    points = count_of("points", options.points, 2, 1000)
    servo = options.servo()
    told = teller()
    began = since = time.monotonic()

    def report(motions: int, a: float) -> None:
        """Where it is: in the first grid of the map, then between its neighbours, from the smallest position up."""
        nonlocal since
        if motions <= points:
            since = time.monotonic()
            told(f"{motions} of {points} motions of the first grid{effort.left(motions, points, began)}")
            return
        ends = default_range(servo, gain)
        bottom, top = low or ends[0], high or ends[1]
        rest = effort.left(math.log(a / bottom), math.log(top / bottom), since)
        told(f"{motions} motions computed, the last one from the stick position {a:.4g} rad{rest}")

    seen = fixed_points(servo, gain, low, high, points=points, report=report)
    if not seen.points:
        raise NoOrbit(f"none of the motions could be computed: {seen.sentence()}", Status.NOT_CONVERGED)
    answer = Answer(_plain(seen), _details(seen))
    give(options, seen, answer, table=tables_of([seen]), picture=("event_map.cobweb", seen))
    return 0


# What `casahunt map` says of all cycles in a range of distances from the set point


def _plain(seen: FixedPoints) -> Iterator[str]:
    stable = sum(f.stable for f in seen.fixed)
    head = "no hunting cycle was found"
    if stable:
        head = "it can hunt" if stable == 1 else f"it can hunt in {stable} ways"
    elif seen.fixed:
        head = "no hunting cycle was found that it ends in"
    yield f"switch servo {at_gain(seen.gain)}: {head}"
    for f in seen.fixed:
        size = f"amplitude {position(f.amplitude, f.error)}, period {short(f.period, f.period_error)} s"
        away = "" if f.stable else ": motions near it leave it"
        yield item("stable cycle" if f.stable else "unstable cycle", f"{size}{away}")
    where = f"stuck {several((seen.low, seen.high), 'rad', short, ' to ')} beside the set point"
    count = f"{len(seen.points)} motions that start {where}"
    yield item("looked at", f"{count}, for cycles that reach equally to both sides")
    if not seen.conclusive:
        yield item("not certain", f"{len(seen.unresolved)} ranges between them, {len(seen.failures)} motions failed")


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
