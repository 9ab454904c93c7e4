"""Events that are all but met: does the scalar of one, which comes near zero and goes away again, pass it?

Between the points of an interval the scalar is a polynomial, looked at on equidistant times and at the tops between
them, and known to some times its last Legendre coefficient.  A top that is no farther from zero than that, on whichever
side, says nothing: what one mesh shows next to a grazing contact is rounding.

Symbols: N intervals, m times.
"""

from __future__ import annotations

import numpy as np

Array = np.ndarray


def comes_and_goes(values: Array, tops: Array, doubt: Array | float, least: Array | float) -> tuple[Array, Array]:
    """Where an event that is not met in the end is met in between: surely, and perhaps.

    values, tops: (..., N, m) of the event, below zero before it is met, and `tops_of` them; doubt, least: (..., N, 1)
    how well they are known, 0 for exactly; (..., 1, 1) what does not count.
    Returns (..., N, m) bool: above `least` for sure, between times at which it is as far below zero; and no farther
    below zero than it is known, between times at which it is, on intervals that do not resolve `least`.
    """
    near = (tops > least) | ((doubt > least) & (tops > -doubt))
    if not near.any():
        return near, near
    flat = values.reshape(*values.shape[:-2], -1)
    around = np.zeros_like(flat)
    before = np.minimum.accumulate(flat, axis=-1)[..., :-2]
    behind = np.minimum.accumulate(flat[..., ::-1], axis=-1)[..., -3::-1]
    around[..., 1:-1] = np.maximum(before, behind)  # of the points before, and of those behind: tops lie between points
    around = around.reshape(values.shape)
    seen = (around < -least) & (tops > least + doubt)
    unknown = (doubt > least) & (around < -doubt) & (tops > -doubt)
    return np.asarray(seen), np.asarray(unknown | (around < -least) & (tops > least) & ~seen)


def tops_of(values: Array) -> Array:
    """Equidistant values (..., m), or what they come up to next to them: vertices of parabolas through neighbours."""
    tops = values.copy()
    left, middle, right = values[..., :-2], values[..., 1:-1], values[..., 2:]
    bend, tilt = left - 2 * middle + right, left - right
    peaked = (bend < 0) & (np.abs(tilt) <= -2 * bend)
    tops[..., 1:-1] -= np.divide(tilt * tilt, bend, out=np.zeros_like(bend), where=peaked) / 8
    return tops
