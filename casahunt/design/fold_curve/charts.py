"""The surface of orbits beside a fold, as continuation/plane_curve.py wants it.

    s, c        the coordinates of continuation/sheet.py: along the branch, and of q in its range
    phi(s, c) = d lambda/d s                 the parameter component of the unit tangent at the orbit (s, c)

Every value of phi is one corrected orbit with its error estimate.

Every fold is checked against the optimisation problem (continuation/fold.py) - the largest gain nearby, or the
smallest where phi_s > 0 - whose multipliers give the exact slope dK/dq (sensitivity.py).  Within `NEXT_TO_CUSP` of a
cusp there is no extremum to be found; the slope is taken from the gain of the orbits beside the fold, d lambda/d c at s
= 0.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ...continuation.fold import confirmed, confirmed_smallest
from ...continuation.plane_curve import Reading
from ...continuation.sheet import DIFFERENCE, NEXT_TO_CUSP, Axis, Sheet, finer, sheet_of
from ...continuation.special_points import FOLD, SpecialPoint
from ...errors import NoOrbit
from ...orbits.adapt import Options
from ...servo.hunting import Model
from ...servo.problem import HuntingFold, HuntingOrbit
from ...servo.servo import Servo
from ..sensitivity import fold_sensitivities
from .points import FoldPoint


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
        return finer(self.options)


@dataclass(frozen=True, eq=False)
class Chart:
    """Coordinates (s, m) around a fold (plane_curve.Chart)."""

    problem: Problem
    sheet: Sheet
    gradient: tuple[float, float] = (0.0, 0.0)
    fold: FoldPoint | None = None

    @property
    def orbit(self) -> HuntingOrbit:
        """The orbit at the fold."""
        return self.sheet.orbit

    @property
    def position(self) -> float:
        """The place of q in its range."""
        return self.sheet.position

    @property
    def steepness(self) -> float:
        """d ln K/dc."""
        return self.sheet.steepness

    @property
    def reach(self) -> tuple[float, float]:
        """The largest steps in s and in m."""
        return self.sheet.reach

    def value(self, s: float, m: float) -> Reading | str:
        """Read phi at a place of the surface.

        m: place of q from that of the fold. Returns phi and the orbit there, or a sentence that says why there is none.
        """
        orbit = self.sheet.orbit_at(s, m)
        return orbit if isinstance(orbit, str) else Reading(float(self.sheet.point_of(orbit).row[-1]), orbit)

    def moved(self, s: float, m: float, reading: Reading) -> Chart | str:
        """The chart of the fold that was read at a place of the surface.

        s, m: the place, as in `value`. Returns chart, or a sentence that says why there is none.
        """
        chart: Chart | str = chart_of(self.problem, reading.data, self.position + m, like=self)
        if isinstance(chart, str):
            return chart
        return chart if self.agrees(chart) else "the corrector went to another fold"

    def agrees(self, other: Chart) -> bool:
        """Whether the slopes here and there explain the change of the gain: another fold would bend the curve."""
        return self.sheet.agrees(other.sheet)


def chart_of(problem: Problem, orbit: HuntingOrbit, position: float, *, like: Chart | None) -> Chart | str:
    """The chart of a fold, with slope, gradient and tilt.

    position: place of the second parameter in its range; like: chart before this one, in whose direction the branch is
    followed. Returns chart, or a sentence that says why there is none.
    """
    axis = problem.axis
    sheet = sheet_of(
        orbit, "gain", axis, position, options=problem.finer, spacing=problem.spacing,
        like=None if like is None else like.sheet,
    )  # fmt: skip
    bare = Chart(problem, sheet)
    beside = [bare.value(sign * DIFFERENCE, 0.0) for sign in (1, -1)]
    if isinstance(beside[0], str):
        return beside[0]
    if isinstance(beside[1], str):
        return beside[1]
    phi_s = (beside[0].value - beside[1].value) / (2 * DIFFERENCE)
    slope: float | None = None
    error = max(orbit.parameter_error, orbit.error_estimate)
    if abs(phi_s) > NEXT_TO_CUSP:
        try:
            fold = _extremum(orbit, phi_s < 0, problem.options)
        except NoOrbit as complaint:
            return str(complaint)
        slope, error = fold_sensitivities(fold).derivatives[axis.vary], fold.error_estimate
        orbit = fold.orbit
    rate = axis.rate(position)
    sheet = replace(sheet, steepness=0.0 if slope is None else slope * rate / orbit.gain)
    m = sheet.inwards  # K may be steep
    ahead = replace(bare, sheet=sheet).value(0.0, m)
    if isinstance(ahead, str):
        return ahead
    if slope is None:  # d lambda/d s vanishes: the gain beside the fold, at s = 0, has the slope of the curve
        steepness = float(np.log(ahead.data.gain / orbit.gain)) / m
        slope = steepness * orbit.gain / rate
        sheet = replace(sheet, steepness=steepness)
    found = FoldPoint(axis.value(position), orbit.gain, slope, orbit, error, phi_s, orbit.status)
    return Chart(problem, sheet.tilted(ahead.data, m), (phi_s, ahead.value / m), found)


def _extremum(orbit: HuntingOrbit, largest: bool, options: Options) -> HuntingFold:
    """A located fold, checked against the optimisation problem: the largest gain nearby, or the smallest."""
    return (confirmed if largest else confirmed_smallest)(SpecialPoint(FOLD.kind, orbit, ""), "gain", options)
