"""Along the stable fixed points of the event map, upwards in the gain and down, a motion or two at each gain.

    a(f K) = a(K) f^r,    r from the last two gains, -1 at first
    log a* = log a - y/y',    y = log P/a and y' = dy/d log a, first that of the gain before

The servo that moves much longer than at the gain before creeps to rest: it is not waited for.  What is met is where a
boundary value problem begins, and no evidence.
"""

from __future__ import annotations

import math
from collections.abc import Iterator

from ..denial import no_cycle
from ..servo import Servo
from .scan import MUCH_LONGER, HalfCycle, near_stable

CLIMB_FACTORS = (4.0, 2.0, 1.4, 1.2)
MOST_CLIMBS = 20
"""Factors by which the gain is raised, each as long as a cycle is found."""
BESIDE_A_CYCLE = 0.3
"""|log P/a| of a motion beside a cycle."""
LOWER_FACTORS, MOST_LOWERED = (2.0, 1.4, 1.1), 3
"""Factors by which the gain is lowered, a smaller one where there is no cycle that far below; how often at most."""
STEEPEST_RATE, FLATTEST_RATE = -3.0, -0.3
"""Of the logarithm of the stick position in that of the gain, as it is foreseen."""


def climbed(servo: Servo, gain: float, beside: HalfCycle) -> list[tuple[float, HalfCycle]]:
    """Increasing gains at which the Switch servo has a stable cycle, each with a motion beside it, from there up.

    Stick positions are foreseen from the last two; a servo that takes much longer than there creeps to rest.

    servo, gain, beside: the servo, and where to begin: a motion with the slope of the map.
    Returns (gain, motion), the first of them as given.
    """
    gains, rate = [(gain, beside)], -1.0
    for factor in CLIMB_FACTORS:
        for _ in range(MOST_CLIMBS):
            if no_cycle(servo, "switch", gain * factor):
                break
            found = near_stable(
                "switch", servo, gain * factor, beside.fixed * factor**rate, close=BESIDE_A_CYCLE, slope=beside.slope,
                longest=MUCH_LONGER * beside.moving,
            )  # fmt: skip
            if found is None:
                break
            rate = min(max(math.log(found.fixed / beside.fixed) / math.log(factor), STEEPEST_RATE), FLATTEST_RATE)
            gain, beside = gain * factor, found
            gains.append((gain, beside))
    return gains


def lowered(servo: Servo, gain: float, beside: HalfCycle) -> Iterator[tuple[float, HalfCycle]]:
    """Decreasing gains at which the Switch servo has a stable cycle, each with a motion beside it, from there down.

    servo, gain, beside: the servo, and where to begin: a motion with the slope of the map.
    Yields (gain, motion), one after the other, without the first.
    """
    for factor in LOWER_FACTORS:
        for _ in range(MOST_LOWERED):
            found = near_stable("switch", servo, gain / factor, beside.fixed * factor**0.5, close=BESIDE_A_CYCLE)
            if found is None:
                break
            gain, beside = gain / factor, found
            yield gain, beside
        else:
            return
