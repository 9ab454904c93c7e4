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

from collections.abc import Callable
from typing import NamedTuple

import casadi as ca
import numpy as np

from .. import effort
from ..collocation.admissibility import LARGEST_JUMP, PASSED
from ..compiled import Caller, caller, kept
from ..hybrid.system import Exit, Feature, VectorMode, VectorSystem
from ..hybrid.vector_form import Bound
from ..roots import MOST_HALVINGS, Bracket
from .march_exits import EVENT_TOLERANCE, behind
from .march_watch import NEAR_EVENT, ON_EVENT
from .segment import Segment

Array = np.ndarray

EXTRAPOLATIONS = 5
"""K: steps of order 10."""
EXPLICIT, IMPLICIT = (2, 4, 6, 8, 10), (2, 6, 10, 14, 22)
"""m_j; a step of implicit substeps is three times as dear."""
STEPS_TOGETHER, STEPS_OF_A_SLIP, MOST_STEPS = 32, 32, 640
"""Steps of a call, at most, and of a phase: a slip takes 15 to 60 steps, what rings beside it hundreds.  What does not
ring any more, by more than the tolerance, and goes on, is stiff."""
OF_THE_TOLERANCE = 1e-2
"""Error of a step, as a part of the tolerance of an interval, whose end is as much better than its inside."""
PART_OF_A_STEP, LEAST_GROWTH, MOST_GROWTH = 0.7, 0.1, 3.0
"""The next step, in units of the one that would have the tolerance; and in units of this one, at least and at most."""
FIRST_MOVES = 1e-3
"""No state moves by a larger part of its size in the first step of a phase."""
LEAST_PART, ROUNDS_OF_A_CUBIC = 0.1, 3
"""Of a bracket its next place cuts off so much at least; steps to the zero of a cubic, from where others begin."""
ROUNDING_OF_ONE = float(np.finfo(float).eps)
NOISE, PLACES_TOGETHER = 3, 8
"""Places in a row at which an event that is zero but for rounding becomes no smaller: it is that of its terms;
and places in a call."""
TAKEN_FIRST = 0.8
"""Part of a step to an event that is taken first, where the whole one is not good enough."""
SEEN_BEHIND = 1e-3
"""Part of the first step after which it is seen to which side an event is left."""


class Followed(NamedTuple):
    """A phase: times (M,) and scaled states (M, n) at the ends of its steps; the exit, None where the time is over;
    whether its mode holds at the ends of its steps, and it does not begin on an event of its own to go on through it."""

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
    """Steps are many, as in a stiff mode, or became nothing, or an event is no number on the way to its zero."""


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


def _midpoint(f: ca.Function, x: ca.SX, rate: ca.SX, h: ca.SX, A: ca.SX | None) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
    """The end of a step, by how much the last two of its approximations differ, and its shortest substeps.

    A: the Jacobian of f at x, by which the substeps are implicit; None for explicit ones.
    """
    counts, rows = EXPLICIT if A is None else IMPLICIT, list[list[ca.SX]]()
    for j, m in enumerate(counts):
        d = h / m
        if A is None:
            passed = [x, x + d * rate]
            for _ in range(m - 1):
                passed.append(passed[-2] + 2 * d * f(passed[-1]))
            row = [passed[-1]]
        else:
            solved = _solver(ca.SX.eye(x.numel()) - d * A)
            moved = solved(d * rate)
            passed = [x, x + moved]
            for _ in range(m - 1):
                moved = moved + 2 * solved(d * f(passed[-1]) - moved)
                passed.append(passed[-1] + moved)
            row = [passed[-1] + solved(d * f(passed[-1]) - moved)]
        for k in range(1, j + 1):
            row.append(row[-1] + (row[-1] - rows[-1][k - 1]) / ((m / counts[j - k]) ** 2 - 1))
        rows.append(row)
    return rows[-1][-1], rows[-1][-1] - rows[-1][-2], passed


