"""Extrapolated midpoint steps, compiled: many in a call, or those that lead to the zero of an event.

    m substeps      y_0 = x,  y_1 = x + d f(x),  y_(i+1) = y_(i-1) + 2 d f(y_i),  d = h/m,    m_j = 2, 4, .., 2 K
    implicit ones   y_1 = x + D_0,  D_0 = W d f(x),  D_i = D_(i-1) + 2 W (d f(y_i) - D_(i-1)),  y_(i+1) = y_i + D_i,
                    the last one y_m + W (d f(y_m) - D_(m-1)),  W = (1 - d f'(x))^-1,    m_j = 2, 6, 10, 14, 22
    extrapolation   T_(j,1) = y_m,  T_(j,k) = T_(j,k-1) + (T_(j,k-1) - T_(j-1,k-1)) / ((m_j/m_(j-k))^2 - 1), order 2 K
    error           |T_(K,K) - T_(K,K-1)| <= tol;  the next step is 0.7 (tol/error)^(1/(2 K - 1)) times as long

The implicit ones are for stiff fields, at three times the price of a step; both are of order 10.  Along an affine field
a step that would be implicit is exact, by its matrix exponential: what rings beside a stuck motor is not kept alive at
the size of its error, which no length of the next steps would get rid of.

Source: Hairer, Norsett and Wanner, Solving Ordinary Differential Equations I, section II.9; II, section IV.9 (Bader and
Deuflhard, Numer. Math. 41 (1983) 373-398).
Symbols: n states, E exits, M steps of a call.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..collocation.admissibility import LARGEST_JUMP, PASSED
from ..compiled import Caller, caller, kept
from ..hybrid.system import Exit, VectorMode
from ..hybrid.vector_form import Bound, Scalar
from .march_exits import EVENT_TOLERANCE
from .march_watch import ON_EVENT

EXTRAPOLATIONS = 5
"""K: steps of order 10."""
EXPLICIT, IMPLICIT = (2, 4, 6, 8, 10), (2, 6, 10, 14, 22)
"""m_j of explicit substeps, and of implicit ones."""
STEPS_OF_A_CALL, PLACES_OF_A_CALL = 32, 8
"""Steps of a call, at most, and places of an event."""
PART_OF_A_STEP, LEAST_GROWTH, MOST_GROWTH = 0.7, 0.1, 3.0
"""The next step, in units of the one that would have the tolerance; and in units of this one, at least and at most."""
FIRST_MOVES = 1e-3
"""No state moves by a larger part of its size in the first step of a phase."""
SEEN_BEHIND = 1e-3
"""Part of the first step after which it is seen to which side an event is left."""
STEP_DOUBLINGS, STEP_TERMS = 40, 4
"""S and terms of the series, of an exact step: of modes of 1e3 1/s it may be 1e8 s long."""
WITHIN_A_STEP = 100.0
"""By which a cubic may miss its middle, in units of the error of other steps: its end is exact, and what events do in
between is seen as well as inside an interval."""
ROUNDING_OF_ONE = float(np.finfo(float).eps)
IDLE_PLACES = 3
"""Places in a row at which an event that is zero but for rounding becomes no smaller: it is that of its terms."""


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


def _exact(x: ca.SX, rate: ca.SX, h: ca.SX, A: ca.SX) -> tuple[ca.SX, ca.SX, list[ca.SX]]:
    """The end of a step along an affine field, and by how much the cubic through both ends misses its middle.

    z = A h/2^S:  E = exp(z) - 1, v = h/2^S (exp(z) - 1)/z rate; of twice the length they are E + E + E^2 and
    v + v + E v, which loses no digits as the squares of exp(z) would.  x, rate, A: state, field and its Jacobian there;
    h: length.
    """
    part = h / 2**STEP_DOUBLINGS
    z = A * part
    E, v, power, factorial = ca.SX.zeros(A.shape), ca.SX.zeros(x.shape), ca.SX.eye(x.numel()), 1.0
    for k in range(1, STEP_TERMS + 1):
        factorial *= k
        v += ca.mtimes(power, rate) * part / factorial
        power = ca.mtimes(power, z)
        E += power / factorial
    for _ in range(STEP_DOUBLINGS):
        half, v = v, 2 * v + ca.mtimes(E, v)
        E = 2 * E + ca.mtimes(E, E)
    missed = half - v / 2 + h / 8 * ca.mtimes(A, v)
    return x + v, missed, [x, x + v]


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


class _Law(NamedTuple):
    """What is compiled of a mode: its field, condition and feature, and the events of its exits; without its sign, and
    the directions of these, which are numbers: modes that differ in them alone share what is compiled."""

    field: Any
    admissible: Any
    slack: float
    feature: Any
    events: tuple[Any, ...]

    @classmethod
    def of(cls, mode: VectorMode, exits: tuple[Exit, ...]) -> _Law:
        """That of a mode."""
        feature, *events = (
            each.scalar if isinstance(each, Bound) else each
            for each in (mode.feature, *(way_out.event.function for way_out in exits))
        )
        return cls(mode.field, mode.admissible, mode.slack, feature, tuple(events))


class _Formulas:
    """A mode's field and events at scaled states, in symbols."""

    def __init__(self, mode: _Law, n: int, parameters: int, implicit: bool) -> None:
        self.x, self.sign, self.p = ca.SX.sym("x", n), ca.SX.sym("sign"), ca.SX.sym("p", parameters)
        self.scale, self.t, self.h, self.tol = ca.SX.sym("scale", n), *(ca.SX.sym(name) for name in ("t", "h", "tol"))
        self.fixed = self.sign, self.p, self.scale, ca.SX.sym("ways", len(mode.events))
        rate = ca.densify(ca.SX(mode.field(self.scale * self.x, self.p, self.sign)) / self.scale)
        self.f = ca.Function("f", [self.x, *self.fixed], [rate])
        self.rate = rate
        f, A = (lambda y: self.f(y, *self.fixed)), ca.jacobian(rate, self.x) if implicit else None
        self.exact = A is not None and not any(ca.which_depends(rate, self.x, 2, False))
        end, off, passed = _exact(self.x, rate, self.h, A) if self.exact else _midpoint(f, self.x, rate, self.h, A)
        error = ca.mmax(ca.fabs(off) / ca.fmax(1, ca.fabs(self.x)))
        jumps = _jumps(mode.feature, [self.scale * y for y in passed], self.p, self.sign)
        self.stepped = ca.Function("stepped", [self.x, self.h, *self.fixed], [end, error, jumps])
        values = [
            event(self.scale * self.x, self.p, self.sign) if isinstance(event, Scalar)
            else event(self.scale * self.x, self.t, self.p) for event in mode.events
        ]  # fmt: skip
        e = ca.densify(self.fixed[-1] * ca.vertcat(*values, ca.SX(0, 1)))
        r = ca.densify(ca.jtimes(e, self.x, rate) + ca.jacobian(e, self.t))
        self.events = ca.Function("events", [self.x, self.t, *self.fixed], [e, r])
        holds = ca.SX(0) if mode.admissible is None else mode.admissible(self.scale * self.x, self.p, self.sign)
        self.holds = ca.Function("holds", [self.x, *self.fixed], [ca.densify(ca.SX(holds)) + mode.slack + PASSED])

    def step(self, h: ca.SX) -> tuple[ca.SX, ca.SX, ca.SX]:
        """Its end, error and largest jump of the feature, both in units of what they may be."""
        end, error, jumps = self.stepped(self.x, h, *self.fixed)
        return end, error / (self.tol * (WITHIN_A_STEP if self.exact else 1)), jumps

    def watched(self, y: ca.SX, time: ca.SX) -> tuple[ca.SX, ca.SX]:
        """Events, in the direction of their exits, and the rates at which they rise."""
        e, r = self.events(y, time, *self.fixed)
        return e, r


