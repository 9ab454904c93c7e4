"""The orbit at a turning point of a branch, between two orbits of a walk, solved for there and nowhere else.

    the turning point of the cubic between the orbits -> the extremum next to it (turn.py), on meshes adapted to the
    tolerance (orbits/adapt.py)

No orbit on the way there is adapted or estimated.  Where Newton's method does not lead there, steps along the branch do
(locating.py).
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from ..hybrid.problem import Problem
from ..orbits.adapt import Options, solve_adaptively
from ..orbits.border import row_along
from ..orbits.orbit import AnyOrbit, Orbit, orbit_of
from ..orbits.restart import Start
from .curve import Point, along, backwards, bend, ends, predict, seen_from

Array = np.ndarray

BEYOND = 0.1
"""Part of the way between two orbits by which a turning point between them may lie beyond either."""


def turned_orbit(problem: Problem, start: Start, vary: str, options: Options, bent: float) -> Any:
    """The orbit where a parameter is extremal, next to a point of the curve.

    problem, start: the problem at the parameters of the setting; transcription, unknowns, setting; bent: second
    derivative of lambda along the curve, about, with its sign; infinite where only that is known. Returns Orbit, of the
    class that the problem names; None where Newton's method does not lead to one.
    """
    began = time.perf_counter()
    t, u, setting = start
    setting = replace(setting, dp=along(problem, vary))
    row = row_along(t, u, setting)
    if not np.isfinite(row).all():
        return None
    solved = solve_adaptively(problem, (t, u, setting), options, solver="newton", border=row, bend=bent, soft=False)
    if not solved.status.ok:
        return None
    problem = problem.with_value(vary, problem.moved(vary, solved.solution.parameter))
    return orbit_of(solved, problem, wall_s=time.perf_counter() - began)


def turned_between(before: AnyOrbit, after: AnyOrbit, vary: str, options: Options) -> AnyOrbit | None:
    """The orbit where a parameter turns between two orbits of a walk.

    before, after: the orbits, in the order of the walk. Returns the orbit; None where Newton's method does not lead
    from the turning point of the cubic between them to one that lies between them too.
    """
    return _between(*ends(before, after, vary), before, vary, options)


def _between(here: Point, there: Point, orbit: AnyOrbit, vary: str, options: Options) -> AnyOrbit | None:
    """The orbit at the turning point between two points of the curve of `orbit`, from the first to the second."""
    if abs(there.row[-1]) < abs(here.row[-1]):
        here, there = backwards(there), backwards(here)
    value = _value(there, orbit, vary)
    problem = orbit.problem.with_value(vary, _value(here, orbit, vary))
    first = there.t.nodes_of(there.u)[0] * there.setting.scale / here.setting.scale
    ahead = _ahead(here, first, float(there.t.durations_of(there.u)[0]), problem.distance(vary, value))
    row = ahead / float(ahead @ here.row)  # the way between them: their tangents may differ by a right angle
    cubic = bend(there, here, seen_from(here, orbit, vary, value), side=1.0, row=row)
    ds, bent = (np.nan, np.nan) if cubic is None else _top(here.row[-1], cubic.coefficients[:, -1])
    if not 0 <= ds <= float(ahead @ row):
        return None
    u, lam, setting = predict(replace(here, row=row, bend=cubic), ds)
    start = here.t, u, setting.moved(lam)
    found = turned_orbit(problem.with_value(vary, problem.moved(vary, lam)), start, vary, options, bent)
    if found is None:
        return None
    arc, lam = found.arcs[0], problem.distance(vary, found.problem.value(vary))
    first = arc.states[0, 0] / here.setting.scale
    part = _ahead(here, first, arc.duration, lam) @ row / (ahead @ row)
    return found if -BEYOND <= part <= 1 + BEYOND else None


def _top(slope: float, cubic: Array) -> tuple[float, float]:
    """(s, second derivative) where slope s + c_0 s^2 + c_1 s^3, lambda or its logarithm, turns; NaN: nowhere.

    The first turn on the way, which bends against the slope there.
    """
    s = np.roots([3 * cubic[1], 2 * cubic[0], slope])
    s = s.real[abs(s.imag) <= 1e-9 * abs(s)]
    bent = 2 * cubic[0] + 6 * cubic[1] * s
    best = np.flatnonzero(bent * slope < 0)
    return (float(s[best[0]]), float(bent[best[0]])) if best.size else (np.nan, np.nan)


def _ahead(point: Point, first: Array, duration: float, lam: float) -> Array:
    """(n + 2,) the way from a point to another first node, scaled as there, first duration and lambda."""
    t, u = point.t, point.u
    longer = np.log(duration / t.durations_of(u)[0])
    return np.concatenate([first - t.nodes_of(u)[0], [longer, lam]])


def _value(point: Point, orbit: Orbit, vary: str) -> float:
    """The parameter at a point of the curve of an orbit."""
    return float(point.setting.p[orbit.problem.names.index(vary)])
