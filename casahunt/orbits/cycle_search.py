"""The cycle that a motion of a user's system settles on, or one that starts near given states.

    watch    the motion, until it has met events or passed many intervals: sizes of the states, where to cut it
    march    on, event by event, until it repeats (recurrence.py): the last m phases like the m before, or mirrored
    solve    the boundary value problem of those m phases (adapt.py), to the tolerance
    believe  the solution only where it is the cycle that was seen: near the motion, and stable where the motion settled

A motion that meets no event is cut by a plane through its middle, x_i = level, or at the turns of its forcing.
What was not met is not denied: the refusal says how far the motion was followed.

Symbols: n states.
"""

from __future__ import annotations

import time
from collections.abc import Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..checks import known
from ..collocation.interval import field_at
from ..errors import NoOrbit, Status
from ..hybrid import system as engine
from ..hybrid.language import System
from ..hybrid.problem import Kind
from ..hybrid.vector_form import TURNS
from ..motion.march import MarchFailure, Segment, march
from ..motion.simulation import MARCH_DEGREE, follow_for, sampled, sizes
from .adapt import Options, finished, solve_adaptively
from .closure import Closure, Section, turned, with_sections
from .family import Family
from .recurrence import Recurrence, rebased, recurrences, turns_over
from .restart import from_segments
from .system_orbit import SystemOrbit

Array = np.ndarray

SEARCH_TOLERANCE = 1e-6
FIRST_LOOK = 20.0
"""Times in which the field moves a state by its size, that a motion is watched at first."""
MOST_LOOKS, LOOK_LONGER = 12, 4.0
"""Looks, each this much longer than the one before, until there is something to see."""
ENOUGH_EVENTS, ENOUGH_INTERVALS = 12, 300
TRIED_STATES = 16
"""States at which a forced system is tried for a symmetry between the halves of a turn."""
RETURNED = 1e-2
"""A motion repeats when it comes back this near, in units of the state scale; each failure asks for a tenth of it."""
WITHIN = 0.2
"""A cycle farther from the motion than this, in units of the state scale, is another one."""
FIRST_PHASES, MOST_PHASES = 24, 3000
STANDSTILL = 1e-8
"""Ranges of all states below this part of their sizes are rest."""


def find_cycle(
    system: System,
    mode: str | None = None,
    *,
    tol: float = 1e-9,
    parameters: Mapping[str, float] | None = None,
    follow: str | None = None,
    measure: str | None = None,
    settled: bool = False,
    options: Options | None = None,
    start: Mapping[str, float] | None = None,
    **states: float,
) -> SystemOrbit:
    """The cycle that the motion from these states settles on.

    Parameters
    ----------
    system
        the system.
    mode
        name of the mode that the motion starts in; default the first one.
    tol
        relative tolerance of the period.
    parameters
        those that differ from the system's, by name.
    follow, measure
        the principal parameter, default the first one; the state whose largest magnitude at the ends of phases is the
        amplitude, default the first one.
    settled
        the states lie next to a cycle already, stable or not: the first return is taken.
    options
        more than a tolerance: scheme, solver; overrides `tol`.
    start
        states at the start, by name; in a forced system t is the time, default 0.
    **states
        the same as keywords, for those that are not in `start`.

    Returns
    -------
    Orbit, converged.

    Raises
    ------
    InputError : a name or number is wrong.
    NoOrbit : no cycle was met, or it was not computed; says how far the motion was followed.
    """
    began = time.perf_counter()
    names = system.names.parameters
    search = _Search(
        system=system,
        p=system.values(parameters),
        mode=system.mode(mode).name if mode is not None else system.modes[0].name,
        x=system.state({**(start or {}), **states}, parameters),
        followed=known("parameter", follow, names) if follow else (names[0] if names else ""),
        measured=known("state", measure, system.states) if measure else system.states[0],
        options=options or Options(tol=tol),
        settled=settled,
        kind="radau" if any(m.stiff for m in system.modes) else "gauss",
    )
    return replace(search.run(), wall_s=time.perf_counter() - began)


