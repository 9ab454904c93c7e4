"""Leading multipliers of many cycles whose equations are solved: multiplier_mesh.py with members in front.

    u_b on the mesh with halved intervals, one Newton step -> multipliers there, compared with those of the own mesh

Those that are not sure after that, or too large to be, are left to meshes of their own.  One mesh for all takes 1.05 ms
a member (7 intervals, 3 states) where meshes of their own take 1.36, and in a batch a member's last bits depend on
the others.

Symbols: B members.
"""

from __future__ import annotations

import numpy as np

from ..collocation.error_estimate import on_halves
from ..collocation.transcription import Setting, Transcription
from . import floquet
from .map_chain import collocation_chain
from .multiplier_mesh import LARGE_MULTIPLIER

Array = np.ndarray


def leading_of_many(t: Transcription, u: Array, settings: Setting) -> tuple[Array, Array]:
    """The leading nontrivial multipliers of many cycles.

    t, u, settings: transcription, (B, size) solutions, and settings.
    Returns (B,) complex, as `Multipliers.leading`, and (B,) errors, as `Multipliers.error`; nan where not trusted here.
    """
    B = len(u)
    fine, finer, halves, lin = on_halves(t, u, settings)
    finer = finer + lin.step(np.repeat(fine.system.border(parameter=1.0)[None], B, axis=0))[0]
    lin, own = fine.linearise(finer, halves), t.linearise(u, settings)
    leading, errors = np.full(B, complex(np.nan, np.nan)), np.full(B, np.nan)
    for b in np.flatnonzero(np.isfinite(finer).all(axis=1) & lin.finite()).tolist():
        exact = collocation_chain(fine, finer[b], halves.of(b), lin.one(b))
        found = floquet.chain_multipliers(exact, fine.cycle.repeats)
        rough, _ = floquet.rough_multipliers(collocation_chain(t, u[b], settings.of(b), own.one(b)), found.frame)
        found = floquet.compared(found, rough)
        if found.trusted and abs(found.leading) < LARGE_MULTIPLIER:
            leading[b], errors[b] = found.leading, found.error
    return leading, errors