def _solver(M: ca.SX) -> Callable[[ca.SX], ca.SX]:
    """b -> the solution of M x = b, eliminated without pivots: M is near 1, or the step not good."""
    n = M.size1()
    left = [[M[i, k] for k in range(n)] for i in range(n)]
    factors = list[tuple[int, int, ca.SX]]()
    for k in range(n):
        for i in range(k + 1, n):
            if not left[i][k].is_zero():
                factors.append((i, k, left[i][k] / left[k][k]))
                left[i] = [a if c.is_zero() else a - factors[-1][2] * c for a, c in zip(left[i], left[k], strict=True)]

    def solved(b: ca.SX) -> ca.SX:
        y = [b[i] for i in range(n)]
        for i, k, factor in factors:
            y[i] = y[i] - factor * y[k]
        for i in reversed(range(n)):
            for k in range(i + 1, n):
                y[i] = y[i] if left[i][k].is_zero() else y[i] - left[i][k] * y[k]
            y[i] = y[i] / left[i][i]
        return ca.vertcat(*y)

    return solved


def _error(off: ca.SX, x: ca.SX, tol: ca.SX) -> ca.SX:
    """That of a step, in units of what it may be."""
    return ca.mmax(ca.fabs(off) / ca.fmax(1, ca.fabs(x))) / tol


