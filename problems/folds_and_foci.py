"""Cycles born where foci or folds of two fields meet on a switching manifold, x = 0 (hopf_like.py says what is told).

    focus       z' = (a + i w)(z - z_0), z = x + i y, half a turn in pi/w: y goes to -exp(pi a/w) y about z_0
    curved one  z' = (a - c x + i) z: 1/|z| obeys a linear equation in the angle, and half a turn takes pi
    fold        x' = -y, y' = -1 for x < 0: a parabola, which takes the time 2 y and turns y into -y, exactly
    curved one  x' = -y, y' = 1 + b y - k y^3 for x > 0: from -y to y + 2 b y^2/3 - 2 k y^4/5 + ...

Left and right, with what slips or changes:

    slipping foci        two foci on x = 0, the right one at y = mu        amplitude mu       period tends to pi/w + pi/w
    slipping focus, fold a fold at 0, a focus at y = mu                    amplitude mu       period tends to pi/w
    slipping folds       a fold at 0, a curved one at y = mu, k = 0        amplitude mu^1/2   period mu^1/2
    fixed foci           a focus with a = -1/10, a curved one: a = growth  amplitude growth - 1/10; period 2 pi
    fixed focus, fold    a fold, a curved focus with a = growth            amplitude growth   period tends to pi
    fixed folds          a fold, a curved one with b = bend                amplitude bend^1/2 period bend^1/2

The composition of two folds' maps has no term of third order where that of second order vanishes (each is an
involution), which is why the last one goes like a square root.

Source: the review named in hopf_like.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from casahunt.hybrid import Event, Mode, System

from .hopf_like import Birth, fixed

Values = Callable[[Any, Any], dict[str, Any]]

BEHIND = "x"


def two_sides(name: str, vary: str, begin: float, left: Values, right: Values) -> System:
    """A system with one field on either side of x = 0.

    Parameters
    ----------
    name
        of the system.
    vary, begin
        its parameter, and the value.
    left, right
        the fields.

    Returns
    -------
    System.
    """
    to_right = Event("to the right", lambda x, p: x.x, +1, to="right")
    to_left = Event("to the left", lambda x, p: x.x, -1, to="left")
    modes = (
        Mode("left", left, holds=lambda x, p: -x.x, ends=(to_right,)),
        Mode("right", right, holds=lambda x, p: x.x, ends=(to_left,)),
    )
    return System(name, ("x", "y"), {vary: begin}, modes)


def turning(x: Any, a: Any, w: Any, slip: Any = 0.0) -> dict[str, Any]:
    """A focus at (0, slip).

    Parameters
    ----------
    x
        states.
    a, w
        growth and turn.
    slip
        where it is.

    Returns
    -------
    The derivatives by name.
    """
    return {"x": a * x.x - w * (x.y - slip), "y": w * x.x + a * (x.y - slip)}


def fold(x: Any, p: Any) -> dict[str, Any]:
    """The left fold, at 0.

    Parameters
    ----------
    x, p
        states and parameters.

    Returns
    -------
    The derivatives by name.
    """
    return {"x": -x.y, "y": -1.0}


LEFT, RIGHT = (-0.3, 1.0), (0.2, 2.0)
"""(growth, turn) of the foci that slip; the right one of the focus and the fold decays at LEFT's rate."""
BEND = -0.5
"""b of the folds that slip."""
DECAY, CURVE, BRAKE = 0.1, 0.5, 0.5
"""-a of the left focus, c of the right one, k of the right fold, where they stay."""


def slipping_foci(mu: float) -> tuple[float, float]:
    """The truth.

    Parameters
    ----------
    mu
        the parameter.

    Returns
    -------
    Period, y.
    """
    left, right = (math.exp(math.pi * a / w) for a, w in (LEFT, RIGHT))
    return math.pi / LEFT[1] + math.pi / RIGHT[1], left * mu * (1 + right) / (1 - left * right)


def slipping_focus_and_fold(mu: float) -> tuple[float, float]:
    """The truth.

    Parameters
    ----------
    mu
        the parameter.

    Returns
    -------
    Period, y.
    """
    a, w = LEFT
    ratio = math.exp(math.pi * a / w)
    y = mu * (1 + ratio) / (1 - ratio)
    return math.pi / w + 2 * y, y


def height(b: float, s: float) -> float:
    """-x of the curved fold with k = 0, s away from where it is.

    Parameters
    ----------
    b, s
        as in the equations.

    Returns
    -------
    s/b - log(1 + b s)/b^2.
    """
    return (b * s - math.log1p(b * s)) / b**2


