"""Marching without a mesh: a mode followed to its exit by extrapolated midpoint steps, compiled, many in a call.

    m substeps      y_0 = x,  y_1 = x + d f(x),  y_(i+1) = y_(i-1) + 2 d f(y_i),  d = h/m,    m_j = 2, 4, .., 2 K
    extrapolation   T_(j,1) = y_m,  T_(j,k) = T_(j,k-1) + (T_(j,k-1) - T_(j-1,k-1)) / ((m_j/m_(j-k))^2 - 1), order 2 K
    error           |T_(K,K) - T_(K,K-1)| <= tol;  the next step is 0.7 (tol/error)^(1/(2 K - 1)) times as long

For who only asks what becomes of a motion: states at the ends of steps, and the exit, located by steps that end on its
event; no stages.  A tenth of the price of power series (march_series.py), which know what lies within a step.

Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, section II.9.
Symbols: n states, E exits, M steps of a call.
"""

from __future__ import annotations

from typing import NamedTuple

import casadi as ca
import numpy as np

from .. import effort
from ..compiled import Caller, caller, kept
from ..hybrid.system import Exit, Field, VectorMode, VectorSystem
from ..roots import MOST_HALVINGS, Bracket
from .march_exits import EVENT_TOLERANCE, behind
from .march_watch import ON_EVENT
from .segment import Segment

Array = np.ndarray

EXTRAPOLATIONS = 5
"""K: steps of order 10."""
STEPS_TOGETHER, MOST_CALLS = 16, 6
"""Steps of a call, and calls of a phase: a slip takes some 40 steps, and what takes more than that is stiff."""
OF_THE_TOLERANCE = 1e-2
"""Error of a step, as a part of the tolerance of an interval, whose end is as much better than its inside."""
PART_OF_A_STEP, LEAST_GROWTH, MOST_GROWTH = 0.7, 0.1, 3.0
"""The next step, in units of the one that would have the tolerance; and in units of this one, at least and at most."""
FIRST_MOVES = 1e-3
"""No state moves by a larger part of its size in the first step of a phase."""
ROUNDING_OF_ONE = float(np.finfo(float).eps)
SEEN_BEHIND = 1e-3
"""Part of the first step after which it is seen to which side an event is left."""


class Followed(NamedTuple):
    """A phase: times (M,) and scaled states (M, n) at the ends of its steps; the exit, None where the time is over."""

    times: Array
    states: Array
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


def _midpoint(f: ca.Function, x: ca.SX, rate: ca.SX, h: ca.SX) -> tuple[ca.SX, ca.SX]:
    """The end of a step, and by how much the last two of its approximations differ."""
    counts, rows = [2 * j for j in range(1, EXTRAPOLATIONS + 1)], list[list[ca.SX]]()
    for j, m in enumerate(counts):
        d, before, y = h / m, x, x + h / m * rate
        for _ in range(m - 1):
            before, y = y, before + 2 * d * f(y)
        row = [y]
        for k in range(1, j + 1):
            row.append(row[-1] + (row[-1] - rows[-1][k - 1]) / ((m / counts[j - k]) ** 2 - 1))
        rows.append(row)
    return rows[-1][-1], rows[-1][-1] - rows[-1][-2]


@kept(maxsize=64)
def _compiled(field: Field, exits: tuple[Exit, ...], n: int, parameters: int) -> tuple[Caller, Caller]:
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
    end, off = _midpoint(f, x, rate, tried)
    error = ca.mmax(ca.fabs(off) / ca.fmax(1, ca.fabs(x))) / tol
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
    exact, _ = _midpoint(f, x, rate, h)
    one = ca.Function("one", [x, ca.vertcat(t, h), sign, p, scale], [exact, *watched(exact, t + h)])
    M, E = STEPS_TOGETHER, len(exits)
    return (caller(many, [n, 4, 1, parameters, n], [(M, n), M, M, M, (M, E), (M, E)]),
            caller(one, [n, 2, 1, parameters, n], [n, E, E]))  # fmt: skip


