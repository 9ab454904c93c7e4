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
from itertools import combinations, product

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
    residual : (..., N, R), stages and node, state by state.
    stages : (..., N, d n, c) the Y of the module docstring: minus the stage update belonging to 1, dx, dT, dlambda.
    maps : (..., N, n, c) of [r | A | B | C], see transcription.py.
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
class Jet:
    """A field with its derivatives as a compiled function, and what stands where in it.

    Attributes
    ----------
    function : of x (n), sign, p, its directions Q (np, m) and the scale D. Outputs: f(D x; p) / D and behind it
        df/dp Q of `moved`, direction after direction; the J_ac of `varying`; those of `constant`.
    varying, constant : the places (a, c) of the J_ac that depend on x, and of those that do not.
    moved : the states whose rate the parameters move.
    F, E : states, see the module docstring.
    """

    function: ca.Function
    varying: tuple[Place, ...]
    constant: tuple[Place, ...]
    moved: tuple[int, ...]
    F: tuple[int, ...]
    E: tuple[int, ...]


@kept(maxsize=64)
def jet(field: Field, n: int, parameters: int, directions: int = 1) -> Jet:
    """The jet of a field f(x, p, sign)."""
    x, sign = ca.SX.sym("x", n), ca.SX.sym("sign")
    p, q, scale = ca.SX.sym("p", parameters), ca.SX.sym("q", parameters, directions), ca.SX.sym("scale", n)
    f = ca.densify(field(scale * x, p, sign) / scale)
    J, changes = ca.jacobian(f, x), [ca.jtimes(f, p, q[:, k]) for k in range(directions)]
    places = list(zip(*J.sparsity().get_triplet(), strict=True))
    varying = tuple(place for place in places if ca.depends_on(J[place], x))
    constant = tuple(place for place in places if place not in varying)
    moved = tuple(a for a in range(n) if not all(change[a].is_zero() for change in changes))
    present = np.zeros((n, n), dtype=bool)
    for place in places:
        present[place] = True
    F, E = kept_states(present)
    outputs = [
        ca.vertcat(f, *(change[a] for change in changes for a in moved)),
        *(ca.vertcat(ca.SX(0, 1), *(J[place] for place in some)) for some in (varying, constant)),
    ]
    outputs = ca.cse([ca.densify(out) for out in outputs])
    return Jet(ca.Function("jet", [x, sign, p, q, scale], outputs), varying, constant, moved, F, E)


@kept(maxsize=64)
def compiled(field: Field, n: int, parameters: int, degree: int) -> ca.Function:
    """The jets at the stages of one interval.

    Returns function of w = (x, X) of length R, duration T, fraction h, sign of the mode, p and its direction dp, scale
    D. Outputs, for arrays that run the other way: h times the first output of the jet (d, n + m); h T times its second
    one (d, .) and its third one (1, .).
    """
    w, T, h, sign = ca.SX.sym("w", n * (degree + 1)), ca.SX.sym("T"), ca.SX.sym("h"), ca.SX.sym("sign")
    p, dp, scale = ca.SX.sym("p", parameters), ca.SX.sym("dp", parameters), ca.SX.sym("scale", n)
    X, at_stage = ca.reshape(w[n:], n, degree), jet(field, n, parameters).function
    stages = [at_stage(X[:, j], sign, p, dp, scale) for j in range(degree)]
    slopes, rates, steady = (ca.horzcat(*parts).T for parts in zip(*stages, strict=True))
    outputs = ca.cse([ca.densify(out) for out in (h * slopes, h * T * rates, h * T * steady[0, :])])
    return ca.Function("stages", [w, T, h, sign, p, dp, scale], outputs)


@kept(maxsize=128)
def _part(field: Field, n: int, parameters: int, degree: int, intervals: int) -> ca.Function:
    """The function over a number of intervals, all arguments given for each."""
    return compiled(field, n, parameters, degree).map(intervals)


