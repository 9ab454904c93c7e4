"""The fold in two parameters: the curve K_fold(q), below which the servo can hunt.

At a fold of the branch in the gain the tangent has no parameter component.  With a second parameter q the orbits
near a fold form a surface with the coordinates

    s   arclength along the branch:  r . (y - y_0),  r the tangent of the branch at the fold, y = (x_0, ln T_1, lambda)
    c   the place of q in its range, 0 to 1: (q - A)/(B - A), or (ln q - ln A)/(ln B - ln A) for a wide range
    phi(s, c) = d lambda/d s                 the parameter component of the unit tangent at the orbit (s, c)

and the fold curve is phi = 0, followed by continuation/plane_curve.py.  Every value of phi is one corrected orbit with
its error estimate: q is set, K = K_fold (1 + lambda) is free under the border row r.  The curve may turn back in q: a
cusp, phi_s = 0, where two folds meet and vanish.

Every point is checked against the optimisation problem (continuation/fold.py) - the largest gain nearby, or the
smallest where phi_s > 0 - whose multipliers give the exact slope dK/dq (sensitivity.py).  Within `NEXT_TO_CUSP` of a
cusp there is no extremum to be found; the slope is taken from the gain of the orbits beside the fold, d lambda/d c at s
= 0.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from ..checks import known, require, shown
from ..continuation.fold import confirmed, confirmed_smallest
from ..continuation.plane_curve import Reading, follow
from ..continuation.special_points import FOLD, SpecialPoint
from ..continuation.walk import Point, corrected, curve_point, in_units_of, predict
from ..errors import InputError, NoOrbit, Status
from ..orbits.adapt import TOLERANCE_RANGE, Options
from ..orbits.orbit import orbit_of, unknowns_of
from ..servo.find_fold import find_fold
from ..servo.hunting import MODELS, Model
from ..servo.problem import Hunting, HuntingFold, HuntingOrbit
from ..servo.servo import Servo, flatten
from .sensitivity import NAMES, fold_sensitivities

Array = np.ndarray

POINTS = 17
"""Points over the range where the curve is not steep."""
WIDE = 5.0
"""Ratio of the ends of a range from which on the points are spread over the logarithm of the parameter."""
LARGEST_CHANGE = 0.4
"""Relative change of the gain from one point to the next, at most."""
LARGEST_S = 0.3
"""Largest step along the branch."""
DIFFERENCE = 1e-3
"""Step of the differences of phi, as a part of the largest step in c, and in s."""
FINER = 0.03
"""Part of the tolerance to which the orbits are computed: the place of a fold on the branch takes a finer mesh than
gain, period and amplitude of an orbit."""
NEXT_TO_CUSP = 1e-3
"""|phi_s| below which a fold is not an extremum that could be found."""
VANISHING = 2e-2
"""Part of the largest fold gain of the curve below which a fold that tends to zero counts as gone."""
GONE = 1e-5
"""The same where it is not known why it should."""
STEEP = 30.0
"""|d ln K/dc| from which on a gain tends to zero: a straight line would get there within 1/30 of the range."""
MOST_RESTARTS = 4
"""How often the curve is taken up again, by a fold computed from nothing, where the steps do not converge."""
ASTRAY = 0.2
"""Largest departure of the gain from the two slopes beside it, relative to its change."""


@dataclass(frozen=True)
class Axis:
    """The second parameter: its name and range."""

    vary: str
    start: float
    end: float

    @property
    def wide(self) -> bool:
        """Whether c is spread over the logarithm."""
        a, b = sorted((self.start, self.end))
        return a > 0 and b >= WIDE * a

    def value(self, c: float) -> float:
        """q at c; the ends exactly."""
        if c in (0.0, 1.0):
            return self.end if c else self.start
        if self.wide:
            return float(self.start * (self.end / self.start) ** c)
        return self.start + c * (self.end - self.start)

    def place(self, q: float) -> float:
        """c at q; the ends exactly."""
        if q in (self.start, self.end):
            return float(q == self.end)
        if self.wide:
            return float(np.log(q / self.start) / np.log(self.end / self.start))
        return (q - self.start) / (self.end - self.start)

    def rate(self, c: float) -> float:
        """dq/dc."""
        return self.value(c) * float(np.log(self.end / self.start)) if self.wide else self.end - self.start


@dataclass(frozen=True, eq=False)
class FoldPoint:
    """A point of a fold curve.

    Attributes
    ----------
    value : the second parameter q.
    gain : the fold gain K [V/rad].
    slope : dK/dq.
    orbit : the orbit at the fold, with the servo there.
    error_estimate : the largest estimated relative error of gain, amplitude and period.
    curvature : phi_s, the second derivative of lambda along the branch: < 0 where the gain is the largest, > 0 where
        it is the smallest, 0 at a cusp.
    status : as everywhere.
    turns : whether the curve turns back in q here: a cusp.
    """

    value: float
    gain: float
    slope: float
    orbit: HuntingOrbit
    error_estimate: float
    curvature: float
    status: Status
    turns: bool = False

    @property
    def elasticity(self) -> float:
        """q/K dK/dq, per cent of gain for one per cent of the parameter."""
        return self.value * self.slope / self.gain


@dataclass(frozen=True, eq=False)
class FoldCurve:
    """The fold gain against a second parameter.

    Attributes
    ----------
    model, servo, vary : the problem; the servo as given.
    points : in order along the curve, cusps among them.
    cusps : the points where the curve turns back in q.
    ended : sentence that says why the curve ended.
    status : CONVERGED where the whole range, or all of it that has a fold, was covered.
    wall_s : time [s].
    vanishes : whether the curve was left where the gain tends to zero.
    """

    model: Model
    servo: Servo
    vary: str
    points: tuple[FoldPoint, ...]
    cusps: tuple[FoldPoint, ...]
    ended: str
    status: Status
    wall_s: float
    vanishes: bool = False

    @property
    def values(self) -> Array:
        """The second parameter."""
        return np.array([point.value for point in self.points])

    @property
    def gains(self) -> Array:
        """The fold gains."""
        return np.array([point.gain for point in self.points])

    @property
    def slopes(self) -> Array:
        """dK/dq."""
        return np.array([point.slope for point in self.points])


def hermite(curve: FoldCurve, samples: int = 24) -> tuple[Array, Array]:
    """(q, K) of the cubic through the points of a curve with their exact slopes, `samples` for each gap."""
    q, K, slope = curve.values, curve.gains, curve.slopes
    if len(q) < 2:
        return q, K
    x = np.linspace(0, 1, samples, endpoint=False)
    h, rise = np.diff(q)[:, None], np.diff(K)[:, None]
    a, b = slope[:-1, None] * h - rise, rise - slope[1:, None] * h
    between = K[:-1, None] + x * rise + x * (1 - x) * (a * (1 - x) + b * x)
    return np.append((q[:-1, None] + x * h).ravel(), q[-1]), np.append(between.ravel(), K[-1])


# The surface of orbits beside a fold ------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class _Problem:
    """What all charts share."""

    model: Model
    servo: Servo
    axis: Axis
    options: Options
    spacing: float

    @property
    def finer(self) -> Options:
        """Options of the orbits on the surface."""
        return replace(self.options, tol=max(FINER * self.options.tol, TOLERANCE_RANGE[0]))


@dataclass(frozen=True, eq=False)
class _Chart:
    """Coordinates (s, m) around a fold (plane_curve.Chart)."""

    problem: _Problem
    orbit: HuntingOrbit
    point: Point
    position: float
    steepness: float = 0.0
    """d ln K/dc."""
    tilt: Array | None = field(default=None, repr=False)
    """(size,) derivative of u by c at s = 0 and along the fold gain; durations by their logarithms."""
    gradient: tuple[float, float] = (0.0, 0.0)
    fold: FoldPoint | None = None

    @property
    def reach(self) -> tuple[float, float]:
        return LARGEST_S, min(self.problem.spacing, LARGEST_CHANGE / max(abs(self.steepness), 1e-9))

    def value(self, s: float, m: float) -> Reading | str:
        began = time.perf_counter()
        problem, t = self.problem, self.point.t
        q = problem.axis.value(self.position + m)
        gain = self.orbit.gain * float(np.exp(np.clip(self.steepness * m, -1.0, 1.0)))
        try:
            servo = problem.servo.replace(**{problem.axis.vary: q})
        except InputError as error:
            return str(error)
        u, _ = predict(self.point, s)
        if self.tilt is not None:
            u[: -t.phases] += m * self.tilt[: -t.phases]
            t.durations_of(u)[:] *= np.exp(np.clip(m * self.tilt[-t.phases :], -1.0, 1.0))
        posed = Hunting(problem.model, servo, gain)
        setting = replace(self.point.setting, p=posed.vector(), dp=posed.direction("gain") * gain)
        ds = float(np.hypot(s, m))
        solved = corrected(
            replace(self.point, setting=setting), u, 0.0, posed, problem.finer, ds=ds, border=self.point.row
        )
        if not solved.status.ok or solved.estimate is None:
            return solved.complaint()
        gain *= 1 + solved.solution.parameter
        if not gain > 0:
            return "the corrector came to a gain below zero"
        orbit = orbit_of(solved, posed.with_value("gain", gain), wall_s=time.perf_counter() - began)
        like = in_units_of(self.point.row, self.point.setting.scale, orbit.scale)
        return Reading(float(curve_point(orbit, "gain", like=like).row[-1]), orbit)

    def moved(self, s: float, m: float, reading: Reading) -> _Chart | str:
        chart: _Chart | str = _chart(self.problem, reading.data, self.position + m, like=self)
        if isinstance(chart, str):
            return chart
        return chart if self.agrees(chart) else "the corrector went to another fold"

    def agrees(self, other: _Chart) -> bool:
        """Whether the slopes here and there explain the change of the gain: another fold would bend the curve."""
        rise = float(np.log(other.orbit.gain / self.orbit.gain))
        m = other.position - self.position
        first, second = self.steepness * m, other.steepness * m
        return abs(rise - (first + second) / 2) <= ASTRAY * max(abs(rise), abs(first), abs(second)) + 1e-3


def _chart(problem: _Problem, orbit: HuntingOrbit, position: float, *, like: _Chart | None) -> _Chart | str:
    """The chart of a fold, with slope, gradient and tilt, or a sentence."""
    row = None if like is None else in_units_of(like.point.row, like.point.setting.scale, orbit.scale)
    bare = _Chart(problem, orbit, curve_point(orbit, "gain", like=row), position)
    beside = [bare.value(sign * DIFFERENCE, 0.0) for sign in (1, -1)]
    if isinstance(beside[0], str):
        return beside[0]
    if isinstance(beside[1], str):
        return beside[1]
    phi_s = (beside[0].value - beside[1].value) / (2 * DIFFERENCE)
    # Inwards, where the parameter has its range; K may be steep.
    m = DIFFERENCE * problem.spacing * (1 if position < 0.5 else -1)
    name = problem.axis.vary
    slope: float | None = None
    error = max(orbit.parameter_error, orbit.error_estimate)
    if abs(phi_s) > NEXT_TO_CUSP:
        try:
            fold = _extremum(orbit, phi_s < 0, problem.options)
        except NoOrbit as complaint:
            return str(complaint)
        slope, error = fold_sensitivities(fold).derivatives[name], fold.error_estimate
        orbit = fold.orbit
    rate = problem.axis.rate(position)
    bare = replace(bare, steepness=0.0 if slope is None else slope * rate / orbit.gain)
    ahead = bare.value(0.0, m)
    if isinstance(ahead, str):
        return ahead
    if slope is None:  # d lambda/d s vanishes: the gain beside the fold, at s = 0, has the slope of the curve
        steepness = float(np.log(ahead.data.gain / orbit.gain)) / m
        slope = steepness * orbit.gain / rate
        bare = replace(bare, steepness=steepness)
    found = FoldPoint(problem.axis.value(position), orbit.gain, slope, orbit, error, phi_s, orbit.status)
    gradient = (phi_s, ahead.value / m)
    return replace(bare, tilt=_tilt(bare, ahead.data, m), gradient=gradient, fold=found)


def _tilt(chart: _Chart, ahead: HuntingOrbit, m: float) -> Array | None:
    """(size,) change of u by c from an orbit beside the fold; None where mesh or phases are others."""
    t, u, setting = chart.point.t, chart.point.u, chart.point.setting
    other, v, its = unknowns_of(ahead)
    if other != t or not np.array_equal(its.fractions, setting.fractions):
        return None
    factor = its.scale / setting.scale
    v = v.copy()
    durations = np.log(t.durations_of(v) / t.durations_of(u)) / m
    nodes = t.nodes_of(v) * factor
    t.intervals_of(v)[:] *= np.tile(factor, t.degree + 1)
    v[t.node_index] = nodes
    tilt = (v - u) / m
    t.durations_of(tilt)[:] = durations
    return tilt


def _extremum(orbit: HuntingOrbit, largest: bool, options: Options) -> HuntingFold:
    """A located fold, checked against the optimisation problem: the largest gain nearby, or the smallest."""
    return (confirmed if largest else confirmed_smallest)(SpecialPoint(FOLD.kind, orbit, ""), "gain", options)


# The curve -------------------------------------------------------------------------------------------------------


def fold_curve(
    servo: Servo,
    model: Model,
    *,
    vary: str,
    start: float,
    end: float,
    points: int = POINTS,
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
    """
    began = time.perf_counter()
    options = options or Options()
    known("model", model, MODELS)
    check_range(servo, vary, start, end)
    require("points", points, at_least=2)
    axis = Axis(vary, float(start), float(end))
    problem = _Problem(model, servo, axis, options, 1 / (points - 1))
    chart, c, sense, found = _begin(problem, begun)
    reason, gone, turned = "", False, any(point.turns for point in found)
    goal = servo.replace(**{vary: axis.value(1 - c)})
    restarts = 0
    places = follow(chart, sense=sense)
    if found:
        next(places)  # the last point itself
        if chart.position in (0.0, 1.0) and len(found) > 1:
            places.close()  # it is the end
    while True:
        try:
            place = next(places)
        except StopIteration as stop:
            reason = stop.value or ""
            again = _restarted(problem, chart, sense) if reason and not turned and restarts < MOST_RESTARTS else None
            if again is None:
                break
            chart, restarts = again, restarts + 1
            places = follow(chart, sense=sense)
            continue
        chart = place.chart
        found.append(replace(place.chart.fold, turns=place.turns))
        turned = turned or place.turns
        if report is not None:
            report(found[-1])
        share = found[-1].gain / max(point.gain for point in found)
        if share < VANISHING and unfed(goal) and abs(place.chart.steepness) > STEEP:
            gone = True
            break
        if share < GONE:
            reason = f"its gain has fallen to {share:.2g} of the largest one"
            break
    last = found[-1]
    if c == 1:
        found = found[::-1]
    cusps = tuple(point for point in found if point.turns)
    sentence, status = _ending(problem, last, axis.value(1 - c), turned, reason, gone)
    return FoldCurve(model, servo, vary, tuple(found), cusps, sentence, status, time.perf_counter() - began, gone)


