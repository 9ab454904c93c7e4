"""The stages of an interval eliminated, the states that are integrals of others first.

With the notation of interval.py, minus what the stages change by is Y: where the residual is taken away (first column),
and with x, T and lambda.  Of every state a it has d rows, and

    Y_a - h T A sum_c diag(J_ac) Y_c = K_a,   K = [residual | d/dx | d/dT | d/dlambda],  J_ac = df_a/dx_c at the stages.

The rate of a position does not contain itself.  Such states E, as many as leave no loop among themselves, are put in
terms of the others F by substitution, each after those that its rate contains,

    Y_e = R_e + sum_f M_ef Y_f,       M_ef = h T A (diag(J_ef) + sum_c diag(J_ec) M_cf),       c in E before e,

and what is left to be solved is S Y_F = rhs of |F| d rows in place of n d; det S is that of the whole.  Where J_ac is
the same at all stages, products of h T A J are powers of A, which are numbers.

Symbols: n states, d stages, R = n (d + 1), N intervals, c = n + 3 columns.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import combinations

import casadi as ca
import numpy as np

from ..compiled import caller_by_rows, kept
from ..hybrid.system import Field
from .interval import sizes_of_parts
from .scheme import Kind, scheme

Array = np.ndarray

MOST_SUBSETS = 12
"""States up to which all choices of F are looked through; of more, all stay."""


@dataclass(frozen=True, eq=False)
class Eliminated:
    """The intervals of a mesh, stages eliminated.

    Attributes
    ----------
    residual : (N, R), stages and node, state by state.
    stages : (N, d n, c) the Y of the module docstring: minus the stage update belonging to 1, dx, dT, dlambda.
    maps : (N, n, c) of [r | A | B | C], see transcription.py.
    """

    residual: Array
    stages: Array
    maps: Array


def kept_states(rates: Array) -> tuple[tuple[int, ...], tuple[int, ...]]:
    """Which states stay, and in which order the others are put in terms of them.

    Parameters
    ----------
    rates
        (n, n) bool: the rate of state a contains state c.

    Returns
    -------
    (F, E): as few F as leave no loop among E; every e depends on F and on those before it in E alone.
    """
    n = len(rates)
    for size in range(1, n) if n <= MOST_SUBSETS else ():
        for chosen in combinations(range(n), size):
            order: list[int] = []
            rest = [a for a in range(n) if a not in chosen]
            while free := [a for a in rest if not any(rates[a, c] for c in rest)]:
                order += free
                rest = [a for a in rest if a not in free]
            if not rest:
                return chosen, tuple(order)
    return tuple(range(n)), ()


class _Polynomial:
    """sum_k coefficients[k] A^k + rest: a (d, d) matrix of which the powers of A are numbers."""

    def __init__(self, A: Array, coefficients: dict[int, ca.SX], rest: ca.SX | None = None) -> None:
        self.A, self.coefficients, self.rest = A, coefficients, rest

    def times(self, right: Array) -> ca.SX:
        """Its product with numbers (d, m)."""
        out = ca.SX.zeros(*right.shape) if self.rest is None else ca.mtimes(self.rest, ca.DM(right))
        for k, value in self.coefficients.items():
            out = out + value * ca.DM(np.linalg.matrix_power(self.A, k) @ right)
        return out

    def full(self) -> ca.SX:
        """The matrix."""
        return self.times(np.eye(len(self.A)))

    def after(self, weights: list[ca.SX], step: ca.SX) -> _Polynomial:
        """step A diag(weights) times it; `weights` has one entry where they are the same."""
        A = ca.DM(self.A)
        if len(weights) > 1:
            if set(self.coefficients) == {0} and self.rest is None:
                row = (step * self.coefficients[0]) * ca.vertcat(*weights).T
                return _Polynomial(self.A, {}, A * ca.repmat(row, len(self.A), 1))
            return _Polynomial(self.A, {}, step * ca.mtimes(A, _weighted(weights, self.full())))
        factor = step * weights[0]
        rest = None if self.rest is None else factor * ca.mtimes(A, self.rest)
        return _Polynomial(self.A, {k + 1: factor * value for k, value in self.coefficients.items()}, rest)

    def minus(self) -> _Polynomial:
        """Its negative."""
        coefficients = {k: -value for k, value in self.coefficients.items()}
        return _Polynomial(self.A, coefficients, None if self.rest is None else -self.rest)

    def __add__(self, other: _Polynomial) -> _Polynomial:
        both = dict(self.coefficients)
        for k, value in other.coefficients.items():
            both[k] = both[k] + value if k in both else value
        rests = [rest for rest in (self.rest, other.rest) if rest is not None]
        return _Polynomial(self.A, both, rests[0] + rests[1] if len(rests) == 2 else next(iter(rests), None))


def _weighted(weights: list[ca.SX], stages: ca.SX) -> ca.SX:
    """diag(weights) times (d, m) columns; `weights` has one entry where they are the same."""
    return (weights[0] if len(weights) == 1 else ca.repmat(ca.vertcat(*weights), 1, stages.size2())) * stages


class Substitution:
    """Y_a = sum_f M_af Y_f - sum_c M_a(n+c) 1 [column of x_c] + R_a [the three other columns], state by state.

    `rates` (n, n) has the J_ac as lists of one entry or of d, empty where there is none.
    """

    def __init__(self, A: Array, step: ca.SX, rates: list[list[list[ca.SX]]], known: list[ca.SX]) -> None:
        present = np.array([[bool(weights) for weights in row] for row in rates])
        self.F, self.E = kept_states(present)
        self.A, self.step, self.rates, self.known, self.n = A, step, rates, known, len(rates)
        self.identity = _Polynomial(A, {0: ca.SX(1.0)})
        self.M = {f: {f: self.identity} for f in self.F}
        self.R: dict[int, ca.SX] = {}
        for e in self.E:
            factors, rest = self._integrals(e, step)
            self.M[e] = {**factors, self.n + e: self.identity}  # n + e is new: no loop leads back to e
            self.R[e] = known[e] + rest

    def _integrals(self, a: int, step: ca.SX) -> tuple[dict[int, _Polynomial], ca.SX]:
        """step A sum_c diag(J_ac) Y_c as (factors, rest)."""
        factors: dict[int, _Polynomial] = {}
        rest = ca.SX.zeros(len(self.A), 3)
        for c, terms in self.M.items():
            if weights := self.rates[a][c]:
                for g, factor in terms.items():
                    term = factor.after(weights, step)
                    factors[g] = factors[g] + term if g in factors else term
                rest += _weighted(weights, self.R[c]) if c in self.R else 0.0
        return factors, step * ca.mtimes(ca.DM(self.A), rest)

    def _columns(self, factors: dict[int, _Polynomial], rest: ca.SX) -> ca.SX:
        """(d, n + 3): what belongs to the columns of K."""
        d = len(self.A)
        of_x = [-factors[self.n + c].times(np.ones((d, 1))) if self.n + c in factors else ca.SX.zeros(d, 1)
                for c in range(self.n)]  # fmt: skip
        return ca.horzcat(rest[:, 0], *of_x, rest[:, 1:])

    def left(self) -> tuple[ca.SX, ca.SX]:
        """S and rhs."""
        d, rows, rhs = len(self.A), [], []
        for f in self.F:
            factors, rest = self._integrals(f, -self.step)
            blocks = [factors[g].full() if g in factors else ca.SX.zeros(d, d) for g in self.F]
            blocks[self.F.index(f)] += np.eye(d)
            rows.append(ca.horzcat(*blocks))
            of_x = {key: factor.minus() for key, factor in factors.items() if key >= self.n}
            rhs.append(self._columns({**of_x, self.n + f: self.identity}, self.known[f] - rest))
        return ca.vertcat(*rows), ca.vertcat(*rhs)

    def of_others(self) -> tuple[ca.SX, ca.SX]:
        """Of the states E: R and M, as (|E| d, .)."""
        d, n = len(self.A), self.n
        if not self.E:
            return ca.SX(0, n + 3), ca.SX(0, len(self.F) * d)
        zero = ca.SX.zeros(d, d)
        back = [[self.M[e][f].full() if f in self.M[e] else zero for f in self.F] for e in self.E]
        return ca.vertcat(*(self._columns(self.M[e], self.R[e]) for e in self.E)), ca.blockcat(back)


@kept(maxsize=64)
def eliminating_function(
    field: Field, n: int, parameters: int, degree: int, kind: Kind
) -> tuple[ca.Function, tuple[int, ...], tuple[int, ...]]:
    """The function behind `Elimination`, for one interval.

    Parameters
    ----------
    field
        f(x, p, sign) of the mode.
    n, parameters
        numbers of states and of parameters.
    degree, kind
        collocation scheme.

    Returns
    -------
    (function, F, E).  Inputs as `interval.interval_function`.  Outputs, transposed for arrays that run the other way:
    residual (R), S, rhs, R and M of the states E, all state by state.
    """
    s, d = scheme(degree, kind), degree
    w, x_next = ca.SX.sym("w", n * (d + 1)), ca.SX.sym("x_next", n)
    T, h, sign = ca.SX.sym("T"), ca.SX.sym("h"), ca.SX.sym("sign")
    p, dp, scale = ca.SX.sym("p", parameters), ca.SX.sym("dp", parameters), ca.SX.sym("scale", n)
    z = ca.SX.sym("z", n)
    f = field(scale * z, p, sign) / scale
    J = ca.jacobian(f, z)
    local = ca.Function("jet", [z, p, dp, scale, sign], [f, J, ca.jtimes(f, p, dp)])
    x, X = w[:n], ca.reshape(w[n:], n, d).T
    jets = [local(X[j, :].T, p, dp, scale, sign) for j in range(d)]
    fields, moved = (ca.horzcat(*(jet[k] for jet in jets)).T for k in (0, 2))
    rates: list[list[list[ca.SX]]] = [[[] for _ in range(n)] for _ in range(n)]
    for a, c in zip(*J.sparsity().get_triplet(), strict=True):
        rates[a][c] = [jet[1][a, c] for jet in jets] if ca.depends_on(J[a, c], z) else [J[a, c]]
    A, step = s.matrix, h * T
    sums = ca.mtimes(ca.DM(A), fields)
    stages = X - ca.repmat(x.T, d, 1) - step * sums
    of_lambda = -step * ca.mtimes(ca.DM(A), moved)
    at_node = x_next - x - step * ca.mtimes(fields.T, ca.DM(s.weights))
    known = [ca.horzcat(stages[:, a], -h * sums[:, a], of_lambda[:, a]) for a in range(n)]
    reduced = Substitution(A, step, rates, known)
    outputs = [ca.vertcat(ca.vec(stages.T), at_node), *reduced.left(), *reduced.of_others()]
    inputs = [w, x_next, T, h, sign, p, dp, scale]
    function = ca.Function("elimination", inputs, ca.cse([ca.densify(out.T) for out in outputs]))
    return function, reduced.F, reduced.E


@kept(maxsize=128)
def _part(field: Field, n: int, parameters: int, degree: int, kind: Kind, intervals: int) -> ca.Function:
    """The function over a number of intervals, all arguments given for each."""
    return eliminating_function(field, n, parameters, degree, kind)[0].map(intervals)


class Elimination:
    """`eliminating_function` over N intervals, called through fixed buffers (compiled.py), and what numpy does then."""

    def __init__(self, field: Field, n: int, parameters: int, degree: int, kind: Kind, intervals: int) -> None:
        function, F, E = eliminating_function(field, n, parameters, degree, kind)
        parts = [(_part(field, n, parameters, degree, kind, size), size) for size in sizes_of_parts(intervals)]
        inputs = [n * (degree + 1), n, 1, 1, 1, parameters, parameters, n]
        outputs = [(function.size2_out(i), function.size1_out(i)) for i in range(function.n_out())]
        self._caller = caller_by_rows(parts, inputs, outputs)
        self._shape = intervals, degree, n
        end = scheme(degree, kind).interpolation(np.array([1.0]))
        self._start, self._end, self._own = float(end[0, 0]), end[:, 1:], np.arange(n)
        self._F, self._E = np.array(F, dtype=int), np.array(E, dtype=int)

    def __call__(
        self, w: Array, x_next: Array, duration: Array, fraction: Array, sign: Array, p: Array, dp: Array, scale: Array
    ) -> Eliminated:
        """The intervals with start and stages w (N, R), next nodes (N, n) and so on; results are copies.

        Raises
        ------
        numpy.linalg.LinAlgError : the stages of an interval cannot be eliminated.
        """
        buffers = self._caller.buffers
        w_, x_next_, duration_, fraction_, sign_, p_, dp_, scale_ = buffers.inputs
        for store, value in ((w_, w), (x_next_, x_next), (p_, p), (dp_, dp), (scale_, scale)):
            store[:] = value
        for store, value in ((duration_, duration), (fraction_, fraction), (sign_, sign)):
            store.T[:] = value
        buffers.trigger()
        residual, S, rhs, R, back = buffers.outputs
        N, d, n = self._shape
        Y = np.linalg.solve(S, rhs)
        stages = np.empty((N, d, n, n + 3))
        by_states = stages.transpose(0, 2, 1, 3)
        by_states[:, self._F] = Y.reshape(N, -1, d, n + 3)
        if self._E.size:
            by_states[:, self._E] = (back @ Y + R).reshape(N, -1, d, n + 3)
        residual = residual.reshape(N, -1).copy()
        maps = (self._end @ -stages.reshape(N, d, -1)).reshape(N, n, n + 3)
        maps[:, :, 0] += (self._end @ residual[:, : d * n].reshape(N, d, n))[:, 0] - residual[:, d * n :]
        maps[:, self._own, 1 + self._own] += self._start
        return Eliminated(residual, stages.reshape(N, d * n, n + 3), maps)


@kept(maxsize=32)
def elimination(field: Field, n: int, parameters: int, degree: int, kind: Kind, intervals: int) -> Elimination:
    """The compiled map, kept for reuse: the same mesh size of the same system is built once.

    Parameters
    ----------
    field
        f(x, p, sign) of the mode.
    n, parameters
        numbers of states and of parameters.
    degree, kind
        collocation scheme.
    intervals
        N.

    Returns
    -------
    Elimination.
    """
    return Elimination(field, n, parameters, degree, kind, intervals)
