"""Special points of a branch, as they are stored with what they mean, and the monitors that tell them.

A monitor is a function of an orbit and of the curve's tangent there that changes sign at the special point:

    fold               d lambda/d s = 0, the tangent's parameter component (multiplier mu = +1)
    symmetry breaking  mu + 1 = 0
    superstable        mu = 0

    grazing            the phase sequence changes: a phase has shrunk to nothing, a slip ends with |m| = Fs

Grazing has no function that changes sign, because the sequence is another one on the other side (vanishing.py).
Some cycles get and lose weak reversals of a ring-down many times along a branch: grazing is located on request only.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any, Generic

import numpy as np

from ..checks import to_absolute_error
from ..orbits.orbit import AnyOrbit, Orbit
from ..results import Result
from .curve import CurvePoint, parameter_value, secant_direction

ACCEPTED_TOLERANCES = 1e3
"""A point counts as located within this many tolerances of its monitor; at a fold, whose parameter is second
order in that, within 1e-12."""
UNESTIMATED = 1e-6
"""Relative error with which the parameter of a provisional orbit is shown, whose own was not estimated."""


@dataclass(frozen=True, eq=False, repr=False)
class SpecialPoint(Result, Generic[AnyOrbit]):
    """A located point of a branch.

    Attributes
    ----------
    kind : "fold", "symmetry breaking", "superstable" or the name of a user function.
    orbit : the orbit at the point.
    meaning : one sentence for the user.
    at : value of the parameter, where `orbit` is the last one next to the point and not the point itself.
    vary : name of the parameter of the branch; "" for the one that the problem follows of itself.
    error : estimated absolute error of the value; NaN where none is known.
    multiplicity : how many multipliers, or complex pairs of them, pass the unit circle there.
    behind : the orbit of the branch behind which it lies; None where `orbit` is one of the branch, or not known.

    Examples
    --------
    >>> from casahunt.continuation import follow
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> (special,) = follow(orbit, "a", to=0.05).special
    >>> special.kind, round(special.value, 5)
    ('flip', 0.02626)
    """

    _quantities = ("kind", "meaning")
    _details = ("value", "vary", "error", "multiplicity", "orbit")

    kind: str
    orbit: AnyOrbit
    meaning: str
    at: float | None = None
    vary: str = ""
    error: float = math.nan
    multiplicity: int = 1
    behind: AnyOrbit | None = None

    @property
    def value(self) -> float:
        """The value of the branch's parameter at the point."""
        return parameter_value(self.orbit, self.vary or self.orbit.problem.principal) if self.at is None else self.at


@dataclass(frozen=True, repr=False)
class Missed(Result):
    """A special point that the branch has, but that was not located.

    Attributes
    ----------
    kind : as of a `SpecialPoint`.
    meaning : one sentence for the user, with the values of the parameter that it lies between.

    Examples
    --------
    >>> from casahunt.continuation import Missed
    >>> Missed("fold", "a fold between 0.1 and 0.2 was not located")
    <Missed: kind fold, meaning a fold between 0.1 and 0.2 was not located>
    """

    _quantities = ("kind", "meaning")

    kind: str
    meaning: str


@dataclass(frozen=True, repr=False)
class Monitor:
    """A function that changes sign at a special point.

    Attributes
    ----------
    kind : name of the special point.
    value : (orbit, point of the curve) -> number, of order one away from the special point.
    meaning : sentence with {name} and {value} for the parameter and its value, and {beyond} (Problem.beyond_a_fold).
    tolerance : |value| at which the point counts as located.
    confirmed : (orbit) -> whether a located point is what it is called, and an orbit next to one may be.
    sure : (orbit, point) -> whether the sign of the value there counts.
    noise : (orbit) -> error of the value; its sign counts where it is larger than that.
    by_multipliers : whether the value is one of the orbit's multipliers.
    multiplier : the value that a real multiplier passes there; NaN where it is none, or any.
    each : (orbit) -> the monitors of single multipliers, in order, where each one of several may pass; else none.

    Examples
    --------
    >>> from casahunt.continuation import FOLD, SYMMETRY_BREAKING
    >>> FOLD.kind, FOLD.by_multipliers, SYMMETRY_BREAKING.kind, SYMMETRY_BREAKING.by_multipliers
    ('fold', False, 'symmetry breaking', True)
    """

    kind: str
    value: Callable[[Orbit, CurvePoint], float]
    meaning: str
    tolerance: float = 1e-9
    confirmed: Callable[[Orbit], bool] = field(default_factory=lambda: _always)
    sure: Callable[[Orbit, CurvePoint], bool] = field(default_factory=lambda: _always)
    noise: Callable[[Orbit], float] = field(default_factory=lambda: _exact)
    by_multipliers: bool = False
    multiplier: float = math.nan
    each: Callable[[Orbit], tuple[Monitor, ...]] = field(default_factory=lambda: _single)

    def __repr__(self) -> str:
        return f"<Monitor: {self.kind}>"


def _always(*_: Any) -> bool:
    return True


def _exact(orbit: Orbit) -> float:
    return 0.0


