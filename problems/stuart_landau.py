"""Stuart-Landau oscillators with exact solutions: smooth cycles that show the order of a method.

Plain (`UNIFORM`), the normal form of a Hopf bifurcation:

    x' = mu x - omega y - (x^2 + y^2) x,      y' = omega x + mu y - (x^2 + y^2) y.

In polar coordinates r' = (mu - r^2) r, theta' = omega: the cycle is r = sqrt(mu), run through uniformly in
T = 2 pi/omega, and a deviation of r decays like exp(-2 mu t), so the multipliers are 1 and exp(-4 pi mu/omega).

With shear and an uneven clock (`KEPLER`):

    r' = (mu - r^2) r / q,    theta' = (omega + shear (r^2 - mu)) / q,    q = 1 - e x/sqrt(mu).

The cycle is the same circle.  On it omega dt = (1 - e cos theta) dtheta, hence Kepler's equation

    omega t = theta - e sin theta

and again T = 2 pi/omega.  The multipliers are the same, too: dr/dtheta has no q in it, and its slope on the
cycle is -2 mu/omega whatever the shear.

Two clocks (`TWO_CLOCKS`): the field of `KEPLER` where y > 0, that of `UNIFORM` where y < 0.  Either half of
the circle takes pi/omega, so period and multipliers stay as they are, while the speed jumps by the factor
1/(1 + e) at theta = pi: a cycle of two phases with two fields, whose multiplier needs a saltation matrix.

With hard excitation (`HARD`), two cycles in place of one:

    r' = (nu - 1) r + b r^3 - c r^5,    theta' = omega;      r^2 = (b -+ sqrt(b^2 - 4 c (1 - nu)))/(2 c),

the smaller one unstable.  They merge at nu = 1 - b^2/(4 c), the smallest nu with a cycle, with r^2 = b/(2 c).
With shear (`SHEARED`) theta' = omega + shear (r^2 - 1): T = 2 pi/theta', the multiplier is exp(T d r'/dr), and either
half of the cycle is the other one with the opposite sign (`SHEARED_HALF`).

Why the variants.  On the uniform circle every interval makes the same error by symmetry, and a scheme may be
better than its order there: the leading error of Radau IIA is a change of radius, which the attraction heals
and the period does not see, so its period converges like h^(2d) instead of h^(2d-1).  The shear turns errors
of the radius into errors of the phase; the clock makes the intervals of a uniform mesh unequal in difficulty,
as the speed varies by the factor (1 + e)/(1 - e).

Source: Kuznetsov, Elements of Applied Bifurcation Theory, section 3.4, for the normal form; the rest is
derived above.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import casadi as ca
import numpy as np

from casahunt.hybrid.system import Cycle, Phase, VectorEvent, VectorMode


def uniform_field(x: Any, p: Any, sign: Any) -> Any:
    """The plain oscillator, as CasADi expression.

    x: (2,) state x, y; sign: not used. Returns (2,) x'.
    """
    mu, omega = p[0], p[1]
    growth = mu - (x[0] ** 2 + x[1] ** 2)
    return ca.vertcat(growth * x[0] - omega * x[1], omega * x[0] + growth * x[1])


def kepler_field(x: Any, p: Any, sign: Any) -> Any:
    """The oscillator with shear and an uneven clock, as CasADi expression.

    x: (2,) state x, y; sign: not used. Returns (2,) x'.
    """
    mu, omega, shear, e = p[0], p[1], p[2], p[3]
    growth = mu - (x[0] ** 2 + x[1] ** 2)
    turn = omega - shear * growth
    q = 1 - e * x[0] / ca.sqrt(mu)
    return ca.vertcat(growth * x[0] - turn * x[1], turn * x[0] + growth * x[1]) / q


def hard_field(x: Any, p: Any, sign: Any) -> Any:
    """The oscillator with hard excitation, as CasADi expression.

    x: (2,) state x, y; sign: not used. Returns (2,) x'.
    """
    square = x[0] ** 2 + x[1] ** 2
    growth = p[0] - 1 + p[2] * square - p[3] * square**2
    return ca.vertcat(growth * x[0] - p[1] * x[1], p[1] * x[0] + growth * x[1])


def sheared_field(x: Any, p: Any, sign: Any) -> Any:
    """The oscillator with hard excitation and shear, as CasADi expression.

    x: (2,) state x, y; sign: not used. Returns (2,) x'.
    """
    square = x[0] ** 2 + x[1] ** 2
    growth, turn = p[0] - 1 + p[2] * square - p[3] * square**2, p[1] + p[4] * (square - 1)
    return ca.vertcat(growth * x[0] - turn * x[1], turn * x[0] + growth * x[1])


def _crosses_axis(x: Any, duration: Any, p: Any) -> Any:
    return x[1] / ca.sqrt(p[0])


_AXIS = VectorEvent("y = 0", _crosses_axis)
_PARAMETERS = ("mu", "omega", "shear", "e")


def _cycle(name: str, parameters: tuple[str, ...], *modes: VectorMode) -> Cycle:
    phases = tuple(Phase(mode, _AXIS) for mode in modes)
    return Cycle(name, ("x", "y"), parameters, phases, closure=np.eye(2), repeats=1)


UNIFORM = _cycle("Stuart-Landau cycle", _PARAMETERS[:2], VectorMode("turn", uniform_field))
"""The plain oscillator, from y = 0 once round."""
KEPLER = _cycle("Stuart-Landau cycle on Kepler's clock", _PARAMETERS, VectorMode("turn", kepler_field))
"""The oscillator with shear and an uneven clock, from y = 0 once round."""
TWO_CLOCKS = _cycle(
    "Stuart-Landau cycle on two clocks",
    _PARAMETERS,
    VectorMode("upper", kepler_field),
    VectorMode("lower", uniform_field),
)
"""Two phases: Kepler's clock above y = 0, the uniform one below."""
HARD = Cycle("oscillator with hard excitation", ("x", "y"), ("nu", "omega", "b", "c"),
             (Phase(VectorMode("turn", hard_field), _AXIS),), closure=np.eye(2), repeats=1)  # fmt: skip
