"""Error of a collocation solution, by an adjoint.

The error of what the user reads (period, amplitude) is found with an adjoint.  Halve every interval, put
the solution u on the refined mesh by interpolation, and let r_e be what the refined equations leave
there, stages eliminated.  With J^T psi = c for the linear functional q = c . y of the node system,

    q(exact) - q(u) = sum_e psi_e . r_e,

to first order, the exact solution being that of the refined mesh.  The sum is the error estimate; its terms say which
interval is to blame and place the next mesh.  An interval far up-stream of an unstable direction weighs exactly as much
as it matters, which no local monitor can know.

Three things can make that sum too small.  The refined mesh has an error itself: of each term a part (`left_on_halved`),
without regard to signs, since terms that cancel on one mesh need not on the next.  In stiff modes and at kinks that may
be several times the term: the few intervals that matter are cut in four there (quarters.py), and of what that changes
half is added.  The others arise where the field changes suddenly inside an interval.  Gauss collocation is far more
accurate at the nodes (h^2d) than inside (h^(d+1)): r_e, a small number, no longer says how wrong the inside is, whose
square may be larger.  And what happens between two points of the refined mesh, such as a change in the first hundredth
of an interval, none of its equations sees.  So an estimate that is about to be believed gets the first added, and what
a Newton step leaves inside each interval, psi_e . r'_e with

    r' = x + h T sum_m w_m f(X(t_m)) - x+        after the step, by a quadrature graded to the ends of the interval,

for the price of some values of the field.  The step is that of the whole cycle, so that r' holds what is of second
order in it too.  It is taken as if it arose where it hurts more, at the start or at the end of its half, and added
without regard to signs: a bound in practice, and as a rule far smaller than the sum above.

Symbols: n states, d stages, N intervals, E elements, P phases.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from .interval import points_map
from .linearisation import Linearisation
from .mesh import on_halved_mesh, shape, sizes_of_states
from .quarters import chained, maps_over_quarters
from .scheme import Kind, scheme
from .transcription import Setting, Transcription

Array = np.ndarray
Start = tuple[Transcription, Array, Setting]

ROUNDING = 4 * np.finfo(float).eps
SMALL_AMPLITUDE = 0.1
"""The error of an amplitude below this part of the largest value of its state is measured by that: it may be zero."""

LEFT_ON_HALVED, LEFT_OF_LOW_ORDER = 1 / 16, 1 / 4
"""Part of the blame of an interval that its halves keep: that of order four, below the order of the schemes, and of
order two, to which stiffness and kinks reduce it.  Measured on 60 cycles at five tolerances: at most 0.02; in
stiff modes at most 0.24, but for one solution in thirty, where up to 11: intervals in which something happens that
halves do not show.  Those that matter are therefore cut in four."""
MATTERS, LEFT_OF_CHANGE = 1 / 32, 1 / 2
"""Intervals of low order that are to blame for more than this part of the error are cut in four, some four in sixty;
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
    indicators : (N,) relative error of period, amplitude or parameter that each interval is to blame for.
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
    believed: float = np.inf,
    amplitude: Functional | None = None,
) -> Estimate:
    """Error estimates of a converged solution u.

    border: border row under which the solution was computed; default lambda fixed; believed: first-order estimates up
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
    errors, per_element, better = _errors(t, u, setting, goals, border, believed)
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
    believed: float = np.inf,
) -> tuple[Array, Array]:
    """Errors of linear functionals of the node system at a converged solution u.

    t, u, setting: as in `estimate`; goals: (k, y) the functionals, k <= node_system.ADJOINTS; border, believed: as in
    `estimate`. Returns (errors (k,), share of each element in them (k, E)), absolute.
    """
    return _errors(t, u, setting, goals, border, believed)[:2]


def _errors(
    t: Transcription, u: Array, setting: Setting, goals: Array, border: Array | None, believed: float
) -> tuple[Array, Array, Start | None]:
    """`functional_errors`, and the solution after a Newton step on the halved mesh where that is looked at."""
    fine, u_fine, fractions = on_halved_mesh(t, u, setting.fractions)
    halves = Setting(fractions, setting.p, setting.scale, setting.dp)
    lin = fine.linearise(u_fine, halves)
    maps = _joined(t, fine, lin.maps)
    row = t.system.border(parameter=1.0) if border is None else border
    own, better = t.interval_elements, None
    matrix, rhs = _newton_step(t, lin, maps, row)
    errors, weights, blame = _blamed(t, maps, goals, matrix, rhs)
    per_element = np.abs(blame)
    if t.intervals and errors.max() <= believed:
        y = t.system.solve(matrix, rhs)
        better = fine, u_fine + lin.expand(_with_middles(t, fine, lin, y), 1.0), halves.moved(float(y[-1]))
        left = _left_by_a_step(*better, lin).reshape(-1, 4, t.n)
        terms = np.abs(left @ weights[:, own].transpose(1, 2, 0))
        overlooked = ANYWHERE * (np.maximum(terms[:, 0], terms[:, 1]) + np.maximum(terms[:, 2], terms[:, 3])).T
        unseen = left_on_halved(t) * per_element[:, own]
        first = errors + (overlooked + unseen).sum(axis=1)
        chosen = np.flatnonzero(to_be_quartered(t, per_element[:, own], first))
        if chosen.size:
            at = own[chosen]
            maps[at] = maps_over_quarters(fine, u_fine, halves, chosen)
            errors, weights, again = _blamed(t, maps, goals, *_newton_step(t, lin, maps, row))
            per_element = np.maximum(per_element, np.abs(again))
            unseen[:, chosen] = left_on_quarters(blame[:, at], again[:, at])
        per_element[:, own] += overlooked + unseen
        errors += (overlooked + unseen).sum(axis=1)
    errors += ROUNDING * np.sqrt((weights**2).sum(axis=(1, 2)))
    return errors, per_element, better


def _newton_step(t: Transcription, lin: Linearisation, maps: Array, border: Array) -> tuple[Array, Array]:
    """Nonzeros and right-hand side (y,) of the node system whose solution is the error, to first order."""
    matrix = t.system.nonzeros(maps, lin.closure, lin.events, border)
    return matrix, np.concatenate([maps[:, :, 0].ravel(), -lin.closure_residual, -lin.events[0], [0.0]])


def _blamed(t: Transcription, maps: Array, goals: Array, matrix: Array, rhs: Array) -> tuple[Array, Array, Array]:
    """First-order errors (k,) of functionals by the maps over the elements; psi (k, E, n) there, and psi . r (k, E)."""
    E, n = t.elements, t.n
    psi = t.system.solve_transposed(matrix, goals)
    weights = psi[:, : E * n].reshape(-1, E, n)
    return np.abs(psi @ rhs), weights, (weights * maps[:, :, 0]).sum(axis=2)


def left_on_halved(t: Transcription) -> Array:
    """(N,) part of the blame of every interval that its halves keep."""
    return np.where(of_low_order(t), LEFT_OF_LOW_ORDER, LEFT_ON_HALVED)


def of_low_order(t: Transcription) -> Array:
    """(N,) whether stiffness or kinks may take the schemes their order there."""
    modes = [phase.mode for phase in t.cycle.phases]
    return np.array([mode.stiff or not mode.smooth for mode in modes])[t.phase_of[t.interval_elements]]


def to_be_quartered(t: Transcription, blame: Array, errors: Array) -> Array:
    """Which intervals matter, and are such that their halves may not tell by how much.

    blame, errors: (..., k, N) blame of its intervals for functionals, and (..., k) errors. Returns (..., N) bool.
    """
    return of_low_order(t) & (blame > np.maximum(MATTERS * errors, ROUNDING)[..., None]).any(axis=-2)


def left_on_quarters(on_halves: Array, on_quarters: Array) -> Array:
    """What quarters of intervals leave.

    on_halves, on_quarters: (..., m) blame of intervals, by their halves and by their quarters. Returns (..., m).
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
    """A solution y of the node system of t, with the nodes in the middles of its intervals."""
    n, ends = t.n, (t.elements + 1) * t.n
    coarse, first = y[:ends].reshape(-1, n), fine.interval_elements[::2]
    nodes = np.empty((fine.elements + 1, n))
    nodes[first], nodes[fine.closed_elements] = coarse[t.interval_elements], coarse[t.closed_elements]
    nodes[-1] = coarse[-1]
    known = np.empty((t.intervals, n + 3, 1))
    known[:, 0], known[:, 1 : n + 1, 0], known[:, n + 2] = 1.0, nodes[first], y[-1]
    known[:, n + 1, 0] = y[ends:-1][t.phase_of[t.interval_elements]]
    nodes[first + 1] = (lin.maps[first] @ known)[:, :, 0]
    return np.concatenate([nodes.ravel(), y[ends:]])


