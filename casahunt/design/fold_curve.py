"""The fold in two parameters: the curve K_f(q), below which a servo can hunt, over a range of q.

    d lambda/d s = 0:    s along the branch of orbits in the gain, or in another parameter of a loop of parts

At a fold of the branch in the gain the tangent has no parameter component.  With a second parameter q the folds are a
curve, which is followed as that of any special point is (continuation/two_parameters.py), from the end next to the
servo's own q.  It may turn back in q: a cusp, where two folds meet and vanish.  It ends at an end of the range, or
where the gain tends to zero because nothing feeds a cycle any more (`unfed`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from ..axis_units import in_its_units
from ..checks import choice_of, require, shown
from ..continuation import Axis, SpecialOrbit, Vanishing, special_walk
from ..errors import InputError, NoOrbit, Status
from ..export import Columns, columns_from
from ..orbits import Options
from ..results import Result
from ..servo.find_fold import find_fold
from ..servo.friction import Model, steepest
from ..servo.parts.loop import Loop
from ..servo.parts.plain_loop import model_asked
from ..servo.parts.verbs import check_present
from ..servo.servo import Servo, a_servo
from .sensitivity import NAMES

Array = np.ndarray

CSV_COLUMNS = (
    "model",
    "parameter",
    "value",
    "gain",
    "amplitude_rad",
    "period_s",
    "slope",
    "elasticity",
    "error_estimate",
    "status",
    "special",
)
"""Columns of the table of a fold curve."""
RANGE_POINTS = 17
"""Points over the range where the curve is not steep."""
VANISHING = 2e-2
"""Part of the largest fold gain of the curve below which a fold that tends to zero counts as gone."""
GONE = 1e-5
"""The same where it is not known why it should."""
Specials = Generator[SpecialOrbit, None, str]
STEEP_GAIN = 30.0
"""|d ln K/dc| from which on a gain tends to zero: a straight line would get there within 1/30 of the range."""


@dataclass(frozen=True, eq=False, repr=False)
class FoldPoint(Result):
    """A point of a fold curve.

    Attributes
    ----------
    value : the second parameter q.
    border : the parameter in which hunting ends there: the fold gain K [V/rad], or another one of a loop of parts.
    gain : K [V/rad].
    slope : derivative of `border` by q.
    orbit : the orbit at the fold, with the servo there.
    error_estimate : the largest estimated relative error of `border`, amplitude and period.
    curvature : phi_s, the second derivative of lambda along the branch: < 0 where the gain is the largest, > 0 where
        it is the smallest, 0 at a cusp.
    status : as everywhere.
    turns : whether the curve turns back in q here: a cusp.
    how : "batch" where it was computed together with others (folds_ahead.py); "followed" where step by step, and
        confirmed alone.
    """

    _quantities = ("value", "border ~ error_estimate", "gain [V/rad]", "slope", "turns", "status")
    _details = (
        "amplitude = orbit.amplitude [rad]", "period = orbit.period [s]", "elasticity", "curvature", "how",
        "servo",
    )  # fmt: skip

    value: float
    border: float
    slope: float
    orbit: Any
    error_estimate: float
    curvature: float
    status: Status
    turns: bool = False
    how: str = "followed"

    @property
    def gain(self) -> float:
        """K [V/rad]."""
        return float(self.orbit.problem.value("gain"))

    @property
    def servo(self) -> Servo | dict[str, float]:
        """The servo there; of a loop of parts its parameters."""
        servo: Servo | dict[str, float] = self.orbit.servo if hasattr(self.orbit, "servo") else self.orbit.parameters
        return servo

    @property
    def elasticity(self) -> float:
        """q/K dK/dq, per cent of gain for one per cent of the parameter."""
        return self.value * self.slope / self.border


@dataclass(frozen=True, eq=False, repr=False)
class FoldCurve(Result):
    """The fold gain against a second parameter; of a loop of parts the fold in any parameter against another one.

    Attributes
    ----------
    model, servo, vary, fold_in : the problem; the servo as given, and where it is a loop of parts, no model.
    points : in order along the curve, cusps among them.
    cusps : the points where the curve turns back in q.
    ended : sentence that says why the curve ended.
    status : CONVERGED where the whole range, or all of it that has a fold, was covered.
    wall_s : time [s].
    vanishes : whether the curve was left where the gain tends to zero.

    Examples
    --------
    >>> from casahunt import Servo, fold_curve
    >>> curve = fold_curve(Servo(), "switch", vary="friction.static", start=0.53, end=0.54, points=2)
    >>> len(curve.points), curve.status.ok
    (2, True)
    >>> [f"{gain:.4f}" for gain in curve.gains]
    ['0.6473', '0.7212']
    """

    _quantities = ("model", "vary", "number_of_points = points.size", "status", "ended")
    _details = ("fold_in", "servo = given", "points", "vanishes", "wall_s [s]")

    model: Model | None
    servo: Servo | Loop
    vary: str
    points: tuple[FoldPoint, ...]
    cusps: tuple[FoldPoint, ...]
    ended: str
    status: Status
    wall_s: float
    vanishes: bool = False
    fold_in: str = "gain"

    @property
    def given(self) -> Servo | dict[str, float]:
        """The servo; of a loop of parts its parameters."""
        return self.servo.parameters if isinstance(self.servo, Loop) else self.servo

    @property
    def way(self) -> str:
        """To which side of the curve there is hunting: "up" to it or "down"."""
        return "up" if self.points[0].curvature <= 0 else "down"

    @property
    def values(self) -> Array:
        """The second parameter."""
        return np.array([point.value for point in self.points])

    @property
    def gains(self) -> Array:
        """The fold gains; of a loop of parts that which stands for them."""
        return np.array([point.border for point in self.points])

    @property
    def slopes(self) -> Array:
        """dK/dq."""
        return np.array([point.slope for point in self.points])

    def _columns(self) -> Columns:
        model = self.model or "loop"
        rows = [
            (model, self.vary, p.value, p.border, p.orbit.amplitude, p.orbit.period, p.slope, p.elasticity,
             p.error_estimate, p.status.name.lower(), "cusp" if p.turns else "")
            for p in self.points
        ]  # fmt: skip
        return columns_from([self.fold_in if name == "gain" else name for name in CSV_COLUMNS], rows)

    def _more(self) -> dict[str, Any]:
        return {"special": [{"kind": "cusp", "value": point.value, self.fold_in: point.border} for point in self.cusps]}


@in_its_units
def fold_curve(
    servo: Servo | Loop,
    model: Model | None = None,
    *,
    vary: str,
    start: float,
    end: float,
    fold_in: str = "gain",
    points: int = RANGE_POINTS,
    options: Options | None = None,
    report: Callable[[FoldPoint], None] | None = None,
) -> FoldCurve:
    """The fold gain of a servo while one of its parameters runs over a range.

    Parameters
    ----------
    servo, model
        the problem, or a loop of parts; its own value of the parameter need not lie in the range.
    vary
        name of the parameter (sensitivity.NAMES), or one of the loop.
    start, end
        range of the parameter; the points run from `start` to `end`.
    fold_in
        of a loop: the parameter in which hunting ends.
    points
        about how many, at least 2; more where the gain changes by more than 40 % between two of them.
    options
        `tol` bounds the relative errors of gain, amplitude and period at every point.
    report
        called with every point as it is found; the first is one of the two ends.

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
    began = time.perf_counter()
    options = options or Options()
    model_asked(servo, model)
    check_range(servo, vary, start, end, fold_in)
    require("points", points, at_least=2)
    task = _FoldCurveTask(servo, model, Axis(vary, float(start), float(end)), fold_in, options, 1 / (points - 1))
    specials, c, first = _first(task)
    found = [task.point(first)]
    if report is not None:
        report(found[0])
    reason, gone = _collect(task, specials, found, c, report)
    last = found[-1]
    if c == 1:
        found = found[::-1]
    cusps = tuple(point for point in found if point.turns)
    sentence, status = _ending(task, last, task.axis.value(1 - c), bool(cusps), reason, gone)
    wall_s = time.perf_counter() - began
    return FoldCurve(model, servo, vary, tuple(found), cusps, sentence, status, wall_s, gone, fold_in)


