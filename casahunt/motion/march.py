"""Marching collocation: the initial value problem solved interval by interval, event by event.

The same interval equations as in the boundary value problem (collocation/interval.py), one interval at a time with
adaptive length, each mode followed to its exit and the exit located to rounding.  What comes out is
already a multi-phase mesh with stages: the starting guess of a transcription, and its phase sequence.

The length of an interval is chosen so that the last Legendre coefficient of the collocation polynomial,
in units of the state scale, equals `tol`.  That bounds the polynomial inside the interval; the end of
the interval is superconvergent and far better.

Symbols: n states, d stages, R = n (d + 1), N intervals of a segment.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from .. import effort
from ..collocation.scheme import Kind, scheme
from ..hybrid.system import Exit, Mode, System
from .march_exits import TooLong, end_of_flow, first_crossing, hidden, locate
from .march_step import Stepper, last_mode, predict, reaches

Array = np.ndarray

VANISHING_STEP = 1e-14  # of the time reached so far, or of one second at the start
GOAL = 1e-7  # of the tolerance: what Newton leaves of an interval's equations
ACCEPTED_ERROR = 4.0  # an interval's error, in units of the tolerance
LENGTHENING = 2.5  # of an interval's length from one to the next
VANISHED = "the step size vanished"


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
    """

    mode: str
    event: str
    duration: float
    breaks: Array
    w: Array
    end: Array

    @property
    def start(self) -> Array:
        """(n,) state at the start."""
        return self.w[0, : self.end.size]


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
    max_time, max_intervals
        [s], stop there; give up beyond.

    Returns
    -------
    The segments.  Where the motion comes to rest, or `max_time` has passed, they end without `until`.

    Raises
    ------
    MarchFailure : NaN, a step size that vanishes, or too many intervals.
    """
    effort.motion()
    s = scheme(degree, kind)
    segments: list[Segment] = []
    time, used = 0.0, 0
    while True:
        field = system.modes[mode]
        if field.flow is not None:
            segment, mode = _closed_form(system, mode, x, p)
        else:
            stepper = Stepper(field.field, s, p, scale, field.sign)
            segment, mode = _collocated(system, mode, x, stepper, tol, max_time - time, max_intervals - used)
        segments.append(segment)
        time += segment.duration
        used += len(segment.w)
        if segment.event == "" or until(segment):
            return segments
        if used >= max_intervals:
            raise MarchFailure(f"no end after {time:.3g} s and {used} intervals")
        if time >= max_time:
            return segments
        x = segment.end


def _closed_form(system: System, mode: str, x: Array, p: Array) -> tuple[Segment, str]:
    """(segment, next mode) of a phase in closed form."""
    found = end_of_flow(system.modes[mode], system.exits[mode], x, p)
    breaks, w = np.array([0.0, 1.0]), x[None].copy()
    if found is None:
        return Segment(mode, "", np.inf, breaks, w, x.copy()), mode
    duration, way_out, end = found
    return Segment(mode, way_out.event.name, duration, breaks, w, end), way_out.successor(end, p)


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


def _collocated(
    system: System, name: str, x: Array, stepper: Stepper, tol: float, max_time: float, max_intervals: int
) -> tuple[Segment, str]:
    """(segment, next mode) of a collocated phase: intervals in a row to its exit, or to `max_time`."""
    scale, p, d = stepper.scale, stepper.p, stepper.scheme.degree
    mode, exits = system.modes[name], system.exits[name]
    lengths: list[float] = []
    pieces: list[Array] = []

    def segment(event: str, end: Array) -> Segment:
        breaks = np.concatenate([[0.0], np.cumsum(lengths)])
        return Segment(name, event, t, breaks / breaks[-1], np.array(pieces) * np.tile(scale, d + 1), end * scale)

    t, start = 0.0, x / scale
    first = stepper.slope(start)
    slope: Array | None = first  # None where the interval does not start on an event
    h = min(1e-2 / max(float(np.max(np.abs(first))), 1e-300), max_time, 1.0) * tol ** (1 / (d + 1))
    previous: tuple[Array, float] | None = None
    while True:
        if t >= max_time * (1 - 1e-15):  # at rest for ever, or as good as; the rest is rounding
            return segment("", start), name
        if len(pieces) >= max_intervals:
            raise MarchFailure(f"mode {name!r}: no exit after {t:.3g} s and {len(pieces)} intervals")
        effort.interval()
        found = _attempt(mode, exits, stepper, previous, start, slope, h, tol)
        if isinstance(found, _Shorter):
            h *= found.factor
            if h < VANISHING_STEP * max(t, 1.0):
                raise MarchFailure(f"mode {name!r}: {found.why} at {t:.6g} s")
            continue
        h, stages, end, error, way_out = found
        pieces.append(np.concatenate([start, stages]))
        lengths.append(h)
        t += h
        if way_out is not None:
            successor = way_out.successor(end * scale, p)
            # An event that leads back into its own mode was touched, not crossed: the motion goes on.
            if successor != name or way_out.mark:
                return segment(way_out.event.name, end), successor
        previous, start, slope = (pieces[-1], h), end, None if way_out is None else stepper.slope(end)
        # The last interval ends at max_time itself, as accurate as any other end of an interval.
        h = min(h * min(LENGTHENING, max(0.3, 0.9 * (tol / max(error, 1e-300)) ** (1 / d))), max(max_time - t, 0.0))


def _attempt(
    mode: Mode,
    exits: tuple[Exit, ...],
    stepper: Stepper,
    previous: tuple[Array, float] | None,
    start: Array,
    slope: Array | None,
    h: float,
    tol: float,
) -> _Interval | _Shorter:
    """One interval from `start`, up to its exit where it has one; `slope` is x' there if it starts on an event."""
    s = stepper.scheme
    d = s.degree
    solved = stepper(start, predict(s, previous, start, h), h, GOAL * tol)
    if solved is None and reaches(previous, h):
        solved = stepper(start, np.tile(start, d), h, GOAL * tol)
    error = np.inf if solved is None else last_mode(s, start, solved[0])
    if solved is None or error > ACCEPTED_ERROR * tol:
        return _Shorter(0.3 if not np.isfinite(error) else max(0.2, 0.8 * (tol / error) ** (1 / d)), VANISHED)
    stages, end = solved
    ahead = None if slope is None else start + 1e-6 * h * slope
    try:
        crossing = first_crossing(exits, stepper, start, stages, end, ahead)
    except TooLong:
        return _Shorter(0.5, "an exit grazes zero")
    if crossing is not None:
        # A look at the polynomial saves locating an exit only to find that the interval hides something.
        rough = s.interpolation(crossing[1] * s.points) @ np.concatenate([start, stages]).reshape(d + 1, -1)
        missed = hidden(mode.feature, start, rough[1:].ravel(), rough[-1], stepper.scale, stepper.p)
        located = None if missed else locate(*crossing, stepper, start, stages, h)
        if located is None:
            return _Shorter(0.5, f"exit {crossing[0].event.name!r} cannot be located")
        h, stages, end = located
    if hidden(mode.feature, start, stages, end, stepper.scale, stepper.p):
        return _Shorter(0.5, VANISHED)  # whatever the step shows of the motion, it has stepped over something
    return _Interval(h, stages, end, error, None if crossing is None else crossing[0])
