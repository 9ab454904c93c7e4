"""What a branch passes from orbit to orbit, and what hides inside a step.

    f_k = f(orbit_k)    a monitor along the branch, at the arclengths s_k
    f_k f_k+1 < 0       a special point lies between them: located (locating.py), or missed and said so
    Q, R                parabolas through three successive values each, both over [s_k, s_k+1]
    min |Q| <= 4 max |Q - R|  two zeros may hide there: the branch is looked at in the middle, and again

A sign counts where the value is larger than its error (Monitor.sure); an orbit of which it is not known is passed over,
and the sign before it stands against that behind it.  A step is looked at when the one behind it is known, too.

Where the parameter turns round, one multiplier passes +1, and the other way round but for branch points:

    d lambda/d s changes sign                      fold, located by either
    it does not, and a multiplier passes +1        branch point: another branch crosses this one
    it is rounding while a multiplier passes +1    whichever it turns out to be when the parameter moves again

The last is a canard's: its parameter moves by less than rounding while the whole cycle changes.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import pairwise
from typing import Generic, NamedTuple

import numpy as np

from .. import effort
from ..orbits.adapt import Options
from ..orbits.batched_multipliers import ORBITS_AHEAD, know_multipliers
from ..orbits.orbit import AnyOrbit
from ..roots import hides_a_pair
from .bifurcations import BRANCH_POINT
from .curve import (
    CurvePoint,
    arrived,
    bend,
    curve_point,
    ends,
    in_units_of,
    parameter_value,
    secant_direction,
    seen_from,
)
from .locating import length_to, locate_special_point
from .poincare_section import apart_by_kinks
from .special_points import FOLD, GRAZING, Missed, Monitor, SpecialPoint, in_order, special_point
from .vanishing import change_of_phases
from .walk import step_along

Array = np.ndarray

LOOKED_INSIDE = 5
"""A step is looked at inside to this part of it, as a power of two: what is narrower is a jump."""
KINK_PASSED = "kink"
KINK_LEFT_OUT = "phases come or go that are parts of one mode: the field has but a kink there, which was not sought"
"""What is said of a change of phases by which the motion hardly changes."""
LOOSELY = 1e3
"""A fold at which the parameter stands still is where a multiplier is 1 to so many tolerances of that: its parameter
is second order in them."""


class Passed(NamedTuple, Generic[AnyOrbit]):
    """What was located, in the order of the walk, and what is there and was not."""

    special: tuple[SpecialPoint[AnyOrbit], ...] = ()
    missed: tuple[Missed, ...] = ()


class _Station(NamedTuple, Generic[AnyOrbit]):
    """An orbit of the branch, the curve there oriented along the walk, and how far it has come.

    `opens` where the values before are those of other coordinates: nothing is interpolated across.
    """

    orbit: AnyOrbit
    point: CurvePoint
    at: float
    opens: bool = False


@dataclass
class _Signs(Generic[AnyOrbit]):
    """What is known so far: by kind of monitor the last station whose sign is sure, and its value.

    And the steps in which a multiplier has passed +1 while the parameter stood still.
    """

    last: dict[str, tuple[_Station[AnyOrbit], float]] = field(default_factory=dict)
    pending: list[tuple[_Station[AnyOrbit], _Station[AnyOrbit]]] = field(default_factory=list)


class Crossings(Generic[AnyOrbit]):
    """The special points of a branch whose orbits come one by one, from its first orbit `start` on.

    inside: steps are looked at inside; at_kinks: it is located where phases come or go between which the field has a
    kink and no more, else it is said.
    """

    def __init__(
        self, start: AnyOrbit, *, vary: str, monitors: Sequence[Monitor], options: Options, inside: bool = True,
        at_kinks: bool = True,
    ) -> None:  # fmt: skip
        self._vary, self._monitors, self._options, self._inside = vary, tuple(monitors), options, inside
        self._start: AnyOrbit = start
        self.at_kinks = at_kinks
        self._line: list[_Station[AnyOrbit]] = []
        self._looked, self._found = 0, list[Passed[AnyOrbit]]()  # the last station before which all is known; what is
        self._ahead = ORBITS_AHEAD if any(monitor.by_multipliers for monitor in monitors) else 1
        self._signs: _Signs[AnyOrbit] = _Signs()

    def past(self, after: AnyOrbit) -> Passed[AnyOrbit]:
        """What lies in the steps before the one that leads to `after`; it is looked for in several steps at once."""
        self._arrive(after)
        if len(self._line) - 2 - self._looked >= self._ahead:
            self._look_up_to(len(self._line) - 2)
            del self._line[: max(self._looked - 1, 0)]
            self._looked = min(self._looked, 1)
        return self._so_far()

    def _look_up_to(self, last: int) -> None:
        """Look at all steps up to a station; the multipliers of all of them are computed in batches."""
        if self._ahead > 1:
            know_multipliers([station.orbit for station in self._line])
        for k in range(self._looked + 1, last + 1):
            signs = _Signs(dict(self._signs.last), list(self._signs.pending))
            try:
                self._found.append(self._step(k))
            except effort.OutOfTime:
                self._signs = signs  # as if nobody had begun with this step
                raise
            self._looked = k

    def in_haste(self, last: AnyOrbit) -> Passed[AnyOrbit]:
        """What lies in all steps up to the last orbit, none of which is looked at inside any more; as `rest`."""
        self._inside = False
        if last is not (self._line[-1].orbit if self._line else self._start):
            self._arrive(last)
        return self.rest()

    def _so_far(self) -> Passed[AnyOrbit]:
        """What was found and is not yet known to anyone: all of it, wherever the search was interrupted."""
        found, self._found = self._found, []
        return Passed(tuple(s for one in found for s in one.special), tuple(m for one in found for m in one.missed))

    def seen(self, *orbits: AnyOrbit) -> Passed[AnyOrbit]:
        """What lies in the last step, between orbits of which no other one behind them is known."""
        for orbit in orbits:
            self._arrive(orbit)
        self._looked = len(self._line) - 2
        return self.rest()

    def _arrive(self, after: AnyOrbit) -> None:
        """The next station."""
        if not self._line:
            here, there = ends(self._start, after, self._vary)
            self._line.append(_Station(self._start, here, 0.0, True))
        else:
            last = self._line[-1]
            there = arrived(last.orbit, after, self._vary)
        length = float(np.linalg.norm(secant_direction(self._line[-1].orbit, after, self._vary)))
        self._line.append(_Station(after, there, self._line[-1].at + length))

    @property
    def sense(self) -> float:
        """+1 where the parameter grows at the last orbit, -1 where it falls; 0 where nothing is known."""
        return float(np.sign(self._line[-1].point.row[-1])) if self._line else 0.0

    def rest(self) -> Passed[AnyOrbit]:
        """What lies in the last step."""
        self._look_up_to(len(self._line) - 1)
        self._start, self._line, self._looked = self._line[-1].orbit if self._line else self._start, [], 0
        return self._so_far()

    def go_on_from(self, orbit: AnyOrbit, *, same: bool = False) -> None:
        """Go on from another orbit; after `rest`.

        orbit, same: the last one again, in other coordinates (`same`), or the one behind a gap.
        """
        last = self._signs.last
        for kind, (station, value) in tuple(last.items()):
            if not same:  # multipliers may jump there, and the parameter turns round without a fold
                del last[kind]
            elif station.orbit is self._start:
                last[kind] = station._replace(orbit=orbit), value
        self._start, self._line = orbit, []

    def unresolved(self) -> tuple[Missed, ...]:
        """What the branch has passed of which its end leaves open what it is; after `rest`."""
        return tuple(
            self._not_located(
                BRANCH_POINT.kind, x, y, "a multiplier passes +1 there while the parameter stands still to rounding: "
                "whether it turns round was not seen",
            )
            for x, y in self._signs.pending
        )  # fmt: skip

    def _step(self, k: int) -> Passed[AnyOrbit]:
        """What lies between stations k - 1 and k."""
        before, after = self._line[k - 1], self._line[k]
        special: list[SpecialPoint[AnyOrbit]] = []
        missed: list[Missed] = []
        if GRAZING in self._monitors and not self.at_kinks and apart_by_kinks(before.orbit, after.orbit):
            missed.append(Missed(KINK_PASSED, f"{self._between(before, after)} {KINK_LEFT_OUT}"))
        elif GRAZING in self._monitors:
            grazing = change_of_phases(before.orbit, after.orbit, self._vary, self._options)
            if grazing is not None:
                special.append(special_point(GRAZING, grazing, self._vary))
        earlier = self._line[k - 2] if k > 1 and not before.opens else None
        later = self._line[k + 1] if k + 1 < len(self._line) else None
        stations = [before, *self._looked_inside(before, after, earlier, later, LOOKED_INSIDE), after]
        for x, y in pairwise(stations):
            for monitor in self._monitors:
                one = self._turned if monitor.kind == FOLD.kind else self._changed
                if monitor is GRAZING or monitor.kind == BRANCH_POINT.kind:
                    continue
                found = one(monitor, x, y)
                special += found.special
                missed += found.missed
        special = in_order(special, before.orbit, after.orbit, self._vary, self._monitors, self._options.tol)
        return Passed(tuple(special), tuple(missed))

    def _looked_inside(
        self, x: _Station[AnyOrbit], y: _Station[AnyOrbit], earlier: _Station[AnyOrbit] | None,
        later: _Station[AnyOrbit] | None, halvings: int,
    ) -> Iterator[_Station[AnyOrbit]]:  # fmt: skip
        """Stations inside a step, where zeros may hide there."""
        if not self._inside or not halvings or x.orbit.signature != y.orbit.signature:
            return
        around = [s for s in (earlier, x, y, later) if s is not None]
        alike = [s for s in around if s.orbit.signature == x.orbit.signature or apart_by_kinks(s.orbit, x.orbit)]
        if not any(self._may_hide(monitor, alike, x, y) for monitor in self._monitors if monitor is not GRAZING):
            return
        middle = self._middle(x, y)
        if middle is None:
            return
        yield from self._looked_inside(x, middle, earlier, y, halvings - 1)
        yield middle
        yield from self._looked_inside(middle, y, x, later, halvings - 1)

    def _may_hide(
        self, monitor: Monitor, alike: list[_Station[AnyOrbit]], x: _Station[AnyOrbit], y: _Station[AnyOrbit]
    ) -> bool:
        """Whether a monitor may vanish twice in a step, as far as the stations around it show.

        One that a multiplier shows to be next to zero may do so on both sides of that station.  Multipliers go on where
        the field has a kink and no more; the components of a tangent do not where the first phase is another one.
        """
        if not monitor.by_multipliers:
            alike = [s for s in alike if s.orbit.signature == x.orbit.signature]
        places = [(s.at, v) for s in alike if np.isfinite(v := self._value(monitor, s, zero=True))]
        if x.at not in (at for at, _ in places) or y.at not in (at for at, _ in places):
            return False
        at, values = np.array(places).T
        if monitor.kind != FOLD.kind:  # multipliers span many decades: in units of 1, or of themselves
            return hides_a_pair(at, values / (1 + np.abs(values)), x.at, y.at)
        # Of a unit vector's component the angle tells more: it does not flatten where the parameter is all that moves.
        # No component comes out larger than 1: squares are summed, and the root taken, without falling below its own.
        return hides_a_pair(at, np.arcsin(values), x.at, y.at, float(np.arcsin(self._mean_slope(x, y))))

    def _mean_slope(self, x: _Station[AnyOrbit], y: _Station[AnyOrbit]) -> float:
        """The mean of d lambda/d s over a step, which its ends know."""
        way = in_units_of(secant_direction(x.orbit, y.orbit, self._vary), x.orbit.scale, x.point.setting.scale)
        return float(way[-1] / np.linalg.norm(way))

    def _middle(self, x: _Station[AnyOrbit], y: _Station[AnyOrbit]) -> _Station[AnyOrbit] | None:
        """The orbit halfway; None where the step there does not converge to one with the same phases."""
        vary, problem = self._vary, x.orbit.problem
        length = length_to(y.orbit, x.orbit, x.point, vary)
        seen = seen_from(x.point, x.orbit, vary, parameter_value(y.orbit, vary))
        start = replace(x.point, bend=bend(y.point, x.point, seen, side=1.0))
        outcome = step_along(start, x.orbit, vary, length / 2, *problem.range_of(vary), self._options)
        if isinstance(outcome, str) or outcome[0].signature != x.orbit.signature:
            return None
        return _Station(outcome[0], arrived(x.orbit, outcome[0], vary), (x.at + y.at) / 2)

    def _value(self, monitor: Monitor, station: _Station[AnyOrbit], *, zero: bool = False) -> float:
        """The value of a monitor, NaN where its sign is not sure; or `zero` where multipliers show that it is.

        They do not where the orbit could be none of what is looked for: of a torus no real pair of multipliers says
        anything, one large and one too small to be known, and no shorter step would make its product better known.
        """
        value = monitor.value(station.orbit, station.point)
        if value != 0 and np.isfinite(value) and monitor.sure(station.orbit, station.point):
            return float(value)
        near = zero and monitor.by_multipliers and station.orbit.multipliers.trusted
        return 0.0 if near and monitor.confirmed(station.orbit) else float("nan")

    def _sign_change(self, monitor: Monitor, x: _Station[AnyOrbit], y: _Station[AnyOrbit]) -> _Station[AnyOrbit] | None:
        """The last station with the other sign than at y; None where there is none, or the sign at y is not sure."""
        last = self._signs.last
        if monitor.kind not in last and np.isfinite(first := self._value(monitor, x)):
            last[monitor.kind] = x, first
        value = self._value(monitor, y)
        if np.isnan(value):
            return None
        known = last.get(monitor.kind)
        last[monitor.kind] = y, value
        return known[0] if known is not None and known[1] * value < 0 else None

    def _changed(self, monitor: Monitor, x: _Station[AnyOrbit], y: _Station[AnyOrbit]) -> Passed[AnyOrbit]:
        """The point at which a monitor changes its sign up to y."""
        before = self._sign_change(monitor, x, y)
        if before is None or not (monitor.confirmed(before.orbit) or monitor.confirmed(y.orbit)):
            return Passed()
        return self._located(monitor, before, y)

    def _located(self, monitor: Monitor, before: _Station[AnyOrbit], after: _Station[AnyOrbit]) -> Passed[AnyOrbit]:
        orbit = locate_special_point(before.orbit, after.orbit, monitor, vary=self._vary, options=self._options)
        if orbit is not None:
            error = self._error(monitor, orbit, before, after)
            special = (special_point(monitor, orbit, self._vary, error),) if monitor.confirmed(orbit) else ()
            return Passed(special)
        jumps = not apart_by_kinks(before.orbit, after.orbit) and before.orbit.signature != after.orbit.signature
        if jumps and GRAZING in self._monitors:
            return Passed()  # multipliers may jump where the phases change, and that is located
        return Passed((), (self._not_located(monitor.kind, before, after),))

    def _error(self, monitor: Monitor, orbit: AnyOrbit, before: _Station[AnyOrbit], after: _Station[AnyOrbit]) -> float:
        """How far off a point may be, in lambda, by what is left of a product of multipliers and by their errors.

        0 of other monitors.
        """
        if not monitor.by_multipliers:
            return 0.0
        a, b = (monitor.value(station.orbit, station.point) for station in (before, after))
        way = abs(before.orbit.problem.distance(self._vary, parameter_value(after.orbit, self._vary)))
        left = abs(monitor.value(orbit, curve_point(orbit, self._vary)))
        off = (left + orbit.multipliers.leading_error) / abs(b - a)
        return max(orbit.error_estimate, way * float(min(off, 1.0)))  # it lies between the two, however little is known

    def _turned(self, monitor: Monitor, x: _Station[AnyOrbit], y: _Station[AnyOrbit]) -> Passed[AnyOrbit]:
        """The fold, or the branch points, up to y."""
        watched = next((m for m in self._monitors if m.kind == BRANCH_POINT.kind), None)
        one = None if watched is None else self._sign_change(watched, x, y)
        if one is not None:
            self._signs.pending.append((one, y))
        before = self._sign_change(monitor, x, y)
        steps, still = self._signs.pending, np.isnan(self._value(monitor, y))
        if still:
            return Passed()
        self._signs.pending = []
        if before is None:
            found = [self._located(watched, *step) for step in steps] if watched is not None else []
            return Passed(tuple(s for f in found for s in f.special), tuple(m for f in found for m in f.missed))
        return self._fold(monitor, watched, before, y, steps)

    def _fold(
        self, monitor: Monitor, watched: Monitor | None, before: _Station[AnyOrbit], after: _Station[AnyOrbit],
        steps: list[tuple[_Station[AnyOrbit], _Station[AnyOrbit]]],
    ) -> Passed[AnyOrbit]:  # fmt: skip
        """The fold between two stations, the multiplier having passed +1 in some steps between them."""
        orbit, vary, options = None, self._vary, self._options
        if watched is not None and len(steps) == 1 and steps[0] != (before, after):
            loosely = replace(watched, tolerance=LOOSELY * watched.tolerance)
            orbit = locate_special_point(steps[0][0].orbit, steps[0][1].orbit, loosely, vary=vary, options=options)
        orbit = orbit or locate_special_point(before.orbit, after.orbit, monitor, vary=vary, options=options)
        width = abs(before.orbit.problem.distance(vary, parameter_value(after.orbit, vary)))
        if orbit is None and width <= options.tol:
            # Too sharp to be resolved in arclength, but the two sides of it agree in the parameter.
            sense = before.point.row[-1]
            orbit = max(before.orbit, after.orbit, key=lambda o: sense * parameter_value(o, vary))
        special = () if orbit is None else (special_point(monitor, orbit, vary),)
        missed = () if special else (self._not_located(monitor.kind, before, after),)
        return Passed(special, missed)

    def _not_located(self, kind: str, before: _Station[AnyOrbit], after: _Station[AnyOrbit], why: str = "") -> Missed:
        why = why or "the steps towards it did not converge; another tolerance may lead there"
        return Missed(kind, f"a {kind} {self._between(before, after)} was not located: {why}")

    def _between(self, before: _Station[AnyOrbit], after: _Station[AnyOrbit]) -> str:
        low, high = (parameter_value(station.orbit, self._vary) for station in (before, after))
        return f"between {self._vary} = {low:.8g} and {high:.8g}"


def special_points_between(
    before: AnyOrbit, after: AnyOrbit, *, vary: str, monitors: Sequence[Monitor], options: Options,
    earlier: AnyOrbit | None = None, inside: bool = False,
) -> tuple[list[SpecialPoint[AnyOrbit]], list[Missed]]:  # fmt: skip
    """The special points between two successive orbits of a walk.

    Parameters
    ----------
    before, after, vary
        the orbits, in the order of the walk, and the name of its parameter.
    monitors, options
        the kinds that are looked for; tolerance and method of the orbits there.
    earlier, inside
        the orbit before the two, where there is one; whether the step is looked at inside, else by what is known at its
        ends.

    Returns
    -------
    Special points in the order of the walk, and those that are there and were not located.

    Examples
    --------
    >>> from casahunt import walk
    >>> from casahunt.continuation import monitors_of, special_points_between
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import Options, find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> after = list(walk(orbit, vary="a", low=0.0119, high=0.027))[-1]
    >>> found, missed = special_points_between(
    ...     orbit, after, vary="a", monitors=monitors_of(orbit), options=Options()
    ... )
    >>> [special.kind for special in found], missed
    (['flip'], [])
    """
    first, *others = [orbit for orbit in (earlier, before, after) if orbit is not None]
    found = Crossings(first, vary=vary, monitors=monitors, options=options, inside=inside).seen(*others)
    return list(found.special), list(found.missed)
