"""A solution on a mesh, and the same solution on another one.

The polynomials of every interval, and of nothing else, say what the solution is between its nodes: it is put on another
mesh by evaluating them there.  The nodes at which phases start and end are carried over as they are.

The last Legendre coefficient of each interval, in units of the state scale, tells how well its polynomial resolves what
it shows (`shape`).

Symbols: n states, d stages, N intervals, E elements, P phases.
"""

from __future__ import annotations

import numpy as np

from ..roots import LOOKED_AT
from .joints import flow_at, linear_in_time
from .scheme import equal_parts
from .transcription import Setting, Transcription, transcribe

Array = np.ndarray

SHORTEST_INTERVAL = 1e-13
"""Part of a phase below which an interval has no length in floating point, and is one with its neighbour."""
AS_GOOD_AS_ZERO = 1e-6
"""A state that is nowhere larger than this part of its scale is zero but for what a solver leaves: sizes follow an
orbit in steps, in none of which one shrinks by so much."""


def phase_breaks(t: Transcription, fractions: Array) -> list[Array]:
    """Interval boundaries of each collocated phase.

    fractions: (N,) interval lengths as fractions of their phase. Returns (N_k + 1,) for each phase, from 0 to 1.
    """
    return [breaks_of_phase(t, fractions, k) for k, count in enumerate(t.counts) if count]


def breaks_of_phase(t: Transcription, fractions: Array, phase: int) -> Array:
    """Interval boundaries of one collocated phase.

    t, fractions: as in `phase_breaks`. Returns (N_k + 1,) from 0 to 1.
    """
    edges = np.zeros(t.counts[phase] + 1)
    np.cumsum(fractions[t.phase_intervals(phase)], out=edges[1:])
    return edges / edges[-1]


def transfer(
    t: Transcription, u: Array, fractions: Array, breaks: list[Array], target: Transcription | None = None
) -> tuple[Transcription, Array, Array]:
    """Put a solution on another mesh by its own collocation polynomials.

    target: the transcription to use; default the one of the same cycle and scheme.
    Returns (transcription, u, fractions) on the new mesh.
    """
    counts, supply = [], iter(breaks)
    for count in t.counts:
        counts.append(next(supply).size - 1 if count else 0)
    new = target or transcribe(t.cycle, tuple(counts), t.degree, t.kind)
    old_w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)
    old_nodes = t.nodes_of(u)
    nodes = np.empty((new.elements + 1, new.n))
    nodes[new.closed_elements] = old_nodes[t.closed_elements]
    nodes[-1] = old_nodes[-1]
    places = []
    for first, old, fresh in zip(t.first_intervals, phase_breaks(t, fractions), breaks, strict=True):
        i, local = _places(old, (fresh[:-1, None] + np.diff(fresh)[:, None] * new.scheme.points).ravel())
        places.append((first + i, local))
    w = _at(t, old_w, places).reshape(new.intervals, new.degree + 1, new.n)
    nodes[new.interval_elements] = w[:, 0]
    # A phase starts where the one before it ended, exactly: interpolation must not move an event.
    nodes[new.phase_start] = old_nodes[t.phase_start]
    nodes[new.phase_end] = old_nodes[t.phase_end]
    u_new = new.pack(w.reshape(new.intervals, new.rows), nodes, t.durations_of(u))
    return new, u_new, np.concatenate([np.zeros(0), *(np.diff(b) for b in breaks)])


def on_halved_mesh(t: Transcription, u: Array, fractions: Array) -> tuple[Transcription, Array, Array]:
    """A solution with every interval cut in two: `divided` by one fixed matrix.  Or those of many members.

    u, fractions: (..., size), and (..., N) interval lengths as fractions of their phase.
    Returns transcription, unknowns and (..., 2 N) fractions of the finer mesh.
    """
    fine = transcribe(t.cycle, tuple(2 * count for count in t.counts), t.degree, t.kind)
    halves, lead = t.scheme.halves.reshape(-1, t.degree + 1), u.shape[:-1]
    w = halves @ t.intervals_of(u).reshape(*lead, t.intervals, t.degree + 1, t.n)
    w = w.reshape(*lead, fine.intervals, t.degree + 1, t.n)
    return fine, _packed(t, u, fine, w), np.repeat(fractions / 2, 2, axis=-1)


def divided(t: Transcription, u: Array, fractions: Array, parts: Array) -> tuple[Transcription, Array, Array]:
    """A solution with every interval cut in equal parts: `transfer` by fixed matrices.

    fractions: (N,) interval lengths as fractions of their phase; parts: (N,) how many parts each becomes.
    Returns transcription, unknowns and fractions of the finer mesh.
    """
    counts = tuple(int(parts[t.phase_intervals(k)].sum()) for k in range(t.phases))
    fine = transcribe(t.cycle, counts, t.degree, t.kind)
    first, old = np.cumsum(parts) - parts, t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)
    w = np.empty((fine.intervals, t.degree + 1, t.n))
    for count in set(parts.tolist()):
        members = np.flatnonzero(parts == count)
        w[first[members, None] + np.arange(count)] = np.einsum(
            "hkj,ijn->ihkn", equal_parts(t.degree, t.kind, count), old[members], optimize=False
        )
    return fine, _packed(t, u, fine, w), np.repeat(fractions / parts, parts)


