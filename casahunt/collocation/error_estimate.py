"""Error of a collocation solution, by an adjoint.

The error of what the user reads (period, amplitude) is found with an adjoint.  Halve every interval, put
the solution u on the refined mesh by interpolation, and let r_e be what the refined equations leave
there, stages eliminated.  With J^T psi = c for the linear functional q = c . y of the node system,

    q(exact) - q(u) = sum_e psi_e . r_e,

to first order, the exact solution being that of the refined mesh.  The sum is the error estimate; its terms say which
interval contributes and place the next mesh.  An interval far up-stream of an unstable direction weighs exactly as much
as it matters, which no local monitor can know.

Three things can make that sum too small.  The refined mesh has an error itself: of each term a part (`left_on_halved`),
without regard to signs, since terms that cancel on one mesh need not on the next.  In stiff modes and at kinks that may
be several times the term: the few intervals that matter are cut in four there, and of what that changes
half is added.  The others arise where the field changes suddenly inside an interval.  Gauss collocation is far more
accurate at the nodes (h^2d) than inside (h^(d+1)): r_e, a small number, no longer says how wrong the inside is, whose
square may be larger.  And what happens between two points of the refined mesh, such as a change in the first hundredth
of an interval, none of its equations sees.  So an estimate that is about to be accepted gets the first added, and what
a Newton step leaves inside each interval, psi_e . r'_e with

    r' = x + h T sum_m w_m f(X(t_m)) - x+        after the step, by a quadrature graded to the ends of the interval,

for the price of some values of the field.  The step is that of the whole cycle, so that r' holds what is of second
order in it too.  It is taken as if it arose where it hurts more, at the start or at the end of its half, and added
without regard to signs: a bound in practice, and as a rule far smaller than the sum above.

One solution has no axis of members, many have theirs first (...): what is said of one holds for each.

Symbols: n states, d stages, N intervals, E elements, P phases, k functionals, y unknowns of the node system.

Intervals whose halves do not tell their error, cut in four.

An interval's map from its start to its end, stages eliminated, is known better from parts of it,

    x+ = r + A x + B dT + C dlambda      from one part to the next,      r = r_2 + A_2 r_1,  A = A_2 A_1,  and so on,

and the residual r of the parts is what the interval contributes to the error.  Two parts suffice
where the solution is smooth.  In stiff modes, and where the field has kinks, something may happen within a part of an
interval that its halves hardly see: there they say 3e-7, and four, eight and thirty-two parts say 1.2e-6.  It is a few
intervals of a mesh that matter, so these are cut in four; what changes then tells how far the halves could be accepted.

Symbols: m intervals, n states, d stages, R = n (d + 1), c = n + 3 columns of [r | A | B | C], or more of C.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from .ensemble_points import eliminate_many
from .mesh import on_halved_mesh, shape, sizes_of_states
from .node_system import Linearisation
from .scheme import Kind, scheme
from .transcription import Setting, Transcription, settings_of

QUARTERS = 4


def chained(maps: Array) -> Array:
    """The maps over all parts of intervals from those over each, the nodes between them eliminated.

    maps: (..., parts, n, c) of [r | A | B | C]. Returns (..., n, c).
    """
    n, through = maps.shape[-2], maps[..., 0, :, :]
    for k in range(1, maps.shape[-3]):
        part, before = maps[..., k, :, :], through
        through = np.matmul(part[..., 1 : n + 1], before)
        through[..., 0] += part[..., 0]
        through[..., n + 1 :] += part[..., n + 1 :]
    return through


def maps_over_quarters(fine: Transcription, u: Array, s: Setting, members: Array, chosen: Array) -> Array:
    """The maps over some intervals of some members, from four parts of each.

    fine, u, s: transcription, (B, size) unknowns and settings of the mesh with halved intervals; members, chosen: (m,)
    whose, and which intervals before they were halved. Returns (m, n, c).
    """
    first = 2 * chosen
    halves = fine.intervals_of(u).reshape(len(u), -1, 2, fine.rows)[members, chosen]
    behind = u[members[:, None], fine.node_index[fine.interval_elements[first + 1] + 1]]
    w, following = quarters(fine, halves, behind)
    duration = u[members, -fine.phases + fine.phase_of[fine.interval_elements[first]], None]
    rows = w, following, np.repeat(duration, QUARTERS, 1), np.repeat(s.fractions[members, first, None] / 2, QUARTERS, 1)
    numbers = s.p[members], s.directions[members], s.scale[members]
    out = np.empty((chosen.size, fine.n, fine.n + 2 + s.directions.shape[1]))
    for mode, intervals in fine.modes:
        own = np.flatnonzero(np.isin(first, intervals))
        if own.size:
            signs = np.full(QUARTERS, mode.sign)
            some, of = [each[own] for each in rows], [each[own] for each in numbers]
            out[own] = chained(eliminate_many(mode.field, fine.kind, signs, some, of).maps)
    return out


def quarters(fine: Transcription, halves: Array, ends: Array) -> tuple[Array, Array]:
    """The halves of halved intervals.

    halves, ends: (m, 2, R) starts and stages of the halves of some intervals, and (m, n) nodes behind these.
    Returns (m, 4, d + 1, n) starts and stages, and the nodes (m, 4, n) behind them.
    """
    w = halves.reshape(-1, 2, 1, fine.degree + 1, fine.n)
    w = np.matmul(fine.scheme.halves.reshape(2, fine.degree + 1, -1), w).reshape(len(w), QUARTERS, *w.shape[3:])
    return w, np.concatenate([w[:, 1:, 0], ends[:, None]], axis=1)


Array = np.ndarray
Start = tuple[Transcription, Array, Setting]
Halved = tuple[Transcription, Array, Setting, Linearisation]
"""Solutions on a mesh with halved intervals, and the equations linearised there."""

ROUNDING = 4 * np.finfo(float).eps
"""Relative: of the few operations that make a period, an amplitude or a parameter from the unknowns."""
SMALL_AMPLITUDE = 0.1
"""The error of an amplitude below this part of the largest value of its state is measured by that: it may be zero."""

LEFT_ON_HALVED, LEFT_OF_LOW_ORDER = 1 / 16, 1 / 4
"""Part of the error contribution of an interval that its halves keep: that of order four, below the order of the
schemes, and of order two, to which stiffness and kinks reduce it.  Measured on 60 cycles at five tolerances: at most
0.02; in stiff modes at most 0.24, but for one solution in thirty, where up to 11: intervals in which something happens
that halves do not show.  Those that matter are therefore cut in four."""
MATTERS, LEFT_OF_CHANGE = 1 / 32, 1 / 2
"""Intervals of low order that contribute more than this part of the error are cut in four, some four in sixty;
part that is left of what this changes."""
FINE_POINTS, GRADED = 6, 0.125
"""Gauss points in either part of half an interval, of which the outer part is an eighth."""
ANYWHERE = 2.0
"""What a Newton step leaves inside half an interval is taken as if it arose at its start or its end, whichever hurts
more, times this: it may hurt more in between (measured: up to 1.6 times)."""


@dataclass(frozen=True)
class Estimate:
    """Error estimates of one solution.

    Attributes
    ----------
    period, amplitude : relative errors.
    parameter : absolute error of lambda under a border row; 0 where it is held fixed.
    indicators : (N,) relative error of period, amplitude or parameter that each interval contributes.
    shape : (N,) last Legendre coefficients in units of the scale.
    measured : the amplitude itself, in physical units.
    better : the solution after a Newton step on the halved mesh: transcription, unknowns, setting; None where that was
        not made.
    """

    period: float
    amplitude: float
    parameter: float
    indicators: Array
    shape: Array
    measured: float = 0.0
    better: Start | None = None

    @property
    def error(self) -> float:
        """The largest of the errors."""
        return float(np.max([self.period, self.amplitude, self.parameter]))


@dataclass(frozen=True, eq=False)
class Functional:
    """Something measured of a solution, linearised.

    Attributes
    ----------
    value : what it is, in physical units.
    row : (y,) its change with the unknowns of the node system.
    change : by how much it changes where all states change by their sizes.
    """

    value: float
    row: Array
    change: float

    @property
    def size(self) -> float:
        """What its error is relative to; 1 where it is zero and nothing moves it: then it has no error."""
        return max(abs(self.value), SMALL_AMPLITUDE * self.change) or 1.0


def amplitude_row(t: Transcription, u: Array) -> tuple[float, int]:
    """The largest |measured state| over the phase ends, where the cycle measures a state there.

    Returns its value, scaled, and its place among the (P + 1) phase-end nodes.
    """
    assert isinstance(t.cycle.measured, int)
    values = np.abs(t.nodes_of(u)[t.phase_ends, t.cycle.measured])
    best = int(np.argmax(values))
    return float(values[best]), best


def estimate(
    t: Transcription,
    u: Array,
    setting: Setting,
    *,
    border: Array | None = None,
    accepted: float = np.inf,
    amplitude: Functional | None = None,
) -> Estimate:
    """Error estimates of a converged solution u.

    border: border row under which the solution was computed; default lambda fixed; accepted: first-order estimates up
    to this get what they overlook added; larger ones only place the next mesh; amplitude: what is measured; default the
    cycle's state at the phase ends.
    Returns estimate; period and amplitude are those of the full cycle, relative errors do not care.
    """
    E, n, P = t.elements, t.n, t.phases
    goals = np.zeros((2 if border is None else 3, t.system.size))
    goals[0, (E + 1) * n : (E + 1) * n + P] = 1 / float(np.sum(t.durations_of(u)))
    if amplitude is None:
        measured = _at_phase_ends(t, u, setting, goals[1])
    else:
        measured = amplitude.value
        goals[1] = amplitude.row / amplitude.size
    if border is not None:
        goals[2, -1] = 1.0
    errors, per_element, better = functional_errors(t, u, setting, goals, border=border, accepted=accepted)
    period, relative, parameter = (*map(float, errors), 0.0)[:3]
    indicators = per_element.max(axis=0)[t.interval_elements]
    return Estimate(period, relative, parameter, indicators, shape(t, u), measured, better)


def _at_phase_ends(t: Transcription, u: Array, setting: Setting, goal: Array) -> float:
    """The amplitude as the cycle's state at the phase ends; its relative error as a functional into `goal`."""
    i, (amplitude, place) = t.cycle.measured, amplitude_row(t, u)
    assert isinstance(i, int)
    size = float(sizes_of_states(t, u, setting)[i])
    goal[t.phase_ends[place] * t.n + i] = 1 / max(amplitude, SMALL_AMPLITUDE * size)
    return amplitude * float(setting.scale[i])


