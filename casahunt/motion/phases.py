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

import numpy as np

from .. import effort
from ..collocation.admissibility import PASSED
from ..collocation.joints import flow_at
from ..collocation.scheme import Kind, Scheme, scheme
from ..collocation.successors import at_speed, taken_over
from ..hybrid.system import Exit, VectorMode, VectorSystem
from .march_exits import behind, end_of_flow, ends_linear_in_time, flow_to
from .march_extrapolated import by_steps
from .march_intervals import Begins, begins_with, collocated
from .march_series import Following, Reached, intervals_of, most_intervals
from .march_step import Stepper
from .march_watch import NEAR_EVENT, EventWatch
from .rest import at_rest, at_rest_since, dies_out_at, is_noise
from .segment import MarchFailure, NoEnd, Segment
from .series import Piece, TooMany, series_of

Array = np.ndarray

MARCHED_AT_MOST = 20_000
"""Intervals after which a motion is given up, some ten seconds (effort.py): cycles have some hundreds."""
MANY_SIZES_AWAY = 1e6
"""A motion that comes to so many times the sizes of its states is told to grow, where it takes too many intervals."""
CROWD, CROWDED = 100, 1e-7
"""So many phases within this part of the time that has passed are no motion that could be followed (`strict`)."""
HIDES = (
    ", or a part of the field that changes suddenly was stepped over: a function that shows it, of order one, is named "
    "as the `feature` of the mode"
)
AT_SPEED = 1.5
"""An event that grows by a lower power of time is left at speed, as by the first one; from rest it is the second."""
FIRST_MOMENTS = np.array([1e-4, 1e-3, 1e-2])
"""Parts of a phase in closed form, or of a unit of time, after which it is seen where it goes."""
UNLIKE_ITS_FIELD = 1e-2
"""A closed form that ends this far off the intervals of its field, in units of the states, is none of it."""


def march(
    system: VectorSystem,
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
    max_intervals: int = MARCHED_AT_MOST,
    strict: bool = False,
    met: str = "",
    after: Segment | None = None,
    meshed: bool = True,
) -> list[Segment]:
    """Follow the motion from x in `mode` until `until(segment)` holds at a segment's end.

    Parameters
    ----------
    system, mode
        the hybrid system in vectors (`VectorSystem.vector_form`), and the mode that it starts in.
    x, p
        (n,) initial state, and (np,) the parameters.
    scale
        (n,) size of the states.
    until
        called with every finished segment; True ends the march.
    tol, degree, kind
        bound on the last Legendre coefficient of each interval, relative to `scale`; collocation scheme.
    max_time, max_intervals
        [s], stop there; give up beyond.
    strict, met, after
        give up where a mode goes on that does not hold any more; event that has just been met in x, if any; segment
        that ended in x, if any.
    meshed
        whether intervals are wanted; else a phase may have but the states at ends of steps (march_extrapolated.py).

    Returns
    -------
    The segments.  Where the motion comes to rest, or `max_time` has passed, they end without `until`.

    Raises
    ------
    MarchFailure : a phase begins with a state that is not finite, a step size vanishes, as where the field is no
        number, or a mode does not hold (`strict`).
    NoEnd : a MarchFailure: too many intervals.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.motion import march
    >>> segments = march(
    ...     belt.vector_form, "slip", np.zeros(2), np.array(list(belt.parameters.values())),
    ...     scale=np.ones(2), until=lambda segment: segment.mode == "stick",
    ... )
    >>> [(segment.mode, segment.event, round(segment.duration, 4)) for segment in segments]
    [('slip', 'catches up', 0.2624), ('stick', 'breaks away', 4.8783)]
    """
    effort.motion_begins()
    s = scheme(degree, kind)
    at_once = _at_once(system, mode, x, p, s) if strict and after is None else None
    segments: list[Segment] = [] if at_once is None else [at_once[0]]
    time, used = 0.0, 0
    if at_once is not None:
        (after, mode), x = at_once, at_once[0].behind
        if until(after):
            return segments
    while True:
        if not np.all(np.isfinite(x)):
            wrong = system.states[int(np.argmin(np.isfinite(x)))]
            raise MarchFailure(f"mode {mode!r}: the state {wrong!r} with which it begins at {time:.6g} s is not finite")
        phase = None if meshed else by_steps(system, mode, x, p, scale, tol, max_time - time)
        left = (time, used), (max_time, max_intervals)
        try:
            segment, mode, clean = phase or _phase(system, mode, x, p, s, scale, tol, after, *left, meshed)
        except MarchFailure as failure:
            failure.time = time if np.isnan(failure.time) else failure.time
            raise
        segments.append(segment)
        still = at_rest_since(segments, scale) if strict else len(segments)
        if strict and still == len(segments):
            try:
                if not clean:
                    _check(system, segments, p, scale, time, met)
                _check_crowd(segments, time + segment.duration)
            except MarchFailure as failure:
                still = dies_out_at(segments, scale)
                if still == len(segments):
                    failure.time = time
                    raise
        if still < len(segments):
            return [*segments[:still], at_rest(segments[still:], max_time - time)]
        time, used, after = time + segment.duration, used + segment.count, segment
        if segment.event == "" or until(segment) or (used < max_intervals and time >= max_time):
            return segments
        if used >= max_intervals:
            raise NoEnd(f"no end after {time:.3g} s and {used} intervals", time)
        x = segment.behind


