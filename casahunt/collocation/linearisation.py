"""The equations of a transcription linearised at one point, stages eliminated: residuals, Newton steps, tangents.

The node system and its blocks A, B, C are drawn in transcription.py, which makes a `Linearisation`.

Symbols: n states, d stages, R = n (d + 1), N intervals, M closed forms, E = N + M elements,
P phases, y = (E + 1) n + P + 1 unknowns of the node system.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from .node_system import ADJOINTS, NodeSystem

Array = np.ndarray


class Layout(Protocol):
    """What a linearisation needs of its transcription: where the unknowns stand, and the node system."""

    n: int
    size: int
    intervals: int
    elements: int
    phases: int
    node_index: Array
    phase_of: Array
    interval_elements: Array

    @property
    def system(self) -> NodeSystem:
        """What is left when the stages are eliminated."""

    def intervals_of(self, u: Array) -> Array:
        """(N, R) view of the interval unknowns w."""


@dataclass(frozen=True, eq=False)
class Linearisation:
    """The equations linearised at one u, stages eliminated.

    Attributes
    ----------
    transcription : whose equations they are.
    interval_residual (N, R), flow_residual (M, n), closure_residual (n,) : residuals.
    events : (n + 3, P); rows value, d/dx (n), d/dT, d/d lambda.
    maps : (E, n, n + 3) of [r | A | B | C], see transcription.py.
    closure : (n, n) scaled S.
    eliminated : (N, n d, n + 3): minus the stage update belonging to 1, dx, dT, dlambda.
    """

    transcription: Layout
    interval_residual: Array
    flow_residual: Array
    closure_residual: Array
    events: Array
    maps: Array
    closure: Array
    eliminated: Array

    def residual_norm(self) -> float:
        """Largest residual in scaled units; NaN where anything is NaN (numpy, never casadi.norm_inf)."""
        parts = (self.interval_residual, self.flow_residual, self.closure_residual, self.events[0])
        return max(float(np.abs(part).max(initial=0.0)) for part in parts) if self.finite() else float("nan")

    def finite(self) -> bool:
        """True where residual and Jacobian hold no NaN and no infinity."""
        return bool(np.isfinite(self.maps).all() and np.isfinite(self.events).all())

    def rhs(self, border: float = 0.0) -> Array:
        """Right-hand side (y,) of the Newton step, with the border row's value last."""
        return np.concatenate(
            [self.maps[:, :, 0].ravel(), -self.closure_residual, -self.events[0], [border]]
        )

    def matrix(self, border: Array) -> Array:
        """Nonzeros of the node system with the given border row (see NodeSystem.border_columns)."""
        return self.transcription.system.nonzeros(self.maps, self.closure, self.events, border)

    def step(self, border: Array, border_value: float = 0.0) -> tuple[Array, Array, float]:
        """One Newton step under a border row.

        Returns (du, dy, dlambda) : update of u (size,), the node-system solution (y,) and the last entry of it.
        """
        y = self.transcription.system.solve(self.matrix(border), self.rhs(border_value))
        return self.expand(y, 1.0), y, float(y[-1])

    def tangent(self, border: Array) -> tuple[Array, Array]:
        """(du/ds, y) with border . y = 1: the direction of the solution curve."""
        rhs = np.zeros(self.transcription.system.size)
        rhs[-1] = 1.0
        y = self.transcription.system.solve(self.matrix(border), rhs)
        return self.expand(y, 0.0), y

    def return_map(self) -> Array:
        """(n, n) scaled M, the linearised map of the start to S times the end; one of its eigenvalues is zero.

        The quick look at the multipliers of a stable cycle: the start responds to a disturbance of the closure by
        (I - M)^-1.  Digits that M loses there are lost; orbits/floquet.py loses none.
        """
        t = self.transcription
        matrix, n = self.matrix(t.system.border(parameter=1.0)), t.n
        response = np.concatenate(
            [t.system.solve_transposed(matrix, np.eye(t.system.size)[k : min(k + ADJOINTS, n)])
             for k in range(0, n, ADJOINTS)]
        )[:, t.elements * n : (t.elements + 1) * n]  # fmt: skip
        return np.eye(n) - np.linalg.inv(response)

    def return_map_eigenvalues(self) -> Array:
        """(n,) eigenvalues of `return_map`."""
        return np.linalg.eigvals(self.return_map())

    def expand(self, y: Array, inhomogeneous: float) -> Array:
        """The update of all unknowns that belongs to a solution of the node system.

        y: (y,) the solution; inhomogeneous: factor of the stage residual: 1 for a step, 0 for a tangent.
        Returns (size,) du.
        """
        t = self.transcription
        E, n, P = t.elements, t.n, t.phases
        nodes = y[: (E + 1) * n].reshape(E + 1, n)
        dT = y[(E + 1) * n : -1]
        known = np.empty((t.intervals, n + 3))
        known[:, 0] = inhomogeneous
        known[:, 1 : n + 1] = nodes[t.interval_elements]
        known[:, n + 1] = dT[t.phase_of[t.interval_elements]]
        known[:, n + 2] = y[-1]
        du = np.empty(t.size)
        w = t.intervals_of(du)
        w[:, n:] = -(self.eliminated @ known[:, :, None])[:, :, 0]
        du[t.node_index] = nodes
        du[-P:] = dT
        return du
