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
from ..collocation.scheme import Kind, Scheme, scheme
from ..collocation.successors import at_speed, taken_over
from ..hybrid.system import Exit, VectorMode, VectorSystem
from .march_checks import check_phase, leads_on
from .march_exits import behind, end_of_flow, ends_linear_in_time, flow_to
from .march_extrapolated import by_steps
from .march_intervals import Begins, begins_with, collocated
from .march_series import Following, Reached, intervals_of, most_intervals
from .march_step import Stepper
from .march_watch import NEAR_EVENT, EventWatch
from .rest import at_rest, at_rest_since, dies_out_at
from .segment import MarchFailure, NoEnd, Segment
from .series import Piece, TooMany, series_of

Array = np.ndarray

MARCHED_AT_MOST = 20_000
"""Intervals after which a motion is given up, some ten seconds (effort.py): cycles have some hundreds."""
MANY_SIZES_AWAY = 1e6
"""A motion that comes to so many times the sizes of its states is told to grow, where it takes too many intervals."""
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
    time, used, by_intervals = 0.0, 0, meshed
    if at_once is not None:
        (after, mode), x = at_once, at_once[0].behind
        if until(after):
            return segments
    while True:
        _check_finite(system, mode, x, time)
        phase = None if by_intervals else by_steps(system, mode, x, p, scale, tol, max_time - time)
        begun, left = mode, ((time, used), (max_time, max_intervals))
        try:
            segment, mode, clean = phase or _phase(system, mode, x, p, s, scale, tol, after, *left, meshed)
        except MarchFailure as failure:
            failure.time = time if np.isnan(failure.time) else failure.time
            raise
        segments.append(segment)
        still = at_rest_since(segments, scale) if strict else len(segments)
        if strict and still == len(segments):
            try:
                check_phase(system, segments, p, scale, time, met, clean)
            except MarchFailure as failure:
                still = dies_out_at(segments, scale, tol)
                if still == len(segments) and phase is not None:  # steps may have passed what intervals meet
                    segments.pop()
                    mode, by_intervals = begun, True
                    continue
                if still == len(segments):
                    failure.time = time
                    raise
        if still < len(segments):
            return [*segments[:still], at_rest(segments[still:], max_time - time)]
        time, used, after, by_intervals = time + segment.duration, used + segment.count, segment, meshed
        if segment.event == "" or until(segment) or (used < max_intervals and time >= max_time):
            return segments
        if used >= max_intervals:
            raise NoEnd(f"no end after {time:.3g} s and {used} intervals", time)
        x = segment.behind


def _check_finite(system: VectorSystem, mode: str, x: Array, time: float) -> None:
    """Refuse a phase that begins with a state that is no number.  Raises MarchFailure."""
    if not np.all(np.isfinite(x)):
        wrong = system.states[int(np.argmin(np.isfinite(x)))]
        raise MarchFailure(f"mode {mode!r}: the state {wrong!r} with which it begins at {time:.6g} s is not finite")


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
        if at_speed(mode, way_out.event, way_out.direction, x, p) and not leads_on(system, way_out, x, p):
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
        following = Following(mode, exits, stepper, series, x / scale, tol, max_time, max_intervals, passes)
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
