"""How the end of a phase moves with its start and with parameters.

    d x(T)/d (x_0, lambda) = M_N ... M_1,    M_i the condensed map of an interval (collocation/interval.py)

at a fixed duration T: where the phase ends with an event h(x) = 0 the duration yields by dT = -(h_x dx)/(h_x f).

Symbols: n states, d stages, N intervals, R = n (d + 1).
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..collocation.interval import field_at, interval_map
from ..hybrid.problem import Kind
from ..hybrid.system import VectorMode, VectorSystem
from .segment import Segment

Array = np.ndarray

ELIMINATED = 16
"""Intervals whose stages are eliminated together."""


def forward_sensitivity(
    system: VectorSystem,
    segment: Segment,
    dx: Array,
    p: Array,
    dp: Array,
    *,
    scale: Array,
    degree: int,
    kind: Kind = "gauss",
) -> tuple[Array, Array]:
    """How the end of a phase moves with its start, and with parameters, at a fixed duration.

    Parameters
    ----------
    system, segment
        the hybrid system in vectors (`VectorSystem.vector_form`), and the phase, as `march` has followed it.
    dx
        (n, k) how the start moves, in units of `scale`.
    p, dp
        (np,) the parameters, and how they move with the last column of `dx`.
    scale, degree, kind
        (n,) size of the states, and the collocation scheme of the march.

    Returns
    -------
    moved : (n, k) how the end moves, in units of `scale`.
    rate : (n,) x' there, likewise.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.motion import forward_sensitivity, march
    >>> p, form = np.array(list(belt.parameters.values())), belt.vector_form
    >>> slip = march(form, "slip", np.zeros(2), p, scale=np.ones(2), until=lambda _: True, tol=1e-8)[0]
    >>> moved, rate = forward_sensitivity(
    ...     form, slip, np.array([[1.0, 0.0], [0.0, 0.0]]), p, np.eye(5)[4], scale=np.ones(2), degree=7
    ... )
    >>> moved.round(3).tolist(), rate.round(3).tolist()
    ([[0.96, -0.061], [-0.344, -0.603]], [0.2, 0.976])
    """
    mode, column = system.modes[segment.mode], np.array(dx, float)
    for through, forced in _interval_slopes(mode, segment, dp, p, scale, degree, kind):
        column = through @ column
        column[:, -1] += forced
    return column, field_at(mode.field, segment.end / scale, mode.sign, p, scale)


def _interval_slopes(
    mode: VectorMode, segment: Segment, dp: Array, p: Array, scale: Array, degree: int, kind: Kind
) -> Iterator[tuple[Array, Array]]:
    """Of each interval d end/d start (n, n) and d end/d lambda (n,), scaled; stages eliminated many at a time."""
    n = scale.size
    rows = n * (degree + 1)
    d_rows = rows - n
    function = interval_map(mode.field, n, p.size, degree, kind, ELIMINATED)
    scaled, lengths = segment.w / np.tile(scale, degree + 1), np.diff(segment.breaks)
    for first in range(0, len(scaled), ELIMINATED):
        w, fractions = scaled[first : first + ELIMINATED], lengths[first : first + ELIMINATED]
        count = len(w)
        w = np.concatenate([w, np.repeat(w[-1:], ELIMINATED - count, axis=0)])
        fractions = np.append(fractions, np.zeros(ELIMINATED - count))
        block = function(w, np.zeros(n), segment.duration, fractions, mode.sign, p, dp, scale)[:count]
        # Residual columns of the block are its rows here: d/dw at 1..R, d/d lambda last.
        known = block[:, [*range(1, n + 1), rows + 2]].swapaxes(1, 2)
        by_stages = block[:, n + 1 : rows + 1].swapaxes(1, 2)
        stages = np.linalg.solve(by_stages[:, :d_rows], known[:, :d_rows])
        ends = by_stages[:, d_rows:] @ stages - known[:, d_rows:]
        yield from ((end[:, :n], end[:, n]) for end in ends)
