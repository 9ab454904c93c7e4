"""Do swings converge, and where to?  What a sequence of amplitudes proves by itself.

A_0, A_1, ... [rad], A_{k+1} = g(A_k) with a map g that is not known.  With d_k = A_{k+1} - A_k its divided differences
are read off the swings,

    r_k = d_{k+1}/d_k = g[A_k, A_{k+1}],      c = (r_{k+1} - r_k)/(A_{k+2} - A_k) = g[A_k, A_{k+1}, A_{k+2}],

and Newton's step for g(A) = A, A* = A + d/(1 - r), counts where

    2 |c| |d| / (1 - r)^2 <= `KANTOROVICH`,   |r| < 1.

A root exists where that number is at most 1/2 (Kantorovich).  Just above a fold there is none, and the swings creep
past the place where the two cycles were: with g - A = -eps - c (A - A*)^2 differences shrink, and the number is
1/2 + eps/(2 c (A - A*)^2), above 1/2 everywhere.

Symbols: A swings, d their differences, e the error of a swing; all [rad].
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray

FEWEST_SWINGS = 4
"""Swings from which convergence is concluded: three differences, two ratios, one curvature."""
KANTOROVICH = 0.1
"""Largest Kantorovich number of a Newton step on the swings; 1/2 is the theorem's."""
ABOVE = 20.0
"""Differences between swings are read where they are so many times the error of the position."""


def limit_of(swings: Array, error: float) -> tuple[float, float, float] | None:
    """The limit that swings converge to.

    Newton's step on the latest differences that stand clear enough of the error, with the later swings for a check.

    swings: (m,) [rad], in order of time; error: to which they are known [rad].
    Returns limit [rad], its error [rad], ratio of successive differences; None where convergence is not certain.
    """
    A = np.asarray(swings, float)
    d = np.diff(A)
    if A.size < FEWEST_SWINGS:
        return None
    clear = np.abs(d) > ABOVE * error
    for k in reversed(np.flatnonzero(clear[2:] & clear[1:-1] & clear[:-2]) + 2):
        found = _newton(A, d, int(k), error)
        if found is not None:
            return found
    return None


def _newton(A: Array, d: Array, k: int, error: float) -> tuple[float, float, float] | None:
    r0, r1 = float(d[k - 1] / d[k - 2]), float(d[k] / d[k - 1])
    base = float(A[k] - A[k - 2])
    if abs(base) <= ABOVE * error:
        return None
    blur = 4 * error / abs(float(d[k - 1]))  # of r0 and r1
    c = (r1 - r0) / base
    r = r1 + c * float(A[k] - A[k - 1])
    if not (abs(r) + blur < 1 and abs(r1) < 1):
        return None
    step = float(d[k]) / (1 - r)
    number = 2 * (abs(c) + 2 * blur / abs(base)) * abs(step) / (1 - r)
    limit, uncertain = float(A[k]) + step, 2 * number * abs(step) + error / (1 - abs(r))
    # What follows must come closer still.
    allowed = abs(step) * max(abs(r), abs(r1)) + uncertain + error
    closer = bool((np.abs(A[k + 1 :] - limit) <= allowed).all())
    return (limit, uncertain, r) if number <= KANTOROVICH and closer else None


def limit_of_sides(swings: Array, error: float) -> tuple[float, float, float] | None:
    """The limit of the swings of a cycle whose two sides differ: each side by itself.

    swings: (m,) [rad], in order of time; error: to which they are known [rad].
    Returns as `limit_of`, for the side of the last swing; None where one of the sides has no certain limit.
    """
    here, there = limit_of(swings[::-1][::2][::-1], error), limit_of(swings[::-1][1::2][::-1], error)
    return here if here is not None and there is not None else None