def steps_of(
    mode: VectorMode, exits: tuple[Exit, ...], n: int, parameters: int, implicit: bool
) -> tuple[Caller, Caller, Caller]:
    """`STEPS_OF_A_CALL` steps in a row, but none behind one in which an event may be met; one of a given length; and
    those that lead to the zero of an event.

    Rows of the first one's table: state, time, length of the next step and of this one, whether the mode holds (>= 0),
    events, rates.
    """
    return _compiled(_Law.of(mode, exits), n, parameters, implicit)


@kept(maxsize=64)
def _compiled(mode: _Law, n: int, parameters: int, implicit: bool) -> tuple[Caller, Caller, Caller]:
    """See `steps_of`."""
    E, of = len(mode.events), _Formulas(mode, n, parameters, implicit)
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
    finite = ca.sum1(ca.fabs(end)) < np.inf  # the largest error takes no notice of what is no number
    good = ca.logic_and(error <= 1, finite)
    factor = PART_OF_A_STEP * ca.fmax(error, 1e-30) ** (-1 / (2 * EXTRAPOLATIONS - 1))
    factor = ca.fmin(ca.fmax(factor, LEAST_GROWTH), MOST_GROWTH)
    factor = ca.if_else(ca.logic_and(finite, error >= 0), factor, LEAST_GROWTH)
    taken, end = ca.if_else(good, tried, 0), ca.if_else(good, end, x)
    e_end, r_end = (ca.if_else(good, a, b) for a, b in zip(of.watched(end, t + taken), (e, r), strict=True))
    top = ca.fmin(e + 2 * r * taken, e_end - 2 * r_end * taken)  # no event rings above it (_Steps._above)
    rises = ca.logic_and(ca.logic_and(r > 0, r_end < 0), top >= 0)
    met = ca.logic_and(e < 0, ca.logic_or(e_end >= 0, rises))  # what was not taken meets nothing
    ends = [end, t + taken, tried * factor, left - taken, ca.logic_or(ca.sum1(met) > 0, left <= taken), e_end, r_end]
    known = [x, t, h, left, over, e, r]
    step = ca.Function("step", [*known, tol, *of.fixed], [*ends, taken, of.holds(end, *of.fixed)])
    same = ca.Function("same", [*known, tol, *of.fixed], [*known, ca.SX(0), ca.SX(0)])
    end, error, jumps = of.step(h)
    outputs = [end, *of.watched(end, t + h), ca.fmax(error, jumps)]
    one = ca.Function("one", [x, ca.vertcat(t, h, tol), *of.fixed], outputs)
    many = _in_a_row(begins, leaves, step, same, (n, E, parameters))
    M = STEPS_OF_A_CALL + 1
    fixed = [1, parameters, n, E]
    return (caller(many, [n, 5, *fixed], [(M, n + 4 + 2 * E), E, E]), caller(one, [n, 3, *fixed], [n, E, E, 1]),
            caller(_to_a_zero(of, one, E), [n, 9, 4, *fixed], [9, n, 2]))  # fmt: skip


