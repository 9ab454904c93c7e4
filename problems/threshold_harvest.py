"""Predators that are harvested as long as there are more of them than a threshold: a cycle that comes to slide.

    x' = x (1 - x/4) - x y/(1 + x),    y' = y (x/(1 + x) - 1/2 - h u),    u = 1 where y > T, 0 where y < T,    h = 1/5

Between, where harvest would bring y below T and no harvest above, 0 < x/(1 + x) - 1/2 < h, y stays at T.  As long as
T is above the largest y of the cycle without harvest, that cycle is the one; from there on it slides.

Source: M. I. S. Costa, E. Kaszkurewicz, A. Bhaya and L. Hsu, Achieving global convergence to an equilibrium
population in predator-prey systems by the use of a discontinuous harvesting policy, Ecological Modelling 128 (2000)
89-99.  The largest y: scripts/peers/branch_truths.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course


def _growth(x: Any, p: Any) -> Any:
    return x.x / (1 + x.x) - p.m


def _prey(x: Any, p: Any) -> Any:
    return x.x * (1 - x.x / p.K) - x.x * x.y / (1 + x.x)


def _harvested(x: Any, p: Any) -> dict[str, Any]:
    return {"x": _prey(x, p), "y": x.y * (_growth(x, p) - p.sign * p.h)}


def _stays(x: Any, p: Any) -> dict[str, Any]:
    return {"x": _prey(x, p), "y": 0.0}


def _over(x: Any, p: Any) -> str:
    return "harvest" if _growth(x, p) > p.h else "sliding"


def _under(x: Any, p: Any) -> str:
    return "free" if _growth(x, p) < 0 else "sliding"


SYSTEM = System(
    "predators harvested above a threshold",
    states=("x", "y"),
    parameters={"T": 3.0, "K": 4.0, "m": 0.5, "h": 0.2},
    modes=(
        Mode("free", field=_harvested, sign=0, ends=(Event("too many", lambda x, p: x.y - p.T, +1, to=_over),)),
        Mode("harvest", field=_harvested, sign=1, ends=(Event("few enough", lambda x, p: x.y - p.T, -1, to=_under),)),
        Mode("sliding", field=_stays, ends=(
            Event("falls", _growth, -1, to="free"),
            Event("rises", lambda x, p: _growth(x, p) - p.h, +1, to="harvest"),
        )),
    ),
)  # fmt: skip
LARGEST = 2.704028810863
"""The largest y without harvest; scripts/peers/branch_truths.py."""


def cycle() -> SystemOrbit:
    """The cycle that is never harvested, T = 3."""
    return find_cycle(SYSTEM, "free", x=1.0, y=1.0)


def branches() -> Iterator[Course]:
    """Down into the sliding."""
    yield Course("threshold harvest", cycle, "T", 2.5, (("grazing", LARGEST),))
