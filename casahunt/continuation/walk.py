"""Following a branch of cycles in one parameter.

The curve is {y} = {(x_0, ln T_1, lambda)}: first node, duration of the first phase, and the parameter
p = p_here (1 + lambda), moved relative to where it stands.  A step of length ds:

    tangent     J (du, dlambda) = 0 with |dy| = 1, oriented forwards
    predictor   the cubic through the last two points and their tangents; logarithms of the durations
    corrector   the equations under  tangent . (y - predicted) = 0, by Newton or by IPOPT (collocation/solve.py)
    adaptation  mesh, phase sequence and error estimate (orbits/adapt.py), under the same row

x_0 is measured in units of the state scale, which follows the orbit.  The whole orbit is a function of x_0 and
lambda, but next to a sharp fold not a fair one: a first phase that lingers next to a repelling motion (a canard)
changes altogether while x_0 and the parameter move by 1e-7.  Its duration tells.  The other durations take no part in
the length: a long phase at rest would decide every step and say nothing.
The step grows and shrinks with the iterations of the corrector and with the angle between successive tangents.

`walk` rounds folds.  `walk_naturally` holds the parameter fixed in the corrector; it ends at a fold.
Both are generators of orbits: stop one when you like, go on later from the last two orbits.
"""

from __future__ import annotations

import time
from collections.abc import Generator
from dataclasses import dataclass, replace

import numpy as np

from ..checks import known
from ..collocation.mesh import phase_breaks, transfer
from ..collocation.transcription import Linearisation, Setting, Transcription
from ..errors import NoOrbit
from ..hybrid.problem import Problem
from ..orbits.adapt import Options, curve_border, solve_adaptively
from ..orbits.orbit import AnyOrbit, Orbit, Solved, orbit_of, unknowns_of

Array = np.ndarray

FIRST_STEP = 0.1
SMALLEST_STEP = 1e-10  # a fold next to a grazing slip may be 1e-7 wide
SOFT_STEP = 0.03  # below this a problem may use its last resorts to get past a change of phases
EASY_ITERATIONS = 7  # iterations of the corrector at which the step is left as it is
LARGEST_ANGLE = 0.5  # rad, between successive tangents
LARGEST_TURN, SHARP_STEP = 0.5, 1e-6  # least cosine between successive tangents, of steps longer than this
NATURAL_SMALLEST_STEP = 1e-5  # relative change of the parameter at which a natural run gives up
MOST_OF_THE_WAY = 0.8  # part of the way to a fold ahead that one natural step may take


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
    """Value of the parameter `vary` at an orbit."""
    return orbit.problem.value(vary)


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
    """
    t, u, setting = unknowns_of(orbit)
    return _point(t, u, setting, orbit.problem.direction(vary), like=like, sense=sense)


def ends(before: Orbit, after: Orbit, vary: str) -> tuple[Point, Point]:
    """The curve at two successive orbits, oriented from the first to the second."""
    way = secant(before, after, vary)
    there = in_units_of(way, before.scale, after.scale)
    return curve_point(before, vary, like=way), curve_point(after, vary, like=there)


def _point(
    t: Transcription,
    u: Array,
    setting: Setting,
    direction: Array,
    *,
    like: Array | None,
    sense: float = 1.0,
    lin: Linearisation | None = None,
) -> Point:
    """The curve at u, in the parameter of the unit vector `direction` (np,).

    `lin` is the linearisation there where the corrector has left one, along setting.dp.
    """
    index = int(np.argmax(direction))
    here = setting.p[index]
    if lin is None:
        setting = replace(setting, dp=direction * here)
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
    # From the units of the corrector to those of the point: states by their size, lambda relative to the parameter.
    factor = _size_of_states(t, u)
    row = np.concatenate(
        [y[: t.n] / factor, [t.durations_of(du)[0] / t.durations_of(u)[0], y[-1] * setting.dp[index] / here]]
    )
    length = float(np.linalg.norm(row))
    turn = float(row @ like) if like is not None else row[-1] * sense
    length = length if turn >= 0 else -length
    u, du = _divided(t, u, factor), _divided(t, du, factor)
    setting = replace(setting, scale=setting.scale * factor, dp=direction * here)
    return Point(t, u, setting, row / length, du / length)


def _size_of_states(t: Transcription, u: Array) -> Array:
    """(n,) largest |state|, in the units of u."""
    w = np.abs(t.intervals_of(u)).reshape(-1, t.n).max(axis=0)
    return np.maximum(np.maximum(w, np.abs(t.nodes_of(u)).max(axis=0)), 1e-12)


def _divided(t: Transcription, u: Array, factor: Array) -> Array:
    """u with its states divided by `factor` (n,); durations as they are."""
    fresh = u.copy()
    w = t.intervals_of(fresh).reshape(-1, t.n)
    w /= factor
    fresh[t.node_index] = u[t.node_index] / factor
    return fresh


def predict(point: Point, ds: float) -> tuple[Array, float]:
    """(u, lambda) a length ds further on; durations are multiplied, so that they stay positive."""
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
    """`point` with a predictor that passes through what was found a length ds further on, at lambda = `lam`.

    The coefficient of the highest power takes up the defect; `point` itself where the mesh is another one.
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