def functional_errors(
    t: Transcription,
    u: Array,
    setting: Setting,
    goals: Array,
    *,
    border: Array | None = None,
    accepted: float = np.inf,
    halved: Halved | None = None,
) -> tuple[Array, Array, Start | None]:
    """Errors of linear functionals of the node system at converged solutions u (..., size), of one member or of many.

    goals: (..., k, y) the functionals; border: (..., .) as in `estimate`; accepted: as there, of no error larger than
    it; halved: the solutions on the mesh with halved intervals (`on_halves`), where they are at hand.
    Returns errors (..., k) and the share of each element in them (..., k, E), absolute; and the solutions after a
    Newton step on the halved mesh, where that is looked at.
    """
    with np.errstate(all="ignore"):
        return _errors(t, halved or on_halves(t, u, setting), goals, border, accepted)


def on_halves(t: Transcription, u: Array, setting: Setting) -> Halved:
    """Solutions (..., size) with every interval cut in two, and the equations linearised there."""
    fine, finer, fractions = on_halved_mesh(t, u, setting.fractions)
    halves = Setting(fractions, setting.p, setting.scale, setting.dp, setting.others)
    return fine, finer, halves, fine.linearise(finer, halves)


def _errors(
    t: Transcription, halved: Halved, goals: Array, border: Array | None, accepted: float
) -> tuple[Array, Array, Start | None]:
    """`functional_errors`.

    Arrays are laid out as they are written, and sums are products with ones: the additions come in the order of the
    memory, and no member's may depend on how many there are.
    """
    fine, finer, halves, lin = halved
    joined, better = lin.over(t, _joined(t, fine, lin.maps)), None
    if border is None:
        border = t.system.border(parameter=1.0)
        border = border if finer.ndim == 1 else np.repeat(border[None], len(finer), axis=0)
    matrix, rhs = joined.matrix(border), joined.rhs()
    errors, weights, contributions = _contributions(joined, goals, matrix, rhs)
    per_element = np.abs(contributions)
    if not errors.max() > accepted:
        y = t.system.solve(matrix, rhs)
        better = fine, finer + lin.expand(_with_middles(t, fine, lin, y), 1.0), halves.moved(y[..., -1])
        if t.intervals:
            first = errors, weights, contributions
            errors, weights = _with_overlooked(t, halved, joined, goals, border, better, first, per_element)
    flat = weights.reshape(*weights.shape[:-2], 1, -1)
    return errors + ROUNDING * np.sqrt((flat @ flat.swapaxes(-1, -2))[..., 0, 0]), per_element, better


