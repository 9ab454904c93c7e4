"""The curve of special points in two parameters.

    phi(s, c) = 0  (special_charts.py), followed by plane_curve.py from a special point that one parameter has led to

The curve may turn back in the second parameter: at a cusp of folds, or where flips exist on one side only.
"""

from __future__ import annotations

import math
import time
from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..checks import error_text, known, number, require
from ..collocation.joints import event_rate
from ..errors import InputError, NoOrbit, Status
from ..export import Columns
from ..orbits.adapt import Options
from ..orbits.closure import Plane
from ..orbits.orbit import AnyOrbit, Orbit, unknowns_of
from ..results import Result
from .bifurcations import FLIP, NEIMARK_SACKER, SYMMETRY_LOST
from .curve import parameter_value
from .plane_curve import Place, Reading, follow, root_across
from .sheet import DIFFERENCE, Axis, Sheet, finer, sheet_of
from .special_charts import SpecialChart, Task, special_chart, where
from .special_points import FOLD, GRAZING, Monitor, SpecialPoint
from .touching import touch_at
from .whole import keeps_symmetry

Array = np.ndarray

SPECIAL_PLACES = 12
"""Places over the range of the second parameter where the curve is not steep."""
FIRST_SEARCH = 0.05
"""How far along the branch the first point of a curve is sought next to the given one."""
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
    special: SpecialPoint[AnyOrbit],
    vary: str,
    other: str,
    *,
    to: float,
    back: float | None = None,
    monitor: Monitor | None = None,
    options: Options | None = None,
    points: int = SPECIAL_PLACES,
    max_points: int = 200,
) -> SpecialCurve:
    """Follow a special point in two parameters, through the turns of its curve.

    Parameters
    ----------
    special
        a fold, flip, symmetry breaking, Neimark-Sacker point or grazing that was located in `vary`; or one of your own.
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
    orbit, options = special.orbit, options or Options(tol=max(special.orbit.error_estimate, 1e-8))
    axis, start = _axis(orbit, vary, other, to, back)
    require("points", points, at_least=2)
    if not keeps_symmetry(orbit, (vary, other), (math.inf, to)):
        sentence = f"along {vary} and {other} the cycle of {orbit.problem.title} loses the symmetry by which half of"
        no_curve = f"it was computed: a {special.kind} of symmetric cycles has no curve there"
        raise NoOrbit(f"{sentence} {no_curve}", Status.NOT_FOUND)
    task, orbit = _task(special, orbit, vary, monitor, options)
    sheet = sheet_of(orbit, vary, axis, start, options=finer(options), spacing=1 / (points - 1), like=None)
    chart = _first(task, sheet)
    if isinstance(chart, str):
        sentence = f"the curve of the {special.meaning or special.kind} was not begun: {chart}"
        raise NoOrbit(sentence, Status.NOT_CONVERGED)
    return _curve(task, *_collected(follow(chart, sense=1.0, most=max_points)), began)


def _curve(task: Task, found: list[Place], reason: str, began: float) -> SpecialCurve:
    """The places that were found as a result; `reason` says why there are no more, "" at an end of the range."""
    last = found[-1].chart.sheet
    reason = reason and (_leaves_its_cut(last.orbit) or reason)
    at = where(last)
    specials = [place.chart.special for place in found]
    return SpecialCurve(
        kind=task.monitor.kind,
        vary=last.vary,
        other=last.axis.vary,
        orbits=tuple(s.orbit for s in specials),
        errors=np.array([s.error for s in specials]),
        slopes=np.array([s.slope for s in specials]),
        turns=np.array([place.turns for place in found]),
        ended=f"it was followed to {at}, and no further: {reason}" if reason else f"{at}, the end of the range",
        complete=not reason,
        wall_s=time.perf_counter() - began,
    )


def _axis(orbit: Orbit, vary: str, other: str, to: float, back: float | None) -> tuple[Axis, float]:
    """The range of the second parameter from `back` to `to`, and where it starts in it."""
    for name in (vary, other):
        known("parameter", name, orbit.problem.names)
    if vary == other:
        raise InputError(f"{vary}: the two parameters must differ")
    here, to = parameter_value(orbit, other), number("to", to)
    back = here if back is None else number("back", back)
    if to == here or (to - here) * (back - here) > 0:
        raise InputError(f"{other} is {here:.6g} at the start: it cannot go to {to:.6g} and come back to {back:.6g}")
    axis = Axis(other, back, to)
    return axis, axis.place(here)


def _task(
    special: SpecialPoint[AnyOrbit], orbit: Any, vary: str, monitor: Monitor | None, options: Options
) -> tuple[Task, Any]:
    """What is followed, and the orbit that it starts from."""
    if monitor is None and special.kind == GRAZING.kind:
        touch, orbit = touch_at(orbit, vary, options)
        return Task(touch.monitor, options, touch.reported), orbit
    monitor = monitor or MONITORS.get(special.kind)
    if monitor is None:
        kinds = ", ".join((*MONITORS, GRAZING.kind))
        raise InputError(f"special point {special.kind!r}: its monitor must be given; it is known of {kinds}")
    return Task(monitor, options, lambda orbit: orbit), orbit


def _first(task: Task, sheet: Sheet) -> SpecialChart | str:
    """The chart of the special point next to the orbit of a sheet, at the same value of the second parameter."""
    bare = SpecialChart(task, sheet)
    above, below = bare.value(DIFFERENCE, 0.0), bare.value(-DIFFERENCE, 0.0)
    for read in (above, below):
        if isinstance(read, str):
            return read
    assert isinstance(above, Reading) and isinstance(below, Reading)
    slope = (above.value - below.value) / (2 * DIFFERENCE)
    found = root_across(replace(bare, gradient=(slope, 0.0)), np.zeros(2), np.array([1.0, 0.0]), FIRST_SEARCH)
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


def _collected(places: Generator[Place, None, str]) -> tuple[list[Place], str]:
    """All places, and the sentence with which they ended."""
    found: list[Place] = []
    while True:
        try:
            found.append(next(places))
        except StopIteration as end:
            return found, end.value
