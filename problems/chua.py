"""Chua's circuit: linear in three zones, its cycles computed without an approximation.

    x' = alpha (y - x - f(x)),    y' = x - y + z,    z' = -beta y
    f = m0 x for |x| <= 1,    m1 x + (m0 - m1) sign(x) beyond,    beta = 100/7, m0 = -8/7, m1 = -5/7

The outer zones' equilibria are centres at

    alpha = 6.79766...:    a1 a2 = a3 in l^3 + a1 l^2 + a2 l + a3 of the outer zone,

where the cycles of the zone fill a disc up to the one that touches |x| = 1: from there the cycle goes on through two
zones. It flips at alpha = 8.175 on the way to the double scroll.

Sources: L. O. Chua, M. Komuro and T. Matsumoto, IEEE Transactions on Circuits and Systems 33 (1986) 1072-1118; the
birth of the cycle: V. Carmona, E. Freire, E. Ponce and F. Torres, ibid. I 49 (2002) 609-620.  The digits: matrix
exponentials, scripts/peers/branch_truths.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course


def _outer(x: Any, p: Any) -> dict[str, Any]:
    return _circuit(x, p, p.m1 * x.x + p.sign * (p.m0 - p.m1))


def _inner(x: Any, p: Any) -> dict[str, Any]:
    return _circuit(x, p, p.m0 * x.x)


def _circuit(x: Any, p: Any, f: Any) -> dict[str, Any]:
    return {"x": p.alpha * (x.y - x.x - f), "y": x.x - x.y + x.z, "z": -p.beta * x.y}


SYSTEM = System(
    "Chua's circuit",
    states=("x", "y", "z"),
    parameters={"alpha": 8.0, "beta": 100 / 7, "m0": -8 / 7, "m1": -5 / 7},
    modes=(
        Mode("right", field=_outer, sign=+1, ends=(Event("in", lambda x, p: x.x - 1, -1, to="middle"),)),
        Mode("middle", field=_inner, ends=(
            Event("out to the right", lambda x, p: x.x - 1, +1, to="right"),
            Event("out to the left", lambda x, p: x.x + 1, -1, to="left"),
        )),
        Mode("left", field=_outer, sign=-1, ends=(Event("in", lambda x, p: x.x + 1, +1, to="middle"),)),
    ),
)  # fmt: skip
FLIP, CENTRE = 8.17520835048, 6.797660498639
"""scripts/peers/branch_truths.py."""


def cycle() -> SystemOrbit:
    """The cycle round one equilibrium at alpha = 8."""
    return find_cycle(SYSTEM, "right", x=1.5, y=0.1, z=-1.5)


def branches() -> Iterator[Course]:
    """Up through the flip, and down to the disc of cycles."""
    yield Course("Chua, up", cycle, "alpha", 9.0, (("flip", FLIP),))
    ends = ("grazing", "vertical family")
    yield Course("Chua, down", cycle, "alpha", 6.0, (("grazing", CENTRE),), ends, {"back": 8.1})
