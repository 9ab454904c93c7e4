"""Solutions of one cycle, each on a mesh whose intervals are parts of those of its own, corrected in batches.

The intervals of all members stand one behind the other and are linearised in blocks, whoever they belong to; between
the nodes of the coarse meshes the unknowns are eliminated along the parts j = 1, 2, ... of an interval,

    dx_j = A_j dx_(j-1) + B_j dT + C_j dlambda + r_j    =    A^j dx_0 + B^j dT + C^j dlambda + r^j,

and what is left of every member is a node system that was factorised symbolically when its coarse mesh was solved: a
new mesh costs as much as a linearisation or two before anything is solved on it.

Symbols: B members, n states, d stages, P phases; of all members together N intervals and E elements of the coarse
meshes, M intervals and F elements of the fine ones, F + B nodes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from .. import effort
from ..hybrid.system import Field
from .elimination import Eliminated, elimination
from .joints import joint_map
from .mesh import divided
from .newton import DIVERGED, FORESEEN_STEP, LARGEST_MOVE, RESIDUAL_LIMIT, ROUNDED, STEP_TOLERANCE
from .scheme import equal_parts
from .transcription import Setting, Transcription

Array = np.ndarray

INTERVALS_AT_ONCE, ROUND_UP = 128, 8
"""Intervals of one call of what is compiled, and what a smaller number is rounded up to a multiple of: what is compiled
serves many numbers, and fits into the cache of a processor."""
STEPS = 4
"""Newton steps after which a member is left to `newton`, which says why it does not converge."""


@dataclass(frozen=True, eq=False)
class Member:
    """A solution and how its mesh is cut.

    Attributes
    ----------
    t, u, setting : transcription, unknowns, setting on its own mesh.
    parts : (N,) how many parts of each interval.
    border : border row of the node system of `t`, orthogonal to the correction.
    """

    t: Transcription
    u: Array
    setting: Setting
    parts: Array
    border: Array

    def place(self) -> tuple[Transcription, Array, Setting]:
        """The same solution on the mesh of the parts, not solved again."""
        t, u, fractions = divided(self.t, self.u, self.setting.fractions, self.parts)
        return t, u, replace(self.setting, fractions=fractions)


@dataclass(frozen=True, eq=False)
class Corrected:
    """A member that solves the equations on the mesh of its parts.

    Attributes
    ----------
    member : what it was.
    nodes, stages, durations, parameter : (F + 1, n), (M, d, n), (P,) and lambda on that mesh.
    maps, events, closure : the equations linearised there, as in a Linearisation.
    phase_start, phase_end : (P,) nodes of that mesh at which the phases start and end.
    """

    member: Member
    nodes: Array
    stages: Array
    durations: Array
    parameter: float
    maps: Array
    events: Array
    closure: Array
    phase_start: Array
    phase_end: Array

    def place(self) -> tuple[Transcription, Array, Setting]:
        """Transcription, unknowns and setting on the mesh of the parts."""
        t, _, setting = self.member.place()
        w = np.concatenate([self.nodes[t.interval_elements][:, None], self.stages], axis=1)
        u = t.pack(w.reshape(t.intervals, t.rows), self.nodes, self.durations)
        return t, u, setting.moved(self.parameter)


@dataclass
class _State:
    """Nodes (F + B, n), stages (M, d, n), durations (B P,), lambda (B,)."""

    X: Array
    Z: Array
    T: Array
    lam: Array


@dataclass(frozen=True, eq=False)
class _Linear:
    """As a Linearisation, of all members: maps (F, n, n + 3), eliminated (M, n d, n + 3), residual norms (B,)."""

    maps: Array
    eliminated: Array
    events: list[Array]
    closures: list[Array]
    closure_residuals: list[Array]
    residuals: Array


class _Rows:
    """Which rows of the arrays belong to whom."""

    def __init__(self, members: Sequence[Member]) -> None:
        t, B = members[0].t, len(members)
        self.members, self.n, self.P = members, t.n, t.phases
        sizes = np.array([m.t.elements for m in members])
        self.coarse = np.cumsum(sizes) - sizes
        """(B,) the first of the coarse elements of every member."""
        is_interval = np.concatenate([np.isin(np.arange(m.t.elements), m.t.interval_elements) for m in members])
        counts = np.ones(is_interval.size, dtype=int)
        self.parts = np.concatenate([m.parts for m in members])
        counts[is_interval] = self.parts
        self.last = np.cumsum(counts) - 1
        """(E,) the last part of every coarse element."""
        first = self.last - counts + 1
        self.later = [first[counts > j] + j for j in range(1, int(counts.max()))]
        """The second parts, the third ones, and so on."""
        self.whole = np.repeat(np.arange(counts.size), counts)
        """(F,) the coarse element of every element."""
        owner = np.repeat(np.arange(B), sizes)
        self.owner, phase_of = owner[self.whole], owner * self.P + np.concatenate([m.t.phase_of for m in members])
        self.phase, self.start = phase_of[self.whole], np.arange(self.whole.size) + self.owner
        """(F,) phase and start node of every element, numbered through all members."""
        self.intervals = np.flatnonzero(is_interval[self.whole])
        self.closed = np.flatnonzero(~is_interval[self.whole])
        """(M,) the elements that are intervals, and those that are closed forms."""
        self.elements = np.bincount(self.owner, minlength=B)
        self.element = np.cumsum(self.elements) - self.elements
        self.counted = np.bincount(self.owner[self.intervals], minlength=B)
        self.interval = np.cumsum(self.counted) - self.counted
        """(B,) numbers of elements and of intervals of every member, and the first of each."""
        begins, ends = (np.array([getattr(m.t, name) for m in members]) for name in ("phase_start", "phase_end"))
        of = np.arange(B)[:, None]
        self.phase_start = (first[begins + self.coarse[:, None]] + of).ravel()
        self.phase_end = (self.last[ends + self.coarse[:, None] - 1] + 1 + of).ravel()
        """(B P,) nodes at which the phases start and end."""
        self._numbers()

    def _numbers(self) -> None:
        """What is not unknown: signs and lengths of the intervals (M,), parameters and scales of the members (B, .)."""
        members, modes = self.members, [phase.mode for phase in self.members[0].t.cycle.phases]
        mode_of, fields = self.phase[self.intervals] % self.P, {mode.field: None for mode in modes}
        of = np.array([list(fields).index(mode.field) for mode in modes])[mode_of]
        self.groups = [(field, np.flatnonzero(of == i)) for i, field in enumerate(fields) if (of == i).any()]
        self.signs = np.array([mode.sign for mode in modes])[mode_of]
        self.fractions = np.repeat(np.concatenate([m.setting.fractions for m in members]) / self.parts, self.parts)
        self.p, self.dp, self.scale = (
            np.array([getattr(m.setting, name) for m in members]) for name in ("p", "dp", "scale")
        )

    def begun(self) -> _State:
        """The members on the meshes of their parts, by interpolation; phases start where those before them ended."""
        t, first = self.members[0].t, np.cumsum(self.parts) - self.parts
        old = np.concatenate([m.t.intervals_of(m.u) for m in self.members]).reshape(-1, t.degree + 1, self.n)
        w = np.empty((self.intervals.size, t.degree + 1, self.n))
        for count in set(self.parts.tolist()):
            cut = np.flatnonzero(self.parts == count)
            matrix = equal_parts(t.degree, t.kind, count).reshape(-1, t.degree + 1)
            w[first[cut, None] + np.arange(count)] = (matrix @ old[cut]).reshape(cut.size, count, -1, self.n)
        X = np.empty((self.whole.size + len(self.members), self.n))
        X[self.start[self.intervals]] = w[:, 0]
        for b, m in enumerate(self.members):
            nodes, phases = m.t.nodes_of(m.u), self.phases_of(b)
            X[self.start[self._closed_of(b)]] = nodes[m.t.closed_elements]
            X[self.phase_start[phases]], X[self.phase_end[phases]] = nodes[m.t.phase_start], nodes[m.t.phase_end]
            X[self.nodes_of(b).stop - 1] = nodes[-1]
        T = np.concatenate([m.t.durations_of(m.u) for m in self.members])
        return _State(X, np.ascontiguousarray(w[:, 1:]), T, np.zeros(len(self.members)))

    def phases_of(self, b: int) -> slice:
        """Which of the phases are a member's."""
        return slice(b * self.P, (b + 1) * self.P)

    def _closed_of(self, b: int) -> Array:
        """The elements of a member that are closed forms."""
        each = self.members[0].t.closed
        return self.closed[b * each : (b + 1) * each]

    def nodes_of(self, b: int) -> slice:
        """Which of the nodes are a member's."""
        return slice(self.element[b] + b, self.element[b] + b + self.elements[b] + 1)

    def linearised(self, at: _State) -> _Linear:
        """The equations of all members.

        Raises numpy.linalg.LinAlgError: the stages of an interval cannot be eliminated.
        """
        n, start = self.n, self.start[self.intervals]
        owner, p = self.owner[self.intervals], self.p + at.lam[:, None] * self.dp
        w = np.concatenate([at.X[start][:, None], at.Z], axis=1).reshape(start.size, -1)
        rows = (w, at.X[start + 1], at.T[self.phase[self.intervals]], self.fractions, self.signs,
                p[owner], self.dp[owner], self.scale[owner])  # fmt: skip
        maps, stages = np.empty((self.whole.size, n, n + 3)), np.empty((start.size, w.shape[1] - n, n + 3))
        left = np.empty(start.size)
        for field, chosen in self.groups:
            for first in range(0, chosen.size, INTERVALS_AT_ONCE):
                i = chosen[first : first + INTERVALS_AT_ONCE]
                found = self._eliminated(field, [row[i] for row in rows])
                maps[self.intervals[i]], stages[i] = found.maps[: i.size], found.stages[: i.size]
                left[i] = np.abs(found.residual[: i.size]).max(axis=1)
        residuals = np.maximum.reduceat(left, self.interval)
        events, closures, closed = [], [], []
        for b, m in enumerate(self.members):
            effort.problem(int(self.counted[b]))
            ends, e, scale, X = self.phases_of(b), self._closed_of(b), self.scale[b], at.X[self.nodes_of(b)]
            states, behind = at.X[self.start[e]], at.X[self.phase_end[ends]]
            joints = joint_map(m.t.cycle)(states, behind, at.T[ends], p[b], self.dp[b], scale)
            flow = at.X[self.start[e] + 1] - joints.flow[:, 0]
            maps[e, :, 0], maps[e, :, 1:] = -flow, joints.flow[:, 1:].transpose(0, 2, 1)
            closures.append(m.t.cycle.closure * (scale[None, :] / scale[:, None]))
            closed.append(X[0] - closures[b] @ X[-1] + m.t.shift / scale)
            events.append(joints.events)
            others = (np.abs(part).max(initial=0.0) for part in (flow, closed[b], joints.events[0]))
            residuals[b] = np.max([residuals[b], *others])
        return _Linear(maps, stages, events, closures, closed, residuals)

    def _eliminated(self, field: Field, rows: list[Array]) -> Eliminated:
        """Some intervals, stages eliminated; the last one again and again behind them."""
        t, count = self.members[0].t, len(rows[0])
        size = -(-count // ROUND_UP) * ROUND_UP
        filled = rows if size == count else [row[np.minimum(np.arange(size), count - 1)] for row in rows]
        return elimination(field, self.n, len(t.cycle.parameters), t.degree, t.kind, size)(*filled)

    def step(self, lin: _Linear) -> _State:
        """The Newton step of every member under its border row."""
        n, B = self.n, len(self.members)
        carried = lin.maps.copy()
        for e in self.later:
            through = lin.maps[e, :, 1 : n + 1] @ carried[e - 1]
            through[:, :, 0] += lin.maps[e, :, 0]
            through[:, :, n + 1 :] += lin.maps[e, :, n + 1 :]
            carried[e] = through
        joined = carried[self.last]
        known, dX = np.ones((self.last.size, n + 3, 1)), np.empty((self.whole.size + B, n))
        dT, dlam = np.empty(B * self.P), np.empty(B)
        for b, m in enumerate(self.members):
            own = slice(self.coarse[b], self.coarse[b] + m.t.elements)
            maps, E = joined[own], m.t.elements
            matrix = m.t.system.nonzeros(maps, lin.closures[b], lin.events[b], m.border)
            rhs = np.concatenate([maps[:, :, 0].ravel(), -lin.closure_residuals[b], -lin.events[b][0], [0.0]])
            y = m.t.system.solve(matrix, rhs)
            dT[self.phases_of(b)], dlam[b] = y[(E + 1) * n : -1], y[-1]
            known[own, 1 : n + 1, 0] = y[: E * n].reshape(E, n)
            known[own, n + 1, 0] = dT[b * self.P + m.t.phase_of]
            known[own, n + 2] = y[-1]
            dX[self.element[b] + b] = y[:n]
        dX[self.start + 1] = (carried @ known[self.whole])[:, :, 0]
        inside = known[self.whole[self.intervals]]
        inside[:, 1 : n + 1, 0] = dX[self.start[self.intervals]]
        dZ = -(lin.eliminated @ inside).reshape(len(inside), -1, n)
        return _State(dX, dZ, dT, dlam)

    def sizes(self, at: _State, by: _State) -> Array:
        """(B,) how large steps are: states as they are (scaled), durations relative; not a number where one is not."""
        node = self.element + np.arange(len(self.members))
        of_nodes = np.maximum.reduceat(np.abs(by.X).max(axis=1), node)
        inside = np.maximum.reduceat(np.abs(by.Z).max(axis=(1, 2)), self.interval)
        durations = (np.abs(by.T) / np.maximum(np.abs(at.T), 1e-300)).reshape(-1, self.P).max(axis=1)
        return np.maximum(np.maximum(of_nodes, inside), durations)

    def one(self, b: int, at: _State, lin: _Linear) -> Corrected:
        """A member by itself."""
        own, phases = self.nodes_of(b), self.phases_of(b)
        elements = slice(self.element[b], self.element[b] + self.elements[b])
        stages = at.Z[self.interval[b] : self.interval[b] + self.counted[b]]
        return Corrected(
            self.members[b], at.X[own], stages, at.T[phases], float(at.lam[b]), lin.maps[elements], lin.events[b],
            lin.closures[b], self.phase_start[phases] - own.start, self.phase_end[phases] - own.start,
        )  # fmt: skip

    def kept(self, at: _State, keep: Array) -> tuple[_Rows, _State]:
        """Some of the members (B,) bool, and where they are."""
        rows = _Rows([m for m, kept in zip(self.members, keep.tolist(), strict=True) if kept])
        nodes = np.repeat(keep, self.elements + 1)
        inside, phases = keep[self.owner[self.intervals]], np.repeat(keep, self.P)
        return rows, _State(at.X[nodes], at.Z[inside], at.T[phases], at.lam[keep])


def solve_batch(members: Sequence[Member], accuracy: float) -> list[Corrected | None]:
    """Solutions on the meshes of their parts, by Newton's method.

    members: solutions of one cycle in one scheme, with their parts; accuracy: a point whose Newton step is no larger
    than this is a solution as it stands.
    Returns as many; None for a member that did not get there in a few steps, for whatever reason.
    """
    found: list[Corrected | None] = [None] * len(members)
    able = [k for k, m in enumerate(members) if m.t.intervals]
    if not able:
        return found
    rows = _Rows([members[k] for k in able])
    at, here = rows.begun(), np.array(able)
    begun, last, arrived = at.X.copy(), np.full(here.size, np.inf), np.zeros(here.size, dtype=bool)
    for _ in range(STEPS):
        try:
            with np.errstate(all="ignore"):
                lin = rows.linearised(at)
        except np.linalg.LinAlgError:
            return found
        small = lin.residuals <= RESIDUAL_LIMIT
        if (arrived & small).all():
            by, size, done = None, np.zeros(here.size), arrived
        else:
            with np.errstate(all="ignore"):
                by = rows.step(lin)
                size = rows.sizes(at, by)
            done = np.maximum(size, np.abs(by.lam)) <= min(accuracy, ROUNDED)
            done |= arrived & (small | (size <= ROUNDED))
        for b in np.flatnonzero(done).tolist():
            if _is_solution(at, rows, b, begun[rows.nodes_of(b)]):
                found[here[b]] = rows.one(b, at, lin)
        keep = ~done & (size <= DIVERGED)
        if by is None or not keep.any():
            return found
        at = _State(at.X + by.X, at.Z + by.Z, at.T + by.T, at.lam + by.lam)
        keep &= (at.T.reshape(-1, rows.P) > 0).all(axis=1)
        with np.errstate(all="ignore"):
            arrived = (size <= STEP_TOLERANCE) | (np.isfinite(last) & (size * (size / last) <= FORESEEN_STEP))
        if not keep.all():
            if not keep.any():
                return found
            begun = begun[np.repeat(keep, rows.elements + 1)]
            rows, at = rows.kept(at, keep)
            here, size, arrived = here[keep], size[keep], arrived[keep]
        last = size
    return found


def _is_solution(at: _State, rows: _Rows, b: int, begun: Array) -> bool:
    """Whether the durations of a member are positive and it lies close to where its nodes were when it began."""
    return bool((at.T[rows.phases_of(b)] > 0).all() and np.abs(at.X[rows.nodes_of(b)] - begun).max() <= LARGEST_MOVE)
