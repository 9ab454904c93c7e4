"""What cubics through neighbouring motions foretell of the event map between them.

    y(t) = P/a - 1 along log a,   y and dy/d log a = P' - P/a given at t = 0 and 1

Three motions whose cubics agree, and keep off y = 0, have no fixed point between them; a pair that fits between two
motions without disturbing them is what every scan can miss.
"""

from __future__ import annotations

import math

import numpy as np

from .slopes import MapPoint

SMOOTH, DISTANCE = 0.01, 0.25
"""A motion half-way may miss the cubic through its neighbours by SMOOTH + DISTANCE times the distance from P = a."""
NEAR = 1e-3
"""A cubic that comes this close to P = a is looked at more closely."""
STEEP = 0.5
"""Part of a step of P between two motions at rounding distance that their slopes must explain; else it is a jump."""
CUBIC_PLACES = 33
"""Places at which a cubic is looked at."""


def nothing_between(left: MapPoint, middle: MapPoint, right: MapPoint) -> bool:
    """Whether the motion half-way is where the cubic has it, and the cubics keep off P = a.

    left, middle, right: the event map at three stick positions, in rising order.
    Returns False also where the motion half-way was not computed, or P - a changes sign.
    """
    if not math.isfinite(middle.position) or not middle.excess * left.excess > 0:
        return False
    expected, nearest = foretold(left, right)
    if abs(middle.excess - expected) > SMOOTH + DISTANCE * nearest:
        return False
    return nearest > NEAR or one_sided(left, middle, right)


def hermite(left: MapPoint, right: MapPoint) -> np.ndarray:
    """The cubic through P/a - 1 and its slopes at two stick positions.

    Returns (4,) coefficients, highest power first, in t from 0 to 1 along log a.
    """
    width = math.log(right.start / left.start)
    y0, y1 = left.excess, right.excess
    s0 = width * (left.slope - 1 - y0)  # d(P/a)/d log a = P' - P/a
    s1 = width * (right.slope - 1 - y1)
    return np.array([2 * y0 - 2 * y1 + s0 + s1, -3 * y0 + 3 * y1 - 2 * s0 - s1, s0, y0])


def foretold(left: MapPoint, right: MapPoint) -> tuple[float, float]:
    """What the cubic says of the stick positions between two.

    Returns P/a - 1 half-way, and the smallest |P/a - 1| between; 0 for the latter where the sign changes.
    """
    c = hermite(left, right)
    t = np.linspace(0, 1, CUBIC_PLACES)
    values = np.polyval(c, t)
    smallest = 0.0 if np.any(values * values[0] <= 0) else float(np.min(np.abs(values)))
    return float(np.polyval(c, 0.5)), smallest


def one_sided(left: MapPoint, middle: MapPoint, right: MapPoint) -> bool:
    """Whether P keeps to one side of a narrow interval close to P = a, with room to spare.

    left, middle, right: the event map at the ends and half-way.
    Returns True where the cubics of both halves stay off P = a by a tenth of what they vary.
    """
    for a, b in ((left, middle), (middle, right)):
        c = hermite(a, b)
        values = np.polyval(c, np.linspace(0, 1, CUBIC_PLACES))
        spread = float(np.ptp(values))
        if np.any(values * values[0] <= 0) or float(np.min(np.abs(values))) < 0.1 * spread:
            return False
    return True


def cubic_is_good(left: MapPoint, right: MapPoint) -> bool:
    """Both slopes are of the size of the step, so that P is no jump here.

    Returns False where the step of P is much larger than the slopes explain.
    """
    step = abs(right.position - left.position)
    by_slope = max(abs(left.slope), abs(right.slope)) * (right.start - left.start)
    return by_slope > STEEP * step
