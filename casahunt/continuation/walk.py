"""Following a branch of cycles in one parameter.

From a point of the curve (curve.py), a step of length ds:

    predictor   of the curve
    corrector   the equations under  tangent . (y - predicted) = 0, by Newton or by IPOPT (collocation/ipopt.py)
    adaptation  mesh, phase sequence and error estimate (orbits/adapt.py), under the same row

The step grows and shrinks with the iterations of the corrector and with the angle between successive tangents, and
grows with small errors of predictions.

`walk` rounds folds; it is a generator of orbits: stop it when you like, go on later from the last two orbits.
`walk_naturally` holds the parameter fixed in the corrector, and ends at a fold.  Next to a fold at lambda_f the unit
tangent has (dlambda/ds)^2 proportional to lambda_f - lambda: two points tell how far it is, and no step goes further
than most of the way.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import replace
from typing import Any

import numpy as np

from ..checks import choice_of
from ..errors import NoOrbit
from ..hybrid.problem import Problem
from ..orbits.adapt import Options, first_solved, solve_adaptively
from ..orbits.bordering import with_other_phases
from ..orbits.orbit import AnyOrbit, Complaint, Orbit, SolvedOrbit, orbit_of
from ..orbits.restart import Start
from ..orbits.simulated_phases import expected
from .curve import (
    CurvePoint,
    along,
    bend,
    cosine,
    curve_point,
    in_units_of,
    parameter_value,
    point_at,
    predict,
    secant_direction,
    seen_from,
)

Array = np.ndarray

FIRST_STEP = 0.1  # as a change of the parameter by a tenth, or of the states by a tenth of their size
SMALLEST_STEP = 1e-10  # a fold next to a grazing slip may be 1e-7 wide
PROVISIONAL_ITERATIONS = 5  # the same of a provisional orbit, which has fewer
SOFT_STEP = 0.03  # below this a problem may use its last resorts to get past a change of phases
EASY_ITERATIONS = 7  # iterations of the corrector at which the step is left as it is
PREDICTED = 0.05  # error of a prediction, as a Newton step is measured, at which it is left as it is too
MOST_BY_EFFORT, MOST_BY_ERROR = 2.0, 4.0  # growth of a step
LARGEST_ANGLE = 0.5  # rad, between successive tangents
LEAST_COSINE, SHARP_STEP = 0.5, 1e-6  # least cosine between successive tangents, of steps longer than this
LANDED = 1e-12  # of a unit of the parameter, from a bound of its range
ASTRAY_BY = 1.5  # lengths of a step from one orbit to the next: at most 48 degrees off the tangent
OTHER_CYCLES = 1.5  # than predicted: the period of other cycles, with phases of the same names
CHANGED_TOO_MUCH = 1.01  # of the change that is asked for: the curve bends
CAUTION, RECOVERY = 0.7, 1.25
"""After a step that failed the next ones stay below this part of its length, and grow by this factor each."""
NATURAL_SMALLEST_STEP = 1e-5  # relative change of the parameter at which a natural run gives up
MOST_OF_THE_WAY = 0.8  # part of the way to a fold ahead that one natural step may take


class Stopped(str):
    """Why a walk has ended without failing: `kind` is "range" or "points"."""

    kind: str

    def __new__(cls, sentence: str, kind: str) -> Stopped:
        """A sentence and its kind."""
        self = super().__new__(cls, sentence)
        self.kind = kind
        return self


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
    smallest_step: float = SMALLEST_STEP,
    largest_step: float | None = None,
    largest_change: float | None = None,
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
    first_step, smallest_step, largest_step
        arclength; the largest one is that of the problem by default; below the smallest one it gives up.
    largest_change
        of the parameter in one step, in its own unit; default none.
    max_points
        give up after so many.

    Yields
    ------
    Converged orbit.  The generator returns the sentence that says why it ended, a Stopped or a Complaint.

    Raises
    ------
    InputError : unknown parameter name.

    Examples
    --------
    >>> from casahunt.continuation.walk import walk
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle
    >>> start = find_cycle(belt, "slip", x=0.0, v=0.0)
    >>> orbits = list(walk(start, vary="belt", low=0.2, high=0.22))
    >>> orbits[-1].problem.value("belt")
    0.22
    """
    vary = varied(start, vary)
    options = options or Options(tol=max(start.error_estimate, 1e-6))
    like = heading if previous is None or heading is not None else secant_direction(previous, start, vary)
    point = replace(curve_point(start, vary, like=like, sense=sense), moves=options.provisional)
    if not low <= start.problem.moved(vary, LANDED * float(np.sign(point.row[-1]))) <= high:
        return _reached(start, vary)
    largest_step = largest_step or start.problem.largest_step
    ds, last, ceiling = first_step, start, largest_step
    for _ in range(max_points):
        # A step in which the parameter changes by no more than it may, as far as the tangent tells
        per_step = abs(float(point.row[-1]) * last.problem.unit(vary))
        ds = ds if largest_change is None or per_step * ds <= largest_change else largest_change / per_step
        outcome = _step_and_tangent(point, last, vary, ds, low, high, options)
        while isinstance(outcome, str) or _changes_more(last, outcome[0], vary, largest_change):
            ceiling = CAUTION * ds
            ds *= 0.4
            if ds < smallest_step:
                sentence = f"no step from {vary} = {parameter_value(last, vary):.8g} converged: {outcome}"
                return Complaint(sentence, getattr(outcome, "status", None))
            outcome = _step_and_tangent(point, last, vary, ds, low, high, options)
        orbit, following, solved = outcome
        yield orbit
        if following is None:
            return _reached(orbit, vary)
        back = seen_from(following, orbit, vary, parameter_value(last, vary))
        following = replace(following, bend=bend(point, following, back))
        angle = float(np.arccos(np.clip(cosine(point, following), -1, 1)))
        room = min(_room(point, solved, options), LARGEST_ANGLE / max(angle, 1e-3))
        ds = min(ds * max(room, 0.4), ceiling)
        ceiling = min(RECOVERY * ceiling, largest_step)
        point, last = following, orbit
    return Stopped(f"stopped after {max_points} points at {vary} = {parameter_value(last, vary):.6g}", "points")


