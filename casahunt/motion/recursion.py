"""Taylor coefficients of the motion along a field, by a rule for each of its operations.

    x(t + tau s) = sum over k of c_k s^k,    c_0 = x,    c_(k + 1) = tau f_k / (k + 1)

f_k is the k-th coefficient of f(x(s)), which needs no more of x than c_0 .. c_k: the operations of the field's graph
are gone through once for every k, each adding one coefficient to its own series.  With u, v those of the operands:

    w = u v            w_k = sum_j u_j v_(k-j)                                j = 0..k
    w = u / v          w_k = (u_k - sum_j v_j w_(k-j)) / v_0                  j = 1..k
    w = sqrt u         w_k = (u_k - sum_j w_j w_(k-j)) / (2 w_0)              j = 1..k-1
    w = u^a            w_k = sum_j (a j - (k - j)) u_j w_(k-j) / (k u_0)      j = 1..k
    w' = q(w) u'       w_k = sum_j j u_j q_(k-j) / k                          j = 1..k
    w' = u' / q(u)     w_k = (u_k - sum_j j w_j q_(k-j) / k) / q_0            j = 1..k-1

the last two for exp (q = w), sin and cos (q each other), sinh and cosh, tan and tanh (q = 1 +- w^2); log (q = u), atan
and atanh (q = 1 +- u^2).  A power by a whole number is taken apart into products, which are right at u = 0 too.
What does not change with x, such as a combination of parameters, is one number, whatever operation it comes from.  A
changing operand of any other operation (|u|, a sign, a choice) has no series: there is none for that field then.

Source: Griewank and Walther, Evaluating Derivatives, section 13.2; Jorba and Zou, Experimental Mathematics 14 (2005).
Symbols: n states, P order, k, j numbers of coefficients.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import casadi as ca

from ..compiled import kept
from ..hybrid.system import Field

Series = list[Any]
"""Coefficients 0..k of one operation; what does not change has one."""
Next = Callable[[int], Any]
"""k -> coefficient k, where those before it and those of the operands are there."""

MOST_FACTORS = 16
"""Powers by whole numbers up to this one are taken apart."""


class _NoRule(Exception):
    """An operation of a changing operand that has no rule."""


def _sum(a: list[Any], b: list[Any]) -> Any:
    """sum_i a_i b_i; written at once, which costs a fifth of one by one."""
    if len(a) < 3:
        return sum((x * y for x, y in zip(a, b, strict=True)), ca.SX(0))
    return ca.dot(ca.vertcat(*a), ca.vertcat(*b))


def _product(u: Series, v: Series, k: int) -> Any:
    if len(u) == 1 < len(v):
        return u[0] * v[k]
    if len(v) == 1 < len(u):
        return v[0] * u[k]
    if u is not v:
        return _sum(u[: k + 1], v[k::-1])
    half = 2 * _sum(u[: (k + 1) // 2], u[k : k - (k + 1) // 2 : -1])  # a square is the same from both ends
    return half if k % 2 else half + u[k // 2] ** 2


def _weighted(u: Series, q: Series, k: int, last: int) -> Any:
    """sum_j j u_j q_(k-j) / k for j = 1..last."""
    return _sum([j / k * u[j] for j in range(1, last + 1)], [q[k - j] for j in range(1, last + 1)])


class _Graph:
    """The series of all operations: those that change hold a rule for their next coefficient."""

    def __init__(self) -> None:
        self.rules: list[tuple[Series, Next]] = []
        self.shared: dict[tuple[int, int], Series] = {}

    def changing(self, first: Any, following: Next) -> Series:
        """A series with a rule."""
        series = [first]
        self.rules.append((series, following))
        return series

    def further(self, k: int) -> None:
        """Coefficient k of every series, operands before those that need them."""
        for series, following in self.rules:
            series.append(following(k))

    def product(self, u: Series, v: Series) -> Series:
        """u v."""
        return self.changing(u[0] * v[0], partial(_product, u, v))

    def quotient(self, u: Series, v: Series, moves: Callable[[Series], bool]) -> Series:
        """u / v."""
        if not moves(v):
            return self.changing(u[0] / v[0], lambda k: u[k] / v[0])
        w: Series = []

        def following(k: int) -> Any:
            known = _sum(v[1 : k + 1], w[k - 1 :: -1] if k > 1 else w[:1])
            return ((u[k] if moves(u) else 0) - known) / v[0]

        w = self.changing(u[0] / v[0], following)
        return w

    def root(self, u: Series) -> Series:
        """The square root."""
        w: Series = []

        def following(k: int) -> Any:
            known = _sum(w[1:k], w[k - 1 : 0 : -1]) if k > 1 else 0
            return (u[k] - known) / (2 * w[0])

        w = self.changing(ca.sqrt(u[0]), following)
        return w

    def power(self, u: Series, a: Any) -> Series:
        """u^a for an exponent that does not change."""
        whole = int(a) if a.is_constant() and float(a) == int(float(a)) else 0
        if 0 < whole <= MOST_FACTORS:
            w = u
            for bit in bin(whole)[3:]:
                w = self.product(w, w)
                w = self.product(w, u) if bit == "1" else w
            return w
        out: Series = []

        def following(k: int) -> Any:
            factors = [(a * j - (k - j)) / k * u[j] for j in range(1, k + 1)]
            return _sum(factors, [out[k - j] for j in range(1, k + 1)]) / u[0]

        out = self.changing(u[0] ** a, following)
        return out

    def exponential(self, u: Series) -> Series:
        """exp u."""
        w: Series = []
        w = self.changing(ca.exp(u[0]), lambda k: _weighted(u, w, k, k))
        return w

    def pair(self, u: Series, first: int, second: int, turned: float) -> tuple[Series, Series]:
        """(sin, cos) or (sinh, cosh), the second with the derivative `turned` times the first."""
        a: Series = []
        b: Series = []
        a = self.changing(ca.SX.unary(first, u[0]), lambda k: _weighted(u, b, k, k))
        b = self.changing(ca.SX.unary(second, u[0]), lambda k: turned * _weighted(u, a, k, k))
        # The two need each other's coefficients below k only.
        return a, b

    def tangent(self, u: Series, operation: int, sign: float) -> Series:
        """Tan or tanh: w' = (1 +- w^2) u'."""
        w: Series = []
        q: Series = []
        w = self.changing(ca.SX.unary(operation, u[0]), lambda k: _weighted(u, q, k, k))
        q = self.changing(1 + sign * w[0] ** 2, lambda k: sign * _product(w, w, k))
        return w

    def inverse_of(self, u: Series, operation: int, q: Series) -> Series:
        """Log, atan, atanh: w' = u' / q(u)."""
        w: Series = []

        def following(k: int) -> Any:
            return (u[k] - (_weighted(w, q, k, k - 1) if k > 1 else 0)) / q[0]

        w = self.changing(ca.SX.unary(operation, u[0]), following)
        return w


_PAIRS = {ca.OP_SIN: (ca.OP_SIN, ca.OP_COS, -1.0, 0), ca.OP_COS: (ca.OP_SIN, ca.OP_COS, -1.0, 1),
          ca.OP_SINH: (ca.OP_SINH, ca.OP_COSH, 1.0, 0), ca.OP_COSH: (ca.OP_SINH, ca.OP_COSH, 1.0, 1)}  # fmt: skip
_LINEAR = {ca.OP_NEG: -1.0, ca.OP_TWICE: 2.0, ca.OP_ASSIGN: 1.0}
_OF_TWO = (ca.OP_ADD, ca.OP_SUB, ca.OP_MUL, ca.OP_DIV, ca.OP_IF_ELSE_ZERO, ca.OP_POW, ca.OP_CONSTPOW)


class _Operations:
    """The rules of a field's operations, over one graph; `moving` holds the identities of the series that change."""

    def __init__(self) -> None:
        self.graph = _Graph()
        self.moving: set[int] = set()

    def moves(self, series: Series) -> bool:
        """Whether it has more than one coefficient."""
        return id(series) in self.moving

    def marked(self, series: Series) -> Series:
        """One that does."""
        self.moving.add(id(series))
        return series

    def apply(self, operation: int, operands: list[Series]) -> Series:
        """The series of an operation.  Raises _NoRule."""
        if not any(self.moves(u) for u in operands):
            values = [u[0] for u in operands]
            return [(ca.SX.unary if len(values) == 1 else ca.SX.binary)(operation, *values)]
        found = self._of_two(operation, *operands) if operation in _OF_TWO else self._of_one(operation, operands)
        return self.marked(found)

    def _of_one(self, operation: int, operands: list[Series]) -> Series:
        u, graph = operands[0], self.graph
        if operation in _LINEAR:
            factor = _LINEAR[operation]
            return graph.changing(factor * u[0], lambda k: factor * u[k])
        if operation == ca.OP_SQ:
            return graph.product(u, u)
        if operation == ca.OP_INV:
            return graph.quotient([ca.SX(1)], u, self.moves)
        if operation == ca.OP_SQRT:
            return graph.root(u)
        if operation == ca.OP_EXP:
            return graph.exponential(u)
        if operation in _PAIRS:
            first, second, turned, which = _PAIRS[operation]
            key = (id(u), first)
            if key not in graph.shared:
                graph.shared[key], graph.shared[(id(u), second)] = graph.pair(u, first, second, turned)
            return graph.shared[(id(u), (first, second)[which])]
        if operation in (ca.OP_TAN, ca.OP_TANH):
            return graph.tangent(u, operation, 1.0 if operation == ca.OP_TAN else -1.0)
        if operation == ca.OP_LOG:
            return graph.inverse_of(u, operation, u)
        if operation in (ca.OP_ATAN, ca.OP_ATANH):
            sign = 1.0 if operation == ca.OP_ATAN else -1.0
            q = graph.changing(1 + sign * u[0] ** 2, lambda k: sign * _product(u, u, k))
            return graph.inverse_of(u, operation, q)
        raise _NoRule

    def _of_two(self, operation: int, u: Series, v: Series) -> Series:
        graph, moves = self.graph, self.moves
        if operation in (ca.OP_ADD, ca.OP_SUB):
            sign = 1.0 if operation == ca.OP_ADD else -1.0
            first = u[0] + v[0] if operation == ca.OP_ADD else u[0] - v[0]
            if not moves(v):
                return graph.changing(first, lambda k: u[k])
            if not moves(u):
                return graph.changing(first, lambda k: sign * v[k])
            return graph.changing(first, lambda k: u[k] + v[k] if sign > 0 else u[k] - v[k])
        if operation == ca.OP_MUL:
            return graph.product(u, v)
        if operation == ca.OP_DIV:
            return graph.quotient(u, v, moves)
        if operation == ca.OP_IF_ELSE_ZERO and not moves(u):
            return graph.changing(ca.if_else(u[0], v[0], 0), lambda k: ca.if_else(u[0], v[k], 0))
        if operation in (ca.OP_POW, ca.OP_CONSTPOW) and not moves(v):
            return graph.power(u, v[0])
        if operation == ca.OP_POW:
            logarithm = self.marked(graph.inverse_of(u, ca.OP_LOG, u)) if moves(u) else [ca.log(u[0])]
            return graph.exponential(self.marked(graph.product(v, logarithm)))
        raise _NoRule


