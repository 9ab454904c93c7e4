"""The stages of an interval eliminated, the states that are integrals of others first.

With the notation of interval.py, minus what the stages change by is Y: where the residual is taken away (first column),
and with x, T and lambda.  Of every state a it has d rows, and

    Y_a - h T A sum_c diag(J_ac) Y_c = K_a,   K = [residual | d/dx | d/dT | d/dlambda],  J_ac = df_a/dx_c at the stages.

The rate of a position does not contain itself.  Such states E, as many as leave no loop among themselves, are put in
terms of the others F by substitution, each after those that its rate contains,

    Y_e = R_e + sum_f M_ef Y_f,    R_e = K_e + h T A sum_c diag(J_ec) R_c,                       c in E before e,
                                   M_ef =      h T A (diag(J_ef) + sum_c diag(J_ec) M_cf),

and the same sums for the states of F give what is left to be solved,

    S Y_F = rhs,    rhs_f = K_f + h T A sum_c diag(J_fc) R_c,  S_fg = 1 - h T A (diag(J_fg) + sum_c diag(J_fc) M_cg),

|F| d rows in place of n d; det S is that of the whole.  R and M stand side by side as columns [R_e | M_e], which the
same sums lead from state to state.  Compiled is what the stages of an interval say by themselves, the field and its
derivatives; the sums are products of A with all columns of all intervals at once.

Symbols: n states, d stages, R = n (d + 1), N intervals, c = n + 3 columns of K, m states whose rate lambda moves.
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
Place = tuple[int, int]

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

    rates: (n, n) bool: the rate of state a contains state c.
    Returns (F, E): as few F as leave no loop among E; every e depends on F and on those before it in E alone.
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


@dataclass(frozen=True)
class Compiled:
    """What is compiled of an interval, and what stands where in it.

    Attributes
    ----------
    function : of w = (x, X) of length R, duration T, fraction h, sign of the mode, p and its direction dp, scale D.
        Outputs, for arrays that run the other way: h f, and h df/dlambda of `moved`, (d, n + m); h T J_ac of `varying`
        (d, .) and of `constant` (1, .).
    varying, constant : the places (a, c) of the J_ac that change from stage to stage, and of those that do not.
    moved : the states whose rate lambda moves.
    F, E : states, see the module docstring.
    """

    function: ca.Function
    varying: tuple[Place, ...]
    constant: tuple[Place, ...]
    moved: tuple[int, ...]
    F: tuple[int, ...]
    E: tuple[int, ...]


@kept(maxsize=64)
def compiled(field: Field, n: int, parameters: int, degree: int) -> Compiled:
    """The function behind `Elimination`, for one interval.

    field: f(x, p, sign) of the mode.
    """
    w, T, h, sign = ca.SX.sym("w", n * (degree + 1)), ca.SX.sym("T"), ca.SX.sym("h"), ca.SX.sym("sign")
    p, dp, scale = ca.SX.sym("p", parameters), ca.SX.sym("dp", parameters), ca.SX.sym("scale", n)
    z = ca.SX.sym("z", n)
    f = field(scale * z, p, sign) / scale
    J, change = ca.jacobian(f, z), ca.jtimes(f, p, dp)
    places = list(zip(*J.sparsity().get_triplet(), strict=True))
    varying = tuple(place for place in places if ca.depends_on(J[place], z))
    constant = tuple(place for place in places if place not in varying)
    moved = tuple(a for a in range(n) if not change[a].is_zero())
    present = np.zeros((n, n), dtype=bool)
    for place in places:
        present[place] = True
    F, E = kept_states(present)
    jet = ca.vertcat(f, *(change[a] for a in moved)), ca.vertcat(ca.SX(0, 1), *(J[place] for place in varying))
    at_stage = ca.Function("jet", [z, p, dp, scale, sign], jet)
    X = ca.reshape(w[n:], n, degree)
    stages = [at_stage(X[:, j], p, dp, scale, sign) for j in range(degree)]
    slopes, rates = (ca.horzcat(*parts).T for parts in zip(*stages, strict=True))
    rates, steady = h * T * rates, h * T * ca.vertcat(ca.SX(0, 1), *(J[place] for place in constant)).T
    outputs = ca.cse([ca.densify(out) for out in (h * slopes, rates, steady)])
    return Compiled(ca.Function("stages", [w, T, h, sign, p, dp, scale], outputs), varying, constant, moved, F, E)


@kept(maxsize=128)
def _part(field: Field, n: int, parameters: int, degree: int, intervals: int) -> ca.Function:
    """The function over a number of intervals, all arguments given for each."""
    return compiled(field, n, parameters, degree).function.map(intervals)


class Elimination:
    """The stages of N intervals eliminated: `compiled` through fixed buffers (compiled.py), and what numpy does then.

    Arrays have stages last and columns before them, the transpose of what the module docstring has: Y (n, N, C, d) of
    C = c + |F| d columns, [R | M] of the states E and [rhs | 1 - S] of F.
    """

    def __init__(self, field: Field, n: int, parameters: int, degree: int, kind: Kind, intervals: int) -> None:
        parts = [(_part(field, n, parameters, degree, size), size) for size in sizes_of_parts(intervals)]
        found, s, d = compiled(field, n, parameters, degree), scheme(degree, kind), degree
        outputs = [(n + len(found.moved), d), (len(found.varying), d), (len(found.constant), 1)]
        self._caller = caller_by_rows(parts, [n * (d + 1), 1, 1, 1, parameters, parameters, n], outputs)
        self._shape, self._moved, self._F, self._E = (intervals, d, n), found.moved, list(found.F), list(found.E)
        blocks = {f: slice(n + 3 + i * d, n + 3 + (i + 1) * d) for i, f in enumerate(found.F)}
        places = list(enumerate((*found.varying, *found.constant)))
        self._own = [[(blocks[c], k) for k, (b, c) in places if a == b and c in blocks] for a in range(n)]
        self._through = [[(c, k) for k, (b, c) in places if a == b and c not in blocks] for a in range(n)]
        self._A, self._sums, self._identity = s.matrix.T.copy(), s.sums.T.copy(), np.eye(len(found.F) * d)
        self._known = np.zeros((n, 1, n + 3 + len(found.F) * d, d))
        self._known[np.arange(n), 0, 1 + np.arange(n)] = -1.0
        end = s.interpolation(np.array([1.0]))[0]
        self._end, self._left_at_end = end[1:].copy(), np.vstack([np.kron(end[1:, None], np.eye(n)), -np.eye(n)])
        self._start = end[0] * np.eye(n, n + 3, 1)[:, None]

    def __call__(
        self, w: Array, x_next: Array, duration: Array, fraction: Array, sign: Array, p: Array, dp: Array, scale: Array
    ) -> Eliminated:
        """The intervals with start and stages w (N, R), next nodes (N, n) and so on; results are copies.

        Raises numpy.linalg.LinAlgError: the stages of an interval cannot be eliminated.
        """
        buffers = self._caller.buffers
        w_, duration_, fraction_, sign_, p_, dp_, scale_ = buffers.inputs
        w_[:], p_[:], dp_[:], scale_[:] = w, p, dp, scale
        duration_[:, 0], fraction_[:, 0], sign_[:, 0] = duration, fraction, sign
        buffers.trigger()
        N, d, n = self._shape
        slopes, varying, constant = buffers.outputs
        residual, Y = self._known_columns(w, x_next, duration, slopes)
        J = [rates[:, None, k] for rates in (varying, constant) for k in range(rates.shape[1])]
        for a in (*self._E, *self._F):
            self._add_integral(J, a, Y)
        Y = self._solved(Y)
        maps = self._start - Y @ self._end
        maps[:, :, 0] += (residual @ self._left_at_end).T
        stages = np.empty((N, n + 3, d, n))
        stages.transpose(3, 0, 1, 2)[:] = Y
        return Eliminated(residual, stages.reshape(N, n + 3, -1).transpose(0, 2, 1), maps.transpose(1, 0, 2))

    def _known_columns(self, w: Array, x_next: Array, duration: Array, slopes: Array) -> tuple[Array, Array]:
        """Residual (N, R) of stages and node, and Y before anything is added to the [K | 0]."""
        N, d, n = self._shape
        sums = (slopes.reshape(-1, d) @ self._sums).reshape(N, -1, d + 1)
        steps = duration[:, None, None] * sums
        residual = np.empty((N, d + 1, n))
        residual[:, :d], residual[:, d] = w.reshape(N, d + 1, n)[:, 1:], x_next
        residual -= w[:, None, :n]
        residual -= steps[:, :n].transpose(0, 2, 1)
        Y = np.empty((n, N, *self._known.shape[2:]))
        Y[:] = self._known
        Y[:, :, 0] = residual[:, :d].transpose(2, 0, 1)
        np.negative(sums[:, :n, :d].transpose(1, 0, 2), out=Y[:, :, n + 1])
        for i, a in enumerate(self._moved, n):
            np.negative(steps[:, i, :d], out=Y[a, :, n + 2])
        return residual.reshape(N, -1), Y

    def _add_integral(self, J: list[Array], a: int, Y: Array) -> None:
        """To the columns of a: h T A sum_c diag(J_ac) Y_c; J has the h T J_ac as (N, 1, d) or (N, 1, 1)."""
        of_a = Y[a]
        for block, k in self._own[a]:
            np.multiply(J[k].transpose(0, 2, 1), self._A, out=of_a[:, block])
        if self._through[a]:
            (c, k), *others = self._through[a]
            inside = J[k] * Y[c]
            for c, k in others:
                inside += J[k] * Y[c]
            of_a += (inside.reshape(-1, len(self._A)) @ self._A).reshape(inside.shape)

    def _solved(self, Y: Array) -> Array:
        """The Y (n, N, c, d) of all states."""
        (N, d, n), F, E = self._shape, self._F, self._E
        c = n + 3
        if len(F) == 1:
            rhs, M = Y[F[0], :, :c], Y[F[0], :, c:]
        else:
            of_F = Y[F].transpose(1, 2, 0, 3).reshape(N, -1, len(F) * d)
            rhs, M = of_F[:, :c], of_F[:, c:]
        S = self._identity - M
        found = np.linalg.solve(S.transpose(0, 2, 1), rhs.transpose(0, 2, 1)).transpose(0, 2, 1)
        out = np.empty((n, N, c, d))
        for i, f in enumerate(F):
            out[f] = found[:, :, i * d : (i + 1) * d]
        for e in E:
            np.add(Y[e, :, :c], found @ Y[e, :, c:], out=out[e])
        return out


@kept(maxsize=32)
def elimination(field: Field, n: int, parameters: int, degree: int, kind: Kind, intervals: int) -> Elimination:
    """The compiled map, kept for reuse: the same mesh size of the same system is built once.

    field: f(x, p, sign) of the mode.
    """
    return Elimination(field, n, parameters, degree, kind, intervals)
