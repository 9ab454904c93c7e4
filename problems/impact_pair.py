"""An impact pair: a ball between the two walls of a shaken box, in closed form.

    x'' = a w^2 cos(w t) for |x| < gap/2,    v+ = -e v- at either wall

The cycle that hits each wall once in a period is symmetric, x(t + T/2) = -x(t).  With the phase phi at the right wall
and the velocity v behind it,

    v = -2 e a w sin(phi)/(1 - e),    gap/a = pi (1 + e)/(1 - e) sin(phi) - 2 cos(phi).

The map of half a period has the determinant e^2 and the trace 2 e - (pi/2) (1 - e^2) cot(phi), so that it has a
multiplier

    +1 (fold)                 at cot(phi) = -2 (1 - e)/(pi (1 + e)):    gap/a = sqrt((pi (1 + e)/(1 - e))^2 + 4)
    -1 (loss of symmetry)     at cot(phi) = 2 (1 + e)/(pi (1 - e))

and the cycle is stable for the a between.

Sources: M. S. Heiman, P. J. Sherman and A. K. Bajaj, On the dynamics and stability of an inclined impact pair,
Journal of Sound and Vibration 114 (1987) 535-547; C. N. Bapat, N. Popplewell and K. McLachlan, ibid. 87 (1983) 19-40.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Any

import casadi as ca

from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import SystemOrbit, find_cycle

from .gallery import Course

E = 0.6


def _bounce(x: Any, p: Any) -> dict[str, Any]:
    return {"v": -p.e * x.v}


SYSTEM = System(
    "impact pair",
    states=("x", "v"),
    parameters={"a": 0.2, "gap": 1.0, "e": E, "w": 1.0},
    modes=(
        Mode("flies", field=lambda x, p: {"x": x.v, "v": p.a * p.w**2 * ca.cos(p.w * x.t)}, ends=(
            Event("right wall", lambda x, p: x.x - p.gap / 2, +1, to="flies", reset=_bounce),
            Event("left wall", lambda x, p: x.x + p.gap / 2, -1, to="flies", reset=_bounce),
        )),
    ),
    forcing_period=lambda p: 2 * math.pi / p.w,
)  # fmt: skip
SLOPE = math.pi * (1 + E) / (1 - E)
COTANGENT = 2 * (1 + E) / (math.pi * (1 - E))
FOLD = 1 / math.hypot(SLOPE, 2)
BREAKING = math.hypot(1, COTANGENT) / (SLOPE - 2 * COTANGENT)


def cycle(a: float = 0.2) -> SystemOrbit:
    """The stable symmetric cycle, from the closed form, with gap = w = 1."""
    phi = math.atan2(2, SLOPE) + math.asin(1 / (a * math.hypot(SLOPE, 2)))
    v = -2 * E * a * math.sin(phi) / (1 - E)
    return find_cycle(SYSTEM, parameters={"a": a}, settled=True, x=0.5 - 1e-7, v=v, t=phi)


def branches() -> Iterator[Course]:
    """Down round the fold, up through the loss of symmetry."""
    yield Course("impact pair, down", cycle, "a", 0.05, (("fold", FOLD),), how={"back": 0.25})
    yield Course("impact pair, up", cycle, "a", 0.5, (("symmetry breaking", BREAKING),))
