"""Intervals whose halves do not tell their error, cut in four.

An interval's map from its start to its end, stages eliminated, is known better from parts of it,

    x+ = r + A x + B dT + C dlambda      from one part to the next,      r = r_2 + A_2 r_1,  A = A_2 A_1,  and so on,

and the residual r of the parts is what the interval contributes to the error (error_estimate.py).  Two parts suffice
where the solution is smooth.  In stiff modes, and where the field has kinks, something may happen within a part of an
interval that its halves hardly see: there they say 3e-7, and four, eight and thirty-two parts say 1.2e-6.  It is a few
intervals of a mesh that matter, so these are cut in four; what changes then tells how far the halves could be accepted.

Symbols: m intervals, n states, d stages, R = n (d + 1), c = n + 3 columns of [r | A | B | C], or more of C.
"""

from __future__ import annotations

import numpy as np

from .ensemble_points import eliminate_many
from .transcription import Setting, Transcription

Array = np.ndarray

QUARTERS = 4


def chained(maps: Array) -> Array:
    """The maps over all parts of intervals from those over each, the nodes between them eliminated.

    maps: (..., parts, n, c) of [r | A | B | C]. Returns (..., n, c).
    """
    n, through = maps.shape[-2], maps[..., 0, :, :]
    for k in range(1, maps.shape[-3]):
        part, before = maps[..., k, :, :], through
        through = np.matmul(part[..., 1 : n + 1], before)
        through[..., 0] += part[..., 0]
        through[..., n + 1 :] += part[..., n + 1 :]
    return through


def maps_over_quarters(fine: Transcription, u: Array, s: Setting, members: Array, chosen: Array) -> Array:
    """The maps over some intervals of some members, from four parts of each.

    fine, u, s: transcription, (B, size) unknowns and settings of the mesh with halved intervals; members, chosen: (m,)
    whose, and which intervals before they were halved. Returns (m, n, c).
    """
    first = 2 * chosen
    halves = fine.intervals_of(u).reshape(len(u), -1, 2, fine.rows)[members, chosen]
    behind = u[members[:, None], fine.node_index[fine.interval_elements[first + 1] + 1]]
    w, following = quarters(fine, halves, behind)
    duration = u[members, -fine.phases + fine.phase_of[fine.interval_elements[first]], None]
    rows = w, following, np.repeat(duration, QUARTERS, 1), np.repeat(s.fractions[members, first, None] / 2, QUARTERS, 1)
    numbers = s.p[members], s.directions[members], s.scale[members]
    out = np.empty((chosen.size, fine.n, fine.n + 2 + s.directions.shape[1]))
    for mode, intervals in fine.modes:
        own = np.flatnonzero(np.isin(first, intervals))
        if own.size:
            signs = np.full(QUARTERS, mode.sign)
            some, of = [each[own] for each in rows], [each[own] for each in numbers]
            out[own] = chained(eliminate_many(mode.field, fine.kind, signs, some, of).maps)
    return out


def quarters(fine: Transcription, halves: Array, ends: Array) -> tuple[Array, Array]:
    """The halves of halved intervals.

    halves, ends: (m, 2, R) starts and stages of the halves of some intervals, and (m, n) nodes behind these.
    Returns (m, 4, d + 1, n) starts and stages, and the nodes (m, 4, n) behind them.
    """
    w = halves.reshape(-1, 2, 1, fine.degree + 1, fine.n)
    w = np.matmul(fine.scheme.halves.reshape(2, fine.degree + 1, -1), w).reshape(len(w), QUARTERS, *w.shape[3:])
    return w, np.concatenate([w[:, 1:, 0], ends[:, None]], axis=1)