def _series_of(f: ca.Function, x: ca.SX, others: list[ca.SX], order: int, unit: ca.SX) -> ca.SX:
    """(n, order + 1) the coefficients along f(x, others).  Raises _NoRule."""
    operations = _Operations()
    states: list[Series] = [operations.marked([x[i]]) for i in range(x.numel())]
    store: list[Any] = [None] * f.sz_w()
    slopes: dict[int, Series] = {}
    for k in range(f.n_instructions()):
        operation, places, into = f.instruction_id(k), f.instruction_input(k), f.instruction_output(k)
        if operation == ca.OP_INPUT:
            which, entry = places
            store[into[0]] = states[entry] if which == 0 else [others[which - 1].nz[entry]]
        elif operation == ca.OP_OUTPUT:
            slopes[into[1]] = store[places[0]]
        elif operation == ca.OP_CONST:
            store[into[0]] = [ca.SX(f.instruction_constant(k))]
        else:
            store[into[0]] = operations.apply(operation, [store[place] for place in places])
    for k in range(order):
        for i, c in enumerate(states):
            f_i = slopes[i]
            c.append(unit / (k + 1) * f_i[k] if k == 0 or operations.moves(f_i) else ca.SX(0))
        if k + 1 < order:
            operations.graph.further(k + 1)
    return ca.vertcat(*[ca.horzcat(*c) for c in states])


