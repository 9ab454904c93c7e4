"""Marching by power series: a mode followed to its exit in steps of high order (series.py), then cut into intervals.

    expand at x    step as far as the series reaches    watch the events along it    expand at its end

Nothing is solved for: a step costs one compiled call and a product of matrices, and an event is a root of a function of
the place in the step.  The last terms of a step are bounded by `SERIES_TOLERANCE` of the tolerance of the intervals, so
that its end is as much better than these as the end of an interval of collocation is.

A series that has not seen what comes (a drop that is hidden where it begins) contradicts the field there: wherever a
step is looked at, its rate is compared with that of the field, and of a step that is wrong anywhere only a part is kept
that is right everywhere.

Where the field has no series, coefficients are no numbers, or steps are much shorter than an interval of collocation
would be (a stiff mode), the rest of the phase is left to intervals (march.py).  That is found by trying one, at steps
32, 64, 128, ... of a phase.

Symbols: n states, P order.
"""

from __future__ import annotations

import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from .. import effort
from ..collocation.admissibility import hides
from ..collocation.scheme import Scheme
from ..collocation.successors import at_speed
from ..hybrid.system import Exit, VectorMode
from ..roots import LOOKED_AT, MOST_HALVINGS, Bracket
from .march_exits import EVENT_TOLERANCE, EXIT_ROUNDING
from .march_step import ExtrapolatedStages, Stepper
from .march_watch import EVENT_LIMIT, ON_EVENT
from .series import Piece, Series, cut_off, looked_at, meshed, most_in_a_step, series_value

Array = np.ndarray

SERIES_TOLERANCE, LEAST_TERM = 1e-4, 1e-17
"""Bound of the last terms in units of the tolerance; and at least, in units of the states."""
MISMATCH, LEAST_MISMATCH = 1e3, 1e-9
"""Difference of the rates of a series and of the field, times the step, in units of the bound of the last terms; and at
least, in units of the states."""
JUST_BEHIND = 1e-6
"""Part of a step after which it is seen to which side an event is left."""
NO_PARABOLA, PARABOLA_OFF = 0.25, 0.1
"""A top between two looks is looked for where the parabola through them leaves less than this part of the way to zero,
or than it may be off, as a part of the second difference: the middle one of three may be all but there."""
INNER_PART, TOP_SECTIONS, TOP_PARABOLAS = 0.5 * (5**0.5 - 1), 12, 2
"""Golden section; so many of them leave 3e-3 of the place between two looks at which an event may come to zero, and so
many parabolas through what is left and a tenth of it leave rounding of its height."""
VAINLY_IN_A_ROW, BESIDE_ITS_ZERO = 2, 1e-9
"""After so many steps that leave more of an event which all but vanishes, what is left is rounding, where its sign
changes within this part of the step."""
FIRST_TRIAL, STIFF = 32, 100.0
"""Steps of a phase before an interval is tried; length of that interval, in steps, which shows that the mode is stiff
where it is resolved."""


class Reached(NamedTuple):
    """How far a mode was followed.

    Attributes
    ----------
    time, x : time in the mode; (n,) scaled state then.
    way_out : the exit there; None: the time is over, or it is to be followed further by intervals.
    over : nothing is left to be followed.
    length : of the last step; what intervals begin with.
    """

    time: float
    x: Array
    way_out: Exit | None
    over: bool
    length: float


class NotLocated(Exception):
    """An event that is crossed in a step, whose number this is, and vanishes nowhere in it."""

    def __init__(self, step: int) -> None:
        super().__init__(step)
        self.step = step


