"""The transcription as CasADi graphs, for optimisation: equations, Jacobian, Hessian of the Lagrangian.

IPOPT is given them (ipopt.py), and the conditions of a fold and of an optimum are evaluated from them.  The unknowns
are z = (u, lambda), with p + lambda dp for the parameters.  All
derivatives are made for one interval in scalar expressions, mapped over the mesh, and placed in the sparse
matrices by fixed permutations; nothing is differentiated at the level of the whole mesh.  Entries that
several intervals share (durations, lambda) are summed by a constant 0-1 matrix.

    IPOPT, square problem    f = 0, lambda fixed at 0 by its bounds, empty Hessian
    IPOPT, fold              f = -lambda, exact Hessian
    Newton, fold             L = lambda - nu . G, its gradient and its Hessian along the curve

Symbols as in transcription.py.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..compiled import alone, kept
from ..hybrid.system import Field
from .interval import interval_function
from .joints import joint_function
from .scheme import Kind
from .transcription import Transcription

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Graphs:
    """Symbols and expressions of one transcription.

    Attributes
    ----------
    z : symbol (size + 1,) of the unknowns u and lambda.
    data : symbol of everything else, stacked: fractions (N), p, dp, scale (n).
    nu : symbol (size,) of the multipliers of the equations.
    residual : (size,) in the order of transcription.py.
    jacobian : (size, size + 1), sparse.
    """

    z: ca.MX
    data: ca.MX
    nu: ca.MX
    residual: ca.MX
    jacobian: ca.MX


class _Symbols:
    """The pieces of z and data."""

    def __init__(self, t: Transcription, z: ca.MX, data: ca.MX) -> None:
        N, m, n = t.intervals, len(t.cycle.parameters), t.n
        self.u, self.lam = z[: t.size], z[t.size]
        self.T = z[t.size - t.phases : t.size]
        self.fractions, self.p = data[:N], data[N : N + m]
        self.dp, self.scale = data[N + m : N + 2 * m], data[N + 2 * m : N + 2 * m + n]


class _Sparse:
    """A sparse matrix or vector assembled from (rows, columns, values); entries that meet are summed."""

    def __init__(self, rows: int, columns: int) -> None:
        self.shape = (rows, columns)
        self._row: list[Array] = []
        self._column: list[Array] = []
        self._value: list[ca.MX] = []

    def add(self, row: Array, column: Array, value: ca.MX, select: Array | None = None) -> None:
        """Place the entries of the dense `value` (in its own column-major order) at (row, column)."""
        flat = ca.vec(ca.MX(value))
        if select is not None:
            flat = flat[np.flatnonzero(select.ravel()).tolist()]
            row, column = row[select], column[select]
        self._row.append(row.ravel())
        self._column.append(column.ravel())
        self._value.append(flat)

    def matrix(self) -> ca.MX:
        row, column = np.concatenate(self._row), np.concatenate(self._column)
        key = column * self.shape[0] + row
        unique, place = np.unique(key, return_inverse=True)
        values = ca.vertcat(*self._value)
        gather = ca.DM(
            ca.Sparsity.triplet(unique.size, key.size, place.tolist(), list(range(key.size))), 1.0
        )
        sparsity = ca.Sparsity.triplet(
            *self.shape, (unique % self.shape[0]).tolist(), (unique // self.shape[0]).tolist()
        )
        return ca.MX(sparsity, ca.densify(gather @ values))


@kept(maxsize=8)
def graphs(t: Transcription) -> Graphs:
    """Residual and Jacobian of a transcription as CasADi graphs."""
    n, N, R, P, m = t.n, t.intervals, t.rows, t.phases, len(t.cycle.parameters)
    z, nu, data = ca.MX.sym("z", t.size + 1), ca.MX.sym("nu", t.size), ca.MX.sym("data", N + 2 * m + n)
    s = _Symbols(t, z, data)
    u, T, q, dp, scale = s.u, s.T, s.p + s.lam * s.dp, s.dp, s.scale
    residual, jacobian = _Sparse(t.size, 1), _Sparse(t.size, t.size + 1)
    for field, members in t.groups:
        phase, next_node = _interval_places(t, members)
        function = interval_function(field, n, m, t.degree, t.kind)
        block = function.map("intervals", "serial", members.size, [5, 6, 7], [])(
            *_interval_unknowns(t, u, members), T[phase.tolist()].T, s.fractions[members.tolist()].T,
            ca.DM(t.signs[members]).T, q, dp, scale,
        )  # fmt: skip
        # Column c of the block of interval i: residual, d/dw (R columns), d/dT, d/dlambda.
        shape = (members.size, R + 3, R)
        row = np.broadcast_to(members[:, None, None] * R + np.arange(R), shape)
        column = np.zeros((members.size, R + 3, 1), dtype=int)
        column[:, 1 : R + 1, 0] = members[:, None] * R + np.arange(R)
        column[:, R + 1, 0] = t.size - P + phase
        column[:, R + 2, 0] = t.size
        column = np.broadcast_to(column, shape)
        which = np.broadcast_to(np.arange(R + 3)[None, :, None], shape)
        residual.add(row, np.zeros(shape, dtype=int), block, which == 0)
        jacobian.add(row, column, block, which > 0)
        jacobian.add(row[:, 0, R - n :], next_node, ca.DM.ones(members.size * n))
    flow, events = joint_function(t.cycle)(*_joint_unknowns(t, u), T, q, dp, scale)
    first = N * R
    for i, e in enumerate(t.closed_elements):
        rows, start = first + i * n + np.arange(n), i * (n + 3)
        k = t.size - P + t.phase_of[e]
        residual.add(rows, np.zeros(n, dtype=int), _at(u, t.node_index[e + 1]) - flow[:, start])
        jacobian.add(rows, t.node_index[e + 1], ca.DM.ones(n))
        columns = np.append(t.node_index[e], [k, t.size])
        jacobian.add(np.tile(rows, n + 2), np.repeat(columns, n), -flow[:, start + 1 : start + n + 3])
    first += t.closed * n
    rows = first + np.arange(n)
    S = ca.DM(t.cycle.closure) * (1 / scale @ scale.T)
    shift = ca.DM(t.shift) / scale
    residual.add(rows, np.zeros(n, dtype=int), _at(u, t.node_index[0]) - S @ _at(u, t.node_index[-1]) + shift)
    jacobian.add(rows, t.node_index[0], ca.DM.ones(n))
    jacobian.add(np.tile(rows, n), np.repeat(t.node_index[-1], n), -ca.densify(S))
    first += n
    residual.add(first + np.arange(P), np.zeros(P, dtype=int), events[:, 0])
    for k in range(P):
        columns = np.append(t.node_index[t.phase_end[k]], [t.size - P + k, t.size])
        jacobian.add(np.full(n + 2, first + k), columns, events[k, 1:].T)
    return Graphs(z, data, nu, ca.densify(residual.matrix()), jacobian.matrix())


@alone
def lagrangian_hessian(t: Transcription, g: Graphs | None = None) -> ca.MX:
    """The Hessian of nu . residual in z = (u, lambda).

    Not kept: kept apart from its graphs it would outlive them and speak of symbols that are gone.

    g: its graphs, whose symbols are used; default `graphs(t)`.
    Returns (size + 1, size + 1) expression, the upper triangle, sparse.
    """
    g = g or graphs(t)
    s = _Symbols(t, g.z, g.data)
    n, N, R, P, m = t.n, t.intervals, t.rows, t.phases, len(t.cycle.parameters)
    hessian = _Sparse(t.size + 1, t.size + 1)
    for field, members in t.groups:
        phase, _ = _interval_places(t, members)
        w, _ = _interval_unknowns(t, s.u, members)
        nu = ca.reshape(_at(g.nu, (members[:, None] * R + np.arange(R)).ravel()), R, members.size)
        block = _interval_hessian(field, n, m, t.degree, t.kind).map(
            "hessians", "serial", members.size, [4, 5, 6, 7], []
        )(w, s.T[phase.tolist()].T, s.fractions[members.tolist()].T, ca.DM(t.signs[members]).T,
          s.p, s.dp, s.scale, s.lam, nu)  # fmt: skip
        place = np.concatenate(
            [
                members[:, None] * R + np.arange(R),
                (t.size - P + phase)[:, None],
                np.full((members.size, 1), t.size),
            ],
            axis=1,
        )
        shape = (members.size, R + 2, R + 2)
        column, row = np.broadcast_to(place[:, :, None], shape), np.broadcast_to(place[:, None, :], shape)
        hessian.add(row, column, block, row <= column)
    nu_flow = ca.reshape(g.nu[N * R : N * R + t.closed * n], n, t.closed)
    block = _joint_hessian(t)(
        *_joint_unknowns(t, s.u), s.T, s.p, s.dp, s.scale, s.lam, nu_flow, g.nu[t.size - P :]
    )
    place = np.concatenate(
        [t.node_index[t.closed_elements].ravel(), t.node_index[t.phase_end].ravel(), t.size - P + np.arange(P + 1)]
    )
    row, column = np.meshgrid(place, place, indexing="ij")
    # Column-major, as CasADi stores; a node may be the end of one phase and the start of the next, and
    # then the two triangles of its block are folded into the upper one.
    row, column = row.T.copy(), column.T.copy()
    own = np.arange(place.size)
    lower = (row > column) | ((row == column) & (own[:, None] < own[None, :]))
    hessian.add(np.where(row > column, column, row), np.where(row > column, row, column), block, ~lower)
    return hessian.matrix()


def _at(vector: ca.MX, index: Array) -> ca.MX:
    return vector[np.ravel(index).tolist()]


def _interval_places(t: Transcription, members: Array) -> tuple[Array, Array]:
    """(phase of each interval, (len, n) places of its next node)."""
    elements = t.interval_elements[members]
    return t.phase_of[elements], t.node_index[elements + 1]


def _interval_unknowns(t: Transcription, u: ca.MX, members: Array) -> tuple[ca.MX, ca.MX]:
    w = ca.reshape(_at(u, members[:, None] * t.rows + np.arange(t.rows)), t.rows, members.size)
    _, next_node = _interval_places(t, members)
    return w, ca.reshape(_at(u, next_node), t.n, members.size)


def _joint_unknowns(t: Transcription, u: ca.MX) -> tuple[ca.MX, ca.MX]:
    v = ca.reshape(_at(u, t.node_index[t.closed_elements]), t.n, t.closed)
    return v, ca.reshape(_at(u, t.node_index[t.phase_end]), t.n, t.phases)


@kept(maxsize=32)
def _interval_hessian(field: Field, n: int, m: int, degree: int, kind: Kind) -> ca.Function:
    """Dense Hessian (R + 2, R + 2) of nu . residual of one interval in (w, T, lambda)."""
    R = n * (degree + 1)
    w, T, h, sign = ca.SX.sym("w", R), ca.SX.sym("T"), ca.SX.sym("h"), ca.SX.sym("sign")
    p, dp, scale, lam = ca.SX.sym("p", m), ca.SX.sym("dp", m), ca.SX.sym("scale", n), ca.SX.sym("lam")
    nu = ca.SX.sym("nu", R)
    block = interval_function(field, n, m, degree, kind)(w, ca.SX.zeros(n), T, h, sign, p + lam * dp, dp, scale)
    # A call on symbols repeats the whole block; only its residual column is differentiated further.
    hessian, _ = ca.hessian(ca.dot(nu, block[:, 0]), ca.vertcat(w, T, lam))
    return ca.Function("interval_hessian", [w, T, h, sign, p, dp, scale, lam, nu], [ca.densify(hessian)])


def _joint_hessian(t: Transcription) -> ca.Function:
    n, P, m = t.n, t.phases, len(t.cycle.parameters)
    v, ends, T = ca.SX.sym("v", n, t.closed), ca.SX.sym("ends", n, P), ca.SX.sym("T", P)
    p, dp, scale, lam = ca.SX.sym("p", m), ca.SX.sym("dp", m), ca.SX.sym("scale", n), ca.SX.sym("lam")
    nu_flow, nu_event = ca.SX.sym("nu_flow", n, t.closed), ca.SX.sym("nu_event", P)
    flow, events = joint_function(t.cycle)(v, ends, T, p + lam * dp, dp, scale)
    value = ca.dot(nu_event, events[:, 0])
    for i in range(t.closed):
        value -= ca.dot(nu_flow[:, i], flow[:, i * (n + 3)])
    hessian, _ = ca.hessian(value, ca.vertcat(ca.vec(v), ca.vec(ends), T, lam))
    return ca.Function("joint_hessian", [v, ends, T, p, dp, scale, lam, nu_flow, nu_event], [ca.densify(hessian)])