def _to_a_zero(of: _Formulas, one: ca.Function, exits: int) -> ca.Function:
    """(x, places, (t, tol, what is zero, number of the event), sign, p, scale, directions) -> places, state, told.

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
    is_noise = ca.logic_and(idle >= IDLE_PLACES, least <= EVENT_TOLERANCE)
    narrow = ca.fmin(ca.fabs(s - before), ca.fabs(b - a)) <= 4 * ROUNDING_OF_ONE * s
    over = ca.logic_or(ca.logic_or(is_noise, narrow), ca.fabs(e) <= small)
    moves_b = (e > 0) == (f_b > 0)
    a, f_a = ca.if_else(moves_b, a, s), ca.if_else(moves_b, f_a, e)
    b, f_b = ca.if_else(moves_b, s, b), ca.if_else(moves_b, e, f_b)
    newton = s - e / r
    inside = ca.logic_and(newton > ca.fmin(a, b), newton < ca.fmax(a, b))
    following = ca.if_else(over, s, ca.if_else(inside, newton, (a + b) / 2))
    after = ca.vertcat(following, s, a, f_a, b, f_b, least, idle, over)
    known = [c, end, told]
    look = ca.Function("look", [*known, of.x, given, *of.fixed], [after, state, ca.vertcat(e, error)])
    same = ca.Function("same", [*known, of.x, given, *of.fixed], known)
    looks = ca.Function.if_else("looks", look, same)
    x, places, what = (ca.MX.sym(name, m) for name, m in (("x", of.x.numel()), ("places", 9), ("what", 4)))
    fixed = [ca.MX.sym("fixed", each.numel()) for each in of.fixed]
    found = [places, x, ca.MX.zeros(2)]
    for _ in range(PLACES_OF_A_CALL):
        found = looks(found[0][8] == 0, *found, x, what, *fixed)
    return ca.Function("to_a_zero", [x, places, what, *fixed], list(found))


def _jumps(feature: Any, passed: list[ca.SX], p: ca.SX, sign: ca.SX) -> ca.SX:
    """The largest jump of a feature from one state to the next, in units of what it may be."""
    if not isinstance(feature, Scalar):
        return ca.SX(0)
    return ca.mmax(ca.fabs(ca.diff(ca.vertcat(*[feature(y, p, sign) for y in passed])))) / LARGEST_JUMP


def _in_a_row(
    begins: ca.Function, leaves: ca.Function, step: ca.Function, same: ca.Function, sizes: tuple[int, int, int]
) -> ca.Function:
    """(x, (t, h, left, tol, whether a phase begins), sign, p, scale, directions) -> table of the steps; where in its
    first one each event was seen first, and what it was at the start."""
    n, E, parameters = sizes
    x, given = ca.MX.sym("x", n), ca.MX.sym("given", 5)
    fixed = ca.MX.sym("sign"), ca.MX.sym("p", parameters), ca.MX.sym("scale", n), ca.MX.sym("ways", E)
    t, h, left, tol, first = ca.vertsplit(given)
    h, e, r, low, at_first, holds = ca.Function.if_else("start", leaves, begins)(first, x, t, h, left, tol, *fixed)
    goes_on = ca.Function.if_else("goes_on", step, same)
    known, table = [x, t, h, left, ca.MX(0), e, r], [ca.vertcat(x, t, h, 0, holds, e, r)]
    for _ in range(STEPS_OF_A_CALL):
        *known, taken, holds = goes_on(known[4] == 0, *known, tol, *fixed)
        table.append(ca.vertcat(*known[:3], taken, holds, *known[5:]))
    return ca.Function("steps", [x, given, *fixed], [ca.horzcat(*table), low, at_first])