@dataclass(frozen=True)
class _FoldCurveTask:
    """The curve that is asked for: `spacing` is the largest step in the place c of q in its range."""

    servo: Any
    model: Model | None
    axis: Axis
    fold_in: str
    options: Options
    spacing: float

    def at(self, c: float) -> Any:
        """The servo at a place of the range."""
        return self.servo.replace(**{self.axis.vary: self.axis.value(c)})

    def fold(self, c: float) -> Any:
        """The orbit at its fold, from nothing.  Raises NoOrbit."""
        there: Any = self.at(c)
        if self.axis.vary not in there.names:
            raise NoOrbit(f"there is no such part of {there.name}", Status.NOT_FOUND)
        fold = find_fold(there, cast(Any, self.model), vary=self.fold_in, options=self.options)
        if isinstance(fold, Vanishing):
            what = f"hunting of the {there.name} ends at {self.fold_in} = {fold.value:.6g} without a fold"
            raise NoOrbit(f"{what}, its swings shrink to nothing: there is no curve of folds", Status.NOT_FOUND)
        return fold.orbit

    def along(self, orbit: Any, sense: float) -> Specials:
        """The folds from one on, itself the first; that raises NoOrbit where there is no way on."""
        return special_walk(orbit, self.fold_in, self.axis, sense=sense, options=self.options, spacing=self.spacing)

    def point(self, special: SpecialOrbit) -> FoldPoint:
        """A place of the curve as a point of the result."""
        orbit, (value, border) = special.orbit, map(special.orbit.problem.value, (self.axis.vary, self.fold_in))
        error, how = max(special.error, orbit.error_estimate), special.how
        return FoldPoint(
            value, border, special.slope, orbit, error, special.across, orbit.status, special.turns, how
        )


