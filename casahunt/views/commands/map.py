"""casahunt map: the event map of the Switch servo, its fixed points and jumps."""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Callable
from typing import Any

from ... import effort
from ...errors import NoOrbit, Status
from ...results import tables_of
from ...servo.event_map.fixed_points import MAP_POINTS, default_range, fixed_points
from ...servo.servo import Servo
from ..answers.map import map_answer
from .arguments import add_command, count_of, gain_of, positive, servo_of
from .output import give
from .progress import progress, teller

MOTIONS = 2, 1000
"""Fewest and most motions of the first grid."""


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = add_command(
        commands, "map", "the event map of the Switch servo: all its cycles", gain=True, tol=False,
        csv="fixed points and jumps", plot="the map (cobweb)",
    )  # fmt: skip
    command.add_argument("--from", dest="start", metavar="A", help="smallest stick position [rad] (1e-4 Fs/kp)")
    command.add_argument("--to", metavar="B", help="largest stick position [rad] (20 Fs/kp)")
    command.add_argument("--points", default=MAP_POINTS, help=f"motions of the first grid (default {MAP_POINTS})")


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code.

    Raises InputError, NoOrbit: the command line is wrong; none of the motions could be computed.
    """
    gain = gain_of(options)
    low = None if options.start is None else positive("from", options.start, "rad")
    high = None if options.to is None else positive("to", options.to, "rad")
    points = count_of("points", options.points, *MOTIONS)
    servo = servo_of(options)
    report = _reporter(servo, gain, low, high, points, options)
    seen = fixed_points(servo, gain, low, high, points=points, report=report)
    if not seen.points:
        raise NoOrbit(f"none of the motions could be computed: {seen.sentence()}", Status.NOT_CONVERGED)
    give(options, seen, map_answer(seen), table=tables_of([seen]), picture=("event_map.cobweb", seen))
    return 0


def _reporter(
    servo: Servo, gain: float, low: float | None, high: float | None, points: int, options: argparse.Namespace
) -> Callable[[int, float], None]:
    """Who says where a map is: in its first grid, then between its neighbours, from the smallest position up."""
    tell = teller(progress(options))
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
