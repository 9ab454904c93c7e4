"""A table as an expression: a piecewise cubic h(v) with a continuous slope, monotone between two entries.

    h_k'  the weighted harmonic mean of the slopes of the chords beside entry k, 0 where they differ in sign

Fritsch and Butland, SIAM J. Sci. Stat. Comput. 5 (1984); at the ends a one-sided slope in three entries.  Beyond its
entries the curve goes on straight, behind the last one never down.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

Entries = tuple[tuple[float, float], ...]
"""(v, h), v rising."""


def slopes(v: np.ndarray, h: np.ndarray) -> np.ndarray:
    """The slopes of the monotone cubic at its entries (n,)."""
    step, chord = np.diff(v), np.diff(h) / np.diff(v)
    w1, w2 = 2 * step[1:] + step[:-1], step[1:] + 2 * step[:-1]
    one_way = chord[:-1] * chord[1:] > 0
    safe = np.where(one_way, chord[:-1] * chord[1:], 1.0)
    inner = np.where(one_way, (w1 + w2) * safe / np.where(one_way, w1 * chord[1:] + w2 * chord[:-1], 1.0), 0.0)

    def end(h0: float, h1: float, d0: float, d1: float) -> float:
        """One-sided in three entries, held to be monotone."""
        slope = ((2 * h0 + h1) * d0 - h0 * d1) / (h0 + h1)
        return 0.0 if slope * d0 <= 0 else 3 * d0 if d0 * d1 <= 0 and abs(slope) > 3 * abs(d0) else slope

    if len(chord) == 1:
        first = last = float(chord[0])
    else:
        first, last = end(*step[:2], *chord[:2]), end(*step[:-3:-1], *chord[:-3:-1])
    return np.array([first, *inner, max(last, 0.0)])


def interpolated(entries: Entries, v: Any) -> Any:
    """h(v) as an expression, v >= 0."""
    knots, values = np.array(entries).T
    d = slopes(knots, values)
    h = values[0] + d[0] * (v - knots[0])
    for k, step in enumerate(np.diff(knots)):
        chord = (values[k + 1] - values[k]) / step
        t = v - knots[k]
        c2, c3 = (3 * chord - 2 * d[k] - d[k + 1]) / step, (d[k] + d[k + 1] - 2 * chord) / step**2
        h = ca.if_else(t > 0, values[k] + t * (d[k] + t * (c2 + t * c3)), h)
    return ca.if_else(v > knots[-1], values[-1] + d[-1] * (v - knots[-1]), h)