def walk(
    start: AnyOrbit,
    *,
    vary: str | None = None,
    low: float,
    high: float,
    sense: float = 1.0,
    previous: AnyOrbit | None = None,
    heading: Array | None = None,
    options: Options | None = None,
    first_step: float = FIRST_STEP,
    largest_step: float | None = None,
    max_points: int = 2000,
) -> Generator[AnyOrbit, None, str]:
    """Orbits along the branch through `start`, by pseudo-arclength, until the parameter leaves [low, high].

    Parameters
    ----------
    start
        a converged orbit; it is not yielded again.
    vary
        name of the parameter; default the principal one of the problem.
    low, high
        range of the parameter; the last orbit lies on the bound.
    sense
        +1 to start towards larger, -1 towards smaller values.
    previous
        the orbit before `start` on the branch, to go on in its direction; overrides `sense`.
    heading
        (n + 2,) direction to start in, as the `row` of a `curve_point`: at a fold `sense` says nothing; overrides both.
    options
        tolerance; default that of the start.
    first_step, largest_step
        arclength; the largest one is that of the problem by default.
    max_points
        give up after so many.

    Returns
    -------
    Iterator of converged orbits.  The generator's return value is the sentence that says why it ended.

    Raises
    ------
    InputError : unknown parameter name.
    """
    vary = _varied(start, vary)
    options = options or Options(tol=max(start.error_estimate, 1e-6))
    like = heading if previous is None or heading is not None else secant(previous, start, vary)
    point = curve_point(start, vary, like=like, sense=sense)
    largest_step = largest_step or start.problem.largest_step
    ds, last, ceiling = first_step, start, largest_step
    for _ in range(max_points):
        outcome = _step_and_tangent(point, last, vary, ds, low, high, options)
        while isinstance(outcome, str):
            ceiling = CAUTION * ds
            ds *= 0.4
            if ds < SMALLEST_STEP:
                return f"no step from {vary} = {parameter_value(last, vary):.8g} converged: {outcome}"
            outcome = _step_and_tangent(point, last, vary, ds, low, high, options)
        orbit, following, iterations = outcome
        yield orbit
        if following is None:
            return f"{vary} reached {parameter_value(orbit, vary):.6g}, the end of the range"
        following = replace(following, bend=bend(point, following, parameter_value(last, vary)))
        angle = float(np.arccos(np.clip(_cosine(point, following), -1, 1)))
        effort = EASY_ITERATIONS / max(iterations, 1)
        ds = min(ds * float(np.clip(min(effort, LARGEST_ANGLE / max(angle, 1e-3)), 0.4, 2.0)), ceiling)
        ceiling = min(RECOVERY * ceiling, largest_step)
        point, last = following, orbit
    return f"stopped after {max_points} points at {vary} = {parameter_value(last, vary):.6g}"


def _varied(start: Orbit, vary: str | None) -> str:
    """The name of the parameter to follow.  Raises InputError where there is none such."""
    return start.problem.principal if vary is None else known("parameter", vary, start.problem.names)


def _step_and_tangent(
    point: Point, last: AnyOrbit, vary: str, ds: float, low: float, high: float, options: Options
) -> tuple[AnyOrbit, Point | None, int] | str:
    """(orbit, the curve there or None at a bound, iterations) of one step, or what went wrong.

    The new tangent is oriented along the way from the last orbit, and a step in which it turns by more than a
    little is not taken: it would leave out the branch on this side of a fold, and set out with the parameter moving
    the other way than asked for.
    """
    outcome = step_along(point, last, vary, ds, low, high, options)
    if isinstance(outcome, str):
        return outcome
    orbit, solved, reached = outcome
    if reached:
        return orbit, None, solved.solution.iterations
    like = in_units_of(secant(last, orbit, vary), last.scale, solved.setting.scale)
    lin = solved.solution.linearisation
    following = _point(
        solved.t, solved.solution.u, _setting_at(solved), orbit.problem.direction(vary), like=like, lin=lin
    )
    if ds > SHARP_STEP and _cosine(point, following) < LARGEST_TURN:
        return "the branch turns by too much in one step"
    return orbit, following, solved.solution.iterations


