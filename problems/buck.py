"""A buck converter: a supply that is switched on and off by a ramp, with its cascade.

    v' = -v/(R C) + i/C,    L i' = -v + E where v is below the ramp, -v where it is above,    ramp = low + slope c

R = 22 Ohm, C = 47 uF, L = 20 mH; the clock c is a state that is set back every 400 us, when the ramp falls.

The cycle of one ramp flips at E = 24.5166 V, that of two at 31.1179 V.

Sources: J. H. B. Deane and D. C. Hamill, IEEE Transactions on Power Electronics 5 (1990) 260-268; E. Fossas and G.
Olivar, IEEE Transactions on Circuits and Systems I 43 (1996) 13-25 (24.5160 and 31.121 by simulation).  The digits:
the map from ramp to ramp with matrix exponentials, scripts/peers/branch_truths.py.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from casahunt.continuation import branch_off, follow
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course


def _switched(x: Any, p: Any) -> dict[str, Any]:
    return {"v": -x.v / (p.R * p.C) + x.i / p.C, "i": (p.sign * p.E - x.v) / p.L, "c": 1.0}


def _above(x: Any, p: Any) -> Any:
    return x.v - p.low - p.slope * x.c


CLOCK = Event(
    "ramp falls", lambda x, p: x.c / p.T - 1, +1, to=lambda x, p: "off" if x.v > p.low else "on",
    reset=lambda x, p: {"c": 0.0},
)  # fmt: skip
SYSTEM = System(
    "buck converter",
    states=("v", "i", "c"),
    parameters={"E": 20.0, "R": 22.0, "C": 47e-6, "L": 0.02, "T": 400e-6, "low": 11.75238, "slope": 1309.524},
    modes=(
        Mode("on", field=_switched, sign=1, ends=(Event("opens", _above, +1, to="off"), CLOCK)),
        Mode("off", field=_switched, sign=0, ends=(Event("closes", _above, -1, to="on"), CLOCK)),
    ),
)
FLIPS = (24.51657591, 31.11790427)
"""Of the cycle of one ramp and of that of two, correct to 3e-8; scripts/peers/branch_truths.py."""


def cycle() -> SystemOrbit:
    """The cycle of one ramp at E = 20 V."""
    return find_cycle(SYSTEM, "on", v=12.0, i=0.55, c=0.0)


def of_two() -> SystemOrbit:
    """The cycle of two ramps, next to where it branches off."""
    special: Any = follow(cycle(), "E", to=26.0).special
    twice: Any = branch_off(special[0], "E")
    return twice


def branches() -> Iterator[Course]:
    """Of one ramp, and of two."""
    yield Course("buck converter, one ramp", cycle, "E", 33.0, (("flip", FLIPS[0]),))
    yield Course("buck converter, two ramps", of_two, "E", 32.0, (("flip", FLIPS[1]),))