def _at_once(system: VectorSystem, name: str, x: Array, p: Array, s: Scheme) -> tuple[Segment, str] | None:
    """(phase of no duration, next mode) of a motion that starts in front of an event of its mode, on it and at speed.

    Not where it may just as well be behind it, where its own jump leads.
    """
    mode = system.modes[name]
    for way_out in system.exits[name]:
        if abs(float(way_out.event.function(x, 0.0, p))) > NEAR_EVENT or way_out.mark and way_out.reset is None:
            continue
        jumped = behind(way_out, x, p)
        successor = way_out.successor(x if jumped is None else jumped, p)
        if at_speed(mode, way_out.event, way_out.direction, x, p) and not _leads_on(system, way_out, x, p):
            w = np.tile(x, 1 if mode.flow is not None else s.degree + 1)[None]
            return Segment(name, way_out.event.name, 0.0, np.array([0.0, 1.0]), w, x.copy(), jumped), successor
    return None


def _phase(
    system: VectorSystem,
    name: str,
    x: Array,
    p: Array,
    s: Scheme,
    scale: Array,
    tol: float,
    after: Segment | None,
    spent: tuple[float, int],
    most: tuple[float, int],
    by_series: bool,
) -> tuple[Segment, str, bool]:
    """(segment, next mode, whether it is surely a motion of its mode) of one phase, in closed form where there is one;
    time and intervals spent, and allowed."""
    mode = system.modes[name]
    if mode.flow is not None and ends_linear_in_time(mode, system.exits[name], x.size, p.size):
        return _closed_form(system, name, x, p)
    stepper = Stepper(mode.field, s, p, scale, mode.sign)
    begins, left = begins_with(after, name), (most[0] - spent[0], most[1] - spent[1])
    try:
        segment, successor = _followed(system, name, x, stepper, tol, *left, begins, by_series)
    except TooMany as many:
        took, end = spent[0] + float(many.args[0]), many.args[1]
        hint = "" if mode.stiff else "; a mode with states that relax far faster than it lasts is to be marked as stiff"
        far = int(np.argmax(np.abs(end)))
        if abs(end[far]) > MANY_SIZES_AWAY:
            size = f"{end[far] * scale[far]:.3g}"
            hint = f"; {system.states[far]!r} has come to {size} there, as where it grows without bound"
        raise NoEnd(f"mode {name!r}: no exit after {took:.3g} s and {most[1]} intervals{hint}", took) from None
    return segment if mode.flow is None else _polished(system, segment, p, scale), successor, False


def _check(system: VectorSystem, segments: list[Segment], p: Array, scale: Array, time: float, met: str) -> None:
    """Whether the last phase, begun at `time`, is a motion of its mode.  Raises MarchFailure where it is none."""
    last = segments[-1]
    _check_holds(system.modes[last.mode], last, p, time)
    why = _starts_on_its_event(system, last, p, time, segments[-2] if len(segments) > 1 else None, met)
    if why and (len(segments) == 1 or not is_noise(last, last.start, scale)):
        raise MarchFailure(why)


def _check_crowd(segments: list[Segment], time: float) -> None:
    """Whether events follow each other ever faster.  Raises MarchFailure where they do."""
    if len(segments) > CROWD and sum(s.duration for s in segments[-CROWD:]) <= CROWDED * time:
        raise MarchFailure(f"near {time:.6g} events follow each other ever faster: {CROWD} of them take no time")