class _Steps:
    """The steps of one mode."""

    def __init__(self, mode: VectorMode, exits: tuple[Exit, ...], p: Array, scale: Array, tol: float) -> None:
        many, one = _compiled(mode.field, exits, scale.size, p.size)
        self._many, self._one, self._exits, self._tol = many.buffers, one.buffers, exits, tol
        self._fixed = mode.sign, p, scale

    def run(self, x: Array, max_time: float) -> Followed:
        """From a scaled state (n,) to the first exit, or to the end of the time.  Raises Lost, effort.GivenUp."""
        times, states, t, h = [np.zeros(1)], [x[None]], 0.0, 0.0
        e_last, r_last = self._at(x, t, 0.0)[1:]
        on = np.abs(e_last) <= ON_EVENT
        for _ in range(MOST_CALLS):
            effort.interval()
            ends, after, lengths, taken, e, r = self._steps(x, t, h, max_time - t)
            good = taken > 0
            if not good.any():
                raise Lost
            ends, after, e, r = ends[good], after[good], e[good], r[good]
            if on.any():  # to which side an event is left on which the phase begins; it is not looked at before
                just = SEEN_BEHIND * float(taken[good][0])
                found = self._at(x, t, just)
                ends, e, r = (np.vstack(both) for both in zip(found, (ends, e, r), strict=True))
                after, e_last, on = np.append(t + just, after), np.where(on, np.nan, e_last), on & False
            ends, after = np.vstack([x, ends]), np.append(t, after)
            e, r = np.vstack([e_last, e]), np.vstack([r_last, r])
            crossing = self._first(ends, after, e, r)
            many = len(after) if crossing is None else crossing[0] + 1
            times.append(after[1:many])
            states.append(ends[1:many])
            if crossing is not None:
                _, place, end, way_out = crossing
                return Followed(np.append(np.concatenate(times), place), np.vstack([*states, end]), way_out)
            x, t, h, e_last, r_last = ends[-1], float(after[-1]), float(lengths[-1]), e[-1], r[-1]
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
        """State, events and their rates after one step."""
        for store, value in zip(self._one.inputs, (x, (t, h), *self._fixed), strict=True):
            store[:] = value
        self._one.trigger()
        return [out.copy() for out in self._one.outputs]

    def _first(self, states: Array, times: Array, e: Array, r: Array) -> tuple[int, float, Array, Exit] | None:
        """The first exit: number of the step, time, state and exit; None where there is none.  Raises Lost.

        An event that rises towards zero at the start of a step and falls at its end has its top in between.
        """
        crossed = (e[:-1] < 0) & (e[1:] >= 0)
        tops = (e[:-1] < 0) & (e[1:] < 0) & (r[:-1] > 0) & (r[1:] < 0)
        best: tuple[float, Array, Exit] | None = None
        for k in np.flatnonzero((crossed | tops).any(axis=1)).tolist():
            start, h = (states[k], float(times[k])), float(times[k + 1] - times[k])
            for i in np.flatnonzero(crossed[k] | tops[k]).tolist():
                high, f_high = h, float(e[k + 1, i])
                if not crossed[k, i]:
                    high, end = self._zero(start, 2, i, (0.0, float(r[k, i])), (h, float(r[k + 1, i])))
                    f_high = float(end[1][i])
                    if f_high <= 0:
                        continue
                s, end = self._zero(start, 1, i, (0.0, float(e[k, i])), (high, f_high))
                if best is None or s < best[0]:
                    best = s, end[0], self._exits[i]
            if best is not None:
                return k, start[1] + best[0], best[1], best[2]
        return None

    def _zero(
        self, start: tuple[Array, float], which: int, i: int, low: tuple[float, float], high: tuple[float, float]
    ) -> tuple[float, list[Array]]:
        """Length of the step at whose end an event, or its rate, vanishes to rounding; and what is there."""
        s, f = high
        end = self._at(*start, s)
        if f == 0:
            return s, end
        bracket, small = Bracket(*low, *high), EVENT_TOLERANCE * max(abs(low[1]), abs(f))
        for _ in range(MOST_HALVINGS):
            slope, before = float(end[2][i]) if which == 1 else 0.0, s
            s = bracket.newton(s, f, slope) if slope and bracket.holds(s) else bracket.illinois
            end = self._at(*start, s)
            f = float(end[which][i])
            if not np.isfinite(f):
                raise Lost
            if abs(f) <= small or min(abs(s - before), bracket.width) <= 4 * ROUNDING_OF_ONE * s:
                break
            bracket = bracket.told(s, f)
        return s, end