@dataclass
class Following:
    """A mode that is being followed; the attributes below `passes` change on the way.

    Attributes
    ----------
    mode, exits, stepper, series : the mode: its exits, its intervals, its series.
    x : (n,) scaled state.
    tol, max_time, most : tolerance of intervals; time after which it ends; steps after which the rest is left to
        intervals.
    passes : whether the mode goes on through an exit at a scaled state.
    stretches : steps so far, in stretches from one exit that was passed to the next.
    t, h : time in the mode; length of the last step.
    longest : that the next step may be.
    fresh : the next step may begin on an event.
    taken, trial : steps so far; after so many an interval is tried.
    """

    mode: VectorMode
    exits: tuple[Exit, ...]
    stepper: Stepper
    series: Series
    x: Array
    tol: float
    max_time: float
    most: int
    passes: Callable[[Exit, Array], bool]
    stretches: list[list[Piece]] = field(default_factory=lambda: [[]])
    t: float = 0.0
    h: float = 1.0
    longest: float = np.inf
    fresh: bool = True
    taken: int = 0
    trial: int = FIRST_TRIAL

    def run(self) -> Reached:
        """To its exit, or as far as series lead."""
        while not self._is_over(self.t):  # beyond, it is at rest for ever, or as good as
            if self.taken >= self.trial:
                if self.taken >= self.most or _is_stiff(self.stepper, self.x, self.h, self.tol):
                    return self._reached(None, False)
                self.trial *= 2
            effort.interval()
            end = self._further()
            if end is not None:
                return end
        return self._reached(None, True)

    def _is_over(self, times: Any) -> Any:
        """Whether there is no time left but for rounding."""
        return times >= self.max_time * (1 - 1e-15)

    def _reached(self, way_out: Exit | None, over: bool) -> Reached:
        """Where it is."""
        return Reached(self.t, self.x, way_out, over, self.h if self.taken else 0.0)

    def _further(self) -> Reached | None:
        """Some steps more; where they end the phase, or series lead no further, how far it was followed."""
        theta = max(SERIES_TOLERANCE * self.tol, LEAST_TERM)
        steps = self.series(self.x, self.h, self.longest, min(self.max_time - self.t, sys.float_info.max), theta)
        began = self.t + np.concatenate([[0.0], np.cumsum(steps.h)])
        known = _count(~np.isfinite(steps.ends).all(axis=1) | ~(steps.h > 0))
        points, rates = looked_at(steps.C[:known])
        right = _right(self.series, steps.h[:known], points, rates, theta)
        j, s, way_out, lost = right, 1.0, None, False
        if right and self.exits:
            try:
                fresh = self.mode if self.fresh else None
                found = first_exit(
                    self.exits, self.stepper, steps.C[:right], points[:right], fresh, self._is_over(began[right])
                )
                j, s, way_out = found
            except NotLocated as refusal:
                j, lost = refusal.step, True
        if j:
            self._append(began[:j], steps.h[:j], steps.C[:j])
            self.t, self.x = float(began[j]), steps.ends[j - 1]
        self.longest = np.inf
        if way_out is not None and _is_right(self.series, cut_off(steps.C[j], s), s * float(steps.h[j]), theta):
            return self._through(way_out, cut_off(steps.C[j], s), s * float(steps.h[j]))
        if lost or j == known < len(steps.h) and not self._is_over(self.t):
            return self._reached(None, False)
        if j < known:  # it is not what the field says: taken again, and less of it
            left = s * float(steps.h[j])
            self.h = self.longest = left * _right_part(self.series, cut_off(steps.C[j], s), left, theta)
            if self.h == 0:  # no part of it is right
                return self._reached(None, False)
        return None

    def _append(self, began: Array, lengths: Array, C: Array) -> None:
        """Steps that are right."""
        self.stretches[-1].append(Piece(began, lengths, C))
        self.taken, self.h, self.fresh = self.taken + len(lengths), float(lengths[-1]), False

    def _through(self, way_out: Exit, C: Array, h: float) -> Reached | None:
        """A step that ends on an exit; where that ends the phase, where it is."""
        self._append(np.array([self.t]), np.array([h]), C[None])
        self.t, self.x, self.fresh = self.t + h, C.sum(axis=0), True
        if not self.passes(way_out, self.x):
            return self._reached(way_out, True)
        self.stretches.append([])
        return None


def _count(bad: Array) -> int:
    """How many there are before the first that is bad."""
    return int(np.argmax(bad)) if bad.any() else len(bad)


def _right(series: Series, h: Array, points: Array, rates: Array, theta: float) -> int:
    """How many steps (K, looks, n) agree with the field wherever they are looked at and it is a number."""
    off = series.defects(points, rates / h[:, None, None]) * h[:, None]
    size = np.maximum(1.0, np.max(np.abs(points), axis=(1, 2)))
    return _count(np.any(off > MISMATCH * theta + LEAST_MISMATCH * size[:, None], axis=1))


def _is_right(series: Series, C: Array, h: float, theta: float) -> bool:
    """The same of one step, with the looks nearer to each other where it is a part of a longer one."""
    return _right(series, np.array([h]), *looked_at(C[None]), theta) == 1


def _right_part(series: Series, C: Array, h: float, theta: float) -> float:
    """The part of a step, 1 - 2^-k or else 2^-k, that is right although the whole of it is not; 0 for none."""

    def right(part: float) -> bool:
        return _is_right(series, cut_off(C, part), part * h, theta)

    k = next(k for k in range(1, MOST_HALVINGS + 1) if k == MOST_HALVINGS or not right(1 - 0.5**k))
    if k > 1:
        return 1 - 0.5 ** (k - 1)
    return next((0.5**k for k in range(2, MOST_HALVINGS) if right(0.5**k)), 0.0)


