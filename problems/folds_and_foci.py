"""Cycles born where foci and folds of two fields meet on the switching manifold x = 0 (hopf_like.py says what is told).

    focus         z' = (a + i w)(z - z_0), z = x + i y: half a turn takes pi/w and y - y_0 to -exp(pi a/w) (y - y_0)
    curved focus  z' = (a - c x + i) z: half a turn takes pi and 1/|y| to exp(-pi a)/|y| + c (1 + exp(-pi a))/(1 + a^2)
    fold          x' = -y, y' = -1 left of x = 0: takes the time 2 y and y to -y
    curved fold   x' = -(y - y_0), y' = 1 + b (y - y_0) - k y^3 right of it: with k = 0 and s = y - y_0 the quantity
                  b s - log(1 + b s) is the same before and after;  s goes from -s to s + 2 b s^2/3 - 2 k s^4/5 + ...

What slips along x = 0 lies at y_0 = mu, or nothing slips and a stability changes:

    slipping foci            left 0, right mu                             amplitude ~ mu       period = pi/w + pi/w
    slipping focus and fold  a fold at 0, a focus at mu                   amplitude ~ mu       period -> pi/w
    slipping folds           a fold at 0, a curved one at mu              amplitude ~ mu^1/2   period ~ mu^1/2
    fixed foci               a focus a = -1/10, a curved one a = growth   amplitude ~ growth - 1/10,  period = 2 pi
    fixed focus and fold     a fold, a curved focus a = growth            amplitude ~ growth   period -> pi
    fixed folds              a fold, a curved one b = bend                amplitude ~ bend^1/2, period ~ bend^1/2

A fold's map is an involution, so the terms of second and third order of the composition of two of them vanish together:
that is why the last amplitude goes like a square root where those of the foci are linear.

Source: the review named in hopf_like.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from numpy.polynomial.legendre import leggauss

from .hopf_like import Birth, Field, Turn, series, two_sides, zero

LEFT, RIGHT = (-0.3, 1.0), (0.2, 2.0)
"""(a, w) of the foci that slip; LEFT's is the one that slips along a fold."""
BEND = -0.5
"""b of the fold that slips."""
DECAY, CURVE, BRAKE = 0.1, 0.5, 0.5
"""Where nothing slips: -a of the left focus, c, k."""


def turning(x: Any, a: Any, w: Any, slip: Any = 0.0) -> dict[str, Any]:
    """A focus at (0, slip).

    slip: where it is.
    """
    return {"x": a * x.x - w * (x.y - slip), "y": w * x.x + a * (x.y - slip)}


def fold(x: Any, p: Any) -> dict[str, Any]:
    """The left fold."""
    return {"x": -x.y, "y": -1.0}


def half(numbers: tuple[float, float]) -> float:
    """What half a turn about a focus makes of the distance.

    Returns exp(pi a/w).
    """
    a, w = numbers
    return math.exp(math.pi * a / w)


def slipping_foci(mu: float) -> Turn:
    """The truth: y_1 = mu + R (mu + y) right of x = 0, y = L y_1 left of it."""
    L, R = half(LEFT), half(RIGHT)
    return Turn(math.pi / LEFT[1] + math.pi / RIGHT[1], 0.0, -L * mu * (1 + R) / (1 - L * R))


def slipping_focus_and_fold(mu: float) -> Turn:
    """The truth: as for the foci with L = 1."""
    R = half(LEFT)
    y = mu * (1 + R) / (1 - R)
    return Turn(math.pi / LEFT[1] + 2 * y, 0.0, -y)


def slipping_folds(mu: float) -> Turn:
    """The truth: s goes from -(y + mu) to y - mu."""
    near = math.sqrt(3 * mu / abs(BEND))

    def change(y: float) -> float:  # of (b s - log(1 + b s))/b^2, over y^3: its quadratic part is -2 mu y
        def term(n: int) -> float:
            return (-BEND) ** (n - 2) * ((y - mu) ** n - (-y - mu) ** n) / n

        return (series(term, 3) - 2 * mu * y) / y**3

    y = zero(change, near / 2, 2 * near)
    return Turn(2 * y + math.log1p(2 * BEND * y / (1 - BEND * (y + mu))) / BEND, 0.0, -y)


