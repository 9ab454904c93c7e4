"""Forced Duffing oscillators: a resonance that bends over, Ueda's loss of symmetry, a well of two.

    x'' + c x' + k x + x^3 = F cos(w t)

hardening    k = 1, c = 0.1, F = 0.5, w from 0.9 to 4: two folds of the symmetric cycle
Ueda         k = 0, c = 0.1, w = 1, F from 1: the symmetric cycle hands on to a lopsided pair, on the way to chaos
wells        k = -1, c = 0.25, w = 1, F from 0.05: the cycle in one well folds twice and flips

Sources: Guckenheimer and Holmes, Nonlinear Oscillations, section 2.2; Y. Ueda, Journal of Statistical Physics 20
(1979) 181-196.  The digits: scripts/peers/branch_truths.py.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import casadi as ca

from casahunt.hybrid import Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course


def field(x: Any, p: Any) -> dict[str, Any]:
    """The oscillator."""
    return {"x": x.v, "v": p.F * ca.cos(p.w * x.t) - p.c * x.v - p.k * x.x - x.x**3}


SYSTEM = System(
    "Duffing's oscillator",
    states=("x", "v"),
    parameters={"w": 0.9, "F": 0.5, "c": 0.1, "k": 1.0},
    modes=(Mode("smooth", field=field),),
    forcing_period=lambda p: 2 * math.pi / p.w,
)
UEDA, WELLS = {"w": 1.0, "F": 1.0, "c": 0.1, "k": 0.0}, {"w": 1.0, "F": 0.05, "c": 0.25, "k": -1.0}
FOLDS = (2.21193531702, 1.43867014551)
BREAKING = 2.28638170514
IN_A_WELL = (("fold", 0.26497948248), ("fold", 0.15980208604), ("flip", 0.18174237954))
"""scripts/peers/branch_truths.py, correct to their digits."""


def cycle(parameters: dict[str, float], x: float) -> SystemOrbit:
    """The cycle that the motion from x at rest settles on."""
    return find_cycle(SYSTEM, parameters=parameters, x=x, v=0.0)


def branches() -> Iterator[Course]:
    """The resonance from both sides, Ueda's, and the well."""
    folds = tuple(("fold", w) for w in FOLDS)
    yield Course("Duffing, up", lambda: cycle({}, 1.0), "w", 4.0, folds, how={"back": 0.5})
    yield Course("Duffing, down", lambda: cycle({"w": 4.0}, 0.0), "w", 0.9, folds, how={"back": 5.0})
    yield Course("Ueda", lambda: cycle(UEDA, 0.0), "F", 5.0, (("symmetry breaking", BREAKING),))
    yield Course("two wells", lambda: cycle(WELLS, 1.0), "F", 0.3, IN_A_WELL, how={"back": -0.5})
