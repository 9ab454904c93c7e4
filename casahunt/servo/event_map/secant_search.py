"""A motion beside a stable fixed point of the event map by a few secant steps, at one gain or along the gain.

    log a* = log a - y/y',    y = log P/a and y' = dy/d log a, at first that of another gain where one is known
    a(f K) = a(K) f^r,        r from the last two gains, -1 at first

The short cut that replaces no scan: given up as soon as it is no quick case. Along the gain, upwards and down, a motion
or two at each gain lead to where a boundary value problem begins; a servo that moves much longer than at the gain
before creeps to rest, and is not waited for.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace

from ...motion import MarchFailure
from ..denial import no_cycle
from .half_cycle import HalfCycle, StickMap

FAR_OFF, SECANT_ROUNDS, LARGEST_SECANT = 10.0, 7, 1.0
"""Largest ratio P(a)/a or a/P(a) met, steps, and their length in log a."""
CONVERGING = {"switch": 0.03, "lugre": 0.005}
"""|log P(a)/a| from which the boundary value problem mostly converges."""
CLOSER = 1e-4
"""The same where it has not."""
BESIDE_A_CYCLE = 0.3
"""The same of a motion that only tells where a cycle is."""
WEAK_SLOPE, BESIDE_A_WEAK_ONE, WEAK_MARCH = -0.1, 0.01, 1e-8
"""Slope of log P/a against log a from which up a cycle attracts so weakly that P/a is next to one far from it, too;
part of its stick position within which a motion is beside such a cycle; tolerance to which P/a is computed there."""
FARTHER_OUT = 3.0
"""Stick position of the stable cycles next to some folds, in units of the typical one."""
MUCH_LONGER = 10.0
"""Times that a servo moves, of which it comes to rest."""
CLIMB_FACTORS = (4.0, 2.0, 1.4, 1.2)
MOST_CLIMBS = 20
"""Factors by which the gain is raised, each as long as a cycle is found."""
LOWER_FACTORS, MOST_LOWERED = (2.0, 1.4, 1.1), 3
"""Factors by which the gain is lowered, a smaller one where there is no cycle that far below; how often at most."""
STEEPEST_RATE, FLATTEST_RATE = -3.0, -0.3
"""Of the logarithm of the stick position in that of the gain, as it is foreseen."""


def near_stable(
    P: StickMap, a: float, *, close: float | None = None, slope: float = math.nan, longest: float = math.inf
) -> HalfCycle | None:
    """A half cycle close to a stable fixed point; a short cut that replaces no scan.

    Secant steps in (log a, log P/a), without a bracket (roots.py). Only a step of the Switch servo too far
    inwards, where it creeps to rest, is taken back by half. The fixed point is taken for the stable one only where the
    ratio falls with a, as it does at P'(a) < 1, and falls so steeply that the next step would reach the fixed point: at
    tiny gains P(a)/a is next to one over decades of a and crosses it nowhere.

    a: stick position next to it [rad], > 0; close: |log P/a| at which it is close enough, default per model; where P <
    a, no larger than that: P > a alone shows that there is a fixed point, farther out; slope: of log P/a where it is
    known from another gain; one motion may then be enough; longest: of a motion [s]: `StickMap`. Returns HalfCycle with
    the slope of log P/a; None where it is no quick case.
    """
    converging, rigid = CONVERGING[P.model], P.model == "switch"
    close = close or converging
    x, previous, known = math.log(a), None, math.isfinite(slope)
    slope = slope if known else -1.5
    for _ in range(SECANT_ROUNDS):
        try:
            run = P(math.exp(x), longest=longest)
        except MarchFailure:
            return None
        if not 1 / FAR_OFF < run.ratio < FAR_OFF:
            if not rigid or previous is None or not x < previous[0] or run.ratio > 1:
                return None
            x = (x + previous[0]) / 2  # too far inwards, where it comes to rest
            continue
        if rigid:
            longest = min(longest, MUCH_LONGER * run.moving)
        y = math.log(run.ratio)
        if previous is not None and previous[0] != x:
            slope, known = (y - previous[1]) / (x - previous[0]), True
        if known and slope >= WEAK_SLOPE:
            return _near_weak(P, (x, y), slope, close, longest)
        enough = abs(y) < (close if y > 0 else min(close, converging))
        if enough and known:
            if abs(y) < -slope * LARGEST_SECANT:
                return replace(run, slope=slope)
            if abs(y) < converging:
                return None
        previous = (x, y)
        x = x - max(-LARGEST_SECANT, min(LARGEST_SECANT, y / slope)) if known or not enough else x + 0.02
    return None


def near_typical(P: StickMap, *, close: float | None = None) -> HalfCycle | None:
    """`near_stable` from where most stable cycles stick, and else from farther out.

    Next to their folds cycles stick there: a motion from nearer may start inside the unstable one.

    Returns HalfCycle with the slope of log P/a; None where neither is a quick case.
    """
    found = near_stable(P, P.typical, close=close)
    return found if found is not None else near_stable(P, FARTHER_OUT * P.typical, close=close)


def _near_weak(P: StickMap, at: tuple[float, float], slope: float, close: float, longest: float) -> HalfCycle | None:
    """`near_stable` where log P/a hardly falls with log a, from (log a, log P/a): the distance decides."""
    x, y = at
    previous = None
    for _ in range(SECANT_ROUNDS):
        if not abs(y) < -slope * LARGEST_SECANT:
            return None
        x -= y / slope
        try:
            run = P(math.exp(x), tol=WEAK_MARCH, longest=longest)
        except MarchFailure:
            return None
        if not run.ratio > 0:
            return None
        y = math.log(run.ratio)
        if previous is not None and previous[0] != x:
            slope = (y - previous[1]) / (x - previous[0])
            if abs(y) < min(close, -slope * BESIDE_A_WEAK_ONE):
                return replace(run, slope=slope)
        previous = (x, y)
    return None


def climbed(P: StickMap, beside: HalfCycle) -> list[tuple[float, HalfCycle]]:
    """Increasing gains at which the Switch servo has a stable cycle, each with a motion beside it, from there up.

    P, beside: where to begin: the map, and a motion with its slope. Returns (gain, motion), the first of them as given.
    """
    gain, rate = P.gain, -1.0
    gains = [(gain, beside)]
    for factor in CLIMB_FACTORS:
        for _ in range(MOST_CLIMBS):
            if no_cycle(P.servo, "switch", gain * factor):
                break
            found = near_stable(
                P.at_gain(gain * factor), beside.fixed * factor**rate, close=BESIDE_A_CYCLE, slope=beside.slope,
                longest=MUCH_LONGER * beside.moving,
            )  # fmt: skip
            if found is None:
                break
            rate = min(max(math.log(found.fixed / beside.fixed) / math.log(factor), STEEPEST_RATE), FLATTEST_RATE)
            gain, beside = gain * factor, found
            gains.append((gain, beside))
    return gains


def lowered(P: StickMap, beside: HalfCycle) -> Iterator[tuple[float, HalfCycle]]:
    """Decreasing gains at which the Switch servo has a stable cycle, each with a motion beside it, from there down.

    P, beside: where to begin: the map, and a motion with its slope. Yields (gain, motion), without the first.
    """
    gain = P.gain
    for factor in LOWER_FACTORS:
        for _ in range(MOST_LOWERED):
            found = near_stable(P.at_gain(gain / factor), beside.fixed * factor**0.5, close=BESIDE_A_CYCLE)
            if found is None:
                break
            gain, beside = gain / factor, found
            yield gain, beside
        else:
            return
