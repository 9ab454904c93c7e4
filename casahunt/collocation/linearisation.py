"""The equations of a transcription linearised at one point, stages eliminated: residuals, Newton steps, tangents.

The node system and its blocks A, B, C are drawn in transcription.py, which makes a `Linearisation`.

Symbols: n states, d stages, R = n (d + 1), N intervals, M closed forms, E = N + M elements,
P phases, y = (E + 1) n + P + 1 unknowns of the node system; of many members B.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import reduce
from typing import Any, Protocol

import numpy as np

from .node_system import NodeSystem

Array = np.ndarray


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