@kept(maxsize=64)
def taylor_coefficients(field: Field, n: int, parameters: int, order: int) -> ca.Function | None:
    """The series of the motion along a field.

    Parameters
    ----------
    field
        f(x, p, sign) of the mode.
    n, parameters, order
        numbers of states and parameters; P.

    Returns
    -------
    Function (x, sign, p, scale D, unit tau) of a scaled state to the coefficients (n, P + 1) of the scaled motion; None
    where an operation of a changing operand has no rule.

    Examples
    --------
    >>> from casahunt.motion import taylor_coefficients
    >>> falls = taylor_coefficients(lambda x, p, sign: -x, 1, 0, 3)  # exp(-t)
    >>> [round(c, 4) for c in falls([1.0], 0.0, [], [1.0], 1.0).full()[0].tolist()]
    [1.0, -1.0, 0.5, -0.1667]
    """
    x, sign = ca.SX.sym("x", n), ca.SX.sym("sign")
    p, scale, unit = ca.SX.sym("p", parameters), ca.SX.sym("scale", n), ca.SX.sym("unit")
    slope = ca.cse(ca.densify(ca.SX(field(scale * x, p, sign)) / scale))  # what stands twice has one series
    f = ca.Function("slope", [x, sign, p, scale], [slope])
    try:
        series = _series_of(f, x, [sign, p, scale], order, unit)
    except _NoRule:
        return None
    return ca.Function("series", [x, sign, p, scale, unit], [ca.densify(series)])
