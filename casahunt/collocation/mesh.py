"""Error of a collocation solution, and the mesh that makes it as small as asked for.

The error of what the user reads (period, amplitude) is found with an adjoint.  Halve every interval, put
the solution u on the refined mesh by interpolation, and let r_e be what the refined equations leave
there, stages eliminated.  With J^T psi = c for the linear functional q = c . y of the node system,

    q(exact) - q(u) = sum_e psi_e . r_e,

to first order in an error that the refined mesh makes 2^(2d) times smaller.  The sum is the error
estimate; its terms say which interval is to blame and place the next mesh.  An interval far up-stream of an unstable
direction weighs exactly as much as it matters, which no local monitor can know.

Two things can make that sum too small, both where the field changes suddenly inside an interval.  Gauss collocation is
far more accurate at the nodes (h^2d) than inside (h^(d+1)): r_e, a small number, no longer says how wrong the inside
is, whose square may be larger.  And what happens between two points of the refined mesh, such as a change in
the first hundredth of an interval, none of its equations sees.  So an estimate that is about to be believed is compared
with what a Newton step inside each interval leaves, psi_e . r'_e with

    r' = x + h T sum_m w_m f(X(t_m)) - x+        after the step, by a quadrature graded to the ends of the interval,

for the price of some values of the field.  It is taken as if it arose where it hurts more, at the start or at the end
of its half, and added without regard to signs: a bound in practice, and as a rule far smaller than the sum above.

A second measure keeps the solution itself presentable between the nodes: the last Legendre coefficient
of each interval in units of the state scale, bounded by `shape_limit`.

Symbols: n states, d stages, N intervals, E elements, P phases.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from .interval import point_map
from .scheme import Kind, scheme
from .transcription import Linearisation, Setting, Transcription, transcribe

Array = np.ndarray

SHAPE = 1e-3
"""Largest last Legendre coefficient: the polynomial inside an interval is then good to about 1e-4."""
KINK_POWER = 1 / 3
"""In a mode with a kink the blame of an interval falls no faster than h^3."""
SAFETY = 0.01
"""The next mesh aims at this part of the tolerance.  A fifth more intervals than at 0.1, and on walks along which
fast slips move about on their mesh a quarter fewer changes of it: 5 to 15 % less time."""
ROUNDING = 4 * np.finfo(float).eps
SMALL = 0.1
"""The error of an amplitude below this part of the largest value of its state is measured by that: it may be zero."""

FINE_POINTS, GRADED = 6, 0.125
"""Gauss points in either part of half an interval, of which the outer part is an eighth."""


@dataclass(frozen=True)
class Estimate:
    """Error estimates of one solution.

    Attributes
    ----------
    period, amplitude : relative errors.
    parameter : absolute error of lambda under a border row; 0 where it is held fixed.
    indicators : (N,) relative error of period, amplitude or parameter that each interval is to blame for.
    shape : (N,) last Legendre coefficients in units of the scale.
    """

    period: float
    amplitude: float
    parameter: float
    indicators: Array
    shape: Array

    @property
    def error(self) -> float:
        """The largest of the errors."""
        return float(np.max([self.period, self.amplitude, self.parameter]))


def phase_breaks(t: Transcription, fractions: Array) -> list[Array]:
    """Interval boundaries (N_k + 1,) of each collocated phase, from the (N,) fractions."""
    out = []
    for k, count in enumerate(t.counts):
        if count:
            edges = np.concatenate([[0.0], np.cumsum(fractions[t.phase_intervals(k)])])
            out.append(edges / edges[-1])
    return out


def transfer(
    t: Transcription, u: Array, fractions: Array, breaks: list[Array], target: Transcription | None = None
) -> tuple[Transcription, Array, Array]:
    """Put a solution on another mesh by its own collocation polynomials.

    Parameters
    ----------
    t, u, fractions
        the solution and its mesh.
    breaks
        new boundaries of each collocated phase.
    target
        the transcription to use; default the one of the same cycle and scheme.

    Returns
    -------
    (transcription, u, fractions) on the new mesh.
    """
    counts, supply = [], iter(breaks)
    for count in t.counts:
        counts.append(next(supply).size - 1 if count else 0)
    new = target or transcribe(t.cycle, tuple(counts), t.degree, t.kind)
    old_w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)
    old_nodes = t.nodes_of(u)
    w = np.empty((new.intervals, new.degree + 1, new.n))
    nodes = np.empty((new.elements + 1, new.n))
    nodes[new.closed_elements] = old_nodes[t.closed_elements]
    nodes[-1] = old_nodes[-1]
    old_breaks = phase_breaks(t, fractions)
    j = 0
    for k, count in enumerate(t.counts):
        if not count:
            continue
        old, fresh = old_breaks[j], breaks[j]
        times = fresh[:-1, None] + np.diff(fresh)[:, None] * new.scheme.points
        w[new.phase_intervals(k)] = _evaluate(t, old_w[t.phase_intervals(k)], old, times)
        j += 1
    nodes[new.interval_elements] = w[:, 0]
    # A phase starts where the one before it ended, exactly: interpolation must not move an event.
    nodes[new.phase_start] = old_nodes[t.phase_start]
    nodes[new.phase_end] = old_nodes[t.phase_end]
    u_new = new.pack(w.reshape(new.intervals, new.rows), nodes, t.durations_of(u))
    return new, u_new, np.concatenate([np.zeros(0), *(np.diff(b) for b in breaks)])


def on_halved_mesh(t: Transcription, u: Array, fractions: Array) -> tuple[Transcription, Array, Array]:
    """(transcription, u, fractions) with every interval cut in two: `transfer` by one fixed matrix."""
    fine = transcribe(t.cycle, tuple(2 * count for count in t.counts), t.degree, t.kind)
    old_nodes = t.nodes_of(u)
    w = np.einsum("hkj,ijn->ihkn", t.scheme.halves, t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n))
    w = w.reshape(fine.intervals, fine.rows)
    nodes = np.empty((fine.elements + 1, t.n))
    nodes[fine.interval_elements] = w[:, : t.n]
    nodes[fine.closed_elements] = old_nodes[t.closed_elements]
    nodes[-1] = old_nodes[-1]
    # A phase starts where the one before it ended, exactly: interpolation must not move an event.
    nodes[fine.phase_start] = old_nodes[t.phase_start]
    nodes[fine.phase_end] = old_nodes[t.phase_end]
    return fine, fine.pack(w, nodes, t.durations_of(u)), np.repeat(fractions / 2, 2)


def _evaluate(t: Transcription, w: Array, breaks: Array, times: Array) -> Array:
    """States (*times.shape, n) of one phase at phase fractions `times`, from its intervals (N_k, d + 1, n)."""
    flat = times.ravel()
    i = np.clip(np.searchsorted(breaks, flat, side="right") - 1, 0, len(w) - 1)
    local = (flat - breaks[i]) / (breaks[i + 1] - breaks[i])
    matrix = t.scheme.interpolation(local)
    return np.einsum("kj,kjn->kn", matrix, w[i]).reshape(*times.shape, t.n)


def evaluate_phase(t: Transcription, u: Array, fractions: Array, phase: int, times: Array) -> Array:
    """Scaled states (m, n) of a collocated phase at the fractions `times` (m,) of its duration."""
    collocated = [k for k, count in enumerate(t.counts) if count]
    breaks = phase_breaks(t, fractions)[collocated.index(phase)]
    w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)[t.phase_intervals(phase)]
    return _evaluate(t, w, breaks, times)


def halved(breaks: list[Array]) -> list[Array]:
    """Boundaries with every interval cut in two."""
    return [np.sort(np.concatenate([b, (b[1:] + b[:-1]) / 2])) for b in breaks]


def quartered_where(t: Transcription, fractions: Array, where: Array) -> list[Array]:
    """Boundaries with the intervals of the mask `where` (N,) cut in four."""
    out = []
    for k, b in zip([k for k, c in enumerate(t.counts) if c], phase_breaks(t, fractions), strict=True):
        chosen = np.flatnonzero(where[t.phase_intervals(k)])
        inner = b[chosen, None] + np.diff(b)[chosen, None] * np.array([0.25, 0.5, 0.75])
        out.append(np.sort(np.concatenate([b, inner.ravel()])))
    return out


def amplitude_row(t: Transcription, u: Array) -> tuple[float, int]:
    """(largest |measured state| over the phase ends, its place among the (P + 1) phase-end nodes)."""
    values = np.abs(t.nodes_of(u)[t.phase_ends, t.cycle.measured])
    best = int(np.argmax(values))
    return float(values[best]), best


def estimate(
    t: Transcription, u: Array, setting: Setting, *, border: Array | None = None, believed: float = np.inf
) -> Estimate:
    """Error estimates of a converged solution u.

    Parameters
    ----------
    t, u, setting
        the solution.
    border
        border row under which the solution was computed; default lambda fixed.
    believed
        first-order estimates up to this get what they overlook added; larger ones only place the next mesh.

    Period and amplitude are those of the full cycle; relative errors do not care.
    """
    fine, u_fine, fractions = on_halved_mesh(t, u, setting.fractions)
    halves = replace(setting, fractions=fractions)
    lin = fine.linearise(u_fine, halves)
    maps = _joined(t, fine, lin.maps)
    row = t.system.border(parameter=1.0) if border is None else border
    matrix = t.system.nonzeros(maps, lin.closure, lin.events, row)
    rhs = np.concatenate([maps[:, :, 0].ravel(), -lin.closure_residual, -lin.events[0], [0.0]])
    E, n, P = t.elements, t.n, t.phases
    amplitude, place = amplitude_row(t, u)
    goals = np.zeros((2 if border is None else 3, t.system.size))
    goals[0, (E + 1) * n : (E + 1) * n + P] = 1 / float(np.sum(t.durations_of(u)))
    size = np.abs(t.intervals_of(u).reshape(-1, n)[:, t.cycle.measured]).max(initial=amplitude)
    goals[1, t.phase_ends[place] * n + t.cycle.measured] = 1 / max(amplitude, SMALL * size)
    if border is not None:
        goals[2, -1] = 1.0
    psi = t.system.solve_transposed(matrix, goals)
    total = psi @ rhs
    weights = psi[:, : E * n].reshape(-1, E, n)
    per_element = np.abs((weights * maps[:, :, 0]).sum(axis=2))
    errors = np.abs(total)
    if t.intervals and errors.max() <= believed:
        left = _left_by_a_step(fine, u_fine, lin, halves).reshape(-1, 4, n)
        terms = np.abs(left @ weights[:, t.interval_elements].transpose(1, 2, 0))
        overlooked = (np.maximum(terms[:, 0], terms[:, 1]) + np.maximum(terms[:, 2], terms[:, 3])).T
        per_element[:, t.interval_elements] += overlooked
        errors += overlooked.sum(axis=1)
    errors += ROUNDING * np.linalg.norm(psi[:, : E * n], axis=1)
    period, amplitude, parameter = (*map(float, errors), 0.0)[:3]
    blame = per_element.max(axis=0)[t.interval_elements]
    return Estimate(period, amplitude, parameter, blame, shape(t, u))


@lru_cache(maxsize=32)
def _fine_rule(degree: int, kind: Kind) -> tuple[Array, Array]:
    """Quadrature on the halves of an interval, graded to its ends: weights (2, m), interpolation (2, m, d + 1)."""
    nodes, weights = legendre.leggauss(FINE_POINTS)
    nodes, weights = (nodes + 1) / 2, weights / 2
    points = np.concatenate([GRADED * nodes, GRADED + (1 - GRADED) * nodes])
    weights = np.concatenate([GRADED * weights, (1 - GRADED) * weights])
    s = scheme(degree, kind)
    return np.array([weights, weights]), np.array([s.interpolation(points), s.interpolation(1 - points)])


def _left_by_a_step(fine: Transcription, u: Array, lin: Linearisation, setting: Setting) -> Array:
    """r' (N, 2, 2, n) of both halves of every interval, carried to its end; the start of the interval is held.

    Once as it would be if it arose at the end of its half, once as if at its start.
    """
    n, count, d = fine.n, fine.intervals // 2, fine.degree
    w = fine.intervals_of(u).reshape(count, 2, d + 1, n).copy()
    ends = fine.nodes_of(u)[fine.interval_elements + 1].reshape(count, 2, n)
    maps = lin.maps[fine.interval_elements].reshape(count, 2, n, n + 3)
    update = lin.eliminated.reshape(count, 2, d * n, n + 3)
    middle, through = maps[:, 0, :, 0], maps[..., 1 : n + 1]
    second = through[:, 1]
    w[:, :, 1:] -= update[..., 0].reshape(count, 2, d, n)
    w[:, 1, 1:] -= (update[:, 1, :, 1 : n + 1] @ middle[:, :, None]).reshape(count, d, n)
    w[:, 1, 0] += middle
    ends[:, 0] += middle
    ends[:, 1] += maps[:, 1, :, 0] + (second @ middle[:, :, None])[:, :, 0]
    weights, rule = _fine_rule(d, fine.kind)
    x = np.matmul(rule, w).reshape(fine.intervals, -1, n)
    f = np.empty_like(x)
    for field, members in fine.groups:
        at = point_map(field, n, setting.p.size)
        signs = np.repeat(fine.signs[members], x.shape[1])
        f[members] = at(x[members].reshape(-1, n), signs, setting.p, setting.scale).reshape(members.size, -1, n)
    step = setting.fractions * fine.durations_of(u)[fine.phase_of[fine.interval_elements]]
    integrals = (weights[:, None] @ f.reshape(count, 2, -1, n))[:, :, 0] * step.reshape(count, 2, 1)
    left = w[:, :, 0] + integrals - ends
    late_early = np.stack([left, (through @ left[..., None])[..., 0]], axis=2)
    late_early[:, 0] = late_early[:, 0] @ second.transpose(0, 2, 1)
    return late_early


def _joined(t: Transcription, fine: Transcription, maps: Array) -> Array:
    """(E, n, n + 3) maps over the intervals of t from those over their two halves: the middle node eliminated."""
    n = t.n
    halves = maps[fine.interval_elements].reshape(t.intervals, 2, n, n + 3)
    first, second = halves[:, 0], halves[:, 1]
    through = second[:, :, 1 : n + 1] @ first
    through[:, :, 0] += second[:, :, 0]
    through[:, :, n + 1 :] += second[:, :, n + 1 :]
    out = np.empty((t.elements, n, n + 3))
    out[t.interval_elements] = through
    out[t.closed_elements] = maps[fine.closed_elements]
    return out


def shape_limit(tol: float) -> float:
    """Last Legendre coefficients that a mesh aims at: the solution presentable between its nodes, and better
    where the tolerance is tight."""
    return min(SHAPE, float(np.sqrt(tol)))


def shape(t: Transcription, u: Array) -> Array:
    """(N,) last Legendre coefficient of every interval, in units of the state scale."""
    w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)
    return np.max(np.abs(np.einsum("j,ijn->in", t.scheme.last_mode, w)), axis=1)


COARSENING = (0.1, 0.3, 1.0)
"""How many intervals may stand in place of one, at least, at the first, second and any later change of a mesh.

Blame is measured on the mesh at hand; an interval without blame may get it when it grows.  Meshes that keep
coarsening go round in circles."""


def better_breaks(t: Transcription, fractions: Array, e: Estimate, tol: float, changes: int = 0) -> list[Array]:
    """The boundaries of the next mesh: place and number of intervals for the tolerance.

    The blame of an interval behaves like h^(order + 1): its length is changed by the power that would
    bring it to its share of the tolerance, by at most 4 at a time when it shrinks and `COARSENING` when it
    grows, where `changes` says how often this mesh has been changed already.
    """
    smooth = np.array([t.cycle.phases[k].mode.smooth for k in t.phase_of[t.interval_elements]])
    power = np.where(smooth, 1.0 / (t.scheme.order + 1), KINK_POWER)
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
    return np.interp(np.linspace(0, load[-1], count + 1), load, breaks)
