"""The mesh for the tolerance of a motion that has been marched and is not yet the orbit, before anything is solved.

    estimate -> better mesh -> is it clear on every interval what its phase is? -> start of adapt.py
                   ^                 | no
                   +-- cut in four --+
"""

from __future__ import annotations

import numpy as np

from ..collocation.admissibility import judge
from ..collocation.mesh import quartered_where
from ..collocation.remesh import better_breaks
from .adapt import Options, on_breaks, presentable
from .amplitude import estimated
from .restart import Start

MOTION = 0.1
"""The mesh of a motion that is not yet the orbit aims at this part of the tolerance: over 24 stick-slip cycles
that takes an eighth off the time at 1e-6, and adds a sixteenth at 1e-8; elsewhere it makes no difference."""
CLEARED = 2
"""How often intervals of a motion on which it is not clear what its phases are may be cut before anything is solved."""


def remeshed(start: Start, options: Options) -> Start:
    """A marched motion on a mesh for the tolerance, before anything is solved.

    A march solves the equations of every interval; the estimate of what each is to blame for does not need the
    closure to hold.

    Returns the same on another mesh; as it is where its own does.
    """
    t, u, setting = start
    e = estimated(t, u, setting, believed=0.0)
    if not np.isfinite(e.indicators).all():
        return start
    if not (float(e.indicators.sum()) <= options.tol and presentable(e, options)):
        start = on_breaks(start, better_breaks(t, setting.fractions, e, MOTION * options.tol))
    return cleared(start)


def cleared(start: Start) -> Start:
    """A motion on a mesh cut, by its own polynomials, where it is not clear what its phases are."""
    for _ in range(CLEARED):
        t, u, setting = start
        verdict = judge(t, u, setting)
        if verdict.violated or not verdict.unclear.any():
            break
        start = on_breaks(start, quartered_where(t, setting.fractions, verdict.unclear))
    return start
