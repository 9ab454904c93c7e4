"""A motion of a user's system, followed until it comes back.

    watch    the motion, until it has met events or passed many intervals (watching.py): sizes, where to cut it
    march    on, event by event, until it is near an earlier state (recurrence.py): m phases ago, or mirrored
    confirm  that it goes to a cycle which was computed from an earlier return, by the return map there

Symbols: n states.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from ..hybrid import system as engine
from ..hybrid.language import System
from ..hybrid.problem import Kind
from ..motion.phases import MARCHED_AT_MOST, Segment, march
from ..motion.rest import STANDS
from ..motion.segment import NoEnd
from ..motion.simulation import MARCH_DEGREE
from .closure import Closure, Section, turned, turns, with_sections
from .recurrence import Recurrence, comes_in, loop_distance, rebased, recurrences
from .system_orbit import SystemOrbit
from .watching import (
    LOOKED_AT_MOST,
    SEARCH_TOLERANCE,
    AtRest,
    NotFound,
    Turning,
    counted_on,
    going_on,
    section_of,
    watch_motion,
)

Array = np.ndarray

WITHIN = 0.2
"""A cycle farther from the motion than this, in units of the state scale, is another one."""
RETURNED = 1e-2
"""It repeats when it comes back this near, in units of the state scale; farther off the return map has to show it."""
REPEATED = 0.1
"""All through its last loop a long recurrence stays this near to the loop before: chance ones do not.  A motion that
comes back this near, as part of how far it has gone away and in units of the state scale, may be about to repeat:
Newton's method is tried.  At 0.2 it is lost more often than it saves a return of the motion."""
FIRST_PHASES, FEW_PHASES = 6, 24
"""Phases after which a motion is looked at for repetition, and again each time there are twice as many; a cycle of more
than so many is a long one."""
ENOUGH_PHASES, MOST_PHASES = 768, 3000
"""Phases after which a motion that nowhere nearly repeats is given up; and any other one."""
RESTS = 1e-6
"""A motion on no cycle that moves by less than this part of its sizes, and by less and less, comes to rest."""
EVER_LONGER = 1.01
"""Of a motion that comes back exactly, and is no cycle, each return takes so many times as long as the one before."""
OUTGROWN = 1e8
"""A state this much larger than all states were at the start, and than 1, grows without bound; farther on it is too
large for its section."""
WAITED = 3_000
"""Intervals without an event after which a motion that was seen to meet some is looked at again."""
AHEAD = 1e3
"""A motion that is not back after so many times the time that it was watched does not come back."""


