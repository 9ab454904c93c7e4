"""What a branch passes from orbit to orbit.

    f_k = f(orbit_k)    a monitor along the branch, at the arclengths s_k
    f_k f_k+1 < 0       a special point lies between them: located (locating.py), or missed and said so

What hides in a step is looked for there (bifurcations.py).  A sign counts where the value is larger than its error; an
orbit of which it is not known is passed over, and the sign before it stands against that behind it.  A step is looked
at when the one behind it is known, too.

Where the parameter turns round, one multiplier passes +1, and the other way round but for branch points:

    d lambda/d s changes sign                      fold, located by either
    it does not, and a multiplier passes +1        branch point: another branch crosses this one
    it is rounding while a multiplier passes +1    whichever it turns out to be when the parameter moves again

The last is a canard's: its parameter moves by less than rounding while the whole cycle changes.

Of several multipliers each has a monitor (bifurcations.py), and those that pass at one place are one point:

    n = multipliers outside the unit circle,    n_k+1 - n_k = the sum of those that the points between them explain

or the step is looked at in halves, as where two points hide each other, and what is left is missed, and said so.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Generic, NamedTuple

import numpy as np

from .. import effort
from ..orbits.adapt import Options
from ..orbits.batched_multipliers import ORBITS_AHEAD, know_multipliers
from ..orbits.orbit import AnyOrbit
from .bifurcations import (
    BRANCH_POINT,
    FLIP,
    LOOKED_INSIDE,
    NEIMARK_SACKER,
    SYMMETRY_LOST,
    Change,
    Inside,
    Signs,
    Station,
)
from .curve import CurvePoint, arrived, ends, parameter_value, secant_direction
from .locating import Located, locate_special_point
from .poincare_section import apart_by_kinks
from .special_points import ACCEPTED_TOLERANCES, FOLD, GRAZING, Missed, Monitor, SpecialPoint, in_order, special_point
from .vanishing import change_of_phases

Array = np.ndarray

KINK_PASSED = "kink"
KINK_LEFT_OUT = "phases come or go that are parts of one mode: the field has but a kink there, which was not sought"
"""What is said of a change of phases by which the motion hardly changes."""
COUNTED = {FOLD.kind, BRANCH_POINT.kind, NEIMARK_SACKER.kind}
"""What must be looked for, besides -1, for all multipliers that leave the unit circle to be explained."""
OPPOSITE = "one multiplier seems to leave the unit circle there while another one enters"
AS_NEAR = 10.0
"""At a fold of several multipliers they are 1 to so many times what the nearest one is off by."""
LOOSELY = 1e3
"""A fold at which the parameter stands still is where a multiplier is 1 to so many tolerances of that: its parameter
is second order in them."""


class Passed(NamedTuple, Generic[AnyOrbit]):
    """What was located, in the order of the walk, and what is there and was not."""

    special: tuple[SpecialPoint[AnyOrbit], ...] = ()
    missed: tuple[Missed, ...] = ()

    def and_(self, other: Passed[AnyOrbit]) -> Passed[AnyOrbit]:
        """Both."""
        return Passed(self.special + other.special, self.missed + other.missed)


class Crossings(Generic[AnyOrbit]):
    """The special points of a branch whose orbits come one by one, from its first orbit `start` on.

    inside: steps are looked at inside; at_kinks: it is located where phases come or go between which the field has a
    kink and no more, else it is said.
    """

    def __init__(
        self, start: AnyOrbit, *, vary: str, monitors: Sequence[Monitor], options: Options, inside: bool = True,
        at_kinks: bool = True,
    ) -> None:  # fmt: skip
        self._vary, self._monitors, self._options = vary, tuple(monitors), options
        self._each = {m.kind: m.each(start) or (m,) for m in monitors if m is not GRAZING}
        self._steps: Inside[AnyOrbit] = Inside(vary, options, self._each)
        self._halvings = LOOKED_INSIDE if inside else 0
        self._counts = COUNTED <= self._each.keys() and not {FLIP.kind, SYMMETRY_LOST.kind}.isdisjoint(self._each)
        self._start: AnyOrbit = start
        self.at_kinks = at_kinks
        self._line: list[Station[AnyOrbit]] = []
        self._looked, self._found = 0, list[Passed[AnyOrbit]]()  # the last station before which all is known; what is
        self._ahead = ORBITS_AHEAD if any(monitor.by_multipliers for monitor in monitors) else 1
        self._signs: Signs[AnyOrbit] = Signs()

    def past(self, after: AnyOrbit) -> Passed[AnyOrbit]:
        """What lies in the steps before the one that leads to `after`; it is looked for in several steps at once."""
        self._arrive(after)
        x, y = (station.point.row[-1] for station in self._line[-3:-1]) if len(self._line) > 2 else (0.0, 0.0)
        if len(self._line) - 2 - self._looked >= self._ahead or x * y < 0:  # a fold, which may be the end
            self._look_up_to(len(self._line) - 2)
            del self._line[: max(self._looked - 1, 0)]
            self._looked = min(self._looked, 1)
        return self._so_far()

    def _look_up_to(self, last: int) -> None:
        """Look at all steps up to a station; the multipliers of all of them are computed in batches."""
        if self._ahead > 1:
            know_multipliers([station.orbit for station in self._line])
        for k in range(self._looked + 1, last + 1):
            signs = self._signs.copy()
            try:
                self._found.append(self._step(k))
            except effort.OutOfTime:
                self._signs = signs  # as if nobody had begun with this step
                raise
            self._looked = k

    def in_haste(self, last: AnyOrbit) -> Passed[AnyOrbit]:
        """What lies in all steps up to the last orbit, none of which is looked at inside any more; as `rest`."""
        self._halvings = 0
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
            self._line.append(Station(self._start, here, 0.0, True))
        else:
            last = self._line[-1]
            there = arrived(last.orbit, after, self._vary)
        length = float(np.linalg.norm(secant_direction(self._line[-1].orbit, after, self._vary)))
        self._line.append(Station(after, there, self._line[-1].at + length))

    @property
    def known(self) -> AnyOrbit:
        """The last orbit before which all is known."""
        return self._line[self._looked].orbit if self._line else self._start

    @property
    def point(self) -> CurvePoint | None:
        """The curve at the last orbit, oriented along the walk; None where nothing lies before that."""
        return self._line[-1].point if self._line else None

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
        for key, (station, value) in tuple(last.items()):
            if not same:  # multipliers may jump there, and the parameter turns round without a fold
                del last[key]
            elif station.orbit is self._start:
                last[key] = station._replace(orbit=orbit), value
        if not same:
            self._signs.owed = self._signs.folds = 0
        self._start, self._line = orbit, []

    def unresolved(self) -> tuple[Missed, ...]:
        """What the branch has passed of which its end leaves open what it is; after `rest`."""
        return tuple(
            self._not_located(
                BRANCH_POINT.kind, change.before, change.after, "a multiplier passes +1 there while the parameter "
                "stands still to rounding: whether it turns round was not seen",
            )
            for change in self._signs.pending
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
        stations = [before, *self._steps.stations(before, after, earlier, later, self._halvings), after]
        passed = [self._passed(x, y, self._halvings) for x, y in pairwise(stations)]
        for found in passed:
            special += found.special
            missed += found.missed
        line = [s for s in (earlier, *stations, later) if s is not None]
        for i, j in ((i, i + k) for i in range(len(passed)) for k in (1, 2) if i + k <= len(passed)):
            if not any(map(any, passed[i:j])) and self._steps.opposite(line, stations[i], stations[j]):
                missed.append(self._not_located("change of stability", stations[i], stations[j], OPPOSITE))
        special = in_order(special, before.orbit, after.orbit, self._vary, self._monitors, self._options.tol)
        return Passed(tuple(replace(one, behind=before.orbit) for one in special), tuple(missed))

    def _passed(self, x: Station[AnyOrbit], y: Station[AnyOrbit], halvings: int) -> Passed[AnyOrbit]:
        """What lies between two stations; in halves, where that does not explain how multipliers have moved."""
        signs, found = self._signs.copy(), Passed[AnyOrbit]()
        for kind, monitors in self._each.items():
            if kind == FOLD.kind:
                found = found.and_(self._turned(monitors[0], x, y))
            elif kind != BRANCH_POINT.kind:
                found = found.and_(self._changed(monitors, x, y))
        if not self._counts or self._signs.pending or not (self._signs.owed or self._hidden_fold(y)):
            return found
        if x.orbit.signature != y.orbit.signature and not apart_by_kinks(x.orbit, y.orbit):
            self._signs.owed = self._signs.folds = 0  # multipliers may jump there
            return found
        if (middle := self._steps.middle(x, y) if halvings else None) is not None:
            self._signs = signs
            return self._passed(x, middle, halvings - 1).and_(self._passed(middle, y, halvings - 1))
        why = "as many multipliers as lie outside the unit circle there or here do not add up with what was located"
        one = self._not_located("change of stability", x, y, f"{why}; smaller steps may show it")
        self._signs.owed = self._signs.folds = 0
        return found.and_(Passed((), (one,)))

    def _hidden_fold(self, y: Station[AnyOrbit]) -> bool:
        """Whether the parameter has turned without a multiplier having passed +1, all of which are known at y."""
        ranks = self._each.get(BRANCH_POINT.kind, ())
        return bool(self._signs.folds) and all(np.isfinite(self._steps.value(rank, y)) for rank in ranks)

    def _changes(
        self, monitors: Sequence[Monitor], x: Station[AnyOrbit], y: Station[AnyOrbit]
    ) -> list[Change[AnyOrbit]]:
        """Where monitors of one kind have another sign at y than at the last station where it was sure."""
        last, found = self._signs.last, []
        for k, monitor in enumerate(monitors):
            key = monitor.kind, k
            if key not in last and np.isfinite(first := self._steps.value(monitor, x)):
                last[key] = x, first
            value = self._steps.value(monitor, y)
            if np.isnan(value):
                continue
            before, was = last.get(key, (y, value))
            last[key] = y, value
            if was * value < 0:
                found.append(Change(monitor, before, y, 1 if value > 0 else -1))
        return found

    def _changed(self, monitors: Sequence[Monitor], x: Station[AnyOrbit], y: Station[AnyOrbit]) -> Passed[AnyOrbit]:
        """The points at which monitors of one kind change their sign up to y."""
        changes = self._changes(monitors, x, y)
        if monitors[0].kind == NEIMARK_SACKER.kind:  # of all that leave the circle
            self._signs.owed += sum(change.sign for change in changes)
        return self._located_of(
            [one for one in changes if one.monitor.confirmed(one.before.orbit) or one.monitor.confirmed(y.orbit)]
        )

    def _located_of(self, changes: Sequence[Change[AnyOrbit]]) -> Passed[AnyOrbit]:
        """The points of some changes of one kind, of which those are one that vanish at one orbit."""
        passed, left = Passed[AnyOrbit](), list(changes)
        while left:
            first = left[0]
            located = self._locate(first.monitor, first.before, first.after)
            if located is None:
                self._signs.owed -= first.sign if first.monitor.by_multipliers else 0
                passed, left = passed.and_(self._lost(first.monitor, first.before, first.after)), left[1:]
                continue
            if not first.monitor.confirmed(located.orbit):
                left = left[1:]
                continue
            together = self._together(first, located.orbit)
            left = [one for one in left[1:] if one.monitor not in together]
            at_once = sum(one.confirmed(located.orbit) for one in together)
            self._signs.owed -= first.sign * at_once if first.monitor.by_multipliers else 0
            many = at_once // (2 if first.monitor.kind == NEIMARK_SACKER.kind else 1)
            passed = passed.and_(Passed((self._special(first.monitor, located, many),)))
        return passed

    def _together(self, change: Change[AnyOrbit], orbit: AnyOrbit) -> list[Monitor]:
        """The monitors of the same kind that vanish where the one of a change does."""
        ranks, point = self._each[change.monitor.kind], change.after.point
        if len(ranks) == 1:
            return [change.monitor]
        f = change.monitor.value(orbit, point)
        near = ACCEPTED_TOLERANCES * change.monitor.tolerance + 2 * change.monitor.noise(orbit)
        return [one for one in ranks if abs(one.value(orbit, point) - f) <= near]

    def _locate(
        self, monitor: Monitor, before: Station[AnyOrbit], after: Station[AnyOrbit]
    ) -> Located[AnyOrbit] | None:
        return locate_special_point(before.orbit, after.orbit, monitor, vary=self._vary, options=self._options)

    def _special(self, monitor: Monitor, located: Located[AnyOrbit], many: int) -> SpecialPoint[AnyOrbit]:
        error = max(located.error, located.orbit.parameter_error) if located.error else 0.0
        return special_point(monitor, located.orbit, self._vary, error, at=located.at, multiplicity=max(many, 1))

    def _lost(self, monitor: Monitor, before: Station[AnyOrbit], after: Station[AnyOrbit]) -> Passed[AnyOrbit]:
        jumps = not apart_by_kinks(before.orbit, after.orbit) and before.orbit.signature != after.orbit.signature
        if jumps and GRAZING in self._monitors:
            return Passed()  # multipliers may jump where the phases change, and that is located
        return Passed((), (self._not_located(monitor.kind, before, after),))

    def _turned(self, monitor: Monitor, x: Station[AnyOrbit], y: Station[AnyOrbit]) -> Passed[AnyOrbit]:
        """The fold, or the branch points, up to y."""
        for one in self._changes(self._each.get(BRANCH_POINT.kind, ()), x, y):
            if self._signs.folds:  # it is that of a fold before, next to which it was not known
                self._signs.folds -= 1
                self._signs.owed -= one.sign
            elif one.monitor.confirmed(one.before.orbit) or one.monitor.confirmed(y.orbit):
                self._signs.pending.append(one)
        turned = self._changes((monitor,), x, y)
        if np.isnan(self._steps.value(monitor, y)):
            return Passed()
        steps, self._signs.pending = self._signs.pending, []
        return self._fold(monitor, turned[0].before, y, steps) if turned else self._located_of(steps)

    def _fold(
        self, monitor: Monitor, before: Station[AnyOrbit], after: Station[AnyOrbit], steps: list[Change[AnyOrbit]]
    ) -> Passed[AnyOrbit]:
        """The fold between two stations, multipliers having passed +1 in some steps between them."""
        located, vary = None, self._vary
        if len(steps) == 1 and (steps[0].before, steps[0].after) != (before, after):
            one = steps[0].monitor
            loosely = replace(one, tolerance=LOOSELY * one.tolerance, multiplier=math.nan)
            located = self._locate(loosely, steps[0].before, steps[0].after)
        located = located or self._locate(monitor, before, after)
        orbit = None if located is None else located.orbit
        width = abs(before.orbit.problem.distance(vary, parameter_value(after.orbit, vary)))
        if orbit is None and width <= self._options.tol:
            # Too sharp to be resolved in arclength, but the two sides of it agree in the parameter.
            sense = before.point.row[-1]
            orbit = max(before.orbit, after.orbit, key=lambda o: sense * parameter_value(o, vary))
        own, others = self._of_the_fold(orbit, steps)
        self._signs.folds += not own and BRANCH_POINT.kind in self._each
        self._signs.owed -= sum(one.sign for one in own)
        special = () if orbit is None else (special_point(monitor, orbit, vary, multiplicity=max(len(own), 1)),)
        missed = () if special else (self._not_located(monitor.kind, before, after),)
        return Passed(special, missed).and_(self._located_of(others))

    def _of_the_fold(
        self, orbit: AnyOrbit | None, steps: list[Change[AnyOrbit]]
    ) -> tuple[list[Change[AnyOrbit]], list[Change[AnyOrbit]]]:
        """The multipliers that are 1 at a fold, of those that have passed it, and the others."""
        if orbit is None or len(steps) < 2:
            return steps, []
        values = np.abs([one.monitor.value(orbit, one.after.point) for one in steps])
        own = values <= AS_NEAR * np.min(values) + ACCEPTED_TOLERANCES * steps[0].monitor.tolerance
        return [s for s, o in zip(steps, own, strict=True) if o], [s for s, o in zip(steps, own, strict=True) if not o]

    def _not_located(self, kind: str, before: Station[AnyOrbit], after: Station[AnyOrbit], why: str = "") -> Missed:
        why = why or "the steps towards it did not converge; another tolerance may lead there"
        return Missed(kind, f"a {kind} {self._between(before, after)} was not located: {why}")

    def _between(self, before: Station[AnyOrbit], after: Station[AnyOrbit]) -> str:
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
