"""The fold curve phi = 0 from one end of the range of q to the other.

    phi(s, c) = 0  (charts.py), followed from the end next to the servo's own q; it may turn back: phi_s = 0, a cusp

It ends at an end of the range, or where the gain tends to zero because nothing feeds a cycle any more (`unfed`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from dataclasses import replace

import numpy as np

from ...checks import known, require, shown
from ...continuation.plane_curve import Place, follow
from ...continuation.sheet import Axis
from ...errors import InputError, NoOrbit, Status
from ...orbits.adapt import Options
from ...servo.find_fold import find_fold
from ...servo.hunting import MODELS, Model
from ...servo.servo import Servo, a_servo, flatten
from ..sensitivity import NAMES
from .batches import points_in_batches
from .charts import Chart, Problem, chart_of
from .points import FoldCurve, FoldPoint, as_found

RANGE_POINTS = 17
"""Points over the range where the curve is not steep."""
VANISHING = 2e-2
"""Part of the largest fold gain of the curve below which a fold that tends to zero counts as gone."""
GONE = 1e-5
"""The same where it is not known why it should."""
STEEP_GAIN = 30.0
"""|d ln K/dc| from which on a gain tends to zero: a straight line would get there within 1/30 of the range."""
MOST_RESTARTS = 4
"""How often the curve is taken up again, by a fold computed from nothing, where the steps do not converge."""


def fold_curve(
    servo: Servo,
    model: Model,
    *,
    vary: str,
    start: float,
    end: float,
    points: int = RANGE_POINTS,
    options: Options | None = None,
    report: Callable[[FoldPoint], None] | None = None,
    begun: Sequence[FoldPoint] = (),
) -> FoldCurve:
    """The fold gain of a servo while one of its parameters runs over a range.

    Parameters
    ----------
    servo, model
        the problem; the servo's own value of the parameter need not lie in the range.
    vary
        name of the parameter (sensitivity.NAMES).
    start, end
        range of the parameter; the points run from `start` to `end`.
    points
        about how many, at least 2; more where the gain changes by more than 40 % between two of them.
    options
        `tol` bounds the relative errors of gain, amplitude and period at every point.
    report
        called with every point as it is found; the first is one of the two ends.
    begun
        the points of the same curve that are there already, from `start` to `end`: it goes on behind them.

    Returns
    -------
    FoldCurve; its `ended` says how far it leads where the range has no fold everywhere.

    Raises
    ------
    InputError : unknown parameter, an empty range, or a value that the parameter cannot have.
    NoOrbit : no fold at either end of the range.

    Examples
    --------
    >>> from casahunt import Servo, fold_curve
    >>> curve = fold_curve(Servo(), "switch", vary="friction.static", start=0.53, end=0.54, points=2)
    >>> f"{curve.slopes[0]:.3f}"  # V/rad per N m
    '7.428'
    """
    a_servo(servo)
    began = time.perf_counter()
    options = options or Options()
    known("model", model, MODELS)
    check_range(servo, vary, start, end)
    require("points", points, at_least=2)
    axis = Axis(vary, float(start), float(end))
    problem = Problem(model, servo, axis, options, 1 / (points - 1))
    chart, c, sense, found = _begin(problem, begun)
    goal = servo.replace(**{vary: axis.value(1 - c)})
    reason, gone = _collect(_all_points(problem, chart, sense, found), found, goal, axis, report)
    last = found[-1]
    if c == 1:
        found = found[::-1]
    cusps = tuple(point for point in found if point.turns)
    sentence, status = _ending(problem, last, axis.value(1 - c), bool(cusps), reason, gone)
    return FoldCurve(model, servo, vary, tuple(found), cusps, sentence, status, time.perf_counter() - began, gone)


def _collect(
    points: Generator[FoldPoint, None, str],
    found: list[FoldPoint],
    goal: Servo,
    axis: Axis,
    report: Callable[[FoldPoint], None] | None,
) -> tuple[str, bool]:
    """Append the points that follow to `found`; (why the curve ends there, whether its gain tends to zero)."""
    reason, gone = "", False
    while not (reason or gone):
        try:
            point = next(points)
        except StopIteration as stop:
            return stop.value, False
        found.append(point)
        if report is not None:
            report(point)
        reason, gone = _fading(found, axis, goal)
    return reason, gone


def _all_points(
    problem: Problem, chart: Chart, sense: float, found: Sequence[FoldPoint]
) -> Generator[FoldPoint, None, str]:
    """The points behind those that were found already: in batches as far as those lead, then step by step.

    The generator's return value is that of `_followed`.
    """
    known = list(found)
    if not known:
        assert chart.fold is not None
        known.append(chart.fold)
        yield known[-1]
    at_an_end = chart.position in (0.0, 1.0) and len(known) > 1
    if not at_an_end and not any(point.turns for point in known):
        count = len(known)
        for point in points_in_batches(problem, known[-1], sense):
            known.append(point)
            yield point
        if len(known) > count:
            position = problem.axis.place(known[-1].value)
            if position in (0.0, 1.0):
                return ""
            again = chart_of(problem, known[-1].orbit, position, like=None)
            if isinstance(again, str):
                return again
            chart = again
    followed = _followed(chart, sense, known)
    while True:
        try:
            place = next(followed)
        except StopIteration as stop:
            return str(stop.value)
        yield replace(place.chart.fold, turns=place.turns)


def _followed(chart: Chart, sense: float, found: Sequence[FoldPoint]) -> Generator[Place, None, str]:
    """The places behind the points that were found already, taken up again where the steps do not converge.

    The generator's return value is "" at the end of the range, or the sentence that says why the curve ends before.
    """
    turned, restarts = any(point.turns for point in found), 0
    places = follow(chart, sense=sense)
    if found:
        next(places)  # the last point itself
        if chart.position in (0.0, 1.0) and len(found) > 1:
            return ""  # it is the end
    while True:
        try:
            place = next(places)
        except StopIteration as stop:
            lost = bool(stop.value) and not turned and restarts < MOST_RESTARTS
            again = _restarted(chart, sense) if lost else None
            if again is None:
                return stop.value or ""
            chart, restarts = again, restarts + 1
            places = follow(chart, sense=sense)
            continue
        chart, turned = place.chart, turned or place.turns
        yield place


def _fading(found: Sequence[FoldPoint], axis: Axis, goal: Servo) -> tuple[str, bool]:
    """(why the curve is left at its last point, or ""; whether the gain tends to zero there)."""
    last = found[-1]
    share = last.gain / max(point.gain for point in found)
    steepness = last.slope / last.gain * axis.rate(axis.place(last.value))
    if share < VANISHING and unfed(goal) and abs(steepness) > STEEP_GAIN:
        return "", True
    return f"its gain has fallen to {share:.2g} of the largest one" if share < GONE else "", False


def check_range(servo: Servo, vary: str, start: float, end: float) -> None:
    """Refuse a range that a parameter cannot run over.

    vary: name of the parameter (sensitivity.NAMES).
    Raises InputError: unknown parameter, an empty range, or a value that the parameter cannot have.
    """
    known("parameter", vary, [name for name in NAMES if name in servo.names])
    if start == end:
        raise InputError(f"from = to = {shown(start)}: must differ")
    for bound in (start, end):
        servo.replace(**{vary: bound})


def _first_chart(problem: Problem) -> Chart:
    """The fold at an end of the range: the end next to the servo's own value, or else the other."""
    axis = problem.axis
    own = flatten(problem.servo)[axis.vary]
    order = (0.0, 1.0) if abs(own - axis.start) <= abs(own - axis.end) else (1.0, 0.0)
    complaints = []
    for c in order:
        servo = problem.servo.replace(**{axis.vary: axis.value(c)})
        chart: Chart | str
        try:
            chart = chart_of(problem, find_fold(servo, problem.model, options=problem.options).orbit, c, like=None)
        except NoOrbit as error:
            chart = str(error)
        if isinstance(chart, Chart):
            return chart
        complaints.append(f"at {axis.vary} = {shown(axis.value(c))}: {chart}")
    raise NoOrbit("no fold to follow at either end of the range; " + "; ".join(complaints), Status.NOT_FOUND)


