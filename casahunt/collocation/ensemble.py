"""The equations of one transcription for many members at once, each with its own parameters, linearised.

    X_j - x - h T sum_l A_jl f(X_l; p_b) = 0,   x+ - x - h T sum_l b_l f(X_l; p_b) = 0        for members b = 1..B

The vector field and its derivatives are compiled for one point alone, [f | df/dx | df/dp Q], and mapped over the points
of all members in chunks of fixed size; Q are m directions in parameter space.  The rest is numpy, stacked:

    K = I - h T A x J       (B, N, n d, n d)        stage Jacobian, by broadcasting
    K E = [stage residual | d/dx | d/dT | d/dq]     one stacked solve with n + 2 + m right-hand sides
    maps = [r | A | B | C]  (B, E, n, n + 2 + m)    as in transcription.py, C with m columns

followed by the node system of each member (node_system.py).  Every number of a member is computed by operations on that
member alone, in the same order whoever else is in the batch: its bits do not depend on the others.

Symbols: B members, n states, d stages, R = n (d + 1), N intervals, M closed forms, E elements, P phases, m directions,
y unknowns of the node system.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from .. import effort
from .ensemble_points import fields, jets, joints
from .linearisation import Linearisation
from .transcription import Setting, Transcription

Array = np.ndarray

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

    Parameters
    ----------
    setting
        of one of them.
    p, directions
        (B, np) parameters and (B, m, np) directions.

    Returns
    -------
    Settings.
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

        Parameters
        ----------
        border, rhs
            (B, .) border rows, and (B, k, y) right-hand sides.

        Returns
        -------
        (B, k, y).
        """
        return self.transcription.system.solve_many(self.nonzeros(border), rhs)

    def expand(self, y: Array, inhomogeneous: float, direction: int = 0, along: float = 0.0) -> Array:
        """(B, size) updates of the unknowns for solutions (B, y) of the node systems.

        Parameters
        ----------
        y
            (B, y) the solutions.
        inhomogeneous
            factor of the stage residual: 1 for a step, 0 for a tangent.
        direction, along
            a direction of p, and how far it is gone besides lambda.

        Returns
        -------
        (B, size) du.
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

    Parameters
    ----------
    t, u
        transcription, and (B, size) unknowns.

    Returns
    -------
    (B, E + 1, n).
    """
    return u[:, t.node_index]


def linearise_many(t: Transcription, u: Array, settings: Settings) -> Linearisations:
    """Residuals and condensed Jacobians of many members.

    Parameters
    ----------
    t
        the transcription, the same for all.
    u, settings
        (B, size) unknowns, and settings.

    Returns
    -------
    Linearisations; not finite where an iterate is wild.
    """
    effort.problem(t.intervals * len(u))
    with np.errstate(all="ignore"):
        return _linearise_many(t, u, settings)


def _linearise_many(t: Transcription, u: Array, s: Settings) -> Linearisations:
    B, n, d, m = len(u), t.n, t.degree, s.directions.shape[1]
    nodes, T = nodes_of_many(t, u), u[:, -t.phases :]
    maps = np.empty((B, t.elements, n, n + 2 + m))
    regular = np.ones(B, dtype=bool)
    if t.intervals:
        w = u[:, : t.intervals * t.rows].reshape(B, t.intervals, d + 1, n)
        step = s.fractions * T[:, t.phase_of[t.interval_elements]]
        jet = _jets_of(t, w, s)
        x_next = nodes[:, t.interval_elements + 1]
        residual, eliminated, condensed = _eliminate(t, w, x_next, step, s.fractions, jet)
        maps[:, t.interval_elements] = condensed
        regular = np.isfinite(eliminated).reshape(B, -1).all(axis=1)
    else:
        residual, eliminated = np.zeros((B, 0, t.rows)), np.zeros((B, 0, n * d, n + 2 + m))
    flow, events = _joint_columns(t, nodes, T, s)
    flow_residual = nodes[:, t.closed_elements + 1] - flow[:, :, 0]
    maps[:, t.closed_elements] = np.concatenate(
        [-flow_residual[..., None], flow[:, :, 1:].transpose(0, 1, 3, 2)], axis=3
    )
    closure = t.cycle.closure * (s.scale[:, None, :] / s.scale[:, :, None])
    closure_residual = nodes[:, 0] - np.matmul(closure, nodes[:, -1, :, None])[..., 0] + t.shift / s.scale
    return Linearisations(t, residual, flow_residual, closure_residual, events, maps, closure, eliminated, regular)


