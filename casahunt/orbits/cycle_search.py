"""The cycle that a motion of a user's system settles on, or one that starts near given states.

    watch    the motion, until it has met events or passed many intervals (watching.py): sizes, where to cut it
    march    on, event by event, until it repeats (recurrence.py): the last m phases like the m before, or mirrored
    solve    the boundary value problem of those m phases (adapt.py), to the tolerance
    believe  the solution only where it is the cycle that was seen: near the motion, and stable where the motion settled

What was not met is not denied: the refusal says how far the motion was followed.

Symbols: n states.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace

import numpy as np

from ..checks import given_once, known, of_kind
from ..collocation.interval import field_at
from ..collocation.remesh import shape_limit
from ..collocation.scheme import scheme
from ..errors import NoOrbit, Status
from ..hybrid import system as engine
from ..hybrid.language import Function, System
from ..hybrid.problem import Kind
from ..motion.closed_forms import check_closed_forms
from ..motion.march import HIDES, MOST_INTERVALS, MarchFailure, Segment, march
from ..motion.march_intervals import VANISHED
from ..motion.segment import NoEnd
from ..motion.simulation import MARCH_DEGREE, sampled
from .adapt import Options, finished, solve_adaptively
from .closure import Closure, Section, turned, turns, with_sections
from .family import Family, measured_of
from .orbit import unknowns_of
from .recurrence import EXACTLY, Recurrence, comes_in, loop_distance, rebased, recurrences
from .restart import from_segments, in_scheme
from .sequences import segments_of
from .system_orbit import SystemOrbit
from .watching import (
    GREW, LOOK_LONGER, MOST_LOOKS, SEARCH_TOLERANCE, STANDSTILL, NotMet, Turning, counted_on, cut, going_on, watched,
)  # fmt: skip

Array = np.ndarray

RETURNED = 1e-2
"""It repeats when it comes back this near, in units of the state scale; farther off the return map has to show it."""
FIRST_MESH = 1e-3
"""The mesh of a series resolves this part of the tolerance, and the motion: most cycles need no other one."""
CLEARLY = 0.1
"""Eigenvalues of the return map are told from the unit circle by this without multipliers on meshes made for them."""
REPEATED = 0.1
"""All through its last loop a long recurrence stays this near to the loop before: chance ones do not."""
NEARBY = 0.1
"""A motion that comes back this near, as part of how far it has gone away and in units of the state scale, may be about
to repeat: Newton's method is tried.  At 0.2 it is lost more often than it saves a return of the motion."""
WITHIN = 0.2
"""A cycle farther from the motion than this, in units of the state scale, is another one."""
FIRST_PHASES, FEW_PHASES = 6, 24
"""Phases after which a motion is looked at for repetition, and again each time there are twice as many; a cycle of more
than so many is a long one."""
ENOUGH_PHASES, MOST_PHASES = 768, 3000
"""Phases after which a motion that nowhere nearly repeats is given up; and any other one."""
MOST_MARCHED = 20_000
"""Intervals after which it is given up likewise; any other one after four times as many."""
SEVERAL_TIMES = 1e-7
"""A cycle that is this near to itself, in units of the state scale, after a part of its phases, has a part of its
period."""
RESTS = 1e-6
"""A motion on no cycle that moves by less than this part of its sizes, and by less and less, comes to rest."""
LONGER = 1.01
"""Of a motion that comes back exactly, and is no cycle, each return takes so many times as long as the one before."""
MOST_LONG = 2
"""Long recurrences that are tried."""
WAITED = 3_000
"""Intervals without an event after which a motion that was seen to meet some is looked at again."""
AHEAD = 1e3
"""A motion that is not back after so many times the time that it was watched does not come back."""


