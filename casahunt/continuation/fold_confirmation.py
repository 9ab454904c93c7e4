"""Turning points of many members, confirmed: how well each is known, and how much it moves with parameters.

As `fold.confirmed` for one: the error of value, period and amplitude by the adjoint, with what it overlooks
(error_estimate.py), plus what the turning point of the mesh with halved intervals has moved along the curve,
and not less than the distance to that turning point:

    one Newton step at fixed a, then a step and da = -g/g' along the tangent.

Parameters move a fold by  d lambda/d q = psi . (rhs of q),  psi the adjoint of lambda with a held.

Symbols: B members, k parameters, n states, P phases, E elements, y unknowns of the node system.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..collocation.admissibility import admissible_many
from ..collocation.error_estimate import functional_errors, left_on_halved, on_halves
from ..collocation.transcription import Setting, Transcription
from ..orbits.amplitude import amplitudes_off, goals_of_many, row_sums
from ..orbits.ensemble import sizes_of_steps
from .fold_expansion import Expansion, borders

Array = np.ndarray

FARTHEST_SECOND = 1e-3
"""The fold on the halved mesh lies within this of the one that it confirms, or confirms nothing."""


def confirmed_many(known: Expansion, u: Array, settings: Setting, bend: Array) -> Array:
    """Turning points with their errors; see the module docstring.

    u, settings: (B, size) unknowns and settings, at the value that was found; bend: (B,) d2 lambda/d a2.
    Returns (6, B) value, period, amplitude, each followed by its error; infinite where nothing is confirmed.
    """
    t, P = known.t, known.t.phases
    fine, finer, halves, lin = halved = on_halves(t, u, settings)
    goals, period, amplitude = goals_of_many(t, u, settings)
    goals = np.concatenate([np.zeros_like(goals[:, :1]), goals], axis=1)
    goals[:, 0, -1] = 1.0
    border = borders(t, u, known.row)
    first, _, better = functional_errors(t, u, settings, goals, border=border, halved=halved)
    assert better is not None
    motions = admissible_many(*better)
    newton, _ = lin.step_and_tangent(borders(fine, finer, known.row))
    finer = finer + lin.expand(newton, 1.0)
    lam = newton[:, -1]
    lin = fine.linearise(finer, halves.moved(lam))
    newton, tangent = lin.step_and_tangent(borders(fine, finer, known.row))
    with np.errstate(all="ignore"):
        da = -tangent[:, -1] / bend
        step = lin.expand(newton + da[:, None] * tangent, 1.0)
        second = finer + step
        lam = lam + newton[:, -1] + 0.5 * da * tangent[:, -1]
        far = np.maximum(sizes_of_steps(fine, finer, step), np.abs(lam))
        longer = np.abs(row_sums(second[:, -P:]) * t.cycle.repeats / period - 1)
        larger = amplitudes_off(fine, second, halves.moved(lam), amplitude)
        # At another place of the curve everything changes to first order: that is added without regard to signs.
        elsewhere = np.abs(np.matmul(goals, (da[:, None] * _on_coarse(t, fine, tangent))[..., None])[..., 0])
        elsewhere[:, 0] *= 0.5
        second = (1 + left_on_halved(t).max(initial=0.0)) * np.column_stack([np.abs(lam), longer, larger])
        errors = np.maximum(first + elsewhere, second)
        errors[~(far <= FARTHEST_SECOND) | ~lin.finite() | ~motions] = np.inf
    place = known.problem.names.index(known.vary)
    return np.array([settings.p[:, place], errors[:, 0], period, errors[:, 1], amplitude, errors[:, 2]])


def _on_coarse(t: Transcription, fine: Transcription, y: Array) -> Array:
    """(B, y) of the node system of t from that with halved intervals: without the nodes in the middle."""
    lengths = np.ones(t.elements, dtype=int)
    lengths[t.interval_elements] = 2
    kept = np.concatenate([[0], np.cumsum(lengths)])
    nodes = y[:, : (fine.elements + 1) * t.n].reshape(len(y), -1, t.n)[:, kept]
    return np.concatenate([nodes.reshape(len(y), -1), y[:, (fine.elements + 1) * t.n :]], axis=1)


def slopes_of_many(known: Expansion, u: Array, settings: Setting, names: tuple[str, ...]) -> Array:
    """How much folds move with parameters, from the adjoint of lambda: a held, which at a fold is the fold.

    known, u, settings: as in `confirmed_many`. Returns (B, k) d ln value/d ln q.
    """
    t, problem = known.t, known.problem
    at = [problem.names.index(name) for name in names]
    directions = np.zeros((len(u), len(at), settings.p.shape[1]))
    directions[:, np.arange(len(at)), at] = settings.p[:, at]
    lin = t.linearise(u, replace(settings, others=directions))
    goal = np.zeros((len(u), 1, t.system.size))
    goal[:, 0, -1] = 1.0
    psi = t.system.solve_transposed(lin.matrix(borders(t, u, known.row)), goal)[:, 0]
    columns = [np.matmul(psi[:, None], lin.rhs(direction=1 + k)[:, :, None])[:, 0, 0] for k in range(len(at))]
    place = problem.names.index(known.vary)
    relative = settings.dp[:, place] / settings.p[:, place]
    return np.stack(columns, axis=1) * relative[:, None]
