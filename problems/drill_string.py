"""A drill string: a motor turns a bit through a flexible shaft, and friction holds the bit for a part of the period.

    J1 w1' = kp (speed - w1) - k phi - c (w1 - w2),     phi' = w1 - w2
    J2 w2' = k phi + c (w1 - w2) - T(w2)                while the bit turns
    w2 = 0    as long as    k phi + c w1 <= Ts          while it sticks

    T(w) = Tc + (Ts - Tc) exp(-w/ws),   w > 0

Torsional stick-slip of two inertias: the bit never turns back here, and the cycle is not symmetric.  Behind a stick the
state has one degree of freedom, in front of it two: one multiplier is zero.

Source: the model of J. D. Jansen and L. van den Steen, Active damping of self-excited torsional vibrations in oil well
drillstrings, Journal of Sound and Vibration 179 (1995) 647-668; the dimensionless parameters are chosen here.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle

from .gallery import Found, Truth, portrait, present


def shaft(x: Any, p: Any) -> Any:
    """The torque in the shaft."""
    return p.k * x.phi + p.c * (x.w1 - x.w2)


def motor(x: Any, p: Any) -> Any:
    """w1'."""
    return (p.kp * (p.speed - x.w1) - shaft(x, p)) / p.J1


def turns(x: Any, p: Any) -> dict[str, Any]:
    """x' while the bit turns."""
    friction = p.Tc + (p.Ts - p.Tc) * ca.exp(-x.w2 / p.ws)
    return {"phi": x.w1 - x.w2, "w1": motor(x, p), "w2": (shaft(x, p) - friction) / p.J2}


def sticks(x: Any, p: Any) -> dict[str, Any]:
    """x' while the bit sticks."""
    return {"phi": x.w1 - x.w2, "w1": motor(x, p), "w2": 0.0}


SYSTEM = System(
    "drill string",
    states=("phi", "w1", "w2"),
    parameters={"speed": 0.8, "J1": 1.0, "J2": 0.3, "k": 2.0, "c": 0.05, "kp": 3.0, "Tc": 0.4, "Ts": 1.0, "ws": 0.3},
    modes=(
        Mode("turns", field=turns, holds=lambda x, p: x.w2, ends=(Event("stops", lambda x, p: x.w2, -1, to="sticks"),)),
        Mode("sticks", field=sticks, holds=lambda x, p: 1 - shaft(x, p) / p.Ts,
             ends=(Event("breaks away", lambda x, p: shaft(x, p) / p.Ts - 1, +1, to="turns"),)),
    ),
)  # fmt: skip

TRUTH = {
    0.8: Truth(2.502029092825914,
        {"phi": (-0.08814869642019862, 0.6294539631994328), "w1": (0.4346667715128166, 0.8002763349944604),
         "w2": (0.0, 1.4883788712155632)},
        (0.0135833418053, 0.0)),
    0.4: Truth(3.720954559807012,
        {"phi": (0.06346472862405528, 0.5186838462930408), "w1": (0.0656096666816903, 0.31722469249781976),
         "w2": (0.0, 0.7288279973584136)},
        (0.00185171099656, 0.0)),
}  # fmt: skip
"""By the motor's speed; scripts/peers/gallery_truths.py."""


def cycles(tol: float = 1e-9) -> Iterator[Found]:
    """The cycle for each speed."""
    for speed, truth in TRUTH.items():
        orbit = find_cycle(SYSTEM, "sticks", tol=tol, parameters={"speed": speed}, phi=0.0, w1=speed, w2=0.0)
        yield Found(f"speed {speed:g}", orbit, truth)


def draw(found: Sequence[Found], ax: Any) -> None:
    """The speeds of both ends of the string."""
    for one, colour in zip(found, ("C0", "C1"), strict=True):
        portrait(one.orbit, "t", "w2", ax, color=colour, label=f"bit, {one.caption}")
        portrait(one.orbit, "t", "w1", ax, color=colour, linestyle="--")
    ax.set(ylabel="w2; w1 dashed")
    ax.legend()


if __name__ == "__main__":
    present(cycles(), draw, "Drill string")