class Stages:
    """The stages of intervals eliminated, from the jets there: what numpy does.

    Arrays have stages last and columns before them, the transpose of what the module docstring has: Y (n, N, C, d) of
    C = c + |F| d columns, [R | M] of the states E and [rhs | 1 - S] of F.  The intervals of B members stand one behind
    the other, as many of each.  Products with A are those of one member's arrays, whoever else is there: no bit of a
    member depends on the others.
    """

    def __init__(self, found: Jet, n: int, degree: int, kind: Kind, directions: int = 1) -> None:
        s, d, c = scheme(degree, kind), degree, n + 2 + directions
        self._shape, self._F, self._E = (d, n, c), list(found.F), list(found.E)
        self._moved = [(i, a, k) for i, (k, a) in enumerate(product(range(n + 2, c), found.moved), n)]
        blocks = {f: slice(c + i * d, c + (i + 1) * d) for i, f in enumerate(found.F)}
        places = list(enumerate((*found.varying, *found.constant)))
        self._own = [[(blocks[b], k) for k, (a, b) in places if a == at and b in blocks] for at in range(n)]
        self._through = [[(b, k) for k, (a, b) in places if a == at and b not in blocks] for at in range(n)]
        self._A, self._sums, self._identity = s.matrix.T.copy(), s.sums.T.copy(), np.eye(len(found.F) * d)
        self._known = np.zeros((n, 1, c + len(found.F) * d, d))
        self._known[np.arange(n), 0, 1 + np.arange(n)] = -1.0
        end = s.interpolation(np.array([1.0]))[0]
        self._end, self._left_at_end = end[1:].copy(), np.vstack([np.kron(end[1:, None], np.eye(n)), -np.eye(n)])
        self._start = end[0] * np.eye(n, c, 1)[:, None]

    def __call__(
        self, w: Array, x_next: Array, duration: Array, slopes: Array, rates: list[Array], members: int = 1
    ) -> Eliminated:
        """The intervals with start and stages w (N, R), next nodes (N, n) and durations T (N,) of B `members`.

        slopes: (N, n + m, d) of h f, and of h df/dp Q of the states that are moved; rates: h T J_ac of every place,
        (N, 1, d) or, the same at all stages, (N, 1, 1).
        Raises numpy.linalg.LinAlgError: the stages of an interval cannot be eliminated.
        """
        N, (d, n, c) = len(w), self._shape
        residual, Y = self._known_columns(w, x_next, duration, self._times(slopes, self._sums, members))
        for a in (*self._E, *self._F):
            self._add_integral(rates, a, Y, members)
        Y = self._solved(Y)
        maps = self._start - Y @ self._end
        maps[:, :, 0] += self._times(residual, self._left_at_end, members).T
        stages = np.empty((N, c, d, n))
        stages.transpose(3, 0, 1, 2)[:] = Y
        return Eliminated(residual, stages.reshape(N, c, -1).transpose(0, 2, 1), maps.transpose(1, 0, 2))

    @staticmethod
    def _times(rows: Array, matrix: Array, members: int) -> Array:
        """(..., k) rows times a matrix, those of each member by themselves."""
        shape = (-1, len(matrix)) if members == 1 else (members, -1, len(matrix))
        return (rows.reshape(shape) @ matrix).reshape(*rows.shape[:-1], matrix.shape[1])

    def _known_columns(self, w: Array, x_next: Array, duration: Array, sums: Array) -> tuple[Array, Array]:
        """Residual (N, R) of stages and node, and Y before anything is added to the [K | 0]."""
        N, (d, n, _) = len(w), self._shape
        steps = duration[:, None, None] * sums
        residual = np.empty((N, d + 1, n))
        residual[:, :d], residual[:, d] = w.reshape(N, d + 1, n)[:, 1:], x_next
        residual -= w[:, None, :n]
        residual -= steps[:, :n].transpose(0, 2, 1)
        Y = np.empty((n, N, *self._known.shape[2:]))
        Y[:] = self._known
        Y[:, :, 0] = residual[:, :d].transpose(2, 0, 1)
        np.negative(sums[:, :n, :d].transpose(1, 0, 2), out=Y[:, :, n + 1])
        for i, a, k in self._moved:
            np.negative(steps[:, i, :d], out=Y[a, :, k])
        return residual.reshape(N, -1), Y

    def _add_integral(self, J: list[Array], a: int, Y: Array, members: int) -> None:
        """To the columns of a: h T A sum_c diag(J_ac) Y_c."""
        of_a = Y[a]
        for block, k in self._own[a]:
            np.multiply(J[k].transpose(0, 2, 1), self._A, out=of_a[:, block])
        if self._through[a]:
            (c, k), *others = self._through[a]
            inside = J[k] * Y[c]
            for c, k in others:
                inside += J[k] * Y[c]
            of_a += self._times(inside, self._A, members)

    def _solved(self, Y: Array) -> Array:
        """The Y (n, N, c, d) of all states."""
        (d, n, c), N, F, E = self._shape, Y.shape[1], self._F, self._E
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


class Elimination:
    """The stages of N intervals eliminated, the jets by `compiled` through fixed buffers (compiled.py)."""

    def __init__(self, field: Field, n: int, parameters: int, degree: int, kind: Kind, intervals: int) -> None:
        parts = [(_part(field, n, parameters, degree, size), size) for size in sizes_of_parts(intervals)]
        found = jet(field, n, parameters)
        outputs = [(n + len(found.moved), degree), (len(found.varying), degree), (len(found.constant), 1)]
        self._caller = caller_by_rows(parts, [n * (degree + 1), 1, 1, 1, parameters, parameters, n], outputs)
        self._stages = Stages(found, n, degree, kind)

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
        slopes, varying, constant = buffers.outputs
        rates = [some[:, None, k] for some in (varying, constant) for k in range(some.shape[1])]
        return self._stages(w, x_next, duration, slopes, rates)


@kept(maxsize=32)
def elimination(field: Field, n: int, parameters: int, degree: int, kind: Kind, intervals: int) -> Elimination:
    """The compiled map, kept for reuse: the same mesh size of the same system is built once.

    field: f(x, p, sign) of the mode.
    """
    return Elimination(field, n, parameters, degree, kind, intervals)