def slipping_folds(mu: float) -> tuple[float, float]:
    """The truth: s goes from -(y + mu) to y - mu.

    Parameters
    ----------
    mu
        the parameter.

    Returns
    -------
    Period, y.
    """
    near = math.sqrt(3 * mu / abs(BEND))
    y = fixed(lambda y: y + (height(BEND, y - mu) - height(BEND, -y - mu)) / y, near / 2, 2 * near)
    return 2 * y + math.log((1 + BEND * (y - mu)) / (1 - BEND * (y + mu))) / BEND, y


def curved(a: float) -> tuple[float, float]:
    """(ratio, offset): half a turn about the curved focus takes 1/|y| to ratio/|y| + offset.

    Parameters
    ----------
    a
        growth.

    Returns
    -------
    Both: u' = -a u + c cos t from t = -pi/2 to pi/2.
    """
    ratio = math.exp(-a * math.pi)
    return ratio, CURVE * (1 + ratio) / (1 + a * a)


def fixed_foci(growth: float) -> tuple[float, float]:
    """The truth.

    Parameters
    ----------
    growth
        the parameter.

    Returns
    -------
    Period, y.
    """
    ratio, offset = curved(growth)
    left = math.exp(DECAY * math.pi)
    return 2 * math.pi, (1 - left * ratio) / (left * offset)


def fixed_focus_and_fold(growth: float) -> tuple[float, float]:
    """The truth.

    Parameters
    ----------
    growth
        the parameter.

    Returns
    -------
    Period, y.
    """
    ratio, offset = curved(growth)
    y = (1 - ratio) / offset
    return math.pi + 2 * y, y


def fixed_folds(bend: float) -> tuple[float, float]:
    """The truth: x = -(integral of y/(1 + b y - k y^3)) is 0 again from -y to y.

    Parameters
    ----------
    bend
        the parameter.

    Returns
    -------
    Period, y.
    """
    from scipy.integrate import quad

    def speed(s: float) -> float:
        return 1 + bend * s - BRAKE * s**3

    def balance(y: float) -> float:  # odd part of s/speed(s), over y^3
        return float(quad(lambda s: s * (bend - BRAKE * s * s) * s / (speed(s) * speed(-s)), 0, y, epsrel=1e-13)[0]) / y**3

    near = math.sqrt(5 * bend / (3 * BRAKE))
    y = fixed(lambda y: y * (1 + balance(y)), near / 2, 2 * near)
    return 2 * y + float(quad(lambda s: 2 / (speed(s) * speed(-s)), 0, y, epsrel=1e-13)[0]), y


def _about(vary: str, begin: float, name: str, left: Values, right: Values, truth: Any, **laws: Any) -> Birth:
    _, y = truth(begin)
    system = two_sides(name, vary, begin, left, right)
    laws = {"value": 0.0, "amplitude": 1.0, "period": 0.0, **laws}
    return Birth(name, system, vary, begin=begin, start={"x": 0.0, "y": -y}, mode="right", measure="y", truth=truth, **laws)


_RATIO = math.exp(math.pi * LEFT[0] / LEFT[1])

BIRTHS = (
    _about("mu", 0.3, "slipping foci", lambda x, p: turning(x, *LEFT), lambda x, p: turning(x, *RIGHT, p.mu),
           slipping_foci, limits=(slipping_foci(1.0)[1], slipping_foci(1.0)[0])),
    _about("mu", 0.3, "slipping focus and fold", fold, lambda x, p: turning(x, *LEFT, p.mu),
           slipping_focus_and_fold, limits=((1 + _RATIO) / (1 - _RATIO), math.pi / LEFT[1])),
    _about("mu", 0.05, "slipping folds", fold,
           lambda x, p: {"x": p.mu - x.y, "y": 1 + BEND * (x.y - p.mu)},
           slipping_folds, amplitude=0.5, period=0.5, limits=(math.sqrt(3 / -BEND), 4 * math.sqrt(3 / -BEND))),
    _about("growth", 0.2, "fixed foci", lambda x, p: turning(x, -DECAY, 1.0),
           lambda x, p: turning(x, p.growth - CURVE * x.x, 1.0),
           fixed_foci, value=DECAY, limits=(math.pi / (curved(DECAY)[1] * math.exp(DECAY * math.pi)), 2 * math.pi)),
    _about("growth", 0.1, "fixed focus and fold", fold, lambda x, p: turning(x, p.growth - CURVE * x.x, 1.0),
           fixed_focus_and_fold, limits=(math.pi / (2 * CURVE), math.pi)),
    _about("bend", 0.05, "fixed folds", fold, lambda x, p: {"x": -x.y, "y": 1 + p.bend * x.y - BRAKE * x.y**3},
           fixed_folds, amplitude=0.5, period=0.5,
           limits=(math.sqrt(5 / (3 * BRAKE)), 4 * math.sqrt(5 / (3 * BRAKE)))),
)  # fmt: skip
