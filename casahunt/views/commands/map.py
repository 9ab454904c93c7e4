"""casahunt map: the event map of the Switch servo, its fixed points and jumps."""

from __future__ import annotations

import argparse
import json
import math
import time
from collections.abc import Callable
from typing import Any

from ... import effort
from ...checks import finite_or_none, to_error
from ...errors import InputError, NoOrbit, Status
from ...servo.event_map.fixed_points import MAP_POINTS, default_range, fixed_points
from ...servo.servo import Servo
from .arguments import add_common, gain_of, picture_of, positive, servo_of
from .console import progress, teller


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = commands.add_parser("map", allow_abbrev=False, help="the event map of the Switch servo: all its cycles")
    add_common(command, tol=False)
    command.add_argument("--gain", help="controller gain K, required")
    command.add_argument("--from", dest="start", metavar="A", help="smallest stick position [rad] (1e-4 Fs/kp)")
    command.add_argument("--to", metavar="B", help="largest stick position [rad] (20 Fs/kp)")
    command.add_argument("--points", default=MAP_POINTS, help=f"motions of the first grid (default {MAP_POINTS})")
    command.add_argument("--plot", metavar="F.png", help="write the map as a cobweb picture")


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code.

    Raises
    ------
    InputError, NoOrbit : the command line is wrong; none of the motions could be computed.
    """
    gain = gain_of(options)
    low = None if options.start is None else positive("from", options.start)
    high = None if options.to is None else positive("to", options.to)
    points = _count(options.points)
    servo = servo_of(options)
    plot = picture_of(options)
    report = _reporter(servo, gain, low, high, points, options)
    seen = fixed_points(servo, gain, low, high, points=points, report=report)
    if not seen.points:
        raise NoOrbit(f"none of the motions could be computed: {seen.sentence()}", Status.NOT_CONVERGED)
    if plot:
        from ..pictures import event_map as pictures_map
        from ..pictures import plotting

        options.outputs.draw(lambda: plotting.save(pictures_map.cobweb(seen), plot))
    if options.json:
        record = {
            "gain": gain,
            "from": seen.low,
            "to": seen.high,
            "fixed_points": [
                {
                    "amplitude": f.amplitude, "half_multiplier": f.multiplier, "period": f.period, "stable": f.stable,
                    "error_estimate": f.error, "period_error": f.period_error,
                }
                for f in seen.fixed
            ],
            "jumps": [
                {"at": j.start, "below": finite_or_none(j.below), "above": finite_or_none(j.above),
                 "crosses": j.crosses}
                for j in seen.jumps
            ],
            "motions": len(seen.points),
            "unresolved": [list(pair) for pair in seen.unresolved],
            "failures": list(seen.failures),
            "conclusive": seen.conclusive,
            "evidence": seen.sentence(),
        }  # fmt: skip
        print(json.dumps(record))
        return 0
    print(f"event map of the Switch servo at gain {gain:.10g}")
    print(f"  {seen.sentence()}")
    for f in seen.fixed:
        print(f"  fixed point  a = {to_error(f.amplitude, f.error)} rad  mu = P' = {f.multiplier:.8g} "
              f"({'stable' if f.stable else 'unstable'})  period = {to_error(f.period, f.period_error)} s")  # fmt: skip
    for j in seen.jumps:
        print(f"  jump         a = {j.start:.8g} rad, P from {j.below:.6g} to {j.above:.6g} rad"
              f"{', across P = a' if j.crosses else ''}")  # fmt: skip
    return 0


def _reporter(
    servo: Servo, gain: float, low: float | None, high: float | None, points: int, options: argparse.Namespace
) -> Callable[[int, float], None]:
    """Who says where a map is: in its first grid, then between its neighbours, from the smallest position up."""
    tell = teller(progress(options.quiet))
    began = since = time.monotonic()

    def report(motions: int, a: float) -> None:
        nonlocal since
        if motions <= points:
            since = time.monotonic()
            tell(f"{motions} of {points} motions of the first grid{effort.left(motions, points, began)}")
            return
        ends = default_range(servo, gain)
        bottom, top = low or ends[0], high or ends[1]
        rest = effort.left(math.log(a / bottom), math.log(top / bottom), since)
        tell(f"{motions} motions computed, the last one from the stick position {a:.4g} rad{rest}")

    return report


def _count(text: Any) -> int:
    try:
        count = int(text)
    except ValueError:
        raise InputError(f"points = {text!r}: must be a whole number") from None
    if not 2 <= count <= 1000:
        raise InputError(f"points = {count}: must be between 2 and 1000")
    return count
