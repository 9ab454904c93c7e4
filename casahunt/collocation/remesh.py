"""The mesh that makes the error as small as asked for.

The error contribution of every interval (error_estimate.py) behaves like h^(order + 1): each interval is made shorter
or longer by the power that brings it to its share of the tolerance.  A second measure keeps the solution presentable
between the nodes: the last Legendre coefficient of each interval in units of the state scale, bounded by `shape_limit`.

Symbols: N intervals.
"""

from __future__ import annotations

import numpy as np

from .error_estimate import Estimate
from .mesh import apart, phase_breaks
from .transcription import Transcription

Array = np.ndarray

SHAPE = 1e-3
"""Largest last Legendre coefficient: the polynomial inside an interval is then good to about 1e-4."""
KINK_POWER = 1 / 3
"""In a mode with a kink the error contribution of an interval falls no faster than h^3."""
SAFETY = 0.01
"""The next mesh aims at this part of the tolerance.  A fifth more intervals than at 0.1, and on walks along which
fast slips move about on their mesh a quarter fewer changes of it: 5 to 15 % less time."""


def shape_limit(tol: float) -> float:
    """Last Legendre coefficients that a mesh aims at: the solution presentable between its nodes, and better
    where the tolerance is tight."""
    return min(SHAPE, float(np.sqrt(tol)))


COARSENING = (0.1, 0.3, 1.0)
"""How many intervals may stand in place of one, at least, at the first, second and any later change of a mesh.

Contributions are measured on the mesh at hand; an interval without any may get one when it grows.  Meshes that keep
coarsening go round in circles."""


def better_breaks(t: Transcription, fractions: Array, e: Estimate, tol: float, changes: int = 0) -> list[Array]:
    """The boundaries of the next mesh: place and number of intervals for the tolerance.

    The contribution of an interval behaves like h^(order + 1): its length is changed by the power that would bring it
    to its share of the tolerance, by at most 4 at a time when it shrinks and `COARSENING` when it grows.

    fractions: (N,) interval lengths as fractions of their phase; e: error estimate on this mesh; changes: how often
    this mesh has been changed already. Returns boundaries of each collocated phase, from 0 to 1.
    """
    power = np.where(t.smooth, 1.0 / (t.scheme.order + 1), KINK_POWER)
    share = SAFETY * tol / max(t.intervals, 1)
    wanted = np.maximum(
        (e.indicators / share) ** power,
        (e.shape / shape_limit(tol)) ** (1.0 / t.degree),
    )
    wanted = np.clip(wanted, COARSENING[min(changes, len(COARSENING) - 1)], 4.0)
    out = []
    for k, b in zip([k for k, c in enumerate(t.counts) if c], phase_breaks(t, fractions), strict=True):
        out.append(_redistribute(b, wanted[t.phase_intervals(k)]))
    return out


def _redistribute(breaks: Array, wanted: Array) -> Array:
    """Boundaries with `wanted[i]` intervals in place of interval i.

    No grading between neighbours: the stub that an event leaves at the end of a march is a thousand times
    shorter than its neighbour, and grading would fill the phase with stubs.
    """
    load = np.concatenate([[0.0], np.cumsum(wanted)])
    count = max(1, int(np.ceil(load[-1] - 1e-9)))
    return apart(np.interp(np.linspace(0, load[-1], count + 1), load, breaks))