def _with_overlooked(
    t: Transcription,
    halved: Halved,
    joined: Linearisation,
    goals: Array,
    border: Array,
    better: Start,
    first: tuple[Array, Array, Array],
    per_element: Array,
) -> tuple[Array, Array]:
    """Errors (..., k) with what `first` of `_contributions` overlooks, which goes to `per_element` too, and psi."""
    (errors, weights, contributions), own, ones = first, t.interval_elements, np.ones(t.intervals)
    left, inside = _left_by_a_step(*better, halved[3]), weights[..., t.inside, :]
    terms = np.abs(left @ inside.swapaxes(-3, -2).swapaxes(-2, -1))
    overlooked = ANYWHERE * (
        np.maximum(terms[..., 0, :], terms[..., 1, :]) + np.maximum(terms[..., 2, :], terms[..., 3, :])
    )
    by_interval = per_element[..., t.inside]
    unseen, over = left_on_halved(t) * by_interval, ones @ overlooked
    where = to_be_quartered(t, by_interval, errors + over + unseen @ ones)
    if where.any():
        # Into the maps (..., E, n, c) those of the intervals `where` (..., N) from four parts of each
        fine, finer, halves, _ = halved
        if where.ndim == 1:
            finer, halves = finer[None], settings_of(halves, halves.p[None], halves.dp[None])
        members, chosen = np.nonzero(np.atleast_2d(where))
        found = maps_over_quarters(fine, finer, halves, members, chosen)
        joined.maps.reshape(len(finer), *joined.maps.shape[-3:])[members, t.interval_elements[chosen]] = found
        errors, weights, again = _contributions(joined, goals, joined.matrix(border), joined.rhs())
        np.maximum(per_element, np.abs(again), out=per_element)
        on_quarters = left_on_quarters(contributions.take(own, axis=-1), again.take(own, axis=-1))
        unseen = np.where(where[..., None, :], on_quarters, unseen)
    per_element[..., own] += unseen + overlooked.swapaxes(-1, -2)
    return errors + unseen @ ones + over, weights