def _jets_of(t: Transcription, w: Array, s: Settings) -> Array:
    """(B, N, d, 1 + n + m, n) field and derivatives at the stages of all intervals."""
    B, n, m = len(w), t.n, s.directions.shape[1]
    points = w[:, :, 1:]
    jet = np.empty((B, t.intervals, t.degree, 1 + n + m, n))
    for f, members in t.groups:
        x = np.ascontiguousarray(points[:, members]).reshape(-1, n)
        signs = np.tile(np.repeat(t.signs[members], t.degree), B)
        mapped = jets(f, n, s.p.shape[1], m)
        each = members.size * t.degree
        jet[:, members] = mapped((x, signs), (s.p, s.directions, s.scale), each).reshape(
            B, members.size, t.degree, 1 + n + m, n
        )
    return jet


def fields_of_many(t: Transcription, x: Array, s: Settings) -> Array:
    """The scaled field at points of all intervals.

    Parameters
    ----------
    t
        the transcription.
    x
        (B, N, k, n) scaled states.
    s
        settings.

    Returns
    -------
    (B, N, k, n).
    """
    out, (B, _, k, n) = np.empty_like(x), x.shape
    for f, members in t.groups:
        signs = np.tile(np.repeat(t.signs[members], k), B)
        states = np.ascontiguousarray(x[:, members]).reshape(-1, n)
        values = fields(f, n, s.p.shape[1])((states, signs), (s.p, s.scale), members.size * k)
        out[:, members] = values.reshape(B, members.size, k, n)
    return out


def _eliminate(
    t: Transcription, w: Array, x_next: Array, step: Array, fractions: Array, jet: Array
) -> tuple[Array, Array, Array]:
    """(residual (B, N, R), eliminated, condensed maps) of the intervals; see the module docstring."""
    B, N, n, d = len(w), t.intervals, t.n, t.degree
    columns = jet.shape[3] + 1
    A, b = t.scheme.matrix, t.scheme.weights
    x, X = w[:, :, :1], w[:, :, 1:]
    # K[(j, a), (l, c)] = delta - h T A_jl df_a/dx_c(X_l)
    J = jet[:, :, :, 1 : n + 1].transpose(0, 1, 4, 2, 3)  # (B, N, a, l, c)
    K = np.multiply((step[:, :, None, None] * -A)[:, :, :, None, :, None], J[:, :, None])
    K = K.reshape(B, N, d * n, d * n)
    own = np.arange(d * n)
    K[:, :, own, own] += 1.0
    others = jet[:, :, :, [0, *range(n + 1, columns - 1)]].reshape(B, N, d, -1)  # f and df/dq at the stages
    sums = np.matmul(np.vstack([A, b]), others).reshape(B, N, d + 1, columns - 1 - n, n)
    known = np.empty((B, N, d + 1, n, columns))
    ends = np.concatenate([X, x_next[:, :, None]], axis=2)
    known[..., 0] = ends - x - step[:, :, None, None] * sums[:, :, :, 0]
    known[..., 1 : n + 1] = -np.eye(n)
    known[..., n + 1] = -fractions[:, :, None, None] * sums[:, :, :, 0]
    known[..., n + 2 :] = -(step[:, :, None, None, None] * sums[:, :, :, 1:]).transpose(0, 1, 2, 4, 3)
    residual = known[..., 0].reshape(B, N, -1)
    known = known.reshape(B, N, (d + 1) * n, columns)
    eliminated = _solved(K, known[:, :, : d * n])
    through = (-step[:, :, None, None, None] * (b[:, None] * J.transpose(0, 1, 2, 3, 4))).reshape(B, N, n, d * n)
    condensed = np.matmul(through, eliminated) - known[:, :, d * n :]
    return residual, eliminated, condensed


def _solved(K: Array, known: Array) -> Array:
    """K^-1 known, stacked; NaN for a member one of whose intervals is singular."""
    try:
        return np.linalg.solve(K, known)
    except np.linalg.LinAlgError:
        out = np.full_like(known, np.nan)
        for b in range(len(K)):
            try:
                out[b] = np.linalg.solve(K[b], known[b])
            except np.linalg.LinAlgError:
                continue
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
