"""The bifurcation diagram of a servo: from a gain on the stable branch, round the fold, back to that gain.

Or, by natural continuation in the gain, from there to the fold, which then is the last point.  Where no gain is asked
for, it begins at the report's lower bound, the Routh-Hurwitz gain without friction J/(cm kd' kp/ki) in three digits,
rounded up (0.0321 for its Table 1); where the servo has no stable cycle there, at the first gain that has one, in
factors of two from there up, or from a twentieth of the fold gain where that lies below.

`diagram` gives it as a Branch; `diagram_points` is a generator, so that points can be written down as they become
known, some at once, since their multipliers are computed side by side.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, overload

from ..axis_units import in_its_units
from ..continuation import (
    FOLD,
    SUPERSTABLE,
    SYMMETRY_BREAKING,
    Missed,
    Monitor,
    SpecialPoint,
    next_fold,
    special_points_between,
)
from ..continuation.walk import walk, walk_naturally
from ..errors import NoOrbit, Status
from ..orbits import Options, with_multipliers
from ..results import Result
from ..servo.branch import Branch
from ..servo.find_fold import HIGHEST, find_fold
from ..servo.find_orbit import find_orbit
from ..servo.friction import MODELS, Model
from ..servo.gains import typical_gain
from ..servo.problem import HuntingOrbit
from ..servo.servo import Servo, a_servo

FIGURES = 3
"""Digits of a gain to start from that nobody asked for."""
DEEPEST = 20.0
"""Fold gain over the gain to start from, where the linear loop gives none: as for Table 1."""
STANDARD = (FOLD, SYMMETRY_BREAKING, SUPERSTABLE)
"""Special points that are located where none are named."""
DRAWING_STEP = 0.15
"""Largest arclength between points: the solver could take three times as much, the eye could not."""


@dataclass(frozen=True, eq=False, repr=False)
class DiagramPoint(Result):
    """An orbit of a diagram with the special points between the one before and this one; it may be one itself.

    `missed` are those that were not located; `ahead`: the next point is computed too, up to its special points.
    """

    _quantities = (
        "model = orbit.model", "gain = orbit.gain [V/rad] ~ orbit.parameter_error",
        "amplitude = orbit.amplitude [rad] ~ orbit.amplitude_error", "period = orbit.period [s] ~ orbit.period_error",
        "is_special",
    )  # fmt: skip
    _details = ("orbit", "special", "missed")

    orbit: HuntingOrbit
    special: tuple[SpecialPoint[HuntingOrbit], ...]
    missed: tuple[Missed, ...] = ()
    ahead: bool = False

    @property
    def is_special(self) -> bool:
        """Whether the orbit is one of the special points."""
        return any(special.orbit is self.orbit for special in self.special)


def starting_gain(servo: Servo, model: Model, options: Options | None = None) -> float:
    """Where a diagram begins that is asked for without a gain.

    servo, model, options: the problem, and tolerance and method of its orbits.
    Returns A gain [V/rad] at which the servo has a stable hunting cycle, the same for the same problem.
    Raises NoOrbit: the servo has no cycle, or none was found.
    """
    a_servo(servo)
    lowest = _rounded_up(typical_gain(servo))
    with suppress(NoOrbit):
        return find_orbit(servo, model, lowest, options=options).gain
    fold = find_fold(servo, model, options=options).gain
    gain = 2 * lowest if lowest < fold else fold / DEEPEST
    while (gain := _rounded_up(gain)) < fold:
        with suppress(NoOrbit):
            return find_orbit(servo, model, gain, options=options).gain
        gain *= 2
    raise NoOrbit(
        f"no stable hunting cycle was found with which the diagram of the {model} servo could start, though its cycles "
        f"end in a fold at gain {fold:.8g}: give the gain to start from",
        Status.NOT_FOUND,
    )


def _rounded_up(gain: float) -> float:
    """A gain in `FIGURES` digits, not smaller."""
    unit = FIGURES - 1 - math.floor(math.log10(gain))
    return float(f"{math.ceil(gain * 10.0**unit * (1 - 1e-12)) / 10.0**unit:.{FIGURES}g}")


@overload
def diagram(
    servo: Servo, model: Model, *, start: float | None = None, options: Options | None = None,
    monitors: tuple[Monitor, ...] = STANDARD, largest_step: float = DRAWING_STEP, natural: bool = False,
) -> Branch: ...  # fmt: skip
@overload
def diagram(
    servo: Servo, model: tuple[Model, ...] = MODELS, *, start: float | None = None, options: Options | None = None,
    monitors: tuple[Monitor, ...] = STANDARD, largest_step: float = DRAWING_STEP, natural: bool = False,
) -> tuple[Branch, ...]: ...  # fmt: skip
@in_its_units
def diagram(
    servo: Servo, model: Model | tuple[Model, ...] = MODELS, *, start: float | None = None,
    options: Options | None = None, monitors: tuple[Monitor, ...] = STANDARD, largest_step: float = DRAWING_STEP,
    natural: bool = False,
) -> Branch | tuple[Branch, ...]:  # fmt: skip
    """The bifurcation diagram of a servo: hunting cycles from a gain round the fold and back.

    Parameters
    ----------
    servo
        the servo.
    model
        its friction model, "switch" or "lugre", or several of them; default: both.
    start
        gain [V/rad] at which the stable branch is entered and the unstable one is left; default: `starting_gain` of
        each model, 0.0321 for Table 1.
    options, monitors
        tolerance and method of the orbits; special points to be located.
    largest_step
        of the walk, in arclength; of natural continuation, in relative change of the gain.
    natural
        natural continuation in the gain: the stable branch, up to the fold.

    Returns
    -------
    Branch; of several models one each, in their order.

    Raises
    ------
    InputError, NoOrbit : as `find_orbit` at the gain `start`, or, without one, where no gain to begin at is found.

    Examples
    --------
    >>> from casahunt import Servo, diagram
    >>> branch = diagram(Servo(), "switch", start=0.6)
    >>> branch.ended
    'gain reached 0.6, the end of the range'
    >>> bool(branch.amplitudes[-1] < branch.amplitudes[0])  # the unstable cycle is the smaller one
    True
    >>> [f"{branch.gains.max():.2f}" for branch in diagram(Servo(), start=0.6)]  # of both models
    ['0.65', '0.62']
    """
    how: dict[str, Any] = {"start": start, "options": options, "monitors": monitors, "largest_step": largest_step,
                           "natural": natural}  # fmt: skip
    models = (model,) if isinstance(model, str) else model
    branches = tuple(_whole(servo, each, diagram_points(servo, each, **how)) for each in models)
    return branches[0] if isinstance(model, str) else branches


def _whole(servo: Servo, model: Model, points: Generator[DiagramPoint, None, str]) -> Branch:
    """A diagram that is run to its end."""
    ended = ""

    def run() -> Iterator[DiagramPoint]:
        nonlocal ended
        ended = yield from points

    return branch_of(servo, model, list(run()), ended)


def diagram_points(
    servo: Servo, model: Model, *, start: float | None = None, options: Options | None = None,
    monitors: tuple[Monitor, ...] = STANDARD, largest_step: float = DRAWING_STEP, natural: bool = False,
    begun: Sequence[DiagramPoint] = (),
) -> Generator[DiagramPoint, None, str]:  # fmt: skip
    """The points of a diagram one by one, in order along the branch, each as soon as it is known.

    Parameters
    ----------
    servo, model
        the problem.
    start
        gain [V/rad] at which the stable branch is entered and the unstable one is left; default: that of the first
        point of `begun`, or `starting_gain`, 0.0321 for Table 1.
    options, monitors
        tolerance and method of the orbits; special points to be located.
    largest_step
        of the walk, in arclength; of natural continuation, in relative change of the gain.
    natural
        natural continuation in the gain: the stable branch, up to the fold.
    begun
        the points of the same diagram that are there already, in order: it goes on behind them.

    Yields
    ------
    DiagramPoint, those of `begun` left out; the generator returns the sentence that says why the branch ends.

    Raises
    ------
    InputError, NoOrbit : as `find_orbit` at the gain `start`, or as `starting_gain` without one.

    Examples
    --------
    >>> from casahunt import Servo, diagram_points
    >>> points = diagram_points(Servo(), "switch", start=0.6)
    >>> next(points).orbit.gain
    0.6
    """
    options = options or Options()
    if start is None:
        start = begun[0].orbit.gain if begun else starting_gain(servo, model, options)
    if begun:
        before = begun[-1].orbit
    else:
        before = find_orbit(servo, model, start, options=options)
        yield DiagramPoint(before, ())
    over = _over(begun, start, natural)
    if over:
        return over
    bounds: dict[str, Any] = {"low": start, "high": start * HIGHEST, "options": options, "largest_step": largest_step}
    previous = begun[-2].orbit if len(begun) > 1 else None
    steps = walk_naturally(before, **bounds) if natural else walk(before, previous=previous, **bounds)
    batches = with_multipliers(steps, ahead=any(monitor.by_multipliers for monitor in monitors))
    while True:
        try:
            after, ahead = next(batches)
        except StopIteration as end:
            ended = str(end.value)
            break
        found, missed = special_points_between(
            before, after, earlier=previous, vary="gain", monitors=monitors, options=options, inside=True
        )
        yield DiagramPoint(after, tuple(found), tuple(missed), ahead)
        previous, before = before, after
    return (yield from _fold_behind(before, ended, options)) if natural else ended


def _fold_behind(before: HuntingOrbit, ended: str, options: Options) -> Generator[DiagramPoint, None, str]:
    """The fold at which natural continuation has ended, as the last point of its diagram."""
    try:
        fold = next_fold(before, "gain", options)
    except NoOrbit as error:
        return f"{ended}; that this is a fold is not shown: {error}"
    yield DiagramPoint(fold.orbit, (fold,))
    return _natural_end(fold, before)


def _over(begun: Sequence[DiagramPoint], start: float, natural: bool) -> str:
    """Why a diagram ends with the points that are there already; "" where it goes on."""
    if len(begun) > 1 and natural and begun[-1].is_special:
        return _natural_end(begun[-1].special[-1], begun[-2].orbit)
    if len(begun) > 1 and not natural and begun[-1].orbit.gain == start:
        return f"gain reached {start:.6g}, the end of the range"
    return ""


def _natural_end(fold: SpecialPoint[HuntingOrbit], before: HuntingOrbit) -> str:
    return f"natural continuation ends at the {fold.meaning}; the last cycle before it lies at gain {before.gain:.10g}"


def branch_of(servo: Servo, model: Model, points: Sequence[DiagramPoint], ended: str) -> Branch:
    """The branch of the symmetric cycles that points are of."""
    special = tuple(found for point in points for found in point.special)
    missed = tuple(gap for point in points for gap in point.missed)
    return Branch(model, servo, tuple(point.orbit for point in points), ended, special, missed)