def _setting_at(solved: Solved) -> Setting:
    return solved.setting.moved(solved.solution.parameter)


def secant(before: Orbit, after: Orbit, vary: str) -> Array:
    """(n + 2,) way from one orbit to the next in (x_0, ln T_1, lambda), in the scale of the first."""
    x = (after.arcs[0].states[0, 0] - before.arcs[0].states[0, 0]) / before.scale
    here, there = parameter_value(before, vary), parameter_value(after, vary)
    # Where the phases are not the same, T_1 may be another thing.
    longer = np.log(after.arcs[0].duration / before.arcs[0].duration) if before.signature == after.signature else 0.0
    return np.concatenate([x, [longer, there / here - 1]])


def in_units_of(row: Array, scale: Array, other: Array) -> Array:
    """A direction (n + 2,) in units of the state scale `scale`, in units of `other`."""
    n = scale.size
    return np.concatenate([row[:n] * scale / other, row[n:]])


def _cosine(before: Point, after: Point) -> float:
    carried = in_units_of(before.row, before.setting.scale, after.setting.scale)
    return float(carried @ after.row / np.linalg.norm(carried))


CAUTION, RECOVERY = 0.7, 1.25
"""After a step that failed the next ones stay below this part of its length, and grow by this factor each."""
STRAIGHT = 0.5
"""Cosine between successive tangents below which the last point says little about the next."""