@dataclass
class _Search:
    """One search; the attributes below `kind` grow with it."""

    system: System
    p: Array
    mode: str
    x: Array
    followed: str
    measured: str
    options: Options
    settled: bool
    kind: Kind
    scale: Array = field(default_factory=lambda: np.ones(0))
    sections: tuple[Section, ...] = ()
    form: engine.System | None = None
    segments: list[Segment] = field(default_factory=list)
    refusals: list[str] = field(default_factory=list)

    def run(self) -> SystemOrbit:
        """The cycle.  Raises NoOrbit."""
        try:
            return self.looked_for()
        except MarchFailure as failure:
            sentence = f"the motion of {self.system.name} cannot be followed: {failure}"
            raise NoOrbit(sentence, Status.NOT_CONVERGED) from None

    def looked_for(self) -> SystemOrbit:
        """Watch, march, solve, believe."""
        if self.settled and not self.system.mode(self.mode).ends and self.system.forcing_period is None:
            return self.first_return()
        self.watch()
        near, phases = RETURNED, 1 if self.settled else FIRST_PHASES
        while True:
            self.march_on(phases)
            assert self.form is not None
            for r in recurrences(self.system, self.form, self.segments, self.p, self.scale, near):
                orbit = self.solved(r)
                if orbit is not None:
                    return orbit
                near = min(near, max(r.distance, 1e-12)) / 10
            if len(self.segments) >= MOST_PHASES:
                raise self.not_found(f"in {len(self.segments)} phases the motion did not repeat")
            if not self.settled:
                phases = len(self.segments)

    def first_return(self) -> SystemOrbit:
        """The cycle through states that lie on it, of a motion without events: cut there, followed once round.

        An unstable cycle is not followed for long: a look at where the motion goes would show another one.
        """
        form, mode = self.system.vector_form, self.system.vector_form.modes[self.mode]
        self.scale = np.where(self.x != 0, np.abs(self.x), 1.0)
        rate = field_at(mode.field, self.x / self.scale, mode.sign, self.p, self.scale)
        i = int(np.argmax(np.abs(rate)))
        section = Section(self.mode, self.system.names.entries[i], float(self.x[i]), float(self.scale[i]))
        way = section.exits(form.states)[0 if rate[i] > 0 else 1]
        self.sections, self.form = (section,), with_sections(self.system, (section,))
        for _ in range(2):  # the first time round shows how large the states are
            self.segments = march(
                self.form, self.mode, self.x, self.p, scale=self.scale,
                until=lambda segment: segment.event == way.event.name, tol=SEARCH_TOLERANCE, degree=MARCH_DEGREE,
                kind=self.kind, strict=True,
            )  # fmt: skip
            _, states = sampled(form, self.segments, self.p, self.kind, 4)
            self.scale = np.where(np.abs(states).max(axis=1) > 0, np.abs(states).max(axis=1), 1.0)
        back = self.segments[-1].behind
        shift = turned(self.system, self.x, back)
        distance = float(np.max(np.abs(back - shift - self.x) / self.scale))
        if self.segments[-1].event == "" or distance > WITHIN:
            raise self.not_found(f"the motion from there comes back no nearer than {distance:.2g} of the states' sizes")
        orbit = self.solved(Recurrence(len(self.segments), Closure.of(np.eye(self.x.size), shift, 1), distance))
        if orbit is None:
            raise self.not_found("the equations of a first return were not solved")
        return orbit

    def not_found(self, why: str) -> NoOrbit:
        tried = "".join(f"; {refusal}" for refusal in dict.fromkeys(self.refusals))
        followed = sum(s.duration for s in self.segments)
        sentence = f"no cycle of {self.system.name} was met: {why} (followed for {followed:.6g}){tried}"
        return NoOrbit(sentence, Status.NOT_FOUND)

    # Watch ----------------------------------------------------------------------------------------------------

    def watch(self) -> None:
        """Look at the motion for longer and longer, until there are events or intervals enough; cut it if need be."""
        form = self.system.vector_form
        span = self.first_span()
        for _ in range(MOST_LOOKS):
            self.scale = sizes(form, self.mode, self.x, self.p, span, self.kind)
            seen = follow_for(form, self.mode, self.x, self.p, self.scale, self.kind, span, SEARCH_TOLERANCE)
            half = sum(s.duration for s in seen) / 2
            ends = np.cumsum([s.duration for s in seen])
            events = sum(bool(s.event) for s, end in zip(seen, ends, strict=True) if end > half)
            if events >= ENOUGH_EVENTS // 2:
                break
            if events == 0 and sum(len(s.w) for s in seen) >= ENOUGH_INTERVALS:
                break
            span *= LOOK_LONGER
        times, states = sampled(form, seen, self.p, self.kind, 8)
        late = states[:, times > half]
        if events == 0:
            self.cut(seen[-1].mode, late)
        elif self.at_rest(late):
            raise self.not_found("the motion comes to rest")
        if not self.settled:
            self.mode, self.x = seen[-1].mode, seen[-1].end
        if self.system.forcing_period is not None:
            self.x[-1] -= np.floor(self.x[-1] + 1e-9)  # rounding is no turn
        self.form = with_sections(self.system, self.sections)

    def first_span(self) -> float:
        """A time in which something happens: that of a turn of the forcing, or of a state that moves by its size."""
        if self.system.forcing_period is not None:
            return FIRST_LOOK * float(self.system.names.turn(self.p))
        form = self.system.vector_form
        scale = np.where(self.x != 0, np.abs(self.x), 1.0)
        probe = march(
            form, self.mode, self.x, self.p, scale=scale, until=lambda s: True, tol=1e-3, degree=MARCH_DEGREE,
            kind=self.kind, max_intervals=10**6, max_time=1e-3,
        )  # fmt: skip
        moved = np.max(np.abs(probe[-1].end - self.x) / scale) / max(min(probe[-1].duration, 1e-3), 1e-300)
        return FIRST_LOOK / max(float(moved), 1e-3)

    def at_rest(self, late: Array) -> bool:
        """Nothing moves but the time."""
        ranges = np.ptp(late, axis=1)[: len(self.system.states)]
        return bool(np.all(ranges <= STANDSTILL * self.scale[: ranges.size]))

    def cut(self, mode: str, late: Array) -> None:
        """A section for a motion that meets no event."""
        if self.at_rest(late):
            raise self.not_found("the motion comes to rest, and meets no event")
        names = self.system.names.entries
        if self.system.forcing_period is not None:
            some = late[:, :: max(1, late.shape[1] // TRIED_STATES)]
            parts = 2 if turns_over(self.system, mode, some, self.p, self.scale) else 1
            self.sections = tuple(Section(mode, TURNS, (k + 1) / parts, 1.0) for k in range(parts))
            return
        low, high = late.min(axis=1), late.max(axis=1)
        moves = (high - low) / self.scale
        others = np.array([name not in self.system.angles for name in names])
        if moves[others].max(initial=0.0) > STANDSTILL:
            moves[~others] = -1.0  # an angle that turns passes a plane once
        i = int(np.argmax(moves))
        level = (low[i] + high[i]) / 2
        if abs(level) < 0.05 * (high[i] - low[i]):
            level = 0.0  # where a symmetry would have it
        self.sections = (Section(mode, names[i], float(level), float(self.scale[i])),)

    @property
    def by_turns(self) -> bool:
        """The motion is cut by the turns of its forcing, or their halves."""
        return bool(self.sections) and self.sections[0].state == TURNS

    # March ----------------------------------------------------------------------------------------------------

    def march_on(self, phases: int) -> None:
        """So many phases more."""
        assert self.form is not None
        goal = len(self.segments) + phases
        while len(self.segments) < goal:
            count = 1 if self.by_turns else goal - len(self.segments)
            found: list[Segment] = []

            def enough(segment: Segment, found: list[Segment] = found, count: int = count) -> bool:
                found.append(segment)
                return len(found) >= count

            new = march(
                self.form, self.mode, self.x, self.p, scale=self.scale, until=enough, tol=SEARCH_TOLERANCE,
                degree=MARCH_DEGREE, kind=self.kind, strict=True,
            )  # fmt: skip
            if new[-1].event == "":
                raise self.not_found("the motion comes to rest")
            self.segments += new
            last = self.form.exits[new[-1].mode]
            way_out = next(e for e in last if e.event.name == new[-1].event)
            self.mode, self.x = way_out.successor(new[-1].behind, self.p), new[-1].behind.copy()
            if self.by_turns and self.x[-1] > 1 - 1e-9:
                self.x[-1] -= 1.0

    # Solve and believe -----------------------------------------------------------------------------------------

    def solved(self, r: Recurrence) -> SystemOrbit | None:
        """The cycle of a recurrence, or None with a refusal."""
        sections, passes, closure = self.sections_for(r)
        problem = Family(self.system, tuple(self.p), closure, self.followed, self.measured, sections)
        signature = tuple((s.mode, s.event) for s in passes)
        cycle = problem.cycle(signature, closure.repeats)
        direction = problem.direction(self.followed) if self.followed else np.zeros(0)
        begin = from_segments(
            cycle, [(1.0, s) for s in passes], self.p, direction, degree=MARCH_DEGREE, kind=self.kind
        )
        outcome = solve_adaptively(problem, begin, self.options, solver="newton")
        try:
            orbit = finished(outcome, problem, self.options, time.perf_counter(), "the cycle")
        except NoOrbit as refusal:
            self.refusals.append(str(refusal))
            return None
        away = float(np.max(np.abs(orbit.arcs[0].states[0, 0] - passes[0].start) / self.scale))
        if away > WITHIN:
            self.refusals.append(f"the solver went to a cycle that is {away:.2g} of the states' sizes off the motion")
            return None
        if not self.settled and not orbit.stable:  # not trusted either: what cannot be told to attract is not believed
            self.refusals.append("an unstable cycle was passed, which the motion leaves")
            if r.phases > FIRST_PHASES:
                raise self.not_found(f"the motion is irregular, next to an unstable cycle of {r.phases} phases")
            return None
        return orbit

    def sections_for(self, r: Recurrence) -> tuple[tuple[Section, ...], list[Segment], Closure]:
        """(sections, phases, closure) of a recurrence: turns are counted on from phase to phase."""
        passes = self.segments[-r.phases :]
        if not self.by_turns:
            return self.sections, rebased(self.system, passes), r.closure
        part = 1.0 / len(self.sections)
        began = round(float(passes[0].start[-1]) / part) * part
        sections = tuple(replace(self.sections[0], level=began + (k + 1) * part) for k in range(r.phases))
        counted = []
        for k, (s, section) in enumerate(zip(passes, sections, strict=True)):
            up = section.exits(self.system.names.entries)[0].event.name
            ahead = round(began + k * part - float(s.start[-1]))
            w, end = s.w.copy(), s.end.copy()
            w[:, self.x.size - 1 :: self.x.size] += ahead
            end[-1] += ahead
            counted.append(Segment(s.mode, up, s.duration, s.breaks, w, end))
        shift = np.array(r.closure.shift)
        shift[-1] = r.phases * part
        return sections, counted, Closure(r.closure.matrix, tuple(map(float, shift)), r.closure.repeats)
