"""Orbits beside a special one, as a surface over two parameters.

    s    arclength along the branch:  r . (y - y_0),  r its tangent at the orbit, y = (x_0, ln T_1, lambda)
    m    c - c_0, c the place of the second parameter q in its range (`Axis`):
         c = (q - A)/(B - A), or (ln q - ln A)/(ln B - ln A) for a wide range between its ends A and B

Every place (s, m) is one corrected orbit with its error estimate: q is set, the first parameter is free under the
border row r.  A parameter that is moved relative to its value stays above zero and is reckoned by its logarithm.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from ..errors import InputError
from ..hybrid.problem import Problem
from ..orbits.adapt import Options
from ..orbits.orbit import Orbit, orbit_of, unknowns_of
from .curve import CurvePoint, along, curve_point, in_units_of, parameter_value, predict
from .walk import corrected

Array = np.ndarray

WIDE_RANGE = 5.0
"""Ratio of the ends of a range from which on the points are spread over the logarithm of the parameter."""
LARGEST_CHANGE = 0.4
"""Growth of the first parameter from one point to the next, at most."""
LARGEST_S = 0.3
"""Largest step along the branch."""
DIFFERENCE = 1e-3
"""Step of differences on the surface, as a part of the largest step in m, and in s."""
ASTRAY = 0.2
"""Largest departure of the growth from the two slopes beside it, relative to its size."""
SLACK_OF_GROWTH = 1e-3
"""And this much, absolute: where nothing grows, differences of steps of `DIFFERENCE` are all that the slopes show."""
FINER = 0.03
"""Part of the tolerance to which the orbits are computed: the place of a special point on the branch takes a finer mesh
than parameter, period and amplitude of an orbit."""
NEXT_TO_CUSP = 1e-3
"""|phi_s| of a fold below which it is not an extremum that could be found."""


def finer(options: Options) -> Options:
    """Options of the orbits on a sheet, from those of the special points on it."""
    return options.finer(FINER)


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


def _relative(problem: Problem, vary: str) -> bool:
    """Whether a parameter is moved relative to its value, which is above zero."""
    return problem.range_of(vary)[0] >= 0


def grown(problem: Problem, vary: str, much: float) -> float:
    """The value of a parameter after a `relative_distance`.

    problem, vary, much: the problem, the name of the parameter, the growth.
    """
    if _relative(problem, vary):
        return problem.value(vary) * float(np.exp(np.clip(much, -1.0, 1.0)))
    return problem.moved(vary, float(np.clip(much, -1.0, 1.0)))


@dataclass(frozen=True, eq=False)
class Sheet:
    """The orbits beside one.

    Attributes
    ----------
    orbit, vary : the orbit and the name of the first parameter.
    axis, position : the second parameter, and c at the orbit.
    options : tolerance and method of the orbits.
    spacing : largest step in m.
    point : the branch at the orbit, with its tangent.
    steepness : growth of the first parameter by m along s = 0, as far as known.
    tilt : (size,) derivative of u by m there; durations by their logarithms.
    """

    orbit: Any
    vary: str
    axis: Axis
    position: float
    options: Options
    spacing: float
    point: CurvePoint
    steepness: float = 0.0
    tilt: Array | None = field(default=None, repr=False)

    @property
    def reach(self) -> tuple[float, float]:
        """The largest steps in s and in m."""
        return LARGEST_S, min(self.spacing, LARGEST_CHANGE / max(abs(self.steepness), 1e-9))

    @property
    def inwards(self) -> float:
        """A small step in m, towards the inside of the range."""
        return DIFFERENCE * self.spacing * (1 if self.position < 0.5 else -1)

    def orbit_at(self, s: float, m: float) -> Any:
        """The orbit at a place.

        m: place of the second parameter from that of the orbit here.
        Returns Orbit, or a sentence that says why there is none.
        """
        began = time.perf_counter()
        here, t = self.orbit.problem, self.point.t
        try:
            posed = here.with_value(self.axis.vary, self.axis.value(self.position + m))
        except InputError as error:
            return str(error)
        posed = posed.with_value(self.vary, grown(here, self.vary, self.steepness * m))
        u, lam, _ = predict(self.point, s)
        if self.tilt is not None:
            u[: -t.phases] += m * self.tilt[: -t.phases]
            t.durations_of(u)[:] *= np.exp(np.clip(m * self.tilt[-t.phases :], -1.0, 1.0))
        setting = replace(self.point.setting, p=posed.vector(), dp=along(posed, self.vary))
        ds = float(np.hypot(s, m))
        solved = corrected((t, u, setting), lam, posed, self.options, ds=ds, border=self.point.row)
        if not solved.status.ok or solved.estimate is None:
            return solved.complaint()
        value = posed.moved(self.vary, lam, solved.solution.parameter)
        low, high = posed.range_of(self.vary)
        if not low < value < high:
            return f"the corrector came to {self.vary} = {value:.6g}, which cannot be"
        return orbit_of(solved, posed.with_value(self.vary, value), wall_s=time.perf_counter() - began)

    def point_of(self, orbit: Orbit) -> CurvePoint:
        """The branch at an orbit of the sheet, oriented as here."""
        return curve_point(orbit, self.vary, like=in_units_of(self.point.row, self.point.setting.scale, orbit.scale))

    def growth_to(self, orbit: Orbit) -> float:
        """The growth of the first parameter from here to an orbit."""
        # How far another value of a parameter lies from the problem's own
        value = parameter_value(orbit, self.vary)
        if _relative(self.orbit.problem, self.vary):
            return float(np.log(value / self.orbit.problem.value(self.vary)))
        return self.orbit.problem.distance(self.vary, value)

    def tilted(self, ahead: Orbit, m: float) -> Sheet:
        """The sheet that knows an orbit at (0, m): with its tilt, where mesh and phases are the same."""
        t, u, setting = self.point.t, self.point.u, self.point.setting
        other, v, its = unknowns_of(ahead)
        if other != t or not np.array_equal(its.fractions, setting.fractions):
            return replace(self, tilt=None)
        factor = its.scale / setting.scale
        v = v.copy()
        durations = np.log(t.durations_of(v) / t.durations_of(u)) / m
        nodes = t.nodes_of(v) * factor
        t.intervals_of(v)[:] *= np.tile(factor, t.degree + 1)
        v[t.node_index] = nodes
        tilt = (v - u) / m
        t.durations_of(tilt)[:] = durations
        return replace(self, tilt=tilt)

    def agrees(self, other: Sheet, s: float = 0.0) -> bool:
        """Whether the slopes here and at another orbit explain the growth between them.

        Returns False where the corrector went to another part of the surface.
        """
        rise, m = self.growth_to(other.orbit), other.position - self.position
        unit = 1.0
        if not _relative(self.orbit.problem, self.vary):
            unit = other.orbit.problem.unit(self.vary) / self.orbit.problem.unit(self.vary)
        first = self.steepness * m + self.point.row[-1] * s
        second = unit * (other.steepness * m + other.point.row[-1] * s)
        return explained(rise, first, second)


def explained(rise: float, first: float, second: float) -> bool:
    """Whether the slopes at both ends of a step, each times its length, explain what has been gained over it."""
    least = ASTRAY * max(abs(rise), abs(first), abs(second)) + SLACK_OF_GROWTH
    return bool(abs(rise - (first + second) / 2) <= least)


def sheet_of(
    orbit: Orbit, vary: str, axis: Axis, position: float, *, options: Options, spacing: float, like: Sheet | None
) -> Sheet:
    """The sheet around an orbit; neither steepness nor tilt are known yet.

    axis, position: the second one, and c at the orbit; options, spacing: tolerance and method of the orbits; largest
    step in m; like: sheet in whose direction the branch is followed.
    """
    point = curve_point(orbit, vary) if like is None else like.point_of(orbit)
    return Sheet(orbit, vary, axis, position, options, spacing, point)