@dataclass(kw_only=True)
class Returning:
    """A motion from x in a mode; the attributes below `kind` grow with it."""

    system: System
    p: Array
    mode: str
    x: Array
    kind: Kind
    scale: Array = field(default_factory=lambda: np.ones(0))
    sections: tuple[Section, ...] = ()
    turning: Turning | None = None
    form: engine.VectorSystem | None = None
    segments: list[Segment] = field(default_factory=list)
    span: float = 0.0
    largest: float = np.inf
    near: float = np.inf
    looks: int = 0
    met: str = ""
    ahead: list[Segment] = field(default_factory=list)
    back: list[Recurrence] = field(default_factory=list)
    known: list[tuple[Recurrence, SystemOrbit, Array]] = field(default_factory=list)
    reached: SystemOrbit | None = None

    def not_met(self, why: str) -> NotFound:
        """Why there is none, with how long the motion was followed."""
        return NotFound(why, sum(s.duration for s in self.segments))

    def at_rest(self) -> NotFound:
        """The same where the motion comes to rest."""
        return AtRest("the motion comes to rest", sum(s.duration for s in self.segments))

    def watch(self) -> None:
        """A look at the motion: sizes of the states, where it is to be cut, and where the march begins."""
        if not self.scale.size:
            self.largest = OUTGROWN * max(1.0, float(np.max(np.abs(self.x))))
            self.near = REPEATED
        seen = watch_motion(self.system, self.mode, self.x, self.p, self.kind, self.scale if self.scale.size else None)
        self.scale, self.span = seen.scale, max(seen.span, AHEAD * self.span)
        if seen.events == 0:
            self.sections, self.turning = section_of(self.system, seen, self.p)
        self.form = with_sections(self.system, self.sections)
        last = seen.segments[-1]
        if seen.events and last.event:
            self.ahead = list(seen.segments)
        self.mode, self.x, self.met = *going_on(self.system.vector_form, last, self.p), last.event
        if self.turning is not None:
            self.x = self.turning.wrapped(self.x)

    def march_on(self) -> None:
        """On, phase by phase, until the motion has come back, or for as many phases as there are."""
        assert self.form is not None
        self.back = []
        while self.ahead:
            self.segments.append(self.ahead.pop(0))
            if self.came_back(self.segments):
                return
        goal = len(self.segments) + max(FIRST_PHASES, len(self.segments))
        while len(self.segments) < goal:
            before = len(self.segments)
            self.marched(1 if self.turning else goal - before)
            if len(self.segments) == before:  # it meets no more events: cut elsewhere
                self.segments = []
                return self.watch()
            self.mode, self.x = going_on(self.form, self.segments[-1], self.p)
            self.met = self.segments[-1].event
            if self.turning is not None:
                self.x = self.turning.wrapped(self.x)
            if self.back or self.reached:
                return
        self.back = self.recurrences(self.near, self.worth_a_try)

    def marched(self, phases: int) -> None:
        """So many phases more, or up to one at which the motion has come back; none where it meets no more events."""
        assert self.form is not None
        motion = list(self.segments)

        def enough(segment: Segment) -> bool:
            motion.append(segment)
            return len(motion) >= len(self.segments) + phases or self.outgrown(segment) or self.came_back(motion)

        try:
            new = march(
                self.form, self.mode, self.x, self.p, scale=self.scale, until=enough, tol=SEARCH_TOLERANCE,
                degree=MARCH_DEGREE, kind=self.kind, strict=True, max_time=AHEAD * self.span, met=self.met,
                max_intervals=MARCHED_AT_MOST if self.sections else WAITED,
                after=self.segments[-1] if self.segments else None,
            )  # fmt: skip
        except NoEnd:
            new = motion[len(self.segments) :]
            if self.sections or not new and (self.looks == LOOKED_AT_MOST or self.form.modes[self.mode].flow):
                raise
        last = new[-1] if new else Segment(self.mode, "", 0.0, np.array([0.0, 1.0]), self.x[None], self.x)
        if last.event:
            self.segments += new
            if self.outgrown(last):
                raise self.not_met("the motion grows without bound")
            return
        moves = self.form.modes[last.mode].flow is None
        if moves and not self.sections and self.looks < LOOKED_AT_MOST:
            self.looks += 1
            self.mode, self.x = last.mode, last.end
            return
        self.segments += [*new[:-1], replace(last, duration=min(last.duration, AHEAD * self.span))]
        if not moves:
            raise self.at_rest()
        missed = [f"come back to {section.state} = {section.level:.6g}" for section in self.sections[:1]]
        raise self.not_met(f"the motion does not {(missed or ['meet another event'])[0]}")

    def came_back(self, motion: list[Segment]) -> bool:
        """Whether the motion is near an earlier state after a few phases: then it is seen what of that is a cycle's."""
        nodes = np.abs(motion[-1].w[:, : self.scale.size]).max(axis=0)
        self.scale = np.where(turns(self.system) > 0, self.scale, np.maximum(self.scale, nodes))
        if len(motion) > 1:
            last = motion[-1 - 2 * FEW_PHASES :]  # of which a mirrored half is looked at with the half before
            self.back = self.recurrences(self.near, lambda r: r.phases <= FEW_PHASES, last)
        self.reached = self.confirmed(motion)
        return bool(self.back) or self.reached is not None

    def worth_a_try(self, r: Recurrence) -> bool:
        """Whether what comes back is no more than a few phases long, or all of it is near to the loop before."""
        return r.phases <= FEW_PHASES or r.distance < RETURNED and self.repeated(r)

    def outgrown(self, segment: Segment) -> bool:
        """Whether the motion is so large that it grows without bound: angles and the time alone may grow."""
        return float(np.max(np.abs(np.where(turns(self.system) > 0, 0.0, segment.end)))) > self.largest

    def recurrences(
        self, near: float, accepted: Callable[[Recurrence], bool], motion: list[Segment] | None = None
    ) -> list[Recurrence]:
        """The ways in which the motion has come back this near."""
        assert self.form is not None
        return recurrences(self.system, self.form, motion or self.segments, self.p, self.scale, near, accepted)

    def repeated(self, r: Recurrence) -> bool:
        """Whether all of the last loop is near to the loop before."""
        return loop_distance(self.system, self.segments, r, self.scale) < REPEATED

    def rests(self, phases: int) -> bool:
        """Whether the motion has become so small that its returns say nothing, or takes longer for each of them.

        After one return what it did before is no return, for it may have begun anywhere: then it has to stand still.
        """
        if self.turning is not None:
            return False
        again = len(self.segments) > 2 * phases
        loops = self.segments[-2 * phases if again else 0 : -phases], self.segments[-phases:]
        before, last = (
            np.max(np.ptp(np.array([x for s in loop for x in (s.start, s.end)]), axis=0) / self.scale, initial=0.0)
            for loop in loops
        )  # fmt: skip
        longer = sum(s.duration for s in loops[1]) > EVER_LONGER * sum(s.duration for s in loops[0])
        return bool(last <= (RESTS if again else STANDS) and last < before or again and longer)

    def check_patience(self) -> None:
        """Raise NotMet where the motion was followed for long enough: for longer where it is about to repeat."""
        count, marched = len(self.segments), sum(len(s.w) for s in self.segments)
        if count < ENOUGH_PHASES and marched < MARCHED_AT_MOST:
            return
        if count < MOST_PHASES and marched < 4 * MARCHED_AT_MOST:
            if self.recurrences(RETURNED, lambda r: r.phases <= FEW_PHASES and self.repeated(r)):
                return
        raise self.not_met(f"the motion did not repeat within {count} phases")

    def confirmed(self, motion: list[Segment]) -> SystemOrbit | None:
        """A cycle that was computed at an earlier return, to which the last one shows that the motion goes."""
        for r, orbit, M in self.known:
            if len(motion) <= r.phases:
                continue
            x, image = orbit.arcs[0].states[0, 0], np.array(r.closure.matrix) @ motion[-1].behind - r.closure.shift
            off = [(y - turned(self.system, x, y) - x) / self.scale for y in (motion[-1 - r.phases].behind, image)]
            if np.max(np.abs(off)) < WITHIN and comes_in(M / self.scale[:, None] * self.scale, *off):
                return orbit
        return None

    def sections_for(self, r: Recurrence, motion: list[Segment]) -> tuple[tuple[Section, ...], list[Segment], Closure]:
        """(sections, phases, closure) of a recurrence: turns are counted on from phase to phase."""
        passes = motion[-r.phases :]
        if self.turning is None:
            return self.sections, rebased(self.system, passes), r.closure
        i, name = self.turning.entry, self.system.names.entries
        sections, counted = counted_on(self.turning, self.sections[0], passes, name)
        shift = np.array(r.closure.shift)
        shift[i] = r.phases * self.turning.step
        return sections, counted, Closure(r.closure.matrix, tuple(map(float, shift)), r.closure.repeats)
