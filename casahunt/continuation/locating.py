"""The orbit between two of a branch at which a monitor vanishes (special_points.py).

    f(s) = 0    by inverse interpolation between true corrections, s the arclength from the orbit that is closer
    fold        the turning point of the cubic between the orbits -> the extremum next to it
    (collocation/newton.py), on
                meshes adapted to the tolerance (orbits/adapt.py)
    branch point    lambda(f) at f = 0 of the polynomial through orbits on both sides, |f| being 2e-3 to 6e-3

Where two branches cross the equations are singular whatever row is added to them, and an orbit at a distance d is known
to rounding / d: the orbits on both sides are not, and a multiplier goes on smoothly through the point.

    error       (|f| + error of f) / |df/dlambda|, or what the polynomial differs by without one of its orbits

The parameter value of a fold is second order in the place on the curve: it comes out to rounding.  No orbit on the way
to one is adapted or estimated; where Newton's method does not lead there, steps along the branch do.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Generic, NamedTuple

import numpy as np

from ..errors import NoOrbit
from ..hybrid.problem import Problem
from ..orbits.adapt import Options, refined
from ..orbits.bordering import row_along
from ..orbits.orbit import AnyOrbit, Orbit
from ..orbits.restart import Start
from ..roots import CLOSED, Bracket, Search
from .curve import (
    CurvePoint,
    along,
    backwards,
    bend,
    bent_through,
    curve_point,
    ends,
    in_units_of,
    parameter_value,
    predict,
    secant_direction,
    seen_from,
    solved_along,
)
from .special_points import ACCEPTED_TOLERANCES, FOLD, Monitor
from .walk import step_along, walk

Array = np.ndarray

BEYOND = 0.1
"""Part of the way between two orbits by which a turning point between them may lie beyond either."""
LOCATE_ROUNDS = 40
"""Four, as a rule; so many halvings leave 1e-12 of the way at a jump."""
MAX_FAILURES = 8
"""Places in a row that fail, each 2 % of the bracket farther from where the root is expected: 16 % to either side."""
NEAR_CROSSING, FROM_CROSSING = 1e-2, (2e-3, 4e-4)
"""A branch point is seen from this value of its monitor on, and located by orbits at one to three times these: at less
rounding tells, at more the polynomial through them is off."""
NODES, LEAST_NODES = (-3, -2, -1, 1, 2, 3), 5
NEXT_TO_CROSSING = 1e-5
"""The orbit that is shown lies so far from it."""
IN_PLACE = 1e-12
"""A multiplier is brought to its place to this, or to its error where that is larger."""
SLOPE_BY = 10.0
"""Values tell the slope of a monitor that differ by so many times what is not known of them."""
RUNS_THROUGH = 0.5
"""What runs through so much to either side of zero within the error of an orbit is no place on a branch."""
FIRST_PART, STEPS_NEARER = 0.25, 30
"""First step of a walk from one orbit to the other, as a part of the way; how many it makes."""


def turned_orbit(problem: Problem, start: Start, vary: str, options: Options, bent: float) -> Any:
    """The orbit where a parameter is extremal, next to a point of the curve.

    problem, start: the problem at the parameters of the setting; transcription, unknowns, setting; bent: second
    derivative of lambda along the curve, about, with its sign; infinite where only that is known. Returns Orbit, of the
    class that the problem names; None where Newton's method does not lead to one.
    """
    t, u, setting = start
    setting = replace(setting, dp=along(problem, vary))
    row = row_along(t, u, setting)
    if not np.isfinite(row).all():
        return None
    found = solved_along(problem, (t, u, setting), vary, row, options, bend=bent, soft=False)
    return None if isinstance(found, str) else found


def turned_between(before: AnyOrbit, after: AnyOrbit, vary: str, options: Options) -> AnyOrbit | None:
    """The orbit where a parameter turns between two orbits of a walk.

    before, after: the orbits, in the order of the walk. Returns the orbit; None where Newton's method does not lead
    from the turning point of the cubic between them to one that lies between them too.
    """
    return _between(*ends(before, after, vary), before, vary, options)


def _between(here: CurvePoint, there: CurvePoint, orbit: AnyOrbit, vary: str, options: Options) -> AnyOrbit | None:
    """The orbit at the turning point between two points of the curve of `orbit`, from the first to the second."""
    if abs(there.row[-1]) < abs(here.row[-1]):
        here, there = backwards(there), backwards(here)
    value = _value(there, orbit, vary)
    problem = orbit.problem.with_value(vary, _value(here, orbit, vary))
    first = there.t.nodes_of(there.u)[0] * there.setting.scale / here.setting.scale
    ahead = _ahead(here, first, float(there.t.durations_of(there.u)[0]), problem.distance(vary, value))
    row = ahead / float(ahead @ here.row)  # the way between them: their tangents may differ by a right angle
    cubic = bend(there, here, seen_from(here, orbit, vary, value), side=1.0, row=row)
    ds, bent = (np.nan, np.nan) if cubic is None else _top(here.row[-1], cubic.coefficients[:, -1])
    if not 0 <= ds <= float(ahead @ row):
        return None
    u, lam, setting = predict(replace(here, row=row, bend=cubic), ds)
    start = here.t, u, setting.moved(lam)
    found = turned_orbit(problem.with_value(vary, problem.moved(vary, lam)), start, vary, options, bent)
    if found is None:
        return None
    arc, lam = found.arcs[0], problem.distance(vary, found.problem.value(vary))
    first = arc.states[0, 0] / here.setting.scale
    part = _ahead(here, first, arc.duration, lam) @ row / (ahead @ row)
    return found if -BEYOND <= part <= 1 + BEYOND else None


def _top(slope: float, cubic: Array) -> tuple[float, float]:
    """(s, second derivative) where slope s + c_0 s^2 + c_1 s^3, lambda or its logarithm, turns; NaN: nowhere.

    The first turn on the way, which bends against the slope there.
    """
    s = np.roots([3 * cubic[1], 2 * cubic[0], slope])
    s = s.real[abs(s.imag) <= 1e-9 * abs(s)]
    bent = 2 * cubic[0] + 6 * cubic[1] * s
    best = np.flatnonzero(bent * slope < 0)
    return (float(s[best[0]]), float(bent[best[0]])) if best.size else (np.nan, np.nan)


def _ahead(point: CurvePoint, first: Array, duration: float, lam: float) -> Array:
    """(n + 2,) the way from a point to another first node, scaled as there, first duration and lambda."""
    t, u = point.t, point.u
    longer = np.log(duration / t.durations_of(u)[0])
    return np.concatenate([first - t.nodes_of(u)[0], [longer, lam]])


def _value(point: CurvePoint, orbit: Orbit, vary: str) -> float:
    """The parameter at a point of the curve of an orbit."""
    return float(point.setting.p[orbit.problem.names.index(vary)])


class Located(NamedTuple, Generic[AnyOrbit]):
    """A special point: an orbit there or, where `at` is given, one next to it; the parameter, and its error."""

    orbit: AnyOrbit
    error: float
    at: float | None = None


class _TooSteep(Exception):
    """A multiplier runs past its place within the error of the orbits, as in a canard: no other step shows it."""


def locate_special_point(
    before: AnyOrbit, after: AnyOrbit, monitor: Monitor, *, vary: str, options: Options
) -> Located[AnyOrbit] | None:
    """The orbit between two at which a monitor vanishes.

    Steps start at the orbit where it is smaller, which is as a rule the closer one, along its tangent; where they fail,
    at the other.

    before, after: the orbits, in the order of the walk. Returns the orbit; None where the steps there do not converge.
    """
    found = turned_between(before, after, vary, options) if monitor.kind == FOLD.kind else None
    if found is not None:
        return Located(found, 0.0)
    start, end = ends(before, after, vary)
    if abs(monitor.value(after, end)) < abs(monitor.value(before, start)):
        before, after = after, before
    try:
        located = _located_from(before, after, monitor, vary=vary, options=options)
        located = located or _located_from(after, before, monitor, vary=vary, options=options)
        return located or _located_nearer(before, after, monitor, vary=vary, options=options)
    except _TooSteep:
        return None


def _located_nearer(
    before: AnyOrbit, after: AnyOrbit, monitor: Monitor, *, vary: str, options: Options
) -> Located[AnyOrbit] | None:
    """`locate_special_point` where no step from either leads there: a walk with shorter ones does, as the curve
    bends."""
    last, value = before, monitor.value(before, ends(before, after, vary)[0])
    for orbit in nearer(before, after, vary, options):
        f = monitor.value(orbit, ends(last, orbit, vary)[1])
        if f * value < 0:
            return _located_from(last, orbit, monitor, vary=vary, options=options)
        last, value = orbit, f
    return None


def nearer(before: AnyOrbit, after: AnyOrbit, vary: str, options: Options) -> Iterator[AnyOrbit]:
    """The orbits of a walk from one orbit towards another of its branch, in shorter steps, as far as one leads."""
    way, (low, high) = secant_direction(before, after, vary), before.problem.range_of(vary)
    first = FIRST_PART * float(np.linalg.norm(way))
    with suppress(NoOrbit):
        yield from walk(
            before, vary=vary, low=low, high=high, heading=way, options=options, first_step=first,
            max_points=STEPS_NEARER,
        )  # fmt: skip


def _accurate(orbit: AnyOrbit, options: Options) -> AnyOrbit:
    """The orbit to the tolerance, on a mesh that serves all the steps from it; as it is where that fails."""
    if orbit.error_estimate > options.tol:
        with suppress(NoOrbit):
            return refined(orbit, options)
    return orbit


@dataclass
class _Line(Generic[AnyOrbit]):
    """Orbits at lengths along the tangent of the first of two, and a monitor there.

    Attributes
    ----------
    start : the curve at `before`, its predictor passing through what was found last.
    seen : (length, value of the monitor, orbit) of those that were found.
    """

    before: AnyOrbit
    after: AnyOrbit
    start: CurvePoint
    monitor: Monitor
    vary: str
    options: Options
    seen: list[tuple[float, float, AnyOrbit]]

    def value(self, ds: float) -> float:
        """The monitor at a length; NaN where no step leads there."""
        bounds = self.before.problem.range_of(self.vary)
        outcome = step_along(self.start, self.before, self.vary, ds, *bounds, self.options)
        if isinstance(outcome, str):
            return math.nan
        orbit = outcome[0]
        self.start = bent_through(self.start, ds, outcome[1], self.lam(orbit))
        f = self.monitor.value(orbit, curve_point(orbit, self.vary, like=self.start.row))
        if np.isfinite(f):
            self.seen.append((ds, f, orbit))
        return f

    def lam(self, orbit: AnyOrbit) -> float:
        """How far the parameter of an orbit is from that of the first, in its unit."""
        return self.before.problem.distance(self.vary, parameter_value(orbit, self.vary))

    @property
    def nearest(self) -> tuple[float, float, AnyOrbit]:
        """What was seen with the smallest value."""
        return min(self.seen, key=lambda one: abs(one[1]))

    def located(self) -> Located[AnyOrbit] | None:
        """The orbit that is nearest to the point; None where the monitor does not vanish there."""
        if not self.seen or abs(self.nearest[1]) > ACCEPTED_TOLERANCES * self.monitor.tolerance:
            return None
        _, f, orbit = self.nearest
        off = abs(f) + self.monitor.noise(orbit)
        others = [(g, o) for _, g, o in self.seen if abs(g - f) > SLOPE_BY * off]
        if not others:
            others = [(self.monitor.value(o, curve_point(o, self.vary)), o) for o in (self.before, self.after)]
        g, lam = min(((g, self.lam(o)) for g, o in others), key=lambda one: abs(one[0] - f))
        part = min(off / abs(g - f), 1.0) if g != f else 1.0  # it lies in the step, however little is known
        return Located(orbit, part * abs(lam - self.lam(orbit)))


def _located_from(
    before: AnyOrbit, after: AnyOrbit, monitor: Monitor, *, vary: str, options: Options
) -> Located[AnyOrbit] | None:
    """`locate_special_point` by steps from `before`; their length along its tangent is the unknown."""
    before = _accurate(before, options)
    start, end = ends(before, after, vary)
    length = length_to(after, before, start, vary)
    f_near, f_far = monitor.value(before, start), monitor.value(after, end)
    if np.isnan(f_far):
        return None
    f_far = f_far or -np.copysign(np.inf, f_near)
    if not f_near * f_far < 0:  # refined, `before` has the sign of the other side: the point is next to it
        f_near = -np.copysign(np.inf, f_far)
    search = Search.within(Bracket(0.0, f_near, length, f_far))
    far = seen_from(start, before, vary, parameter_value(after, vary))
    line = _Line(before, after, replace(start, bend=bend(end, start, far, side=1.0)), monitor, vary, options, [])
    accepted = ACCEPTED_TOLERANCES * monitor.tolerance
    for _ in range(LOCATE_ROUNDS):
        if search.failures > MAX_FAILURES:
            break
        ds = search.ask()
        f = line.value(ds)
        if abs(f) <= NEAR_CROSSING and monitor.by_multipliers and monitor.multiplier == 1 and search.seen:
            s, g = min(search.seen, key=lambda one: abs(one[1]))
            return _beside(line, ds - f * (s - ds) / (g - f), (g - f) / (s - ds))
        enough = max(IN_PLACE, monitor.noise(line.nearest[2])) if monitor.by_multipliers and line.seen else np.inf
        if abs(f) <= min(monitor.tolerance, enough) or search.bracket.width <= CLOSED * search.bracket.b:
            break
        last = min((abs(value) for _, value in search.seen), default=np.inf)
        search = search.told(ds, f)
        steep = min(abs(search.bracket.f_a), abs(search.bracket.f_b)) > RUNS_THROUGH
        if monitor.by_multipliers and steep and search.bracket.width <= before.error_estimate:
            raise _TooSteep
        if abs(f) > last and max(abs(search.bracket.f_a), abs(search.bracket.f_b)) <= accepted:
            break  # a jump over zero, by the error of the orbits: their meshes change from one step to the next
    return line.located()


def _beside(line: _Line[AnyOrbit], place: float, slope: float) -> Located[AnyOrbit] | None:
    """The branch point on a line, by orbits on both sides of it.

    place, slope: length at which it lies, about, and derivative of the monitor there.
    """
    accepted, problem = ACCEPTED_TOLERANCES * line.monitor.tolerance, line.before.problem
    for beside in FROM_CROSSING:
        line.seen = []
        for k in NODES:
            line.value(place + k * beside / slope)
        if len(line.seen) < LEAST_NODES:
            continue
        s, f = np.array([one[:2] for one in line.seen]).T
        lam, every = np.array([line.lam(orbit) for *_, orbit in line.seen]), np.arange(f.size)
        at = at_zero(f, lam)
        noise = max(line.monitor.noise(orbit) for *_, orbit in line.seen) * float(np.ptp(lam) / np.ptp(f))
        error = noise + max(abs(at_zero(f[every != k], lam[every != k]) - at) for k in every)
        place, slope = at_zero(f, s), np.ptp(f) / np.ptp(s) * np.sign(slope)
        if error * np.ptp(f) <= accepted * np.ptp(lam) and f.min() < 0 < f.max():
            line.value(place + NEXT_TO_CROSSING / slope)
            near = [one for one in line.seen if abs(one[1]) > NEXT_TO_CROSSING / 2]  # else it has gone to the other
            return Located(min(near, key=lambda one: abs(one[1]))[2], error, problem.moved(line.vary, at))
    return None


def at_zero(f: Array, x: Array) -> Any:
    """x at f = 0 of the polynomial x(f) through points: (m,) or (m, ...)."""
    weights = [np.prod(np.delete(f, k) / (np.delete(f, k) - f[k])) for k in range(f.size)]
    return np.dot(weights, x)


def length_to(after: Orbit, before: Orbit, start: CurvePoint, vary: str) -> float:
    """How far one orbit is from another.

    after, before, start, vary: the orbits, the curve at the second, and the name of the parameter.
    Returns the length along the tangent there.
    """
    return float(in_units_of(secant_direction(before, after, vary), before.scale, start.setting.scale) @ start.row)
