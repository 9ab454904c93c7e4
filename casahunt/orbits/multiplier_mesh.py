"""Multipliers on meshes made for them, finer than the orbit's, until they are known.

    half as long intervals, solved anew:    |trivial - 1| small,  and the same leading multiplier as on the mesh before

Symbols: n states.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..collocation.mesh import halved, phase_breaks, transfer
from ..collocation.newton import Solver
from ..collocation.remesh import better_breaks
from ..collocation.solve import solve
from ..collocation.transcription import Setting, Transcription
from . import floquet
from .amplitude import estimated

Array = np.ndarray

MULTIPLIER_TOLERANCE = 1e-9
"""Error of the period on the mesh on which multipliers are computed."""
HEALTHY = 4e-9
"""Trivial multipliers nearer to 1 than this need no finer mesh: that of the full period, its square, is within 1e-8."""
MORE_HALVINGS = 3
LARGE_MULTIPLIER, AGREED = 10.0, 1e-7
"""Half multipliers beyond LARGE_MULTIPLIER are computed on two meshes at least, until they agree to AGREED."""
NEXT_TO_FOLD = 0.02
"""Share of the parameter in the unit tangent below which a point counts as next to a fold."""


def refined_multipliers(
    t: Transcription, u: Array, setting: Setting, *, solver: Solver = "newton"
) -> tuple[floquet.Multipliers, tuple[Transcription, Array, Setting]]:
    """Multipliers on a mesh made for them: finer than the orbit's, until the trivial one is 1.

    They depend on the whole linearised flow, which converges later than period and amplitude.  Their error is that
    against a mesh of intervals twice as long: of the same orbit at first, then of the orbit solved there.

    Parameters
    ----------
    t, u, setting
        the orbit: transcription, unknowns, setting.
    solver
        for the finer meshes.

    Returns
    -------
    Multipliers, and the orbit (transcription, unknowns, setting) on the mesh on which they came out best.
    """
    e = estimated(t, u, setting)
    best: floquet.Multipliers | None = None
    place = t, u, setting
    breaks = phase_breaks(t, setting.fractions)
    if e.error > MULTIPLIER_TOLERANCE:
        breaks = better_breaks(t, setting.fractions, e, MULTIPLIER_TOLERANCE)
    weights = _fold_border(t, u, setting)
    coarse: Array | None = None
    for _ in range(1 + MORE_HALVINGS):
        whole = breaks
        t, u, fractions = transfer(t, u, setting.fractions, halved(breaks))
        setting = replace(setting, fractions=fractions)
        border = None if weights is None else t.system.border(nodes=weights, parameter=0.0)
        solution = solve(t, u, setting, solver=solver, border=border)
        if not solution.status.ok:
            break
        u, breaks, setting = solution.u, phase_breaks(t, fractions), setting.moved(solution.parameter)
        found = floquet.multipliers(t, u, setting, solution.linearisation)
        if coarse is None:
            coarse = floquet.rough_multipliers(*_moved_to(whole, t, u, setting), found.frame)
        found, coarse = floquet.compared(found, coarse), found.half[1:]
        # Where the flow expands a lot, the trivial multiplier says nothing about the leading one: it must
        # come out the same on two meshes.
        settled = abs(found.leading) < LARGE_MULTIPLIER or (
            best is not None and abs(found.leading - best.leading) < AGREED * abs(found.leading)
        )
        better = best is None or found.trivial_error < best.trivial_error or best.error >= floquet.TRUSTED
        if best is None or better or abs(found.leading) >= LARGE_MULTIPLIER:
            best, place = found, (t, u, setting)
        if best.trivial_error < HEALTHY and best.error < floquet.TRUSTED and settled:
            break
    if best is None:  # nothing was solved: the orbit's own mesh, against its halves
        best = floquet.multipliers(*place)
        finer = _moved_to(halved(phase_breaks(place[0], place[2].fractions)), *place)
        best = floquet.compared(best, floquet.rough_multipliers(*finer, best.frame), share=1.0)
    return best, place


def _moved_to(
    breaks: list[Array], t: Transcription, u: Array, setting: Setting
) -> tuple[Transcription, Array, Setting]:
    """The same orbit on another mesh, not solved again."""
    t, u, fractions = transfer(t, u, setting.fractions, breaks)
    return t, u, replace(setting, fractions=fractions)


def _fold_border(t: Transcription, u: Array, setting: Setting) -> Array | None:
    """Weights of the phase-end nodes along which to hold u where the parameter cannot be held: next to a fold.

    There the equations at a fixed parameter are singular; on a finer mesh it must be free to move by the
    error of the coarser one.
    """
    lin = t.linearise(u, replace(setting, dp=setting.dp * (setting.dp @ setting.p or 1.0)))
    _, y = lin.tangent(t.system.border(parameter=1.0))
    length = float(np.linalg.norm(np.append(y[: t.n], y[-1])))
    if np.isfinite(length) and abs(y[-1]) > NEXT_TO_FOLD * length:
        return None
    first = y[: t.n] / length if np.isfinite(length) else np.ones(t.n)
    weights = np.zeros((t.phases + 1, t.n))
    weights[0] = first
    return weights
