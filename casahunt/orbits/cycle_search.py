"""The cycle that a motion of a user's system settles on, or one that lies next to given states (first_return.py).

    watch    the motion, until it has met events or passed many intervals (watching.py): sizes, where to cut it
    march    on, event by event, until it repeats (recurrence.py): the last m phases like the m before, or mirrored
    solve    the boundary value problem of those m phases (adapt.py), to the tolerance
    accept  the solution only where it is the cycle that was seen: near the motion, and stable where the motion settled

What was not met is not denied: the refusal says how far the motion was followed.

Symbols: n states.
"""

from __future__ import annotations

import time
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from itertools import chain
from typing import cast

import numpy as np

from ..checks import choice_of, given_once, of_kind
from ..collocation.remesh import shape_limit
from ..collocation.scheme import scheme
from ..errors import ComesToRest, NoOrbit, Status
from ..hybrid.language import Function, System
from ..motion.closed_forms import check_closed_forms
from ..motion.march_checks import HIDES
from ..motion.march_intervals import VANISHED
from ..motion.segment import MarchFailure, NoEnd, Segment
from ..motion.simulation import MARCH_DEGREE
from .adapt import Options, finished, solve_adaptively
from .closure import Closure, turned, turns, with_sections
from .family import Family, measured_of
from .first_return import FirstReturn, Guess, reversed_in_time
from .floquet import clearly_attracts
from .fold_side import one_of_many
from .orbit import unknowns_of
from .recurrence import EXACTLY, Recurrence, recurrences
from .restart import from_segments, in_scheme
from .returning import FEW_PHASES, RESTS, RETURNED, WITHIN, Returning
from .sequences import segments_of
from .system_orbit import SystemOrbit, off_start
from .watching import SEARCH_TOLERANCE, AtRest, NotFound

Array = np.ndarray