def _contributions(joined: Linearisation, goals: Array, matrix: Array, rhs: Array) -> tuple[Array, Array, Array]:
    """First-order errors (..., k) of functionals; psi (..., k, E, n), and psi . r (..., k, E)."""
    E, n = joined.maps.shape[-3:-1]
    psi = joined.transcription.system.solve_transposed(matrix, goals)
    weights = np.ascontiguousarray(psi[..., : E * n]).reshape(*psi.shape[:-1], E, n)
    shares = (weights * joined.maps[..., None, :, :, 0]).sum(axis=-1)
    return np.abs((psi @ rhs[..., None])[..., 0]), weights, shares


def left_on_halved(t: Transcription) -> Array:
    """(N,) part of the error contribution of every interval that its halves keep."""
    return np.where(t.low_order, LEFT_OF_LOW_ORDER, LEFT_ON_HALVED)


def to_be_quartered(t: Transcription, contributions: Array, errors: Array) -> Array:
    """Which intervals matter, and are such that their halves may not tell by how much.

    contributions, errors: (..., k, N) error contributions of its intervals for functionals, and (..., k) errors.
    Returns (..., N) bool.
    """
    return t.low_order & (contributions > np.maximum(MATTERS * errors, ROUNDING)[..., None]).any(axis=-2)


