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
        self._closure_entries = ci * n + cj
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
        *others, self._of_lambda = np.flatnonzero(self._rows == last).tolist()  # nonzeros of the border row
        self._of_others = np.array(others)

    @alone
    def _solver(self, columns: int) -> _LinearSolve:
        """The plain solver for k right-hand sides, or the transposed one for -k; built when first asked for."""
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
        """The matrix from the blocks of a Linearisation and a border row, or those of B members.

        maps: (..., E, n, n + 3) condensed maps: residual, A, B, C; closure: (..., n, n) matrix S; events: (..., n + 3,
        P) values of the events and their derivatives; border: (..., .) of `border`.
        Returns (..., nnz) nonzeros, column after column.
        """
        n, lead = self._shape[1], border.shape[:-1]
        values = [
            -maps[..., 1:].reshape(*lead, -1),
            self._ones if not lead else np.broadcast_to(self._ones, (*lead, self._ones.size)),
            -closure.reshape(*lead, -1).take(self._closure_entries, axis=-1),
            events[..., 1 : n + 1, :].swapaxes(-1, -2).reshape(*lead, -1),
            events[..., n + 1 :, :].reshape(*lead, -1),
            border,
        ]
        return np.concatenate(values, axis=-1).take(self._order, axis=-1)

    def solve(self, nonzeros: Array, rhs: Array) -> Array:
        """Solve the node system, for one right-hand side or k, of one member or of B, one after the other.

        nonzeros: (..., nnz) of `nonzeros`; rhs: (..., y) or (..., k, y).
        Returns the like, whose last entries are exact where the border row has no other: rounding moves no parameter
        that is held.  NaN where a matrix is singular.
        """
        return self._solved(nonzeros, rhs, 1)

    def solve_transposed(self, nonzeros: Array, rhs: Array) -> Array:
        """Solve the transposed node system: the adjoints of linear functionals of y.

        nonzeros, rhs: as in `solve`. A matrix is factorised once for all of its functionals.
        """
        return self._solved(nonzeros, rhs, -1)

    def _solved(self, nonzeros: Array, rhs: Array, sign: int) -> Array:
        if nonzeros.ndim > 1:
            found = [self._solved(*one, sign) for one in zip(nonzeros, rhs, strict=True)]
            return np.array(found).reshape(rhs.shape)
        columns = sign * (len(rhs) if rhs.ndim > 1 else 1)
        y = (self._solvers.get(columns) or self._solver(columns))(nonzeros, rhs)
        if sign > 0 and nonzeros[self._of_lambda] and not nonzeros.take(self._of_others).any():  # a row about lambda
            y.T[-1] = rhs.T[-1] / nonzeros[self._of_lambda]
        return y

    def dense(self, nonzeros: Array) -> Array:
        """The matrix as a dense array (y, y), for tests and condition numbers."""
        out = np.zeros((self.size, self.size))
        out[self._rows, self._cols] = nonzeros
        return out


class _LinearSolve:
    """Sparse QR solve as a CasADi function on fixed buffers: A y = b for k right-hand sides, A^T y = b for -k."""

    def __init__(self, factorisation: ca.Linsol, sparsity: ca.Sparsity, columns: int) -> None:
        size = sparsity.size1()
        A, b = ca.MX.sym("A", sparsity), ca.MX.sym("b", size, abs(columns))
        function = ca.Function("solve", [A, b], [factorisation.solve(A, b, columns < 0)])
        self._caller = caller(function, [sparsity.nnz(), (abs(columns), size)], [(abs(columns), size)])

    def __call__(self, nonzeros: Array, rhs: Array) -> Array:
        """Solutions of the shape of the right-hand sides, (y,) or (k, y)."""
        buffers = self._caller.buffers
        matrix, right = buffers.inputs
        (out,) = buffers.outputs
        matrix[:] = nonzeros
        right[:] = rhs
        out.fill(np.nan)  # a singular matrix leaves the output as it is: it must not be an earlier answer
        buffers.trigger()
        return out.copy() if rhs.ndim == 2 else out[0].copy()


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