def _reached(orbit: Orbit, vary: str) -> Stopped:
    return Stopped(f"{vary} reached {parameter_value(orbit, vary):.6g}, the end of the range", "range")


def _changes_more(last: Orbit, orbit: Orbit, vary: str, largest: float | None) -> bool:
    """Whether a step has changed the parameter by more than it may, the tangent having turned."""
    change = abs(parameter_value(orbit, vary) - parameter_value(last, vary))
    return largest is not None and change > CHANGED_TOO_MUCH * largest


def _room(point: CurvePoint, solved: SolvedOrbit, options: Options) -> float:
    """How many times longer the next step may be: because the corrector is quick, or because predictions are good."""
    easy = PROVISIONAL_ITERATIONS if options.provisional else EASY_ITERATIONS
    effort = min(easy / max(solved.iterations, 1), MOST_BY_EFFORT)
    if solved.off <= PREDICTED:
        effort = max(effort, 1.0)  # the prediction was good: it is the mesh that took long, as a shorter step's would
    if point.bend is None or not point.bend.drift.any():
        return effort
    # On a mesh that moves along the fourth root of the error says what the next one will be; elsewhere it is no guide.
    by_error = float((PREDICTED / max(solved.off, SMALLEST_STEP)) ** (1 / 4))
    return max(effort, min(by_error, MOST_BY_ERROR))


def varied(start: Orbit, vary: str | None) -> str:
    """The name of the parameter to follow.

    start, vary: an orbit, and the name or None for the principal one of its problem.
    Raises InputError: there is none such.
    """
    return start.problem.principal if vary is None else choice_of("parameter", vary, start.problem.names)


def _step_and_tangent(
    point: CurvePoint, last: AnyOrbit, vary: str, ds: float, low: float, high: float, options: Options
) -> tuple[AnyOrbit, CurvePoint | None, SolvedOrbit] | str:
    """(orbit, the curve there or None at a bound, what was solved) of one step, or what went wrong.

    The new tangent is oriented along the way from the last orbit, and a step in which it turns by more than a
    little is not taken: it would leave out the branch on this side of a fold, and set out with the parameter moving
    the other way than asked for.
    """
    outcome = step_along(point, last, vary, ds, low, high, options)
    if isinstance(outcome, str):
        return outcome
    orbit, solved, reached = outcome
    if reached:
        return orbit, None, solved
    like = in_units_of(secant_direction(last, orbit, vary), last.scale, solved.setting.scale)
    lin, setting = solved.solution.linearisation, solved.setting.moved(solved.solution.parameter)
    dp = along(orbit.problem, vary, float(setting.p[orbit.problem.names.index(vary)]))
    following = replace(point_at(solved.t, solved.solution.u, setting, dp, like=like, lin=lin), moves=point.moves)
    if ds > SHARP_STEP and (cosine(point, following) < LEAST_COSINE or _astray(point, following, last, orbit, vary)):
        return "the branch turns by too much in one step"
    return orbit, following, solved


