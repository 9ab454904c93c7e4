"""The states of a cycle at given times, and how they move with its parameters.

The equations G(u; p) = 0 of a transcription hold along lambda, which moves p along dp, with

    G_u du/dlambda + G_p dp = 0

(implicit function theorem: the Jacobian is Newton's own).  In phase k, which begins at s_k = T_1 + ... + T_{k-1}, the
state at the time t is the polynomial of an interval, or a closed form, at tau = (t - s_k)/T_k:

    dx/dlambda at fixed t = dP_k(tau) - f(x) (ds_k + tau dT_k),     dx/dlambda = flow_x dx_k + flow_p dp - f(x) ds_k,

and after j of the computed pieces, of which each lasts H, x(t) = S^-j x(t - j H), so that -f(x) j dH comes besides.
At an event the derivative at a fixed time jumps with f: there it is that of the phase which begins.

Symbols: n states, m times, k parameters, N intervals.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..checks import choice_of
from ..collocation.ensemble_points import OverArrays, fields_at
from ..collocation.transcription import Transcription
from ..compiled import kept
from ..hybrid.system import VectorMode
from ..results import Result
from .orbit import Orbit, unknowns_of

Array = np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class StateSensitivity(Result):
    """The states of a cycle at m times, with their derivatives by k of its parameters.

    Attributes
    ----------
    names : the k parameters.
    times : (m,) [s] from the start of the first phase.
    states, rates : (n, m) x and dx/dt there.
    derivatives : (k, n, m) dx/dq at fixed times, per unit of the parameter q.
    period_derivatives : (k,) dT/dq of the whole cycle.

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle, state_sensitivity
    >>> state_sensitivity(find_cycle(belt, "slip", x=0.0, v=0.0), [1.0, 2.0], ["static"])
    <StateSensitivity: names (static), times 2>
    """

    _quantities = ("names", "times = times.size")
    _details = ("states", "rates", "derivatives", "period_derivatives")

    names: tuple[str, ...]
    times: Array
    states: Array
    rates: Array
    derivatives: Array
    period_derivatives: Array


@dataclass(frozen=True, eq=False)
class _Moves:
    """How a cycle moves along the parameter vectors dp (k, np).

    w (k, N, d + 1, n) of its interval polynomials, nodes (k, E + 1, n), durations (k, P).
    """

    transcription: Transcription
    w: Array
    nodes: Array
    durations: Array
    dp: Array


def state_sensitivity(orbit: Orbit, times: Any, names: Sequence[str] = ()) -> StateSensitivity:
    """The states of a cycle at given times, and their exact derivatives by parameters.

    Parameters
    ----------
    orbit
        the cycle.
    times
        (m,) [s] from the start of the first phase; the cycle goes on before and behind its period.
    names
        k parameters.

    Returns
    -------
    StateSensitivity: states and rates (n, m), derivatives (k, n, m) at fixed times, and those of the period (k,).

    Raises
    ------
    InputError : there is no such parameter.

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle, state_sensitivity
    >>> orbit = find_cycle(belt, "slip", x=0.0, v=0.0)
    >>> found = state_sensitivity(orbit, [1.0, 2.0], ["static"])
    >>> found.states.shape, found.derivatives.shape, found.period_derivatives.round(3).tolist()
    ((2, 2), (1, 2, 2), [7.917])
    """
    names = tuple(choice_of("parameter", name, orbit.problem.names) for name in names)
    times = np.atleast_1d(np.asarray(times, float))
    moves, n, count = _moves(orbit, names), len(orbit.cycle.states), len(names)
    piece, dpiece = sum(arc.duration for arc in orbit.arcs), moves.durations.sum(axis=1)
    pieces = np.floor(times / piece)
    x, f = np.empty((n, times.size)), np.empty((n, times.size))
    dx = np.empty((count, n, times.size))
    durations = np.array([arc.duration for arc in orbit.arcs])
    starts = np.concatenate([[0.0], np.cumsum(durations)])
    local = times - pieces * piece
    number = np.clip(np.searchsorted(starts, local, side="right") - 1, 0, durations.size - 1)
    inside = np.clip(local - starts[number], 0.0, durations[number])
    counts = np.array(moves.transcription.counts)
    for k in (-1, *np.flatnonzero(counts == 0)):  # the intervals of all phases together, and each closed form
        at = np.flatnonzero(number == k if k >= 0 else counts[number] > 0)
        if at.size:
            own = _in_closed_form(orbit, k, inside[at], moves) if k >= 0 else _in_intervals(
                orbit, number[at], inside[at] / durations[number[at]], moves
            )
            x[:, at], f[:, at], dx[:, :, at] = own
    later = np.cumsum(moves.durations, axis=1) - moves.durations
    dx -= later[:, None, number] * f
    dx -= (pieces * dpiece[:, None])[:, None, :] * f
    # From the computed piece to that many pieces later, in place: x' = S^-1 (x + c) each time
    cycle, repeats = orbit.cycle, orbit.repeats
    back = np.linalg.inv(cycle.closure)
    whole = np.allclose(np.linalg.matrix_power(back, repeats), np.eye(len(back))) and not cycle.shift
    for count in np.unique(pieces % repeats if whole else pieces):
        at = np.flatnonzero((pieces % repeats if whole else pieces) == count)
        power = np.linalg.matrix_power(back, int(count))
        if np.array_equal(power, np.eye(len(back))) and not cycle.shift:
            continue
        moved = x[:, at].T
        for _ in range(abs(int(count)) if cycle.shift else 0):
            moved = cycle.opened(moved) if count > 0 else moved @ cycle.closure.T - np.array(cycle.shift)
        x[:, at] = moved.T if cycle.shift else power @ x[:, at]
        f[:, at], dx[:, :, at] = power @ f[:, at], power @ dx[:, :, at]
    return StateSensitivity(names, times, x, f, dx, dpiece * orbit.repeats)


def _moves(orbit: Orbit, names: tuple[str, ...]) -> _Moves:
    """The derivatives of all unknowns, per unit of each parameter: one Jacobian for all of them."""
    t, u, setting = unknowns_of(orbit)
    units = np.array([orbit.problem.unit(name) or 1.0 for name in names])  # 1 of a parameter that is zero
    ways = np.array([orbit.problem.direction(name) for name in names]).reshape(len(names), setting.p.size)
    du = t.responses(u, setting, ways * units[:, None]) / units[:, None] if names else np.zeros((0, t.size))
    w = t.intervals_of(du).reshape(len(names), t.intervals, t.degree + 1, t.n) * setting.scale
    return _Moves(t, w, t.nodes_of(du) * setting.scale, t.durations_of(du), ways)


def _in_closed_form(orbit: Orbit, k: int, inside: Array, moves: _Moves) -> tuple[Array, Array, Array]:
    """x, f (n, m) and the derivatives (k, n, m) at fixed times after the start of phase k."""
    t, p = moves.transcription, orbit.problem.vector()
    flow = _flow(orbit.cycle.phases[k].mode, t.n, p.size)
    x, f, by_start, by_p = _over(flow, orbit.arcs[k].states[0, 0], inside, p)
    through = np.einsum("abm,ka->kbm", by_start, moves.nodes[:, t.phase_start[k]])
    return x, f, through + np.einsum("abm,ka->kbm", by_p, moves.dp)


def _in_intervals(orbit: Orbit, number: Array, tau: Array, moves: _Moves) -> tuple[Array, Array, Array]:
    """The same at fractions tau (m,) of the collocated phases of these numbers (m,)."""
    t, p, scale = moves.transcription, orbit.problem.vector(), orbit.scale
    collocated = [(k, arc) for k, arc in enumerate(orbit.arcs) if t.counts[k]]
    begins, widths, states = (
        np.concatenate(parts)
        for parts in zip(*((arc.breaks[:-1], np.diff(arc.breaks), arc.states) for _, arc in collocated), strict=True)
    )
    order = np.concatenate([k + arc.breaks[:-1] for k, arc in collocated])
    firsts = np.cumsum(t.counts) - t.counts
    i = np.clip(np.searchsorted(order, number + tau, side="right") - 1, firsts[number], (firsts + t.counts - 1)[number])
    matrix = t.scheme.interpolation((tau - begins[i]) / widths[i])
    found = _polynomials(np.concatenate([states[None], moves.w]), i, matrix)
    x, dx, f = found[0], found[1:], np.empty((t.n, tau.size))
    for field, intervals in t.groups:
        at = np.flatnonzero(np.isin(i, intervals))
        if not at.size:
            continue
        points = (x[:, at].T / scale)[None, :, None]
        f[:, at] = (fields_at(field, points, t.signs[i[at]], p[None], scale[None])[0, :, 0] * scale).T
    return x, f, dx - (moves.durations[:, number] * tau)[:, None, :] * f


def _polynomials(w: Array, i: Array, matrix: Array) -> Array:
    """(k, n, m) of k sets of interval polynomials w (k, N, d + 1, n), each at a point of the interval i (m,): by
    intervals, each of which is one product of matrices."""
    k, count, points, n = w.shape
    each = np.ascontiguousarray(w.transpose(1, 2, 0, 3)).reshape(count, points, k * n)
    order = np.argsort(i, kind="stable")
    matrix, ends = matrix[order], np.searchsorted(i[order], np.arange(count + 1))
    found, out = np.empty((i.size, k * n)), np.empty((i.size, k * n))
    for number, (start, end) in enumerate(itertools.pairwise(ends)):
        found[start:end] = matrix[start:end] @ each[number]
    out[order] = found
    return out.reshape(i.size, k, n).transpose(1, 2, 0)


def _over(function: OverArrays, x: Array, times: Any, p: Array) -> list[Array]:
    """The outputs of a function at many points: (rows, m), or (columns, rows, m) of a matrix."""
    m = np.broadcast_shapes(np.shape(x[0]), np.shape(times))
    found = [np.array([np.broadcast_to(each, m) for each in out]) for out in function(list(x), [times], list(p))]
    return [out if i < 2 else out.reshape(-1, len(x), *m) for i, out in enumerate(found)]  # matrices by columns


@kept(maxsize=64)
def _flow(mode: VectorMode, n: int, parameters: int) -> OverArrays:
    """A closed form, and its derivatives by the time, by the state at its start and by the parameters."""
    assert mode.flow is not None
    x, t, p = ca.SX.sym("x", n), ca.SX.sym("t"), ca.SX.sym("p", parameters)
    end = mode.flow(x, t, p)
    outputs = [end, *(ca.jacobian(end, by) for by in (t, x, p))]
    return OverArrays(ca.Function("flow", [x, t, p], [ca.densify(each) for each in outputs]))
