"""Stuart-Landau oscillators with exact solutions: smooth cycles that show the order of a method.

Plain (`UNIFORM`), the normal form of a Hopf bifurcation:

    x' = mu x - omega y - (x^2 + y^2) x,      y' = omega x + mu y - (x^2 + y^2) y.

In polar coordinates r' = (mu - r^2) r, theta' = omega: the cycle is r = sqrt(mu), run through uniformly in
T = 2 pi/omega, and a deviation of r decays like exp(-2 mu t), so the multipliers are 1 and exp(-4 pi mu/omega).

With shear and an uneven clock (`KEPLER`):

    r' = (mu - r^2) r / q,    theta' = (omega + shear (r^2 - mu)) / q,    q = 1 - e x/sqrt(mu).

The cycle is the same circle.  On it omega dt = (1 - e cos theta) dtheta, hence Kepler's equation

    omega t = theta - e sin theta

and again T = 2 pi/omega.  The clock q changes neither the paths nor the period, and the shear makes the
matrix of the Poincare map no more than triangular, so the multipliers are the same, too.

Why the variant.  On the uniform circle every interval makes the same error by symmetry, and a scheme may be
better than its order there: the leading error of Radau is a change of radius, which the attraction heals and
the period does not see.  The shear turns errors of the radius into errors of the phase; the clock makes the
intervals of a uniform mesh unequal in difficulty, as e = 0.5 varies the speed by a factor of three.

Source: Kuznetsov, Elements of Applied Bifurcation Theory, section 3.4, for the normal form; the rest is
derived above.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from casahunt.cycle import Cycle, Event, Mode, Phase


def uniform_field(x: Any, p: Any, sign: Any) -> Any:
    """The plain oscillator; p = (mu, omega)."""
    mu, omega = p[0], p[1]
    growth = mu - (x[0] ** 2 + x[1] ** 2)
    return ca.vertcat(growth * x[0] - omega * x[1], omega * x[0] + growth * x[1])


def kepler_field(x: Any, p: Any, sign: Any) -> Any:
    """The oscillator with shear and an uneven clock; p = (mu, omega, shear, e)."""
    mu, omega, shear, e = p[0], p[1], p[2], p[3]
    growth = mu - (x[0] ** 2 + x[1] ** 2)
    turn = omega - shear * growth
    q = 1 - e * x[0] / ca.sqrt(mu)
    return ca.vertcat(growth * x[0] - turn * x[1], turn * x[0] + growth * x[1]) / q


def _crosses_axis(x: Any, duration: Any, p: Any) -> Any:
    return x[1] / ca.sqrt(p[0])


def _cycle(name: str, parameters: tuple[str, ...], field: Any) -> Cycle:
    phase = Phase(Mode("turn", field), Event("y = 0", _crosses_axis))
    return Cycle(name, ("x", "y"), parameters, (phase,), closure=np.eye(2), repeats=1)


UNIFORM = _cycle("Stuart-Landau cycle", ("mu", "omega"), uniform_field)
"""The plain oscillator, from y = 0 once round."""
KEPLER = _cycle("Stuart-Landau cycle on Kepler's clock", ("mu", "omega", "shear", "e"), kepler_field)
"""The oscillator with shear and an uneven clock, from y = 0 once round."""


def period(mu: float, omega: float, shear: float = 0.0, e: float = 0.0) -> float:
    """Exact period."""
    return 2 * np.pi / omega


def multiplier(mu: float, omega: float, shear: float = 0.0, e: float = 0.0) -> float:
    """Exact nontrivial Floquet multiplier."""
    return float(np.exp(-4 * np.pi * mu / omega))


def states(times: np.ndarray, mu: float, omega: float, shear: float = 0.0, e: float = 0.0) -> np.ndarray:
    """Exact states (2, m) on the cycle at times (m,), from (sqrt(mu), 0) at time 0; 0 <= e < 1."""
    mean = omega * np.asarray(times, float)
    theta = mean + e * np.sin(mean)
    for _ in range(20):  # Newton on Kepler's equation; converges from this start for e up to about 0.9
        theta = theta - (theta - e * np.sin(theta) - mean) / (1 - e * np.cos(theta))
    return np.sqrt(mu) * np.array([np.cos(theta), np.sin(theta)])