def curved(a: float) -> tuple[float, float]:
    """(ratio, offset): half a turn about the curved focus takes 1/|y| to ratio/|y| + offset."""
    ratio = math.exp(-a * math.pi)
    return ratio, CURVE * (1 + ratio) / (1 + a * a)


def fixed_foci(growth: float) -> Turn:
    """The truth."""
    y = -math.expm1(math.pi * (DECAY - growth)) / (math.exp(DECAY * math.pi) * curved(growth)[1])
    return Turn(2 * math.pi, 0.0, -y)


def fixed_focus_and_fold(growth: float) -> Turn:
    """The truth."""
    y = -math.expm1(-math.pi * growth) / curved(growth)[1]
    return Turn(math.pi + 2 * y, 0.0, -y)


def fixed_folds(bend: float) -> Turn:
    """The truth: s/(1 + b s - k s^3) has no integral from -y to y, and the odd part of that is s^2 (k s^2 - b) over q.
    """
    nodes, weights = leggauss(40)

    def mean(y: float, part: Callable[[float], float]) -> float:  # of part/q over (0, y), q = (1 + ...)(1 - ...)
        at = [y * (1 + c) / 2 for c in nodes]
        each = [part(s) / (1 - (bend * s - BRAKE * s**3) ** 2) for s in at]
        return math.fsum(w * e for w, e in zip(weights, each, strict=True)) / 2

    near = math.sqrt(5 * bend / (3 * BRAKE))
    y = zero(lambda y: mean(y, lambda s: s**2 * (bend - BRAKE * s**2)) / y**4, near / 2, 2 * near)
    return Turn(2 * y + 2 * y * mean(y, lambda s: 1.0), 0.0, -y)


def _birth(turn: Callable[[float], Turn], varied: tuple[str, float], fields: tuple[Field, Field], **laws: Any) -> Birth:
    name, (vary, begin) = turn.__name__.replace("_", " "), varied
    laws = {"value": 0.0, "exponents": (1.0, 0.0), **laws}
    system = two_sides(name, varied, *fields)
    return Birth(name, system, vary, begin=begin, mode="right", measure="y", turn=turn, **laws)


BIRTHS = (
    _birth(slipping_foci, ("mu", 0.3), (lambda x, p: turning(x, *LEFT), lambda x, p: turning(x, *RIGHT, p.mu)),
           limits=(-slipping_foci(1.0).y, math.pi / LEFT[1] + math.pi / RIGHT[1])),
    _birth(slipping_focus_and_fold, ("mu", 0.3), (fold, lambda x, p: turning(x, *LEFT, p.mu)),
           limits=((1 + half(LEFT)) / (1 - half(LEFT)), math.pi / LEFT[1])),
    _birth(slipping_folds, ("mu", 0.05), (fold, lambda x, p: {"x": p.mu - x.y, "y": 1 + BEND * (x.y - p.mu)}),
           exponents=(0.5, 0.5), limits=(math.sqrt(3 / -BEND), 4 * math.sqrt(3 / -BEND))),
    _birth(fixed_foci, ("growth", 0.2),
           (lambda x, p: turning(x, -DECAY, 1.0), lambda x, p: turning(x, p.growth - CURVE * x.x, 1.0)),
           value=DECAY, limits=(math.pi / (math.exp(DECAY * math.pi) * curved(DECAY)[1]), 2 * math.pi)),
    _birth(fixed_focus_and_fold, ("growth", 0.1), (fold, lambda x, p: turning(x, p.growth - CURVE * x.x, 1.0)),
           limits=(math.pi / (2 * CURVE), math.pi)),
    _birth(fixed_folds, ("bend", 0.05), (fold, lambda x, p: {"x": -x.y, "y": 1 + p.bend * x.y - BRAKE * x.y**3}),
           exponents=(0.5, 0.5), limits=(math.sqrt(5 / (3 * BRAKE)), 4 * math.sqrt(5 / (3 * BRAKE)))),
)  # fmt: skip
