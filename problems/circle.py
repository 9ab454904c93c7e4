"""The normal form of a Hopf bifurcation in a user's words: a uniform circle, beside a state that is zero.

    x' = (mu - r^2) x - omega y,      y' = omega x + (mu - r^2) y,      z' = -decay z,      r^2 = x^2 + y^2

The cycle is r = sqrt(mu), z = 0 in T = 2 pi/omega, with the multipliers exp(-4 pi mu/omega) and exp(-decay T).  Nothing
that is as large as one, no event, no parameter that sets a size: mu = 1e-6 is as good as mu = 1.

`problems/stuart_landau.py` has the same circle with uneven clocks, in the engine's terms, to measure orders.

Source: Y. A. Kuznetsov, Elements of Applied Bifurcation Theory, section 3.4.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from casahunt.hybrid import Mode, System
from casahunt.orbits import find_cycle

from .gallery import Found, Truth, portrait, present


def field(x: Any, p: Any) -> dict[str, Any]:
    """The normal form, and a state that decays."""
    growth = p.mu - x.x**2 - x.y**2
    return {"x": growth * x.x - p.omega * x.y, "y": p.omega * x.x + growth * x.y, "z": -p.decay * x.z}


SYSTEM = System(
    "Hopf normal form",
    states=("x", "y", "z"),
    parameters={"mu": 1.0, "omega": 1.0, "decay": 0.1},
    modes=(Mode("smooth", field=field),),
)

CASES = (
    (1.0, 1.0, 0.1, 0.0), (1.0, 1.0, 0.1, 1.0), (1e-2, 10.0, 1.0, 0.0), (100.0, 1.0, 1e-2, 0.0),
    (1e-2, 1e-3, 1e-3, 0.0),
)  # fmt: skip
"""(mu, omega, decay, z at the start)."""


def truth(mu: float, omega: float, decay: float) -> Truth:
    """The closed form.

    Returns truth: period, extrema, multipliers.
    """
    T, r = 2 * math.pi / omega, math.sqrt(mu)
    multipliers = sorted((math.exp(-2 * mu * T), math.exp(-decay * T)), reverse=True)
    return Truth(T, {"x": (-r, r), "y": (-r, r)}, tuple(map(complex, multipliers)))


def cycles(tol: float = 1e-9) -> Iterator[Found]:
    """The cycle of each case."""
    for mu, omega, decay, z in CASES:
        p = {"mu": mu, "omega": omega, "decay": decay}
        orbit = find_cycle(SYSTEM, tol=tol, parameters=p, x=0.5 * math.sqrt(mu), y=0.0, z=z)
        yield Found(f"mu = {mu:g}, omega = {omega:g}, z = {z:g}", orbit, truth(mu, omega, decay))


def draw(found: Sequence[Found], ax: Any) -> None:
    """The phase plane, in units of the radius."""
    portrait(found[0].orbit, "x", "y", ax)
    ax.set_aspect("equal")


if __name__ == "__main__":
    present(cycles(), draw, "Hopf normal form")
