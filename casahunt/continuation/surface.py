"""Orbits beside a special one, as a surface over two parameters, and the special points on it.

    s, m    arclength along the branch, r . (y - y_0), r its tangent at the orbit, y = (x_0, ln T_1, lambda);
            and c - c_0, c the place of the second parameter q in its range (`Axis`):
            c = (q - A)/(B - A), or (ln q - ln A)/(ln B - ln A) for a wide range between its ends A and B
    orbit   at (s, m): q is set and lambda free under the border row r, from the tangent plane  u_0 + s u_s + m u_m,
            G_u u_m + G_lambda lambda_m = -G_q,  r . y_m = 0
    phi     the monitor there, zero at special points; phi_s, phi_m by differences
    slope   d lambda/d m = lambda_m - lambda_s phi_m/phi_s along their curve, which plane_curve.py follows

A place where phi vanishes is confirmed before it is one: a fold as an extremum of the parameter on two meshes
(fold_check.py), a flip or a loss of symmetry by its multiplier -1, a torus by a complex pair on the unit circle.
Multipliers may jump where the phases of the cycle change, and its grazing contact is one of its phases: their curves
end there.  A fold stands for itself, whatever its phases; the slopes of two tell whether they are of one curve.

Error of the parameter: that of lambda along the branch, and what an error e of phi moves the place by along the branch,

    ds = e/|phi_s|,   no more than  ds = (e/|grad phi|)^(1/2)  where the curve turns back and phi_s vanishes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from typing import Any, Literal

import numpy as np

from ..collocation.transcription import settings_of
from ..errors import InputError, NoOrbit
from ..orbits.adapt import Options
from ..orbits.bordering import curve_border
from ..orbits.orbit import Orbit, orbit_of
from .bifurcations import COMPLEX, FLIP, NEIMARK_SACKER, SYMMETRY_LOST, pair_of
from .curve import CurvePoint, along, curve_point, in_units_of, predict
from .fold_check import confirmed
from .plane_curve import LOCATED, Evaluation
from .special_points import FOLD, Monitor, SpecialPoint
from .walk import corrected

Array = np.ndarray

WIDE_RANGE = 5.0
"""Ratio of the ends of a range from which on the points are spread over the logarithm of the parameter."""
LARGEST_CHANGE = 0.4
"""Relative change of the first parameter from one point to the next, at most."""
LARGEST_S = 0.3
"""Largest step along the branch."""
DIFFERENCE = 1e-3
"""Step of differences on the surface, as a part of the largest step in m, and in s."""
ASTRAY = 0.2
"""Largest departure of the change from the two slopes beside it, relative to its size."""
SLACK_OF_CHANGE = 1e-3
"""And this much of the parameter: where it hardly changes, neither do slopes tell."""
FINER = 0.03
"""Part of the tolerance to which the orbits are computed: the place of a special point on the branch takes a finer mesh
than parameter, period and amplitude of an orbit."""
NEXT_TO_CUSP = 1e-3
"""|phi_s| of a fold below which it is not an extremum that could be found."""
KINK = 1e-6
"""By how much the angles of a pair of multipliers at three places in a row are out of line where it has passed 0 or pi
between them [rad]."""
ENOUGH = 0.1
"""Part of the tolerance that may be left of a monitor: parameter, period and amplitude are off by about as much."""
CONFIRMED = 1e-5
"""How far from where it should be the multiplier of a special point may be, besides its estimated error."""


@dataclass(frozen=True)
class Axis:
    """The second parameter: its name and range, in which c is the place, from 0 to 1.

    Attributes
    ----------
    vary : name of the parameter.
    start, end : the range; where it is wide and above zero, c is spread over the logarithm.

    Examples
    --------
    >>> from casahunt.continuation import Axis
    >>> axis = Axis("stiffness", 1.0, 100.0)
    >>> axis.wide, round(axis.value(0.5), 6), round(axis.place(10.0), 6)
    (True, 10.0, 0.5)
    """

    vary: str
    start: float
    end: float

    @property
    def wide(self) -> bool:
        """Whether c is spread over the logarithm."""
        a, b = sorted((self.start, self.end))
        return a > 0 and b >= WIDE_RANGE * a

    def value(self, c: float) -> float:
        """q at c; the ends exactly."""
        if c in (0.0, 1.0):
            return self.end if c else self.start
        if self.wide:
            return float(self.start * (self.end / self.start) ** c)
        return self.start + c * (self.end - self.start)

    def place(self, q: float) -> float:
        """c at q; the ends exactly."""
        if q in (self.start, self.end):
            return float(q == self.end)
        if self.wide:
            return float(np.log(q / self.start) / np.log(self.end / self.start))
        return (q - self.start) / (self.end - self.start)

    def rate(self, c: float) -> float:
        """dq/dc."""
        return self.value(c) * float(np.log(self.end / self.start)) if self.wide else self.end - self.start


@dataclass(frozen=True, eq=False)
class SpecialOrbit:
    """A place of the curve.

    Attributes
    ----------
    orbit : the orbit there.
    error : estimated relative error of the first parameter, in its unit.
    slope : derivative of the first parameter by the second along the curve; infinite where it turns.
    across : phi_s; at a fold the second derivative of lambda along the branch: < 0 where the parameter is largest, > 0
        where it is smallest, 0 at a cusp.
    turns : whether the curve turns back in the second parameter here.
    how : "followed" step by step, or in a "batch" with others.

    Examples
    --------
    >>> from casahunt.continuation import Axis, largest, special_walk
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import Options, find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> walk = special_walk(largest(orbit, "g").orbit, "g", Axis("r", 0.8, 0.79), sense=1.0, options=Options())
    >>> first = next(walk)
    >>> first.how, first.turns, first.across < 0
    ('followed', False, True)
    """

    orbit: Any
    error: float
    slope: float
    across: float
    turns: bool = False
    how: Literal["followed", "batch"] = "followed"


@dataclass(frozen=True, eq=False)
class Sought:
    """What is the same all along a curve of special points.

    Attributes
    ----------
    monitor : vanishes on the curve.
    vary, axis : the first parameter, and the second one with its range.
    options : tolerance and method of the special points.
    spacing : largest step in c.
    reported : (orbit of the surface) -> that which a user gets, or a sentence about why it is no such point.
    """

    monitor: Monitor
    vary: str
    axis: Axis
    options: Options
    spacing: float
    reported: Callable[[Any], Any] = field(default=lambda orbit: orbit)


@dataclass(frozen=True, eq=False)
class Place:
    """An orbit of the surface, with coordinates (s, m) around it (plane_curve.py).

    Attributes
    ----------
    sought, orbit, position : what is followed, the orbit, and c there.
    point : the branch there, with its tangent.
    tilt, steepness : (size,) u_m, and lambda_m, along s = 0.
    gradient, special : (phi_s, phi_m), and the special point, where they are known.
    angle : of the pair of multipliers of a torus, in (0, pi), with its derivatives by s and m.
    """

    sought: Sought
    orbit: Any
    position: float
    point: CurvePoint = field(repr=False)
    tilt: Array = field(repr=False)
    steepness: float
    gradient: tuple[float, float] = (0.0, 0.0)
    special: SpecialOrbit | None = None
    angle: tuple[float, float, float] | None = None

    @property
    def reach(self) -> tuple[float, float]:
        """The largest steps in s and in m."""
        return LARGEST_S, min(self.sought.spacing, LARGEST_CHANGE / max(abs(self.steepness), 1e-9))

    def orbit_at(self, s: float, m: float) -> Any:
        """The orbit at a place, or a sentence that says why there is none."""
        began, vary, axis = time.perf_counter(), self.sought.vary, self.sought.axis
        here, t = self.orbit.problem, self.point.t
        try:
            posed = here.with_value(axis.vary, axis.value(self.position + m))
        except InputError as error:
            return str(error)
        posed = posed.with_value(vary, here.moved(vary, self.steepness * m))
        u, lam, _ = predict(self.point, s)
        u[: -t.phases] += m * self.tilt[: -t.phases]
        t.durations_of(u)[:] *= np.exp(np.clip(m * t.durations_of(self.tilt) / t.durations_of(self.point.u), -1, 1))
        setting = replace(self.point.setting, p=posed.vector(), dp=along(posed, vary))
        finely, ds = finer(self.sought.options), float(np.hypot(s, m))
        solved = corrected((t, u, setting), lam, posed, finely, ds=ds, border=self.point.row)
        if not solved.status.ok or solved.estimate is None:
            return solved.complaint()
        value = posed.moved(vary, lam, solved.solution.parameter)
        low, high = posed.range_of(vary)
        if not low < value < high:
            return f"the corrector came to {vary} = {value:.6g}, which cannot be"
        return orbit_of(solved, posed.with_value(vary, value), wall_s=time.perf_counter() - began)

    def value(self, s: float, m: float) -> Evaluation | str:
        """The monitor at a place with the orbit there, or a sentence that says why there is none."""
        sought, orbit = self.sought, self.orbit_at(s, m)
        if isinstance(orbit, str):
            return orbit
        if orbit.signature != self.orbit.signature and sought.monitor is not FOLD:
            return "the phases of the cycle change: it grazes an event, or one of them vanishes"
        value = sought.monitor.value(orbit, _point_at(orbit, sought.vary, self))
        near = max(LOCATED, ENOUGH * sought.options.tol)
        return Evaluation(value, orbit, near) if np.isfinite(value) else "its multipliers are not known well enough"

    def moved(self, s: float, m: float, reading: Evaluation) -> Place | str:
        """The special point that was read at a place, or a sentence that says why there is none."""
        there = place_of(self.sought, reading.data, self.position + m, self)
        if not self.agrees(there, s):
            return f"the corrector went to another {self.sought.monitor.kind}"
        found = there.confirmed(reading.value)
        return found if isinstance(found, str) else passes_resonance(self, found, s, m) or found

    def agrees(self, other: Place, s: float = 0.0) -> bool:
        """Whether the slopes here and at another place explain the change between them: the corrector may have gone to
        another part of the surface."""
        vary, m = self.sought.vary, other.position - self.position
        first, second = (
            at.orbit.problem.unit(vary) * (at.steepness * m + float(at.point.row[-1]) * s) for at in (self, other)
        )
        rise = other.orbit.problem.value(vary) - self.orbit.problem.value(vary)
        return explained(rise, first, second, self.orbit.problem.unit(vary))

    def sloped(self, value: float = 0.0) -> Place | str:
        """The place with the gradient of phi; `value`: phi here."""
        here, kind = Evaluation(value, self.orbit), self.sought.monitor.kind
        dm = DIFFERENCE * self.sought.spacing * (1 if self.position < 0.5 else -1)  # to the inside of the range
        reads: list[Evaluation] = []
        for s, m in ((DIFFERENCE, 0.0), (-DIFFERENCE, 0.0), (0.0, dm)):
            read = self.value(s, m)
            if isinstance(read, str):
                return read
            reads.append(read)
        # Of a fold nothing but the tangent needs phi_m; and beyond its range a parameter has no value.
        back = here if kind == FOLD.kind else self.value(0.0, -dm)
        back, width = (here, dm) if isinstance(back, str) or back is here else (back, 2 * dm)
        right, left, up, down = (read.value for read in (*reads, back))
        found = replace(self, gradient=((right - left) / (2 * DIFFERENCE), (up - down) / width))
        if kind == FOLD.kind:
            return found
        # In the slope, what another mesh does to lambda and to phi cancels: both are of the same orbits.
        vary, problem = self.sought.vary, self.orbit.problem
        change = reads[-1].data.problem.value(vary) - back.data.problem.value(vary)
        found = replace(found, steepness=change / problem.unit(vary) / width)
        if kind != NEIMARK_SACKER.kind:
            return found
        at, right, left, up, down = (abs(float(np.angle(pair_of(read.data)[0]))) for read in (here, *reads, back))
        if max(abs(right + left - 2 * at) - abs(right - left), abs(up + down - 2 * at) - abs(up - down)) > KINK:
            return f"the pair of multipliers meets at {_resonance(at > np.pi / 2)}"
        return replace(found, angle=(at, (right - left) / (2 * DIFFERENCE), (up - down) / width))

    def confirmed(self, value: float = 0.0) -> Place | str:
        """The place with its special point, or a sentence about why it is none; `value`: what is left of phi."""
        sought, orbit, vary = self.sought, self.orbit, self.sought.vary
        found = not_what_it_is_called(sought.monitor, orbit) or self.sloped(value)
        if isinstance(found, str):
            return found
        (phi_s, phi_m), lambda_s, slope = found.gradient, float(self.point.row[-1]), found.steepness
        if sought.monitor is not FOLD:  # whose parameter changes along the curve as it does along s = 0
            slope -= lambda_s * phi_m / phi_s if phi_s else np.inf
        slope *= orbit.problem.unit(vary) / sought.axis.rate(self.position)
        if sought.monitor is FOLD and abs(phi_s) > NEXT_TO_CUSP:
            sense = 1.0 if phi_s < 0 else -1.0
            try:
                fold = confirmed(SpecialPoint(FOLD.kind, orbit, ""), vary, sought.options, sense=sense)
            except NoOrbit as refusal:
                return str(refusal)
            return replace(found, special=SpecialOrbit(fold.orbit, fold.error_estimate, slope, phi_s))
        monitor = sought.monitor
        noise = abs(value) + (monitor.noise(orbit) if monitor.by_multipliers else monitor.tolerance)
        off = noise / max(abs(phi_s), float(np.sqrt(noise * np.hypot(phi_s, phi_m)))) if noise else 0.0
        error = max(orbit.parameter_error, orbit.error_estimate) + abs(lambda_s) * off
        shown = sought.reported(orbit)
        return shown if isinstance(shown, str) else replace(found, special=SpecialOrbit(shown, error, slope, phi_s))


def place_of(sought: Sought, orbit: Orbit, position: float, like: Place | None = None) -> Place:
    """The place of an orbit, c its position; `like`: the one in whose direction the branch is followed."""
    point = _point_at(orbit, sought.vary, like)
    t, u, setting = point.t, point.u, point.setting
    one, way = settings_of(setting, setting.p[None], setting.dp[None]), orbit.problem.direction(sought.axis.vary)
    lin = t.linearise(u[None], replace(one, others=sought.axis.rate(position) * way[None, None]))
    y = t.system.solve(lin.matrix(curve_border(t, u, point.row)[None]), lin.rhs(direction=1)[:, None])[:, 0]
    return Place(sought, orbit, position, point, lin.expand(y, 0.0, 1, 1.0)[0], float(y[0, -1]))


def _point_at(orbit: Orbit, vary: str, like: Place | None) -> CurvePoint:
    """The branch at an orbit, oriented as at another."""
    row = None if like is None else in_units_of(like.point.row, like.point.setting.scale, orbit.scale)
    return curve_point(orbit, vary, like=row)


def explained(rise: float, first: float, second: float, unit: float) -> bool:
    """Whether the slopes at both ends of a step, each times its length, explain how a parameter has changed over it."""
    least = ASTRAY * max(abs(rise), abs(first), abs(second)) + SLACK_OF_CHANGE * abs(unit)
    return bool(abs(rise - (first + second) / 2) <= least)


def finer(options: Options) -> Options:
    """Options of the orbits on a surface, from those of the special points on it."""
    return options.finer(FINER)


def not_what_it_is_called(monitor: Monitor, orbit: Orbit) -> str:
    """What speaks against a place where a monitor of multipliers vanishes.

    monitor, orbit: the monitor and the orbit at which it vanishes.
    Returns A sentence, or "" where it is what it is called, or has no multipliers to tell.
    """
    if monitor.kind not in (FLIP.kind, SYMMETRY_LOST.kind, NEIMARK_SACKER.kind):
        return ""
    multipliers = orbit.multipliers
    if not multipliers.trusted:
        return f"the multipliers are not known well enough: their error is {multipliers.error:.2g}"
    mu = multipliers.half[1:]
    slack = CONFIRMED + 10 * multipliers.error
    if monitor.kind != NEIMARK_SACKER.kind:
        off = float(np.min(np.abs(mu + 1), initial=np.inf))
        return "" if off <= slack else f"no multiplier is -1: the nearest is off by {off:.2g}"
    a, b = pair_of(orbit)
    if abs(a * b - 1) > 2 * slack:
        return "no pair of multipliers lies on the unit circle"
    if abs(a.imag) > COMPLEX:
        return ""
    return f"the pair of multipliers becomes real at {_resonance(a.real < 0)}, and no torus branches off beyond"


def passes_resonance(here: Place, there: Place, s: float, m: float) -> str:
    """Whether the pair of multipliers of a torus meets at -1 or +1 between two points of its curve.

    Returns A sentence, or "".  The angle of the pair comes back from 0 or pi, where it would have gone beyond.
    """
    if here.angle is None or there.angle is None:
        return ""
    angle, first = here.angle[0], here.angle[1] * s + here.angle[2] * m
    second = there.angle[1] * s + there.angle[2] * m
    left = np.pi - angle if first > 0 else angle
    if first * second < 0 and abs(first) + abs(second) > left:
        return f"the pair of multipliers meets at {_resonance(first > 0)}"
    return ""


def _resonance(turned: bool) -> str:
    return "-1: a 1:2 resonance" if turned else "+1: a 1:1 resonance"
