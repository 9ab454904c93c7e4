"""A pair of gears with backlash: forced, linear where the teeth touch, free in the gap.

    x'' + 2 zeta x' + f(x) = load + F cos(w t),    f = x - 1 beyond 1, x + 1 beyond -1, 0 in the gap

With a small F the teeth never part, and the cycle is that of a linear oscillator round 1 + load, of amplitude
F/|1 - w^2 + 2 i zeta w|.  Where that is the load, the teeth touch with no force:

    (1 - w^2)^2 + (2 zeta w)^2 = (F/load)^2

Between the two grazings the resonance bends over to the left, with two folds.

Source: A. Kahraman and R. Singh, Non-linear dynamics of a spur gear pair, Journal of Sound and Vibration 142 (1990)
49-75.  The folds: matrix exponentials, scripts/peers/branch_truths.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import casadi as ca
import numpy as np

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course

LOAD, FORCE, ZETA = 0.1, 0.02, 0.05


def _touching(x: Any, p: Any) -> dict[str, Any]:
    return _pushed(x, p, x.x - p.sign)


def _free(x: Any, p: Any) -> dict[str, Any]:
    return _pushed(x, p, 0.0)


def _pushed(x: Any, p: Any, spring: Any) -> dict[str, Any]:
    return {"x": x.v, "v": p.load + p.F * ca.cos(p.w * x.t) - 2 * p.zeta * x.v - spring}


SYSTEM = System(
    "gears with backlash",
    states=("x", "v"),
    parameters={"w": 1.4, "F": FORCE, "load": LOAD, "zeta": ZETA},
    modes=(
        Mode("drives", field=_touching, sign=+1, ends=(Event("parts", lambda x, p: x.x - 1, -1, to="gap"),)),
        Mode("gap", field=_free, ends=(
            Event("touches", lambda x, p: x.x - 1, +1, to="drives"),
            Event("touches behind", lambda x, p: x.x + 1, -1, to="coasts"),
        )),
        Mode("coasts", field=_touching, sign=-1, ends=(Event("parts", lambda x, p: x.x + 1, +1, to="gap"),)),
    ),
    forcing_period=lambda p: 2 * math.pi / p.w,
)  # fmt: skip
FOLDS = (0.79799009623, 0.90933406581)
"""scripts/peers/branch_truths.py."""
GRAZINGS = tuple(math.sqrt(w2) for w2 in np.roots([1, 4 * ZETA**2 - 2, 1 - (FORCE / LOAD) ** 2]).real)
"""Of the closed form."""


def cycle(w: float) -> SystemOrbit:
    """The cycle that never parts, at a frequency outside of the resonance."""
    return find_cycle(SYSTEM, "drives", parameters={"w": w}, x=1.1, v=0.0)


def branches() -> Iterator[Course]:
    """The resonance from both sides."""
    special = (*(("fold", w) for w in FOLDS), *(("grazing", w) for w in GRAZINGS))
    yield Course("gears, down", lambda: cycle(1.4), "w", 0.5, special)
    yield Course("gears, up", lambda: cycle(0.5), "w", 1.4, special)
