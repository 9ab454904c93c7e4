"""Marching without a mesh: a mode followed to its exit by extrapolated midpoint steps (extrapolated_steps.py).

For who only asks what becomes of a motion: states at the ends of steps, and the exit, located by steps that end on its
event; no stages.  A tenth of the price of power series (march_series.py), which know what lies within a step.

A step can seem good because it goes past what its field does in between, such as a drop about the zero of a rate that
is an event: the step that ends there has to be as good, and its substeps have to see the mode's feature come, or a
shorter one is taken before.

Symbols: n states, E exits, M steps of a phase.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from .. import effort
from ..collocation.admissibility import PASSED
from ..collocation.successors import at_speed
from ..hybrid.system import Exit, VectorMode, VectorSystem
from ..roots import MOST_HALVINGS, Bracket
from .extrapolated_steps import PLACES_OF_A_CALL, ROUNDING_OF_ONE, STEPS_OF_A_CALL, steps_of
from .march_exits import EVENT_TOLERANCE, behind
from .march_watch import NEAR_EVENT
from .segment import Segment

Array = np.ndarray

STEPS_OF_A_SLIP, STEPS_OF_A_PHASE = 32, 640
"""Steps of a phase: a slip takes 15 to 60, what rings beside it hundreds.  What does not ring any more, by more than
the tolerance, and goes on, is stiff."""
OF_THE_TOLERANCE = 1e-2
"""Error of a step, as a part of the tolerance of an interval, whose end is as much better than its inside."""
LEAST_PART, ROUNDS_OF_A_CUBIC = 0.1, 3
"""Of a bracket its next place cuts off so much at least; steps to the zero of a cubic, from where others begin."""
TAKEN_FIRST = 0.8
"""Part of a step to an event that is taken first, where the whole one is not good enough."""


class Followed(NamedTuple):
    """A phase: times (M,) and scaled states (M, n) at the ends of its steps; the exit, None where the time is over;
    whether its mode holds there, and it does not begin on an event of its own to go on through it."""

    times: Array
    states: Array
    way_out: Exit | None
    clean: bool


class Place(NamedTuple):
    """A length of a step, an event and its rate at the end, and the error of the step in units of what it may be."""

    s: float
    event: float
    rate: float
    error: float = 0.0


class Landing(NamedTuple):
    """Where the first exit of a step is: time, state, and the exit.

    way_out: None where a step to it is not good enough; time: of the end of a shorter one.
    """

    time: float
    state: Array
    way_out: Exit | None


class Lost(Exception):
    """Steps are many, as in a stiff mode, or became nothing, or an event is no number on the way to its zero, or comes
    back to it between the start and the first look."""


def by_steps(
    system: VectorSystem, name: str, x: Array, p: Array, scale: Array, tol: float, max_time: float
) -> tuple[Segment, str, bool] | None:
    """(segment, next mode, whether it is surely a motion of its mode) of a phase without a mesh: its `w` are the states
    at which steps begin.

    x, p, scale: (n,) state, parameters, (n,) sizes of the states; tol, max_time: as of `march`.
    Returns None where it has to be followed otherwise: in closed form, by intervals where the mode is stiff, through an
    event that leads back into it.
    """
    mode, exits = system.modes[name], system.exits[name]
    if mode.flow is not None or not mode.smooth:
        return None
    try:
        found = _Steps(mode, exits, p, scale, OF_THE_TOLERANCE * tol).run(x / scale, max_time)
    except Lost:
        return None
    states, duration = found.states * scale, float(found.times[-1])
    if not duration > 0:
        return None
    jumped, successor, event = None, name, ""
    if found.way_out is not None:
        jumped, event = behind(found.way_out, states[-1], p), found.way_out.event.name
        successor = found.way_out.successor(states[-1] if jumped is None else jumped, p)
        if successor == name and jumped is None and not found.way_out.mark:  # it was grazed: the phase goes on
            return None
    segment = Segment(name, event, duration, found.times / duration, states[:-1], states[-1], jumped)
    holds = mode.admissible is None or mode.admissible(states[-1], p, mode.sign) >= -mode.slack - PASSED
    return segment, successor, found.clean and bool(holds)


class _Steps:
    """The steps of one mode."""

    def __init__(self, mode: VectorMode, exits: tuple[Exit, ...], p: Array, scale: Array, tol: float) -> None:
        self._mode, self._exits, self._tol = mode, exits, tol
        self._fixed = mode.sign, p, scale, [way_out.direction for way_out in exits]
        self._own = [i for i, way_out in enumerate(exits) if not way_out.mark or way_out.reset is not None]
        self._compiled = lambda implicit: steps_of(mode, exits, scale.size, p.size, implicit)
        self._take(mode.stiff)

    def _take(self, implicit: bool) -> None:
        """Steps of one kind from now on."""
        self._implicit = implicit
        self._many, self._one, self._lands = (each.buffers for each in self._compiled(implicit))
        for buffers in (self._many, self._one, self._lands):
            for store, value in zip(buffers.inputs[-4:], self._fixed, strict=True):
                store[:] = value

    def run(self, x: Array, max_time: float) -> Followed:
        """From a scaled state (n,) to the first exit, or to the end of the time.  Raises Lost, effort.GivenUp."""
        n, E = x.size, len(self._exits)
        tables, t, h, many, clean = [np.array([[*x, 0.0]])], 0.0, 0.0, 0, True
        while many < STEPS_OF_A_PHASE:
            if many >= STEPS_OF_A_SLIP and not self._implicit:
                if not _rings(np.vstack(tables)[-STEPS_OF_A_CALL:, :n], self._tol / OF_THE_TOLERANCE):
                    self._take(implicit=True)
            effort.interval()
            table, lows, at_first = self._steps(x, (t, h, max_time - t, self._tol, t == 0))
            good = table[1:, n + 2] > 0
            m = int(np.count_nonzero(good))
            rows = table[1 : m + 1] if good[:m].all() else table[1:][good]
            if not m:
                raise Lost
            if t == 0:
                h = float(rows[0, n + 2])
                if h <= max(lows, default=0.0):  # it is not seen yet to which side an event is left
                    continue
                if any(low > 0 and self._dips(i, x, table[0, n + 4 + i]) for i, low in enumerate(lows)):
                    raise Lost
                near = [i for i in self._own if abs(at_first[i]) <= NEAR_EVENT]
                clean = table[0, n + 3] >= 0 and not any(rows[:3, n + 4 + i].min() > 0 for i in near)
            before, last = (rows[-2] if m > 1 else table[0]), rows[-1]
            start, length = (before[:n], float(before[n])), float(last[n + 2])
            met = self._first(start, lows if m == 1 else [0.0] * E, before[n + 4 :].tolist(), length,
                              last[n + 4 :].tolist())  # fmt: skip
            many += m
            clean &= bool(rows[: m - (met is not None), n + 3].min(initial=0.0) >= 0)
            if met is not None:
                tables.append(rows[:-1, : n + 1])
                if met.way_out is not None:
                    states = np.vstack([*tables, [[*met.state, met.time]]])
                    return Followed(states[:, n], states[:, :n], met.way_out, clean)
                (x, t), h = start, met.time - start[1]
                continue
            tables.append(rows[:, : n + 1])
            x, t, h = last[:n], float(last[n]), float(last[n + 1])
            if not np.isfinite(x).all():
                raise Lost
            if t >= max_time * (1 - 4 * ROUNDING_OF_ONE):
                states = np.vstack(tables)
                return Followed(states[:, n], states[:, :n], None, clean)
        raise Lost

    def _dips(self, i: int, x: Array, seen: float) -> bool:
        """Whether an event that is not seen below zero just behind the start went there, and has come back."""
        if seen < 0:
            return False
        way_out, (_, p, scale, _) = self._exits[i], self._fixed
        return at_speed(self._mode, way_out.event, -way_out.direction, x * scale, p)

    def _steps(self, x: Array, given: tuple[float, ...]) -> tuple[Array, list[float], list[float]]:
        """The next steps: their table, where each event was seen first, and what it was at the start."""
        self._many.inputs[0][:], self._many.inputs[1][:] = x, given
        self._many.trigger()
        table, lows, at_first = self._many.outputs
        return table.copy(), lows.tolist(), at_first.tolist()

    def _at(self, x: Array, t: float, h: float) -> list[Array]:
        """State, events and their rates after one step, and its error in units of what it may be."""
        self._one.inputs[0][:], self._one.inputs[1][:] = x, (t, h, self._tol)
        self._one.trigger()
        return [out.copy() for out in self._one.outputs]

    def _first(
        self, start: tuple[Array, float], lows: list[float], low: list[float], length: float, high: list[float]
    ) -> Landing | None:
        """The first exit within a step, from scaled state and time; None where there is none.  Raises Lost.

        lows, low: where in it each event is known first, events and rates there; high: those at its end.  An event that
        rises towards zero at the start and falls at the end has its top in between.
        """
        best, E = None, len(self._exits)
        for i in range(E):
            crossed = low[i] < 0 <= high[i]
            if not (crossed or low[i] < 0 and high[i] < 0 and low[E + i] > 0 and high[E + i] < 0):
                continue
            below, beyond = Place(lows[i], low[i], low[E + i]), Place(length, high[i], high[E + i])
            above = beyond if crossed else self._above(start, i, below, beyond)
            if above is None:
                continue
            s, end, good = self._zero(start, i, below, above)
            if not good:
                return Landing(start[1] + TAKEN_FIRST * s, end, None)
            if best is None or start[1] + s < best.time:
                best = Landing(start[1] + s, end, self._exits[i])
        return best

    def _above(self, start: tuple[Array, float], i: int, low: Place, high: Place) -> Place | None:
        """Where an event that rises at one place below zero and falls at another is above it; None: nowhere between.

        Between them it is below its tangents, for whose slopes twice as much is taken.
        """
        for _ in range(MOST_HALVINGS):
            width = high.s - low.s
            top = min(low.event + 2 * low.rate * width, high.event - 2 * high.rate * width)
            if top < 0 or width <= 4 * ROUNDING_OF_ONE * high.s:
                return None
            part = min(max(low.rate / (low.rate - high.rate), LEAST_PART), 1 - LEAST_PART)
            place = self._seen(start, i, low.s + part * width)[0]
            if place.event > 0:
                return place
            low, high = (place, high) if place.rate > 0 else (low, place)
        return None

    def _seen(self, start: tuple[Array, float], i: int, s: float) -> tuple[Place, Array]:
        """An event, and the state, after a step of a length.  Raises Lost."""
        end, events, rates, error = self._at(*start, s)
        if not np.isfinite(events[i]):
            raise Lost
        return Place(s, float(events[i]), float(rates[i]), float(error[0])), end

    def _zero(self, start: tuple[Array, float], i: int, low: Place, high: Place) -> tuple[float, Array, bool]:
        """Length of the step at whose end an event vanishes to rounding, from below to above; the state there; and
        whether that is as good as the end of another step."""
        if high.event == 0:
            return high.s, self._seen(start, i, high.s)[1], True
        small, (x, t) = EVENT_TOLERANCE * max(-low.event, high.event), start
        c: list[float] = [_cubic_zero(low, high), high.s, low.s, low.event, high.s, high.event, np.inf, 0, 0]
        for _ in range(0, MOST_HALVINGS, PLACES_OF_A_CALL):
            state, places, given = self._lands.inputs[:3]
            state[:], places[:], given[:] = x, c, (t, self._tol, small, i)
            self._lands.trigger()
            c, end, (event, error) = (out.tolist() for out in self._lands.outputs)
            if c[-1]:
                return c[0], np.array(end), error <= 1
            if not np.isfinite(event):
                raise Lost
        return c[0], np.array(end), False


def _rings(states: Array, tol: float) -> bool:
    """Whether one of the states (m, n) goes to and fro, by more than a tolerance."""
    moved = np.diff(states, axis=0)
    back = (moved[1:] * moved[:-1] < 0) & (np.minimum(np.abs(moved[1:]), np.abs(moved[:-1])) > tol)
    return bool(back.any())


def _cubic_zero(low: Place, high: Place) -> float:
    """Where the cubic through two places vanishes, about."""
    h = high.s - low.s
    c = 3 * (high.event - low.event) - h * (2 * low.rate + high.rate)
    d = 2 * (low.event - high.event) + h * (low.rate + high.rate)
    bracket = Bracket(0.0, low.event, 1.0, high.event)
    part = bracket.illinois
    for _ in range(ROUNDS_OF_A_CUBIC):
        f = low.event + part * (h * low.rate + part * (c + part * d))
        if f == 0:
            break
        bracket = bracket.told(part, f)
        part = bracket.newton(part, f, h * low.rate + part * (2 * c + part * 3 * d))
    return low.s + part * h
