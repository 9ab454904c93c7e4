"""The curve of a branch: its points, its tangent and the predictor.

The curve is {y} = {(x_0, ln T_1, lambda)}: first node, duration of the first phase, and the parameter
p = p_here + lambda dp, moved in units of its value (Problem.unit).  At arclength s:

    tangent     J (du, dlambda) = 0 with |dy| = 1, oriented forwards
    predictor   the cubic through the last two points and their tangents; logarithms of the durations

x_0 is measured in units of the state scale, which follows the orbit.  The whole orbit is a function of x_0 and
lambda, but next to a sharp fold not a fair one: a first phase that lingers next to a repelling motion (a canard)
changes altogether while x_0 and the parameter move by 1e-7.  Its duration tells.  The other durations take no part in
the length: a long phase at rest would decide every step and say nothing.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ..collocation.linearisation import Linearisation
from ..collocation.mesh import phase_breaks, sizes_of_states, transfer
from ..collocation.transcription import Setting, Transcription
from ..hybrid.problem import Problem
from ..orbits.border import curve_border, with_other_phases
from ..orbits.orbit import Orbit, Solved, linearised

Array = np.ndarray

TINY = 1e-300
STRAIGHT = 0.5
"""Cosine between successive tangents below which the last point says little about the next."""


@dataclass(frozen=True, eq=False)
class Point:
    """A point of the curve in the solver's terms.

    Attributes
    ----------
    t, u, setting : transcription, unknowns and numbers, with p at this point and dp = p e.
    row : (n + 2,) unit tangent in (x_0, ln T_1, lambda).
    du : (size,) derivative of u by arclength.
    bend : (2, size + 1) coefficients of ds^2 and ds^3 in (u, lambda), durations as logarithms; None at the first
        point and after a change of the phase sequence.
    """

    t: Transcription
    u: Array
    setting: Setting
    row: Array
    du: Array
    bend: Array | None = None


def parameter_value(orbit: Orbit, vary: str) -> float:
    """Value of a parameter at an orbit.

    Parameters
    ----------
    orbit, vary
        the orbit, and the name of the parameter.

    Returns
    -------
    The value.
    """
    return orbit.problem.value(vary)


def secant(before: Orbit, after: Orbit, vary: str) -> Array:
    """The way from one orbit to the next.

    Parameters
    ----------
    before, after
        the orbits.
    vary
        name of the parameter.

    Returns
    -------
    (n + 2,) in (x_0, ln T_1, lambda), in the scale of `before`.
    """
    x = (after.arcs[0].states[0, 0] - before.arcs[0].states[0, 0]) / before.scale
    lam = before.problem.distance(vary, parameter_value(after, vary))
    # Where the phases are not the same, T_1 may be another thing.
    longer = np.log(after.arcs[0].duration / before.arcs[0].duration) if before.signature == after.signature else 0.0
    return np.concatenate([x, [longer, lam]])


def in_units_of(row: Array, scale: Array, other: Array) -> Array:
    """A direction of the curve in other units.

    Parameters
    ----------
    row
        (n + 2,) direction.
    scale, other
        (n,) its state scale, and that of the result.

    Returns
    -------
    (n + 2,).
    """
    n = scale.size
    return np.concatenate([row[:n] * scale / other, row[n:]])


def cosine(before: Point, after: Point) -> float:
    """The angle between the tangents at two points; without ln T_1 where that is another thing.

    Parameters
    ----------
    before, after
        the points.

    Returns
    -------
    Its cosine.
    """
    carried, row = in_units_of(before.row, before.setting.scale, after.setting.scale), after.row
    if before.t.cycle != after.t.cycle:
        first, then = (float(point.t.durations_of(point.u)[0]) for point in (before, after))
        carried, whole = with_other_phases(carried, first, then), carried
        row = np.where(carried == whole, row, 0.0)
    return float(carried @ row / max(np.linalg.norm(carried) * np.linalg.norm(row), TINY))


def curve_point(orbit: Orbit, vary: str, *, like: Array | None = None, sense: float = 1.0) -> Point:
    """The curve at an orbit, with its tangent.

    Parameters
    ----------
    orbit, vary
        a converged orbit and the name of the parameter.
    like
        (n + 2,) direction to go on in; the tangent makes an acute angle with it.
    sense
        where `like` is None, +1 to go on towards larger, -1 towards smaller parameter values.

    Returns
    -------
    Point.
    """
    t, u, setting, lin = linearised(orbit, vary)
    return point_at(t, u, setting, setting.dp, like=like, sense=sense, lin=lin)


def along(problem: Problem, vary: str, value: float | None = None) -> Array:
    """The way dp that p goes for lambda = 1.

    Parameters
    ----------
    problem, vary, value
        the problem, the name of the parameter, and where it stands: default the problem's own value.

    Returns
    -------
    (np,).
    """
    return problem.direction(vary) * problem.unit(vary, value)


def ends(before: Orbit, after: Orbit, vary: str) -> tuple[Point, Point]:
    """The curve at two successive orbits, oriented from the first to the second.

    Parameters
    ----------
    before, after
        the orbits.
    vary
        name of the parameter.

    Returns
    -------
    Points at both.
    """
    way = secant(before, after, vary)
    there = in_units_of(way, before.scale, after.scale)
    return curve_point(before, vary, like=way), curve_point(after, vary, like=there)


def point_at(
    t: Transcription,
    u: Array,
    setting: Setting,
    dp: Array,
    *,
    like: Array | None,
    sense: float = 1.0,
    lin: Linearisation | None = None,
) -> Point:
    """The curve at a solution, with its tangent.

    Parameters
    ----------
    t, u, setting
        the solution: transcription, unknowns, setting.
    dp
        (np,) the way that p goes for lambda = 1.
    like
        (n + 2,) direction to go on in; the tangent makes an acute angle with it.
    sense
        where `like` is None, +1 to go on towards larger, -1 towards smaller parameter values.
    lin
        the linearisation there where the corrector has left one, along setting.dp.

    Returns
    -------
    Point.
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
    turn = float(row @ like) if like is not None else row[-1] * sense
    length = length if turn >= 0 else -length
    u, du = _divided(t, u, factor), _divided(t, du, factor)
    setting = replace(setting, scale=setting.scale * factor, dp=dp)
    return Point(t, u, setting, row / length, du / length)


