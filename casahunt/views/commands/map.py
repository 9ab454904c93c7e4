"""casahunt map: the event map of the Switch servo, its fixed points and jumps."""

from __future__ import annotations

import argparse
import json
from typing import Any

from ...checks import finite_or_none, to_error
from ...errors import InputError, NoOrbit, Status
from ...servo.event_map.fixed_points import MAP_POINTS, fixed_points
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
    tell = teller(progress(options.quiet))

    def report(motions: int, a: float) -> None:
        tell(f"{motions} motions computed, the last one from the stick position {a:.4g} rad")

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


def _count(text: Any) -> int:
    try:
        count = int(text)
    except ValueError:
        raise InputError(f"points = {text!r}: must be a whole number") from None
    if not 2 <= count <= 1000:
        raise InputError(f"points = {count}: must be between 2 and 1000")
    return count
