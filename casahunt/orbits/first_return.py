"""Where a motion first comes back to where it began: the guess of a cycle next to given states, stable or not.

    off(t) = S x(t) - c - x,    |off(t)| < 0.6 min(1, how far it has been away),    S = 1, or a symmetry of the motion

A motion that begins next to an unstable cycle is away from it within a turn, but once round it is still a guess: the
equations of the cycle correct the start by -(M - 1)^-1 off, M being its return map, and the rest of the turn with it.
So what comes back is taken from ever so far, and how far the cycle lies from the start is told.  The motion is followed
on for as long again, since one of two turns passes near its start after the first.  Lengths are largest differences of
states, in units of their sizes in the motion so far; the part of off(t) along the motion is only time.

Next to one whose disturbances grow a hundredfold no first return need be near.  But what the motion has done from its
first event to where that, or its image, comes again solves the equations of a cycle with another closure,

    x(start) = S x(end) - c - s gap,    s = 1 -> 0

and s leads to the cycle, step by step, as long as the start stays near.

Of a motion that meets events the last phase, which ends where it has come back, and the first, which began there, are
parts of one phase of the cycle.  One that meets none is cut at the state that moves the fastest, or by turns.

Symbols: n states, m points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from itertools import count, product
from typing import Any, NamedTuple

import numpy as np

from ..collocation.admissibility import MOVES_BELOW
from ..collocation.interval import field_at
from ..collocation.scheme import scheme
from ..hybrid import system as engine
from ..hybrid.language import System
from ..hybrid.problem import Kind
from ..motion.phases import MarchFailure, Segment, march
from ..motion.segment import NoEnd
from ..motion.simulation import MARCH_DEGREE, sampled
from .closure import MAY_BE_ROUNDING, Closure, Section, sizes_of, turned, turns
from .recurrence import TRIED, image_of, symmetries, turns_over
from .sequences import joined_phases, later
from .watching import SEARCH_TOLERANCE, Turning, going_on, longest_look

Array = np.ndarray

TRIED_WITHIN, SURELY_BACK = 0.6, 0.3
"""What comes back so near is tried, as part of how far it has been away, and in units of the sizes of the states: with
0.3 fewer starts lead to their cycle, with 1 hardly more (tests/orbits/test_first_return.py).  And what is as near as
ends the search in time."""
AS_LONG, A_NEARER_ONE, BACK = 2.1, 0.5, 1e-3
"""A motion that is surely back is followed until it has taken so many times as long, for a return that is nearer by
this factor; not where it is so near."""
EVENTS_ROUND = 6
"""Events within which a motion that does not come back near may have been round."""
STATES_OF_AN_INTERVAL = 8
"""Points of an interval at which it is seen how far the motion is from its start."""
PHASES_AT_MOST, TURNS_AT_MOST, INTERVALS_AT_MOST = 100, 12, 5000
"""Phases, turns (of what goes round, or through the plane of the start) and intervals after which it is not expected
back."""
IN_TIME = 0.999
"""Part of the time up to which a motion was followed that meets no event, in which it is looked at."""
OF_A_TURN = 1e-9
"""Part of a turn that is rounding."""


class Return(NamedTuple):
    """A motion is back: when, after so many events and a time behind the last of them; S and c; how near, by sizes."""

    time: float
    events: int
    left: float
    mode: str
    closure: Closure
    distance: float


class Guess(NamedTuple):
    """The phases of a motion that closes but for a distance; planes that cut it, what is counted; (n,) sizes."""

    passes: list[Segment]
    closure: Closure
    distance: float
    sections: tuple[Section, ...]
    turning: Turning | None
    scale: Array


@dataclass(kw_only=True)
class FirstReturn:
    """The motion from x (n,) in a mode, its angles and time within their first turn; what is below `kind` grows."""

    system: System
    p: Array
    mode: str
    x: Array
    kind: Kind
    returns: list[Return] = field(default_factory=list)
    nearest: float = np.inf
    seen: list[tuple[Segment, Array, Array]] = field(default_factory=list)
    images: dict[tuple[str, str, Closure], tuple[str, str] | None] = field(default_factory=dict)

    def __post_init__(self) -> None:
        self.form, turn = self.system.vector_form, turns(self.system)
        self.span, self.scale = longest_look(self.system, self.mode, self.x, self.p, self.kind)
        mode = self.form.modes[self.mode]
        rate = field_at(mode.field, self.x / self.scale, mode.sign, self.p, self.scale)
        self.rate, swings = self.scale * rate, np.where(turn > 0, 0.0, np.abs(rate))
        forced = self.system.forcing_period is not None
        self.cut = self.x.size - 1 if forced else int(np.argmax(swings if swings.max() > MOVES_BELOW else np.abs(rate)))
        self.step = float(np.copysign(turn[self.cut], rate[self.cut])) if turn[self.cut] else 0.0
        self.way = 0 if rate[self.cut] > 0 else 1

    @property
    def followed(self) -> float:
        """For how long."""
        return sum(segment.duration for segment, _, _ in self.seen)

    def guesses(self) -> Iterator[Guess]:
        """Starting points, the most promising one first.  Raises MarchFailure: the motion cannot be followed."""
        stops = [self._exits(plane)[self.way] for plane in self._planes(self.step, TURNS_AT_MOST if self.step else 1)]
        try:
            # A plane through a start that lies on an event would be met together with that.
            if self.system.mode(self.mode).ends:
                self._follow([])
            if not any(segment.event for segment, *_ in self.seen):
                self.seen = []
                self._follow(stops)
        except MarchFailure:
            if not self.returns:
                raise
        for r in sorted(self.returns, key=lambda r: r.distance):
            guess = self._phases(r) if r.events else self._cut(r)
            if guess is not None:
                yield guess

    def by_events(self) -> Iterator[Guess]:
        """The motion from its first event to where that or its image comes again, so far from there as it may be.

        The shift of its closure has the gap in it; its distance is zero.
        """
        met = [segment for segment, *_ in self.seen if self.form.ways_out(segment.mode, segment.event)]
        ways = [(1, np.eye(self.x.size)), *((2, S) for S in symmetries(self.system))]
        for last, (repeats, S) in product(range(1, min(len(met), EVENTS_ROUND + 1)), ways):
            begin, end = met[0].behind, S @ met[last].behind
            closure = Closure.of(S, turned(self.system, begin, end, parts=repeats), repeats)
            names = (met[0].mode, met[0].event)
            if repeats > 1:
                names = image_of(self.form, met[0], closure, self.p, self.scale) or ("", "")
            if (met[last].mode, met[last].event) == names:
                gap = replace(closure, shift=tuple((end - begin).tolist()))
                yield Guess(met[1 : last + 1], gap, 0.0, (), None, self.scale)

    def _follow(self, stops: list[engine.Exit]) -> None:
        """The motion until it is back, with planes at which it is looked at; what of it meets no event, in the end."""
        marks = [stop.event.name for stop in stops]

        def until(segment: Segment) -> bool:
            return self._enough(segment, marks)

        try:
            met = self._march(until, stops)
        except NoEnd as ended:  # as where it grows in a finite time beyond all bounds
            if self.seen or not ended.time > 0:
                raise
            met = self._march(until, stops, max_time=IN_TIME * ended.time)
        for segment in met[len(self.seen) :]:
            if segment.duration < np.inf:  # it does not stay for ever
                self._enough(segment, marks)

    def _planes(self, step: float, many: int) -> tuple[Section, ...]:
        """Where a motion without events is cut: so many planes, each a step behind the one before."""
        name, level = self.system.names.entries[self.cut], float(self.x[self.cut])
        size = abs(self.step) or float(self.scale[self.cut])
        return tuple(Section(self.mode, name, level + (k + 1) * step, size) for k in range(many))

    def _exits(self, plane: Section) -> tuple[engine.Exit, ...]:
        return plane.exits(self.form.states)

    def _march(
        self, until: Callable[[Segment], bool], stops: list[engine.Exit] | None = None, mode: str = "",
        x: Array | None = None, **how: Any,
    ) -> list[Segment]:  # fmt: skip
        """The motion from the start, or from x in a mode, with more ways out of the mode in which it starts."""
        form, how = self.form, {"max_time": self.span, "max_intervals": INTERVALS_AT_MOST, **how}
        if stops and form.modes[self.mode].flow is None:
            form = replace(form, exits={**form.exits, self.mode: (*form.exits[self.mode], *stops)})
        return march(
            form, mode or self.mode, self.x if x is None else x, self.p, scale=self.scale, until=until,
            tol=SEARCH_TOLERANCE, degree=MARCH_DEGREE, kind=self.kind, strict=True, **how,
        )  # fmt: skip

    # When it is back ------------------------------------------------------------------------------------------

    def _enough(self, segment: Segment, marks: list[str]) -> bool:
        """Whether the motion was followed for long enough; `returns` are those up to now."""
        times, states = sampled(self.form, [segment], self.p, self.kind, STATES_OF_AN_INTERVAL)
        self.seen.append((segment, times, states.T))
        self.returns = []
        for r in sorted(self._near(marks), key=lambda r: r.time):
            best = self.returns[-1].distance if self.returns else np.inf
            if r.distance < A_NEARER_ONE * best and (r.closure.repeats == 1 or self._mirrored(r)):
                self.returns.append(r)
        last = self.returns[-1] if self.returns else None
        if last is not None and last.distance < SURELY_BACK:
            return last.distance < BACK or self.followed > AS_LONG * last.time
        return len(self.seen) >= PHASES_AT_MOST or sum(each.event in marks for each, *_ in self.seen) >= TURNS_AT_MOST

    def _near(self, marks: list[str]) -> Iterator[Return]:
        """Where the motion is nearest to its start, on each way there: as it is, and mirrored."""
        names = list(self.form.modes)
        events, began, time, places, modes = 0, 0.0, 0.0, [], []
        for segment, times, _ in self.seen:
            places.append(np.stack([time + times, np.full(times.size, events), time + times - began], axis=1))
            modes.append(np.full(times.size, names.index(segment.mode)))
            time += segment.duration
            if segment.event not in marks:
                events, began = events + 1, time
        x, system = np.vstack([states for _, _, states in self.seen]), self.system
        place, mode = np.vstack(places), np.concatenate(modes)
        self.scale = size = sizes_of(system, x, self.scale)
        away = np.max(np.abs(x - turned(system, self.x, x) - self.x) / size, axis=1)
        farthest, along = np.maximum.accumulate(np.where(away > MOVES_BELOW, away, 0.0)), self.rate / size
        self.nearest = float(away[int(np.argmax(away)) :].min())
        for repeats, S in ((1, np.eye(size.size)), *((2, S) for S in symmetries(system))):
            image = x @ S.T
            shift = turned(system, self.x, image, parts=repeats)
            off = (image - shift - self.x) / size
            distance = np.max(np.abs(off), axis=1)
            near = distance < TRIED_WITHIN * np.minimum(1.0, farthest)
            near &= (repeats == 2) | (mode == names.index(self.mode))
            label = np.where(near, mode, -1)
            ends = np.flatnonzero(np.diff(label, prepend=-1, append=-1))
            for first, last in zip(ends[:-1], ends[1:], strict=True):
                i = int(first + np.argmin(distance[first:last]))
                if label[first] >= 0:
                    across = off[i] - along * (along @ off[i]) / (along @ along)
                    closure = Closure.of(S, shift[i], repeats)
                    when, number, left = place[i].tolist()
                    yield Return(when, int(number), left, names[mode[i]], closure, float(np.max(np.abs(across))))

    def _mirrored(self, r: Return) -> bool:
        """Whether the symmetry of a return is one of the motion up to there."""
        if not r.events:
            x = np.vstack([states for _, _, states in self.seen])
            asked = self.system, self.mode, x[:: max(1, len(x) // TRIED)].T, self.p, self.scale
            return self.system.forcing_period is not None and turns_over(*asked)
        images = []
        for phase, _, _ in self.seen[: r.events]:
            label = phase.mode, phase.event, r.closure
            if label not in self.images:
                self.images[label] = image_of(self.form, phase, r.closure, self.p, self.scale)
            images.append(self.images[label])
        return None not in images and (images[0] or ("",))[0] == r.mode

    def backwards(self, segments: Sequence[Segment], closure: Closure) -> Guess:
        """The phases of a cycle of the reversed field, and how it closes, as one phase forwards, to a plane."""
        whole = joined_phases(segments)
        s = scheme(whole.w.shape[1] // self.x.size - 1, self.kind)
        w = whole.w[::-1].reshape(len(whole.w), -1, self.x.size)
        w = np.einsum("kj,ijn->ikn", s.interpolation(1 - s.points), w)
        inverse = np.linalg.inv(np.array(closure.matrix))
        back = Closure.of(inverse, -inverse @ np.array(closure.shift), closure.repeats)
        mode, end = self.form.modes[self.mode], whole.start
        rate = field_at(mode.field, end / self.scale, mode.sign, self.p, self.scale)
        self.cut = int(np.argmax(np.where(turns(self.system) > 0, 0.0, np.abs(rate))))
        level = float(end[self.cut]) if abs(end[self.cut]) > MAY_BE_ROUNDING * self.scale[self.cut] else 0.0
        (plane,) = planes = (replace(self._planes(0.0, 1)[0], level=level),)
        event = self._exits(plane)[0 if rate[self.cut] > 0 else 1].event.name
        passes = [Segment(self.mode, event, whole.duration, 1 - whole.breaks[::-1], w.reshape(len(w), -1), end)]
        return Guess(passes, back, 0.0, planes, None, self.scale)

    # Its phases -----------------------------------------------------------------------------------------------

    def _phases(self, r: Return) -> Guess | None:
        """From event to event, from the first one on; None where the motion is another one with better sizes."""
        ends = count(1)
        met = self._march(lambda _: next(ends) == r.events)
        names = (met[0].mode, met[0].event)
        if r.closure.repeats > 1:
            names = image_of(self.form, met[0], r.closure, self.p, self.scale) or ("", "")
        mode, x = going_on(self.form, met[-1], self.p)
        if len(met) < r.events or mode != names[0]:
            return None
        last = replace(later(r.closure, met[0]), mode=names[0], event=names[1])
        if r.left > 0:
            rest = self._march(lambda _: True, mode=mode, x=x, max_time=r.left, after=met[-1], met=met[-1].event)[0]
            last = joined_phases([rest, last])
        return Guess([*met[1:], last], r.closure, r.distance, (), None, self.scale)

    def _cut(self, r: Return) -> Guess | None:
        """From plane to plane, the first of them through the start; or from turn to turn.

        None where it has left the mode by rounding, an event that it met just behind that time.
        """
        if self.step:
            return self._by_turns(r)
        (plane,) = planes = self._planes(0.0, 1)
        exits = list(self._exits(plane))
        end = exits.pop(self.way).event.name
        *met, last = self._march(lambda _: False, exits, max_time=r.left)
        if last.mode != self.mode:
            return None
        return Guess([*met, replace(last, event=end)], r.closure, r.distance, planes, None, self.scale)

    def _by_turns(self, r: Return) -> Guess | None:
        """The same where turns are counted, from the first that is whole."""
        step, x = self.step / r.closure.repeats, float(self.x[self.cut])
        many, begins = round(r.closure.shift[self.cut] / step), x / step
        whole = abs(begins - round(begins)) < OF_A_TURN
        levels = [(np.floor(begins + OF_A_TURN) + 1 + k) * step for k in range(many)] + [x + many * step] * (not whole)
        if not many:
            return None
        planes = tuple(replace(self._planes(0.0, 1)[0], level=float(level)) for level in levels)
        exits = [self._exits(plane)[self.way] for plane in planes]
        met = self._march(lambda segment: segment.event == exits[-1].event.name, exits)
        if len(met) != len(levels):
            return None
        if not whole:
            met = [*met[1:-1], joined_phases([met[-1], later(r.closure, met[0])])]
        turning = Turning(self.cut, step, r.closure.repeats)
        return Guess(met, r.closure, r.distance, planes[:1], turning, self.scale)


def reversed_in_time(system: System, mode: str) -> System | None:
    """The system in which the motions of a mode without events run backwards; None where it has some, or is forced."""
    forward = system.mode(mode)
    if forward.ends or forward.field is None or system.forcing_period is not None:
        return None
    field = forward.field

    def back(x: Any, p: Any) -> dict[str, Any]:
        return {name: -rate for name, rate in field(x, p).items()}

    return replace(system, modes=(replace(forward, field=back, flow=None),))
