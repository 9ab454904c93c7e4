"""Special points of a branch, located between two orbits and stored with what they mean.

A monitor is a function of an orbit and of the curve's tangent there that changes sign at the special
point.  Between two successive orbits where it does, the root is found in arclength by inverse interpolation between
true corrections, down to rounding of the function or to the precision that it can have:

    fold               d lambda/d s = 0, the tangent's parameter component (multiplier mu = +1)
    symmetry breaking  mu + 1 = 0
    superstable        mu = 0

    grazing            the phase sequence changes: a phase has shrunk to nothing, a slip ends with |m| = Fs

Grazing has no function that changes sign, because the sequence is another one on the other side (phase_change.py).
Some cycles get and lose weak reversals of a ring-down many times along a branch: grazing is located on request only.

The parameter value of a fold is second order in the place on the curve: it comes out to rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Generic

import numpy as np

from ..checks import to_error
from ..errors import NoOrbit
from ..hybrid.roots import CLOSED, Bracket, Search
from ..orbits.adapt import Options, refined
from ..orbits.orbit import AnyOrbit, Orbit
from ..results import Result
from .curve import (
    Point,
    backwards,
    bend,
    bent_through,
    curve_point,
    ends,
    in_units_of,
    parameter_value,
    secant,
    seen_from,
)
from .phase_change import change_of_phases
from .walk import step_along

Array = np.ndarray

LOCATE_ROUNDS = 40
CUBIC_ROUNDS = 6
"""Turning points of cubics after which a fold is sought in the other way; most need three."""
MAX_FAILURES = 8
ACCEPTED_TOLERANCES = 1e3
"""A point counts as located within this many tolerances of its monitor; at a fold, whose parameter is second
order in that, within 1e-12."""


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
    _details = ("value", "vary", "orbit")

    kind: str
    orbit: AnyOrbit
    meaning: str
    at: float | None = None
    vary: str = ""

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


@dataclass(frozen=True)
class Monitor:
    """A function that changes sign at a special point.

    Attributes
    ----------
    kind : name of the special point.
    value : (orbit, point of the curve) -> number, of order one away from the special point.
    meaning : sentence with {name} and {value} for the parameter and its value, and {beyond} (Problem.beyond_a_fold).
    tolerance : |value| at which the point counts as located.
    confirmed : (orbit) -> whether a located point is what it is called, and an orbit next to one may be.
    passed : (orbit, point, orbit, point) before and after -> whether multipliers say, too, that there is one between.
    by_multipliers : whether the value is one of the orbit's multipliers.
    """

    kind: str
    value: Callable[[Orbit, Point], float]
    meaning: str
    tolerance: float = 1e-9
    confirmed: Callable[[Orbit], bool] = lambda orbit: True
    passed: Callable[[Orbit, Point, Orbit, Point], bool] = lambda before, here, after, there: True
    by_multipliers: bool = False


def _fold_value(orbit: Orbit, point: Point) -> float:
    return float(point.row[-1])


FOLD = Monitor(
    "fold", _fold_value,
    "fold at {name} = {value:.10g}: the stable and the unstable cycle merge; {beyond}",
)  # fmt: skip
SYMMETRY_BREAKING = Monitor(
    "symmetry breaking", lambda orbit, point: orbit.half_multiplier + 1,
    "symmetry breaking at {name} = {value:.10g}: the symmetric cycle hands its stability to a pair of lopsided ones",
    by_multipliers=True,
)  # fmt: skip
SUPERSTABLE = Monitor(
    "superstable", lambda orbit, point: orbit.half_multiplier,
    "superstable at {name} = {value:.10g}: perturbations of the cycle die out within half a period",
    by_multipliers=True,
)  # fmt: skip
GRAZING = Monitor(
    "grazing", lambda orbit, point: float("nan"),
    "grazing at {name} = {value:.8g}: a phase of the cycle shrinks to nothing or is born",
)  # fmt: skip
STANDARD = (FOLD, SYMMETRY_BREAKING, SUPERSTABLE)


def special_point(monitor: Monitor, orbit: AnyOrbit, vary: str, error: float = 0.0) -> SpecialPoint[AnyOrbit]:
    """An orbit with its meaning in words, its parameter in as many digits as are known.

    Parameters
    ----------
    monitor
        what is special about it.
    orbit
        the orbit.
    vary
        name of the parameter.
    error
        relative error of the parameter, where it is known better than from the orbit itself.

    Returns
    -------
    SpecialPoint.
    """
    value = parameter_value(orbit, vary)
    relative = error or orbit.parameter_error or orbit.error_estimate
    absolute = relative * abs(orbit.problem.unit(vary))
    digits = to_error(value, absolute / abs(value)) if abs(value) > absolute else "0"
    meaning = monitor.meaning.format(name=vary, value=float(digits), beyond=orbit.problem.beyond_a_fold)
    return SpecialPoint(monitor.kind, orbit, meaning, vary=vary)


def crossings(
    before: AnyOrbit, after: AnyOrbit, *, vary: str, monitors: tuple[Monitor, ...], options: Options
) -> tuple[list[SpecialPoint[AnyOrbit]], list[Missed]]:
    """The special points between two successive orbits of a walk.

    Parameters
    ----------
    before, after
        the orbits, in the order of the walk.
    vary
        name of the parameter.
    monitors
        the kinds that are looked for.
    options
        tolerance and method of the orbits.

    Returns
    -------
    Special points in the order of the walk, and those that are there and were not located.
    """
    found, missed = [], []
    start: Point | None = None
    end: Point | None = None
    for monitor in monitors:
        if monitor is GRAZING:
            grazing = change_of_phases(before, after, vary, options)
            if grazing is not None:
                found.append(special_point(monitor, grazing, vary))
            continue
        if start is None or end is None:
            start, end = ends(before, after, vary)
        a, b = monitor.value(before, start), monitor.value(after, end)
        if not (np.isfinite(a) and np.isfinite(b)) or a * b > 0 or a == 0:
            continue
        if not (monitor.confirmed(before) or monitor.confirmed(after)) or not monitor.passed(before, start, after, end):
            continue
        orbit = locate(before, after, monitor, vary=vary, options=options)
        width = abs(before.problem.distance(vary, parameter_value(after, vary)))
        if orbit is None and monitor.kind == "fold" and width <= options.tol:
            # Too sharp to be resolved in arclength, but the two sides of it agree in the parameter.
            orbit = max(before, after, key=lambda o: parameter_value(o, vary))
        if orbit is None:
            bounds = f"{vary} = {parameter_value(before, vary):.8g} and {parameter_value(after, vary):.8g}"
            advice = "the steps towards it did not converge; another tolerance may lead there"
            missed.append(Missed(monitor.kind, f"a {monitor.kind} point between {bounds} was not located: {advice}"))
            continue
        if monitor.confirmed(orbit):
            found.append(special_point(monitor, orbit, vary))
    found.sort(key=lambda s: float(np.dot(secant(before, s.orbit, vary), secant(before, after, vary))))
    return found, missed


def locate(before: AnyOrbit, after: AnyOrbit, monitor: Monitor, *, vary: str, options: Options) -> AnyOrbit | None:
    """The orbit between two at which a monitor vanishes.

    Steps start at the orbit where it is smaller, which is as a rule the closer one, along its tangent; where they fail,
    at the other.

    Parameters
    ----------
    before, after
        the orbits, in the order of the walk.
    monitor
        which changes sign between them.
    vary
        name of the parameter.
    options
        tolerance and method of the orbit.

    Returns
    -------
    The orbit; None where the steps there do not converge.
    """
    start, end = ends(before, after, vary)
    if abs(monitor.value(after, end)) < abs(monitor.value(before, start)):
        before, after = after, before
    orbit = _fold_by_cubics(before, after, vary=vary, options=options) if monitor.kind == FOLD.kind else None
    orbit = orbit or _located_from(before, after, monitor, vary=vary, options=options)
    return orbit or _located_from(after, before, monitor, vary=vary, options=options)


def _fold_by_cubics(before: AnyOrbit, after: AnyOrbit, *, vary: str, options: Options) -> AnyOrbit | None:
    """The fold next to `before`: again and again the turning point of the cubic through the last two orbits.

    The error of a cubic falls with the fourth power of the way between its ends: three orbits are enough as a rule.
    None where one of them is not where it should be.
    """
    before = _accurate(before, options)
    here, there = ends(before, after, vary)
    found: AnyOrbit | None = None
    for k in range(CUBIC_ROUNDS):
        cubic = bend(there, here, seen_from(here, before, vary, parameter_value(after, vary)), side=1.0)
        length = _length_to(after, before, here, vary)
        # At first the fold lies between the two; then next to the last one, on either side of it.
        least = 0.0 if k == 0 else -length
        ds = math.inf if cubic is None else _turning_point(here.row[-1], cubic.coefficients[:, -1], least)
        if not abs(ds) < length:
            return found
        here = replace(here, bend=cubic)
        there = here if ds > 0 else backwards(here)
        outcome = step_along(there, before, vary, abs(ds), *before.problem.range_of(vary), options)
        if isinstance(outcome, str):
            return found
        before, after, there = outcome[0], before, backwards(there)
        here = curve_point(before, vary, like=in_units_of(there.row, there.setting.scale, before.scale))
        off = abs(FOLD.value(before, here))
        found = before if off <= FOLD.tolerance else None
        if off <= min(FOLD.tolerance, options.tol):  # period and amplitude move with the place along the branch
            return before
    return found


def _accurate(orbit: AnyOrbit, options: Options) -> AnyOrbit:
    """The orbit to the tolerance, on a mesh that serves all the steps from it; as it is where that fails."""
    if orbit.error_estimate > options.tol:
        with suppress(NoOrbit):
            return refined(orbit, options)
    return orbit


def _located_from(
    before: AnyOrbit, after: AnyOrbit, monitor: Monitor, *, vary: str, options: Options
) -> AnyOrbit | None:
    """`locate` by steps from `before`; their length along its tangent is the unknown."""
    before = _accurate(before, options)
    start, end = ends(before, after, vary)
    length = _length_to(after, before, start, vary)
    f_near, f_far = monitor.value(before, start), monitor.value(after, end)
    if np.isnan(f_far):
        return None
    f_far = f_far or -np.copysign(np.inf, f_near)
    if not f_near * f_far < 0:  # refined, `before` has the sign of the other side: the point is next to it
        f_near = -np.copysign(np.inf, f_far)
    search = Search.within(Bracket(0.0, f_near, length, f_far))
    far = seen_from(start, before, vary, parameter_value(after, vary))
    start = replace(start, bend=bend(end, start, far, side=1.0))
    best: tuple[float, AnyOrbit] | None = None
    accepted = ACCEPTED_TOLERANCES * monitor.tolerance
    for _ in range(LOCATE_ROUNDS):
        if search.failures > MAX_FAILURES:
            break
        ds = search.ask()
        outcome = step_along(start, before, vary, ds, *before.problem.range_of(vary), options)
        if isinstance(outcome, str):
            search = search.failed()
            continue
        orbit = outcome[0]
        start = bent_through(start, ds, outcome[1], before.problem.distance(vary, parameter_value(orbit, vary)))
        f = monitor.value(orbit, curve_point(orbit, vary, like=start.row))
        if np.isfinite(f) and (best is None or abs(f) < abs(best[0])):
            best = (f, orbit)
        if abs(f) <= monitor.tolerance or search.bracket.width <= CLOSED * search.bracket.b:
            break
        last = min((abs(value) for _, value in search.seen), default=np.inf)
        search = search.told(ds, f)
        if abs(f) > last and max(abs(search.bracket.f_a), abs(search.bracket.f_b)) <= accepted:
            break  # a jump over zero, by the error of the orbits: their meshes change from one step to the next
    return best[1] if best and abs(best[0]) <= accepted else None


def _length_to(after: Orbit, before: Orbit, start: Point, vary: str) -> float:
    """Length along the tangent at `start`, the curve at `before`, to `after`."""
    return float(in_units_of(secant(before, after, vary), before.scale, start.setting.scale) @ start.row)


def _turning_point(slope: float, cubic: Array, least: float) -> float:
    """Where slope s + c_0 s^2 + c_1 s^3 has the extremum next to s = 0, not below `least`; nan where it has none."""
    roots = np.roots([3 * cubic[1], 2 * cubic[0], slope])
    real = roots.real[(abs(roots.imag) <= 1e-9 * abs(roots)) & (roots.real >= least)]
    return float(real[np.argmin(abs(real))]) if real.size else float("nan")


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
