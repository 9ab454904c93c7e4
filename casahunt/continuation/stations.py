"""Orbits along a branch as stations, what is known at them, and which steps must be looked at inside.

    f_k = f(orbit_k)    a monitor along the branch, at the arclengths s_k
    Q, R                parabolas through three successive values each, both over [s_k, s_k+1]
    min |Q| <= 4 max |Q - R|  two zeros may hide there: the branch is looked at in the middle, and again
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Generic, NamedTuple

import numpy as np

from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit
from ..roots import hides_a_pair
from .bifurcations import NEIMARK_SACKER
from .curve import CurvePoint, arrived, bend, in_units_of, parameter_value, secant_direction, seen_from
from .locating import length_to
from .poincare_section import apart_by_kinks
from .special_points import FOLD, Monitor
from .walk import step_along

Array = np.ndarray

HALFWAY = 0.5, 0.45
"""Part of a step at which it is looked at, and where the equations are singular just there, as where branches cross."""
LOOKED_INSIDE, LOOKED_CLOSER = 5, 15
"""A step is looked at inside to this part of it, as a power of two: what is narrower is a jump; and how often it is
halved on where one multiplier may leave the unit circle while another one enters."""


class Station(NamedTuple, Generic[AnyOrbit]):
    """An orbit of the branch, the curve there oriented along the walk, and how far it has come.

    `opens` where the values before are those of other coordinates: nothing is interpolated across.
    """

    orbit: AnyOrbit
    point: CurvePoint
    at: float
    opens: bool = False


class Change(NamedTuple, Generic[AnyOrbit]):
    """A monitor has changed its sign between two stations, to +1 or -1."""

    monitor: Monitor
    before: Station[AnyOrbit]
    after: Station[AnyOrbit]
    sign: int


@dataclass
class Signs(Generic[AnyOrbit]):
    """What is known so far.

    Attributes
    ----------
    last : by kind and number of monitor the last station whose sign is sure, and its value.
    pending : where multipliers have passed +1 while the parameter stood still.
    owed : how many multipliers have left the unit circle that no point has explained.
    folds : how many folds have been passed whose multiplier has not.
    """

    last: dict[tuple[str, int], tuple[Station[AnyOrbit], float]] = field(default_factory=dict)
    pending: list[Change[AnyOrbit]] = field(default_factory=list)
    owed: int = 0
    folds: int = 0

    def copy(self) -> Signs[AnyOrbit]:
        """As they are now."""
        return replace(self, last=dict(self.last), pending=list(self.pending))


@dataclass(frozen=True)
class Inside(Generic[AnyOrbit]):
    """Steps of a branch as they are looked at inside.

    Attributes
    ----------
    vary, options : name of its parameter; tolerance and method.
    monitors : by kind, those of single multipliers apart.
    """

    vary: str
    options: Options
    monitors: Mapping[str, Sequence[Monitor]]

    def stations(
        self, x: Station[AnyOrbit], y: Station[AnyOrbit], earlier: Station[AnyOrbit] | None,
        later: Station[AnyOrbit] | None, halvings: int,
    ) -> Iterator[Station[AnyOrbit]]:  # fmt: skip
        """Stations inside a step, where zeros may hide there."""
        around = [s for s in (earlier, x, y, later) if s is not None]
        if x.orbit.signature != y.orbit.signature or halvings <= 0 and not (
            -LOOKED_CLOSER < halvings and self.opposite(around, x, y)
        ):
            return
        alike = [s for s in around if s.orbit.signature == x.orbit.signature or apart_by_kinks(s.orbit, x.orbit)]
        every = [monitor for each in self.monitors.values() for monitor in each]
        if halvings > 0 and not any(self._may_hide(monitor, alike, x, y) for monitor in every):
            return
        middle = self.middle(x, y)
        if middle is None:
            return
        yield from self.stations(x, middle, earlier, y, halvings - 1)
        yield middle
        yield from self.stations(middle, y, x, later, halvings - 1)

    def opposite(self, around: Sequence[Station[AnyOrbit]], x: Station[AnyOrbit], y: Station[AnyOrbit]) -> bool:
        """Whether one multiplier may leave the unit circle in a step while another one enters, as those around show.

        As many are outside at both ends, and both the last of them and the first one inside turn back next to it.
        """
        ranks = self.monitors.get(NEIMARK_SACKER.kind, ())
        alike = [s for s in around if s.orbit.signature == x.orbit.signature]
        at, values = np.array([s.at for s in alike]), np.array([[self.value(k, s) for k in ranks] for s in alike])
        many, last = (int(np.sum(values[at == s.at] > 0)) for s in (x, y))
        if many != last or not 0 < many < len(ranks):
            return False
        pair = values[:, many - 1 : many + 1]
        known = np.all(np.isfinite(pair), axis=1)
        at, pair = at[known], np.arctanh(np.clip(pair[known], -0.999, 0.999))
        side_by_side = x.at in at and y.at in at and not np.any((at > x.at) & (at < y.at))
        return side_by_side and all(self._may_bounce(at, way, x.at) for way in pair.T)

    def _may_hide(
        self, monitor: Monitor, alike: list[Station[AnyOrbit]], x: Station[AnyOrbit], y: Station[AnyOrbit]
    ) -> bool:
        """Whether a monitor may vanish twice in a step, as far as the stations around it show.

        One that a multiplier shows to be next to zero may do so on both sides of that station.  Multipliers go on where
        the field has a kink and no more; the components of a tangent do not where the first phase is another one.
        """
        if not monitor.by_multipliers:
            alike = [s for s in alike if s.orbit.signature == x.orbit.signature]
        places = [(s.at, v) for s in alike if np.isfinite(v := self.value(monitor, s, zero=True))]
        if x.at not in (at for at, _ in places) or y.at not in (at for at, _ in places):
            return False
        at, values = np.array(places).T
        if monitor.kind != FOLD.kind:  # multipliers span many decades: in units of 1, or of themselves
            bounces = monitor.by_multipliers and self._may_bounce(at, np.arctanh(np.clip(values, -0.999, 0.999)), x.at)
            return bounces or hides_a_pair(at, values / (1 + np.abs(values)), x.at, y.at)
        # Of a unit vector's component the angle tells more: it does not flatten where the parameter is all that moves.
        # No component comes out larger than 1: squares are summed, and the root taken, without falling below its own.
        # The mean over a step is known to errors of lambda in its units: over a short one next to an end it is noise.
        noise = (x.orbit.error_estimate + y.orbit.error_estimate) / (y.at - x.at)
        known = noise < np.abs(values[(at == x.at) | (at == y.at)]).min()
        mean = float(np.arcsin(self._mean_slope(x, y))) if known else None
        return hides_a_pair(at, np.arcsin(values), x.at, y.at, mean)

    @staticmethod
    def _may_bounce(at: Array, values: Array, low: float) -> bool:
        """Whether the lines before and behind a step, those that there are, reach zero inside: ranks may swap."""
        k = int(np.flatnonzero(at == low)[0])
        ways = [(k, k - 1, k + 1)] * (k > 0) + [(k + 1, k + 2, k)] * (k + 2 < at.size)
        met = [values[i] + (values[i] - values[j]) / (at[i] - at[j]) * (at[to] - at[i]) for i, j, to in ways]
        return bool(ways) and all(value * values[k] <= 0 for value in met) and values[k] * values[k + 1] > 0

    def _mean_slope(self, x: Station[AnyOrbit], y: Station[AnyOrbit]) -> float:
        """The mean of d lambda/d s over a step, which its ends know."""
        way = in_units_of(secant_direction(x.orbit, y.orbit, self.vary), x.orbit.scale, x.point.setting.scale)
        return float(way[-1] / np.linalg.norm(way))

    def middle(self, x: Station[AnyOrbit], y: Station[AnyOrbit]) -> Station[AnyOrbit] | None:
        """The orbit halfway; None where the step there does not converge to one with the same phases."""
        vary, problem = self.vary, x.orbit.problem
        length = length_to(y.orbit, x.orbit, x.point, vary)
        seen = seen_from(x.point, x.orbit, vary, parameter_value(y.orbit, vary))
        start = replace(x.point, bend=bend(y.point, x.point, seen, side=1.0))
        for part in HALFWAY:
            outcome = step_along(start, x.orbit, vary, part * length, *problem.range_of(vary), self.options)
            if not isinstance(outcome, str) and outcome[0].signature == x.orbit.signature:
                return Station(outcome[0], arrived(x.orbit, outcome[0], vary), x.at + part * (y.at - x.at))
        return None

    def value(self, monitor: Monitor, station: Station[AnyOrbit], *, zero: bool = False) -> float:
        """The value of a monitor, NaN where its sign is not sure; or `zero` where multipliers show that it is.

        They do not where the orbit could be none of what is looked for: of a torus no real pair of multipliers says
        anything, one large and one too small to be known, and no shorter step would make its product better known.
        """
        value = monitor.value(station.orbit, station.point)
        if value != 0 and np.isfinite(value) and monitor.sure(station.orbit, station.point):
            if abs(value) > monitor.noise(station.orbit):
                return float(value)
        near = zero and monitor.by_multipliers and station.orbit.multipliers.trusted
        return 0.0 if near and monitor.confirmed(station.orbit) else float("nan")
