"""A forced oscillator with dry friction: it slips either way, and sticks for a part of the period.

    x'' + 2 zeta x' + x = f0 cos(w t) - eta sign(x')       while it slips
    x' = 0   as long as   |f0 cos(w t) - x| <= tau         while it sticks

eta is what friction resists with in motion, tau >= eta what it can hold.  The forcing changes its sign after half a
turn, so the cycle is the same under x -> -x, t -> t + pi/w, and half of it is computed.  Every piece is linear.

Source, for tau = eta: J. P. Den Hartog, Forced vibrations with combined viscous and Coulomb damping, Philosophical
Magazine, series 7, vol. 9 (1930), from p. 801 on, who solves it for motions that never stop.  That friction holds more
than it resists with in motion is the usual law of stiction; the parameters are chosen here, and the numbers below are
no paper's.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import casadi as ca

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle

from .gallery import Found, Truth, portrait, present


def pull(x: Any, p: Any) -> Any:
    """What pulls at the mass besides friction, at rest."""
    return p.f0 * ca.cos(p.w * x.t) - x.x


def slips(sign: int) -> Mode:
    """The slip in one direction: it comes to rest, and turns back where the pull is too large to be held."""
    return Mode(
        "forwards" if sign > 0 else "backwards",
        field=lambda x, p: {"x": x.v, "v": pull(x, p) - 2 * p.zeta * x.v - p.eta * sign},
        holds=lambda x, p: sign * x.v,
        ends=(Event("stops", lambda x, p: x.v, -sign, to=after_stop),),
    )


def after_stop(x: Any, p: Any) -> str:
    """The mode behind a stop."""
    force = float(pull(x, p))
    return "stick" if abs(force) <= p.tau else "forwards" if force > 0 else "backwards"


SYSTEM = System(
    "forced dry friction oscillator",
    states=("x", "v"),
    parameters={"f0": 1.5, "w": 0.9, "zeta": 0.05, "tau": 1.1, "eta": 1.0},
    modes=(
        slips(+1),
        slips(-1),
        Mode("stick", flow=lambda x, t, p: {"x": x.x, "v": 0.0}, holds=lambda x, p: 1 - (pull(x, p) / p.tau) ** 2,
             ends=(Event("forwards", lambda x, p: pull(x, p) / p.tau - 1, +1, to="forwards"),
                   Event("backwards", lambda x, p: pull(x, p) / p.tau + 1, -1, to="backwards"))),
    ),
    forcing_period=lambda p: 2 * ca.pi / p.w,
)  # fmt: skip

TRUTH = {
    (1.5, 0.9, 1.1): Truth(6.981317007977318,
        {"x": (-2.420236350574373, 2.420236350574373), "v": (-2.2965063735866966, 2.2965063735866966)},
        (0.569365537014, 0.0872331875142)),
    (1.5, 0.3, 1.1): Truth(20.943951023931955,
        {"x": (-1.0247242397281202, 1.0247242397281202), "v": (-0.7536171195260187, 0.7536171195260187)},
        (0.0212782422087, 0.0)),
    (3.0, 0.9, 1.1): Truth(6.981317007977318,
        {"x": (-10.741135605290129, 10.741135605290129), "v": (-9.703755007654353, 9.703755007654353)},
        (0.449177207649 + 0.333366399362j, 0.449177207649 - 0.333366399362j)),
    (1.5, 0.6, 1.0): Truth(10.471975511965978,
        {"x": (-1.8141265715207429, 1.8141265715207429), "v": (-1.4727847802537188, 1.4727847802537188)},
        (0.0417697768783, 0.0)),
}  # fmt: skip
"""By (f0, w, tau); scripts/peers/gallery_truths.py.  It sticks at the second and the last."""


def cycles(tol: float = 1e-9) -> Iterator[Found]:
    """The cycle of each case, from a stick."""
    for (f0, w, tau), truth in TRUTH.items():
        p = {"f0": f0, "w": w, "tau": tau}
        orbit = find_cycle(SYSTEM, "stick", tol=tol, parameters=p, x=f0 - 0.5, v=0.0)
        yield Found(f"f0 = {f0:g}, w = {w:g}, tau = {tau:g}", orbit, truth)


def draw(found: Sequence[Found], ax: Any) -> None:
    """The phase plane."""
    for one in found:
        portrait(one.orbit, "x", "v", ax, label=one.caption)
    ax.legend(fontsize="small")


if __name__ == "__main__":
    present(cycles(), draw, "Forced oscillator with dry friction")