def _collect(
    task: _FoldCurveTask,
    specials: Specials,
    found: list[FoldPoint],
    c: float,
    report: Callable[[FoldPoint], None] | None,
) -> tuple[str, bool]:
    """Append the points that follow to `found`; (why the curve ends there, whether its gain tends to zero)."""
    goal = task.at(1 - c)
    while True:
        try:
            found.append(task.point(next(specials)))
        except StopIteration as stop:
            return stop.value, False
        if report is not None:
            report(found[-1])
        last = found[-1]
        share = last.border / max(point.border for point in found)
        steepness = last.slope / last.border * task.axis.rate(task.axis.place(last.value))
        if share < VANISHING and isinstance(goal, Servo) and unfed(goal) and abs(steepness) > STEEP_GAIN:
            return "", True
        if share < GONE:
            return f"its gain has fallen to {share:.2g} of the largest one", False


def check_range(servo: Servo | Loop, vary: str, start: float, end: float, fold_in: str = "gain") -> None:
    """Refuse a range that a parameter cannot run over.

    vary: name of the parameter (sensitivity.NAMES), or one of the loop.
    Raises InputError: unknown parameter, an empty range, or a value that the parameter cannot have.
    """
    if not isinstance(servo, Loop):
        choice_of("parameter", vary, [name for name in NAMES if name in a_servo(servo).names])
        if fold_in != "gain":
            raise InputError(f"fold-in = {fold_in}: must be gain of a servo; of a loop of parts it is any parameter")
    elif vary == fold_in:
        raise InputError(f"fold-in = {fold_in}: must be another parameter than that of --vary")
    else:
        check_present(servo.replace(**{vary: start}), vary)
    if start == end:
        raise InputError(f"from = to = {shown(start)}: must differ")
    for bound in (start, end):
        servo.replace(**{vary: bound})


def _first(task: _FoldCurveTask) -> tuple[Specials, float, SpecialOrbit]:
    """The folds from an end of the range, the end, and the first of them.

    The end next to the servo's own value, or else the other.
    """
    axis = task.axis
    own = task.servo.value(axis.vary)
    order = (0.0, 1.0) if abs(own - axis.start) <= abs(own - axis.end) else (1.0, 0.0)
    complaints = []
    for c in order:
        try:
            specials = task.along(task.fold(c), 1.0 if c == 0 else -1.0)
            return specials, c, next(specials)
        except NoOrbit as error:
            complaints.append(f"at {axis.vary} = {shown(axis.value(c))}: {error}")
    raise NoOrbit("no fold to follow at either end of the range; " + "; ".join(complaints), Status.NOT_FOUND)


def _ending(
    task: _FoldCurveTask, last: FoldPoint, goal: float, turned: bool, reason: str, gone: bool
) -> tuple[str, Status]:
    """(sentence about where the curve ends, CONVERGED where nothing is missing)."""
    vary, name = task.axis.vary, "K" if task.fold_in == "gain" else task.fold_in
    where = f"the fold was followed to {vary} = {last.value:.8g}, {name} = {last.border:.6g}"
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
    least = f.viscous - steepest(f)
    return bool(least >= servo.inertia / servo.controller.reset_time) or f.static == f.coulomb


def cubic_through_points(curve: FoldCurve, samples: int = 24) -> tuple[Array, Array]:
    """The cubic through the points of a curve with their exact slopes.

    Returns q, and K [V/rad] there.
    """
    q, K, slope = curve.values, curve.gains, curve.slopes
    if len(q) < 2:
        return q, K
    x = np.linspace(0, 1, samples, endpoint=False)
    h, rise = np.diff(q)[:, None], np.diff(K)[:, None]
    a, b = slope[:-1, None] * h - rise, rise - slope[1:, None] * h
    between = K[:-1, None] + x * rise + x * (1 - x) * (a * (1 - x) + b * x)
    return np.append((q[:-1, None] + x * h).ravel(), q[-1]), np.append(between.ravel(), K[-1])