def check_range(servo: Servo, vary: str, start: float, end: float) -> None:
    """Whether a parameter can run over a range.

    Raises
    ------
    InputError : unknown parameter, an empty range, or a value that the parameter cannot have.
    """
    known("parameter", vary, NAMES)
    if start == end:
        raise InputError(f"from = to = {shown(start)}: must differ")
    for bound in (start, end):
        servo.replace(**{vary: bound})


def _first_chart(problem: _Problem) -> _Chart:
    """The fold at an end of the range: the end next to the servo's own value, or else the other."""
    axis = problem.axis
    own = flatten(problem.servo)[axis.vary]
    order = (0.0, 1.0) if abs(own - axis.start) <= abs(own - axis.end) else (1.0, 0.0)
    complaints = []
    for c in order:
        servo = problem.servo.replace(**{axis.vary: axis.value(c)})
        chart: _Chart | str
        try:
            chart = _chart(problem, find_fold(servo, problem.model, options=problem.options).orbit, c, like=None)
        except NoOrbit as error:
            chart = str(error)
        if isinstance(chart, _Chart):
            return chart
        complaints.append(f"at {axis.vary} = {shown(axis.value(c))}: {chart}")
    raise NoOrbit("no fold to follow at either end of the range; " + "; ".join(complaints))


