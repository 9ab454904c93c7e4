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
NOISE = 3
"""Places in a row at which an event that is zero but for rounding becomes no smaller: it is that of its terms."""
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
) -> tuple[Segment, str] | None:
    """(segment, next mode) of a phase without a mesh: its `w` are the states at which steps begin.

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
    return Segment(name, event, duration, found.times / duration, states[:-1], states[-1], jumped), successor


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

    def __init__(self, field: Field, exits: tuple[Exit, ...], n: int, parameters: int, implicit: bool) -> None:
        self.x, self.sign, self.p = ca.SX.sym("x", n), ca.SX.sym("sign"), ca.SX.sym("p", parameters)
        self.scale, self.t, self.h, self.tol = ca.SX.sym("scale", n), *(ca.SX.sym(name) for name in ("t", "h", "tol"))
        self.fixed = self.sign, self.p, self.scale
        rate = ca.densify(ca.SX(field(self.scale * self.x, self.p, self.sign)) / self.scale)
        self.f = ca.Function("f", [self.x, *self.fixed], [rate])
        self.rate, self.A = rate, ca.jacobian(rate, self.x) if implicit else None
        events = [e.direction * e.event.function(self.scale * self.x, self.t, self.p) for e in exits]
        e = ca.densify(ca.vertcat(*events, ca.SX(0, 1)))
        r = ca.densify(ca.jtimes(e, self.x, rate) + ca.jacobian(e, self.t))
        self.events = ca.Function("events", [self.x, self.t, *self.fixed], [e, r])

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
    field: Field, feature: Feature | None, exits: tuple[Exit, ...], n: int, parameters: int, implicit: bool
) -> tuple[Caller, Caller]:
    """`STEPS_TOGETHER` steps in a row, but none behind one in which an event may be met; and one of a given length.

    Rows of the first one's table: state, time, length of the next step and of this one, events, rates.
    """
    E, of = len(exits), _Formulas(field, exits, n, parameters, implicit)
    x, t, h, tol, left, over = of.x, of.t, of.h, of.tol, ca.SX.sym("left"), ca.SX.sym("over")
    e, r = ca.SX.sym("e", E), ca.SX.sym("r", E)
    first = FIRST_MOVES / ca.fmax(ca.mmax(ca.fabs(of.rate)), 1e-300)
    tried = ca.fmin(ca.if_else(h > 0, h, first), left)
    begins = ca.Function("begins", [x, t, h, left, tol, *of.fixed], [tried, *of.watched(x, t), ca.SX(E, 1)])
    just = SEEN_BEHIND * tried
    on = ca.fabs(of.watched(x, t)[0]) <= ON_EVENT
    behind_it = zip(of.watched(of.step(just)[0], t + just), of.watched(x, t), strict=True)
    leaves = ca.Function("leaves", [x, t, h, left, tol, *of.fixed],
                         [tried, *(ca.if_else(on, a, b) for a, b in behind_it), ca.if_else(on, just, 0)])  # fmt: skip
    tried = ca.fmin(h, left)
    end, error, passed = of.step(tried)
    good = ca.logic_and(error <= 1, ca.sum1(end * 0) == 0)
    factor = PART_OF_A_STEP * ca.fmax(error, 1e-30) ** (-1 / (2 * EXTRAPOLATIONS - 1))
    factor = ca.if_else(error >= 0, ca.fmin(ca.fmax(factor, LEAST_GROWTH), MOST_GROWTH), LEAST_GROWTH)
    taken, end = ca.if_else(good, tried, 0), ca.if_else(good, end, x)
    e_end, r_end = (ca.if_else(good, a, b) for a, b in zip(of.watched(end, t + taken), (e, r), strict=True))
    rises = ca.logic_and(r > 0, r_end < 0)
    met = ca.logic_and(e < 0, ca.logic_or(e_end >= 0, rises))  # what was not taken meets nothing
    ends = [end, t + taken, tried * factor, left - taken, ca.logic_or(ca.sum1(met) > 0, left <= taken), e_end, r_end]
    known = [x, t, h, left, over, e, r]
    step = ca.Function("step", [*known, tol, *of.fixed], [*ends, taken])
    same = ca.Function("same", [*known, tol, *of.fixed], [*known, ca.SX(0)])
    one = ca.Function("one", [x, ca.vertcat(t, h, tol), *of.fixed], [of.step(h)[0], *of.watched(of.step(h)[0], t + h),
                      ca.fmax(of.step(h)[1], _jumps(feature, [of.scale * y for y in of.step(h)[2]], of.p))])  # fmt: skip
    many = _in_a_row(begins, leaves, step, same, (n, E, parameters))
    M = STEPS_TOGETHER + 1
    return (caller(many, [n, 5, 1, parameters, n], [(M, n + 3 + 2 * E), E]),
            caller(one, [n, 3, 1, parameters, n], [n, E, E, 1]))  # fmt: skip


def _jumps(feature: Feature | None, passed: list[ca.SX], p: ca.SX) -> ca.SX:
    """The largest jump of a feature from one state to the next, in units of what it may be."""
    if not isinstance(feature, Bound):
        return ca.SX(0)
    return ca.mmax(ca.fabs(ca.diff(ca.vertcat(*[feature(y, p) for y in passed])))) / LARGEST_JUMP


def _in_a_row(
    begins: ca.Function, leaves: ca.Function, step: ca.Function, same: ca.Function, sizes: tuple[int, int, int]
) -> ca.Function:
    """(x, (t, h, left, tol, whether a phase begins), sign, p, scale) -> table of the steps, and where in its first one
    each event was seen first."""
    n, _, parameters = sizes
    x, given = ca.MX.sym("x", n), ca.MX.sym("given", 5)
    fixed = ca.MX.sym("sign"), ca.MX.sym("p", parameters), ca.MX.sym("scale", n)
    t, h, left, tol, first = ca.vertsplit(given)
    h, e, r, low = ca.Function.if_else("start", leaves, begins)(first, x, t, h, left, tol, *fixed)
    goes_on = ca.Function.if_else("goes_on", step, same)
    known, table = [x, t, h, left, ca.MX(0), e, r], [ca.vertcat(x, t, h, 0, e, r)]
    for _ in range(STEPS_TOGETHER):
        *known, taken = goes_on(known[4] == 0, *known, tol, *fixed)
        table.append(ca.vertcat(*known[:3], taken, *known[5:]))
    return ca.Function("steps", [x, given, *fixed], [ca.horzcat(*table), low])


class _Steps:
    """The steps of one mode."""

    def __init__(self, mode: VectorMode, exits: tuple[Exit, ...], p: Array, scale: Array, tol: float) -> None:
        self._exits, self._tol, self._fixed = exits, tol, (mode.sign, p, scale)
        self._compiled = lambda implicit: _compiled(mode.field, mode.feature, exits, scale.size, p.size, implicit)
        self._take(mode.stiff)

    def _take(self, implicit: bool) -> None:
        """Steps of one kind from now on."""
        self._implicit = implicit
        self._many, self._one = (each.buffers for each in self._compiled(implicit))

    def run(self, x: Array, max_time: float) -> Followed:
        """From a scaled state (n,) to the first exit, or to the end of the time.  Raises Lost, effort.GivenUp."""
        n, E = x.size, len(self._exits)
        tables, t, h, many = [np.array([[*x, 0.0]])], 0.0, 0.0, 0
        while many < MOST_STEPS:
            if many >= STEPS_OF_A_SLIP and not self._implicit:
                if not _rings(np.vstack(tables)[-STEPS_TOGETHER:, :n], self._tol / OF_THE_TOLERANCE):
                    self._take(implicit=True)
            effort.interval()
            table, lows = self._steps(x, (t, h, max_time - t, self._tol, t == 0))
            rows = table[1:][table[1:, n + 2] > 0]
            if not len(rows):
                raise Lost
            if rows[0, n + 2] <= lows.max(initial=0.0):  # it is not seen yet to which side an event is left
                h = float(rows[0, n + 2])
                continue
            before, last = (rows[-2] if len(rows) > 1 else table[0]), rows[-1]
            start, h_last = (before[:n], float(before[n])), float(last[n + 2])
            lows = lows if len(rows) == 1 else np.zeros(E)
            met = self._first(start, [Place(*of) for of in zip(lows.tolist(), *_events_of(before, n, E), strict=True)],
                              [Place(h_last, *of) for of in zip(*_events_of(last, n, E), strict=True)])  # fmt: skip
            many += len(rows)
            if met is not None:
                tables.append(rows[:-1, : n + 1])
                if met.way_out is not None:
                    states = np.vstack([*tables, [[*met.state, met.time]]])
                    return Followed(states[:, n], states[:, :n], met.way_out)
                (x, t), h = start, met.time - start[1]
                continue
            tables.append(rows[:, : n + 1])
            x, t, h = last[:n], float(last[n]), float(last[n + 1])
            if not np.isfinite(x).all():
                raise Lost
            if t >= max_time * (1 - 4 * ROUNDING_OF_ONE):
                states = np.vstack(tables)
                return Followed(states[:, n], states[:, :n], None)
        raise Lost

    def _steps(self, x: Array, given: tuple[float, ...]) -> list[Array]:
        """The next steps."""
        for store, value in zip(self._many.inputs, (x, given, *self._fixed), strict=True):
            store[:] = value
        self._many.trigger()
        return [out.copy() for out in self._many.outputs]

    def _at(self, x: Array, t: float, h: float) -> list[Array]:
        """State, events and their rates after one step, and its error in units of what it may be."""
        for store, value in zip(self._one.inputs, (x, (t, h, self._tol), *self._fixed), strict=True):
            store[:] = value
        self._one.trigger()
        return [out.copy() for out in self._one.outputs]

    def _first(self, start: tuple[Array, float], lows: list[Place], highs: list[Place]) -> Landing | None:
        """The first exit within a step, from scaled state and time; None where there is none.  Raises Lost.

        lows, highs: of each event, at the start and at the end.  One that rises towards zero at the start and falls at
        the end has its top in between.
        """
        best: Landing | None = None
        for i, (low, high) in enumerate(zip(lows, highs, strict=True)):
            crossed = low.event < 0 <= high.event
            if not (crossed or low.event < 0 and high.event < 0 and low.rate > 0 and high.rate < 0):
                continue
            above = high if crossed else self._above(start, i, low, high)
            if above is None:
                continue
            s, end, good = self._zero(start, i, low, above)
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
        bracket, small = Bracket(low.s, low.event, high.s, high.event), EVENT_TOLERANCE * max(-low.event, high.event)
        s, before, least, idle = _cubic_zero(low, high), high.s, np.inf, 0
        for _ in range(MOST_HALVINGS):
            at, end = self._seen(start, i, s)
            least, idle = (abs(at.event), 0) if abs(at.event) <= least / 2 else (least, idle + 1)
            is_noise = idle >= NOISE and least <= EVENT_TOLERANCE
            if is_noise or abs(at.event) <= small or min(abs(s - before), bracket.width) <= 4 * ROUNDING_OF_ONE * s:
                return s, end, at.error <= 1
            bracket, before = bracket.told(s, at.event), s
            s = bracket.newton(s, at.event, at.rate)
        return s, end, False


def _events_of(row: Array, n: int, exits: int) -> tuple[list[float], list[float]]:
    """Events and rates in a row of the table."""
    return row[n + 3 : n + 3 + exits].tolist(), row[n + 3 + exits :].tolist()


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