FIRST_MESH = 1e-3
"""The mesh of a series resolves this part of the tolerance, and the motion: most cycles need no other one."""
FARTHER = 10.0
"""A cycle so many times as far from the motion as that comes back is accepted where the return map shows it alone."""
SEVERAL_TIMES = 1e-7
"""A cycle that is this near to itself, in units of the state scale, after a part of its phases, has a part of its
period."""
LEADS_ASTRAY = (Status.SINGULAR, Status.NOT_CONVERGED, Status.FAR_FROM_GUESS, Status.NOT_FINITE)
"""How it may end to solve for a cycle that is one of many."""
LEAST_CLOSED, MOST_CLOSING = 1e-5, 50
"""Part of a gap that is closed in one step at least; steps of that, of which three to four dozens were seen to serve
where a disturbance of 1 % grows seventyfold within a half turn."""
UNSTABLE = "an unstable cycle was passed, which the motion leaves"
NEITHER = "a cycle was computed of which is not known whether the motion stays there"
MOST_LONG = 2
"""Long recurrences that are tried."""


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
        the states are a guess, some percent beside a cycle, stable or not: that is sought (`SystemOrbit.from_start`).
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
    NoOrbit : no cycle was found, or it was not computed; says how far the motion was followed.

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle
    >>> round(find_cycle(belt, "slip", x=0.0, v=0.0, parameters={"belt": 0.21}).period, 3)
    11.712
    """
    began = time.perf_counter()
    names = of_kind("system", system, System).names.parameters
    search = _CycleSearch(
        system=system,
        p=system.values(parameters),
        mode=system.mode(mode).name if mode is not None else system.modes[0].name,
        x=system.state(given_once(start, states), parameters),
        followed=choice_of("parameter", follow, names) if follow else (names[0] if names else ""),
        measured=measured_of(system, measure),
        options=options or Options(tol=tol),
        settled=settled,
        kind="radau" if any(m.stiff for m in system.modes) else "gauss",
    )
    return replace(search.run(), wall_s=time.perf_counter() - began)


def _phases_of(r: Recurrence) -> str:
    """How many they are, in words."""
    return f"{r.phases} phase{'s' * (r.phases > 1)}"


@dataclass(kw_only=True)
class _CycleSearch(Returning):
    """One search; the attributes below `options` grow with it."""

    settled: bool
    followed: str
    measured: str | Function
    options: Options
    refusals: list[str] = field(default_factory=list)
    long: int = 0

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
        except NotFound as why:
            refusals = [] if isinstance(why, AtRest) else self.refusals
            evidence = "; ".join([f"followed for {why.followed:.6g}", *map(str, dict.fromkeys(refusals))])
            kind = ComesToRest if isinstance(why, AtRest) else NoOrbit
            sentence = f"no cycle of {self.system.name} was found: {why}"
            raise kind(sentence, Status.NOT_FOUND, evidence=evidence) from None

    def looked_for(self) -> SystemOrbit:
        """Watch, march, solve, accept."""
        if self.settled:
            return self.next_to_start()
        self.watch()
        while True:
            self.march_on()
            for r in self.back:
                orbit = self.solved(r)
                if orbit is not None:
                    return orbit
                self.near = max(r.distance, 1e-12) / 10
                # Raise NotMet where a recurrence that gave no cycle leaves none to be hoped for
                if r.distance < EXACTLY:
                    if self.rests(r.phases):
                        raise self.at_rest()
                    raise self.not_met(f"the motion repeats after {_phases_of(r)}, but its cycle was not computed")
                self.long += r.phases > FEW_PHASES
                if self.long >= MOST_LONG:
                    raise self.not_met(f"the motion repeats only nearly, after {_phases_of(r)}, without settling")
            if self.reached is not None:
                return self.once_round(self.reached) or self.reached
            self.check_patience()

    def next_to_start(self) -> SystemOrbit:
        """The cycle of a first return, or of a nearer one, stable or not, that lies next to the start."""
        turn = turns(self.system)
        x = self.x - turn * np.floor(self.x / np.where(turn > 0, turn, 1.0))
        motion = FirstReturn(system=self.system, p=self.p, mode=self.mode, x=x, kind=self.kind)
        failure: MarchFailure | None = None
        try:
            guesses = list(motion.guesses())
        except MarchFailure as ended:
            guesses, failure = [], ended
        for guess in chain(guesses, self.backwards(motion)):
            self.sections, self.turning, self.scale, self.segments = guess[3:6] + (guess.passes,)
            self.form = with_sections(self.system, self.sections)
            orbit = self.solved(Recurrence(len(guess.passes), guess.closure, guess.distance))
            if orbit is None:
                continue
            off = off_start(orbit, x, motion.scale)
            if off <= WITHIN:
                return replace(orbit, from_start=off)
            self.refusals.append(f"the solver went to a cycle that is {off:.2g} of the states' sizes off the start")
        for guess in motion.by_events():
            orbit = self.led_round(guess)
            if orbit is not None and (off := off_start(orbit, x, motion.scale)) <= WITHIN:
                return replace(orbit, from_start=off)
        if failure is not None and not isinstance(failure, NoEnd):
            raise failure
        near = "" if motion.nearest == np.inf else f" nearer than {motion.nearest:.2g} of the states' sizes"
        why = f"the motion from there does not come back{near}"
        why = "the equations of its first return have no solution near the start" if guesses else why
        raise NotFound(f"{why}: start nearer to a cycle", motion.followed)

    def led_round(self, guess: Guess) -> SystemOrbit | None:
        """The cycle to which a motion leads that has been round but is far from its start: the gap closes by and by."""
        self.sections, self.turning, self.scale, self.form = (), None, guess.scale, self.system.vector_form
        S, gap, repeats = np.array(guess.closure.matrix), np.array(guess.closure.shift), guess.closure.repeats
        begin, passes = guess.passes[0].start, guess.passes
        closed = turned(self.system, begin, begin + gap, parts=repeats)
        left, step = 1.0, 1.0
        for _ in range(MOST_CLOSING):
            if step < LEAST_CLOSED:
                break
            part = max(left - step, 0.0)
            closure = Closure.of(S, closed + part * (gap - closed), repeats)
            orbit = self.solved(Recurrence(len(passes), closure, 0.0), passes)
            if orbit is None or np.max(np.abs(orbit.arcs[0].states[0, 0] - begin) / orbit.scale) > WITHIN:
                step /= 4
                continue
            if not part:
                return orbit
            left, step, passes = part, 2 * step, segments_of(*unknowns_of(orbit))
        return None

    def backwards(self, motion: FirstReturn) -> Iterator[Guess]:
        """The cycle to which the motion leads that runs backwards from the start: an unstable one may attract that."""
        system = reversed_in_time(self.system, self.mode)
        if system is None:
            return
        search = _CycleSearch(
            system=system, p=self.p, mode=self.mode, x=self.x, followed=self.followed, measured=self.measured,
            options=self.options, settled=False, kind=self.kind,
        )  # fmt: skip
        with suppress(NoOrbit):
            orbit = search.run()
            yield motion.backwards(segments_of(*unknowns_of(orbit)), cast(Family, orbit.problem).closure)

    # Solve and accept -----------------------------------------------------------------------------------------

    def solved(self, r: Recurrence, motion: list[Segment] | None = None, *, sure: bool = False) -> SystemOrbit | None:
        """The cycle of a recurrence, of what was marched or of a motion that is `sure`ly one; None with a refusal."""
        sections, passes, closure = self.sections_for(r, motion or self.segments)
        problem = Family(self.system, tuple(self.p), closure, self.followed, self.measured, sections)
        signature = tuple((s.mode, s.event) for s in passes)
        cycle = problem.cycle(signature, closure.repeats)
        direction = problem.direction(self.followed) if self.followed else np.zeros(0)
        passes = [s.meshed(min(SEARCH_TOLERANCE, shape_limit(FIRST_MESH * self.options.tol))) for s in passes]
        begin = from_segments(cycle, [(1.0, s) for s in passes], self.p, direction, degree=MARCH_DEGREE, kind=self.kind)
        begin = in_scheme(begin, *self.options.scheme_of(problem))
        options = self.options
        if options.solver == "auto" and not self.settled:
            # What Newton loses is sought again nearer to it, which costs less than an optimisation problem of its size.
            options = replace(options, solver="newton")
        outcome = solve_adaptively(problem, begin, options, solver="newton")
        try:
            orbit = finished(outcome, problem, self.options, time.perf_counter(), "the cycle")
        except NoOrbit as refusal:
            many = one_of_many(begin) if refusal.status in LEADS_ASTRAY else ""
            if many:
                if not self.settled and r.distance < EXACTLY and self.rests(r.phases):
                    raise self.at_rest() from None
                raise self.not_met(f"the motion repeats after {_phases_of(r)}, but {many}") from None
            unsettled = refusal.status in (Status.TOLERANCE_NOT_REACHED, Status.INADMISSIBLE, Status.NOT_FINITE)
            self.refused(r, str(refusal) + (self.hidden if unsettled else ""))
            return None
        if self.settled:
            return self.once_round(orbit) or orbit
        away = float(np.max(np.abs(orbit.arcs[0].states[0, 0] - passes[0].start) / self.scale))
        if r.distance < RETURNED and away > WITHIN:
            self.refused(r, f"the solver went to a cycle that is {away:.2g} of the states' sizes off the motion")
            return None
        lin = outcome.solution.linearisation
        scaled = lin.return_map() if lin is not None else np.full((self.x.size, self.x.size), np.nan)
        M = scaled * outcome.setting.scale[:, None] / outcome.setting.scale
        if not (attracts := self.attracts(orbit, M)):  # what cannot be told to attract is not accepted
            self.refused(r, UNSTABLE if attracts is False else NEITHER + self.hidden)
            if r.phases > FEW_PHASES:
                what = "an unstable cycle" if attracts is False else "a cycle, stable or not,"
                raise self.not_met(f"the motion is irregular, next to {what} of {r.phases} phases")
            return None
        if not sure and (r.distance >= RETURNED or away > FARTHER * r.distance + orbit.error_estimate + RESTS):
            self.known.append((r, orbit, M))
            if self.confirmed(self.segments) is not orbit:
                return None
        return self.once_round(orbit) or orbit

    def refused(self, r: Recurrence, why: str) -> None:
        """A recurrence that has led to no cycle is told of where the motion was really near one."""
        if r.distance < RETURNED:
            self.refusals.append(why)

    def attracts(self, orbit: SystemOrbit, M: Array) -> bool | None:
        """Whether a cycle is stable, by the eigenvalues of its return map (n, n) where these tell it."""
        seen = clearly_attracts(M)
        return orbit.stable if seen is None else seen

    def once_round(self, orbit: SystemOrbit) -> SystemOrbit | None:
        """The cycle that an orbit runs through several times, or that its half with an image is; None for neither.

        A motion that spirals in may come back nearer after two turns than after one, or than its image after half.
        """
        assert self.form is not None
        near = max(SEVERAL_TIMES, 10 * orbit.error_estimate)
        whole, round_it = len(orbit.arcs) * orbit.repeats, segments_of(*unknowns_of(orbit))
        if self.turning is not None:  # every turn ends with the same event, but for how many there were before
            round_it = [replace(segment, event=self.segments[-1].event) for segment in round_it]
        found = recurrences(
            self.system, self.form, round_it, self.p, self.scale, near,
            lambda r: r.phases * r.closure.repeats < whole or not self.settled and r.phases < len(orbit.arcs),
        )  # fmt: skip
        return self.solved(found[0], None if self.turning else round_it, sure=True) if found else None

    @property
    def hidden(self) -> str:
        """What may be behind meshes or steps that do not get fine enough, where no mode says it."""
        return HIDES if any(mode.feature is None for mode in self.system.modes) else ""
