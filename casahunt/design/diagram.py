"""The bifurcation diagram of a servo: from a gain on the stable branch, round the fold, back to that gain.

Or, by natural continuation in the gain, from there to the fold, which then is the last point.  Where no gain is asked
for, it begins at the report's lower bound, the Routh-Hurwitz gain without friction J/(cm kd' kp/ki) in three digits,
rounded up (0.0321 for its Table 1); where the servo has no stable cycle there, at the first gain that has one, in
factors of two from there up, or from a twentieth of the fold gain where that lies below.

`diagram` gives it as a Branch; `diagram_points` is a generator, so that points can be written down as they become
known, some at once, since their multipliers are computed side by side.

A diagram on the disk: MODEL.npz and MODEL.csv, whole after every point.

The npz file holds the orbits and how they were computed; the CSV file is the table of the same points and is made from
it, never read.
"""

from __future__ import annotations

import math
from collections.abc import Generator, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from io import StringIO
from pathlib import Path
from typing import Any, overload

from ..axis_units import in_its_units, shown
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
from ..export import table
from ..files import together, whole_text
from ..orbits import Archive, Options, with_multipliers
from ..results import Result
from ..servo.branch import CSV_COLUMNS, Branch, csv_row, pair_rows, save_branch
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
) -> Generator[DiagramPoint, None, str]:  # fmt: skip
    """The points of a diagram one by one, in order along the branch, each as soon as it is known.

    Parameters
    ----------
    servo, model
        the problem.
    start
        gain [V/rad] at which the stable branch is entered and the unstable one is left; default: `starting_gain`,
        0.0321 for Table 1.
    options, monitors
        tolerance and method of the orbits; special points to be located.
    largest_step
        of the walk, in arclength; of natural continuation, in relative change of the gain.
    natural
        natural continuation in the gain: the stable branch, up to the fold.

    Yields
    ------
    DiagramPoint; the generator returns the sentence that says why the branch ends.

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
        start = starting_gain(servo, model, options)
    before, previous = find_orbit(servo, model, start, options=options), None
    yield DiagramPoint(before, ())
    bounds: dict[str, Any] = {"low": start, "high": start * HIGHEST, "options": options, "largest_step": largest_step}
    steps = walk_naturally(before, **bounds) if natural else walk(before, **bounds)
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
    return f"natural continuation ends at the {fold.meaning}; the last cycle before it lies at gain {before.gain:.10g}"


def branch_of(servo: Servo, model: Model, points: Sequence[DiagramPoint], ended: str) -> Branch:
    """The branch of the symmetric cycles that points are of."""
    special = tuple(found for point in points for found in point.special)
    missed = tuple(gap for point in points for gap in point.missed)
    return Branch(model, servo, tuple(point.orbit for point in points), ended, special, missed)


SIGNS = {".csv": ",".join(("", *CSV_COLUMNS[2:])).encode() + b"\n", ".npz": Archive.SIGN}
"""What stands in a table and in an archive of a diagram, and in no other file."""


@dataclass(frozen=True)
class DiagramTask:
    """What is asked for, of every model.

    Attributes
    ----------
    servo, start, options, natural : as in `diagram`; a start of None is found for each model.
    """

    servo: Servo
    start: float | None
    options: Options
    natural: bool


@dataclass(frozen=True)
class Words:
    """What of a diagram was put into words for its files: with a new point the others are written as they were.

    Attributes
    ----------
    orbits, rows : records of orbits, and the lines of points in the table.
    """

    orbits: dict[Any, Any] = field(default_factory=dict)
    rows: dict[DiagramPoint, str] = field(default_factory=dict)

    def of(self, point: DiagramPoint) -> str:
        """The lines of a point."""
        if point not in self.rows:
            rows = [csv_row(found.orbit, found.kind) for found in point.special]
            rows += [] if point.is_special else [csv_row(point.orbit, "")]
            self.rows[point] = _lines(rows)
        return self.rows[point]


def keep(
    task: DiagramTask,
    model: Model,
    points: Sequence[DiagramPoint],
    ended: str,
    out: Path,
    words: Words | None = None,
    beside: Branch | None = None,
) -> Branch:
    """Write the points so far (npz and csv).

    words: what was written of the same points before, to which that of the new ones is added; beside: the branch with
    its lopsided pairs, where these are known. Raises InputError, OSError: as `save_branch`.
    """
    words = words or Words()
    branch = beside or branch_of(task.servo, model, points, ended)
    with together():
        save_branch(branch, out / f"{model}.npz", said=words.orbits)
        with whole_text(out / f"{model}.csv") as stream:
            table(stream, [*shown().columns({name: () for name in CSV_COLUMNS})])
            stream.writelines(words.of(point) for point in points)
            for number, pair in enumerate(branch.lopsided, 1):
                stream.write(_lines(pair_rows(pair, number)))
    return branch


def _lines(rows: Sequence[Sequence[Any]]) -> str:
    """Rows as the lines of a table."""
    whole = StringIO(newline="")
    columns = shown().columns(dict(zip(CSV_COLUMNS, zip(*rows, strict=True), strict=False)))
    table(whole, [*columns])(zip(*columns.values(), strict=True))
    return whole.getvalue().partition("\n")[2]  # without the header