def backwards(point: Point) -> Point:
    """The same point of the curve, run through in the other sense."""
    flipped = None if point.bend is None else point.bend * [[1.0], [-1.0]]
    return replace(point, row=-point.row, du=-point.du, bend=flipped)


def _divided(t: Transcription, u: Array, factor: Array) -> Array:
    """u with its states divided by `factor` (n,); durations as they are."""
    fresh = u.copy()
    w = t.intervals_of(fresh).reshape(-1, t.n)
    w /= factor
    fresh[t.node_index] = u[t.node_index] / factor
    return fresh


def predict(point: Point, ds: float) -> tuple[Array, float]:
    """Predict a point further on; durations are multiplied, so that they stay positive.

    Parameters
    ----------
    point
        where the prediction is made.
    ds
        how far on, in arclength.

    Returns
    -------
    (size,) u, and lambda.
    """
    t, P = point.t, point.t.phases
    change = _change(point, ds)
    u = point.u + change[:-1]
    t.durations_of(u)[:] = t.durations_of(point.u) * np.exp(np.clip(change[-1 - P : -1], -1.0, 1.0))
    return u, float(change[-1])


def _change(point: Point, ds: float) -> Array:
    """(size + 1,) predicted change of (u, lambda), durations as logarithms."""
    change = ds * np.append(point.du, point.row[-1])
    change[-1 - point.t.phases : -1] /= point.t.durations_of(point.u)
    if point.bend is not None:
        change += ds**2 * (point.bend[0] + ds * point.bend[1])
    return change