def _astray(point: CurvePoint, following: CurvePoint, last: Orbit, orbit: Orbit, vary: str) -> bool:
    """Whether a step is too far off the tangent at its end, too: the curve may have come there the other way round."""
    way = in_units_of(secant_direction(last, orbit, vary), last.scale, following.setting.scale)
    same = point.t.cycle == following.t.cycle
    return same and bool(np.linalg.norm(way) > ASTRAY_BY * float(way @ following.row))


def step_along(
    point: CurvePoint, last: AnyOrbit, vary: str, ds: float, low: float, high: float, options: Options
) -> tuple[AnyOrbit, SolvedOrbit, bool] | str:
    """One corrected step of length ds from `point`, the curve at the orbit `last`.

    point, last: a point of the curve, and the orbit there; low, high: range of the parameter; a step beyond lands on
    the bound. Returns (orbit, solved, whether a bound of [low, high] is reached), or a sentence about what went wrong.
    """
    began = time.perf_counter()
    moved = last.problem.moved
    u, lam, setting = predict(point, ds)
    bound = _bound_met(last.problem, vary, lam, low, high)
    if bound is not None:  # land on it: shorten the step and hold the parameter there
        ds *= last.problem.distance(vary, bound) / lam
        u, lam, setting = predict(point, ds)
        lam = last.problem.distance(vary, bound)
    # Where Newton does not land on the bound, a shorter step costs a tenth of what IPOPT would.
    how = replace(options, solver="newton") if bound is not None and options.solver == "auto" else options
    border = None if bound is not None else point.row
    solved = corrected((point.t, u, setting), lam, last.problem, how, ds=ds, border=border)
    value = moved(vary, lam, solved.solution.parameter) if bound is None else bound
    if not solved.status.ok or solved.estimate is None:
        return solved.complaint()
    slack = LANDED * abs(last.problem.unit(vary))
    if not low - slack <= value <= high + slack:
        return "the corrector left the range"
    if bound is None:
        bound = _bound_met(last.problem, vary, lam + solved.solution.parameter, low, high)
        value = value if bound is None else bound
    orbit = orbit_of(solved, last.problem.with_value(vary, value), wall_s=time.perf_counter() - began)
    way = in_units_of(secant_direction(last, orbit, vary), last.scale, point.setting.scale)
    row = point.row
    if orbit.signature != last.signature and sorted(orbit.signature) == sorted(last.signature):
        return "the corrector went through a point, to the same cycles from another of their phases on"
    if orbit.signature != last.signature:  # `way` knows nothing of ln T_1 there
        row = with_other_phases(row, last.arcs[0].duration, orbit.arcs[0].duration)
    if not 0.3 * ds * float(row @ row) < float(way @ row) or np.linalg.norm(way) > ASTRAY_BY * ds:
        return "the corrector went to another part of the curve"
    leapt = orbit.period / (orbit.repeats * float(point.t.durations_of(u).sum()))
    if ds > SHARP_STEP and orbit.signature == last.signature and not 1 / OTHER_CYCLES < leapt < OTHER_CYCLES:
        return "the corrector went to cycles of another period"
    return orbit, solved, bound is not None


def _bound_met(problem: Problem, vary: str, lam: float, low: float, high: float) -> float | None:
    """The bound that a step of lambda comes up to, but for rounding, or leads beyond; None where it stays inside."""
    value = problem.moved(vary, lam + LANDED * float(np.sign(lam)))
    return high if value > high else low if value < low else None


def corrected(
    predicted: Start,
    lam: float,
    problem: Problem,
    options: Options,
    *,
    ds: float,
    border: Array | None,
) -> SolvedOrbit:
    """The corrector from a predicted point, across changes of the phase sequence.

    In turn: the phase sequences that the problem expects there; and, on short steps only, with its last resorts.

    predicted: transcription, unknowns and mesh, with the setting of the point from which the prediction was made;
    problem, options: the problem at that point, and the tolerance; border: (n + 2,) weights under which lambda is free;
    None holds it at `lam`.
    """
    t, u, setting = predicted
    start = t, u, setting.moved(lam)
    solved = first_solved(
        problem, expected(problem.asked(), start), options, solver="newton", border=border, soft=False
    )
    if not solved.status.ok and abs(ds) < SOFT_STEP:
        return solve_adaptively(problem, start, options, solver="newton", border=border)
    return solved