def _packed(t: Transcription, u: Array, fine: Transcription, w: Array) -> Array:
    """Unknowns of a finer mesh from its intervals (..., N, d + 1, n), and from the nodes of the one that it refines.

    A phase starts where the one before it ended, exactly: interpolation must not move an event.
    """
    old, lead = t.nodes_of(u), u.shape[:-1]
    nodes = np.empty((*lead, fine.elements + 1, t.n))
    nodes[..., fine.inside, :] = w[..., 0, :]
    nodes[..., fine.closed_forms, :], nodes[..., -1, :] = old[..., t.closed_forms, :], old[..., -1, :]
    nodes[..., fine.phase_start, :] = old.take(t.phase_start, axis=-2)
    nodes[..., fine.phase_end, :] = old.take(t.phase_end, axis=-2)
    return fine.pack(w.reshape(*lead, fine.intervals, fine.rows), nodes, t.durations_of(u))


def _places(breaks: Array, times: Array) -> tuple[Array, Array]:
    """Interval of a phase, and local time in it, of each of the phase fractions `times`."""
    i = breaks[1:-1].searchsorted(times, side="right")
    return i, (times - breaks[i]) / (breaks[i + 1] - breaks[i])


def _at(t: Transcription, w: Array, places: list[tuple[Array, Array]]) -> Array:
    """(m, n) states at intervals and local times in them, from the intervals w (N, d + 1, n)."""
    if not places:
        return np.empty((0, t.n))
    i, local = (np.concatenate(parts) for parts in zip(*places, strict=True))
    return np.matmul(t.scheme.interpolation(local)[:, None], w[i])[:, 0]


def evaluate_phase(t: Transcription, u: Array, fractions: Array, phase: int, times: Array) -> Array:
    """States of a collocated phase.

    fractions: (N,) interval lengths as fractions of their phase; times: (m,) fractions of its duration.
    Returns (m, n), scaled.
    """
    breaks = breaks_of_phase(t, fractions, phase)
    w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)[t.phase_intervals(phase)]
    return _at(t, w, [_places(breaks, times)])


def apart(breaks: Array) -> Array:
    """Boundaries of a phase without those that leave an interval no length."""
    inside = breaks[1:-1]
    kept = (np.diff(breaks[:-1]) > SHORTEST_INTERVAL) & (breaks[-1] - inside > SHORTEST_INTERVAL)
    return breaks if kept.all() else np.concatenate([breaks[:1], inside[kept], breaks[-1:]])


def halved(breaks: list[Array]) -> list[Array]:
    """Boundaries with every interval cut in two."""
    return [apart(np.sort(np.concatenate([b, (b[1:] + b[:-1]) / 2]))) for b in breaks]


def quartered_where(t: Transcription, fractions: Array, where: Array) -> list[Array]:
    """Boundaries with some intervals cut in four.

    fractions: (N,) interval lengths as fractions of their phase; where: (N,) bool: the intervals.
    Returns boundaries of each collocated phase, from 0 to 1.
    """
    out = []
    for k, b in zip([k for k, c in enumerate(t.counts) if c], phase_breaks(t, fractions), strict=True):
        chosen = np.flatnonzero(where[t.phase_intervals(k)])
        inner = b[chosen, None] + np.diff(b)[chosen, None] * np.array([0.25, 0.5, 0.75])
        out.append(apart(np.sort(np.concatenate([b, inner.ravel()]))))
    return out


def sizes_of_states(t: Transcription, u: Array, setting: Setting) -> Array:
    """The largest magnitude of every state in a solution.

    Returns (n,) in the units of u, that is of setting.scale; 1 for a state that is zero all along, whose size nobody
    knows.
    """
    nodes = t.nodes_of(u)
    largest = np.abs(nodes).max(axis=0)
    if t.intervals:
        largest = np.maximum(largest, np.abs(t.intervals_of(u)).max(axis=0).reshape(-1, t.n).max(axis=0))
    for k, phase in enumerate(t.cycle.phases):
        if phase.mode.flow is not None and not linear_in_time(phase.mode, t.n, setting.p.size):
            times = float(t.durations_of(u)[k]) * LOOKED_AT
            inside = flow_at(phase.mode, nodes[t.phase_start[k]] * setting.scale, times, setting.p)
            largest = np.maximum(largest, np.abs(inside).max(axis=0) / setting.scale)
    return np.where(largest > AS_GOOD_AS_ZERO, largest, 1.0)


def shape(t: Transcription, u: Array) -> Array:
    """The last Legendre coefficient of every interval.

    Returns (N,) its absolute value, in units of the state scale.
    """
    w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)
    return np.abs(np.matmul(t.scheme.last_mode, w)).max(axis=1)
