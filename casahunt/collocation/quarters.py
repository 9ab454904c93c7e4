"""Intervals whose halves do not tell their error, cut in four.

An interval's map from its start to its end, stages eliminated, is known better from parts of it,

    x+ = r + A x + B dT + C dlambda      from one part to the next,      r = r_2 + A_2 r_1,  A = A_2 A_1,  and so on,

and the residual r of the parts is what the interval is to blame for (error_estimate.py).  Two parts suffice where the
solution is smooth.  In stiff modes, and where the field has kinks, something may happen within a part of an interval
that its halves hardly see: there they say 3e-7, and four, eight and thirty-two parts say 1.2e-6.  It is a few intervals
of a mesh that matter, so these are cut in four; what changes then tells how far the halves could be believed.

Symbols: m intervals, n states, d stages, R = n (d + 1), c = n + 3 columns of [r | A | B | C], or more of C.
"""

from __future__ import annotations

import numpy as np

from .elimination import elimination
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


def maps_over_quarters(fine: Transcription, u: Array, setting: Setting, chosen: Array) -> Array:
    """The maps over some intervals, from four parts of each.

    fine, u, setting: transcription, unknowns and setting of the mesh with halved intervals; chosen: (m,) which
    intervals before they were halved. Returns (m, n, n + 3).
    """
    n, first = fine.n, 2 * chosen
    halves = u[: fine.intervals * fine.rows].reshape(-1, 2, fine.rows)[chosen]
    w, following = quarters(fine, halves, fine.nodes_of(u)[fine.interval_elements[first + 1] + 1])
    duration = fine.durations_of(u)[fine.phase_of[fine.interval_elements[first]]]
    fraction, sign = setting.fractions[first] / 2, fine.signs[first]
    out = np.empty((chosen.size, n, n + 3))
    for field, members in fine.groups:
        own = np.flatnonzero(np.isin(first, members))
        if not own.size:
            continue
        # A power of two, so that few sizes are compiled: the first one is repeated, and not read again.
        count = 1 << int(own.size - 1).bit_length()
        i = np.concatenate([own, np.repeat(own[:1], count - own.size)])
        T, h, signs = (np.repeat(of[i], QUARTERS) for of in (duration, fraction, sign))
        eliminated = elimination(field, n, setting.p.size, fine.degree, fine.kind, QUARTERS * count)(
            w[i].reshape(QUARTERS * count, -1), following[i].reshape(-1, n), T, h, signs, setting.p, setting.dp,
            setting.scale,
        )  # fmt: skip
        out[own] = chained(eliminated.maps.reshape(count, QUARTERS, n, -1))[: own.size]
    return out


def quarters(fine: Transcription, halves: Array, ends: Array) -> tuple[Array, Array]:
    """The halves of halved intervals.

    halves, ends: (m, 2, R) starts and stages of the halves of some intervals, and (m, n) nodes behind these.
    Returns (m, 4, d + 1, n) starts and stages, and the nodes (m, 4, n) behind them.
    """
    w = halves.reshape(-1, 2, 1, fine.degree + 1, fine.n)
    w = np.matmul(fine.scheme.halves.reshape(2, fine.degree + 1, -1), w).reshape(len(w), QUARTERS, *w.shape[3:])
    return w, np.concatenate([w[:, 1:, 0], ends[:, None]], axis=1)
