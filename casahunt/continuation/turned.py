"""The orbit at a turning point of a branch, between two orbits of a walk, solved for there and nowhere else.

    the turning point of the cubic between the orbits
         |
    mesh -> the turning point of the curve on it (turning_point.py) -> judge, estimate -> within tol and clear? -> done
     ^                                                                        | no
     +------------------------------------------------------------------------+

No orbit on the way there is adapted or estimated.  Where Newton's method does not lead there, steps along the branch do
(special_points.py).
"""

from __future__ import annotations

import time
from dataclasses import replace
from typing import Any

import numpy as np

from ..collocation.admissibility import judge, unclear_on_halves
from ..collocation.mesh import quartered_where
from ..collocation.remesh import better_breaks
from ..errors import Status
from ..hybrid.problem import Problem
from ..orbits.adapt import LEFT_OUT, MAX_INTERVALS, Options, on_breaks, presentable
from ..orbits.amplitude import estimated
from ..orbits.border import curve_border
from ..orbits.orbit import AnyOrbit, Orbit, Solved, orbit_of
from ..orbits.restart import Start
from .curve import Point, along, backwards, bend, ends, predict, seen_from
from .turning_point import turned_solution

Array = np.ndarray

MOST_MESHES = 6
FREEDOM = 0.1
"""|lambda| at which a turning point is not next to the start."""
BEYOND = 0.1
"""Part of the way between two orbits by which a turning point between them may lie beyond either."""


def turned_orbit(problem: Problem, start: Start, vary: str, options: Options, bent: float) -> Any:
    """The orbit where a parameter is largest, next to a point of the curve.

    problem, start: the problem at the parameters of the setting; transcription, unknowns, setting; bent: second
    derivative of lambda along the curve, about; NaN where it is not known. Returns Orbit, of the class that the problem
    names; None where Newton's method does not lead to one that is a motion.
    """
    began, iterations = time.perf_counter(), 0
    for k in range(MOST_MESHES):
        t, u, setting = start
        setting = replace(setting, dp=along(problem, vary))
        solution, row, bent = turned_solution(
            t, u, setting, bent, freedom=FREEDOM, accuracy=LEFT_OUT * options.tol
        )  # fmt: skip
        if solution is None:
            return None
        iterations += solution.iterations
        problem = problem.with_value(vary, problem.moved(vary, solution.parameter))
        u, setting = solution.u, setting.moved(solution.parameter)
        verdict = judge(t, u, setting)
        error = estimated(t, u, setting, border=curve_border(t, u, row), believed=options.tol)
        if verdict.violated or not np.isfinite(error.error):
            return None
        fine = error.error <= options.tol and presentable(error, options)
        if fine and verdict.admissible:
            verdict = replace(verdict, unclear=unclear_on_halves(t, error.better))
        if fine and verdict.admissible:
            solution = replace(solution, parameter=0.0, iterations=iterations)
            solved = Solved(t, solution, setting, error, Status.CONVERGED, iterations)
            return orbit_of(solved, problem, wall_s=time.perf_counter() - began)
        if fine:
            breaks = quartered_where(t, setting.fractions, verdict.unclear)
        else:
            breaks = better_breaks(t, setting.fractions, error, options.tol, k)
        if sum(b.size - 1 for b in breaks) > MAX_INTERVALS:
            return None
        start = on_breaks((t, u, setting), breaks)
    return None


def turned_between(before: AnyOrbit, after: AnyOrbit, vary: str, options: Options) -> AnyOrbit | None:
    """The orbit where a parameter is largest between two orbits of a walk.

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
    part = _ahead(here, arc.states[0, 0] / here.setting.scale, arc.duration, lam) @ row / (ahead @ row)
    return found if -BEYOND <= part <= 1 + BEYOND else None


def _top(slope: float, cubic: Array) -> tuple[float, float]:
    """(s, second derivative) where slope s + c_0 s^2 + c_1 s^3, lambda or its logarithm, is largest; NaN: nowhere."""
    s = np.roots([3 * cubic[1], 2 * cubic[0], slope])
    s = s.real[abs(s.imag) <= 1e-9 * abs(s)]
    bent = 2 * cubic[0] + 6 * cubic[1] * s
    best = np.flatnonzero(bent < 0)
    return (float(s[best[0]]), float(bent[best[0]])) if best.size else (np.nan, np.nan)


def _ahead(point: Point, first: Array, duration: float, lam: float) -> Array:
    """(n + 2,) the way from a point to another first node, scaled as there, first duration and lambda."""
    t, u = point.t, point.u
    longer = np.log(duration / t.durations_of(u)[0])
    return np.concatenate([first - t.nodes_of(u)[0], [longer, lam]])


def _value(point: Point, orbit: Orbit, vary: str) -> float:
    """The parameter at a point of the curve of an orbit."""
    return float(point.setting.p[orbit.problem.names.index(vary)])
