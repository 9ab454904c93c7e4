"""The surface of orbits beside a fold, as continuation/plane_curve.py wants it.

    s   arclength along the branch:  r . (y - y_0),  r the tangent of the branch at the fold, y = (x_0, ln T_1, lambda)
    c   the place of q in its range (points.py)
    phi(s, c) = d lambda/d s                 the parameter component of the unit tangent at the orbit (s, c)

Every value of phi is one corrected orbit with its error estimate: q is set, K = K_fold (1 + lambda) is free under the
border row r.

Every fold is checked against the optimisation problem (continuation/fold.py) - the largest gain nearby, or the
smallest where phi_s > 0 - whose multipliers give the exact slope dK/dq (sensitivity.py).  Within `NEXT_TO_CUSP` of a
cusp there is no extremum to be found; the slope is taken from the gain of the orbits beside the fold, d lambda/d c at s
= 0.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, field, replace

import numpy as np

from ...continuation.curve import Point, curve_point, in_units_of, predict
from ...continuation.fold import confirmed, confirmed_smallest
from ...continuation.plane_curve import Reading
from ...continuation.special_points import FOLD, SpecialPoint
from ...continuation.walk import corrected
from ...errors import InputError, NoOrbit
from ...orbits.adapt import TOLERANCE_RANGE, Options
from ...orbits.orbit import orbit_of, unknowns_of
from ...servo.hunting import Model
from ...servo.problem import Hunting, HuntingFold, HuntingOrbit
from ...servo.servo import Servo
from ..sensitivity import fold_sensitivities
from .points import Array, Axis, FoldPoint

LARGEST_CHANGE = 0.4
"""Relative change of the gain from one point to the next, at most."""
LARGEST_S = 0.3
"""Largest step along the branch."""
DIFFERENCE = 1e-3
"""Step of the differences of phi, as a part of the largest step in c, and in s."""
FINER = 0.03
"""Part of the tolerance to which the orbits are computed: the place of a fold on the branch takes a finer mesh than
gain, period and amplitude of an orbit."""
NEXT_TO_CUSP = 1e-3
"""|phi_s| below which a fold is not an extremum that could be found."""
ASTRAY = 0.2
"""Largest departure of the gain from the two slopes beside it, relative to its change."""


@dataclass(frozen=True, eq=False)
class Problem:
    """What all charts share."""

    model: Model
    servo: Servo
    axis: Axis
    options: Options
    spacing: float

    @property
    def finer(self) -> Options:
        """Options of the orbits on the surface."""
        return replace(self.options, tol=max(FINER * self.options.tol, TOLERANCE_RANGE[0]))


@dataclass(frozen=True, eq=False)
class Chart:
    """Coordinates (s, m) around a fold (plane_curve.Chart)."""

    problem: Problem
    orbit: HuntingOrbit
    point: Point
    position: float
    steepness: float = 0.0
    """d ln K/dc."""
    tilt: Array | None = field(default=None, repr=False)
    """(size,) derivative of u by c at s = 0 and along the fold gain; durations by their logarithms."""
    gradient: tuple[float, float] = (0.0, 0.0)
    fold: FoldPoint | None = None

    @property
    def reach(self) -> tuple[float, float]:
        """The largest steps in s and in m."""
        return LARGEST_S, min(self.problem.spacing, LARGEST_CHANGE / max(abs(self.steepness), 1e-9))

    def value(self, s: float, m: float) -> Reading | str:
        """Read phi at a place of the surface.

        Parameters
        ----------
        s
            arclength from the fold, along the branch.
        m
            place of q from that of the fold.

        Returns
        -------
        phi and the orbit there, or a sentence that says why there is none.
        """
        began = time.perf_counter()
        problem, t = self.problem, self.point.t
        q = problem.axis.value(self.position + m)
        gain = self.orbit.gain * float(np.exp(np.clip(self.steepness * m, -1.0, 1.0)))
        try:
            servo = problem.servo.replace(**{problem.axis.vary: q})
        except InputError as error:
            return str(error)
        u, _ = predict(self.point, s)
        if self.tilt is not None:
            u[: -t.phases] += m * self.tilt[: -t.phases]
            t.durations_of(u)[:] *= np.exp(np.clip(m * self.tilt[-t.phases :], -1.0, 1.0))
        posed = Hunting(problem.model, servo, gain)
        setting = replace(self.point.setting, p=posed.vector(), dp=posed.direction("gain") * gain)
        ds = float(np.hypot(s, m))
        solved = corrected(
            replace(self.point, setting=setting), u, 0.0, posed, problem.finer, ds=ds, border=self.point.row
        )
        if not solved.status.ok or solved.estimate is None:
            return solved.complaint()
        gain *= 1 + solved.solution.parameter
        if not gain > 0:
            return "the corrector came to a gain below zero"
        orbit = orbit_of(solved, posed.with_value("gain", gain), wall_s=time.perf_counter() - began)
        like = in_units_of(self.point.row, self.point.setting.scale, orbit.scale)
        return Reading(float(curve_point(orbit, "gain", like=like).row[-1]), orbit)

    def moved(self, s: float, m: float, reading: Reading) -> Chart | str:
        """The chart of the fold that was read at a place of the surface.

        Parameters
        ----------
        s, m
            the place, as in `value`.
        reading
            what was read there.

        Returns
        -------
        Chart, or a sentence that says why there is none.
        """
        chart: Chart | str = chart_of(self.problem, reading.data, self.position + m, like=self)
        if isinstance(chart, str):
            return chart
        return chart if self.agrees(chart) else "the corrector went to another fold"

    def agrees(self, other: Chart) -> bool:
        """Whether the slopes here and there explain the change of the gain: another fold would bend the curve."""
        rise = float(np.log(other.orbit.gain / self.orbit.gain))
        m = other.position - self.position
        first, second = self.steepness * m, other.steepness * m
        return abs(rise - (first + second) / 2) <= ASTRAY * max(abs(rise), abs(first), abs(second)) + 1e-3


def chart_of(problem: Problem, orbit: HuntingOrbit, position: float, *, like: Chart | None) -> Chart | str:
    """The chart of a fold, with slope, gradient and tilt.

    Parameters
    ----------
    problem
        the curve that is asked for.
    orbit
        at the fold.
    position
        place of the second parameter in its range.
    like
        chart before this one, in whose direction the branch is followed.

    Returns
    -------
    Chart, or a sentence that says why there is none.
    """
    row = None if like is None else in_units_of(like.point.row, like.point.setting.scale, orbit.scale)
    bare = Chart(problem, orbit, curve_point(orbit, "gain", like=row), position)
    beside = [bare.value(sign * DIFFERENCE, 0.0) for sign in (1, -1)]
    if isinstance(beside[0], str):
        return beside[0]
    if isinstance(beside[1], str):
        return beside[1]
    phi_s = (beside[0].value - beside[1].value) / (2 * DIFFERENCE)
    # Inwards, where the parameter has its range; K may be steep.
    m = DIFFERENCE * problem.spacing * (1 if position < 0.5 else -1)
    name = problem.axis.vary
    slope: float | None = None
    error = max(orbit.parameter_error, orbit.error_estimate)
    if abs(phi_s) > NEXT_TO_CUSP:
        try:
            fold = _extremum(orbit, phi_s < 0, problem.options)
        except NoOrbit as complaint:
            return str(complaint)
        slope, error = fold_sensitivities(fold).derivatives[name], fold.error_estimate
        orbit = fold.orbit
    rate = problem.axis.rate(position)
    bare = replace(bare, steepness=0.0 if slope is None else slope * rate / orbit.gain)
    ahead = bare.value(0.0, m)
    if isinstance(ahead, str):
        return ahead
    if slope is None:  # d lambda/d s vanishes: the gain beside the fold, at s = 0, has the slope of the curve
        steepness = float(np.log(ahead.data.gain / orbit.gain)) / m
        slope = steepness * orbit.gain / rate
        bare = replace(bare, steepness=steepness)
    found = FoldPoint(problem.axis.value(position), orbit.gain, slope, orbit, error, phi_s, orbit.status)
    gradient = (phi_s, ahead.value / m)
    return replace(bare, tilt=_tilt(bare, ahead.data, m), gradient=gradient, fold=found)


def _tilt(chart: Chart, ahead: HuntingOrbit, m: float) -> Array | None:
    """(size,) change of u by c from an orbit beside the fold; None where mesh or phases are others."""
    t, u, setting = chart.point.t, chart.point.u, chart.point.setting
    other, v, its = unknowns_of(ahead)
    if other != t or not np.array_equal(its.fractions, setting.fractions):
        return None
    factor = its.scale / setting.scale
    v = v.copy()
    durations = np.log(t.durations_of(v) / t.durations_of(u)) / m
    nodes = t.nodes_of(v) * factor
    t.intervals_of(v)[:] *= np.tile(factor, t.degree + 1)
    v[t.node_index] = nodes
    tilt = (v - u) / m
    t.durations_of(tilt)[:] = durations
    return tilt


def _extremum(orbit: HuntingOrbit, largest: bool, options: Options) -> HuntingFold:
    """A located fold, checked against the optimisation problem: the largest gain nearby, or the smallest."""
    return (confirmed if largest else confirmed_smallest)(SpecialPoint(FOLD.kind, orbit, ""), "gain", options)