def _begin(problem: Problem, begun: Sequence[FoldPoint]) -> tuple[Chart, float, float, list[FoldPoint]]:
    """(chart to start from, c of the first point, direction of c, the points up to that chart as they were found)."""
    axis = problem.axis
    if not begun:
        chart = _first_chart(problem)
        return chart, chart.position, 1.0 if chart.position == 0 else -1.0, []
    c = 0.0 if begun[0].value == axis.start else 1.0
    found = as_found(begun, axis.start)
    position = axis.place(found[-1].value)
    again = chart_of(problem, found[-1].orbit, position, like=None)
    if isinstance(again, str):
        where = f"{axis.vary} = {shown(found[-1].value)}"
        raise NoOrbit(f"the curve cannot be taken up at {where}: {again}", Status.NOT_CONVERGED)
    sense = position - axis.place(found[-2].value) if len(found) > 1 else 0.5 - c
    return again, c, float(np.sign(sense)), found


def _restarted(last: Chart, sense: float) -> Chart | None:
    """A fold computed from nothing a step further on, where the curve was lost; None where it is not the same one."""
    problem = last.problem
    c = float(np.clip(last.position + sense * last.reach[1] / 2, 0.0, 1.0))
    if c == last.position:
        return None
    servo = problem.servo.replace(**{problem.axis.vary: problem.axis.value(c)})
    try:
        fold = find_fold(servo, problem.model, options=problem.options)
        chart = chart_of(problem, fold.orbit, c, like=None)
    except NoOrbit:
        return None
    return chart if isinstance(chart, Chart) and last.agrees(chart) else None


def _ending(
    problem: Problem, last: FoldPoint, goal: float, turned: bool, reason: str, gone: bool
) -> tuple[str, Status]:
    """(sentence about where the curve ends, CONVERGED where nothing is missing)."""
    vary = problem.axis.vary
    where = f"the fold was followed to {vary} = {last.value:.8g}, K = {last.gain:.6g}"
    if gone:
        return (
            f"{where}, and tends to zero from there: towards {vary} = {shown(goal)} the friction curve falls too "
            "little to feed a cycle",
            Status.CONVERGED,
        )
    if not reason:
        back = ", where it began, after a cusp" if turned and last.value != goal else ", the end of the range"
        return f"{vary} reached {shown(last.value)}{back}", Status.CONVERGED
    return f"{where}, and no further: {reason}", Status.NOT_CONVERGED


def unfed(servo: Servo) -> bool:
    """Whether the loop without dry friction, damped by the least slope of the friction curve, is stable at every gain.

    Routh-Hurwitz: kd + sigma > J/(kp/ki), where sigma = sigma2 - (Fs - Fc)/vs sqrt(2/e) is the least
    slope of g(v) + sigma2 v.  Fold gains tend to zero on the way there; pure Coulomb friction lies beyond it where
    sigma2 does.
    """
    f = servo.friction
    least = f.viscous - (f.static - f.coulomb) / f.stribeck_velocity * np.sqrt(2 / np.e)
    return bool(least >= servo.inertia / servo.controller.reset_time) or f.static == f.coulomb
