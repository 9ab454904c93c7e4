"""The node system: what is left of the collocation equations when the stages are eliminated.

Sparsity and solver for the matrix drawn in transcription.py, with a border row.  They depend on the
structure of the chain alone (elements, phases, closure) and are built once for it.

Symbols: n states, E elements, P phases, y = (E + 1) n + P + 1 unknowns.

The equations of a transcription linearised at one point, stages eliminated: residuals, Newton steps, tangents.

The node system and its blocks A, B, C are drawn in transcription.py, which makes a `Linearisation`.

Symbols: n states, d stages, R = n (d + 1), N intervals, M closed forms, E = N + M elements,
P phases, y = (E + 1) n + P + 1 unknowns of the node system; of many members B.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any, Protocol

import casadi as ca
import numpy as np

from ..compiled import alone, caller, kept


class Layout(Protocol):
    """What a linearisation needs of its transcription: where the unknowns stand, and the node system."""

    n: int
    rows: int
    intervals: int
    elements: int
    phase_of_intervals: Array
    inside: Array | slice
    size: int
    node_index: Array

    @property
    def system(self) -> NodeSystem:
        """What is left when the stages are eliminated."""

    def intervals_of(self, u: Array) -> Array:
        """View of the interval unknowns."""

    def durations_of(self, u: Array) -> Array:
        """View of the durations."""


@dataclass(frozen=True, eq=False)
class Linearisation:
    """The equations linearised at one u, stages eliminated; or of B members, whose axis comes first.

    c = n + 2 + m columns, m = 1 but for many members with more directions (transcription.Setting).

    Attributes
    ----------
    transcription : whose equations they are.
    interval_residual (..., N, R), flow_residual (..., M, n), closure_residual (..., n) : residuals.
    events : (..., c, P); rows value, d/dx (n), d/dT, d/d lambda (m).
    maps : (..., E, n, c) of [r | A | B | C], see transcription.py.
    closure : (..., n, n) scaled S.
    eliminated : (..., N, n d, c): minus the stage update belonging to 1, dx, dT, dlambda.
    """

    transcription: Layout
    interval_residual: Array
    flow_residual: Array
    closure_residual: Array
    events: Array
    maps: Array
    closure: Array
    eliminated: Array

    def residual_norm(self) -> Any:
        """(...) largest residuals in scaled units; NaN where anything is NaN (numpy, never casadi.norm_inf)."""
        parts = (self.interval_residual, self.flow_residual, self.closure_residual, self.events[..., 0, :])
        shape = (*self.closure.shape[:-2], -1)
        found = [np.abs(part).reshape(shape).max(axis=-1, initial=0.0) for part in parts if part.size]
        return np.where(self.finite(), reduce(np.maximum, found), np.nan)[()]

    def finite(self) -> Any:
        """(...) True where residual and Jacobian hold no NaN and no infinity."""
        maps, events = np.isfinite(self.maps), np.isfinite(self.events)
        return np.logical_and.reduce(maps, axis=(-3, -2, -1)) & np.logical_and.reduce(events, axis=(-2, -1))

    def one(self, member: int) -> Linearisation:
        """That of one member."""
        parts = (
            self.interval_residual, self.flow_residual, self.closure_residual, self.events, self.maps, self.closure,
            self.eliminated,
        )  # fmt: skip
        return Linearisation(self.transcription, *(part[member] for part in parts))

    def over(self, transcription: Layout, maps: Array) -> Linearisation:
        """The same equations over other elements, those of another transcription."""
        return Linearisation(
            transcription, self.interval_residual, self.flow_residual, self.closure_residual, self.events, maps,
            self.closure, self.eliminated,
        )  # fmt: skip

    def rhs(self, border: float = 0.0, direction: int | None = None) -> Array:
        """(..., y) right-hand side of the Newton step, the border row's value last; or what a direction puts there."""
        t, lead, column = self.transcription, self.closure.shape[:-2], 0
        rhs = np.empty((*lead, t.system.size))
        closure = -self.closure_residual
        if direction is not None:
            closure, column = np.zeros_like(closure), t.n + 2 + direction
        nodes = t.elements * t.n
        rhs[..., :nodes] = self.maps[..., column].reshape(*lead, nodes)
        rhs[..., nodes : nodes + t.n] = closure
        rhs[..., nodes + t.n : -1] = -self.events[..., column, :]
        rhs[..., -1] = border
        return rhs

    def matrix(self, border: Array) -> Array:
        """(..., nnz) nonzeros of the node system with the given border row (see NodeSystem.border_columns)."""
        c = self.transcription.n + 3
        return self.transcription.system.nonzeros(
            self.maps[..., :c], self.closure, self.events[..., :c, :], border
        )

    def step(self, border: Array, border_value: float = 0.0) -> tuple[Array, Array, Any]:
        """One Newton step under a border row.

        Returns (du, dy, dlambda) : update of u (..., size), the node-system solution (..., y) and the last entry of it.
        """
        y = self.transcription.system.solve(self.matrix(border), self.rhs(border_value))
        return self.expand(y, 1.0), y, y[..., -1]

    def tangent(self, border: Array) -> tuple[Array, Array]:
        """(du/ds, y) with border . y = 1: the direction of the solution curve."""
        rhs = np.zeros((*self.closure.shape[:-2], self.transcription.system.size))
        rhs[..., -1] = 1.0
        y = self.transcription.system.solve(self.matrix(border), rhs)
        return self.expand(y, 0.0), y

    def step_and_tangent(self, border: Array) -> tuple[Array, Array]:
        """Both (..., y): the node system's solutions of `step` and of `tangent`, the matrix factorised once."""
        rhs = np.zeros((*self.closure.shape[:-2], 2, self.transcription.system.size))
        rhs[..., 0, :], rhs[..., 1, -1] = self.rhs(), 1.0
        y = self.transcription.system.solve(self.matrix(border), rhs)
        return y[..., 0, :], y[..., 1, :]

    def return_map(self) -> Array:
        """(n, n) scaled M, the linearised map of the start to S times the end; one of its eigenvalues is zero.

        The quick look at the multipliers of a stable cycle: the start responds to a disturbance of the closure by
        (I - M)^-1.  Digits that M loses there are lost; orbits/floquet.py loses none.
        """
        t = self.transcription
        matrix, n = self.matrix(t.system.border(parameter=1.0)), t.n
        response = t.system.solve_transposed(matrix, np.eye(n, t.system.size))
        return np.eye(n) - np.linalg.inv(response[:, t.elements * n : (t.elements + 1) * n])

    def return_map_eigenvalues(self) -> Array:
        """(n,) eigenvalues of `return_map`."""
        return np.linalg.eigvals(self.return_map())

    def expand(self, y: Array, inhomogeneous: float, direction: int = 0, along: float = 0.0) -> Array:
        """The update of all unknowns that belongs to a solution of the node system.

        y: (..., y) the solution; inhomogeneous: factor of the stage residual: 1 for a step, 0 for a tangent; direction,
        along: a direction of p, and how far it is gone besides lambda.
        Returns (..., size) du.
        """
        t, lead = self.transcription, y.shape[:-1]
        E, n = t.elements, t.n
        nodes = y[..., : (E + 1) * n].reshape(*lead, E + 1, n)
        dT = y[..., (E + 1) * n : -1]
        known = np.empty((*lead, t.intervals, self.eliminated.shape[-1]))
        known[..., 0] = inhomogeneous
        known[..., 1 : n + 1] = nodes[..., t.inside, :]
        known[..., n + 1] = dT.take(t.phase_of_intervals, axis=-1)
        known[..., n + 2] = y[..., -1:]
        known[..., n + 3 :] = 0.0
        if along:
            known[..., n + 2 + direction] += along
        du = np.empty((*lead, t.size))
        np.negative((self.eliminated @ known[..., None])[..., 0], out=t.intervals_of(du)[..., n:])
        du[..., t.node_index] = nodes
        t.durations_of(du)[...] = dT
        return du


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
