"""A forced linear oscillator that hits a stop: x'' = A cos(w t) - c x' - k x below x = d, v+ = -e v- at x = d.

Between impacts the motion is linear and known; the times of the impacts are not.  The period is a multiple of that of
the forcing, exactly.

Source: the impact oscillator of COCO's toolbox hspo (Dankowicz and Schilder, Recipes for Continuation, SIAM 2013,
chapter 9), k = 1, c = 0.1, A = 1, w = 1, d = 1, e = 0.8; the theory is Nordmark's, Journal of Sound and Vibration 145
(1991) 279-297.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle

from .gallery import Found, Truth, portrait, present


def free(x: Any, p: Any) -> dict[str, Any]:
    """x' below the stop."""
    return {"x": x.v, "v": p.A * ca.cos(p.w * x.t) - p.c * x.v - p.k * x.x}


SYSTEM = System(
    "impact oscillator",
    states=("x", "v"),
    parameters={"A": 1.0, "k": 1.0, "c": 0.1, "w": 1.0, "d": 1.0, "e": 0.8},
    modes=(
        Mode("free", field=free, holds=lambda x, p: p.d - x.x,
             ends=(Event("impact", lambda x, p: x.x - p.d, +1, to="free", reset=lambda x, p: {"v": -p.e * x.v}),)),
    ),
    forcing_period=lambda p: 2 * ca.pi / p.w,
)  # fmt: skip

TRUTH = {
    (1.0, 1.0): Truth(6.283185307179586477,
                      {"x": (-1.1840600885370553, 1.0), "v": (-1.3565863500759056, 1.7043228073187798)},
                      (-0.5842953143414 + 0.00560035149249j, -0.5842953143414 - 0.00560035149249j)),
    (0.7, 1.0): Truth(8.975979010256552679,
                      {"x": (-2.293127766580543, 1.0), "v": (-1.5181064711701398, 1.9989780941722745)},
                      (-0.04183420553032 + 0.4064250687323j, -0.04183420553032 - 0.4064250687323j)),
    (0.5, 1.0): Truth(12.566370614359172954,
                      {"x": (-1.7083987256535164, 1.0), "v": (-0.9266608394110808, 0.8869670746550689)},
                      (-0.4156494015845 + 0.09687973316905j, -0.4156494015845 - 0.09687973316905j)),
    (2.8, 0.0): Truth(2.2439947525641381698,
                      {"x": (-0.4796304818102069, 0.0), "v": (-0.5866626647808757, 0.607915011263788)},
                      (-2.646309419409, -0.1932341572863)),
}  # fmt: skip
"""By (w, d); scripts/peers/gallery_truths.py.  Two impacts in a period at w = 0.7; a saddle at w = 2.8, in chaos."""
SADDLE = {"x": -0.47900722, "v": 0.04289251}
"""Next to the last one, at t = 0."""


def cycles(tol: float = 1e-9) -> Iterator[Found]:
    """The cycle of each case."""
    for (w, d), truth in TRUTH.items():
        unstable = w == 2.8
        start = SADDLE if unstable else {"x": 0.0, "v": 0.0}
        orbit = find_cycle(SYSTEM, tol=tol, parameters={"w": w, "d": d}, settled=unstable, start=start)
        yield Found(f"w = {w:g}, d = {d:g}", orbit, truth)


def draw(found: Sequence[Found], ax: Any) -> None:
    """The phase plane."""
    for one in found:
        portrait(one.orbit, "x", "v", ax, label=one.caption)
    ax.legend()


if __name__ == "__main__":
    present(cycles(), draw, "Impact oscillator")
