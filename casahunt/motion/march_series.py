"""Marching by power series: a mode followed to its exit in steps of high order (series.py), then cut into intervals.

    expand at x    step as far as the series reaches    watch the events along it    expand at its end

Nothing is solved for: a step costs one compiled call and a product of matrices, and an event is a root of a function of
the place in the step.  The last terms of a step are bounded by `SERIES_TOLERANCE` of the tolerance of the intervals, so
that its end is as much better than these as the end of an interval of collocation is.

A series that has not seen what comes (a drop that is hidden where it begins) contradicts the field at the end of its
step: the slope there is the first coefficient of the next series, and a step whose slope is another one is halved.

Where the field has no series, coefficients are no numbers, or steps are much shorter than an interval of collocation
would be (a stiff mode), the rest of the phase is left to intervals (march.py).  That is found by trying one, at steps
8, 16, 32, ... of a phase.

Symbols: n states, P order.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from .. import effort
from ..collocation.admissibility import hides
from ..hybrid.roots import Bracket
from ..hybrid.system import Exit, Mode
from .march_exits import EVENT_LIMIT, EVENT_TOLERANCE, EXIT_ROUNDING, EXIT_ROUNDS, ON_EVENT
from .march_step import Stepper, last_mode
from .series import LOOKS, ORDER, Expansion, Step, at, meshed, powers, reach, stretched

Array = np.ndarray

SERIES_TOLERANCE, LEAST_TERM = 1e-4, 1e-17
"""Bound of the last terms in units of the tolerance; and at least, in units of the states."""
MISMATCH, LEAST_MISMATCH = 1e3, 1e-9
"""Difference of the slopes where two steps meet, times the step, in units of the bound of the last terms; and at least,
in units of the states."""
LONGER_STEP = 100.0
"""A step in units of the one before, at most."""
JUST_BEHIND = 1e-6
"""Part of a step after which it is seen to which side an event is left."""
FIRST_TRIAL, STIFF = 8, 8.0
"""Steps of a phase before an interval is tried; length of that interval, in steps, which shows that the mode is stiff
where it is resolved."""
_AHEAD = JUST_BEHIND ** np.arange(ORDER + 1.0)


class Reached(NamedTuple):
    """How far a mode was followed.

    Attributes
    ----------
    time, x : time in the mode; (n,) scaled state then.
    way_out : the exit there; None: the time is over, or it is to be followed further by intervals.
    over : nothing is left to be followed.
    length : of the last step; what intervals begin with.
    """

    time: float
    x: Array
    way_out: Exit | None
    over: bool
    length: float


class StepVanished(Exception):
    """A step that is too short, at this time."""

    def __init__(self, time: float) -> None:
        super().__init__(time)
        self.time = time


def follow(
    mode: Mode,
    exits: tuple[Exit, ...],
    stepper: Stepper,
    series: Expansion,
    x: Array,
    tol: float,
    max_time: float,
    most: int,
    passes: Callable[[Exit, Array], bool],
    vanishing: float,
) -> tuple[list[list[Step]], Reached]:
    """A mode from a state to its exit, or as far as series lead.

    Parameters
    ----------
    mode, exits
        the mode and its exits.
    stepper, series
        its intervals and its series.
    x
        (n,) scaled state at the start.
    tol, max_time, most
        tolerance of intervals; time after which it ends; steps after which the rest is left to intervals.
    passes
        whether the mode goes on through an exit at a scaled state.
    vanishing
        step that is too short, relative to the time, or to one.

    Returns
    -------
    Steps, in stretches from one exit that was passed to the next; and where they end.

    Raises
    ------
    StepVanished : a step is too short.
    """
    theta = max(SERIES_TOLERANCE * tol, LEAST_TERM)
    stretches: list[list[Step]] = [[]]
    t, taken, fresh, h = 0.0, 0, True, 1.0
    C = series(x, h)
    while True:
        if t >= max_time * (1 - 1e-15):  # at rest for ever, or as good as; the rest is rounding
            return stretches, Reached(t, x, None, True, h)
        s = reach(C, theta)
        if np.isnan(s) or taken >= most or _is_stiff(stepper, x, h * s, tol, taken):
            return stretches, Reached(t, x, None, False, h if np.isnan(s) else h * s)
        effort.interval()
        longest = min(max_time - t, LONGER_STEP * h if taken else np.inf, 1e300)
        C, h = (stretched(C, longest / h), longest) if h * s > longest else (stretched(C, s), h * s)
        while True:
            if h < vanishing * max(t, 1.0):
                raise StepVanished(t)
            points = powers(LOOKS) @ C
            way_out, s = first_exit(exits, stepper, C, points, fresh)
            end = points[-1] if way_out is None else at(C, s)
            ahead = series(end, h * s)
            if _as_foretold(mode, stepper, C, points, s, end, ahead, theta, way_out is not None):
                break
            C, h = stretched(C, 0.5), 0.5 * h
        h *= s
        stretches[-1].append(Step(t, h, C if s == 1.0 else stretched(C, s)))
        t, x, C, taken, fresh = t + h, end, ahead, taken + 1, way_out is not None
        if way_out is not None:
            if not passes(way_out, x):
                return stretches, Reached(t, x, way_out, True, h)
            stretches.append([])


def _is_stiff(stepper: Stepper, x: Array, h: float, tol: float, taken: int) -> bool:
    """Whether an interval of so many steps is resolved, looked at now and then."""
    if taken < FIRST_TRIAL or taken & (taken - 1):
        return False
    solved = stepper(x, np.tile(x, stepper.scheme.degree), STIFF * h, tol)
    return solved is not None and last_mode(stepper.scheme, x, solved[0]) <= tol


def _as_foretold(
    mode: Mode, stepper: Stepper, C: Array, points: Array, s: float, end: Array, ahead: Array, theta: float, exits: bool
) -> bool:
    """Whether a step up to s has hidden nothing: its slope at the end is that of the field there."""
    slope = (np.arange(1.0, ORDER + 1) * s ** np.arange(1.0, ORDER + 1)) @ C[1:]
    off = float(np.max(np.abs(slope - ahead[1])))
    if not (off <= MISMATCH * theta + LEAST_MISMATCH * max(1.0, float(np.max(np.abs(end)))) or np.isnan(off)):
        return False
    if mode.feature is None:
        return True
    if exits:
        places = np.linspace(0, s, LOOKS)
        points = np.vander(places, ORDER + 1, increasing=True) @ C
    return not bool(hides(mode.feature, points[None] * stepper.scale, stepper.p)[0])


def first_exit(
    exits: tuple[Exit, ...], stepper: Stepper, C: Array, points: Array, fresh: bool
) -> tuple[Exit | None, float]:
    """The first exit of a step.

    Parameters
    ----------
    exits, stepper
        of the mode.
    C, points
        (P + 1, n) coefficients of the step, (`LOOKS`, n) states along it.
    fresh
        the step may begin on an event, of which is seen to which side it is left.

    Returns
    -------
    Exit and place 0 < s <= 1; None and 1 where there is none.
    """
    if not exits:
        return None, 1.0
    if fresh:
        points = np.vstack([points, _AHEAD @ C])
    states = points.T * stepper.scale[:, None]
    best: Exit | None = None
    first, place = LOOKS, 1.0
    for way_out in exits:
        h = way_out.direction * np.asarray(way_out.event.function(states, 0.0, stepper.p), float)
        inside = h[: LOOKS - 1] < 0
        if fresh and abs(h[0]) <= ON_EVENT:
            begins = float(h[LOOKS]) - h[0]
            inside[0] = begins < 0 if begins != 0 else h[1] < 0
        crossed = np.flatnonzero(inside & (h[1:LOOKS] > 0))
        if not crossed.size or crossed[0] > first:
            continue
        k = int(crossed[0])
        s = _root(way_out, stepper, C, k, float(h[k]), float(h[k + 1]))
        if s is not None and (k < first or s < place):
            best, first, place = way_out, k, s
    return best, place


def _root(way_out: Exit, stepper: Stepper, C: Array, k: int, f_low: float, f_high: float) -> float | None:
    """The place between two looks where an event vanishes; None where it does not, as one that is no number."""

    def value(s: float) -> float:
        state = at(C, s) * stepper.scale
        return way_out.direction * float(way_out.event.function(state, 0.0, stepper.p))

    size = max(-min(f_low, 0.0), f_high, stepper.scale_of(way_out))
    tolerance = max(EVENT_TOLERANCE, EXIT_ROUNDING * size)
    low, high = k / (LOOKS - 1), (k + 1) / (LOOKS - 1)
    bracket = Bracket(low, f_low if f_low < 0 else -np.inf, high, f_high)
    s = bracket.illinois
    near = False
    for _ in range(EXIT_ROUNDS):
        f = value(s)
        if np.isnan(f):
            return None
        if f == 0 or near or bracket.width < 1e-15:
            break
        near = abs(f) <= tolerance  # one step more leaves rounding
        bracket = bracket.told(s, f)
        s = bracket.illinois
    return s if abs(f) <= EVENT_LIMIT else None


def intervals_of(
    mode: Mode, stepper: Stepper, stretches: list[list[Step]], tol: float, accepted: float
) -> tuple[list[float], list[Array]]:
    """The intervals of a motion that was followed by series.

    Parameters
    ----------
    mode, stepper
        the mode and its intervals.
    stretches
        what was followed; a node stands where one ends.
    tol, accepted
        last Legendre coefficient that intervals are chosen for; the largest that one may have.

    Returns
    -------
    Lengths, and (R,) start and stages of each, scaled.
    """

    def hidden(states: Array) -> Array:
        if mode.feature is None:
            return np.zeros(len(states), bool)
        return hides(mode.feature, states * stepper.scale, stepper.p)

    lengths: list[float] = []
    pieces: list[Array] = []
    for steps in stretches:
        if steps:
            breaks, w = meshed(steps, stepper.scheme, tol, accepted, hidden)
            lengths += [float(h) for h in np.diff(breaks)]
            pieces += list(w)
    return lengths, pieces
