"""The orbit between two of a branch at which a monitor vanishes (special_points.py).

    f(s) = 0    by inverse interpolation between true corrections, s the arclength from the orbit that is closer
    fold        the turning point of the cubic between the orbits -> the extremum next to it
    (collocation/fold_system.py), on
                meshes adapted to the tolerance (orbits/adapt.py)

The parameter value of a fold is second order in the place on the curve: it comes out to rounding.  No orbit on the way
to one is adapted or estimated; where Newton's method does not lead there, steps along the branch do.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import NoOrbit
from ..hybrid.problem import Problem
from ..orbits.adapt import Options, refined
from ..orbits.bordering import row_along
from ..orbits.orbit import AnyOrbit, Orbit
from ..orbits.restart import Start
from ..roots import CLOSED, Bracket, Search
from .curve import (
    CurvePoint,
    along,
    backwards,
    bend,
    bent_through,
    curve_point,
    ends,
    in_units_of,
    parameter_value,
    predict,
    secant_direction,
    seen_from,
    solved_along,
)
from .special_points import ACCEPTED_TOLERANCES, FOLD, Monitor
from .walk import step_along, walk

Array = np.ndarray

BEYOND = 0.1
"""Part of the way between two orbits by which a turning point between them may lie beyond either."""
LOCATE_ROUNDS = 40
"""Four, as a rule; so many halvings leave 1e-12 of the way at a jump."""
MAX_FAILURES = 8
"""Places in a row that fail, each 2 % of the bracket farther from where the root is expected: 16 % to either side."""
FIRST_PART, STEPS_NEARER = 0.25, 30
"""First step of a walk from one orbit to the other, as a part of the way; how many it makes."""


def turned_orbit(problem: Problem, start: Start, vary: str, options: Options, bent: float) -> Any:
    """The orbit where a parameter is extremal, next to a point of the curve.

    problem, start: the problem at the parameters of the setting; transcription, unknowns, setting; bent: second
    derivative of lambda along the curve, about, with its sign; infinite where only that is known. Returns Orbit, of the
    class that the problem names; None where Newton's method does not lead to one.
    """
    t, u, setting = start
    setting = replace(setting, dp=along(problem, vary))
    row = row_along(t, u, setting)
    if not np.isfinite(row).all():
        return None
    found = solved_along(problem, (t, u, setting), vary, row, options, bend=bent, soft=False)
    return None if isinstance(found, str) else found


def turned_between(before: AnyOrbit, after: AnyOrbit, vary: str, options: Options) -> AnyOrbit | None:
    """The orbit where a parameter turns between two orbits of a walk.

    before, after: the orbits, in the order of the walk. Returns the orbit; None where Newton's method does not lead
    from the turning point of the cubic between them to one that lies between them too.
    """
    return _between(*ends(before, after, vary), before, vary, options)


def _between(here: CurvePoint, there: CurvePoint, orbit: AnyOrbit, vary: str, options: Options) -> AnyOrbit | None:
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


def _ahead(point: CurvePoint, first: Array, duration: float, lam: float) -> Array:
    """(n + 2,) the way from a point to another first node, scaled as there, first duration and lambda."""
    t, u = point.t, point.u
    longer = np.log(duration / t.durations_of(u)[0])
    return np.concatenate([first - t.nodes_of(u)[0], [longer, lam]])


def _value(point: CurvePoint, orbit: Orbit, vary: str) -> float:
    """The parameter at a point of the curve of an orbit."""
    return float(point.setting.p[orbit.problem.names.index(vary)])


def locate_special_point(
    before: AnyOrbit, after: AnyOrbit, monitor: Monitor, *, vary: str, options: Options
) -> AnyOrbit | None:
    """The orbit between two at which a monitor vanishes.

    Steps start at the orbit where it is smaller, which is as a rule the closer one, along its tangent; where they fail,
    at the other.

    before, after: the orbits, in the order of the walk. Returns the orbit; None where the steps there do not converge.
    """
    found = turned_between(before, after, vary, options) if monitor.kind == FOLD.kind else None
    if found is not None:
        return found
    start, end = ends(before, after, vary)
    if abs(monitor.value(after, end)) < abs(monitor.value(before, start)):
        before, after = after, before
    orbit = _located_from(before, after, monitor, vary=vary, options=options)
    orbit = orbit or _located_from(after, before, monitor, vary=vary, options=options)
    return orbit or _located_nearer(before, after, monitor, vary=vary, options=options)


def _located_nearer(
    before: AnyOrbit, after: AnyOrbit, monitor: Monitor, *, vary: str, options: Options
) -> AnyOrbit | None:
    """`locate_special_point` where no step from either leads there: a walk with shorter ones does, as the curve
    bends."""
    last, value = before, monitor.value(before, ends(before, after, vary)[0])
    for orbit in nearer(before, after, vary, options):
        f = monitor.value(orbit, ends(last, orbit, vary)[1])
        if f * value < 0:
            return _located_from(last, orbit, monitor, vary=vary, options=options)
        last, value = orbit, f
    return None


def nearer(before: AnyOrbit, after: AnyOrbit, vary: str, options: Options) -> Iterator[AnyOrbit]:
    """The orbits of a walk from one orbit towards another of its branch, in shorter steps, as far as one leads."""
    way, (low, high) = secant_direction(before, after, vary), before.problem.range_of(vary)
    first = FIRST_PART * float(np.linalg.norm(way))
    with suppress(NoOrbit):
        yield from walk(
            before, vary=vary, low=low, high=high, heading=way, options=options, first_step=first,
            max_points=STEPS_NEARER,
        )  # fmt: skip


def _accurate(orbit: AnyOrbit, options: Options) -> AnyOrbit:
    """The orbit to the tolerance, on a mesh that serves all the steps from it; as it is where that fails."""
    if orbit.error_estimate > options.tol:
        with suppress(NoOrbit):
            return refined(orbit, options)
    return orbit


def _located_from(
    before: AnyOrbit, after: AnyOrbit, monitor: Monitor, *, vary: str, options: Options
) -> AnyOrbit | None:
    """`locate_special_point` by steps from `before`; their length along its tangent is the unknown."""
    before = _accurate(before, options)
    start, end = ends(before, after, vary)
    length = length_to(after, before, start, vary)
    f_near, f_far = monitor.value(before, start), monitor.value(after, end)
    if np.isnan(f_far):
        return None
    f_far = f_far or -np.copysign(np.inf, f_near)
    if not f_near * f_far < 0:  # refined, `before` has the sign of the other side: the point is next to it
        f_near = -np.copysign(np.inf, f_far)
    search = Search.within(Bracket(0.0, f_near, length, f_far))
    far = seen_from(start, before, vary, parameter_value(after, vary))
    start = replace(start, bend=bend(end, start, far, side=1.0))
    best: tuple[float, AnyOrbit] | None = None
    accepted = ACCEPTED_TOLERANCES * monitor.tolerance
    for _ in range(LOCATE_ROUNDS):
        if search.failures > MAX_FAILURES:
            break
        ds = search.ask()
        outcome = step_along(start, before, vary, ds, *before.problem.range_of(vary), options)
        if isinstance(outcome, str):
            search = search.failed()
            continue
        orbit = outcome[0]
        start = bent_through(start, ds, outcome[1], before.problem.distance(vary, parameter_value(orbit, vary)))
        f = monitor.value(orbit, curve_point(orbit, vary, like=start.row))
        if np.isfinite(f) and (best is None or abs(f) < abs(best[0])):
            best = (f, orbit)
        if abs(f) <= monitor.tolerance or search.bracket.width <= CLOSED * search.bracket.b:
            break
        last = min((abs(value) for _, value in search.seen), default=np.inf)
        search = search.told(ds, f)
        if abs(f) > last and max(abs(search.bracket.f_a), abs(search.bracket.f_b)) <= accepted:
            break  # a jump over zero, by the error of the orbits: their meshes change from one step to the next
    return best[1] if best and abs(best[0]) <= accepted else None


def length_to(after: Orbit, before: Orbit, start: CurvePoint, vary: str) -> float:
    """How far one orbit is from another.

    after, before, start, vary: the orbits, the curve at the second, and the name of the parameter.
    Returns the length along the tangent there.
    """
    return float(in_units_of(secant_direction(before, after, vary), before.scale, start.setting.scale) @ start.row)
