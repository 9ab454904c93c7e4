"""A cycle on a mesh as a square system of equations, its Jacobian, and the named layout of the unknowns.

The pieces of the chain, in time order, are E elements: the N intervals of the collocated phases and the M closed forms
(one element each), which are phases in closed form and jumps at the ends of phases.  Element e leads from node e to
node e + 1.  Unknowns, all states divided by the scale D:

    u = [ w_1 | ... | w_N | v_1 | ... | v_M | x_end | T_1 ... T_P ]
          |                 |             |       durations [s]
          |                 |             last node
          |                 start nodes of the closed forms
          (x, X_1, ..., X_d): start node and stages of one interval, R = n (d + 1) numbers

Equations, in this order: the R rows of each interval (interval.py), the n rows x+ - flow(v) of each
closed form (joints.py), the n rows x_0 - S x_E + c of the closure, the P events.

Eliminating the stages of an interval gives its end-to-start map, the sensitivity of the implicit
Runge-Kutta integrator that collocation is; what is left is the node system (E = 4 drawn, phases 1 | 2):

      x_0  x_1  x_2  x_3  x_4 |  T_1 T_2 | lambda
    [ -A    I                 |  -B      |  -C   ]   r
    [      -A    I            |  -B      |  -C   ]   r        A = d x+/d x,  B = d x+/d T,
    [           -A    I       |      -B  |  -C   ]   r        C = d x+/d lambda
    [                -A    I  |      -B  |  -C   ]   r
    [  I                  -S  |          |       ]   closure
    [            h            |   h      |   h   ]   event of phase 1
    [                      h  |       h  |   h   ]   event of phase 2
    [  c         c         c  |   c   c  |   c   ]   border

lambda moves p along dp.  The border row fixes lambda, or measures arclength, or anything else that is a
linear function of the phase-end nodes, the durations and lambda.

Symbols: n states, d stages, R = n (d + 1), N intervals, M closed forms, E = N + M elements,
P phases, y = (E + 1) n + P + 1 unknowns of the node system.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from .. import effort
from ..compiled import kept
from ..hybrid.system import Cycle, Field, VectorMode
from .elimination import Eliminated, elimination
from .ensemble_points import eliminate_many, fields_at
from .interval import points_map
from .joints import Joints, joint_map
from .node_system import Linearisation, NodeSystem, node_system
from .scheme import Kind, scheme

Array = np.ndarray


JOINTS_TOGETHER = 16
"""Members of a mapped call for closed forms and events."""


@dataclass(frozen=True)
class Setting:
    """The numbers of one solve that are not unknowns, or of B solves, whose axis comes first.

    Attributes
    ----------
    fractions : (..., N) interval lengths as fractions of their phase, phase after phase.
    p : (..., np) parameter vector.
    scale : (..., n) state scale D.
    dp : (..., np) direction in parameter space that lambda moves along (zero where lambda is not used).
    others : (B, m - 1, np) more directions, of many solves, for the derivatives by them.
    """

    fractions: Array
    p: Array
    scale: Array
    dp: Array
    others: Array | None = None

    @property
    def directions(self) -> Array:
        """(B, m, np) all directions of many solves; the first one is that of lambda."""
        own = self.dp[:, None]
        return own if self.others is None else np.concatenate([own, self.others], axis=1)

    def moved(self, step: float | Array) -> Setting:
        """The setting at lambda = `step`, of every member its own."""
        way = step if self.p.ndim == 1 else np.asarray(step)[:, None]
        return Setting(self.fractions, self.p + way * self.dp, self.scale, self.dp, self.others)

    def of(self, members: Array | int) -> Setting:
        """That of some members, or of one."""
        others = None if self.others is None or np.ndim(members) == 0 else self.others[members]
        return Setting(self.fractions[members], self.p[members], self.scale[members], self.dp[members], others)


def settings_of(setting: Setting, p: Array, dp: Array) -> Setting:
    """That of members that share mesh and scale, with parameters p (B, np) and directions dp (B, np) of their own."""
    fractions, scale = (np.repeat(each[None], len(p), axis=0) for each in (setting.fractions, setting.scale))
    return Setting(fractions, np.array(p), scale, np.array(dp))


class Transcription:
    """Cycle + numbers of intervals + scheme -> residual, Jacobian and layout.

    Parameters
    ----------
    cycle
        the cycle.
    counts
        intervals of each phase; 0 for a closed-form phase.
    degree, kind
        collocation scheme.
    """

    def __init__(self, cycle: Cycle, counts: tuple[int, ...], degree: int, kind: Kind) -> None:
        for phase, count in zip(cycle.phases, counts, strict=True):
            if (phase.mode.flow is None) != (count > 0):
                raise ValueError(f"phase {phase.mode.name!r}: {count} intervals do not fit its mode")
        self.cycle, self.counts, self.degree, self.kind = cycle, counts, degree, kind
        self.scheme = scheme(degree, kind)
        n = self.n = len(cycle.states)
        self.rows = n * (degree + 1)
        self.intervals = sum(counts)
        jumps = sum(phase.reset is not None for phase in cycle.phases)
        self.closed = sum(count == 0 for count in counts) + jumps
        self.phases = len(counts)
        self.elements = self.intervals + self.closed
        self._index_chain()
        self.size = self.intervals * self.rows + (self.closed + 1) * n + self.phases
        self.shift = np.array(cycle.shift) if cycle.shift else np.zeros(n)
        """(n,) the shift c of the closure."""
        self._system: NodeSystem | None = None
        self._joints = joint_map(cycle)

    def _key(self) -> tuple[Cycle, tuple[int, ...], int, str]:
        return self.cycle, self.counts, self.degree, self.kind

    def __hash__(self) -> int:
        return hash(self._key())

    def __eq__(self, other: object) -> bool:
        """Equal ones are interchangeable: an IPOPT solver built for one serves the other."""
        return isinstance(other, Transcription) and self._key() == other._key()

    @property
    def system(self) -> NodeSystem:
        """What is left when the stages are eliminated; made when first solved."""
        if self._system is None:  # no cached_property, which locks in Python 3.11: see compiled.alone
            closure = self.cycle.closure.tobytes()
            self._system = node_system(self.elements, self.n, tuple(self.phase_of), tuple(self.phase_end), closure)
        return self._system

    def _index_chain(self) -> None:
        n, phase_of, is_interval, phase_start, phase_end, signs = self.n, [], [], [], [], []
        start: list[Array] = []
        fields: dict[Field, list[Array]] = {}
        modes: dict[VectorMode, list[Array]] = {}
        elements, intervals, v = 0, 0, self.intervals * self.rows
        for k, (phase, count) in enumerate(zip(self.cycle.phases, self.counts, strict=True)):
            phase_start.append(elements)
            elements += max(count, 1)
            phase_end.append(elements)
            if count:
                members = np.arange(intervals, intervals + count)
                intervals += count
                start.append(members * self.rows)
                signs.append(np.full(count, phase.mode.sign))
                fields.setdefault(phase.mode.field, []).append(members)
                modes.setdefault(phase.mode, []).append(members)
            alone = int(count == 0) + int(phase.reset is not None)  # elements that are no intervals
            start.append(v + n * np.arange(alone))
            v += n * alone
            elements = phase_end[-1] + int(phase.reset is not None)
            is_interval.append(np.repeat([True, False], [count, alone]))
            phase_of.append(np.full(count + alone, k))
        start.append(np.array([v]))
        self.node_index = np.concatenate(start)[:, None] + np.arange(n)
        """(E + 1, n): where the nodes of the chain stand in u."""
        self.phase_of = np.concatenate(phase_of)
        """(E,) phase of each element."""
        self.phase_start, self.phase_end = np.array(phase_start), np.array(phase_end)
        """(P,) node at which each phase starts, and at which it ends: where its event is."""
        self.phase_ends = np.concatenate([[0], self.phase_end])
        """(P + 1,) the first node and those at which the phases end."""
        collocated = np.concatenate(is_interval)
        self.interval_elements, self.closed_elements = np.flatnonzero(collocated), np.flatnonzero(~collocated)
        self.inside, self.closed_forms = _together(self.interval_elements), _together(self.closed_elements)
        self.behind_intervals = _together(self.interval_elements + 1)
        """The elements that are intervals, those that are closed forms, and the nodes behind the intervals."""
        self.phase_of_intervals = self.phase_of[self.interval_elements]
        of_phases = [phase.mode for phase in self.cycle.phases]
        self.smooth = np.array([mode.smooth for mode in of_phases])[self.phase_of_intervals]
        self.low_order = np.array([mode.stiff for mode in of_phases])[self.phase_of_intervals] | ~self.smooth
        """(N,) whether the field has no kink there, and whether stiffness or kinks may take the schemes their order."""
        self.signs = np.concatenate([np.zeros(0, dtype=int), *signs])
        """(N,) phase, and number of the mode, of each interval."""
        self.groups = [(field, np.concatenate(members)) for field, members in fields.items()]
        self.modes = [(mode, np.concatenate(members)) for mode, members in modes.items()]
        """The modes that are collocated, each with its intervals."""
        self.collocated_counts = np.array([count for count in self.counts if count], dtype=int)
        self.first_intervals = np.cumsum(self.collocated_counts) - self.collocated_counts
        """Of the phases that are collocated: their numbers of intervals, and the first of these."""

    # Layout ------------------------------------------------------------------------------------------

    def intervals_of(self, u: Array) -> Array:
        """(..., N, R) view of the interval unknowns w."""
        return u[..., : self.intervals * self.rows].reshape(*u.shape[:-1], self.intervals, self.rows)

    def nodes_of(self, u: Array) -> Array:
        """(..., E + 1, n) copy of the node states."""
        return u.take(self.node_index, axis=-1)

    def durations_of(self, u: Array) -> Array:
        """(..., P) view of the phase durations [s]."""
        return u[..., -self.phases :]

    def phase_intervals(self, k: int) -> slice:
        """Which of the N intervals belong to phase k."""
        first = sum(self.counts[:k])
        return slice(first, first + self.counts[k])

    def pack(self, w: Array, nodes: Array, durations: Array) -> Array:
        """The unknowns from their parts.

        w: (..., N, R) start and stages of the intervals; nodes: (..., E + 1, n); they win over the start nodes inside
        `w`; durations: (..., P) [s]. Returns (..., size) u.
        """
        u = np.empty((*nodes.shape[:-2], self.size))
        self.intervals_of(u)[:] = w
        u[..., self.node_index] = nodes
        self.durations_of(u)[:] = durations
        return u

    # Equations ---------------------------------------------------------------------------------------

    def joints(self, nodes: Array, T: Array, setting: Setting) -> Joints:
        """The joints at the nodes (..., E + 1, n) and with durations (..., P); by all directions of many solves."""
        states, ends = nodes[..., self.closed_forms, :], nodes.take(self.phase_end, axis=-2)
        p, dp, scale = setting.p, setting.dp, setting.scale
        if T.ndim == 1:
            return self._joints(states, ends, T, p, dp, scale)
        at = joint_map(self.cycle, JOINTS_TOGETHER)
        found = [at(states, ends, T, p, setting.directions[:, k], scale) for k in range(setting.directions.shape[1])]
        flows, events = ([getattr(one, name) for one in found] for name in ("flow", "events"))
        known = self.n + 2  # the columns that are the same for all directions
        return Joints(
            np.concatenate([flows[0], *(more[:, :, known:] for more in flows[1:])], axis=2),
            np.concatenate([events[0], *(more[:, known:] for more in events[1:])], axis=1),
        )

    def linearise(self, u: Array, setting: Setting, *, counted: bool = True) -> Linearisation:
        """Residual and condensed Jacobian, of one member or of many.

        u: (..., size), with settings to match; counted: as work (effort.py); False where whoever keeps it counts it at
        every reading.
        Returns linearisation; not finite where the iterate is wild.
        """
        if counted:
            effort.problem(self.intervals * (1 if u.ndim == 1 else len(u)))
        with np.errstate(all="ignore"):  # a wild iterate may overflow; `Linearisation.finite` tells
            nodes, T, scale = self.nodes_of(u), self.durations_of(u), setting.scale
            intervals, joints = self._eliminated(u, nodes, T, setting), self.joints(nodes, T, setting)
            maps = np.empty((*nodes.shape[:-2], self.elements, self.n, intervals.maps.shape[-1]))
            maps[..., self.inside, :, :] = intervals.maps
            flow_residual = nodes.take(self.closed_elements + 1, axis=-2) - joints.flow[..., 0, :]
            if self.closed:
                maps[..., self.closed_forms, :, :] = joints.flow.swapaxes(-1, -2)
                maps[..., self.closed_forms, :, :1] = -flow_residual[..., None]
            closure = self.cycle.closure * (scale[..., None, :] / scale[..., :, None])
            back = (closure @ nodes[..., -1, :, None])[..., 0]
            return Linearisation(
                transcription=self,
                interval_residual=intervals.residual,
                flow_residual=flow_residual,
                closure_residual=nodes[..., 0, :] - back + self.shift / scale,
                events=joints.events,
                maps=maps,
                closure=closure,
                eliminated=intervals.stages,
            )

    def responses(self, u: Array, setting: Setting, along: Array) -> Array:
        """(k, size) how all unknowns of one solution move along directions of p (k, np), k > 0: by one Jacobian."""
        setting = Setting(setting.fractions[None], setting.p[None], setting.scale[None], along[:1], along[None, 1:])
        lin = self.linearise(u[None], setting)
        rhs = np.stack([lin.rhs(direction=i) for i in range(len(along))], axis=1)
        y = self.system.solve(lin.matrix(self.system.border(parameter=1.0)[None]), rhs)
        return np.array([lin.expand(y[:, i], 0.0, i, 1.0)[0] for i in range(len(along))])

    def residual_norm(self, u: Array, setting: Setting) -> float:
        """What is left of the equations, without their Jacobian.

        Returns the largest, in scaled units, as `Linearisation.residual_norm`; NaN where anything is NaN.
        """
        with np.errstate(all="ignore"):
            return float(np.max([np.abs(part).max(initial=0.0) for part in self._residuals(u, setting)]))

    def _residuals(self, u: Array, setting: Setting) -> Iterator[Array]:
        nodes, T = self.nodes_of(u), self.durations_of(u)
        w = self.intervals_of(u).reshape(self.intervals, self.degree + 1, self.n)
        step = setting.fractions * T.take(self.phase_of_intervals)
        ends = np.concatenate([w[:, 1:], nodes.take(self.interval_elements + 1, axis=0)[:, None]], axis=1)
        yield ends - w[:, :1] - step[:, None, None] * (self.scheme.sums @ self.fields(w[:, 1:], setting))
        joints = self.joints(nodes, T, setting)
        yield nodes[self.closed_elements + 1] - joints.flow[:, 0]
        yield joints.events[0]
        closure = self.cycle.closure * (setting.scale[None, :] / setting.scale[:, None])
        yield nodes[0] - closure @ nodes[-1] + self.shift / setting.scale

    def fields(self, x: Array, setting: Setting) -> Array:
        """The scaled field at points (..., N, k, n) of all intervals."""
        p, scale, of = setting.p, setting.scale, self._fields_of_one if x.ndim == 3 else fields_at
        if len(self.groups) == 1:
            return of(self.groups[0][0], x, self.signs, p, scale)
        out = np.empty_like(x)
        for field, i in self.groups:
            out[..., i, :, :] = of(field, x.take(i, axis=-3), self.signs[i], p, scale)
        return out

    def _fields_of_one(self, field: Field, x: Array, signs: Array, p: Array, scale: Array) -> Array:
        """The scaled field at points (N, k, n) of some intervals of one member."""
        return points_map(field, self.n, p.size, x.shape[1], signs.size)(x, signs, p, scale)

    def _eliminated(self, u: Array, nodes: Array, T: Array, setting: Setting) -> Eliminated:
        """The stages of all intervals, those of one vector field together; of many members over arrays."""
        w, x_next = self.intervals_of(u), nodes[..., self.behind_intervals, :]
        rows = w, x_next, T.take(self.phase_of_intervals, axis=-1), setting.fractions
        of = self._of_one if u.ndim == 1 else self._of_many
        if len(self.groups) == 1:
            return of(self.groups[0][0], self.signs, rows, setting)
        n, d, lead = self.n, self.degree, u.shape[:-1]
        c = n + 3 if u.ndim == 1 else n + 2 + setting.directions.shape[1]
        whole = Eliminated(*(np.empty((*lead, self.intervals, *shape)) for shape in ((self.rows,), (n * d, c), (n, c))))
        for field, i in self.groups:
            part = of(field, self.signs[i], tuple(row.take(i, axis=len(lead)) for row in rows), setting)
            for out, found in zip(
                (whole.residual, whole.stages, whole.maps), (part.residual, part.stages, part.maps), strict=True
            ):
                out[(slice(None),) * len(lead) + (i,)] = found
        return whole

    def _of_one(self, field: Field, signs: Array, rows: tuple[Array, ...], s: Setting) -> Eliminated:
        """Some intervals of one member: (N, R), (N, n), (N,), (N,)."""
        count, parameters = signs.size, len(self.cycle.parameters)
        w, x_next, duration, h = rows
        eliminate = elimination(field, self.n, parameters, self.degree, self.kind, count)
        return eliminate(w, x_next, duration, h, signs, s.p, s.dp, s.scale)

    def _of_many(self, field: Field, signs: Array, rows: tuple[Array, ...], s: Setting) -> Eliminated:
        """Some intervals of many members: (B, N, R), (B, N, n), (B, N), (B, N)."""
        w, *others = rows
        w = w.reshape(len(w), signs.size, self.degree + 1, self.n)
        return eliminate_many(field, self.kind, signs, (w, *others), (s.p, s.directions, s.scale))


def _together(indices: Array) -> Array | slice:
    """Indices that follow each other as a slice, which is quicker."""
    if indices.size and not (np.diff(indices) == 1).all():
        return indices
    return slice(int(indices[0]), int(indices[-1]) + 1) if indices.size else slice(0, 0)


@kept(maxsize=48)
def transcribe(cycle: Cycle, counts: tuple[int, ...], degree: int, kind: Kind) -> Transcription:
    """The transcription of a cycle: built once, kept for reuse.

    counts: intervals of each phase; 0 for a closed-form phase.
    """
    return Transcription(cycle, counts, degree, kind)