"""Two cycles from a fold on, at which nu is smallest."""
SHEARED = Cycle("sheared oscillator", ("x", "y"), ("nu", "omega", "b", "c", "shear"),
                (Phase(VectorMode("turn", sheared_field), _AXIS),), closure=np.eye(2), repeats=1)  # fmt: skip
"""The same with a period that depends on the radius."""
SHEARED_HALF = replace(SHEARED, name="sheared oscillator, half cycle", closure=-np.eye(2), repeats=2)
"""Half of it."""


def period(mu: float, omega: float, shear: float = 0.0, e: float = 0.0) -> float:
    """The exact period.

    mu, omega, shear, e: parameters; only omega matters. Returns 2 pi/omega.
    """
    return 2 * np.pi / omega


def multiplier(mu: float, omega: float, shear: float = 0.0, e: float = 0.0) -> float:
    """The exact nontrivial Floquet multiplier.

    mu, omega, shear, e: parameters; only mu and omega matter. Returns exp(-4 pi mu/omega).
    """
    return float(np.exp(-4 * np.pi * mu / omega))


def states(times: np.ndarray, mu: float, omega: float, shear: float = 0.0, e: float = 0.0) -> np.ndarray:
    """Exact states of `KEPLER`, of `UNIFORM` for e = 0.

    times: (m,), from (sqrt(mu), 0) at time 0; mu, omega, shear, e: parameters, 0 <= e < 1; shear does not matter.
    Returns (2, m).
    """
    mean = omega * np.asarray(times, float)
    theta = mean + e * np.sin(mean)
    for _ in range(20):  # Newton on Kepler's equation; from this start it converges for e up to about 0.9
        theta = theta - (theta - e * np.sin(theta) - mean) / (1 - e * np.cos(theta))
    return np.sqrt(mu) * np.array([np.cos(theta), np.sin(theta)])


def sheared_square(nu: float, omega: float, b: float, c: float, shear: float, *, larger: bool = True) -> float:
    """r^2 of a cycle of `SHEARED`: of the larger, stable one or of the smaller one.

    larger: the larger, stable cycle; else the smaller one. Returns r^2.
    """
    return float((b + (1 if larger else -1) * np.sqrt(b**2 - 4 * c * (1 - nu))) / (2 * c))


def sheared_period(square: float, nu: float, omega: float, b: float, c: float, shear: float) -> float:
    """Period of the cycle of `SHEARED` with r^2 = square.

    square: r^2 of the cycle.
    """
    return 2 * np.pi / (omega + shear * (square - 1))


def sheared_multiplier(square: float, nu: float, omega: float, b: float, c: float, shear: float) -> float:
    """Nontrivial Floquet multiplier of the cycle of `SHEARED` with r^2 = square.

    square: r^2 of the cycle.
    """
    return float(np.exp(sheared_period(square, nu, omega, b, c, shear) * (nu - 1 + 3 * b * square - 5 * c * square**2)))