def _left_by_a_step(fine: Transcription, u: Array, setting: Setting, lin: Linearisation) -> Array:
    """r' (N, 2, 2, n) of both halves of every interval after the Newton step, carried to the end of the interval.

    Once as it would be if it arose at the end of its half, once as if at its start.
    """
    n, count, d = fine.n, fine.intervals // 2, fine.degree
    w = fine.intervals_of(u).reshape(count, 2, d + 1, n)
    ends = fine.nodes_of(u)[fine.interval_elements + 1].reshape(count, 2, n)
    weights, rule = fine_rule(d, fine.kind)
    x = np.matmul(rule, w).reshape(fine.intervals, -1, n)
    f = np.empty_like(x)
    for field, members in fine.groups:
        at = points_map(field, n, setting.p.size, x.shape[1], members.size)
        f[members] = at(x[members], fine.signs[members], setting.p, setting.scale)
    step = setting.fractions * fine.durations_of(u)[fine.phase_of[fine.interval_elements]]
    integrals = (weights[:, None] @ f.reshape(count, 2, -1, n))[:, :, 0] * step.reshape(count, 2, 1)
    left = w[:, :, 0] + integrals - ends
    through = lin.maps[fine.interval_elements].reshape(count, 2, n, n + 3)[..., 1 : n + 1]
    late_early = np.stack([left, (through @ left[..., None])[..., 0]], axis=2)
    late_early[:, 0] = late_early[:, 0] @ through[:, 1].transpose(0, 2, 1)
    return late_early


def _joined(t: Transcription, fine: Transcription, maps: Array) -> Array:
    """(E, n, n + 3) maps over the intervals of t from those over their two halves."""
    out = np.empty((t.elements, *maps.shape[1:]))
    out[t.interval_elements] = chained(maps[fine.interval_elements].reshape(t.intervals, 2, *maps.shape[1:]))
    out[t.closed_elements] = maps[fine.closed_elements]
    return out
