"""How well a condition is known inside an interval: to a few times the last Legendre coefficient of its values.

Where it vanishes at an end of its phase, it is divided by the distance from there, and the quotient must be clear of
zero.

Symbols: d stages, N intervals, m points.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from .conditions import BETWEEN
from .scheme import Kind, scheme
from .transcription import Transcription

Array = np.ndarray

RESOLUTION = 3.0
"""A condition is known to this many times its last Legendre coefficient."""
NOISE = 1e-10
"""Of a condition, relative to its size above one: what Newton's method and rounding leave of it is less.
No cycle of sixteen notices ten times more or less."""
BARELY = 1e-8
"""An event that is passed, and passed back, by less than this is not: a cycle that grazes shows no more.  Intervals
that do not resolve as little where one is all but met are unclear, whichever side of zero they show."""


@lru_cache(maxsize=256)
def _slope_of(degree: int, kind: Kind, starts: bool, stops: bool) -> tuple[slice, Array, Array]:
    """(kept points, divisor, row of the last Legendre coefficient) of a condition with zeros at its ends divided out.

    Values of the condition at the kept points over the divisor are the slope's; the row gives its resolution.
    """
    points = scheme(degree, kind).points
    keep = slice(int(starts), points.size - int(points[-1] == 1.0 and stops))
    tau = points[keep]
    divisor = (tau if starts else 1.0) * (1 - tau if stops else 1.0) * np.ones(tau.size)
    return keep, divisor, np.linalg.inv(legendre.legvander(2 * tau - 1, tau.size - 1))[-1]


@lru_cache(maxsize=32)
def dense_rule(degree: int, kind: Kind) -> tuple[Array, Array]:
    """How a condition is looked at between the points where it is known.

    Returns interpolation (d + 1, m) to the times between, and (d + 1,) to the end.
    """
    s = scheme(degree, kind)
    return s.interpolation(BETWEEN).T.copy(), s.interpolation(np.array([1.0]))[0]


def largest_of_phase(t: Transcription, values: Array) -> Array:
    """For every interval the largest magnitude of a condition in its phase.

    t, values: the transcription, and (..., N, m) values of the condition. Returns (..., N).
    """
    largest = np.maximum.reduceat(np.abs(values).max(axis=-1), t.first_intervals, axis=-1)
    return np.repeat(largest, t.collocated_counts, axis=-1)


def not_clear(t: Transcription, values: Array, slack: Array) -> Array:
    """Where a condition is not clear of zero by its resolution, and a shorter interval can make it so.

    Of a phase that has all but vanished nothing is left but noise.

    t, values, slack: the transcription, (..., N, d + 1) values of the condition at start and stages, and (N,) its
    slack. Returns (..., N) bool.
    """
    s, size = t.scheme, largest_of_phase(t, values)
    first, last = t.first_intervals, t.first_intervals + t.collocated_counts - 1
    kinds = np.zeros(values.shape[:-1], dtype=int)
    kinds[..., first] = 2 * (np.abs(values[..., first, 0]) <= BARELY * size[..., first])
    ends = values[..., last, :] @ dense_rule(s.degree, s.kind)[1]
    kinds[..., last] += np.abs(ends) <= BARELY * size[..., last]
    out = values.min(axis=-1) + slack < RESOLUTION * np.abs(values @ s.last_mode)
    for kind in range(1, 4):
        chosen = (kinds == kind).nonzero()
        if not chosen[0].size:
            continue
        keep, divisor, top = _slope_of(s.degree, s.kind, kind > 1, kind % 2 == 1)
        slope, allowed = values[chosen][:, keep] / divisor, slack[chosen[-1]]
        unclear = slope.min(axis=1) + allowed < RESOLUTION * np.abs(slope @ top)
        if kind > 1 and s.degree == 2:
            # A slip starts with v ~ t^2, whose slope is a straight line: at degree 2 its last coefficient
            # is no smaller on a finer mesh, that of v/t^2 is.
            slope /= s.points[keep]
            unclear &= slope.min(axis=1) + allowed < RESOLUTION * np.abs(slope @ top)
        out[chosen] = unclear
    return np.asarray(out & (RESOLUTION * np.abs(values @ s.last_mode) > NOISE * np.maximum(1.0, size)))
