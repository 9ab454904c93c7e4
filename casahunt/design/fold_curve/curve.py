"""The fold curve phi = 0 from one end of the range of q to the other.

    K_f(q), followed by continuation/two_parameters.py from the end next to the servo's own q; it may turn back: a cusp

It ends at an end of the range, or where the gain tends to zero because nothing feeds a cycle any more (`unfed`).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Generator, Sequence
from contextlib import suppress
from dataclasses import dataclass

from ...axis_units import in_its_units
from ...checks import choice_of, require, shown
from ...continuation import Axis, SpecialOrbit, special_walk
from ...errors import InputError, NoOrbit, Status
from ...orbits import Options
from ...servo.find_fold import find_fold
from ...servo.friction import MODELS, Model, steepest
from ...servo.problem import HuntingOrbit
from ...servo.servo import Servo, a_servo, flatten
from ..sensitivity import NAMES
from .data import FoldCurve, FoldPoint

RANGE_POINTS = 17
"""Points over the range where the curve is not steep."""
VANISHING = 2e-2
"""Part of the largest fold gain of the curve below which a fold that tends to zero counts as gone."""
GONE = 1e-5
"""The same where it is not known why it should."""
Specials = Generator[SpecialOrbit, None, str]
STEEP_GAIN = 30.0
"""|d ln K/dc| from which on a gain tends to zero: a straight line would get there within 1/30 of the range."""


@in_its_units
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
    choice_of("model", model, MODELS)
    check_range(servo, vary, start, end)
    require("points", points, at_least=2)
    task = _FoldCurveTask(servo, model, Axis(vary, float(start), float(end)), options, 1 / (points - 1))
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
    return FoldCurve(model, servo, vary, tuple(found), cusps, sentence, status, time.perf_counter() - began, gone)


@dataclass(frozen=True)
class _FoldCurveTask:
    """The curve that is asked for: `spacing` is the largest step in the place c of q in its range."""

    servo: Servo
    model: Model
    axis: Axis
    options: Options
    spacing: float

    def at(self, c: float) -> Servo:
        """The servo at a place of the range."""
        return self.servo.replace(**{self.axis.vary: self.axis.value(c)})

    def fold(self, c: float) -> HuntingOrbit:
        """The orbit at its fold, from nothing.  Raises NoOrbit."""
        return find_fold(self.at(c), self.model, options=self.options).orbit

    def along(self, orbit: HuntingOrbit, sense: float) -> Specials:
        """The folds from one on, itself the first; that raises NoOrbit where there is no way on."""

        def again(c: float) -> HuntingOrbit | None:
            with suppress(NoOrbit):
                return self.fold(c)
            return None

        return special_walk(
            orbit, "gain", self.axis, sense=sense, options=self.options, spacing=self.spacing, again=again
        )

    def point(self, special: SpecialOrbit) -> FoldPoint:
        """A place of the curve as a point of the result."""
        orbit: HuntingOrbit = special.orbit
        value, status = orbit.problem.value(self.axis.vary), orbit.status
        return FoldPoint(
            value, orbit.gain, special.slope, orbit, special.error, special.across, status, special.turns, special.how
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
        reason, gone = _fading(found, task.axis, goal)
        if reason or gone:
            return reason, gone


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
    choice_of("parameter", vary, [name for name in NAMES if name in servo.names])
    if start == end:
        raise InputError(f"from = to = {shown(start)}: must differ")
    for bound in (start, end):
        servo.replace(**{vary: bound})


def _first(task: _FoldCurveTask) -> tuple[Specials, float, SpecialOrbit]:
    """The folds from an end of the range, the end, and the first of them.

    The end next to the servo's own value, or else the other.
    """
    axis = task.axis
    own = flatten(task.servo)[axis.vary]
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
    vary = task.axis.vary
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
    least = f.viscous - steepest(f)
    return bool(least >= servo.inertia / servo.controller.reset_time) or f.static == f.coulomb