def _starts_on_its_event(
    system: VectorSystem, segment: Segment, p: Array, time: float, before: Segment | None, met: str
) -> str:
    """What is said of a mode that starts on an event of its own and goes on through it; "" where it does not.

    No zero of the event is crossed then, and the mode would never end.  An event at which the mode goes on is none, nor
    is the one that has just been `met`, before or at the end of the phase before, and is left behind at speed, as by a
    pendulum that is pushed on; or one whose own jump leads there, as a walker begins its step where its foot stands.
    """
    x = segment.start
    for way_out in system.exits[segment.mode]:
        begins = way_out.direction * float(way_out.event.function(x, 0.0, p))
        if abs(begins) > NEAR_EVENT or segment.duration == 0:
            continue
        times, values = _next_to_the_start(system, segment, way_out, p)
        if not np.all(values > NEAR_EVENT * NEAR_EVENT + 10 * abs(begins)):
            continue
        if way_out.reset is None and (way_out.mark or way_out.successor(x, p) == segment.mode):
            continue
        if len(times) > 1:
            left = bool(values[0] > (times[0] / times[-1]) ** AT_SPEED * values[-1])
        else:  # a phase of one step
            left = at_speed(system.modes[segment.mode], way_out.event, way_out.direction, x, p)
        met, modes = (met, list(system.exits)) if before is None else (before.event, [before.mode])
        # modes on both sides of an event may give it one name, and cross it in opposite directions
        crossed = {(met, one.direction) for name in modes for one in system.ways_out(name, met)}
        same = (way_out.event.name, way_out.direction) in crossed
        if not (left and (same or _leads_on(system, way_out, x, p))):
            return _on_its_event(system, segment, way_out, p, time, before)
    return ""


def _next_to_the_start(system: VectorSystem, segment: Segment, way_out: Exit, p: Array) -> tuple[Array, Array]:
    """Times of a phase, as parts of something, just behind its start, and how far an event has risen there."""
    mode, x, n = system.modes[segment.mode], segment.start, segment.end.size
    if segment.w.shape[1] > n:
        following = segment.w[0].reshape(-1, n)[1:]
        times = scheme(len(following)).stages
    elif mode.flow is None:
        following, times = segment.nodes[1:4], segment.breaks[1:4]  # the first just behind the event
    else:
        times = FIRST_MOMENTS
        following = flow_at(mode, x, min(segment.duration, 1.0) * times, p)
    return times, way_out.direction * np.asarray(way_out.event.function(following.T, 0.0, p))


def _leads_on(system: VectorSystem, way_out: Exit, x: Array, p: Array) -> bool:
    """Whether the jump of an event leads from x to where one is left behind at speed: x may be such a state too."""
    jumped = behind(way_out, x, p)
    if jumped is None:
        return False
    name = way_out.successor(jumped, p)
    return any(
        abs(float(other.event.function(jumped, 0.0, p))) <= NEAR_EVENT
        and at_speed(system.modes[name], other.event, other.direction, jumped, p)
        for other in system.exits[name]
    )


def _on_its_event(
    system: VectorSystem, segment: Segment, way_out: Exit, p: Array, time: float, before: Segment | None
) -> str:
    """What is said of a mode that starts on its own event and moves on through it."""
    name = way_out.event.name
    if before is not None and before.event != name:
        for other in system.ways_out(before.mode, name):
            if abs(float(other.event.function(before.end, 0.0, p))) <= NEAR_EVENT:
                return (
                    f"at {time:.6g} the mode {before.mode!r} meets two events at once, {before.event!r} and {name!r}, "
                    "and which is the first is rounding: state them as one event, casadi.fmin (falling) or fmax "
                    "(rising) of their functions, whose reset and `to` look at which of them are within 1e-9 of zero; "
                    "or start where they do not meet"
                )
    return (
        f"at {time:.6g} the mode {segment.mode!r} starts on its own event {name!r} and moves on through it: another "
        "mode should begin there, one that slides along it where the modes on both sides lead to it; `holds` says "
        "where a mode is a motion"
    )


def _check_holds(mode: VectorMode, segment: Segment, p: Array, time: float) -> None:
    """The condition of a mode at the nodes of a segment of it.  Raises MarchFailure where it does not hold."""
    if mode.admissible is None:
        return
    lasts, first = np.isfinite(segment.duration), np.append(0.0, FIRST_MOMENTS)
    nodes = segment.nodes if lasts else np.array(flow_at(mode, segment.start, first, p))  # for ever: in closed form
    values = np.asarray(mode.admissible(nodes.T, p, mode.sign))
    wrong = np.flatnonzero(values < -mode.slack - PASSED)
    if 0 in wrong:
        where = f"at {time:.6g} the mode {mode.name!r} does not hold where it begins ({values[0]:.3g})"
        raise MarchFailure(f"{where}: start in the mode that does, or let the event before lead there")
    if wrong.size:
        at = time + (segment.duration * segment.breaks if lasts else first)[wrong[0]]
        raise MarchFailure(
            f"at {at:.6g} the mode {mode.name!r} does not hold any more ({values[wrong[0]]:.3g}), and none of its "
            "exits was met: an exit is missing, the modes on both sides of an event lead to it (then one that slides "
            "along it is missing), or events follow each other ever faster until they cannot be told apart"
            f"{'' if mode.feature else HIDES}"
        )


