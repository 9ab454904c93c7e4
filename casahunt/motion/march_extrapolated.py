"""Marching without a mesh: a mode followed to its exit by extrapolated midpoint steps, compiled, many in a call.

    m substeps      y_0 = x,  y_1 = x + d f(x),  y_(i+1) = y_(i-1) + 2 d f(y_i),  d = h/m,    m_j = 2, 4, .., 2 K
    extrapolation   T_(j,1) = y_m,  T_(j,k) = T_(j,k-1) + (T_(j,k-1) - T_(j-1,k-1)) / ((m_j/m_(j-k))^2 - 1), order 2 K
    error           |T_(K,K) - T_(K,K-1)| <= tol;  the next step is 0.7 (tol/error)^(1/(2 K - 1)) times as long

For who only asks what becomes of a motion: states at the ends of steps, and the exit, located by steps that end on its
event; no stages.  A tenth of the price of power series (march_series.py), which know what lies within a step.

A step can seem good because it goes past what its field does in between, such as a drop about the zero of a rate that
is an event: the step that ends there has to be as good, and its substeps have to see the mode's feature come, or a
shorter one is taken before.

Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, section II.9.
Symbols: n states, E exits, M steps of a call.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from .. import effort
from ..collocation.admissibility import LARGEST_JUMP
from ..compiled import Caller, caller, kept
from ..hybrid.system import Exit, Feature, Field, VectorMode, VectorSystem
from ..hybrid.vector_form import Bound
from ..roots import MOST_HALVINGS, Bracket
from .march_exits import EVENT_TOLERANCE, behind
from .march_watch import ON_EVENT
from .segment import Segment

Array = np.ndarray

EXTRAPOLATIONS = 5
"""K: steps of order 10."""
STEPS_TOGETHER, CALLS_OF_A_SLIP, MOST_CALLS = 16, 10, 40
"""Steps of a call, and calls of a phase: a slip takes 30 to 110 steps, what rings beside it hundreds.  What does not
ring any more, by more than the tolerance, and goes on, is stiff, and left to intervals, four times as dear a step."""
OF_THE_TOLERANCE = 1e-2
"""Error of a step, as a part of the tolerance of an interval, whose end is as much better than its inside."""
PART_OF_A_STEP, LEAST_GROWTH, MOST_GROWTH = 0.7, 0.1, 3.0
"""The next step, in units of the one that would have the tolerance; and in units of this one, at least and at most."""
FIRST_MOVES = 1e-3
"""No state moves by a larger part of its size in the first step of a phase."""
LEAST_PART, ROUNDS_OF_A_CUBIC = 0.1, 3
"""Of a bracket its next place cuts off so much at least; steps to the zero of a cubic, from where others begin."""
ROUNDING_OF_ONE = float(np.finfo(float).eps)
TAKEN_FIRST = 0.8
"""Part of a step to an event that is taken first, where the whole one is not good enough."""
SEEN_BEHIND = 1e-3
"""Part of the first step after which it is seen to which side an event is left."""


class Followed(NamedTuple):
    """A phase: times (M,) and scaled states (M, n) at the ends of its steps; the exit, None where the time is over."""

    times: Array
    states: Array
    way_out: Exit | None


class Place(NamedTuple):
    """A length of a step, an event and its rate at the end, and the error of the step in units of what it may be."""

    s: float
    event: float
    rate: float
    error: float = 0.0


class Landing(NamedTuple):
    """Where the first exit of some steps is: the step's number; time, state, and the exit.

    way_out: None where a step to it is not good enough; time: of the end of a shorter one.
    """

    number: int
    time: float
    state: Array
    way_out: Exit | None


class Lost(Exception):
    """Steps are many, as in a stiff mode, or became nothing, or an event is no number on the way to its zero."""


def by_steps(
    system: VectorSystem, name: str, x: Array, p: Array, scale: Array, tol: float, max_time: float
) -> tuple[Segment, str] | None:
    """(segment, next mode) of a phase without a mesh: its `w` are the states at which steps begin.

    x, p, scale: (n,) state, parameters, (n,) sizes of the states; tol, max_time: as of `march`.
    Returns None where it has to be followed otherwise: in closed form, by intervals where the mode is stiff, through an
    event that leads back into it.
    """
    mode, exits = system.modes[name], system.exits[name]
    if mode.stiff or mode.flow is not None:
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
    return Segment(name, event, duration, found.times / duration, states[:-1], states[-1], jumped), successor


def _midpoint(f: ca.Function, x: ca.SX, rate: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
    """The end of a step, by how much the last two of its approximations differ, and its shortest substeps."""
    counts, rows = [2 * j for j in range(1, EXTRAPOLATIONS + 1)], list[list[ca.SX]]()
    for j, m in enumerate(counts):
        d, passed = h / m, [x, x + h / m * rate]
        for _ in range(m - 1):
            passed.append(passed[-2] + 2 * d * f(passed[-1]))
        row = [passed[-1]]
        for k in range(1, j + 1):
            row.append(row[-1] + (row[-1] - rows[-1][k - 1]) / ((m / counts[j - k]) ** 2 - 1))
        rows.append(row)
    return rows[-1][-1], rows[-1][-1] - rows[-1][-2], passed


def _error(off: ca.SX, x: ca.SX, tol: ca.SX) -> ca.SX:
    """That of a step, in units of what it may be."""
    return ca.mmax(ca.fabs(off) / ca.fmax(1, ca.fabs(x))) / tol


@kept(maxsize=64)
def _compiled(
    field: Field, feature: Feature | None, exits: tuple[Exit, ...], n: int, parameters: int
) -> tuple[Caller, Caller]:
    """`STEPS_TOGETHER` steps in a row; and one of a given length."""
    x, sign, p, scale = ca.SX.sym("x", n), ca.SX.sym("sign"), ca.SX.sym("p", parameters), ca.SX.sym("scale", n)
    t, h, left, tol = (ca.SX.sym(name) for name in ("t", "h", "left", "tol"))
    field_at = ca.Function("f", [x, sign, p, scale], [ca.densify(ca.SX(field(scale * x, p, sign)) / scale)])

    def f(y: ca.SX) -> ca.SX:
        return field_at(y, sign, p, scale)

    def watched(y: ca.SX, time: ca.SX) -> list[ca.SX]:
        """Events, in the direction of their exits, and the rates at which they rise."""
        at, T = ca.SX.sym("at", n), ca.SX.sym("T")
        events = ca.densify(ca.vertcat(*[e.direction * e.event.function(scale * at, T, p) for e in exits], ca.SX(0, 1)))
        rates = ca.jtimes(events, at, f(at)) + ca.jacobian(events, T)
        return ca.substitute([events, ca.densify(rates)], [at, T], [y, time])

    rate = f(x)
    first = FIRST_MOVES / ca.fmax(ca.mmax(ca.fabs(rate)), 1e-300)
    tried = ca.fmin(ca.if_else(h > 0, h, first), left)
    end, off, _ = _midpoint(f, x, rate, tried)
    error = _error(off, x, tol)
    good = ca.logic_and(error <= 1, ca.sum1(end * 0) == 0)
    factor = PART_OF_A_STEP * ca.fmax(error, 1e-30) ** (-1 / (2 * EXTRAPOLATIONS - 1))
    factor = ca.if_else(error >= 0, ca.fmin(ca.fmax(factor, LEAST_GROWTH), MOST_GROWTH), LEAST_GROWTH)
    taken = ca.if_else(good, tried, 0)
    end = ca.if_else(good, end, x)
    step = ca.Function("step", [x, t, h, left, tol, sign, p, scale],
                       [end, t + taken, tried * factor, left - taken, taken, *watched(end, t + taken)])  # fmt: skip
    X, P, S, G = ca.MX.sym("x", n), ca.MX.sym("p", parameters), ca.MX.sym("scale", n), ca.MX.sym("sign")
    given = ca.MX.sym("given", 4)
    state, found = [X, *ca.vertsplit(given)[:3]], list[list[ca.MX]]()
    for _ in range(STEPS_TOGETHER):
        *state, taken_, e, r = step(*state, given[3], G, P, S)
        found.append([state[0], state[1], state[2], taken_, e, r])
    many = ca.Function("steps", [X, given, G, P, S], [ca.horzcat(*columns) for columns in zip(*found, strict=True)])
    exact, off, passed = _midpoint(f, x, rate, h)
    jumps = ca.SX(0)
    if isinstance(feature, Bound):
        jumps = ca.mmax(ca.fabs(ca.diff(ca.vertcat(*[feature(scale * y, p) for y in passed])))) / LARGEST_JUMP
    one = ca.Function("one", [x, ca.vertcat(t, h, tol), sign, p, scale],
                      [exact, *watched(exact, t + h), ca.fmax(_error(off, x, tol), jumps)])  # fmt: skip
    M, E = STEPS_TOGETHER, len(exits)
    return (caller(many, [n, 4, 1, parameters, n], [(M, n), M, M, M, (M, E), (M, E)]),
            caller(one, [n, 3, 1, parameters, n], [n, E, E, 1]))  # fmt: skip


class _Steps:
    """The steps of one mode."""

    def __init__(self, mode: VectorMode, exits: tuple[Exit, ...], p: Array, scale: Array, tol: float) -> None:
        many, one = _compiled(mode.field, mode.feature, exits, scale.size, p.size)
        self._many, self._one, self._exits, self._tol = many.buffers, one.buffers, exits, tol
        self._fixed = mode.sign, p, scale

    def run(self, x: Array, max_time: float) -> Followed:
        """From a scaled state (n,) to the first exit, or to the end of the time.  Raises Lost, effort.GivenUp."""
        times, states, t, h = [np.zeros(1)], [x[None]], 0.0, 0.0
        e_last, r_last = self._at(x, t, 0.0)[1:3]
        on = np.abs(e_last) <= ON_EVENT
        for call in range(MOST_CALLS):
            if call >= CALLS_OF_A_SLIP and not _rings(states[-1], self._tol / OF_THE_TOLERANCE):
                break
            effort.interval()
            ends, after, lengths, taken, e, r = self._steps(x, t, h, max_time - t)
            if not (good := taken > 0).all():
                if not good.any():
                    raise Lost
                ends, after, taken, e, r = ends[good], after[good], taken[good], e[good], r[good]
            if on.any():  # to which side an event is left on which the phase begins; it is not looked at before
                just = SEEN_BEHIND * float(taken[0])
                found = self._at(x, t, just)[:3]
                ends, e, r = (np.vstack(both) for both in zip(found, (ends, e, r), strict=True))
                after, e_last, on = np.append(t + just, after), np.where(on, np.nan, e_last), on & False
            ends, after = np.concatenate([x[None], ends]), np.concatenate([[t], after])
            e, r = np.concatenate([e_last[None], e]), np.concatenate([r_last[None], r])
            crossing = self._first(ends, after, e, r)
            last = len(after) - 1 if crossing is None else crossing.number
            times.append(after[1 : last + 1])
            states.append(ends[1 : last + 1])
            if crossing is not None and crossing.way_out is not None:
                _, place, end, way_out = crossing
                return Followed(np.append(np.concatenate(times), place), np.vstack([*states, end]), way_out)
            x, t, e_last, r_last = ends[last], float(after[last]), e[last], r[last]
            h = float(lengths[-1]) if crossing is None else crossing.time - t
            if not np.isfinite(x).all():
                raise Lost
            if t >= max_time * (1 - 4 * ROUNDING_OF_ONE):
                return Followed(np.concatenate(times), np.vstack(states), None)
        raise Lost

    def _steps(self, x: Array, t: float, h: float, left: float) -> list[Array]:
        """The next steps."""
        for store, value in zip(self._many.inputs, (x, (t, h, left, self._tol), *self._fixed), strict=True):
            store[:] = value
        self._many.trigger()
        return [out.copy() for out in self._many.outputs]

    def _at(self, x: Array, t: float, h: float) -> list[Array]:
        """State, events and their rates after one step, and its error in units of what it may be."""
        for store, value in zip(self._one.inputs, (x, (t, h, self._tol), *self._fixed), strict=True):
            store[:] = value
        self._one.trigger()
        return [out.copy() for out in self._one.outputs]

    def _first(self, states: Array, times: Array, e: Array, r: Array) -> Landing | None:
        """The first exit; None where there is none.  Raises Lost.

        An event that rises towards zero at the start of a step and falls at its end has its top in between.
        """
        below = e[:-1] < 0
        crossed = below & (e[1:] >= 0)
        tops = below & (e[1:] < 0) & (r[:-1] > 0) & (r[1:] < 0)
        best: Landing | None = None
        for k in np.flatnonzero((crossed | tops).any(axis=1)).tolist():
            start, h = (states[k], float(times[k])), float(times[k + 1] - times[k])
            for i in np.flatnonzero(crossed[k] | tops[k]).tolist():
                low = Place(0.0, float(e[k, i]), float(r[k, i]))
                high = Place(h, float(e[k + 1, i]), float(r[k + 1, i]))
                above = high if crossed[k, i] else self._above(start, i, low, high)
                if above is None:
                    continue
                s, end, good = self._zero(start, i, low, above)
                if not good:
                    return Landing(k, start[1] + TAKEN_FIRST * s, end, None)
                if best is None or start[1] + s < best.time:
                    best = Landing(k, start[1] + s, end, self._exits[i])
            if best is not None:
                return best
        return None

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
        bracket, small = Bracket(low.s, low.event, high.s, high.event), EVENT_TOLERANCE * max(-low.event, high.event)
        s, before = _cubic_zero(low, high), high.s
        for _ in range(MOST_HALVINGS):
            at, end = self._seen(start, i, s)
            if abs(at.event) <= small or min(abs(s - before), bracket.width) <= 4 * ROUNDING_OF_ONE * s:
                return s, end, at.error <= 1
            bracket, before = bracket.told(s, at.event), s
            s = bracket.newton(s, at.event, at.rate)
        return s, end, False


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