def _begin(problem: _Problem, begun: Sequence[FoldPoint]) -> tuple[_Chart, float, float, list[FoldPoint]]:
    """(chart to start from, c of the first point, direction of c, the points up to that chart as they were found)."""
    axis = problem.axis
    if not begun:
        chart = _first_chart(problem)
        return chart, chart.position, 1.0 if chart.position == 0 else -1.0, []
    c = 0.0 if begun[0].value == axis.start else 1.0
    found = as_found(begun, axis.start)
    position = axis.place(found[-1].value)
    again = _chart(problem, found[-1].orbit, position, like=None)
    if isinstance(again, str):
        raise NoOrbit(f"the curve cannot be taken up at {axis.vary} = {shown(found[-1].value)}: {again}")
    sense = position - axis.place(found[-2].value) if len(found) > 1 else 0.5 - c
    return again, c, float(np.sign(sense)), found


def as_found(points: Sequence[FoldPoint], start: float) -> list[FoldPoint]:
    """The points of a part of a curve in the order in which they were found, up to the last that is no cusp.

    `start` is where the range begins; a curve may have been followed from its other end.  At a cusp the second
    parameter has no direction to go on in.
    """
    found = list(points if points and points[0].value == start else points[::-1])
    while len(found) > 1 and found[-1].turns:
        found.pop()
    return found