def bent_through(point: Point, ds: float, solved: Solved, lam: float) -> Point:
    """A point whose predictor passes through what was found further on.

    The coefficient of the highest power takes up the defect.

    Parameters
    ----------
    point
        the point.
    ds
        how far on, in arclength.
    solved, lam
        what was found there, and its lambda.

    Returns
    -------
    Point; `point` itself where the mesh is another one.
    """
    same = solved.t == point.t and np.array_equal(solved.setting.fractions, point.setting.fractions)
    if not same or not np.array_equal(solved.setting.scale, point.setting.scale):
        return point
    durations = slice(-1 - point.t.phases, -1)
    change = np.append(solved.solution.u - point.u, lam)
    change[durations] = np.log(point.t.durations_of(solved.solution.u) / point.t.durations_of(point.u))
    defect = change - _change(point, ds)
    if point.bend is None:
        return replace(point, bend=np.array([defect / ds**2, np.zeros_like(defect)]))
    return replace(point, bend=np.array([point.bend[0], point.bend[1] + defect / ds**3]))


def seen_from(after: Point, orbit: Orbit, vary: str, value: float) -> tuple[float, float]:
    """Another value of the parameter in the terms of a point of the curve.

    Parameters
    ----------
    after, orbit
        the point, and an orbit of the branch, whose problem knows units.
    vary, value
        name of the parameter; the value.

    Returns
    -------
    (lambda that leads there, its unit there in units of that at the point).
    """
    here = float(after.setting.p[orbit.problem.names.index(vary)])
    ratio = orbit.problem.unit(vary, value) / orbit.problem.unit(vary, here)
    return orbit.problem.distance(vary, value, here), ratio


def bend(
    before: Point, after: Point, seen: tuple[float, float], *, side: float = -1.0, row: Array | None = None
) -> Array | None:
    """The cubic u + s u' + s^2 c_0 + s^3 c_1 through two points.

    s is measured along the tangent of `after`, as the corrector measures it: `before` lies at s = tangent . (y_before -
    y_after).  Where the curve turns much between the two, another row than the tangent shows it better.

    Parameters
    ----------
    before, after
        the points.
    seen
        lambda at `before`, and its unit there, as `seen_from` has them from `after`.
    side
        the sign that s must have at `before`.
    row
        (n + 2,) row along which s is measured, default the tangent of `after`; row . tangent = 1 there.

    Returns
    -------
    (2, size + 1) coefficients c; None where the phases are not the same, or the curve turns too much.
    """
    t = after.t
    if before.t.cycle != t.cycle:
        return None
    u, du = before.u, before.du
    if before.t != t or not np.array_equal(before.setting.fractions, after.setting.fractions):
        breaks = phase_breaks(t, after.setting.fractions)
        _, u, _ = transfer(before.t, u, before.setting.fractions, breaks, target=t)
        _, du, _ = transfer(before.t, du, before.setting.fractions, breaks, target=t)
    factor = after.setting.scale / before.setting.scale
    lam, unit = seen
    u, du = _divided(t, u, factor), _divided(t, du, factor)
    rate = np.append(du, before.row[-1] * unit)
    rate[-1 - t.phases : -1] /= t.durations_of(u)
    change = np.append(u - after.u, lam)
    change[-1 - t.phases : -1] = np.log(t.durations_of(u) / t.durations_of(after.u))
    here = np.append(after.du, after.row[-1])
    here[-1 - t.phases : -1] /= t.durations_of(after.u)

    def way(vector: Array) -> float:
        y = np.concatenate([vector[t.node_index[0]], [vector[-1 - t.phases], vector[-1]]])
        return float((after.row if row is None else row) @ y)

    s, slope = way(change), way(rate)
    if not s * side > 0 or slope < STRAIGHT * float(np.linalg.norm(before.row)):
        return None
    first = (change - s * here) / s**2
    second = (rate / slope - here) / s
    return np.array([3 * first - second, (second - 2 * first) / s])