def walk_to_end(
    generator: Generator[Any, None, str], progress: Callable[[Any], None] | None = None
) -> tuple[list[Any], str]:
    """All that a walk leads to, and the sentence with which it ended.

    Parameters
    ----------
    generator, progress
        the walk, and what is called with each orbit as it is found.

    Returns
    -------
    (orbits, sentence).

    Examples
    --------
    >>> from casahunt import walk
    >>> from casahunt.continuation import walk_to_end
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle
    >>> start = find_cycle(belt, "slip", x=0.0, v=0.0)
    >>> orbits, ended = walk_to_end(walk(start, vary="belt", low=0.2, high=0.21))
    >>> ended
    'belt reached 0.21, the end of the range'
    """
    found: list[Any] = []
    while True:
        try:
            found.append(next(generator))
            if progress is not None:
                progress(found[-1])
        except StopIteration as end:
            return found, str(end.value or "")
        except NoOrbit as error:
            return found, str(error)


def walk_naturally(
    start: AnyOrbit, *, vary: str | None = None, low: float, high: float, sense: float = 1.0,
    options: Options | None = None, first_step: float = FIRST_STEP, largest_step: float | None = None,
    max_points: int = 2000,
) -> Generator[AnyOrbit, None, str]:  # fmt: skip
    """Orbits at prescribed parameter values, warm-started, until the range or the branch ends.

    Parameters
    ----------
    start, vary, low, high, sense, options, first_step, largest_step, max_points
        as in `walk`; steps are relative changes of the parameter.

    Yields
    ------
    Converged orbit.  At a fold no smaller step helps, and the generator returns the sentence that says so.

    Raises
    ------
    InputError : unknown parameter name.

    Examples
    --------
    >>> from casahunt.continuation.walk import walk_naturally
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle
    >>> start = find_cycle(belt, "slip", x=0.0, v=0.0)
    >>> orbits = list(walk_naturally(start, vary="belt", low=0.2, high=0.22))
    >>> orbits[-1].period < start.period
    True
    """
    vary = varied(start, vary)
    options = options or Options(tol=max(start.error_estimate, 1e-6))
    largest_step = largest_step or start.problem.largest_step
    last, step = start, first_step
    before: tuple[float, float] | None = None
    for _ in range(max_points):
        here = parameter_value(last, vary)
        point = curve_point(last, vary, sense=sense)
        if abs(point.row[-1]) < 1e-4:
            return Complaint(f"the branch ends at {vary} = {here:.8g}: a fold, where two cycles meet and are gone")
        steepness = float(point.row[-1]) ** 2
        if before is not None and steepness < before[1]:
            ahead = steepness * abs(here - before[0]) / (before[1] - steepness) / abs(last.problem.unit(vary))
            if ahead < NATURAL_SMALLEST_STEP:
                return Complaint(
                    f"the branch ends at {vary} = {here:.8g}: its tangent shows a fold within a relative step of "
                    f"{ahead:.1g} (half multiplier {last.half_multiplier:.3g}; +1 is a fold)"
                )
            step = min(step, MOST_OF_THE_WAY * ahead)
        before = here, steepness
        while True:
            value = min(max(last.problem.moved(vary, sense * step), low), high)
            orbit = _natural_step(point, last, vary, value, options)
            if not isinstance(orbit, str):
                break
            step *= 0.4
            if step < NATURAL_SMALLEST_STEP:
                return Complaint(
                    f"the branch ends at {vary} = {here:.8g}: no cycle follows within a relative step of {step:.1g} "
                    f"(half multiplier {last.half_multiplier:.3g}; +1 is a fold): {orbit}"
                )
        yield orbit
        last = orbit
        if value in (low, high):
            return _reached(orbit, vary)
        step = min(step * float(np.clip(EASY_ITERATIONS / max(orbit.iterations, 1), 0.5, 2.0)), largest_step)
    return Stopped(f"stopped after {max_points} points at {vary} = {parameter_value(last, vary):.6g}", "points")


def _natural_step(point: CurvePoint, last: AnyOrbit, vary: str, value: float, options: Options) -> AnyOrbit | str:
    """The orbit at a value: a step along the curve that lands there, on this side of a fold; or what went wrong."""
    ds = last.problem.distance(vary, value) / float(point.row[-1])
    outcome = step_along(point, last, vary, ds, value, value, options)
    if isinstance(outcome, str):
        return outcome
    after = curve_point(outcome[0], vary, like=secant_direction(last, outcome[0], vary))
    if after.row[-1] * (value - parameter_value(last, vary)) <= 0:
        return "the solver converged to the other side of the fold"
    return outcome[0]