def left_on_quarters(on_halves: Array, on_quarters: Array) -> Array:
    """What quarters of intervals leave.

    on_halves, on_quarters: (..., m) error contributions of intervals, by their halves and by their quarters. Returns
    (..., m).
    """
    return LEFT_OF_CHANGE * np.abs(on_quarters - on_halves) + LEFT_ON_HALVED * np.abs(on_quarters)


@lru_cache(maxsize=32)
def fine_rule(degree: int, kind: Kind) -> tuple[Array, Array]:
    """Quadrature on the halves of an interval, graded to its ends.

    Returns weights (2, m), and interpolation (2, m, d + 1).
    """
    nodes, weights = legendre.leggauss(FINE_POINTS)
    nodes, weights = (nodes + 1) / 2, weights / 2
    points = np.concatenate([GRADED * nodes, GRADED + (1 - GRADED) * nodes])
    weights = np.concatenate([GRADED * weights, (1 - GRADED) * weights])
    s = scheme(degree, kind)
    return np.array([weights, weights]), np.array([s.interpolation(points), s.interpolation(1 - points)])


def _with_middles(t: Transcription, fine: Transcription, lin: Linearisation, y: Array) -> Array:
    """A solution y (..., y) of the node system of t, with the nodes in the middles of its intervals."""
    n, ends, lead = t.n, (t.elements + 1) * t.n, y.shape[:-1]
    coarse, first = y[..., :ends].reshape(*lead, -1, n), fine.interval_elements[::2]
    nodes = np.empty((*lead, fine.elements + 1, n))
    starts = coarse[..., t.inside, :]
    nodes[..., first, :], nodes[..., -1, :] = starts, coarse[..., -1, :]
    nodes[..., fine.closed_forms, :] = coarse[..., t.closed_forms, :]
    known = np.empty((*lead, t.intervals, n + 3, 1))
    known[..., 0, :], known[..., 1 : n + 1, 0], known[..., n + 2, :] = 1.0, starts, y[..., None, -1:]
    known[..., n + 1, 0] = y[..., ends:-1].take(t.phase_of_intervals, axis=-1)
    nodes[..., first + 1, :] = (lin.maps.take(first, axis=-3)[..., : n + 3] @ known)[..., 0]
    return np.concatenate([nodes.reshape(*lead, -1), y[..., ends:]], axis=-1)


def _left_by_a_step(fine: Transcription, u: Array, setting: Setting, lin: Linearisation) -> Array:
    """r' (..., N, 4, n) of both halves of every interval after the Newton step, carried to the end of the interval.

    Once as it would be if it arose at the end of its half, once as if at its start.
    """
    n, d, shape = fine.n, fine.degree, (*u.shape[:-1], fine.intervals // 2, 2)
    w = fine.intervals_of(u).reshape(*shape, d + 1, n)
    ends = fine.nodes_of(u)[..., fine.behind_intervals, :].reshape(*shape, n)
    weights, rule = fine_rule(d, fine.kind)
    x = (rule @ w).reshape(*u.shape[:-1], fine.intervals, -1, n)
    step = setting.fractions * fine.durations_of(u).take(fine.phase_of_intervals, axis=-1)
    integrals = (weights[:, None] @ fine.fields(x, setting).reshape(*shape, -1, n))[..., 0, :]
    left = w[..., 0, :] + integrals * step.reshape(*shape, 1) - ends
    through = lin.maps[..., fine.inside, :, :].reshape(*shape, n, -1)[..., 1 : n + 1]
    late_early = np.stack([left, (through @ left[..., None])[..., 0]], axis=-2)
    late_early[..., 0, :, :] = late_early[..., 0, :, :] @ through[..., 1, :, :].swapaxes(-1, -2)
    return late_early.reshape(*shape[:-1], 4, n)


def _joined(t: Transcription, fine: Transcription, maps: Array) -> Array:
    """(..., E, n, c) maps over the intervals of t from those over their two halves."""
    lead, shape = maps.shape[:-3], maps.shape[-2:]
    out = np.empty((*lead, t.elements, *shape))
    halves = maps[..., fine.inside, :, :].reshape(*lead, t.intervals, 2, *shape)
    out[..., t.inside, :, :] = chained(halves)
    out[..., t.closed_forms, :, :] = maps[..., fine.closed_forms, :, :]
    return out
