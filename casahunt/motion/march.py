"""The march: the initial value problem of a hybrid system, phase by phase, event by event.

    smooth modes    power series of high order, in steps (march_series.py); the mesh is chosen when the motion is known
    the others      the interval equations of the boundary value problem (collocation/interval.py), one interval at a
                    time with adaptive length: stiff modes, and fields without a series
    closed forms    by themselves

Each mode is followed to its exit, and the exit located to rounding.  What comes out is already a multi-phase mesh with
stages, whichever way it was found: the starting guess of a transcription, and its phase sequence.

The length of an interval is chosen so that the last Legendre coefficient of the polynomial through its start and
stages, in units of the state scale, equals `tol`.  That bounds the polynomial inside the interval; its end is far
better either way: superconvergent, or bounded by a small part of `tol`.

Symbols: n states, d stages, R = n (d + 1), N intervals of a segment.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, fields
from typing import Any, NamedTuple

import numpy as np

from .. import effort
from ..collocation.joints import flow_at
from ..collocation.scheme import Kind, Scheme, scheme
from ..hybrid.system import Exit, Mode, System
from .march_exits import TooLong, Watch, behind, end_of_flow, ends_linear_in_time, flow_to, locate
from .march_series import Following, Reached, intervals_of, most_intervals
from .march_step import Foretold, Previous, Stepper, foretold
from .series import Piece, TooMany, series_of

Array = np.ndarray

VANISHING_STEP = 1e-14  # of the time reached so far, or of one second at the start
GOAL = 1e-7  # of the tolerance: what Newton leaves of an interval's equations
ACCEPTED_ERROR = 4.0  # an interval's error, in units of the tolerance
LENGTHENING = 2.5  # of an interval's length from one to the next; none behind one that was too long
BROKEN = 1e-6  # a condition below zero by this much does not hold
VANISHED = "the step size vanished"
CROWD, CROWDED = 100, 1e-7
"""So many phases within this part of the time that has passed are no motion that could be followed (`strict`)."""
HIDES = (
    ", or a part of the field that changes suddenly was stepped over: a function that shows it, of order one, is named "
    "as the `feature` of the mode"
)
NEAR_EVENT = 1e-9
"""A mode that starts so near to its own event starts on it."""
AT_SPEED = 0.3
"""An event whose mean rate at first is this part of that later on is left at speed; from rest it is nearly zero."""
FIRST_MOMENTS = np.array([1e-4, 1e-3, 1e-2])
"""Parts of a phase in closed form, or of a unit of time, after which it is seen where it goes."""
UNLIKE_ITS_FIELD = 1e-2
"""A closed form that ends this far off the intervals of its field, in units of the states, is none of it."""


@dataclass(frozen=True, eq=False)
class Segment:
    """One phase of a simulated motion.

    Attributes
    ----------
    mode, event : names; event is "" where the march ended without one.
    duration : length of the segment [s].
    breaks : (N + 1,) interval boundaries as fractions of the duration; (2,) for a closed-form mode.
    w : (N, R) start and stages of each interval, unscaled; (1, n) for a closed-form mode.
    end : (n,) state at the end.
    jumped : (n,) state behind the event where it jumps there, else None.
    length : [s] of the interval that would have come next; 0 where the phase was not followed by intervals.
    """

    mode: str
    event: str
    duration: float
    breaks: Array
    w: Array
    end: Array
    jumped: Array | None = None
    length: float = 0.0

    @classmethod
    def followed(
        cls,
        ends: tuple[str, str, float, Array, Array, Array | None],
        count: int,
        mesh: Callable[[], tuple[Array, Array]],
    ) -> Segment:
        """A phase whose intervals are made when somebody asks for them, as few who only want its end do.

        Parameters
        ----------
        ends
            mode, event, duration, (n,) start and end, and the state behind the event.
        count
            steps in which it was followed.
        mesh
            makes `breaks` and `w`.

        Returns
        -------
        Segment.
        """
        self = object.__new__(cls)
        names = ("mode", "event", "duration", "_start", "end", "jumped", "length", "_count", "_mesh")
        for name, value in zip(names, (*ends, 0.0, count, mesh), strict=True):
            object.__setattr__(self, name, value)
        return self

    def __getattr__(self, name: str) -> Any:
        """`breaks` and `w` of a phase that has none yet; two threads may both make them, and make the same."""
        mesh = self.__dict__.get("_mesh")
        if name not in ("breaks", "w") or mesh is None:
            raise AttributeError(name)
        for made, value in zip(("breaks", "w"), mesh(), strict=True):
            object.__setattr__(self, made, value)
        return self.__dict__[name]

    def __getstate__(self) -> dict[str, Any]:
        """What is copied and sent to other processes."""
        return {field.name: getattr(self, field.name) for field in fields(self)}

    @property
    def count(self) -> int:
        """Number of its intervals, or of the steps in which it was followed."""
        return int(self.__dict__["_count"]) if "_count" in self.__dict__ else len(self.w)

    @property
    def start(self) -> Array:
        """(n,) state at the start."""
        return self.__dict__["_start"] if "_start" in self.__dict__ else self.w[0, : self.end.size]

    @property
    def behind(self) -> Array:
        """(n,) state behind the event: where the next segment starts."""
        return self.end if self.jumped is None else self.jumped


class MarchFailure(Exception):
    """The march could not go on; the message says where."""


def march(
    system: System,
    mode: str,
    x: Array,
    p: Array,
    *,
    scale: Array,
    until: Callable[[Segment], bool],
    tol: float = 1e-4,
    degree: int = 7,
    kind: Kind = "gauss",
    max_time: float = np.inf,
    max_intervals: int = 20_000,
    strict: bool = False,
    met: str = "",
    after: Segment | None = None,
) -> list[Segment]:
    """Follow the motion from x in `mode` until `until(segment)` holds at a segment's end.

    Parameters
    ----------
    system, mode
        the hybrid system and the mode that it starts in.
    x, p
        (n,) initial state; parameter vector.
    scale
        (n,) size of the states.
    until
        called with every finished segment; True ends the march.
    tol, degree, kind
        bound on the last Legendre coefficient of each interval, relative to `scale`; collocation scheme.
    max_time, max_intervals, strict, met, after
        [s], stop there; give up beyond; give up where a mode goes on that does not hold any more; event that has just
        been met in x, if any; the segment that ended in x, if any.

    Returns
    -------
    The segments.  Where the motion comes to rest, or `max_time` has passed, they end without `until`.

    Raises
    ------
    MarchFailure : NaN, a step size that vanishes, too many intervals, or a mode that does not hold (`strict`).
    """
    effort.motion()
    s = scheme(degree, kind)
    segments: list[Segment] = []
    time, used = 0.0, 0
    while True:
        segment, mode = _phase(
            system, mode, x, p, s, scale, tol, max_time - time, max_intervals - used, _begins(after, mode)
        )
        segments.append(segment)
        if strict:
            _check(system, segments, p, time, met)
        time += segment.duration
        after = segment
        used += segment.count
        if segment.event == "" or until(segment):
            return segments
        if used >= max_intervals:
            raise MarchFailure(f"no end after {time:.3g} s and {used} intervals")
        if time >= max_time:
            return segments
        x = segment.behind


class _Begins(NamedTuple):
    """Length of the first interval of a phase, 0 where it is to be chosen, then at most so long."""

    length: float = 0.0
    at_most: float = np.inf


def _begins(after: Segment | None, mode: str) -> _Begins:
    """What the intervals in front of a phase foretell: in another mode only that longer ones miss what is there."""
    if after is None or after.length == 0:
        return _Begins()
    goes_on = after.mode == mode and after.jumped is None
    return _Begins(length=after.length) if goes_on else _Begins(at_most=after.length)


def _phase(
    system: System,
    name: str,
    x: Array,
    p: Array,
    s: Scheme,
    scale: Array,
    tol: float,
    max_time: float,
    intervals: int,
    begins: _Begins,
) -> tuple[Segment, str]:
    """(segment, next mode) of one phase, in closed form where there is one."""
    mode = system.modes[name]
    if mode.flow is not None and ends_linear_in_time(mode, system.exits[name], x.size, p.size):
        return _closed_form(system, name, x, p)
    stepper = Stepper(mode.field, s, p, scale, mode.sign)
    segment, successor = _followed(system, name, x, stepper, tol, max_time, intervals, begins)
    return segment if mode.flow is None else _polished(system, segment, p, scale), successor


def _check(system: System, segments: list[Segment], p: Array, time: float, met: str) -> None:
    """Whether the last phase, begun at `time`, is a motion of its mode.  Raises MarchFailure where it is none."""
    last = segments[-1]
    _check_holds(system.modes[last.mode], last, p, time)
    _check_start(system, last, p, time, segments[-2].event if len(segments) > 1 else met)
    time += last.duration
    if len(segments) > CROWD and sum(s.duration for s in segments[-CROWD:]) <= CROWDED * time:
        raise MarchFailure(f"near {time:.6g} events follow each other ever faster: {CROWD} of them take no time")


def _check_start(system: System, segment: Segment, p: Array, time: float, met: str) -> None:
    """Whether a mode starts on an event of its own and goes on through it.  Raises MarchFailure where it does.

    No zero of the event is crossed then, and the mode would never end.  An event at which the mode goes on is none, nor
    is the one that has just been `met` and is left behind at speed, as by a pendulum that is pushed on.
    """
    mode, x, n = system.modes[segment.mode], segment.start, segment.end.size
    for way_out in system.exits[segment.mode]:
        begins = way_out.direction * float(way_out.event.function(x, 0.0, p))
        if abs(begins) > NEAR_EVENT or segment.duration == 0:
            continue
        if way_out.reset is None and (way_out.mark or way_out.successor(x, p) == segment.mode):
            continue
        if segment.w.shape[1] > n:
            following = segment.w[0].reshape(-1, n)[1:]
            times = scheme(len(following)).stages
        else:
            times = FIRST_MOMENTS
            following = flow_at(mode, x, min(segment.duration, 1.0) * times, p)
        values = way_out.direction * np.array([float(way_out.event.function(state, 0.0, p)) for state in following])
        at_speed = values[0] / times[0] > AT_SPEED * values[-1] / times[-1]
        if np.all(values > NEAR_EVENT * NEAR_EVENT + 10 * abs(begins)) and not (at_speed and way_out.event.name == met):
            raise MarchFailure(
                f"at {time:.6g} the mode {mode.name!r} starts on its own event {way_out.event.name!r} and moves on "
                "through it: another mode should begin there, one that slides along it where the modes on both sides "
                "lead to it; `holds` says where a mode is a motion"
            )


def _check_holds(mode: Mode, segment: Segment, p: Array, time: float) -> None:
    """The condition of a mode at the nodes of a segment of it.  Raises MarchFailure where it does not hold."""
    if mode.admissible is None or not np.isfinite(segment.duration):
        return
    nodes = np.vstack([segment.w[:, : segment.end.size], segment.end])
    values = np.asarray(mode.admissible(nodes.T, p, mode.sign))
    wrong = np.flatnonzero(values < -mode.slack - BROKEN)
    if wrong.size:
        at = time + segment.duration * np.append(segment.breaks[:-1], 1.0)[wrong[0]]
        raise MarchFailure(
            f"at {at:.6g} the mode {mode.name!r} does not hold any more ({values[wrong[0]]:.3g}), and none of its "
            "exits was met: an exit is missing, the modes on both sides of an event lead to it (then one that slides "
            "along it is missing), or events follow each other ever faster until they cannot be told apart"
            f"{'' if mode.feature else HIDES}"
        )


def _closed_form(system: System, mode: str, x: Array, p: Array) -> tuple[Segment, str]:
    """(segment, next mode) of a phase in closed form."""
    found = end_of_flow(system.modes[mode], system.exits[mode], x, p)
    breaks, w = np.array([0.0, 1.0]), x[None].copy()
    if found is None:
        return Segment(mode, "", np.inf, breaks, w, x.copy()), mode
    duration, way_out, end = found
    jumped = behind(way_out, end, p)
    successor = way_out.successor(end if jumped is None else jumped, p)
    return Segment(mode, way_out.event.name, duration, breaks, w, end, jumped), successor


def _polished(system: System, segment: Segment, p: Array, scale: Array) -> Segment:
    """A phase in closed form whose end was found by intervals: its duration to rounding.

    Raises MarchFailure where the closed form ends elsewhere: x(s + t) from x is x(t) from x(s) in a flow alone.
    """
    mode, exits = system.modes[segment.mode], system.exits[segment.mode]
    named = [e for e in exits if e.event.name == segment.event]
    way_out = min(named, key=lambda e: abs(float(e.event.function(segment.end, 0.0, p))), default=None)
    duration, end = flow_to(mode, exits, way_out, segment.start, segment.duration, p)
    off = np.abs(end - segment.end) / np.maximum(scale, np.abs(segment.end))
    if np.isfinite(duration) and not np.max(off) <= UNLIKE_ITS_FIELD:
        raise MarchFailure(
            f"mode {segment.mode!r}: after {duration:.6g} its closed form is {np.max(off):.2g} of the sizes off "
            "the motion along its field"
        )
    jumped = None if way_out is None else behind(way_out, end, p)
    return Segment(segment.mode, segment.event, duration, np.array([0.0, 1.0]), segment.start[None], end, jumped)


class _Interval(NamedTuple):
    """An interval that is right: its length, stages, end, error, and the exit that it ends on."""

    h: float
    stages: Array
    end: Array
    error: float
    way_out: Exit | None


class _Shorter(NamedTuple):
    """An interval that is too long: the factor for its length, and why it is given up where that gets too small."""

    factor: float
    why: str


def _followed(
    system: System,
    name: str,
    x: Array,
    stepper: Stepper,
    tol: float,
    max_time: float,
    max_intervals: int,
    begins: _Begins,
) -> tuple[Segment, str]:
    """(segment, next mode) of a phase without closed form: series as far as they lead, then intervals in a row."""
    scale, p = stepper.scale, stepper.p
    mode, exits = system.modes[name], system.exits[name]
    behind_it: tuple[Array | None, str] = None, name

    def passes(way_out: Exit, end: Array) -> bool:
        """An event that leads back into its own mode was touched, not crossed: the motion goes on."""
        nonlocal behind_it
        jumped = behind(way_out, end * scale, p)
        successor = way_out.successor(end * scale if jumped is None else jumped, p)
        behind_it = jumped, successor
        return successor == name and not way_out.mark and mode.flow is None

    stretches: list[list[Piece]] = []
    reached = Reached(0.0, x / scale, None, False, begins.length)
    series = None if mode.stiff else series_of(mode.field, mode.sign, p, scale)
    if series is not None:
        following = Following(exits, stepper, series, x / scale, tol, max_time, max_intervals, passes)
        reached, stretches = following.run(), following.stretches
    if stretches and reached.over and most_intervals(stretches, stepper.scheme, tol) <= max_intervals:
        jumped, successor = behind_it if reached.way_out is not None else (None, name)
        event = "" if reached.way_out is None else reached.way_out.event.name
        ends = name, event, reached.time, x.copy(), reached.x * scale, jumped

        def mesh() -> tuple[Array, Array]:
            return _meshed(*intervals_of(mode, stepper, stretches, tol, max_intervals), scale)

        return Segment.followed(ends, following.taken, mesh), successor
    try:
        lengths, pieces = intervals_of(mode, stepper, stretches, tol, max_intervals)
    except TooMany:
        raise MarchFailure(f"mode {name!r}: no exit after {reached.time:.3g} s and {max_intervals} intervals") from None
    by_intervals = not reached.over
    if by_intervals:
        reached = _collocated(
            mode, exits, stepper, reached, begins.at_most, tol, max_time, max_intervals, passes, lengths, pieces
        )
    breaks, w = _meshed(lengths, pieces, scale)
    jumped, successor = behind_it if reached.way_out is not None else (None, name)
    event = "" if reached.way_out is None else reached.way_out.event.name
    length = reached.length if by_intervals else 0.0
    return Segment(name, event, reached.time, breaks, w, reached.x * scale, jumped, length), successor


def _meshed(lengths: list[float], pieces: list[Array], scale: Array) -> tuple[Array, Array]:
    """`breaks` and `w` of a segment."""
    breaks = np.concatenate([[0.0], np.cumsum(lengths)])
    w = np.array(pieces)
    return breaks / breaks[-1], w * np.tile(scale, w.shape[1] // scale.size)


def _collocated(
    mode: Mode,
    exits: tuple[Exit, ...],
    stepper: Stepper,
    begun: Reached,
    at_most: float,
    tol: float,
    max_time: float,
    max_intervals: int,
    passes: Callable[[Exit, Array], bool],
    lengths: list[float],
    pieces: list[Array],
) -> Reached:
    """Intervals in a row to the exit of a mode, or to `max_time`, put behind those that are there."""
    d = stepper.scheme.degree
    t, start, h = begun.time, begun.x, min(begun.length, max_time - begun.time)
    slope: Array | None = None  # where the interval does not start on an event
    if t == 0:
        slope = stepper.slope(start)
    if h <= 0:
        assert slope is not None
        h = min(1e-2 / max(float(np.max(np.abs(slope))), 1e-300), max_time, 1.0) * tol ** (1 / (d + 1))
        h = min(h, at_most)
    previous: Previous | None = None
    longest = LENGTHENING
    watch = Watch(exits, mode.feature, stepper)
    while True:
        if t >= max_time * (1 - 1e-15):  # at rest for ever, or as good as; the rest is rounding
            return Reached(t, start, None, True, h)
        if len(pieces) >= max_intervals:
            raise MarchFailure(f"mode {mode.name!r}: no exit after {t:.3g} s and {len(pieces)} intervals")
        effort.interval()
        found = _attempt(watch, previous, start, slope, h, tol)
        if isinstance(found, _Shorter):
            h *= found.factor
            longest = 1.0
            if h < VANISHING_STEP * max(t, 1.0):
                raise MarchFailure(f"mode {mode.name!r}: {found.why} at {t:.6g} s")
            continue
        length = h * min(longest, max(0.3, 0.9 * (tol / max(found.error, 1e-300)) ** (1 / d)))
        longest = LENGTHENING
        h, stages, end, error, way_out = found
        pieces.append(np.concatenate([start, stages]))
        lengths.append(h)
        t += h
        if way_out is not None and not passes(way_out, end):
            return Reached(t, end, way_out, True, length)
        previous = Previous(pieces[-1].reshape(d + 1, -1), h, error)
        start, slope = end, None if way_out is None else stepper.slope(end)
        # The last interval ends at max_time itself, as accurate as any other end of an interval.
        h = min(length, max(max_time - t, 0.0))


def _attempt(
    watch: Watch,
    previous: Previous | None,
    start: Array,
    slope: Array | None,
    h: float,
    tol: float,
) -> _Interval | _Shorter:
    """One interval from `start`, up to its exit where it has one; `slope` is x' there if it starts on an event."""
    stepper = watch.stepper
    s = stepper.scheme
    d = s.degree
    guess = foretold(d, previous, start, h)
    solved = stepper(start, guess, h, GOAL * tol)
    if solved is None and guess.w is not start:
        solved = stepper(start, Foretold(start), h, GOAL * tol)
    error = np.inf if solved is None else solved.error
    if solved is None or error > ACCEPTED_ERROR * tol:
        return _Shorter(0.3 if not np.isfinite(error) else max(0.2, 0.8 * (tol / error) ** (1 / d)), VANISHED)
    stages, end, _ = solved
    ahead = None if slope is None else start + 1e-6 * h * slope
    reached = h, stages, end
    way_out: Exit | None = None
    try:
        crossings, hidden = watch.crossings(start, stages, end, ahead)
    except TooLong:
        return _Shorter(0.5, "an exit grazes zero")
    if crossings:
        # A look at the polynomial saves locating an exit only to find that the interval hides something.
        rough = s.interpolation(crossings[0][1] * s.points) @ np.concatenate([start, stages]).reshape(d + 1, -1)
        missed = watch.hides(start, rough[1:].ravel(), rough[-1])
        for candidate, beyond in crossings:  # all of them between the same two watched times: the first is the exit
            located = None if missed else locate(watch, candidate, beyond, start, stages, h)
            if located is None:
                return _Shorter(0.5, f"exit {candidate.event.name!r} cannot be located")
            if way_out is None or located[0] < reached[0]:
                way_out, reached = candidate, located
        h, stages, end = reached
        hidden = watch.hides(start, stages, end)
    if hidden:
        return _Shorter(0.5, VANISHED)  # whatever the step shows of the motion, it has stepped over something
    return _Interval(h, stages, end, error, way_out)
