"""Starting points for another phase sequence, from the unknowns of the one at hand or from a simulated motion.

The states of every phase are polynomials (start and stages of its intervals): a part of one can be taken at chosen
times, or the same unknowns read as those of another cycle with as many phases and intervals.

    from_segments   a marched motion (motion/phases.py) becomes the unknowns of a cycle
    in_scheme       the same motion in another collocation scheme
    relabelled      the same unknowns for another cycle
    piece           a part of a phase

Which sequence comes next, only the problem knows (hybrid/problem.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..collocation.mesh import breaks_of_phase, evaluate_phase, phase_breaks, sizes_of_states, transfer
from ..collocation.scheme import Kind
from ..collocation.transcription import Setting, Transcription, transcribe
from ..hybrid.system import Cycle
from ..motion.phases import Segment

Array = np.ndarray
Start = tuple[Transcription, Array, Setting]
"""Transcription, unknowns and setting: where a solve begins."""

Piece = tuple[Array, Array, float]
"""(breaks in 0..1, w (N, R), duration) of one phase, states scaled."""


def from_segments(
    cycle: Cycle, passes: Sequence[tuple[float, Segment]], p: Array, dp: Array, *, degree: int, kind: Kind
) -> Start:
    """Transcription, unknowns and setting of a marched motion.

    cycle: with as many phases as there are `passes`; passes: (factor, segment) of each phase: its states are `factor`
    times those of the segment.
    """
    n = len(cycle.states)
    counts, w, nodes, fractions, durations = [], [], [], [], []
    for (factor, segment), phase in zip(passes, cycle.phases, strict=True):
        collocated = phase.mode.flow is None
        counts.append(len(segment.w) if collocated else 0)
        durations.append(segment.duration)
        nodes.append(factor * segment.w[:, :n])
        if phase.reset is not None:
            nodes.append(factor * segment.end[None])
        if collocated:
            w.append(factor * segment.w)
            fractions.append(np.diff(segment.breaks))
    last, segment = passes[-1]
    nodes.append(last * segment.behind[None])
    t = transcribe(cycle, tuple(counts), degree, kind)
    all_w, all_nodes = np.vstack([np.zeros((0, t.rows)), *w]), np.vstack(nodes)
    scale = np.max(np.abs(np.vstack([all_nodes, all_w.reshape(-1, n)])), axis=0)
    scale[scale == 0] = 1.0
    u = t.pack(all_w / np.tile(scale, degree + 1), all_nodes / scale, np.array(durations))
    setting = Setting(np.concatenate([np.zeros(0), *fractions]), p, scale, dp)
    larger = np.maximum(sizes_of_states(t, u, setting), 1.0)  # in the middle of a closed form
    if (larger > 1.0).any():
        u = t.pack(all_w / np.tile(scale * larger, degree + 1), all_nodes / (scale * larger), np.array(durations))
        setting = replace(setting, scale=scale * larger)
    return t, u, setting


def in_scale(start: Start, scale: Array) -> Start:
    """The same starting point in units of another state scale.

    scale: (n,) the state scale.
    """
    t, u, setting = start
    factor = setting.scale / scale
    fresh = u.copy()
    w = t.intervals_of(fresh).reshape(-1, t.n)
    w *= factor
    fresh[t.node_index] = u[t.node_index] * factor
    return t, fresh, replace(setting, scale=scale)


def in_scheme(start: Start, degree: int, kind: Kind) -> Start:
    """The same starting point in another collocation scheme, its intervals cut where that has fewer stages."""
    t, u, setting = start
    if (degree, kind) == (t.degree, t.kind):
        return start
    parts = -(-t.degree // degree)
    breaks = []
    for b in phase_breaks(t, setting.fractions):
        inner = b[:-1, None] + np.diff(b)[:, None] * np.arange(parts) / parts
        breaks.append(np.append(inner, 1.0))
    target = transcribe(t.cycle, tuple(parts * count for count in t.counts), degree, kind)
    t, u, fractions = transfer(t, u, setting.fractions, breaks, target)
    return t, u, replace(setting, fractions=fractions)


def relabelled(cycle: Cycle, t: Transcription, u: Array, setting: Setting) -> Start:
    """The same unknowns for another cycle.

    cycle: with as many phases, collocated where those of `t` are.
    """
    return transcribe(cycle, t.counts, t.degree, t.kind), u, setting


def breaks_of(t: Transcription, setting: Setting, phase: int) -> Array:
    """Interval boundaries of one collocated phase.

    Returns (N + 1,) from 0 to 1.
    """
    return breaks_of_phase(t, setting.fractions, phase)


def piece(t: Transcription, u: Array, setting: Setting, phase: int, a: float = 0.0, b: float = 1.0) -> Piece:
    """A part of a collocated phase, from its own polynomials.

    a, b: ends of the part, as fractions of the phase.
    Returns breaks of the part in 0..1, start and stages (N, R) of its intervals, its duration [s].
    """
    breaks = breaks_of(t, setting, phase)
    inner = breaks[(breaks > a + 1e-3 * (b - a)) & (breaks < b - 1e-3 * (b - a))]
    if (a, b) == (0.0, 1.0) and inner.size == breaks.size - 2:  # all of it, as it stands
        w, duration = t.intervals_of(u)[t.phase_intervals(phase)], t.durations_of(u)[phase]
        return breaks, w.copy(), float(duration)
    part = np.concatenate([[a], inner, [b]])
    times = part[:-1, None] + np.diff(part)[:, None] * t.scheme.points
    w = evaluate_phase(t, u, setting.fractions, phase, times.ravel())
    duration = float((b - a) * t.durations_of(u)[phase])
    return (part - a) / (b - a), w.reshape(part.size - 1, -1), duration