def _is_stiff(stepper: Stepper, x: Array, h: float, tol: float) -> bool:
    """Whether an interval of so many steps is resolved."""
    solved = stepper(x, ExtrapolatedStages(x), STIFF * h, tol)
    return solved is not None and solved.error <= tol


def first_exit(
    exits: tuple[Exit, ...], stepper: Stepper, C: Array, points: Array, fresh: VectorMode | None, over: bool
) -> tuple[int, float, Exit | None]:
    """The first exit of steps in a row.

    C, points: (K, P + 1, n) coefficients of the steps; (K, looks, n) states at which they are looked at;
    fresh: the mode, where the first step may begin on an event: to which side this is left is seen just behind it, or
    told by its rate where the motion is back by then; over: at the end of the last one the time is over, and an event
    is met that the motion comes to there but for rounding.
    Returns number of the step, place 0 < s <= 1 in it, and exit; the number of steps, 1 and None where there is none.
    Raises NotLocated: an event is crossed, and vanishes nowhere.
    """
    inner = points[:, :-1].reshape(-1, points.shape[2])
    looks, parts = len(inner) + 1, LOOKED_AT.size - 1
    states = (
        np.vstack([inner, points[-1, -1], *([series_value(C[0], JUST_BEHIND)] if fresh is not None else [])]).T
        * stepper.scale[:, None]
    )
    best: Exit | None = None
    first, place = looks - 1, 1.0
    for way_out in exits:
        h = way_out.direction * np.asarray(way_out.event.function(states, 0.0, stepper.p), float)
        inside = h[: looks - 1] < 0
        if fresh is not None and abs(h[0]) <= ON_EVENT:
            begins = float(h[looks]) - h[0]
            inside[0] = begins < 0 if begins != 0 else h[1] < 0
            if not inside[0]:
                inside[0] = at_speed(fresh, way_out.event, -way_out.direction, states[:, 0], stepper.p)
        if over and -ON_EVENT <= h[looks - 1] < 0 and h[looks - 2] < h[looks - 1]:
            h[looks - 1] = 0.0
        crossed = np.flatnonzero(inside & (h[1:looks] >= 0))
        between = _passed_between(way_out, stepper, C, h[:looks], int(crossed[0]) if crossed.size else looks - 1)
        if between is None and (not crossed.size or crossed[0] > first):
            continue
        k, f_high, high = between or (int(crossed[0]), float(h[crossed[0] + 1]), None)
        if k > first:
            continue
        low, f_low = (k % parts) / parts, float(h[k])
        if k == 0 and fresh is not None and abs(f_low) <= ON_EVENT:  # the zero that it begins on is none to come
            value = partial(_event_at, way_out, stepper, C[0])
            low = next((s for s in JUST_BEHIND * 0.5 ** np.arange(MOST_HALVINGS) if value(s) < 0), 0.0)
            f_low = value(low)
        s = _root(way_out, stepper, C[k // parts], low, f_low, f_high, high)
        if s is None:
            raise NotLocated(k // parts)
        if k < first or best is None or s < place:
            best, first, place = way_out, k, s
    return (first // parts, place, best) if best is not None else ((looks - 1) // parts, 1.0, None)


def _passed_between(
    way_out: Exit, stepper: Stepper, C: Array, h: Array, before: int
) -> tuple[int, float, float] | None:
    """Where an event is passed and passed back between looks: (look, value at a place behind it, place); or None.

    h, before: the event at the looks; no more than so many of these are asked for.  A top of it whose parabola all but
    comes to zero is looked for in the series.
    """
    if before < 2:
        return None
    left, mid, right = h[: before - 1], h[1:before], h[2 : before + 1]
    bend = left - 2 * mid + right
    tops = (mid < 0) & (mid >= left) & (mid >= right) & (bend < 0)
    if not tops.any():
        return None
    parts = LOOKED_AT.size - 1
    for i in np.flatnonzero(tops):
        if mid[i] - (right[i] - left[i]) ** 2 / (8 * bend[i]) < min(NO_PARABOLA * mid[i], PARABOLA_OFF * bend[i]):
            continue
        for k in (i, i + 1):  # between this look and the next
            value = partial(_event_at, way_out, stepper, C[k // parts])
            low = (k % parts) / parts
            highest, place = _highest(value, low, low + LOOKED_AT[1])
            if highest > 0:
                return int(k), highest, place
    return None


def _highest(value: Callable[[float], float], low: float, high: float) -> tuple[float, float]:
    """(the largest value found between two places, or the first above zero; where), by golden sections."""
    a, b = high - INNER_PART * (high - low), low + INNER_PART * (high - low)
    f_a, f_b = value(a), value(b)
    for _ in range(TOP_SECTIONS):
        if max(f_a, f_b) > 0:
            break
        if f_a > f_b:
            high, b, f_b = b, a, f_a
            a = high - INNER_PART * (high - low)
            f_a = value(a)
        else:
            low, a, f_a = a, b, f_b
            b = low + INNER_PART * (high - low)
            f_b = value(b)
    best = max((f_a, a), (f_b, b))
    half = (high - low) / 2
    for _ in range(TOP_PARABOLAS):
        if best[0] > 0:
            break
        left, right = value(best[1] - half), value(best[1] + half)
        bend = left - 2 * best[0] + right
        if bend < 0:
            top = best[1] + half * min(max((left - right) / (2 * bend), -1.0), 1.0)
            best = max(best, (value(top), top))
        half /= 10
    return best


def _event_at(way_out: Exit, stepper: Stepper, C: Array, s: float) -> float:
    """The event of a way out at a place of a step, counted along its direction."""
    state = series_value(C, s) * stepper.scale
    return way_out.direction * float(way_out.event.function(state, 0.0, stepper.p))


def _root(
    way_out: Exit, stepper: Stepper, C: Array, low: float, f_low: float, f_high: float, high: float | None = None
) -> float | None:
    """The place between two looks where an event vanishes; None where it does not, as one that is no number."""
    value = partial(_event_at, way_out, stepper, C)

    size = max(-min(f_low, 0.0), f_high, stepper.scale_of(way_out))
    tolerance = max(EVENT_TOLERANCE, EXIT_ROUNDING * size)
    high = LOOKED_AT[LOOKED_AT > low][0] if high is None else high
    if f_high == 0:
        return high if abs(value(high)) <= EVENT_LIMIT else None
    bracket = Bracket(low, f_low if f_low < 0 else -np.inf, high, f_high)
    s, best, left, worse = bracket.illinois, high, np.inf, 0
    for _ in range(MOST_HALVINGS):
        f = value(s)
        if np.isnan(f):
            return None
        worse += left <= tolerance and abs(f) >= left
        if abs(f) < left:
            best, left = s, abs(f)
        if f == 0 or bracket.width < 1e-15:
            break
        if worse == VAINLY_IN_A_ROW and value(best - BESIDE_ITS_ZERO) < 0 < value(best + BESIDE_ITS_ZERO):
            break
        bracket = bracket.told(s, f)
        s = bracket.illinois if worse < VAINLY_IN_A_ROW else bracket.middle  # of one that all but stands
    return best if left <= EVENT_LIMIT else None


def intervals_of(
    mode: VectorMode, stepper: Stepper, stretches: list[list[Piece]], tol: float, most: float = np.inf
) -> tuple[list[float], list[Array]]:
    """The intervals of a motion that was followed by series.

    stretches: what was followed; a node stands where one ends; tol, most: last Legendre coefficient of an interval; how
    many there may be. Returns lengths, and (R,) start and stages of each, scaled. Raises TooMany: more than `most` are
    needed.
    """

    def hidden(states: Array) -> Array:
        if mode.feature is None:
            return np.zeros(len(states), bool)
        return hides(mode.feature, states * stepper.scale, stepper.p)

    lengths: list[float] = []
    pieces: list[Array] = []
    for stretch in stretches:
        if stretch:
            breaks, w = meshed(stretch, stepper.scheme, tol, hidden, most - len(lengths))
            lengths += [float(h) for h in np.diff(breaks)]
            pieces += list(w)
    return lengths, pieces


def most_intervals(stretches: list[list[Piece]], s: Scheme, tol: float) -> float:
    """A bound of the number of these intervals, but for those that hide something of the field.

    stretches, s, tol: what was followed; the scheme; last Legendre coefficient of an interval.
    Returns steps times intervals in a step of which no term exceeds the size of the states.
    """
    pieces = [piece for stretch in stretches for piece in stretch]
    size = max([1.0, *(float(np.abs(piece.C[:, 0]).max()) for piece in pieces)])
    return sum(len(piece.lengths) for piece in pieces) * most_in_a_step(s.degree, tol / size) + len(stretches)