def _closed_form(system: VectorSystem, mode: str, x: Array, p: Array) -> tuple[Segment, str, bool]:
    """(segment, next mode, whether it is surely a motion of its mode) of a phase in closed form."""
    found = end_of_flow(system.modes[mode], system.exits[mode], x, p)
    breaks, w = np.array([0.0, 1.0]), x[None].copy()
    if found is None:
        return Segment(mode, "", np.inf, breaks, w, x.copy()), mode, False
    duration, way_out, end, clean = found
    jumped, successor = _led(system.modes[mode], way_out, end, p)
    return Segment(mode, way_out.event.name, duration, breaks, w, end, jumped), successor, clean


def _led(mode: VectorMode, way_out: Exit, end: Array, p: Array) -> tuple[Array | None, str]:
    """(the state behind an exit, None where it does not jump; the next mode).  Raises MarchFailure: it cannot be."""
    jumped = behind(way_out, end, p)
    if (successor := way_out.successor(end if jumped is None else jumped, p)) == mode.name:
        if why := taken_over(mode, way_out, end, p):
            raise MarchFailure(why)
    return jumped, successor


def _polished(system: VectorSystem, segment: Segment, p: Array, scale: Array) -> Segment:
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


def _followed(
    system: VectorSystem,
    name: str,
    x: Array,
    stepper: Stepper,
    tol: float,
    max_time: float,
    max_intervals: int,
    begins: Begins,
    by_series: bool,
) -> tuple[Segment, str]:
    """(segment, next mode) of a phase without closed form: series as far as they lead, then intervals in a row."""
    scale, p = stepper.scale, stepper.p
    mode, exits = system.modes[name], system.exits[name]
    behind_it: tuple[Array | None, str] = None, name

    def passes(way_out: Exit, end: Array) -> bool:
        """An event that leads back into its own mode was grazed, not crossed: the motion goes on."""
        nonlocal behind_it
        behind_it = _led(mode, way_out, end * scale, p)
        return behind_it[1] == name and not way_out.mark and mode.flow is None

    stretches: list[list[Piece]] = []
    reached = Reached(0.0, x / scale, None, False, begins.length)
    series = None if mode.stiff or not by_series else series_of(mode.field, mode.sign, p, scale)
    if series is not None:
        following = Following(exits, stepper, series, x / scale, tol, max_time, max_intervals, passes)
        reached, stretches = following.run(), following.stretches
    if stretches and reached.over and most_intervals(stretches, stepper.scheme, tol) <= max_intervals:
        event = "" if reached.way_out is None else reached.way_out.event.name
        ends = name, event, float(reached.time), x.copy(), reached.x * scale, behind_it[0]

        def mesh(tol: float) -> tuple[Array, Array]:
            return _meshed(*intervals_of(mode, stepper, stretches, tol), scale)

        return Segment.followed(ends, following.taken, mesh, tol), behind_it[1]
    try:
        lengths, pieces = intervals_of(mode, stepper, stretches, tol, max_intervals)
    except TooMany:
        raise TooMany(reached.time, reached.x) from None
    by_intervals = not reached.over
    if by_intervals:
        watch, limits = EventWatch(exits, mode.feature, stepper), (tol, max_time, max_intervals)
        reached = collocated(name, watch, passes, reached, begins.at_most, limits, lengths, pieces)
    breaks, w = _meshed(lengths, pieces, scale)
    event = "" if reached.way_out is None else reached.way_out.event.name
    length = reached.length if by_intervals else 0.0
    return Segment(name, event, float(reached.time), breaks, w, reached.x * scale, behind_it[0], length), behind_it[1]


def _meshed(lengths: list[float], pieces: list[Array], scale: Array) -> tuple[Array, Array]:
    """`breaks` and `w` of a segment."""
    breaks = np.concatenate([[0.0], np.cumsum(lengths)])
    w = np.array(pieces)
    return breaks / breaks[-1], w * np.tile(scale, w.shape[1] // scale.size)
