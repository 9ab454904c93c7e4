"""A PID servo with LuGre friction that hunts: Canudas de Wit's example.

    m x'' = u - F,      u = -(kp x + kv x' + ki integral of x)
    F = sigma0 z + sigma1 z' + sigma2 x',      z' = x' - sigma0 |x'| z/g(x')
    g(v) = Fc + (Fs - Fc) exp(-(v/vs)^2)

The bristle z moves within Fs/sigma0 = 1.5e-5 and settles in 1e-3 of the time in which the mass slips: the modes are
stiff.  |x'| changes at x' = 0, which parts the two modes.  The cycle is the same under (x, ...) -> -(x, ...).

Source: C. Canudas de Wit, H. Olsson, K. J. Astrom and P. Lischinsky, A new model for control of systems with friction,
IEEE Transactions on Automatic Control 40 (1995) 419-425, section on PID position control.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle

from .gallery import Found, Truth, portrait, present


def moves(x: Any, p: Any) -> dict[str, Any]:
    """The field, for one sign of the velocity."""
    g = p.Fc + (p.Fs - p.Fc) * ca.exp(-((x.v / p.vs) ** 2))
    z_rate = x.v - p.sigma0 * p.sign * x.v * x.z / g
    friction = p.sigma0 * x.z + p.sigma1 * z_rate + p.sigma2 * x.v
    u = -(p.kp * x.x + p.kv * x.v + p.ki * x.w)
    return {"x": x.v, "v": (u - friction) / p.m, "w": x.x, "z": z_rate}


def speed(x: Any, p: Any) -> Any:
    """The velocity, of order one in a slip."""
    return x.v / p.vs


def onwards(x: Any, p: Any) -> Any:
    """The velocity in the direction of the mode."""
    return p.sign * speed(x, p)


def drop(x: Any, p: Any) -> Any:
    """The Stribeck drop, which passes within a part of a slip that is as small as vs."""
    return ca.exp(-((x.v / p.vs) ** 2))


SYSTEM = System(
    "PID servo with LuGre friction",
    states=("x", "v", "w", "z"),
    parameters={"kp": 3.0, "kv": 6.0, "ki": 4.0, "m": 1.0, "sigma0": 1e5, "sigma1": 1e5**0.5, "sigma2": 0.4,
                "Fc": 1.0, "Fs": 1.5, "vs": 1e-3},
    modes=(
        Mode("forwards", field=moves, sign=+1, holds=onwards, slack=1e-6, stiff=True, feature=drop,
             ends=(Event("turns back", speed, -1, to="backwards"),)),
        Mode("backwards", field=moves, sign=-1, holds=onwards, slack=1e-6, stiff=True, feature=drop,
             ends=(Event("turns forth", speed, +1, to="forwards"),)),
    ),
)  # fmt: skip

TRUTH = Truth(
    24.436786455993310,
    {
        "x": (-0.0639025103325494616, 0.0639025103325494616),
        "v": (-0.07774454047238064167, 0.07774454047238064167),
        "w": (-0.35858982317302902593, 0.35858982317302902593),
        "z": (-1.4728448650046808233e-05, 1.4728448650046808233e-05),
    },
    (0.006145704044283, 0.0, 0.0),
)
"""scripts/peers/gallery_truths.py."""


def cycles(tol: float = 1e-9) -> Iterator[Found]:
    """The cycle, from a mass let go at x = 1."""
    orbit = find_cycle(SYSTEM, "backwards", tol=tol, follow="ki", x=1.0, v=0.0, w=0.0, z=0.0)
    yield Found("Canudas de Wit's servo", orbit, TRUTH)


def draw(found: Sequence[Found], ax: Any) -> None:
    """Position and, scaled, the bristle over the time."""
    portrait(found[0].orbit, "t", "x", ax, label="x")
    times, states = found[0].orbit.sample(16)
    ax.plot(times, states[3] * 4e3, label="4000 z")
    ax.set(ylabel="")
    ax.legend()


if __name__ == "__main__":
    present(cycles(), draw, "PID servo with LuGre friction")