def _single(orbit: Orbit) -> tuple[Monitor, ...]:
    return ()


def _fold_value(orbit: Orbit, point: CurvePoint) -> float:
    return float(point.row[-1])


FOLD = Monitor(
    "fold", _fold_value,
    "fold at {name} = {value:.10g}: two cycles, as a rule a stable and an unstable one, meet and are gone; {beyond}",
    multiplier=1.0,
)  # fmt: skip
SYMMETRY_BREAKING = Monitor(
    "symmetry breaking", lambda orbit, point: orbit.half_multiplier + 1,
    "symmetry breaking at {name} = {value:.10g}: the symmetric cycle hands its stability to a pair of lopsided ones",
    by_multipliers=True, multiplier=-1.0,
)  # fmt: skip
SUPERSTABLE = Monitor(
    "superstable", lambda orbit, point: orbit.half_multiplier,
    "superstable at {name} = {value:.10g}: a small disturbance of the cycle is gone after half a period",
    by_multipliers=True, multiplier=0.0,
)  # fmt: skip
GRAZING = Monitor(
    "grazing", lambda orbit, point: float("nan"),
    "grazing at {name} = {value:.8g}: a phase of the cycle shrinks to nothing or is born",
)  # fmt: skip


def special_point(
    monitor: Monitor, orbit: AnyOrbit, vary: str, error: float = 0.0, *, at: float | None = None, multiplicity: int = 1
) -> SpecialPoint[AnyOrbit]:
    """An orbit with its meaning in words, its parameter in as many digits as are known.

    error: relative error of the parameter, where the orbit does not tell it; 0: it does; at, multiplicity: as of a
    `SpecialPoint`.
    """
    value, absolute = parameter_value(orbit, vary) if at is None else at, absolute_error(orbit, vary, error)
    shown = to_absolute_error(value, absolute if math.isfinite(absolute) else UNESTIMATED * abs(value))
    meaning = monitor.meaning.format(name=vary, value=float(shown), beyond=orbit.problem.beyond_a_fold)
    if multiplicity > 1:
        what = "pairs of multipliers" if math.isnan(monitor.multiplier) else "multipliers"
        meaning += f" ({multiplicity} {what} at once)"
    return SpecialPoint(monitor.kind, orbit, meaning, at, vary, absolute, multiplicity)


def absolute_error(orbit: Orbit, vary: str, relative: float = 0.0) -> float:
    """Estimated absolute error of a parameter at a special point; relative: as `error` of `special_point`."""
    return (relative or orbit.parameter_error or orbit.error_estimate) * abs(orbit.problem.unit(vary))


def user_monitor(name: str, function: Callable[[Orbit], float]) -> Monitor:
    """A monitor of the user's own.

    Parameters
    ----------
    name
        kind of the special points.
    function
        of an orbit; they are where it changes sign.

    Returns
    -------
    Monitor.

    Examples
    --------
    >>> from casahunt.continuation import follow, user_monitor
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> height = user_monitor("top at 0.13", lambda orbit: orbit.amplitude - 0.13)
    >>> branch = follow(orbit, "a", to=0.02, monitors=(height,))
    >>> [special.kind for special in branch.special]
    ['top at 0.13']
    """
    return Monitor(name, lambda orbit, point: float(function(orbit)), name + " at {name} = {value:.10g}")


def in_order(
    special: Sequence[SpecialPoint[AnyOrbit]], before: AnyOrbit, after: AnyOrbit, vary: str,
    monitors: Sequence[Monitor], tol: float,
) -> list[SpecialPoint[AnyOrbit]]:  # fmt: skip
    """The special points between two orbits, located to a tolerance, in the order in which they are met.

    At a sharp fold a multiplier passes -1, 0 and +1 within rounding: in this order, or the other way round.  There the
    parameter, which is known to the tolerance, is second order in the place, which is known to the root of that.
    """
    if len(special) < 2:
        return list(special)
    way = secant_direction(before, after, vary)
    places = [float(secant_direction(before, s.orbit, vary) @ way / np.linalg.norm(way)) for s in special]
    start, end = (orbit.multipliers.leading.real for orbit in (before, after))
    between = (m for m in monitors if min(start, end) < m.multiplier < max(start, end))
    passed = {m.kind: m.multiplier if end > start else -m.multiplier for m in between}
    order = by_place(places, [passed.get(s.kind, math.nan) for s in special], math.sqrt(tol))
    return [special[i] for i in order]


def by_place(places: Sequence[float], passed: Sequence[float], apart: float) -> list[int]:
    """Numbers of the points in order: by place; of those no farther `apart` than that by the values that are passed.

    passed: of a multiplier, in the sense in which it goes; NaN where a point is met at none.
    """
    at, value = np.asarray(places, float), np.asarray(passed, float)
    order = np.argsort(at, kind="stable")
    groups = np.split(order, 1 + np.flatnonzero(np.diff(at[order]) > apart))
    told = (g[np.argsort(value[g], kind="stable")] if np.all(np.isfinite(value[g])) else g for g in groups)
    return [int(i) for g in told for i in g]
