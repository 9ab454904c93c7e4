"""The motion of a user's system (hybrid/language.py) from given states: mode by mode, with its events and its error.

    x' = f_k(x; p) in mode k, to the first of its exits, x+ = R(x; p) there, the next mode, ...

The motion is marched twice (phases.py), the second time to `SECOND_RUN` of the tolerance; what the two differ by, in
the states and in the times of the events, is the error estimate of the first, and a bound in practice of the second,
which is returned.  Where an event all but stands, both may agree on a place that is known to its rounding alone
(`_common`).
States are measured in units of their size in the motion itself, which a first look finds: a bristle of 1e-5 rad counts
as much as an angle of 1 rad.

Symbols: n states, d stages, N intervals of a phase, m sample points.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping

import numpy as np

from ..checks import choice_of, given_once, of_kind, require
from ..collocation.interval import field_at
from ..collocation.joints import event_rate, flow_at
from ..collocation.scheme import Kind
from ..errors import NotFollowed, Status
from ..hybrid import system as engine
from ..hybrid.language import System
from ..hybrid.vector_form import TURNS
from .closed_forms import check_closed_forms
from .motion import Motion, sampled
from .phases import MARCHED_AT_MOST, MarchFailure, Segment, march
from .rest import before_rest, far_after, far_from
from .segment import NoEnd

Array = np.ndarray

MARCH_DEGREE = 7
SECOND_RUN = 1e-2  # of the tolerance: what the two runs differ by is then the error of the first one
UNLIKE, LOOKS_AT_MOST = 10.0, 3
"""A supposed size of a state larger than its own by this factor has led to a rough motion; looks at most."""
BESIDE_TIMES, BESIDE_AGREES = 10.0 ** np.arange(12, -301, -1), 0.1
"""Times in which a state that is beside zero may leave it; two ways to what it comes to agree to this part of it."""
HALVED_DIGITS, AS_ITS_RATE, NO_SPEED = 50, 0.5, 1e-6
"""Steps beside an event, from the rounding of the states on and each twice the one before; part of what its rate says
by which it has to change on them; part of what its rate is the sum of, to which that is zero."""
LOOK_TOLERANCE, CUT_AT_AN_EVENT = 1e-4, 1e-9
"""Error of an interval in a look: it shows sizes, and where to begin; part of its time behind the last event by which
one that is cut short may end by rounding."""


def simulate(
    system: System,
    mode: str | None = None,
    *,
    duration: float,
    parameters: Mapping[str, float] | None = None,
    tol: float = 1e-8,
    sizes: Mapping[str, float] | None = None,
    start: Mapping[str, float] | None = None,
    **states: float,
) -> Motion:
    """Follow the motion for a time.

    Parameters
    ----------
    system
        the system.
    mode
        name of the mode that it starts in; default the first one.
    duration
        how long, > 0.
    parameters
        those that differ from the system's, by name.
    tol
        error of an interval, relative to the sizes of the states.
    sizes
        these sizes, by name; default the largest magnitudes along the motion.  A motion that goes on from another one,
        and has nearly come to rest, is measured by the sizes that it had (`Motion.sizes`).
    start
        states at the start, by name; in a forced system t is the time, default 0.
    **states
        the same as keywords, for those that are not in `start`.

    Returns
    -------
    Motion.  Where it comes to rest for ever, its last phase lasts as long as the time that was asked for.

    Raises
    ------
    InputError : a name or number is wrong.
    NotFollowed : a NoOrbit: the motion cannot be followed, with the time and the reason.

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.motion import simulate
    >>> [crossing.event for crossing in simulate(belt, "slip", x=0.0, v=0.0, duration=15.0).events]
    ['catches up', 'breaks away', 'catches up']
    """
    of_kind("system", system, System)
    require("duration", duration, above=0.0)
    require("tol", tol, above=0.0)
    p, x = system.values(parameters), system.state(given_once(start, states), parameters)
    name, form = (system.modes[0] if mode is None else system.mode(mode)).name, system.vector_form
    kind: Kind = "radau" if any(m.stiff for m in system.modes) else "gauss"
    check_closed_forms(system, x, p)
    try:
        if sizes is None:
            scale = look(form, name, x, p, first_sizes(form.modes[name], x, p, duration), kind, duration)[0]
        else:
            scale = _scale_of(sizes, system)
        coarse, fine = (follow_for(form, name, x, p, scale, kind, duration, error) for error in (tol, SECOND_RUN * tol))
    except MarchFailure as failure:
        what = f"the motion of {system.name} cannot be followed"
        raise NotFollowed(what, Status.NOT_CONVERGED, evidence=str(failure), time=failure.time) from None
    error = max(_difference(coarse, fine, scale, tol), _common(form, fine, p, scale, tol))
    return Motion(system, p, tuple(fine), error, scale, kind)


def _scale_of(sizes: Mapping[str, float], system: System) -> Array:
    """(n,) sizes of the states, 1 for the time.  Raises InputError: a state is unknown, or has no size above zero."""
    for name in sizes:
        choice_of("size of the state", name, system.states)
    scale = np.ones(len(system.names.entries))
    scale[: len(system.states)] = [require(f"sizes: {name}", sizes.get(name), above=0.0) for name in system.states]
    return scale


def follow_for(
    form: engine.VectorSystem,
    mode: str,
    x: Array,
    p: Array,
    scale: Array,
    kind: Kind,
    duration: float,
    tol: float,
    until: Callable[[Segment], bool] | None = None,
    most: int = MARCHED_AT_MOST,
) -> list[Segment]:
    """The phases of a motion for exactly this time, or until something holds at the end of one.

    Parameters
    ----------
    form, mode
        the hybrid system (`System.vector_form`), and the mode that it starts in.
    x, p, scale
        (n,) state at the start; (np,) parameters; (n,) sizes of the states.
    kind
        collocation scheme.
    duration
        how long [s].
    tol
        error of an interval, relative to the sizes.
    until
        called with every phase; True ends the motion.
    most
        how many intervals there may be.

    Returns
    -------
    The phases; their durations sum up to `duration`.

    Raises
    ------
    MarchFailure : as of `march`.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.motion import follow_for
    >>> p = np.array(list(belt.parameters.values()))
    >>> phases = follow_for(belt.vector_form, "slip", np.zeros(2), p, np.ones(2), "gauss", 5.0, 1e-6)
    >>> [phase.mode for phase in phases], sum(phase.duration for phase in phases)
    (['slip', 'stick'], 5.0)
    """
    phases = march(
        form, mode, x, p, scale=scale, until=until or (lambda segment: False), tol=tol, degree=MARCH_DEGREE, kind=kind,
        max_time=duration, max_intervals=most, strict=True,
    )  # fmt: skip
    left = duration - sum(phase.duration for phase in phases[:-1])
    last = phases[-1]
    rests = not last.event and np.isfinite(last.duration)
    if rests or last.duration <= left or form.modes[last.mode].flow is None:  # a march ends in time, but for rounding
        return phases
    end = flow_at(form.modes[last.mode], last.start, np.array([left]), p)[0]  # a closed form does not see the time
    return [*phases[:-1], Segment(last.mode, "", left, last.breaks, last.w, end)]


def first_sizes(
    mode: engine.VectorMode, x: Array, p: Array, duration: float = np.inf, least: float | Array = 0.0
) -> Array:
    """(n,) sizes of the states with which a motion can be looked at.

    They are the start's where it is not zero, and 1 where it is.  But a state that is beside zero, by rounding or since
    it passes there, says nothing: its size is what it comes to in the longest of the times 10^k for which one step of
    Runge's and Kutta's, and two of half the length, still agree; at most 1.

    mode: that it starts in; x, p: (n,) state at the start; parameter vector; duration: of the motion; least: (n,) what
    sizes are at least.
    """
    known, one = np.maximum(np.abs(x), least), np.ones(x.size)

    def step(y: Array, h: float) -> Array:
        a = field_at(mode.field, y, mode.sign, p, one)
        b = field_at(mode.field, y + h / 2 * a, mode.sign, p, one)
        c = field_at(mode.field, y + h / 2 * b, mode.sign, p, one)
        return np.asarray(y + h / 6 * (a + 2 * b + 2 * c + field_at(mode.field, y + h * c, mode.sign, p, one)))

    reached = known
    with np.errstate(all="ignore"):
        for h in BESIDE_TIMES[BESIDE_TIMES <= duration]:
            whole, halves = step(x, h), step(step(x, h / 2), h / 2)
            if np.all(np.abs(whole - halves) <= BESIDE_AGREES * np.maximum(np.abs(halves), known)):
                reached = np.abs(halves)
                break
    return np.where(known > 0, np.maximum(known, np.minimum(reached, 1.0)), 1.0)


def look(
    form: engine.VectorSystem,
    mode: str,
    x: Array,
    p: Array,
    scale: Array,
    kind: Kind,
    duration: float,
    events: float = np.inf,
    most: int = MARCHED_AT_MOST,
    least: float | Array = 0.0,
) -> tuple[Array, list[Segment], tuple[Array, Array]]:
    """A look at a motion, again where the states turn out to be much smaller than was thought.

    form, mode: the hybrid system and the mode that it starts in; x, p, scale: (n,) state at the start; parameter
    vector; (n,) supposed sizes of the states; events, most: so many events end the look, and about so many intervals
    do, where these are fewer than a march may have; least: (n,) what sizes are at least. Returns (n,) the largest
    magnitudes, 1 for a state that stays zero and for the time; the phases; times (m,) and states (n, m) along them.
    Raises MarchFailure: see `march`.
    """
    for _ in range(LOOKS_AT_MOST):
        asked = form, mode, x, p, scale, kind
        try:
            phases = follow_for(*asked, duration, LOOK_TOLERANCE, _after(events), most)
        except NoEnd as ended:
            if most == MARCHED_AT_MOST:
                raise
            phases = follow_for(*asked, ended.time, LOOK_TOLERANCE, _after(events))
            if len(phases) > 1 and phases[-1].duration <= CUT_AT_AN_EVENT * ended.time:
                phases.pop()  # in which a state that begins at zero has the size of rounding
        times, states = sampled(form, phases, p, kind, 4)
        found = np.maximum(np.max(np.abs(states), axis=1), least)
        found = np.where(found > 0, found, 1.0)
        found[[i for i, name in enumerate(form.states) if name == TURNS]] = 1.0
        rough = scale > UNLIKE * found
        scale = found
        if not rough.any():
            break
    return scale, phases, (times, states)


def _after(events: float) -> Callable[[Segment], bool]:
    """What holds behind so many phases."""
    count = itertools.count(1)
    return lambda segment: next(count) >= events


def _difference(coarse: list[Segment], fine: list[Segment], scale: Array, tol: float) -> float:
    """What two runs of one motion differ by: times of events relative to the duration, states relative to their sizes.

    Infinite where the sequences of the phases are not the same.  Where both motions have come to where they end, but
    for half of the tolerance, their phases from then on may differ, and count by how far they lead from there.
    """
    whole, at_end = sum(s.duration for s in fine), float(np.max(np.abs(coarse[-1].end - fine[-1].end) / scale))
    found = _apart(coarse, fine, scale, whole)
    if found > tol:
        lively = min(len(before_rest(run, scale, tol / 2)) for run in (coarse, fine))
        later = max(far_from(run[lively:], run[-1].end, scale) for run in (coarse, fine))
        before = _apart(coarse[:lively], fine[:lively], scale, whole)
        (mode, met), (other_mode, other_met) = ((run[lively - 1].mode, run[lively - 1].event) for run in (coarse, fine))
        alike = mode == other_mode and (met == other_met or "" in (met, other_met))
        if before > tol and alike:  # the phase in which they come there may end by rounding, or not at all
            ended = min(run[lively - 1].duration for run in (coarse, fine))
            crept = max(far_after(run[lively - 1], ended, run[-1].end, scale) for run in (coarse, fine))
            before = max(_apart(coarse[: lively - 1], fine[: lively - 1], scale, whole), crept)
        if later <= tol:
            found = min(found, max(before, later))
    return max(found, at_end)


def _common(form: engine.VectorSystem, phases: list[Segment], p: Array, scale: Array, tol: float) -> float:
    """What is not known of the events although both runs agree: of all times, by the duration, or of a state, by size.

    An event is known to the shortest time in which it goes through zero as its rate says, to both sides; not where it
    is met with no speed, nor where the motion comes to rest: when a slip that creeps there ends changes nothing.
    """
    times, states = 0.0, 0.0
    lively = len(before_rest(phases, scale, tol / 2))
    steps = np.finfo(float).eps * 2.0 ** np.arange(HALVED_DIGITS)
    for phase in phases[: lively if lively == len(phases) else max(lively - 1, 0)]:
        for way_out in form.ways_out(phase.mode, phase.event)[:1]:
            mode, x = form.modes[phase.mode], phase.end
            f = scale * field_at(mode.field, x / scale, mode.sign, p, scale)
            rate, size = event_rate(engine.Phase(mode, way_out.event), x, 0.0, p)
            speed = float(np.max(np.abs(f) / scale))
            if abs(rate) <= NO_SPEED * size:
                continue
            on = np.stack([x[:, None] + side * f[:, None] / speed * steps for side in (1, -1)], axis=1)
            h = np.asarray(way_out.event.function(on.reshape(x.size, -1), 0.0, p), float).reshape(2, -1)
            share = h * np.array([[1.0], [-1.0]]) / (rate * steps / speed)
            seen = np.flatnonzero(np.all((share > AS_ITS_RATE) & (share < 1 / AS_ITS_RATE), axis=0))
            if seen.size:
                times, states = times + steps[seen[0]] / speed, max(states, float(steps[seen[0]]))
    return max(times / sum(phase.duration for phase in phases), states)


def _apart(coarse: list[Segment], fine: list[Segment], scale: Array, whole: float) -> float:
    """By how much the phases differ; infinite where their sequences do."""
    if _names_of(coarse) != _names_of(fine):
        return float("inf")
    times = np.cumsum([a.duration - b.duration for a, b in zip(coarse, fine, strict=True)]) / whole
    states = [np.abs(a.end - b.end) / scale for a, b in zip(coarse, fine, strict=True)]
    return float(max(np.max(np.abs(times), initial=0.0), np.max(states, initial=0.0)))


def _names_of(segments: list[Segment]) -> list[tuple[str, str]]:
    return [(s.mode, s.event) for s in segments]
