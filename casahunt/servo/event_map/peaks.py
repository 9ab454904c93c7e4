"""The largest P(a)/a between motions of the event map: does any go farther out?

With y = P(a)/a over x = log a, known at x1 < x2 < x3, y2 the largest, the next motion starts at the top of the parabola
through the three, or where the golden section looks if the last one was not where a parabola expected it.  The climb
ends as soon as y > 1, and where what is left open cannot lead there: parabolas have foretold y, or many motions in a
row have gained nothing, measured by what the peak lacks to one.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from .half_cycle import HalfCycle

MOST_CLIMBING, NARROW = 30, 1e-5
"""Motions in search of a peak of P/a, and width in log a at which it is found."""
GOLDEN = (3 - math.sqrt(5)) / 2
LEFT_OPEN, FORETOLD, IN_VAIN = 0.01, 2, 12
"""Part of what a peak lacks to one that does not count; times in a row that parabolas foretell P/a to that part, or
that no motion gains as much (at the edge of a jump), after which it stays below one."""
KEPT_OFF = 0.02
"""Part of the range that a motion keeps off those that are there."""

Try = Callable[[float], HalfCycle | None]
Point = tuple[float, float]
"""(log a, P(a)/a)."""


def highest(at: Try, inner: HalfCycle, best: HalfCycle, outer: HalfCycle) -> HalfCycle:
    """The motion with the largest ratio between two others.

    at: the motion from a stick position, None where it cannot be computed; inner, best, outer: three of them, by
    increasing stick position; the middle one leads farthest out.
    Returns one whose ratio exceeds one as soon as there is one; else the one with the largest ratio.
    """
    low, top, high = ((float(np.log(run.start)), run.ratio) for run in (inner, best, outer))
    foretold, golden, in_vain = 0, False, 0
    for _ in range(MOST_CLIMBING):
        if best.ratio >= 1 or high[0] - low[0] < NARROW or foretold == FORETOLD or in_vain == IN_VAIN:
            break
        x, expected = _golden(low, top, high) if golden else _vertex(low, top, high)
        run = at(float(np.exp(x)))
        ratio = -math.inf if run is None else run.ratio
        open_to_it = LEFT_OPEN * (1 - best.ratio)
        golden = not abs(ratio - expected) < open_to_it
        foretold = 0 if golden else foretold + 1
        in_vain = 0 if ratio > best.ratio + open_to_it else in_vain + 1
        if run is not None and ratio > best.ratio:
            best = run
            low, top, high = (low, (x, ratio), top) if x < top[0] else (top, (x, ratio), high)
        else:
            low, high = ((x, ratio), high) if x < top[0] else (low, (x, ratio))
    return best


def _golden(low: Point, top: Point, high: Point) -> Point:
    """Where the golden section looks next, and what the parabola expects there."""
    side = low if top[0] - low[0] > high[0] - top[0] else high
    x = top[0] + GOLDEN * (side[0] - top[0])
    return x, _parabola(low, top, high, x)


def _vertex(low: Point, top: Point, high: Point) -> Point:
    """The top of the parabola through three points, kept off them, and its height."""
    left, right = top[0] - low[0], high[0] - top[0]
    falls = (top[1] - low[1]) / left, (top[1] - high[1]) / right
    curved = falls[0] + falls[1]
    if not 0 < curved < math.inf:
        return _golden(low, top, high)
    x = top[0] + (falls[0] * right - falls[1] * left) / (2 * curved)
    aside = KEPT_OFF * (high[0] - low[0])
    if abs(x - top[0]) < aside:
        x = top[0] + math.copysign(aside, right - left)
    x = min(max(x, low[0] + aside), high[0] - aside)
    return x, _parabola(low, top, high, x)


def _parabola(low: Point, top: Point, high: Point, x: float) -> float:
    """The parabola through three points at x; no number where a motion has failed."""
    if not math.isfinite(low[1] + high[1]):
        return math.nan
    first = (top[1] - low[1]) / (top[0] - low[0])
    second = ((high[1] - top[1]) / (high[0] - top[0]) - first) / (high[0] - low[0])
    return top[1] + (x - top[0]) * (first + second * (x - low[0]))
