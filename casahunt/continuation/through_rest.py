"""Through the rest that a forced cycle shrinks to: its forcing passes zero, and the cycle goes on.

    x(t; lambda) = x*(t) + (lambda - lambda_0) y(t) + ...

A cycle of a forced system keeps its period, and a rest is one of its cycles.  Its size is |lambda - lambda_0| times a
constant, whichever the sign.  In units of its own size it takes for ever to come there; so it is looked for as far on
the other side.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from ..collocation.mesh import phase_breaks, transfer
from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit, unknowns_of
from ..orbits.restart import in_scale
from .curve import parameter_value
from .vanishing import solved_at

BEYOND_REST = 30.0
"""How many times farther from the rest than the last cycle the next one is."""


def through_rest(orbits: Sequence[AnyOrbit], vary: str, value: float, options: Options) -> Any:
    """The cycle on the other side of the rest that a branch of forced cycles shrinks to.

    orbits, vary: of the branch, and the name of its parameter; value: of the parameter where they are at rest.
    Returns Orbit; None where the system is not forced, or none was found.
    """
    before, last = orbits[-2:]
    family = last.problem
    if not family.forced:
        return None
    if before.signature != last.signature:
        return None
    t, u, setting = unknowns_of(last)
    other, v, its = in_scale(unknowns_of(before), setting.scale)
    _, v, _ = transfer(other, v, its.fractions, phase_breaks(t, setting.fractions), target=t)
    away = [parameter_value(orbit, vary) - value for orbit in (before, last)]
    rate = (u - v) / (away[1] - away[0])
    beyond = -BEYOND_REST * away[1]
    start = t, u + (beyond - away[1]) * rate, setting
    return solved_at(family.with_value(vary, value + beyond), start, options)