def _restarted(problem: _Problem, last: _Chart, sense: float) -> _Chart | None:
    """A fold computed from nothing a step further on, where the curve was lost; None where it is not the same one."""
    c = float(np.clip(last.position + sense * last.reach[1] / 2, 0.0, 1.0))
    if c == last.position:
        return None
    servo = problem.servo.replace(**{problem.axis.vary: problem.axis.value(c)})
    try:
        fold = find_fold(servo, problem.model, options=problem.options)
        chart = _chart(problem, fold.orbit, c, like=None)
    except NoOrbit:
        return None
    return chart if isinstance(chart, _Chart) and last.agrees(chart) else None


def _ending(
    problem: _Problem, last: FoldPoint, goal: float, turned: bool, reason: str, gone: bool
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

    Routh-Hurwitz: K cm tau_d + sigma > J/(tau_i + tau_d), where sigma = sigma2 - (Fs - Fc)/vs sqrt(2/e) is the least
    slope of g(v) + sigma2 v.  Fold gains tend to zero on the way there; pure Coulomb friction lies beyond it where
    sigma2 does.
    """
    f, c = servo.friction, servo.controller
    least = f.viscous - (f.static - f.coulomb) / f.stribeck_velocity * np.sqrt(2 / np.e)
    return bool(least >= servo.inertia / (c.integral_time + c.lead_time)) or f.static == f.coulomb


__all__ = ["POINTS", "Axis", "FoldCurve", "FoldPoint", "as_found", "check_range", "fold_curve", "hermite", "unfed"]
