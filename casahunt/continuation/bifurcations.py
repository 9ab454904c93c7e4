"""Where the multipliers of a cycle meet the unit circle, as monitors (special_points.py).

    fold               d lambda/d s = 0        a multiplier passes +1
    branch point       x_k = 1, x = Re mu      a multiplier +1 where the parameter goes on: branches cross
    flip               x_k = 1, x = -Re mu     a multiplier -1: a cycle of twice the period branches off
    symmetry breaking  the same of half multipliers of a symmetric cycle: a pair of lopsided cycles branches off
    Neimark-Sacker     x_k = 1, x = |mu|       a complex pair on the circle: a torus branches off

x_k is the k-th largest x of the nontrivial multipliers.  Sorted, they are continuous along a branch whatever the
multipliers do, and where r more of them are beyond 1 than before, r of the x_k have passed it: two that do so at once
are seen as one is, and of |mu| none leaves the circle unseen.  One that leaves while another one enters at the same
real place makes x_k turn back next to 1: lines from both sides show it; where both do so at one place, or
two pairs, that is missed, and said.

The value is (x - 1)/(1 + |x|), which does not drown in multipliers of 1e10.  Re mu of a complex pair passes 1 where
nothing happens, |mu| of a real one where another monitor does: what is located is looked at again.  Along a curve in
two parameters nobody need count, and a smooth function serves: prod (mu_i + 1), or mu_i mu_j - 1 of the nearest pair,
which goes on where the two become real.

The sign of a value is sure where it is larger than the error of its multiplier (in units of 1, or of its size), that of
d lambda/d s where it is larger than the error of lambda: next to an orbit that takes for ever, and along a canard,
lambda has come to rest, and its slope is rounding.

Orbits along a branch as stations, what is known at them, and which steps must be looked at inside.

f_k = f(orbit_k)    a monitor along the branch, at the arclengths s_k
Q, R                parabolas through three successive values each, both over [s_k, s_k+1]
min |Q| <= 4 max |Q - R|  two zeros may hide there: the branch is looked at in the middle, and again
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from itertools import combinations
from typing import Generic, NamedTuple

import numpy as np

from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit, Orbit
from ..roots import hides_a_pair
from .curve import CurvePoint, arrived, bend, in_units_of, parameter_value, secant_direction, seen_from
from .locating import length_to
from .poincare_section import apart_by_kinks
from .special_points import FOLD, Monitor
from .walk import step_along

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


Array = np.ndarray

COMPLEX = 1e-6
"""A pair of multipliers with less imaginary part than this is real."""
NOISE_OF_SLOPE = 100.0
"""d lambda/d s is known to so many errors of lambda, a step being of the order of one."""


def _nontrivial(orbit: Orbit) -> Array:
    """Half multipliers but for the trivial one; of a full cycle those of the period."""
    return orbit.multipliers.half[1:]


def _errors(orbit: Orbit) -> Array:
    """Of the nontrivial multipliers: that of the leading one, relative above 1, or the bound that stands for one."""
    known = orbit.multipliers
    return np.maximum(known.error * np.maximum(1.0, np.abs(_nontrivial(orbit))), known.floor[1:])


class Ranked(NamedTuple):
    """The nontrivial multipliers mu (m,) by decreasing x (m,), and their errors (m,)."""

    x: Array
    errors: Array
    mu: Array

    def values(self) -> Array:
        """(m,) what vanishes where x passes 1."""
        return np.asarray((self.x - 1) / (1 + np.abs(self.x)))


@lru_cache(maxsize=64)  # each of them is asked for by the monitor of every rank
def _ranked(orbit: Orbit, x: Callable[[Array], Array]) -> Ranked:
    mu, errors = _nontrivial(orbit), _errors(orbit)
    order = np.argsort(-x(mu), kind="stable")
    return Ranked(x(mu)[order], errors[order], mu[order])


def _passes(
    kind: str, meaning: str, x: Callable[[Array], Array], *, turns: bool = False, at: float = math.nan
) -> Monitor:
    """The monitor of the multipliers whose x passes 1: real ones, which are `at` that place then, or pairs that turn.

    Its own value is that of the one that is nearest.
    """

    def of_rank(k: int | None) -> Monitor:
        def ranked(orbit: Orbit) -> tuple[float, float, float]:
            """The value, its error, and the imaginary part of the multiplier."""
            found = _ranked(orbit, x)
            if not found.x.size:
                return 1.0, 0.0, 0.0
            values = found.values()
            one = int(np.argmin(np.where(np.isnan(values), np.inf, np.abs(values)))) if k is None else k
            error = 2 * found.errors[one] / (1 + abs(found.x[one])) ** 2
            return float(values[one]), float(error), float(found.mu[one].imag)

        return Monitor(
            kind, lambda orbit, point: ranked(orbit)[0], f"{kind} at {{name}} = {{value:.10g}}: {meaning}",
            noise=lambda orbit: ranked(orbit)[1], confirmed=lambda orbit: turns == (abs(ranked(orbit)[2]) > COMPLEX),
            by_multipliers=True, multiplier=at, each=each if k is None else lambda orbit: (),
        )  # fmt: skip

    def each(orbit: Orbit) -> tuple[Monitor, ...]:
        return tuple(of_rank(k) for k in range(orbit.scale.size - 1))

    return of_rank(None)


def _slope_is_sure(orbit: Orbit, point: CurvePoint) -> bool:
    return abs(float(point.row[-1])) > NOISE_OF_SLOPE * orbit.error_estimate


def pair_of(orbit: Orbit) -> tuple[complex, complex]:
    """The two nontrivial multipliers whose product is nearest to 1; zeros where there are no two."""
    pairs = combinations(_nontrivial(orbit), 2)
    return min(pairs, key=lambda pair: abs(pair[0] * pair[1] - 1), default=(0j, 0j))


def _product(orbit: Orbit, point: CurvePoint) -> float:
    mu = _nontrivial(orbit)
    return float(np.prod((mu + 1) / (1 + np.abs(mu))).real)


def _of_a_pair(orbit: Orbit, point: CurvePoint) -> float:
    a, b = pair_of(orbit)
    return float(((a * b - 1) / (1 + abs(a * b))).real)


def _is_complex(orbit: Orbit) -> bool:
    return abs(pair_of(orbit)[0].imag) > COMPLEX


TURN = replace(FOLD, sure=_slope_is_sure)
BRANCH_POINT = _passes(
    "branch point", "a multiplier passes +1 while {name} goes on, and another branch of cycles crosses this one",
    np.real, at=1.0,
)  # fmt: skip
FLIP = replace(
    _passes("flip", "a cycle of twice the period branches off", lambda mu: -mu.real, at=-1.0), value=_product
)
SYMMETRY_LOST = replace(
    _passes("symmetry breaking", "a pair of lopsided cycles branches off", lambda mu: -mu.real, at=-1.0), value=_product
)
NEIMARK_SACKER = replace(
    _passes("Neimark-Sacker", "a torus branches off", np.abs, turns=True), value=_of_a_pair, confirmed=_is_complex
)


def monitors_of(orbit: Orbit) -> tuple[Monitor, ...]:
    """What is looked for along a branch of any system: symmetric cycles lose their symmetry, others flip.

    Examples
    --------
    >>> from casahunt.continuation import monitors_of
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> [monitor.kind for monitor in monitors_of(orbit)]
    ['fold', 'branch point', 'flip', 'Neimark-Sacker']
    """
    return TURN, BRANCH_POINT, SYMMETRY_LOST if orbit.repeats == 2 else FLIP, NEIMARK_SACKER
