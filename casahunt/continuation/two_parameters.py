"""The curve of special points in two parameters.

    phi(s, c) = 0  (surface.py), followed by plane_curve.py from a special point that one parameter has led to

The curve may turn back in the second parameter: at a cusp of folds, or where flips exist on one side only.  Folds go
ahead in batches (folds_ahead.py) as far as those lead.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..checks import choice_of, error_text, require, to_and_back
from ..errors import InputError, NoOrbit, Status
from ..export import Columns
from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit, Orbit
from ..results import Result
from .bifurcations import FLIP, NEIMARK_SACKER, SYMMETRY_LOST
from .branching import keeps_symmetry
from .curve import parameter_value
from .fold import Fold
from .folds_ahead import folds_ahead
from .grazing_contact import contact_of
from .plane_curve import Evaluation, follow_curve, root_across
from .special_points import FOLD, GRAZING, Monitor, SpecialPoint, special_point
from .surface import Axis, Place, Sought, SpecialOrbit, place_of
from .walk import walk_to_end

Array = np.ndarray

SPECIAL_PLACES = 12
"""Places over the range of the second parameter where the curve is not steep."""
FIRST_SEARCH = 0.05
"""How far along the branch the first point of a curve is sought next to the given one."""
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
    sought, orbit = _sought(special, orbit, vary, axis, monitor, options, 1 / (points - 1))
    first = _next_to(place_of(sought, orbit, start))
    if isinstance(first, str):
        sentence = f"the curve of the {special.meaning or special.kind} was not begun: {first}"
        raise NoOrbit(sentence, Status.NOT_CONVERGED)
    found, reason = walk_to_end(special_orbits(first, sense=1.0, most=max_points), progress)
    return _curve(sought.monitor.kind, (vary, other), found, reason, began)


def _check_symmetry(special: SpecialPoint[AnyOrbit], vary: str, other: str, to: float) -> None:
    """Refuse a curve on which half a cycle is none.  Raises NoOrbit: it leads out of the symmetry."""
    orbit = special.orbit
    if not keeps_symmetry(orbit, (vary, other), (math.inf, to)):
        sentence = f"along {vary} and {other} the cycle of {orbit.problem.title} loses the symmetry by which half of"
        no_curve = f"it was computed: a {special.kind} of symmetric cycles has no curve there"
        raise NoOrbit(f"{sentence} {no_curve}", Status.NOT_FOUND)


def _curve(kind: str, names: tuple[str, str], found: list[SpecialOrbit], reason: str, began: float) -> SpecialCurve:
    """What was found as a result; `reason` says why there is no more, "" at an end of the range."""
    (vary, other), last = names, found[-1].orbit
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
    spacing: float = 1 / SPECIAL_PLACES,
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
    sought = Sought(monitor, vary, axis, options, spacing)
    first = place_of(sought, orbit, axis.place(orbit.problem.value(axis.vary))).confirmed()
    if isinstance(first, str):
        raise NoOrbit(first, Status.NOT_CONVERGED)
    return (yield from special_orbits(first, sense=sense))


def special_orbits(first: Place, *, sense: float, most: int = 200) -> Generator[SpecialOrbit, None, str]:
    """The special points along a curve, that of a place first, folds in batches as far as those lead.

    sense: +1 to start towards larger, -1 towards smaller c; most: number of steps after which it ends.
    The generator returns "" at an end of the range, or the sentence that says why it ends.
    """
    sought, special, place = first.sought, first.special, first
    assert special is not None
    yield special
    ahead = folds_ahead(first, sense) if sought.monitor is FOLD else iter(())
    for special in ahead:
        yield special
    if special.how == "batch":
        c = sought.axis.place(parameter_value(special.orbit, sought.axis.vary))
        beyond = "" if c in (0.0, 1.0) else place_of(sought, special.orbit, c, first).confirmed()
        if isinstance(beyond, str):
            return beyond
        place = beyond
    points = follow_curve(place, sense=sense, most=most)
    next(points)
    while True:
        try:
            point = next(points)
        except StopIteration as end:
            return str(end.value)
        yield replace(point.chart.special, turns=point.turns)


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


def _sought(
    special: SpecialPoint[AnyOrbit], orbit: Any, vary: str, axis: Axis, monitor: Monitor | None, options: Options,
    spacing: float,
) -> tuple[Sought, Any]:  # fmt: skip
    """What is followed, and the orbit that it starts from."""
    if monitor is None and special.kind == GRAZING.kind:
        contact, orbit = contact_of(orbit, vary, options)
        return Sought(contact.monitor, vary, axis, options, spacing, contact.reported), orbit
    monitor = monitor or MONITORS.get(special.kind)
    if monitor is None:
        kinds = ", ".join((*MONITORS, GRAZING.kind))
        raise InputError(f"special point {special.kind!r}: its monitor must be given; it is known of {kinds}")
    return Sought(monitor, vary, axis, options, spacing), orbit


def _next_to(place: Place) -> Place | str:
    """The special point next to a place, at the same value of the second parameter."""
    found = place.value(0.0, 0.0)
    if isinstance(found, Evaluation) and abs(found.value) > found.accuracy:
        sloped = place.sloped(found.value)
        across = np.zeros(2), np.array([1.0, 0.0]), FIRST_SEARCH
        root = sloped if isinstance(sloped, str) else root_across(sloped, *across)
        found = root if isinstance(root, str) else root[1]
    if isinstance(found, str):
        return found
    return place_of(place.sought, found.data, place.position, place).confirmed(found.value)
