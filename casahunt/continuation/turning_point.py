"""The largest lambda of a solution curve by Newton's method alone: where the tangent has no lambda component.

With a row w = (w_x, w_T, 0) along the curve, a = w . (x_0 - x_0*, ln T_1 - ln T_1*) measures the way, and

    G(u, lambda) = 0,   a fixed     is regular at a fold;   its tangent with w . dy = 1 has  d lambda/d a.

The root of d lambda/d a is found by secants.  At it the equations have the adjoint nu of the fold,

    G_u^T nu = 0,   nu . G_lambda = 1:      [ G_u  G_lambda ]^T [ nu ]   [ 0 ]
                                            [  w      0     ]   [ s  ] = [ 1 ],   s = 0,

as the multipliers of the optimisation problem that IPOPT solves for the same fold (ipopt.maximise_parameter).
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from ..collocation.graphs import graphs
from ..collocation.ipopt import Maximum
from ..collocation.linearisation import Linearisation
from ..collocation.newton import LARGEST_MOVE, ROUNDED, Solution, newton, size_of_step, verdict
from ..collocation.transcription import Setting, Transcription
from ..compiled import alone
from ..errors import Status
from ..orbits.border import curve_border
from .fold_conditions import data_of

Array = np.ndarray

FIRST_STEPS = (1e-4, 1e-6, 1e-8)
"""First steps along the curve, in turn: a sharp fold is narrower than the first of them."""
MOST_SECANTS = 12
MOST_TOGETHER, CLEAN = 10, 0.1
"""Linearisations from a bend that is about known; Newton steps below this part of the way between two slopes let them
be compared, and below this let the slope be believed."""
LAST_STEP, LAST_CHANGE = 1e-10, 1e-14
"""No further step is made where the last one, and the change of lambda that it brought, are below these; nor where
lambda does not change any more and the slope is nothing but rounding."""


def turning_point(t: Transcription, u: Array, setting: Setting, *, freedom: float = 0.01) -> Maximum:
    """The largest lambda next to an orbit by Newton's method, as `ipopt.maximise_parameter` by IPOPT.

    freedom: |lambda| at which it is no longer next to the orbit.
    Returns maximum; where none is found, its status is NOT_CONVERGED, and u is what it was.
    """
    row = row_along(t, u, setting)
    solution, iterations = _turned(t, u, setting, row, freedom, 0.0)
    if solution is None:
        return Maximum(u, 0.0, np.full(t.size, np.nan), Status.NOT_CONVERGED, iterations)
    nu = _adjoint(t, solution, setting, row)
    status = Status.CONVERGED if np.isfinite(nu).all() else Status.NOT_FINITE
    return Maximum(solution.u, solution.parameter, nu, status, iterations)


def turning_place(
    t: Transcription, u: Array, setting: Setting, *, freedom: float = 0.01, accuracy: float = 0.0,
    known: tuple[Array, float] | None = None,
) -> tuple[Array, float] | None:  # fmt: skip
    """`turning_point` without multipliers, and to an accuracy.

    accuracy: way along the curve that may be left, in scaled units; 0 for all digits; known: a row along the curve,
    without lambda, and d2 lambda/d a2 along it, as they are on another mesh.
    Returns (u, lambda), or None where none is found.
    """
    row, bend = known or (row_along(t, u, setting), np.nan)
    solution, _ = _turned(t, u, setting, row, freedom, accuracy, bend)
    return None if solution is None else (solution.u, solution.parameter)


def turned_solution(
    t: Transcription, u: Array, setting: Setting, bend: float, *, freedom: float, accuracy: float
) -> tuple[Solution | None, Array, float]:
    """`turning_place` with the equations linearised there.

    t, u, setting: as there; u need not solve the equations; bend: d2 lambda/d a2, about; NaN where it is not known.
    Returns (the solution or None, the row along the curve, d2 lambda/d a2 along it where it was known or NaN).
    """
    row = row_along(t, u, setting)
    found = _together(t, u, setting, row, accuracy, bend) if bend < 0 else None
    if found is not None and abs(found[0].parameter) < freedom:
        return found[0], row, found[1]
    return _turned(t, u, setting, row, freedom, accuracy)[0], row, np.nan


def _turned(
    t: Transcription, u: Array, setting: Setting, row: Array, freedom: float, accuracy: float, bend: float = np.nan
) -> tuple[Solution | None, int]:
    """(the solution at the turning point or None, Newton iterations); from a known bend, else from first steps."""
    if bend < 0:
        found = _together(t, u, setting, row, accuracy, bend)
        if found is not None and abs(found[0].parameter) < freedom:
            return found[0], found[0].iterations
    iterations = 0
    for first in FIRST_STEPS:
        found = _secants(t, u, setting, row, first, accuracy)
        if found is None:
            continue
        solution = found[0]
        iterations += solution.iterations
        if abs(solution.parameter) < freedom and solution.linearisation is not None:
            return solution, iterations
    return None, iterations


def _together(
    t: Transcription, u: Array, setting: Setting, row: Array, accuracy: float, bend: float
) -> tuple[Solution, float] | None:
    """(the solution where d lambda/d a = 0, the bend there), from a bend that is about known; None where it is lost.

    One linearisation gives Newton's step at fixed a, and the way along the curve to where its slope should vanish.
    """
    start, u, lam = u, u.copy(), 0.0
    last, former, slope, way = np.inf, np.inf, np.nan, 0.0
    for k in range(1, MOST_TOGETHER + 1):
        try:
            lin = t.linearise(u, setting.moved(lam))
        except np.linalg.LinAlgError:
            return None
        border = curve_border(t, u, row)
        (du, _, dlam), (along, y) = lin.step(border), lin.tangent(border)
        size, length = max(size_of_step(t, u, du), abs(dlam)), size_of_step(t, u, along)
        fresh = (float(y[-1]) - slope) / way if way else np.nan
        if max(size, last) <= CLEAN * abs(way) * length:
            bend = fresh
        slope = float(y[-1])
        way = -slope / bend if size <= CLEAN else 0.0
        total = max(size, abs(way) * length)
        if not (bend < 0 and total <= LARGEST_MOVE):  # a minimum; too far away, or no number
            return None
        rounding = size <= ROUNDED and abs(way) <= LAST_STEP and total > 0.3 * former
        if rounding or max(size, abs(way)) <= min(accuracy, ROUNDED):
            residual = lin.residual_norm()
            status = verdict(t, start, u, residual, True, LARGEST_MOVE)
            return (Solution(u, lam, status, k, residual, lin), bend) if status.ok else None
        u += du + way * along
        lam += dlam + way * (slope + bend / 2 * way)
        last, former = size, total
    return None


def row_along(t: Transcription, u: Array, setting: Setting) -> Array:
    """The row w of the module docstring at a point of the curve.

    Returns (n + 2,) of length one, its last entry zero.
    """
    lin = t.linearise(u, setting)
    # Next to the sharpest folds the first node moves no more than lambda does: the first duration tells.
    for trial in (np.append(np.ones(t.n), [0.0, 0.0]), np.append(np.zeros(t.n), [1.0, 0.0])):
        du, y = lin.tangent(curve_border(t, u, trial))
        if np.isfinite(y).all():
            break
    row = np.concatenate([y[: t.n], [t.durations_of(du)[0] / t.durations_of(u)[0], 0.0]])
    return row / np.linalg.norm(row)


def _secants(
    t: Transcription, u: Array, setting: Setting, row: Array, first: float, accuracy: float
) -> tuple[Solution, float] | None:
    """(the solution where d lambda/d a = 0, the bend there), or None where that is no maximum or is not reached."""
    solution = newton(t, u, setting, border=curve_border(t, u, row), accuracy=accuracy)
    iterations = solution.iterations
    if not solution.status.ok or solution.linearisation is None:
        return None
    du, slope = _tangent(t, solution.u, solution.linearisation, row)
    ds = first
    for k in range(MOST_SECANTS):
        start = solution.u + ds * du
        following = newton(
            t, start, setting, border=curve_border(t, start, row), parameter=solution.parameter + ds * slope,
            accuracy=accuracy,
        )  # fmt: skip
        iterations += following.iterations
        if not following.status.ok or following.linearisation is None:
            return None
        du, fresh = _tangent(t, following.u, following.linearisation, row)
        bend = (fresh - slope) / ds
        if k == 0 and not bend < 0:  # later on, next to the turning point, rounding may bend it either way
            return None
        still = abs(fresh * ds) <= LAST_CHANGE
        if still and (abs(ds) <= LAST_STEP or abs(fresh) > 0.1 * abs(slope)):
            return replace(following, iterations=iterations), bend
        if not bend < 0:
            return None
        if abs(fresh) <= accuracy * abs(bend):
            return replace(following, iterations=iterations), bend
        solution, slope, ds = following, fresh, -fresh / bend
    return None


def _tangent(t: Transcription, u: Array, lin: Linearisation, row: Array) -> tuple[Array, float]:
    """(du/da, d lambda/d a)."""
    du, y = lin.tangent(curve_border(t, u, row))
    return du, float(y[-1])


@alone
def _adjoint(t: Transcription, solution: Solution, setting: Setting, row: Array) -> Array:
    """nu (size,) of the module docstring."""
    g = graphs(t)
    jacobian = ca.Function("jacobian", [g.z, g.data], [g.jacobian])
    places = np.append(t.node_index[0], t.size - t.phases)
    weights = np.append(row[: t.n], row[t.n] / t.durations_of(solution.u)[0])
    border = ca.DM(ca.Sparsity.triplet(1, t.size + 1, [0] * places.size, places.tolist()), weights)
    matrix = ca.vertcat(jacobian(np.append(solution.u, solution.parameter), data_of(setting)), border)
    goal = np.zeros(t.size + 1)
    goal[-1] = 1.0
    # Factorised as it is: its few dense columns would be dense rows of the transposed matrix, which fill everything.
    return np.array(ca.Linsol("adjoint", "qr", matrix.sparsity()).solve(matrix, goal, True)).ravel()[:-1]
