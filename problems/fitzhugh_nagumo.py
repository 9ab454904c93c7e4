"""FitzHugh's and Nagumo's nerve: canards, by which a cycle grows from nothing to its full size in no range at all.

    v' = v - v^3/3 - w + I,    w' = eps (v + a - b w),    eps = 0.08, a = 0.7, b = 0.8

It is the same for (-v, 7/4 - w, 7/4 - I): the two ends of the range of cycles are images of each other.  At either
end the cycle comes to a fold, so sharp that the parameter does not change in the first seven digits while the cycle
shrinks to a half, and ends at a Hopf point,

    v_H^2 = 1 - eps b,    I_H = (v_H + a)/b - v_H + v_H^3/3

Sources: R. FitzHugh, Biophysical Journal 1 (1961) 445-466; J. Nagumo, S. Arimoto and S. Yoshizawa, Proceedings of the
IRE 50 (1962) 2061-2070.  The fold: scripts/peers/branch_truths.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from functools import partial
from typing import Any

from casahunt.hybrid import Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course

EPS, A, B = 0.08, 0.7, 0.8


def field(x: Any, p: Any) -> dict[str, Any]:
    """The nerve."""
    return {"v": x.v - x.v**3 / 3 - x.w + p.I, "w": p.eps * (x.v + p.a - p.b * x.w)}


SYSTEM = System(
    "FitzHugh and Nagumo's nerve", ("v", "w"), {"I": 0.5, "eps": EPS, "a": A, "b": B}, (Mode("smooth", field=field),)
)


def _hopf(side: int) -> float:
    v = side * math.sqrt(1 - EPS * B)
    return (v + A) / B - v + v**3 / 3


FOLDS = (0.32417852250371, 1.75 - 0.32417852250371)
"""scripts/peers/branch_truths.py, correct to 1e-13."""
HOPF = (_hopf(-1), _hopf(1))


def cycle(v: float = 1.0) -> SystemOrbit:
    """The cycle at I = 0.5, from w = 0 and v: where the search cuts it depends on that."""
    return find_cycle(SYSTEM, v=v, w=0.0)


def branches() -> Iterator[Course]:
    """To either end."""
    for v in (1.0, 0.0):
        ends = (("fold", FOLDS[0]), ("Hopf", HOPF[0]))
        yield Course(f"nerve, down, from v = {v:g}", partial(cycle, v), "I", 0.2, ends, ("Hopf",))
    ends = (("fold", FOLDS[1]), ("Hopf", HOPF[1]))
    yield Course("nerve, up", cycle, "I", 1.6, ends, ("Hopf",))