def bend(before: Point, after: Point, value: float, *, side: float = -1.0) -> Array | None:
    """(2, size + 1) coefficients c of u + s u' + s^2 c_0 + s^3 c_1, the cubic through `before` and `after`.

    s is measured along the tangent of `after`, as the corrector measures it: `before` lies at
    s = tangent . (y_before - y_after), which must have the sign `side`.  `value` is the parameter at `before`.  None
    where the phases are not the same, or the curve turns too much.
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
    index = int(np.argmax(np.abs(after.setting.dp)))
    ratio = value / after.setting.p[index]
    u, du = _divided(t, u, factor), _divided(t, du, factor)
    rate = np.append(du, before.row[-1] * ratio)
    rate[-1 - t.phases : -1] /= t.durations_of(u)
    change = np.append(u - after.u, ratio - 1)
    change[-1 - t.phases : -1] = np.log(t.durations_of(u) / t.durations_of(after.u))
    here = np.append(after.du, after.row[-1])
    here[-1 - t.phases : -1] /= t.durations_of(after.u)

    def along(vector: Array) -> float:
        y = np.concatenate([vector[t.node_index[0]], [vector[-1 - t.phases], vector[-1]]])
        return float(after.row @ y)

    s, slope = along(change), along(rate)
    if not s * side > 0 or slope < STRAIGHT * float(np.linalg.norm(before.row)):
        return None
    first = (change - s * here) / s**2
    second = (rate / slope - here) / s
    return np.array([3 * first - second, (second - 2 * first) / s])


def step_along(
    point: Point, last: AnyOrbit, vary: str, ds: float, low: float, high: float, options: Options
) -> tuple[AnyOrbit, Solved, bool] | str:
    """One corrected step of length ds from `point`, the curve at the orbit `last`.

    Returns
    -------
    (orbit, solved, whether a bound of [low, high] is reached), or a sentence about what went wrong.
    """
    began = time.perf_counter()
    here = parameter_value(last, vary)
    u, lam = predict(point, ds)
    reached = not low <= here * (1 + lam) <= high
    bound = high if here * (1 + lam) > high else low
    if reached:  # land on the bound: shorten the step and hold the parameter there
        ds *= (bound / here - 1) / lam
        u, lam = predict(point, ds)
        lam = bound / here - 1
    # Where Newton does not land on the bound, a shorter step costs a tenth of what IPOPT would.
    how = replace(options, solver="newton") if reached and options.solver == "auto" else options
    solved = corrected(point, u, lam, last.problem, how, ds=ds, border=None if reached else point.row)
    value = bound if reached else here * (1 + lam + solved.solution.parameter)
    if not solved.status.ok or solved.estimate is None:
        return solved.complaint()
    if not low * (1 - 1e-12) <= value <= high * (1 + 1e-12):
        return "the corrector left the range"
    orbit = orbit_of(solved, last.problem.with_value(vary, value), wall_s=time.perf_counter() - began)
    moved = in_units_of(secant(last, orbit, vary), last.scale, point.setting.scale)
    if not 0.3 * ds < float(moved @ point.row) or np.linalg.norm(moved) > 3 * ds:
        return "the corrector went to another part of the curve"
    return orbit, solved, reached


def walk_naturally(
    start: AnyOrbit,
    *,
    vary: str | None = None,
    low: float,
    high: float,
    sense: float = 1.0,
    options: Options | None = None,
    first_step: float = FIRST_STEP,
    largest_step: float | None = None,
    max_points: int = 2000,
) -> Generator[AnyOrbit, None, str]:
    """Orbits at prescribed parameter values, warm-started, until the range or the branch ends.

    The arguments are those of `walk`; steps are relative changes of the parameter.  At a fold no smaller
    step helps and the generator returns the sentence that says so.

    Next to a fold at lambda_f the unit tangent has (dlambda/ds)^2 proportional to lambda_f - lambda: two points tell
    how far it is, and no step goes further than most of the way.
    """
    vary = _varied(start, vary)
    options = options or Options(tol=max(start.error_estimate, 1e-6))
    largest_step = largest_step or start.problem.largest_step
    last, step = start, first_step
    before: tuple[float, float] | None = None
    for _ in range(max_points):
        here = parameter_value(last, vary)
        point = curve_point(last, vary, sense=sense)
        if abs(point.row[-1]) < 1e-4:
            return f"the branch ends at {vary} = {here:.8g}: a fold, where the stable and the unstable cycle merge"
        steepness = float(point.row[-1]) ** 2
        if before is not None and steepness < before[1]:
            ahead = steepness * abs(here - before[0]) / (before[1] - steepness) / here
            if ahead < NATURAL_SMALLEST_STEP:
                return (
                    f"the branch ends at {vary} = {here:.8g}: its tangent shows a fold within a relative step of "
                    f"{ahead:.1g} (half multiplier {last.half_multiplier:.3g}; +1 is a fold)"
                )
            step = min(step, MOST_OF_THE_WAY * ahead)
        before = here, steepness
        while True:
            value = min(max(here * (1 + sense * step), low), high)
            orbit = _natural_step(point, last, vary, value, options)
            if not isinstance(orbit, str):
                break
            step *= 0.4
            if step < NATURAL_SMALLEST_STEP:
                return (
                    f"the branch ends at {vary} = {here:.8g}: no cycle follows within a relative step of {step:.1g} "
                    f"(half multiplier {last.half_multiplier:.3g}; +1 is a fold): {orbit}"
                )
        yield orbit
        last = orbit
        if value in (low, high):
            return f"{vary} reached {value:.6g}, the end of the range"
        step = min(step * float(np.clip(EASY_ITERATIONS / max(orbit.iterations, 1), 0.5, 2.0)), largest_step)
    return f"stopped after {max_points} points at {vary} = {parameter_value(last, vary):.6g}"


def _natural_step(point: Point, last: AnyOrbit, vary: str, value: float, options: Options) -> AnyOrbit | str:
    began = time.perf_counter()
    here = parameter_value(last, vary)
    target = value / here - 1
    ds = target / point.row[-1]
    u, _ = predict(point, ds)
    solved = corrected(point, u, target, last.problem, options, ds=ds, border=None)
    if not solved.status.ok or solved.estimate is None:
        return solved.complaint()
    orbit = orbit_of(solved, last.problem.with_value(vary, value), wall_s=time.perf_counter() - began)
    after = curve_point(orbit, vary, like=secant(last, orbit, vary))
    if after.row[-1] * (value - here) <= 0:
        return "the solver converged to the other side of the fold"
    return orbit


def corrected(
    point: Point,
    u: Array,
    lam: float,
    problem: Problem,
    options: Options,
    *,
    ds: float,
    border: Array | None,
) -> Solved:
    """The corrector from a predicted point, across changes of the phase sequence.

    In turn: the phase sequences that the problem expects there; and, on short steps only, with its last resorts.
    """
    start = (point.t, u, point.setting.moved(lam))
    solved: Solved | None = None
    for candidate in problem.expected(*start):
        solved = solve_adaptively(problem, candidate, options, solver="newton", border=border, soft=False)
        if solved.status.ok:
            return solved
    if abs(ds) < SOFT_STEP or solved is None:
        return solve_adaptively(problem, start, options, solver="newton", border=border)
    return solved


def run(generator: Generator[AnyOrbit, None, str]) -> tuple[list[AnyOrbit], str]:
    """All orbits of a walk and the sentence with which it ended."""
    orbits: list[AnyOrbit] = []
    while True:
        try:
            orbits.append(next(generator))
        except StopIteration as end:
            return orbits, str(end.value or "")
        except NoOrbit as error:
            return orbits, str(error)
