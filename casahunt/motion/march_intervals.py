"""Marching by intervals of collocation: a mode followed to its exit, each interval as long as the tolerance allows.

Symbols: n states, d stages, R = n (d + 1).
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .. import effort
from ..hybrid.system import Exit
from .march_exits import locate_exit
from .march_series import Reached
from .march_step import ExtrapolatedStages, Previous, extrapolated_stages
from .march_watch import EventWatch, TooLong
from .segment import MarchFailure, Segment
from .series import TooMany

Array = np.ndarray

VANISHING_STEP = 1e-14  # of the time reached so far, or of one second at the start
GOAL = 1e-7  # of the tolerance: what Newton leaves of an interval's equations
ACCEPTED_ERROR = 4.0  # an interval's error, in units of the tolerance
LENGTHENING = 2.5  # of an interval's length from one to the next; none behind one that was too long
VANISHED = "the step size vanished"


class Begins(NamedTuple):
    """Length of the first interval of a phase, 0 where it is to be chosen, then at most so long."""

    length: float = 0.0
    at_most: float = np.inf


def begins_with(after: Segment | None, mode: str) -> Begins:
    """What the intervals in front of a phase foretell: in another mode only that longer ones miss what is there."""
    if after is None or after.length == 0:
        return Begins()
    goes_on = after.mode == mode and after.jumped is None
    return Begins(length=after.length) if goes_on else Begins(at_most=after.length)


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


def _first_length(slope: Array, max_time: float, tol: float, d: int) -> float:
    """Of an interval that moves by little, of which nothing else is known."""
    return min(1e-2 / max(float(np.max(np.abs(slope))), 1e-300), max_time, 1.0) * tol ** (1 / (d + 1))


def collocated(
    name: str,
    watch: EventWatch,
    passes: Callable[[Exit, Array], bool],
    begun: Reached,
    at_most: float,
    limits: tuple[float, float, int],
    lengths: list[float],
    pieces: list[Array],
) -> Reached:
    """Intervals in a row to the exit of a mode, or until the time is over, put behind those that are there.

    name, watch, passes: of the mode: its name, its intervals and exits, and whether it goes on through an exit at a
    scaled state; begun, at_most: how far it was followed, with the length of the first interval, 0 where that is to be
    chosen; and is at most; limits: last Legendre coefficient of an interval; [s], stop there; intervals, give up
    beyond; lengths, pieces: of the intervals so far: [s], and (R,) start and stages, scaled; those of this part are put
    behind them. Returns reached, with the length of the interval that would have come next. Raises MarchFailure,
    TooMany: a step size that vanishes; more intervals than there may be, with time and state at their end.
    """
    stepper, (tol, max_time, max_intervals) = watch.stepper, limits
    t, start, d, h = begun.time, begun.x, stepper.scheme.degree, min(begun.length, max_time - begun.time)
    slope = stepper.slope(start) if t == 0 else None  # None where the interval does not start on an event
    if h <= 0:
        h = min(_first_length(stepper.slope(start), max_time, tol, d), at_most)
    previous: Previous | None = None
    longest = LENGTHENING
    while True:
        if t >= max_time * (1 - 1e-15):  # at rest for ever, or as good as; the rest is rounding
            return Reached(t, start, None, True, h)
        if len(pieces) >= max_intervals:
            raise TooMany(t, start)
        effort.interval()
        found = _attempt(watch, previous, start, slope, h, tol)
        if isinstance(found, _Shorter):
            h, longest = h * found.factor, 1.0
            if not h >= VANISHING_STEP * max(t, 1.0):  # nor where the field, and so the first length, is no number
                raise MarchFailure(f"mode {name!r}: {found.why} at {t:.6g} s")
            continue
        length = h * min(longest, max(0.3, 0.9 * (tol / max(found.error, 1e-300)) ** (1 / d)))
        (h, stages, end, error, way_out), longest = found, LENGTHENING
        pieces.append(np.concatenate([start, stages]))
        lengths.append(h)
        t += h
        if way_out is not None and not passes(way_out, end):
            return Reached(t, end, way_out, True, length)
        previous = Previous(pieces[-1].reshape(d + 1, -1), h, error)
        start, slope = end, None if way_out is None else stepper.slope(end)
        h = min(length, max(max_time - t, 0.0))  # the last one ends at max_time itself


def _attempt(
    watch: EventWatch,
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
    guess = extrapolated_stages(d, previous, start, h)
    solved = stepper(start, guess, h, GOAL * tol)
    if solved is None and guess.w is not start:
        solved = stepper(start, ExtrapolatedStages(start), h, GOAL * tol)
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
            located = None if missed else locate_exit(watch, candidate, beyond, start, stages, h)
            if located is None:
                return _Shorter(0.5, f"exit {candidate.event.name!r} cannot be located")
            if way_out is None or located[0] < reached[0]:
                way_out, reached = candidate, located
        h, stages, end = reached
        hidden = watch.hides(start, stages, end)
    if hidden:
        return _Shorter(0.5, VANISHED)  # whatever the step shows of the motion, it has stepped over something
    return _Interval(h, stages, end, error, way_out)
