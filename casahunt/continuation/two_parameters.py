"""The curve of special points in two parameters.

    phi(s, c) = 0  (special_charts.py), followed by plane_curve.py from a special point that one parameter has led to

The curve may turn back in the second parameter: at a cusp of folds, or where flips exist on one side only.  Folds go
ahead in batches (special_charts.py) as far as those lead.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..checks import choice_of, error_text, require, to_and_back
from ..collocation.joints import event_rate
from ..errors import InputError, NoOrbit, Status
from ..export import Columns
from ..orbits.adapt import Options
from ..orbits.closure import Plane
from ..orbits.orbit import AnyOrbit, Orbit, unknowns_of
from ..results import Result
from .bifurcations import FLIP, NEIMARK_SACKER, SYMMETRY_LOST
from .branching import keeps_symmetry
from .curve import parameter_value
from .fold import Fold
from .grazing_contact import contact_of
from .plane_curve import Evaluation, follow_curve, root_across
from .sheet import Axis, Sheet, finer, sheet_of
from .special_charts import ChartSetting, SpecialChart, SpecialOrbit, folds_ahead, special_chart
from .special_points import FOLD, GRAZING, Monitor, SpecialPoint, special_point
from .walk import walk_to_end

Array = np.ndarray

SPECIAL_PLACES = 12
"""Places over the range of the second parameter where the curve is not steep."""
FIRST_SEARCH = 0.05
"""How far along the branch the first point of a curve is sought next to the given one."""
MOST_RESTARTS = 4
"""How often a curve is taken up again, by a special point found another way, where the steps do not converge."""
HARDLY = 1e-2
"""A plane is hardly crossed where the rate of what vanishes on it, times the period, is less."""
MONITORS = {monitor.kind: monitor for monitor in (FOLD, FLIP, SYMMETRY_LOST, NEIMARK_SACKER)}


@dataclass(frozen=True, eq=False, repr=False)
class SpecialCurve(Result):
    """Special points along a curve in two parameters.

    Attributes
    ----------
    kind : of the special points.
    vary, other : names of the two parameters.
    orbits : (m) at the special points, in order along the curve, the one that it starts at first.
    errors : (m,) estimated errors of `vary`, relative to its size or to that of the system's own value, if larger.
    slopes : (m,) derivative of `vary` by `other` along the curve.
    turns : (m,) whether the curve turns back in `other` there.
    ended : one sentence that says why the curve ends where it does.
    complete : whether it ends at an end of the range.
    wall_s : time that it took [s].

    Examples
    --------
    >>> from casahunt.continuation import follow, special_curve
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> (flip,) = follow(orbit, "a", to=0.05).special
    >>> flips = special_curve(flip, "a", "r", to=0.78, points=2)
    >>> flips.kind, flips.complete, flips.values.shape
    ('flip', True, (2, 2))
    """

    _quantities = ("kind", "vary", "other", "number_of_points = orbits.size", "complete")
    _details = ("ended", "wall_s")

    kind: str
    vary: str
    other: str
    orbits: tuple[Any, ...]
    errors: Array
    slopes: Array
    turns: Array
    ended: str
    complete: bool
    wall_s: float

    @property
    def values(self) -> Array:
        """(m, 2) values of `vary` and of `other`."""
        return np.array([[parameter_value(orbit, name) for name in (self.vary, self.other)] for orbit in self.orbits])

    def __str__(self) -> str:
        x, q = self.values.T
        ways = f"{self.other} from {q[0]:.6g} to {q[-1]:.6g}, {self.vary} from {x.min():.6g} to {x.max():.6g}"
        lines = [f"{self.kind} curve of {self.orbits[0].problem.title}: {len(q)} cycles, {ways}; {self.ended}"]
        turns = self.turns.nonzero()[0]
        lines += [f"it turns back at {self.other} = {q[k]:.8g}, {self.vary} = {x[k]:.8g}" for k in turns]
        return "\n".join([*lines, f"largest error of {self.vary}: {error_text(float(np.max(self.errors)))}"])

    def _columns(self) -> Columns:
        return {
            self.other: self.values[:, 1],
            self.vary: self.values[:, 0],
            "error": self.errors,
            "slope": self.slopes,
            "turns": self.turns,
            "period": [orbit.period for orbit in self.orbits],
        }


def special_curve(
    special: SpecialPoint[AnyOrbit] | Fold[AnyOrbit],
    vary: str,
    other: str,
    *,
    to: float,
    back: float | None = None,
    monitor: Monitor | None = None,
    options: Options | None = None,
    points: int = SPECIAL_PLACES,
    max_points: int = 200,
    progress: Callable[[SpecialOrbit], None] | None = None,
) -> SpecialCurve:
    """Follow a special point in two parameters, through the turns of its curve.

    Parameters
    ----------
    special
        a fold, flip, symmetry breaking, Neimark-Sacker point or grazing that was located in `vary`; what `largest` or
        `smallest` has found; or one of your own.
    vary, other
        names of the parameter it was located in, and of the second one.
    to
        value of `other` towards which the curve goes, and at which it ends.
    back
        value of `other` at which it ends on the other side, where it has turned; default the one it starts at.
    monitor
        what vanishes at a special point of your own.
    options
        tolerance and method; default the tolerance to which the orbit is known, or 1e-8.
    points
        about how many over the range, at least 2; more where `vary` changes by more than 40 % between two of them.
    max_points
        number of steps after which it ends.
    progress
        called with every point as it is found.

    Returns
    -------
    SpecialCurve.

    Raises
    ------
    InputError : unknown parameter, no range, or a kind of special point that has no monitor.
    NoOrbit : at the given point there is none.

    Examples
    --------
    >>> from casahunt.continuation import follow, special_curve
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> (flip,) = follow(orbit, "a", to=0.05).special
    >>> flips = special_curve(flip, "a", "r", to=0.78, points=2)
    >>> [round(value, 5) for value in flips.values[-1].tolist()]
    [0.02666, 0.78]
    """
    began = time.perf_counter()
    special = special_point(FOLD, special.orbit, vary) if isinstance(special, Fold) else special
    orbit, options = special.orbit, options or Options(tol=max(special.orbit.error_estimate, 1e-8))
    axis, start = _axis(orbit, vary, other, to, back)
    require("points", points, at_least=2)
    _check_symmetry(special, vary, other, to)
    task, orbit = _task(special, orbit, vary, monitor, options)
    sheet = sheet_of(orbit, vary, axis, start, options=finer(options), spacing=1 / (points - 1), like=None)
    chart = _first(task, sheet)
    if isinstance(chart, str):
        sentence = f"the curve of the {special.meaning or special.kind} was not begun: {chart}"
        raise NoOrbit(sentence, Status.NOT_CONVERGED)
    found, reason = walk_to_end(_told(special_orbits(chart, sense=1.0, most=max_points), progress))
    return _curve(task.monitor.kind, (vary, other), found, reason, began)


def _check_symmetry(special: SpecialPoint[AnyOrbit], vary: str, other: str, to: float) -> None:
    """Refuse a curve on which half a cycle is none.  Raises NoOrbit: it leads out of the symmetry."""
    orbit = special.orbit
    if not keeps_symmetry(orbit, (vary, other), (math.inf, to)):
        sentence = f"along {vary} and {other} the cycle of {orbit.problem.title} loses the symmetry by which half of"
        no_curve = f"it was computed: a {special.kind} of symmetric cycles has no curve there"
        raise NoOrbit(f"{sentence} {no_curve}", Status.NOT_FOUND)


def _told(
    points: Generator[SpecialOrbit, None, str], progress: Callable[[SpecialOrbit], None] | None
) -> Generator[SpecialOrbit, None, str]:
    """The points of a walk, each told of."""
    while True:
        try:
            point = next(points)
        except StopIteration as end:
            return str(end.value or "")
        if progress is not None:
            progress(point)
        yield point


def _curve(kind: str, names: tuple[str, str], found: list[SpecialOrbit], reason: str, began: float) -> SpecialCurve:
    """What was found as a result; `reason` says why there is no more, "" at an end of the range."""
    (vary, other), last = names, found[-1].orbit
    reason = reason and (_leaves_its_cut(last) or reason)
    at = f"{other} = {parameter_value(last, other):.8g}, {vary} = {parameter_value(last, vary):.8g}"
    return SpecialCurve(
        kind=kind,
        vary=vary,
        other=other,
        orbits=tuple(s.orbit for s in found),
        errors=np.array([s.error for s in found]),
        slopes=np.array([s.slope for s in found]),
        turns=np.array([s.turns for s in found]),
        ended=f"it was followed to {at}, and no further: {reason}" if reason else f"{at}, the end of the range",
        complete=not reason,
        wall_s=time.perf_counter() - began,
    )


def special_walk(
    orbit: AnyOrbit, vary: str, axis: Axis, *, sense: float, options: Options, monitor: Monitor = FOLD,
    spacing: float = 1 / SPECIAL_PLACES, turned: bool = False, again: Callable[[float], Any] | None = None,
) -> Generator[SpecialOrbit, None, str]:  # fmt: skip
    """The special points along a curve in two parameters, one by one: that of a known orbit first.

    Parameters
    ----------
    orbit
        at a special point, where the second parameter is in its range.
    vary, axis
        name of the parameter it was located in; the second one with its range.
    sense
        +1 to start towards the end of the range, -1 towards its start.
    options, monitor
        tolerance and method; what vanishes at the special point: a fold, a flip, a loss of symmetry, a torus.
    spacing
        largest step, as a part of the range.
    turned
        whether the curve has turned already: parts of it that go ahead in batches do not.
    again
        from a place in the range to the orbit of a special point there, by another way, None where there is none: asked
        a little further on where the curve was lost.

    Yields
    ------
    SpecialOrbit.  The generator returns "" at an end of the range, or the sentence that says why it ends.

    Raises
    ------
    NoOrbit : the first one is none that a curve goes through.

    Examples
    --------
    >>> from casahunt.continuation import Axis, largest, special_walk
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import Options, find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> fold, axis = largest(orbit, "g"), Axis("r", 0.8, 0.79)
    >>> *_, last = special_walk(fold.orbit, "g", axis, sense=1.0, options=Options(tol=1e-7))
    >>> last.orbit.problem.value("r"), round(last.orbit.problem.value("g"), 3)
    (0.79, 13.023)
    """
    task, c = ChartSetting(monitor, options, lambda orbit: orbit), axis.place(orbit.problem.value(axis.vary))
    chart = chart_at(task, orbit, vary, axis, c, spacing)
    if isinstance(chart, str):
        raise NoOrbit(chart, Status.NOT_CONVERGED)
    return (yield from special_orbits(chart, sense=sense, turned=turned, again=again))


def special_orbits(
    chart: SpecialChart,
    *,
    sense: float,
    most: int = 200,
    turned: bool = False,
    again: Callable[[float], Any] | None = None,
) -> Generator[SpecialOrbit, None, str]:
    """The special points along a curve, that of the chart first.

    sense: +1 to start towards larger, -1 towards smaller c; most, turned: number of steps after which it ends, whether
    the curve has turned already; again: c -> the orbit of a special point there, by another way, None where there is
    none: asked a little further on where the curve was lost.
    Yields special points.  The generator returns "" at an end of the range, or the sentence that says why it ends.
    """
    special, task = chart.special, chart.task
    assert special is not None
    yield special
    if task.monitor is FOLD and not turned:
        first = special
        for special in folds_ahead(chart.sheet, first, sense, task.options.tol):
            yield special
        if special is not first:
            axis = chart.sheet.axis
            position = axis.place(parameter_value(special.orbit, axis.vary))
            if position in (0.0, 1.0):
                return ""
            beyond = special_chart(task, Evaluation(0.0, special.orbit), chart.sheet, position - chart.position)
            if isinstance(beyond, str):
                return beyond
            chart = beyond
    for _ in range(MOST_RESTARTS + 1):
        places = follow_curve(chart, sense=sense, most=most)
        next(places)
        try:
            while True:
                place = next(places)
                chart, turned = place.chart, turned or place.turns
                yield replace(place.chart.special, turns=place.turns)
        except StopIteration as end:
            ended = str(end.value)
        fresh = _beyond(chart, sense, again) if ended and not turned else None
        if fresh is None or fresh.special is None:
            break
        chart = fresh
        yield fresh.special
    return ended


def _beyond(last: SpecialChart, sense: float, again: Callable[[float], Any] | None) -> SpecialChart | None:
    """The special point a step further on, by another way; None where it is not of the same curve."""
    c = float(np.clip(last.position + sense * last.reach[1] / 2, 0.0, 1.0))
    orbit = again(c) if again is not None and c != last.position else None
    if orbit is None:
        return None
    chart = special_chart(last.task, Evaluation(0.0, orbit), last.sheet, c - last.position)
    return None if isinstance(chart, str) or not last.sheet.agrees(chart.sheet) else chart


def _axis(orbit: Orbit, vary: str, other: str, to: float, back: float | None) -> tuple[Axis, float]:
    """The range of the second parameter from `back` to `to`, and where it starts in it."""
    for name in (vary, other):
        choice_of("parameter", name, orbit.problem.names)
    if vary == other:
        raise InputError(f"{vary}: the two parameters must differ")
    here = parameter_value(orbit, other)
    to, back = to_and_back(other, here, to, back)
    axis = Axis(other, back, to)
    return axis, axis.place(here)


def _task(
    special: SpecialPoint[AnyOrbit], orbit: Any, vary: str, monitor: Monitor | None, options: Options
) -> tuple[ChartSetting, Any]:
    """What is followed, and the orbit that it starts from."""
    if monitor is None and special.kind == GRAZING.kind:
        contact, orbit = contact_of(orbit, vary, options)
        return ChartSetting(contact.monitor, options, contact.reported), orbit
    monitor = monitor or MONITORS.get(special.kind)
    if monitor is None:
        kinds = ", ".join((*MONITORS, GRAZING.kind))
        raise InputError(f"special point {special.kind!r}: its monitor must be given; it is known of {kinds}")
    return ChartSetting(monitor, options, lambda orbit: orbit), orbit


def chart_at(task: ChartSetting, orbit: Orbit, vary: str, axis: Axis, c: float, spacing: float) -> SpecialChart | str:
    """The chart of a special point that is known, or a sentence that says why there is none.

    orbit, vary: its orbit, and the first parameter; axis, c, spacing: the second one, where in its range the point is,
    and the largest step there.
    """
    sheet = sheet_of(orbit, vary, axis, c, options=finer(task.options), spacing=spacing, like=None)
    return special_chart(task, Evaluation(0.0, orbit), sheet, 0.0)


def _first(task: ChartSetting, sheet: Sheet) -> SpecialChart | str:
    """The chart of the special point next to the orbit of a sheet, at the same value of the second parameter."""
    bare = SpecialChart(task, sheet)
    beside = bare.along_s()
    if isinstance(beside, str):
        return beside
    found = root_across(replace(bare, gradient=(beside[2], 0.0)), np.zeros(2), np.array([1.0, 0.0]), FIRST_SEARCH)
    return found if isinstance(found, str) else special_chart(task, found[1], sheet, 0.0)


def _leaves_its_cut(orbit: Orbit) -> str:
    """A sentence where an orbit hardly crosses a plane that cuts it, and has left it beyond; else ""."""
    t, u, setting = unknowns_of(orbit)
    for k, phase in enumerate(t.cycle.phases):
        x = t.nodes_of(u)[t.phase_end[k]] * setting.scale
        if not isinstance(phase.end.function, Plane):
            continue
        if abs(event_rate(phase, x, orbit.arcs[k].duration, setting.p)[0]) * orbit.period < HARDLY:
            plane = f"the plane that cuts it, {phase.end.name}"
            return f"beyond, the cycle does not reach {plane}; begin with a cycle there"
    return ""