class _Formulas:
    """A mode's field and events at scaled states, in symbols."""

    def __init__(self, mode: VectorMode, exits: tuple[Exit, ...], n: int, parameters: int, implicit: bool) -> None:
        self.x, self.sign, self.p = ca.SX.sym("x", n), ca.SX.sym("sign"), ca.SX.sym("p", parameters)
        self.scale, self.t, self.h, self.tol = ca.SX.sym("scale", n), *(ca.SX.sym(name) for name in ("t", "h", "tol"))
        self.fixed = self.sign, self.p, self.scale
        rate = ca.densify(ca.SX(mode.field(self.scale * self.x, self.p, self.sign)) / self.scale)
        self.f = ca.Function("f", [self.x, *self.fixed], [rate])
        self.rate, self.A = rate, ca.jacobian(rate, self.x) if implicit else None
        events = [e.direction * e.event.function(self.scale * self.x, self.t, self.p) for e in exits]
        e = ca.densify(ca.vertcat(*events, ca.SX(0, 1)))
        r = ca.densify(ca.jtimes(e, self.x, rate) + ca.jacobian(e, self.t))
        self.events = ca.Function("events", [self.x, self.t, *self.fixed], [e, r])
        holds = ca.SX(0) if mode.admissible is None else mode.admissible(self.scale * self.x, self.p, self.sign)
        self.holds = ca.Function("holds", [self.x, *self.fixed], [ca.densify(ca.SX(holds)) + mode.slack + PASSED])

    def step(self, h: ca.SX) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
        """Its end, error in units of what it may be, and shortest substeps."""
        end, off, passed = _midpoint(lambda y: self.f(y, *self.fixed), self.x, self.rate, h, self.A)
        return end, _error(off, self.x, self.tol), passed

    def watched(self, y: ca.SX, time: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Events, in the direction of their exits, and the rates at which they rise."""
        e, r = self.events(y, time, *self.fixed)
        return e, r


@kept(maxsize=64)
def _compiled(
    mode: VectorMode, exits: tuple[Exit, ...], n: int, parameters: int, implicit: bool
) -> tuple[Caller, Caller, Caller]:
    """`STEPS_TOGETHER` steps in a row, but none behind one in which an event may be met; one of a given length; and
    those that lead to the zero of an event.

    Rows of the first one's table: state, time, length of the next step and of this one, whether the mode holds (>= 0),
    events, rates.
    """
    E, of = len(exits), _Formulas(mode, exits, n, parameters, implicit)
    x, t, h, tol, left, over = of.x, of.t, of.h, of.tol, ca.SX.sym("left"), ca.SX.sym("over")
    e, r = ca.SX.sym("e", E), ca.SX.sym("r", E)
    first = FIRST_MOVES / ca.fmax(ca.mmax(ca.fabs(of.rate)), 1e-300)
    tried = ca.fmin(ca.if_else(h > 0, h, first), left)
    at_first = of.watched(x, t)
    begins = ca.Function("begins", [x, t, h, left, tol, *of.fixed],
                         [tried, *at_first, ca.SX.zeros(E, 1), at_first[0], ca.SX(0)])  # fmt: skip
    just = SEEN_BEHIND * tried
    on = ca.fabs(at_first[0]) <= ON_EVENT
    sides = (ca.if_else(on, *both) for both in zip(of.watched(of.step(just)[0], t + just), at_first, strict=True))
    leaves = ca.Function("leaves", [x, t, h, left, tol, *of.fixed],
                         [tried, *sides, ca.if_else(on, just, 0), at_first[0], of.holds(x, *of.fixed)])  # fmt: skip
    tried = ca.fmin(h, left)
    end, error, _ = of.step(tried)
    good = ca.logic_and(error <= 1, ca.sum1(end * 0) == 0)
    factor = PART_OF_A_STEP * ca.fmax(error, 1e-30) ** (-1 / (2 * EXTRAPOLATIONS - 1))
    factor = ca.if_else(error >= 0, ca.fmin(ca.fmax(factor, LEAST_GROWTH), MOST_GROWTH), LEAST_GROWTH)
    taken, end = ca.if_else(good, tried, 0), ca.if_else(good, end, x)
    e_end, r_end = (ca.if_else(good, a, b) for a, b in zip(of.watched(end, t + taken), (e, r), strict=True))
    rises = ca.logic_and(r > 0, r_end < 0)
    met = ca.logic_and(e < 0, ca.logic_or(e_end >= 0, rises))  # what was not taken meets nothing
    ends = [end, t + taken, tried * factor, left - taken, ca.logic_or(ca.sum1(met) > 0, left <= taken), e_end, r_end]
    known = [x, t, h, left, over, e, r]
    step = ca.Function("step", [*known, tol, *of.fixed], [*ends, taken, of.holds(end, *of.fixed)])
    same = ca.Function("same", [*known, tol, *of.fixed], [*known, ca.SX(0), ca.SX(0)])
    end, error, passed = of.step(h)
    error = ca.fmax(error, _jumps(mode.feature, [of.scale * y for y in passed], of.p))
    one = ca.Function("one", [x, ca.vertcat(t, h, tol), *of.fixed], [end, *of.watched(end, t + h), error])
    many = _in_a_row(begins, leaves, step, same, (n, E, parameters))
    M = STEPS_TOGETHER + 1
    return (caller(many, [n, 5, 1, parameters, n], [(M, n + 4 + 2 * E), E, E]),
            caller(one, [n, 3, 1, parameters, n], [n, E, E, 1]),
            caller(_to_a_zero(of, one, E), [n, 9, 4, 1, parameters, n], [9, n, 2]))  # fmt: skip


def _to_a_zero(of: _Formulas, one: ca.Function, exits: int) -> ca.Function:
    """(x, places, (t, tol, what is zero, number of the event), sign, p, scale) -> places, state, event and error.

    Places: length of the next step and of the last one; a bracket, lengths and events; the smallest event, and how
    often in a row it has become no smaller; whether the zero is found.  Newton's method, kept in the bracket.
    """
    c, given, end, told = ca.SX.sym("c", 9), ca.SX.sym("given", 4), ca.SX.sym("end", of.x.numel()), ca.SX.sym("told", 2)
    s, before, a, f_a, b, f_b, least, idle, _ = ca.vertsplit(c)
    t, tol, small, i = ca.vertsplit(given)
    state, events, rates, error = one(of.x, ca.vertcat(t, s, tol), *of.fixed)
    chosen = ca.DM(list(range(exits))) == i
    e, r = ca.dot(chosen, events), ca.dot(chosen, rates)
    halved = ca.fabs(e) <= least / 2
    least, idle = ca.if_else(halved, ca.fabs(e), least), ca.if_else(halved, 0, idle + 1)
    is_noise = ca.logic_and(idle >= NOISE, least <= EVENT_TOLERANCE)
    narrow = ca.fmin(ca.fabs(s - before), ca.fabs(b - a)) <= 4 * ROUNDING_OF_ONE * s
    over = ca.logic_or(ca.logic_or(is_noise, narrow), ca.fabs(e) <= small)
    moves_b = (e > 0) == (f_b > 0)
    a, f_a = ca.if_else(moves_b, a, s), ca.if_else(moves_b, f_a, e)
    b, f_b = ca.if_else(moves_b, s, b), ca.if_else(moves_b, e, f_b)
    newton = s - e / r
    inside = ca.logic_and(newton > ca.fmin(a, b), newton < ca.fmax(a, b))
    after = ca.vertcat(ca.if_else(over, s, ca.if_else(inside, newton, (a + b) / 2)), s, a, f_a, b, f_b, least, idle, over)
    known = [c, end, told]
    look = ca.Function("look", [*known, of.x, given, *of.fixed], [after, state, ca.vertcat(e, error)])
    same = ca.Function("same", [*known, of.x, given, *of.fixed], known)
    looks = ca.Function.if_else("looks", look, same)
    x, places, what = (ca.MX.sym(name, m) for name, m in (("x", of.x.numel()), ("places", 9), ("what", 4)))
    fixed = ca.MX.sym("sign"), ca.MX.sym("p", of.p.numel()), ca.MX.sym("scale", of.x.numel())
    found = [places, x, ca.MX.zeros(2)]
    for _ in range(PLACES_TOGETHER):
        found = looks(found[0][8] == 0, *found, x, what, *fixed)
    return ca.Function("to_a_zero", [x, places, what, *fixed], list(found))


def _jumps(feature: Feature | None, passed: list[ca.SX], p: ca.SX) -> ca.SX:
    """The largest jump of a feature from one state to the next, in units of what it may be."""
    if not isinstance(feature, Bound):
        return ca.SX(0)
    return ca.mmax(ca.fabs(ca.diff(ca.vertcat(*[feature(y, p) for y in passed])))) / LARGEST_JUMP


def _in_a_row(
    begins: ca.Function, leaves: ca.Function, step: ca.Function, same: ca.Function, sizes: tuple[int, int, int]
) -> ca.Function:
    """(x, (t, h, left, tol, whether a phase begins), sign, p, scale) -> table of the steps; where in its first one each
    event was seen first, and what it was at the start."""
    n, _, parameters = sizes
    x, given = ca.MX.sym("x", n), ca.MX.sym("given", 5)
    fixed = ca.MX.sym("sign"), ca.MX.sym("p", parameters), ca.MX.sym("scale", n)
    t, h, left, tol, first = ca.vertsplit(given)
    h, e, r, low, at_first, holds = ca.Function.if_else("start", leaves, begins)(first, x, t, h, left, tol, *fixed)
    goes_on = ca.Function.if_else("goes_on", step, same)
    known, table = [x, t, h, left, ca.MX(0), e, r], [ca.vertcat(x, t, h, 0, holds, e, r)]
    for _ in range(STEPS_TOGETHER):
        *known, taken, holds = goes_on(known[4] == 0, *known, tol, *fixed)
        table.append(ca.vertcat(*known[:3], taken, holds, *known[5:]))
    return ca.Function("steps", [x, given, *fixed], [ca.horzcat(*table), low, at_first])


class _Steps:
    """The steps of one mode."""

    def __init__(self, mode: VectorMode, exits: tuple[Exit, ...], p: Array, scale: Array, tol: float) -> None:
        self._exits, self._tol, self._fixed = exits, tol, (mode.sign, p, scale)
        self._own = [i for i, way_out in enumerate(exits) if not way_out.mark or way_out.reset is not None]
        self._compiled = lambda implicit: _compiled(mode, exits, scale.size, p.size, implicit)
        self._take(mode.stiff)

    def _take(self, implicit: bool) -> None:
        """Steps of one kind from now on."""
        self._implicit = implicit
        self._many, self._one, self._lands = (each.buffers for each in self._compiled(implicit))
        for buffers in (self._many, self._one, self._lands):
            for store, value in zip(buffers.inputs[-3:], self._fixed, strict=True):
                store[:] = value

    def run(self, x: Array, max_time: float) -> Followed:
        """From a scaled state (n,) to the first exit, or to the end of the time.  Raises Lost, effort.GivenUp."""
        n, E = x.size, len(self._exits)
        tables, t, h, many, clean = [np.array([[*x, 0.0]])], 0.0, 0.0, 0, True
        while many < MOST_STEPS:
            if many >= STEPS_OF_A_SLIP and not self._implicit:
                if not _rings(np.vstack(tables)[-STEPS_TOGETHER:, :n], self._tol / OF_THE_TOLERANCE):
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
            below, above = Place(lows[i], low[i], low[E + i]), Place(length, high[i], high[E + i])
            above = above if crossed else self._above(start, i, below, above)
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
        for _ in range(0, MOST_HALVINGS, PLACES_TOGETHER):
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
