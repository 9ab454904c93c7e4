"""The curve of a branch: its points, its tangent and the predictor.

The curve is {y} = {(x_0, ln T_1, lambda)}: first node, duration of the first phase, and the parameter
p = p_here + lambda dp, moved in units of its value (Problem.unit).  At arclength s:

    tangent     J (du, dlambda) = 0 with |dy| = 1, oriented forwards
    predictor   the polynomial through the last points and their tangents (predictor.py)

x_0 is in units of the state scale, which follows the orbit.  The whole orbit is a function of x_0 and lambda, but next
to a sharp fold not a fair one: a first phase that lingers next to a repelling motion (a canard) changes altogether
while x_0 and the parameter move by 1e-7.  Its duration tells; the others, of long phases at rest, would decide all.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, cast

import numpy as np

from ..collocation.mesh import sizes_of_states
from ..collocation.node_system import Linearisation
from ..collocation.transcription import Setting, Transcription
from ..errors import NoOrbit, Status
from ..hybrid.problem import Problem
from ..orbits.adapt import Options, solve_adaptively
from ..orbits.bordering import curve_border, with_other_phases
from ..orbits.orbit import AnyOrbit, Orbit, SolvedOrbit, linearised, orbit_of, unknowns_of
from ..orbits.restart import Start, in_scheme
from .predictor import (
    Bend,
    RelativePoint,
    alive,
    bent,
    logarithms,
    stiff,
    straight,
    unknowns,
)

Array = np.ndarray

STRAIGHT = 0.5
"""Cosine between successive tangents below which the last point says little about the next."""


@dataclass(frozen=True, eq=False)
class CurvePoint:
    """A point of the curve in the solver's terms.

    Attributes
    ----------
    t, u, setting : transcription, unknowns and numbers, with p at this point and dp = p e.
    row : (n + 2,) unit tangent in (x_0, ln T_1, lambda).
    du : (size,) derivative of u by arclength.
    bend : what the points before say of the way beyond the tangent; None at the first point and after a change of the
        phase sequence.
    moves : whether its mesh moves along where no mode is stiff: on the way to a fold, where nothing else is looked for.
    """

    t: Transcription
    u: Array
    setting: Setting
    row: Array
    du: Array
    bend: Bend | None = None
    moves: bool = False


def parameter_value(orbit: Orbit, vary: str) -> float:
    """Value of a parameter at an orbit.

    orbit, vary: the orbit, and the name of the parameter.
    """
    return orbit.problem.value(vary)


def solved_at(problem: Problem, start: Start, options: Options) -> Orbit | None:
    """The cycle next to a starting point, at the parameters of the problem, by Newton's method: IPOPT goes elsewhere.

    problem, start, options: the problem, the starting point, and the tolerance.
    Returns Orbit; None where it does not converge.
    """
    began = time.perf_counter()
    t, u, setting = start
    start, near = (t, u, replace(setting, p=problem.vector())), replace(options, solver="newton")
    solved = solve_adaptively(problem, start, near, solver="newton")
    return orbit_of(solved, problem, wall_s=time.perf_counter() - began) if solved.status.ok else None


def solved_along(
    problem: Problem, start: Start, vary: str, row: Array, options: Options, *, began: float | None = None, **how: Any
) -> Any:
    """The cycle next to a starting point under a row of the curve, the parameter being free.

    row: (n + 2,); began: when the search for it began; how: as of `solve_adaptively`. Returns Orbit, of the class that
    the problem names; or the Complaint about why there is none.
    """
    began = time.perf_counter() if began is None else began
    solved = solve_adaptively(problem, start, options, solver="newton", border=row, **how)
    if not solved.status.ok or solved.estimate is None:
        return solved.complaint()
    there = problem.with_value(vary, problem.moved(vary, solved.solution.parameter))
    return orbit_of(solved, there, wall_s=time.perf_counter() - began)


def secant_direction(before: Orbit, after: Orbit, vary: str) -> Array:
    """The way from one orbit to the next.

    Returns (n + 2,) in (x_0, ln T_1, lambda), in the scale of `before`.
    """
    x = (after.arcs[0].states[0, 0] - before.arcs[0].states[0, 0]) / before.scale
    lam = before.problem.distance(vary, parameter_value(after, vary))
    # Where the phases are not the same, T_1 may be another thing.
    longer = np.log(after.arcs[0].duration / before.arcs[0].duration) if before.signature == after.signature else 0.0
    return np.concatenate([x, [longer, lam]])


def in_units_of(row: Array, scale: Array, other: Array) -> Array:
    """A direction of the curve in other units.

    row: (n + 2,) direction; scale, other: (n,) its state scale, and that of the result. Returns (n + 2,).
    """
    n = scale.size
    return np.concatenate([row[:n] * scale / other, row[n:]])


def cosine(before: CurvePoint, after: CurvePoint) -> float:
    """The angle between the tangents at two points; without ln T_1 where that is another thing."""
    carried, row = in_units_of(before.row, before.setting.scale, after.setting.scale), after.row
    if before.t.cycle != after.t.cycle:
        told = with_other_phases(carried, *(float(at.t.durations_of(at.u)[0]) for at in (before, after)))
        carried, row = told, np.where(told == carried, row, 0.0)
    return float(carried @ row / (np.linalg.norm(carried) * np.linalg.norm(row) or 1.0))


def curve_point(orbit: Orbit, vary: str, *, like: Array | None = None, sense: float = 1.0) -> CurvePoint:
    """The curve at an orbit, with its tangent.

    orbit, vary: a converged orbit and the name of the parameter; like: (n + 2,) direction to go on in; the tangent
    makes an acute angle with it; sense: where `like` is None, +1 to go on towards larger, -1 towards smaller parameter
    values.
    """
    t, u, setting, lin = linearised(orbit, vary)
    return point_at(t, u, setting, setting.dp, like=like, sense=sense, lin=lin)


def along(problem: Problem, vary: str, value: float | None = None) -> Array:
    """The way dp that p goes for lambda = 1.

    problem, vary, value: the problem, the name of the parameter, and where it stands: default the problem's own value.
    Returns (np,).
    """
    return problem.direction(vary) * problem.unit(vary, value)


def ends(before: Orbit, after: Orbit, vary: str) -> tuple[CurvePoint, CurvePoint]:
    """The curve at two successive orbits, oriented from the first to the second."""
    return curve_point(before, vary, like=secant_direction(before, after, vary)), arrived(before, after, vary)


def arrived(before: Orbit, after: Orbit, vary: str) -> CurvePoint:
    """The curve at an orbit, oriented along the way from another one to it."""
    return curve_point(after, vary, like=in_units_of(secant_direction(before, after, vary), before.scale, after.scale))


def point_at(
    t: Transcription,
    u: Array,
    setting: Setting,
    dp: Array,
    *,
    like: Array | None,
    sense: float = 1.0,
    lin: Linearisation | None = None,
) -> CurvePoint:
    """The curve at a solution, with its tangent.

    dp: (np,) the way that p goes for lambda = 1; like: (n + 2,) direction to go on in; the tangent makes an acute angle
    with it; sense: where `like` is None, +1 to go on towards larger, -1 towards smaller parameter values; lin: the
    linearisation there where the corrector has left one, along setting.dp.
    """
    index = int(np.argmax(np.abs(dp)))
    if lin is None:
        setting = replace(setting, dp=dp)
        lin = t.linearise(u, setting)
    # Exactly at a fold the trial row lambda = 1 is singular; at a sharp one the first node moves as little.
    for trial in (
        np.append(np.zeros(t.n + 1), 1.0) if like is None else like,
        np.append(np.ones(t.n), [0.0, 0.0]),
        np.append(np.zeros(t.n), [1.0, 0.0]),
    ):
        du, y = lin.tangent(curve_border(t, u, trial))
        if np.isfinite(y).all():
            break
    # From the units of the corrector to those of the point: states by their size, lambda to its unit here.
    factor = sizes_of_states(t, u, setting)
    row = np.concatenate(
        [y[: t.n] / factor, [t.durations_of(du)[0] / t.durations_of(u)[0], y[-1] * setting.dp[index] / dp[index]]]
    )
    length = float(np.linalg.norm(row))
    length = length if (float(row @ like) if like is not None else row[-1] * sense) >= 0 else -length
    u, du = _divided(t, u, factor), _divided(t, du, factor)
    setting = replace(setting, scale=setting.scale * factor, dp=dp)
    return CurvePoint(t, u, setting, row / length, du / length)


def backwards(point: CurvePoint) -> CurvePoint:
    """The same point of the curve, run through in the other sense."""
    flipped = None if point.bend is None else point.bend.backwards()
    return replace(point, row=-point.row, du=-point.du, bend=flipped)


def _divided(t: Transcription, u: Array, factor: Array) -> Array:
    """u with its states divided by `factor` (n,); durations as they are."""
    fresh = u.copy()
    w = t.intervals_of(fresh).reshape(-1, t.n)
    w /= factor
    fresh[t.node_index] = u[t.node_index] / factor
    return fresh


def predict(point: CurvePoint, ds: float) -> tuple[Array, float, Setting]:
    """Predict a point further on; sizes and durations are multiplied, so that they stay positive.

    point: where the prediction is made; ds: how far on, in arclength.
    Returns (size,) u, lambda, and the setting at the point with the mesh of u.
    """
    bend = _way_on(point)
    u, lam = unknowns(point.t, bend.ahead(ds), bend.here.value, _sign(point))
    # What is told by logarithms has come a little more or less than ds along the row, which the corrector keeps.
    t, first = point.t, point.t.node_index[0]
    came = np.concatenate([u[first] - point.u[first], [np.log(t.durations_of(u)[0] / t.durations_of(point.u)[0]), lam]])
    more = (ds - float(point.row @ came)) / float(point.row @ point.row) * point.row
    u[first] += more[: t.n]
    t.durations_of(u)[0] *= np.exp(more[t.n])
    lam += float(more[-1])
    return u, lam, replace(point.setting, fractions=bend.fractions(point.t, ds))


def _sign(point: CurvePoint) -> float:
    """The sign of the parameter where lambda is in units of its value; else 0."""
    index = int(np.argmax(np.abs(point.setting.dp)))
    ratio = float(point.setting.p[index] / point.setting.dp[index])
    return ratio if abs(ratio) == 1 else 0.0


def _place(point: CurvePoint) -> RelativePoint:
    t, moves = point.t, point.moves or stiff(point.t)
    return RelativePoint(0.0, t, point.u, point.du, point.setting.fractions, 0.0, float(point.row[-1]), moves)


def _way_on(point: CurvePoint) -> Bend:
    return point.bend or straight(_place(point), _sign(point))


def bent_through(point: CurvePoint, ds: float, solved: SolvedOrbit, lam: float) -> CurvePoint:
    """A point whose predictor passes through what was found further on.

    The coefficient of the highest power takes up the defect.

    ds: how far on, in arclength. Returns Point; `point` itself where the mesh is another one than was predicted.
    """
    bend = _way_on(point)
    same = solved.t == point.t and np.array_equal(solved.setting.fractions, predict(point, ds)[2].fractions)
    if not same or not np.array_equal(solved.setting.scale, point.setting.scale):
        return point
    u = solved.solution.u
    found = RelativePoint(ds, point.t, u, np.zeros_like(u), solved.setting.fractions, lam, 0.0)
    z = logarithms(found, _sign(point), alive(point.t, point.u)).value
    return replace(point, bend=bend.through(ds, z))


def seen_from(after: CurvePoint, orbit: Orbit, vary: str, value: float) -> tuple[float, float]:
    """Another value of the parameter in the terms of a point of the curve.

    after, orbit: the point, and an orbit of the branch, whose problem knows units.
    Returns (lambda that leads there, its unit there in units of that at the point).
    """
    here = float(after.setting.p[orbit.problem.names.index(vary)])
    ratio = orbit.problem.unit(vary, value) / orbit.problem.unit(vary, here)
    return orbit.problem.distance(vary, value, here), ratio


def bend(
    before: CurvePoint, after: CurvePoint, seen: tuple[float, float], *, side: float = -1.0, row: Array | None = None
) -> Bend | None:
    """The cubic through two points and their tangents.

    s is measured along the tangent of `after`, as the corrector measures it: `before` lies at s = tangent . (y_before -
    y_after).  Where the curve turns much between the two, another row than the tangent shows it better.

    seen: lambda at `before`, and its unit there, as `seen_from` has them from `after`; side: the sign that s must have
    at `before`; row: (n + 2,) row along which s is measured, default the tangent of `after`; row . tangent = 1 there.
    Returns bend; None where the phases are not the same, or the curve turns too much.
    """
    there = _seen_along(before, after, seen, after.row if row is None else row)
    if there is None or not there.s * side > 0:
        return None
    return bent(_place(after), there, _sign(after))


def _seen_along(before: CurvePoint, after: CurvePoint, seen: tuple[float, float], row: Array) -> RelativePoint | None:
    """Another point as it is seen from `after`, s counted along a row; None as for `bend`."""
    t, old = after.t, before.t
    if old.cycle != t.cycle or (old.degree, old.kind) != (t.degree, t.kind):
        return None
    factor = after.setting.scale / before.setting.scale
    lam, unit = seen
    u, du, growth = _divided(old, before.u, factor), _divided(old, before.du, factor), before.row[-1] * unit
    T = old.durations_of(u)[0]
    first, here = old.node_index[0], after.u[t.node_index[0]]
    y = np.concatenate([u[first] - here, [np.log(T / t.durations_of(after.u)[0]), lam]])
    s = float(row @ y)
    slope = float(row @ np.concatenate([du[first], [old.durations_of(du)[0] / T, growth]]))
    sign = _sign(after)
    if slope < STRAIGHT * float(np.linalg.norm(before.row)) or (sign and not 1 + sign * lam > 0):
        return None
    if np.any(alive(t, after.u) & ~alive(old, u)):
        return None
    return RelativePoint(s, old, u, du / slope, before.setting.fractions, lam, growth / slope)


def in_asked_scheme(orbit: AnyOrbit, options: Options) -> AnyOrbit:
    """The cycle in the collocation scheme that is asked for; as it is where none is."""
    asked = options.degree or orbit.degree, options.kind or orbit.kind
    if asked == (orbit.degree, orbit.kind):
        return orbit
    found = solved_at(orbit.problem, in_scheme(unknowns_of(orbit), *asked), options)
    if found is None:
        sentence = f"the cycle of {orbit.problem.title} was not found with degree = {asked[0]}, kind = {asked[1]!r}"
        raise NoOrbit(f"{sentence}: leave them out, or ask for another tolerance", Status.NOT_CONVERGED)
    return cast(AnyOrbit, found)
