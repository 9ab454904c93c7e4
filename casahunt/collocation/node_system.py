"""The node system: what is left of the collocation equations when the stages are eliminated.

Sparsity and solver for the matrix drawn in transcription.py, with a border row.  They depend on the
structure of the chain alone (elements, phases, closure) and are built once for it.

Symbols: n states, E elements, P phases, y = (E + 1) n + P + 1 unknowns.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiled import alone, caller, kept

Array = np.ndarray

ADJOINTS = 3
"""Functionals whose errors are estimated at once: period, amplitude, parameter."""


class NodeSystem:
    """Sparsity and solver of the node system; depends on the structure of the chain alone.

    Factorising symbolically takes 15 ms at 80 elements, so it is done when first needed, and once for the plain
    and the transposed solver.
    CasADi's sparse QR solves it: backward stable where the interval maps span many decades (csparse's
    LU lost six digits there) and as fast, 0.05 ms at 80 elements of 4 states.
    """

    def __init__(self, elements: int, n: int, phase_of: Array, phase_end: Array, closure: Array) -> None:
        E, P = elements, phase_end.size
        self.size = (E + 1) * n + P + 1
        self._shape = (E, n, P)
        last = self.size - 1
        states = np.arange(E * n).reshape(E, n)  # numbers of x_0 ... x_(E-1), as columns and as rows of their maps
        duration = (E + 1) * n + phase_of
        blocks = np.column_stack([states, duration, np.full(E, last)])  # (E, n + 2): columns of A, B and C
        ends = phase_end[:, None] * n + np.arange(n)
        ci, cj = np.nonzero(closure)
        self._closure_entries = (ci, cj)
        first_event = (E + 1) * n
        joint_nodes = np.concatenate([[0], phase_end])
        self.border_columns = np.concatenate(
            [(joint_nodes[:, None] * n + np.arange(n)).ravel(), (E + 1) * n + np.arange(P), [last]]
        )
        """Columns that the border row may use: phase-end nodes (the very first included), T, lambda."""
        rows = [
            np.repeat(states, n + 2), states.ravel(), E * n + np.arange(n), E * n + ci,
            np.repeat(first_event + np.arange(P), n), first_event + np.arange(P), first_event + np.arange(P),
            np.full(self.border_columns.size, last),
        ]  # fmt: skip
        columns = [
            np.repeat(blocks, n, axis=0).ravel(), states.ravel() + n, np.arange(n), E * n + cj,
            ends.ravel(), (E + 1) * n + np.arange(P), np.full(P, last),
            self.border_columns,
        ]  # fmt: skip
        row, column = np.concatenate(rows), np.concatenate(columns)
        # For a chain of one element the closure may meet itself; elsewhere every entry is unique.
        self._order = np.lexsort((row, column))
        self._ones = np.ones((E + 1) * n)
        sparsity = ca.Sparsity.triplet(self.size, self.size, row.tolist(), column.tolist())
        if sparsity.nnz() != row.size:
            raise AssertionError("node system: two entries share a place")
        self._sparsity = sparsity
        self._factorisation: ca.Linsol | None = None
        self._solvers: dict[int, _LinearSolve] = {}
        self._rows, self._cols = row[self._order], column[self._order]
        self._border = np.flatnonzero(self._rows == last)  # of the nonzeros; that of lambda is the last one

    @alone
    def _solver(self, columns: int) -> _LinearSolve:
        """The plain solver for one (0) or -k right-hand sides, the transposed one for k; built when first asked for."""
        if columns not in self._solvers:
            if self._factorisation is None:
                self._factorisation = ca.Linsol("node_system", "qr", self._sparsity)
            self._solvers[columns] = _LinearSolve(self._factorisation, self._sparsity, columns)
        return self._solvers[columns]

    def border(self, *, nodes: Array | None = None, durations: Array | None = None, parameter: float = 0.0) -> Array:
        """A border row.

        nodes: (P + 1, n) weights of the phase-end nodes; default 0; durations: (P,) weights of the durations; default
        0. Returns ((P + 1) n + P + 1,).
        """
        E, n, P = self._shape
        return np.concatenate(
            [
                np.zeros((P + 1) * n) if nodes is None else np.ravel(nodes),
                np.zeros(P) if durations is None else durations,
                [parameter],
            ]
        )

    def nonzeros(self, maps: Array, closure: Array, events: Array, border: Array) -> Array:
        """The matrix from the blocks of a Linearisation and a border row.

        maps: (E, n, n + 3) condensed maps: residual, A, B, C; closure: (n, n) matrix S; events: (n + 3, P) values of
        the events and their derivatives; border: of `border`. Returns nonzeros, column after column.
        """
        n = self._shape[1]
        values = np.concatenate(
            [
                -maps[:, :, 1:].ravel(),
                self._ones,
                -closure[self._closure_entries],
                events[1 : n + 1].T.ravel(),
                events[n + 1 :].ravel(),
                border,
            ]
        )
        return values[self._order]

    def solve(self, nonzeros: Array, rhs: Array) -> Array:
        """Solve the node system.

        nonzeros: of `nonzeros`; rhs: (y,) right-hand side. Returns (y,), whose last entry is exact where the border row
        has no other: rounding moves no parameter that is held.
        """
        y = (self._solvers.get(0) or self._solver(0))(nonzeros, rhs)
        if self._holds(nonzeros):
            y[-1] = rhs[-1] / nonzeros[self._border[-1]]
        return y

    def _holds(self, nonzeros: Array) -> bool:
        """Whether the border row is about lambda alone."""
        return not nonzeros[self._border[:-1]].any() and bool(nonzeros[self._border[-1]])

    def solve_transposed(self, nonzeros: Array, rhs: Array) -> Array:
        """Solve the transposed node system: the adjoints of linear functionals of y.

        The matrix is factorised once for all of them.

        nonzeros: of `nonzeros`; rhs: (k, y) the functionals, k <= ADJOINTS. Returns (k, y).
        """
        goals = np.zeros((ADJOINTS, self.size))
        goals[: len(rhs)] = rhs
        return (self._solvers.get(ADJOINTS) or self._solver(ADJOINTS))(nonzeros, goals)[: len(rhs)]

    def nonzeros_of_many(self, maps: Array, closure: Array, events: Array, border: Array) -> Array:
        """The matrices of B members.

        maps, closure, events, border: as in `nonzeros`, with an axis of B members in front.
        Returns (B, nnz) nonzeros, column after column.
        """
        B, n = len(maps), self._shape[1]
        ci, cj = self._closure_entries
        values = np.concatenate(
            [
                -maps[..., 1:].reshape(B, -1),
                np.broadcast_to(self._ones, (B, self._ones.size)),
                -closure[:, ci, cj],
                events[:, 1 : n + 1].transpose(0, 2, 1).reshape(B, -1),
                events[:, n + 1 :].reshape(B, -1),
                border,
            ],
            axis=1,
        )
        return values[:, self._order]

    def solve_many(self, nonzeros: Array, rhs: Array, *, transposed: bool = False) -> Array:
        """The node systems of B members, one after the other, each factorised once.

        nonzeros: (B, nnz); rhs: (B, k, y) right-hand sides.
        Returns (B, k, y); NaN for a member whose matrix is singular, exact where it holds lambda, as in `solve`.
        """
        columns = rhs.shape[1] if transposed else -rhs.shape[1]
        solve = self._solvers.get(columns) or self._solver(columns)
        out = np.empty_like(rhs)
        for b in range(len(rhs)):
            out[b] = solve(nonzeros[b], rhs[b])
            if not transposed and self._holds(nonzeros[b]):
                out[b, :, -1] = rhs[b, :, -1] / nonzeros[b, self._border[-1]]
        return out

    def dense(self, nonzeros: Array) -> Array:
        """The matrix as a dense array (y, y), for tests and condition numbers."""
        out = np.zeros((self.size, self.size))
        out[self._rows, self._cols] = nonzeros
        return out


class _LinearSolve:
    """Sparse QR solve as a CasADi function on fixed buffers.

    A y = b for one (`columns` 0) or -k right-hand sides b, A^T y = b for k of them.
    """

    def __init__(self, factorisation: ca.Linsol, sparsity: ca.Sparsity, columns: int) -> None:
        size = sparsity.size1()
        A, b = ca.MX.sym("A", sparsity), ca.MX.sym("b", size, max(abs(columns), 1))
        function = ca.Function("solve", [A, b], [factorisation.solve(A, b, columns > 0)])
        shape = (abs(columns), size) if columns else (size,)
        self._caller = caller(function, [sparsity.nnz(), shape], [shape])

    def __call__(self, nonzeros: Array, rhs: Array) -> Array:
        buffers = self._caller.buffers
        matrix, right = buffers.inputs
        (out,) = buffers.outputs
        matrix[:] = nonzeros
        right[:] = rhs
        out.fill(np.nan)  # a singular matrix leaves the output as it is: it must not be an earlier answer
        buffers.trigger()
        return out.copy()


@kept(maxsize=48)
def node_system(
    elements: int, n: int, phase_of: tuple[int, ...], phase_end: tuple[int, ...], closure: bytes
) -> NodeSystem:
    """The node system of a chain structure, built once.

    closure: (n, n) matrix S, as bytes.
    """
    return NodeSystem(
        elements, n, np.array(phase_of), np.array(phase_end), np.frombuffer(closure).reshape(n, n)
    )