def find_cycle(
    system: System,
    mode: str | None = None,
    *,
    tol: float = 1e-9,
    parameters: Mapping[str, float] | None = None,
    follow: str | None = None,
    measure: str | Function | None = None,
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
        relative tolerance of period and amplitude.
    parameters
        those that differ from the system's, by name.
    follow, measure
        the principal parameter, default the first one; the state, or the function (x, p) of named states and
        parameters, whose largest magnitude over the cycle is the amplitude: default the first state that is no angle.
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

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle
    >>> round(find_cycle(belt, "slip", x=0.0, v=0.0, parameters={"belt": 0.21}).period, 3)
    11.712
    """
    began = time.perf_counter()
    names = of_kind("system", system, System).names.parameters
    search = _Search(
        system=system,
        p=system.values(parameters),
        mode=system.mode(mode).name if mode is not None else system.modes[0].name,
        x=system.state(given_once(start, states), parameters),
        followed=known("parameter", follow, names) if follow else (names[0] if names else ""),
        measured=measured_of(system, measure),
        options=options or Options(tol=tol),
        settled=settled,
        kind="radau" if any(m.stiff for m in system.modes) else "gauss",
    )
    return replace(search.run(), wall_s=time.perf_counter() - began)


def _phases_of(r: Recurrence) -> str:
    """How many they are, in words."""
    return f"{r.phases} phase{'s' * (r.phases > 1)}"


@dataclass
class _Search:
    """One search; the attributes below `kind` grow with it."""

    system: System
    p: Array
    mode: str
    x: Array
    followed: str
    measured: str | Function
    options: Options
    settled: bool
    kind: Kind
    scale: Array = field(default_factory=lambda: np.ones(0))
    sections: tuple[Section, ...] = ()
    turning: Turning | None = None
    span: float = 0.0
    form: engine.System | None = None
    segments: list[Segment] = field(default_factory=list)
    refusals: list[str] = field(default_factory=list)
    met: str = ""
    largest: float = np.inf
    looks: int = 0
    long: int = 0
    near: float = 0.0
    ahead: list[Segment] = field(default_factory=list)
    back: list[Recurrence] = field(default_factory=list)
    reached: SystemOrbit | None = None
    known: list[tuple[Recurrence, SystemOrbit, Array]] = field(default_factory=list)

    def run(self) -> SystemOrbit:
        """The cycle.  Raises NoOrbit."""
        scheme(self.options.degree or MARCH_DEGREE, self.options.kind or self.kind)  # refuses what does not exist
        check_closed_forms(self.system, self.x, self.p)
        try:
            return self.looked_for()
        except MarchFailure as failure:
            hidden = self.hidden if VANISHED in str(failure) else ""
            sentence = f"the motion of {self.system.name} cannot be followed: {failure}{hidden}"
            raise NoOrbit(sentence, Status.NOT_CONVERGED) from None
        except NotMet as why:
            tried = "".join(f"; {refusal}" for refusal in dict.fromkeys(self.refusals))
            sentence = f"no cycle of {self.system.name} was met: {why} (followed for {why.followed:.6g}){tried}"
            raise NoOrbit(sentence, Status.NOT_FOUND) from None

    def looked_for(self) -> SystemOrbit:
        """Watch, march, solve, believe."""
        if self.settled and not self.system.mode(self.mode).ends and self.system.forcing_period is None:
            return self.first_return()
        self.largest = GREW * max(1.0, float(np.max(np.abs(self.x))))
        self.watch()
        self.near = RETURNED if self.settled else NEARBY
        while True:
            self.march_on()
            for r in self.back:
                orbit = self.solved(r)
                if orbit is not None:
                    return orbit
                self.near = max(r.distance, 1e-12) / 10
                self.check_hope(r)
            if self.reached is not None:
                return self.once_round(self.reached) or self.reached
            self.check_patience()

    def first_return(self) -> SystemOrbit:
        """The cycle through states that lie on it, of a motion without events: cut there, followed once round.

        An unstable cycle is not followed for long: a look at where the motion goes would show another one.
        """
        form, mode = self.system.vector_form, self.system.vector_form.modes[self.mode]
        self.scale = np.where(self.x != 0, np.abs(self.x), 1.0)
        rate = field_at(mode.field, self.x / self.scale, mode.sign, self.p, self.scale)
        swings = np.where(turns(self.system) > 0, 0.0, np.abs(rate))
        i = int(np.argmax(swings if swings.max() > STANDSTILL else np.abs(rate)))
        ahead = np.copysign(turns(self.system)[i], rate[i])  # an angle alone is back a turn later
        section = Section(self.mode, self.system.names.entries[i], float(self.x[i] + ahead), float(self.scale[i]))
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
            raise self.not_met(f"the motion from there comes back no nearer than {distance:.2g} of the states' sizes")
        orbit = self.solved(Recurrence(len(self.segments), Closure.of(np.eye(self.x.size), shift, 1), distance))
        if orbit is None:
            raise self.not_met("the equations of a first return were not solved")
        return orbit

    def not_met(self, why: str) -> NotMet:
        """Why there is none, with how long the motion was followed."""
        return NotMet(why, sum(s.duration for s in self.segments))

    def watch(self) -> None:
        """A look at the motion: sizes of the states, where it is to be cut, and where the march begins."""
        seen = watched(self.system, self.mode, self.x, self.p, self.kind, self.scale if self.scale.size else None)
        self.scale, self.span = seen.scale, max(seen.span, LOOK_LONGER * self.span)
        if seen.events == 0:
            self.sections, self.turning = cut(self.system, seen, self.p)
        self.form = with_sections(self.system, self.sections)
        last = seen.segments[-1]
        if seen.events and last.event:
            self.ahead = list(seen.segments)
        if seen.events or not self.settled:
            self.mode, self.x, self.met = *going_on(self.system.vector_form, last, self.p), last.event
        if self.turning is not None:
            self.x = self.turning.wrapped(self.x)

    # March ----------------------------------------------------------------------------------------------------

    def march_on(self) -> None:
        """On, phase by phase, until the motion has come back, or for as many phases as there are."""
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
                max_intervals=MOST_INTERVALS if self.sections else WAITED, after=(self.segments or [None])[-1],
            )  # fmt: skip
        except NoEnd:
            new = motion[len(self.segments) :]
            if self.sections or not new and self.looks == MOST_LOOKS:
                raise
        last = new[-1] if new else Segment(self.mode, "", 0.0, np.array([0.0, 1.0]), self.x[None], self.x)
        if self.outgrown(last):
            raise self.not_met("the motion grows without bound")
        if last.event:
            self.segments += new
            return
        moves = self.form.modes[last.mode].flow is None
        if moves and not self.sections and self.looks < MOST_LOOKS:
            self.looks += 1
            self.mode, self.x = last.mode, last.end
            return
        self.segments += [*new[:-1], replace(last, duration=min(last.duration, AHEAD * self.span))]
        raise self.not_met(
            f"the motion does not come back to {self.sections[0].state} = {self.sections[0].level:.6g}"
            if moves and self.sections else "the motion comes to rest"
        )  # fmt: skip

    def came_back(self, motion: list[Segment]) -> bool:
        """Whether the motion is near an earlier state after a few phases: then it is seen what of that is a cycle's."""
        nodes = np.abs(motion[-1].w[:, : self.scale.size]).max(axis=0)
        self.scale = np.where(turns(self.system) > 0, self.scale, np.maximum(self.scale, nodes))
        if len(motion) > 1:
            self.back = self.recurrences(self.near, lambda r: r.phases <= FEW_PHASES, motion)
        self.reached = self.confirmed(motion)
        return bool(self.back) or self.reached is not None

    def worth_a_try(self, r: Recurrence) -> bool:
        """Whether what comes back is no more than a few phases long, or all of it is near to the loop before."""
        return r.phases <= FEW_PHASES or r.distance < RETURNED and self.repeated(r)

    def outgrown(self, segment: Segment) -> bool:
        """Whether the motion is so large that it grows without bound: angles and the time alone may grow."""
        return float(np.max(np.abs(np.where(turns(self.system) > 0, 0.0, segment.end)))) > self.largest

    def recurrences(
        self, near: float, believed: Callable[[Recurrence], bool], motion: list[Segment] | None = None
    ) -> list[Recurrence]:
        """The ways in which the motion has come back this near."""
        assert self.form is not None
        return recurrences(self.system, self.form, motion or self.segments, self.p, self.scale, near, believed)

    def repeated(self, r: Recurrence) -> bool:
        """Whether all of the last loop is near to the loop before."""
        return loop_distance(self.system, self.segments, r, self.scale) < REPEATED

    def check_hope(self, r: Recurrence) -> None:
        """Raise NotMet where a recurrence that gave no cycle leaves none to be hoped for."""
        if r.distance < EXACTLY:
            if self.rests(r.phases):
                raise self.not_met("the motion comes to rest")
            raise self.not_met(f"the motion repeats after {_phases_of(r)}, but its cycle was not computed")
        self.long += r.phases > FEW_PHASES
        if self.long >= MOST_LONG:
            raise self.not_met(f"the motion repeats only nearly, after {_phases_of(r)}, without settling")

    def rests(self, phases: int) -> bool:
        """Whether the motion has become so small that its returns say nothing, or takes longer for each of them."""
        if self.turning is not None or len(self.segments) < 2 * phases:
            return False
        loops = self.segments[-2 * phases : -phases], self.segments[-phases:]
        before, last = (
            np.max(np.ptp(np.array([x for s in loop for x in (s.start, s.end)]), axis=0) / self.scale)
            for loop in loops
        )
        longer = sum(s.duration for s in loops[1]) > LONGER * sum(s.duration for s in loops[0])
        return bool(last <= RESTS and last < before) or longer

    def check_patience(self) -> None:
        """Raise NotMet where the motion was followed for long enough: for longer where it is about to repeat."""
        count, marched = len(self.segments), sum(len(s.w) for s in self.segments)
        if count < ENOUGH_PHASES and marched < MOST_MARCHED:
            return
        if count < MOST_PHASES and marched < 4 * MOST_MARCHED:
            if self.recurrences(RETURNED, lambda r: r.phases <= FEW_PHASES and self.repeated(r)):
                return
        raise self.not_met(f"the motion did not repeat within {count} phases")

    # Solve and believe -----------------------------------------------------------------------------------------

    def solved(self, r: Recurrence, motion: list[Segment] | None = None) -> SystemOrbit | None:
        """The cycle of a recurrence, at the end of what was marched or of another motion; or None with a refusal."""
        sections, passes, closure = self.sections_for(r, motion or self.segments)
        problem = Family(self.system, tuple(self.p), closure, self.followed, self.measured, sections)
        signature = tuple((s.mode, s.event) for s in passes)
        cycle = problem.cycle(signature, closure.repeats)
        direction = problem.direction(self.followed) if self.followed else np.zeros(0)
        passes = [s.meshed(min(SEARCH_TOLERANCE, shape_limit(FIRST_MESH * self.options.tol))) for s in passes]
        begin = from_segments(
            cycle, [(1.0, s) for s in passes], self.p, direction, degree=MARCH_DEGREE, kind=self.kind
        )
        begin = in_scheme(begin, *self.options.scheme_of(problem))
        # What Newton loses is sought again nearer to it, which costs less than an optimisation problem of its size.
        options = replace(self.options, solver="newton") if self.options.solver == "auto" else self.options
        outcome = solve_adaptively(problem, begin, options, solver="newton")
        try:
            orbit = finished(outcome, problem, self.options, time.perf_counter(), "the cycle")
        except NoOrbit as refusal:
            unsettled = refusal.status in (Status.TOLERANCE_NOT_REACHED, Status.INADMISSIBLE, Status.NOT_FINITE)
            return self.refused(r, str(refusal) + (self.hidden if unsettled else ""))
        away = float(np.max(np.abs(orbit.arcs[0].states[0, 0] - passes[0].start) / self.scale))
        if r.distance < RETURNED and away > WITHIN:
            return self.refused(r, f"the solver went to a cycle that is {away:.2g} of the states' sizes off the motion")
        if self.settled:
            return self.once_round(orbit) or orbit
        lin = outcome.solution.linearisation
        scaled = lin.return_map() if lin is not None else np.full((self.x.size, self.x.size), np.nan)
        M = scaled * outcome.setting.scale[:, None] / outcome.setting.scale
        if not self.attracts(orbit, M):  # what cannot be told to attract is not believed
            refused = self.refused(r, "an unstable cycle was passed, which the motion leaves")
            if r.phases > FEW_PHASES:
                raise self.not_met(f"the motion is irregular, next to an unstable cycle of {r.phases} phases")
            return refused
        if r.distance >= RETURNED:
            self.known.append((r, orbit, M))
            if self.confirmed(self.segments) is not orbit:
                return None
        return self.once_round(orbit) or orbit

    def refused(self, r: Recurrence, why: str) -> None:
        """A recurrence that has led to no cycle is told of where the motion was really near one."""
        if r.distance < RETURNED:
            self.refusals.append(why)

    def attracts(self, orbit: SystemOrbit, M: Array) -> bool:
        """Whether a cycle is stable, by the eigenvalues of its return map (n, n) where these tell it."""
        largest = float(np.max(np.abs(np.linalg.eigvals(M)))) if np.isfinite(M).all() else 1.0
        return largest < 1 - CLEARLY or largest < 1 + CLEARLY and orbit.stable

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

    def once_round(self, orbit: SystemOrbit) -> SystemOrbit | None:
        """The cycle that an orbit runs through several times; None where it is its own period.

        A motion that spirals in may come back nearer after two turns than after one.
        """
        assert self.form is not None
        near = max(SEVERAL_TIMES, 10 * orbit.error_estimate)
        whole, round_it = len(orbit.arcs) * orbit.repeats, segments_of(*unknowns_of(orbit))
        if self.turning is not None:  # every turn ends with the same event, but for how many there were before
            round_it = [replace(segment, event=self.segments[-1].event) for segment in round_it]
        found = recurrences(
            self.system, self.form, round_it, self.p, self.scale, near,
            lambda r: r.phases * r.closure.repeats < whole,
        )  # fmt: skip
        return self.solved(found[0], None if self.turning else round_it) if found else None

    @property
    def hidden(self) -> str:
        """What may be behind meshes or steps that do not get fine enough, where no mode says it."""
        return HIDES if any(mode.feature is None for mode in self.system.modes) else ""

    def sections_for(
        self, r: Recurrence, motion: list[Segment]
    ) -> tuple[tuple[Section, ...], list[Segment], Closure]:
        """(sections, phases, closure) of a recurrence: turns are counted on from phase to phase."""
        passes = motion[-r.phases :]
        if self.turning is None:
            return self.sections, rebased(self.system, passes), r.closure
        i, name = self.turning.entry, self.system.names.entries
        sections, counted = counted_on(self.turning, self.sections[0], passes, name)
        shift = np.array(r.closure.shift)
        shift[i] = r.phases * self.turning.step
        return sections, counted, Closure(r.closure.matrix, tuple(map(float, shift)), r.closure.repeats)
