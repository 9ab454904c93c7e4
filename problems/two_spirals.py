"""Two spirals side by side, COCO's piecewise smooth oscillator: one law left of x = 0, another one right of it.

    left    r' = (1 - r) r,            theta' = 1
    right   r' = alpha (beta - r) r,   theta' = gamma + beta - r

Left, half a turn takes pi, and 1/r - 1 decays like exp(-t).  Right, theta' = gamma + (ln r)'/alpha, so half a turn
takes the s with pi = gamma s + ln(r_1/r_0)/alpha, while 1/r - 1/beta decays like exp(-alpha beta s).  What is left is
one equation for s inside another one for r_0.

Source: H. Dankowicz and F. Schilder, Recipes for Continuation, SIAM 2013, example 9.2 (alpha 1, beta 2, gamma 1.5).
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle

from .gallery import Found, Truth, portrait, present, root


def turning(x: Any, growth: Any, turn: Any) -> dict[str, Any]:
    """r' = growth r, theta' = turn in Cartesian coordinates."""
    return {"x": growth * x.x - turn * x.y, "y": growth * x.y + turn * x.x}


def left(x: Any, p: Any) -> dict[str, Any]:
    """The law for x < 0."""
    return turning(x, 1 - ca.sqrt(x.x**2 + x.y**2), 1.0)


def right(x: Any, p: Any) -> dict[str, Any]:
    """The law for x > 0."""
    r = ca.sqrt(x.x**2 + x.y**2)
    return turning(x, p.alpha * (p.beta - r), p.gamma + p.beta - r)


SYSTEM = System(
    "two spirals",
    states=("x", "y"),
    parameters={"alpha": 1.0, "beta": 2.0, "gamma": 1.5},
    modes=(
        Mode("left", field=left, holds=lambda x, p: -x.x,
             ends=(Event("to the right", lambda x, p: x.x, +1, to="right"),)),
        Mode("right", field=right, holds=lambda x, p: x.x,
             ends=(Event("to the left", lambda x, p: x.x, -1, to="left"),)),
    ),
)  # fmt: skip

CASES = ((1.0, 2.0, 1.5), (1.0, 0.3, 1.5), (4.0, 2.0, 1.5), (0.05, 2.0, 1.5))
"""(alpha, beta, gamma)."""


def truth(alpha: float, beta: float, gamma: float) -> Truth:
    """The closed form, but for one number.

    Returns truth: period, extrema of x, multiplier.
    """

    def radius(t: float, start: float, a: float, b: float) -> float:
        return 1 / (1 / b + (1 / start - 1 / b) * math.exp(-a * b * t))

    def angle(s: float, start: float) -> float:
        return gamma * s + math.log(radius(s, start, alpha, beta) / start) / alpha - math.pi / 2

    def through(low: float) -> tuple[float, float, float]:
        """(radius after the left half, after the right one, time of the right one) from a radius."""
        first = radius(math.pi, low, 1, 1)
        s = root(lambda s: angle(s, first) - math.pi / 2, math.pi / gamma)
        return first, radius(s, first, alpha, beta), s

    r = root(lambda r: through(r)[1] - r, beta)
    first, _, s = through(r)

    def x_left(t: float, slope: bool = False) -> float:
        rho, theta = radius(t, r, 1, 1), math.pi / 2 + t
        return (1 - rho) * math.cos(theta) - math.sin(theta) if slope else rho * math.cos(theta)

    def x_right(t: float, slope: bool = False) -> float:
        rho, theta = radius(t, first, alpha, beta), angle(t, first)
        turn = gamma + beta - rho
        return alpha * (beta - rho) * math.cos(theta) - turn * math.sin(theta) if slope else rho * math.cos(theta)

    low = x_left(root(lambda t: x_left(t, slope=True), math.pi / 2))
    high = x_right(root(lambda t: x_right(t, slope=True), s / 2))
    # Slopes of the halves; the time of the right one changes with the radius at its start as its equation says.
    left_half, right_half = (first / r) ** 2 * math.exp(-math.pi), (r / first) ** 2 * math.exp(-alpha * beta * s)
    rate = alpha * (beta - r) * r
    ds = -(right_half / r - 1 / first) / alpha / (gamma + rate / r / alpha)
    return Truth(math.pi + s, {"x": (low, high)}, (complex(left_half * (right_half + rate * ds)),))


def cycles(tol: float = 1e-9) -> Iterator[Found]:
    """The cycle of each case."""
    for alpha, beta, gamma in CASES:
        p = {"alpha": alpha, "beta": beta, "gamma": gamma}
        orbit = find_cycle(SYSTEM, "left", tol=tol, parameters=p, follow="beta", x=-1.0, y=0.0)
        yield Found(", ".join(f"{name} = {value:g}" for name, value in p.items()), orbit, truth(alpha, beta, gamma))


def draw(found: Sequence[Found], ax: Any) -> None:
    """The phase plane."""
    for one in found:
        portrait(one.orbit, "x", "y", ax, label=one.caption)
    ax.set_aspect("equal")
    ax.legend(fontsize="small", loc="center left", bbox_to_anchor=(1, 0.5))


if __name__ == "__main__":
    present(cycles(), draw, "Two spirals")
