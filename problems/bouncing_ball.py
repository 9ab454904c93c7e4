"""A ball that bounces on a shaking table, exactly: x'' = -g above the table z = a sin(w t).

    impact at x = z:   v+ - z' = -e (v- - z')

A ball that meets the table once in n turns, T = 2 pi n/w, flies as a parabola between equal heights: v+ = g T/2, v- =
-v+.  The impact law then asks for the phase phi = w t of the impacts

    a w^2 cos(phi) = n pi g (1 - e)/(1 + e),

two of them from the fold a w^2 = n pi g (1 - e)/(1 + e) on.  The map from impact to impact has, at the cycle, the
determinant e^2 and the trace 1 + e^2 - (1 + e)^2 (a w^2/g) sin(phi): a saddle for sin(phi) < 0, and for sin(phi) > 0
a sink until it flips at

    (a w^2)^2 = (n pi g (1 - e)/(1 + e))^2 + (2 g (1 + e^2)/(1 + e)^2)^2.

Nothing is approximated here; the usual map for high bounces (v+ large against a w) has another determinant.

Sources: P. J. Holmes, The dynamics of repeated impacts with a sinusoidally vibrating table, Journal of Sound and
Vibration 84 (1982) 173-189; Guckenheimer and Holmes, Nonlinear Oscillations, section 2.4.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle

from .gallery import Found, Truth, portrait, present


def height(x: Any, p: Any) -> Any:
    """Of the ball above the table, in amplitudes of the table."""
    return x.x / p.a - ca.sin(p.w * x.t)


def bounced(x: Any, p: Any) -> dict[str, Any]:
    """The velocity behind an impact."""
    return {"v": -p.e * x.v + (1 + p.e) * p.a * p.w * ca.cos(p.w * x.t)}


SYSTEM = System(
    "bouncing ball",
    states=("x", "v"),
    parameters={"a": 0.0125, "e": 0.8, "w": 20.0, "g": 9.81},
    modes=(
        Mode("flight", flow=lambda x, t, p: {"x": x.x + x.v * t - p.g * t**2 / 2, "v": x.v - p.g * t}, holds=height,
             ends=(Event("impact", height, -1, to="flight", reset=bounced),)),
    ),
    forcing_period=lambda p: 2 * ca.pi / p.w,
)  # fmt: skip

CASES = ((1.001, 1, +1), (1.46, 1, +1), (1.001, 1, -1), (1.46, 1, -1), (3.2, 1, +1), (1.15, 2, +1), (1.3, 3, +1))
"""(a w^2 in units of the fold's, turns per bounce, sign of sin(phi)).  The fifth is beyond its flip, at 3.07."""


def truth(a: float, turns: int, sign: int) -> tuple[Truth, dict[str, float]]:
    """The closed form.

    sign: of sin(phi): +1 for a sink or what has flipped from it, -1 for the saddle.
    Returns truth, and the state behind the impact.
    """
    e, w, g = (SYSTEM.parameters[name] for name in ("e", "w", "g"))
    T = 2 * math.pi * turns / w
    phi = sign * math.acos(fold(turns) / (a * w**2))
    v, low = g * T / 2, a * math.sin(phi)
    trace = 1 + e**2 - (1 + e) ** 2 * a * w**2 * math.sin(phi) / g
    multipliers = np.roots([1, -trace, e**2])
    known = Truth(T, {"x": (low, low + v**2 / (2 * g)), "v": (-v, v)}, tuple(map(complex, multipliers)))
    return known, {"x": low, "v": v, "t": phi / w}


def fold(turns: int) -> float:
    """The a w^2 from which on the ball can bounce once in so many turns."""
    e, g = SYSTEM.parameters["e"], SYSTEM.parameters["g"]
    return turns * math.pi * g * (1 - e) / (1 + e)


def cycles(tol: float = 1e-9) -> Iterator[Found]:
    """The cycle of each case, from a state next to it."""
    for part, turns, sign in CASES:
        a = part * fold(turns) / SYSTEM.parameters["w"] ** 2
        known, state = truth(a, turns, sign)
        start = {"x": state["x"] + 1e-6, "v": state["v"], "t": state["t"]}
        orbit = find_cycle(SYSTEM, tol=tol, parameters={"a": a}, settled=True, start=start)
        yield Found(f"{turns} turns, {part:g} folds, {'lower' if sign < 0 else 'upper'} branch", orbit, known)


def draw(found: Sequence[Found], ax: Any) -> None:
    """Height over the time."""
    for one in found:
        portrait(one.orbit, "t", "x", ax, label=one.caption)
    ax.legend(fontsize="small")


if __name__ == "__main__":
    present(cycles(), draw, "A ball on a shaking table")
