"""The errors of many solutions at once: error_estimate.py with members in front.

    u_b on the mesh with halved intervals -> r_b, linearised there -> joined over the halves -> J_b^T psi = c_b
    q(exact) - q(u_b) = sum_e psi_e . r_e,    and what the halved mesh and a Newton step inside the intervals leave

Symbols: B members, n states, d stages, N intervals, E elements, P phases, k functionals, y unknowns of the node system.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .ensemble import (
    Linearisations,
    Settings,
    fields_of_many,
    intervals_without_stages,
    linearise_many,
    nodes_of_many,
)
from .error_estimate import ANYWHERE, ROUNDING, fine_rule, left_on_halved, left_on_quarters, to_be_quartered
from .quarters import QUARTERS, chained, quarters
from .transcription import Transcription, transcribe

Array = np.ndarray
Solutions = tuple[Transcription, Array, Settings]


def halved_for_many(t: Transcription, u: Array, settings: Settings) -> tuple[Transcription, Array, Settings]:
    """Solutions with every interval cut in two, as `mesh.on_halved_mesh`.

    t, u, settings: transcription, (B, size) unknowns, and settings. Returns the same on the finer mesh.
    """
    fine, B = transcribe(t.cycle, tuple(2 * count for count in t.counts), t.degree, t.kind), len(u)
    old = nodes_of_many(t, u)
    w = u[:, : t.intervals * t.rows].reshape(B, t.intervals, 1, t.degree + 1, t.n)
    w = np.matmul(t.scheme.halves, w).reshape(B, fine.intervals, fine.rows)
    nodes = np.empty((B, fine.elements + 1, t.n))
    nodes[:, fine.interval_elements] = w[:, :, : t.n]
    nodes[:, fine.closed_elements] = old[:, t.closed_elements]
    nodes[:, -1] = old[:, -1]
    # A phase starts where the one before it ended, exactly: interpolation must not move an event.
    nodes[:, fine.phase_start] = old[:, t.phase_start]
    nodes[:, fine.phase_end] = old[:, t.phase_end]
    out = np.empty((B, fine.size))
    out[:, : fine.intervals * fine.rows] = w.reshape(B, -1)
    out[:, fine.node_index] = nodes
    out[:, -fine.phases :] = u[:, -t.phases :]
    fractions = np.repeat(settings.fractions / 2, 2, axis=1)
    return fine, out, Settings(fractions, settings.p, settings.scale, settings.directions)


def errors_of_many(
    t: Transcription,
    fine: Transcription,
    u: Array,
    settings: Settings,
    lin: Linearisations,
    goals: Array,
    border: Array,
) -> tuple[Array, Solutions]:
    """Errors of linear functionals of the node systems at converged solutions.

    fine, u, settings, lin: the solutions on the halved mesh, and the equations linearised there; goals: (B, k, y)
    functionals of the node systems of `t`; border: (B, .) border rows under which the solutions were computed.
    Returns (B, k) absolute errors, what they overlook added; and the solutions after a Newton step on the halved mesh.
    """
    with np.errstate(all="ignore"):
        B, n, own = len(u), t.n, t.interval_elements
        maps, everyone = _joined(t, fine, lin.maps), np.arange(B)
        system = _newton_step(t, lin, everyone, maps, border)
        y = t.system.solve_many(system[0], system[1][:, None])[:, 0]
        better = fine, u + lin.expand(_with_middles(t, fine, lin, y), 1.0), settings.moved(y[:, -1])
        errors, chains, shares = _blamed(t, maps, goals, *system)
        if t.intervals:
            # Laid out as it is written, whatever B is: the additions below come in the order of the memory.
            weights = np.ascontiguousarray(chains[:, :, own])
            blame, one_each = np.abs(np.ascontiguousarray(shares[:, :, own])), np.ones(t.intervals)
            left = _left_by_steps(*better, lin).reshape(B, t.intervals, 4, n)
            terms = np.abs(np.matmul(left, weights.transpose(0, 2, 3, 1)))
            overlooked = np.maximum(terms[:, :, 0], terms[:, :, 1]) + np.maximum(terms[:, :, 2], terms[:, :, 3])
            overlooked = ANYWHERE * np.matmul(one_each, overlooked)
            unseen = left_on_halved(t) * blame
            first = errors + overlooked + np.matmul(unseen, one_each)
            where = to_be_quartered(t, blame, first)
            members, chosen = np.nonzero(where)
            if members.size:
                maps[members, own[chosen]] = _over_quarters(fine, u, settings, members, chosen)
                some = np.flatnonzero(where.any(axis=1))
                system = _newton_step(t, lin, some, maps[some], border[some])
                errors[some], chains[some], again = _blamed(t, maps[some], goals[some], *system)
                on_quarters = left_on_quarters(shares[some][:, :, own], again[:, :, own])
                unseen[some] = np.where(where[some, None], on_quarters, unseen[some])
            errors = errors + np.matmul(unseen, one_each) + overlooked
        flat = chains.reshape(B, chains.shape[1], 1, -1)
        return errors + ROUNDING * np.sqrt(np.matmul(flat, flat.swapaxes(2, 3))[..., 0, 0]), better


def _over_quarters(fine: Transcription, u: Array, s: Settings, members: Array, chosen: Array) -> Array:
    """The maps (m, n, c) over some intervals (m,) of some members (m,), from four parts of each."""
    first = 2 * chosen
    halves = u[:, : fine.intervals * fine.rows].reshape(len(u), -1, 2, fine.rows)[members, chosen]
    w, following = quarters(fine, halves, u[members[:, None], fine.node_index[fine.interval_elements[first + 1] + 1]])
    duration = u[members, -fine.phases + fine.phase_of[fine.interval_elements[first]]]
    fractions = np.repeat(s.fractions[members, first, None] / 2, QUARTERS, axis=1)
    out = np.empty((chosen.size, fine.n, fine.n + 2 + s.directions.shape[1]))
    for mode, intervals in fine.modes:
        own = np.flatnonzero(np.isin(first, intervals))
        if own.size:
            of = members[own]
            settings = Settings(fractions[own], s.p[of], s.scale[of], s.directions[of])
            phase = next(phase for phase in fine.cycle.phases if phase.mode == mode)
            alone = replace(fine.cycle, phases=(replace(phase, reset=None),))
            parts = transcribe(alone, (QUARTERS,), fine.degree, fine.kind)
            out[own] = chained(
                intervals_without_stages(parts, w[own], following[own], duration[own, None], settings)[2]
            )
    return out


def _newton_step(
    t: Transcription, lin: Linearisations, members: Array, maps: Array, border: Array
) -> tuple[Array, Array]:
    """Nonzeros and right-hand sides (B, y) of the node systems of some members, as `error_estimate._newton_step`."""
    B, closure, events = len(maps), lin.closure[members], lin.events[members][:, : t.n + 3]
    rhs = [maps[..., 0].reshape(B, -1), -lin.closure_residual[members], -events[:, 0], np.zeros((B, 1))]
    nonzeros = t.system.nonzeros_of_many(maps[..., : t.n + 3], closure, events, border)
    return nonzeros, np.concatenate(rhs, axis=1)


def _blamed(t: Transcription, maps: Array, goals: Array, nonzeros: Array, rhs: Array) -> tuple[Array, Array, Array]:
    """First-order errors (B, k) of functionals of some members; psi (B, k, E, n), and psi . r (B, k, E)."""
    B, E, n = len(maps), t.elements, t.n
    psi = t.system.solve_many(nonzeros, goals, transposed=True)
    chains = np.ascontiguousarray(psi[:, :, : E * n]).reshape(B, -1, E, n)
    errors = np.abs(np.matmul(psi, rhs[:, :, None])[..., 0])
    shares = np.matmul(chains[..., None, :], maps[:, None, :, :, :1])[..., 0, 0]
    return errors, chains, shares


def _with_middles(t: Transcription, fine: Transcription, lin: Linearisations, y: Array) -> Array:
    """Solutions y (B, y) of the node systems of t, with the nodes in the middles of the intervals."""
    B, n, ends = len(y), t.n, (t.elements + 1) * t.n
    coarse, first = y[:, :ends].reshape(B, -1, n), fine.interval_elements[::2]
    nodes = np.empty((B, fine.elements + 1, n))
    nodes[:, first], nodes[:, fine.closed_elements] = coarse[:, t.interval_elements], coarse[:, t.closed_elements]
    nodes[:, -1] = coarse[:, -1]
    known = np.empty((B, t.intervals, n + 3, 1))
    known[:, :, 0], known[:, :, 1 : n + 1, 0], known[:, :, n + 2] = 1.0, nodes[:, first], y[:, None, -1:]
    known[:, :, n + 1, 0] = y[:, ends:-1][:, t.phase_of[t.interval_elements]]
    nodes[:, first + 1] = np.matmul(lin.maps[:, first, :, : n + 3], known)[..., 0]
    return np.concatenate([nodes.reshape(B, -1), y[:, ends:]], axis=1)


def _left_by_steps(fine: Transcription, u: Array, s: Settings, lin: Linearisations) -> Array:
    """r' (B, N, 2, 2, n): see `error_estimate._left_by_a_step`."""
    B, n, count, d = len(u), fine.n, fine.intervals // 2, fine.degree
    w = u[:, : fine.intervals * fine.rows].reshape(B, count, 2, d + 1, n)
    ends = nodes_of_many(fine, u)[:, fine.interval_elements + 1].reshape(B, count, 2, n)
    through = lin.maps[:, fine.interval_elements].reshape(B, count, 2, n, -1)[..., 1 : n + 1]
    weights, rule = fine_rule(d, fine.kind)
    x = np.matmul(rule, w).reshape(B, fine.intervals, -1, n)
    f = fields_of_many(fine, x, s).reshape(B, count, 2, -1, n)
    step = s.fractions * u[:, -fine.phases :][:, fine.phase_of[fine.interval_elements]]
    integrals = np.matmul(weights[:, None], f)[..., 0, :] * step.reshape(B, count, 2, 1)
    left = w[:, :, :, 0] + integrals - ends
    late_early = np.stack([left, np.matmul(through, left[..., None])[..., 0]], axis=3)
    late_early[:, :, 0] = np.matmul(late_early[:, :, 0], through[:, :, 1].transpose(0, 1, 3, 2))
    return late_early


def _joined(t: Transcription, fine: Transcription, maps: Array) -> Array:
    """(B, E, n, c) maps over the intervals of t from those over their two halves."""
    B, *shape = len(maps), *maps.shape[2:]
    out = np.empty((B, t.elements, *shape))
    out[:, t.interval_elements] = chained(maps[:, fine.interval_elements].reshape(B, t.intervals, 2, *shape))
    out[:, t.closed_elements] = maps[:, fine.closed_elements]
    return out


def estimates_of_many(
    t: Transcription, u: Array, settings: Settings, goals: Array, border: Array
) -> tuple[Array, Solutions]:
    """Errors of linear functionals, from solutions on the mesh that they were computed on.

    t, u, settings: transcription, (B, size) solutions and settings; goals, border: as in `errors_of_many`.
    Returns as `errors_of_many`.
    """
    fine, finer, halves = halved_for_many(t, u, settings)
    return errors_of_many(t, fine, finer, halves, linearise_many(fine, finer, halves), goals, border)
