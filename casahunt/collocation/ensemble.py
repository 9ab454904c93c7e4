"""The equations of one transcription for many members at once, each with its own parameters, linearised.

    X_j - x - h T sum_l A_jl f(X_l; p_b) = 0,   x+ - x - h T sum_l b_l f(X_l; p_b) = 0        for members b = 1..B

The vector field and its derivatives f, df/dx, df/dp Q are evaluated at the stages of all members (ensemble_points.py);
Q are m directions in parameter space.  The stages are eliminated by stacked linear algebra (ensemble_stages.py), which
leaves

    maps = [r | A | B | C]  (B, E, n, n + 2 + m)    as in transcription.py, C with m columns

and the node system of each member (node_system.py).  Every number of a member is computed by operations on that
member alone, in the same order whoever else is in the batch: its bits do not depend on the others.

Symbols: B members, n states, d stages, R = n (d + 1), N intervals, M closed forms, E elements, P phases, m directions,
y unknowns of the node system.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import effort
from .ensemble_points import Jets, fields_at, jets_at, joints
from .ensemble_stages import eliminate_many
from .linearisation import Linearisation
from .transcription import Setting, Transcription

Array = np.ndarray

INTERVALS_TOGETHER = 480
"""Intervals eliminated at once: few enough for the caches, enough to hide the price of a call."""


@dataclass(frozen=True, eq=False)
class Settings:
    """The numbers of B solves that are not unknowns.

    Attributes
    ----------
    fractions : (B, N) interval lengths as fractions of their phase.
    p : (B, np) parameter vectors.
    scale : (B, n) state scales D.
    directions : (B, m, np) directions in parameter space; the first one is that of lambda.
    """

    fractions: Array
    p: Array
    scale: Array
    directions: Array

    def __len__(self) -> int:
        return len(self.p)

    def moved(self, steps: Array) -> Settings:
        """The settings at lambda = `steps` (B,)."""
        return Settings(self.fractions, self.p + steps[:, None] * self.directions[:, 0], self.scale, self.directions)

    def of(self, members: Array) -> Settings:
        """Those of some members."""
        return Settings(self.fractions[members], self.p[members], self.scale[members], self.directions[members])

    def one(self, member: int) -> Setting:
        """That of one member."""
        return Setting(self.fractions[member], self.p[member], self.scale[member], self.directions[member, 0])


def settings_of(setting: Setting, p: Array, directions: Array) -> Settings:
    """Settings of members that share mesh and scale.

    p, directions: (B, np) parameters and (B, m, np) directions.
    """
    B = len(p)
    return Settings(
        np.repeat(setting.fractions[None], B, axis=0), np.array(p), np.repeat(setting.scale[None], B, axis=0),
        directions,
    )  # fmt: skip


@dataclass(frozen=True, eq=False)
class Linearisations:
    """The equations of B members linearised, stages eliminated; as `linearisation.Linearisation`, members first.

    Attributes
    ----------
    transcription : whose equations they are.
    interval_residual (B, N, R), flow_residual (B, M, n), closure_residual (B, n) : residuals.
    events : (B, n + 2 + m, P); rows value, d/dx (n), d/dT, d/dq (m).
    maps : (B, E, n, n + 2 + m) of [r | A | B | C].
    closure : (B, n, n) scaled S.
    eliminated : (B, N, n d, n + 2 + m): minus the stage update belonging to 1, dx, dT, dq.
    regular : (B,) False where the stages could not be eliminated.
    """

    transcription: Transcription
    interval_residual: Array
    flow_residual: Array
    closure_residual: Array
    events: Array
    maps: Array
    closure: Array
    eliminated: Array
    regular: Array

    def finite(self) -> Array:
        """(B,) True where residual and Jacobian hold no NaN and no infinity."""
        B = len(self.maps)
        sound = np.isfinite(self.maps).reshape(B, -1).all(axis=1) & np.isfinite(self.events).reshape(B, -1).all(axis=1)
        return sound & self.regular

    def one(self, member: int) -> Linearisation:
        """That of one member."""
        parts = (
            self.interval_residual, self.flow_residual, self.closure_residual, self.events, self.maps, self.closure,
            self.eliminated,
        )  # fmt: skip
        return Linearisation(self.transcription, *(part[member] for part in parts))

    def residual_norms(self) -> Array:
        """(B,) largest residuals in scaled units."""
        parts = (self.interval_residual, self.flow_residual, self.closure_residual, self.events[:, 0])
        B = len(self.maps)
        return np.max([np.abs(part).reshape(B, -1).max(axis=1, initial=0.0) for part in parts], axis=0)

    def rhs(self, direction: int | None = None) -> Array:
        """(B, y) right-hand sides of the Newton steps with border value 0; or what a direction of p puts there."""
        B, n = len(self.maps), self.transcription.n
        zero = np.zeros((B, 1))
        if direction is None:
            return np.concatenate(
                [self.maps[..., 0].reshape(B, -1), -self.closure_residual, -self.events[:, 0], zero], axis=1
            )
        column = n + 2 + direction
        return np.concatenate(
            [self.maps[..., column].reshape(B, -1), np.zeros((B, n)), -self.events[:, column], zero], axis=1
        )

    def nonzeros(self, border: Array) -> Array:
        """(B, nnz) of the node systems, lambda being the first direction, with the border rows (B, .)."""
        n = self.transcription.n
        return self.transcription.system.nonzeros_of_many(
            self.maps[..., : n + 3], self.closure, self.events[:, : n + 3], border
        )

    def solve(self, border: Array, rhs: Array) -> Array:
        """Solutions of the node systems.

        border, rhs: (B, .) border rows, and (B, k, y) right-hand sides. Returns (B, k, y).
        """
        return self.transcription.system.solve_many(self.nonzeros(border), rhs)

    def expand(self, y: Array, inhomogeneous: float, direction: int = 0, along: float = 0.0) -> Array:
        """(B, size) updates of the unknowns for solutions (B, y) of the node systems.

        y: (B, y) the solutions; inhomogeneous: factor of the stage residual: 1 for a step, 0 for a tangent; direction,
        along: a direction of p, and how far it is gone besides lambda. Returns (B, size) du.
        """
        t, B = self.transcription, len(y)
        E, n, P = t.elements, t.n, t.phases
        nodes = y[:, : (E + 1) * n].reshape(B, E + 1, n)
        dT = y[:, (E + 1) * n : -1]
        known = np.zeros((B, t.intervals, self.maps.shape[-1]))
        known[..., 0] = inhomogeneous
        known[..., 1 : n + 1] = nodes[:, t.interval_elements]
        known[..., n + 1] = dT[:, t.phase_of[t.interval_elements]]
        known[..., n + 2] = y[:, -1:]
        known[..., n + 2 + direction] += along
        du = np.empty((B, t.size))
        du[:, : t.intervals * t.rows].reshape(B, t.intervals, t.rows)[..., n:] = -np.matmul(
            self.eliminated, known[..., None]
        )[..., 0]
        du[:, t.node_index] = nodes
        du[:, -P:] = dT
        return du


def nodes_of_many(t: Transcription, u: Array) -> Array:
    """The node states of many members.

    t, u: transcription, and (B, size) unknowns. Returns (B, E + 1, n).
    """
    return u[:, t.node_index]


def linearise_many(t: Transcription, u: Array, settings: Settings) -> Linearisations:
    """Residuals and condensed Jacobians of many members.

    u, settings: (B, size) unknowns, and settings. Returns linearisations; not finite where an iterate is wild.
    """
    effort.problem(t.intervals * len(u))
    with np.errstate(all="ignore"):
        return _linearise_many(t, u, settings)


def _linearise_many(t: Transcription, u: Array, s: Settings) -> Linearisations:
    B, n, d, m = len(u), t.n, t.degree, s.directions.shape[1]
    nodes, T = nodes_of_many(t, u), u[:, -t.phases :]
    maps = np.empty((B, t.elements, n, n + 2 + m))
    residual, eliminated = np.zeros((B, t.intervals, t.rows)), np.zeros((B, t.intervals, n * d, n + 2 + m))
    together = max(1, INTERVALS_TOGETHER // max(t.intervals, 1))
    for first in range(0, B if t.intervals else 0, together):
        own = np.arange(first, min(first + together, B))
        w = u[own, : t.intervals * t.rows].reshape(own.size, t.intervals, d + 1, n)
        duration = T[own][:, t.phase_of[t.interval_elements]]
        parts = intervals_without_stages(t, w, nodes[own][:, t.interval_elements + 1], duration, s.of(own))
        residual[own], eliminated[own], maps[first : first + together, t.interval_elements] = parts
    regular = np.asarray(np.isfinite(eliminated).reshape(B, -1).all(axis=1))
    flow, events = _joint_columns(t, nodes, T, s)
    flow_residual = nodes[:, t.closed_elements + 1] - flow[:, :, 0]
    maps[:, t.closed_elements] = np.concatenate(
        [-flow_residual[..., None], flow[:, :, 1:].transpose(0, 1, 3, 2)], axis=3
    )
    closure = t.cycle.closure * (s.scale[:, None, :] / s.scale[:, :, None])
    closure_residual = nodes[:, 0] - np.matmul(closure, nodes[:, -1, :, None])[..., 0] + t.shift / s.scale
    return Linearisations(t, residual, flow_residual, closure_residual, events, maps, closure, eliminated, regular)


def intervals_without_stages(
    t: Transcription, w: Array, x_next: Array, duration: Array, s: Settings
) -> tuple[Array, Array, Array]:
    """The intervals of a few members, their stages eliminated (ensemble_stages.py).

    w, x_next: (B, N, d + 1, n) starts and stages, (B, N, n) next nodes; duration: (B, N) of the phases that the
    intervals are fractions of [s]. Returns (residual (B, N, R), eliminated (B, N, n d, c), maps (B, N, n, c)).
    """
    return eliminate_many(t, w, x_next, s.fractions * duration, s.fractions, _jets_of(t, w, s))


def _jets_of(t: Transcription, w: Array, s: Settings) -> Jets:
    """Field and derivatives at the stages of all intervals."""
    B, n, m, N, d = len(w), t.n, s.directions.shape[1], t.intervals, t.degree
    out = Jets(np.zeros((n, B, N, d)), np.zeros((n, n, B, N, d)), np.zeros((n, m, B, N, d)))
    for f, members in t.groups:
        own = out if len(t.groups) == 1 else Jets(*(part[..., members, :] for part in (out.f, out.J, out.q)))
        jets_at(f, w[:, members, 1:], t.signs[members], s.p, s.directions, s.scale, own)
        if own is not out:
            out.f[..., members, :], out.J[..., members, :], out.q[..., members, :] = own.f, own.J, own.q
    return out


def fields_of_many(t: Transcription, x: Array, s: Settings) -> Array:
    """The scaled field at points of all intervals.

    x: (B, N, k, n) scaled states. Returns (B, N, k, n).
    """
    out = np.empty_like(x)
    for f, members in t.groups:
        out[:, members] = fields_at(f, x[:, members], t.signs[members], s.p, s.scale)
    return out


def _joint_columns(t: Transcription, nodes: Array, T: Array, s: Settings) -> tuple[Array, Array]:
    """Flows (B, M, n + 2 + m, n) and events (B, n + 2 + m, P): one call of the joints for every direction."""
    mapped, n = joints(t.cycle), t.n
    states, ends = nodes[:, t.closed_elements], nodes[:, t.phase_end]
    flow, events = mapped(states, ends, T, s.p, s.directions[:, 0], s.scale)
    for k in range(1, s.directions.shape[1]):
        more, of_events = mapped(states, ends, T, s.p, s.directions[:, k], s.scale)
        flow = np.concatenate([flow, more[:, :, n + 2 :]], axis=2)
        events = np.concatenate([events, of_events[:, n + 2 :]], axis=1)
    return flow, events
