"""The largest lambda of a solution curve as an optimisation problem, by Newton's method on its conditions.

    maximise lambda   subject to  G(z) = 0,   z = (u, lambda);      L = lambda - nu . G

    G = 0,    G_u^T nu = 0,    nu . G_lambda = 1                                       (first order)
    v . L_zz v = -v . (nu . G)_zz v < 0   for the v with G_z v = 0                     (second order)

With a row w along the curve, one factorisation of the node system gives what leads back to the curve, the way along it
and the multipliers (s = d lambda/d a, zero at the optimum):

    [ G_z ]      [ -G ]        [ G_z ]      [ 0 ]        [ G_z ]^T [ nu ]
    [  w  ] n  = [  0 ],       [  w  ] v  = [ 1 ],       [  w  ]   [ s  ]  = e_lambda

and the Newton step of the conditions is  z += n + a v,   a = -(s - v . H n)/(-v . H v),   H = (nu . G)_zz.

The conditions are evaluated on the whole mesh, from the expressions that IPOPT is given (collocation/graphs.py): they
share nothing with the elimination of the stages, nor with the tangents by which a fold is located on its branch.
IPOPT's own step from a point that close is this one.

The multipliers of the largest lambda are its adjoint: for any parameter q of the problem, G_q being the same Jacobian
with another direction dp,

    d lambda/d q = - nu . G_q

all of them at once, none of them recomputed.  And the conditions of first order, in u, nu (size each) and lambda, are
the extended system of bifurcation theory with the left null vector: constraints of a larger optimisation problem
(`fold_conditions`).

Symbols: n states, d stages, R = n (d + 1), N intervals.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import casadi as ca
import numpy as np

from ..collocation.graphs import graphs, lagrangian_hessian
from ..collocation.interval import interval_map
from ..collocation.ipopt import Maximum
from ..collocation.newton import RESIDUAL_LIMIT, size_of_step
from ..collocation.node_system import Linearisation
from ..collocation.transcription import Setting, Transcription
from ..compiled import Caller, alone, caller, kept
from ..errors import Status
from ..orbits.bordering import curve_border
from ..orbits.orbit import Orbit, unknowns_of

Array = np.ndarray

MOST_OPTIMUM_STEPS = 6
"""Newton steps from a point next to the fold; from a located one it is one."""
LAST_OPTIMUM_STEP = 1e-8
"""A step below this is the last one: what it leaves is of its square."""
STATIONARY = 1e-6
"""Part of the largest multiplier up to which the gradient of L counts as zero."""


def optimum(t: Transcription, u: Array, setting: Setting, row: Array, *, freedom: float = 0.01) -> Maximum:
    """The largest lambda next to a point by Newton's method on the optimality conditions.

    t, u, setting: the equations, and a point next to the fold; row: (n + 2,) weights along the curve, without lambda;
    freedom: |lambda| at which it is no longer next to the point. Returns maximum; status NOT_CONVERGED where no largest
    lambda is next to the point, and where rounding hides whether the conditions hold.
    """
    best = None
    with suppress(np.linalg.LinAlgError):
        best = _by_newton(t, np.append(u, 0.0), setting, row, freedom)
    return best or Maximum(u, 0.0, np.full(t.size, np.nan), Status.NOT_CONVERGED, MOST_OPTIMUM_STEPS)


def _by_newton(t: Transcription, z: Array, setting: Setting, row: Array, freedom: float) -> Maximum | None:
    """`optimum` from z, which is changed; None where it is not reached."""
    for k in range(1, MOST_OPTIMUM_STEPS + 1):
        lin = t.linearise(z[:-1], setting.moved(float(z[-1])))
        border = curve_border(t, z[:-1], row)
        (back, _, lam), (along, y) = lin.step(border), lin.tangent(border)
        n, v = np.append(back, lam), np.append(along, y[-1])
        nu, s = _multipliers(t, z, setting, lin, border)
        residual, gradient, vHv, vHn = _conditions(t, z, setting, nu, v, n)
        if not vHv > 0:  # a smallest lambda, or no numbers
            return None
        step = n + (s - vHn) / vHv * v
        z += step
        if max(size_of_step(t, z[:-1], step[:-1]), abs(float(step[-1]))) <= LAST_OPTIMUM_STEP:
            held = residual <= RESIDUAL_LIMIT and gradient <= STATIONARY * max(1.0, float(np.abs(nu).max()))
            held = held and abs(z[-1]) < freedom
            return Maximum(z[:-1], float(z[-1]), nu, Status.CONVERGED, k, bend=-vHv) if held else None
    return None


def _multipliers(
    t: Transcription, z: Array, setting: Setting, lin: Linearisation, border: Array
) -> tuple[Array, float]:
    """(nu (size,), s): those of the node system, and of the stage rows what takes the stages out of L.

    Of an interval, with stages X, stage rows c and node rows e:    nu_c c_X + nu_e e_X = 0.
    """
    E, n, d = t.elements, t.n, t.degree
    goal = np.zeros((1, t.system.size))
    goal[0, -1] = 1.0
    psi = t.system.solve_transposed(lin.matrix(border), goal)[0]
    of_elements = psi[: E * n].reshape(E, n)
    nu = np.empty((t.intervals, t.rows))
    nu[:, n * d :] = of_elements[t.interval_elements]
    w, T = t.intervals_of(z[:-1]), t.durations_of(z[:-1])
    duration, p = T[t.phase_of[t.interval_elements]], setting.p + z[-1] * setting.dp
    x_next = z[t.node_index[t.interval_elements + 1]]
    for field, i in t.groups:
        blocks = interval_map(field, n, p.size, d, t.kind, i.size)(
            w[i], x_next[i], duration[i], setting.fractions[i], t.signs[i], p, setting.dp, setting.scale
        )[:, n + 1 : t.rows + 1]
        known = blocks[:, :, n * d :] @ nu[i, n * d :, None]
        nu[i, : n * d] = -np.linalg.solve(blocks[:, :, : n * d], known)[:, :, 0]
    closed = of_elements[t.closed_elements].ravel()
    return np.concatenate([nu.ravel(), closed, psi[E * n : -1]]), float(psi[-1])


def multipliers_at(t: Transcription, u: Array, lam: float, setting: Setting, row: Array) -> Array:
    """(size,) multipliers of the equations at an optimum that is known."""
    border = curve_border(t, u, row)
    return _multipliers(t, np.append(u, lam), setting, t.linearise(u, setting.moved(lam)), border)[0]


def bend_at(t: Transcription, u: Array, lam: float, setting: Setting, row: Array, nu: Array) -> float:
    """d2 lambda/d a2 at an optimum with its multipliers, whoever found it: < 0 where lambda is largest."""
    along, y = t.linearise(u, setting.moved(lam)).tangent(curve_border(t, u, row))
    v = np.append(along, y[-1])
    return -_conditions(t, np.append(u, lam), setting, nu, v, v)[2]


def _conditions(
    t: Transcription, z: Array, setting: Setting, nu: Array, v: Array, n: Array
) -> tuple[float, float, float, float]:
    """(largest |G|, largest entry of the gradient of L, v . H v, v . H n)."""
    buffers = _compiled(t).buffers
    for place, value in zip(buffers.inputs, (z, data_of(setting), nu, v, n), strict=True):
        place[:] = value
    buffers.trigger()
    residual, gradient, forms = buffers.outputs
    return float(np.abs(residual).max()), float(np.abs(gradient).max()), float(forms[0]), float(forms[1])


@kept(maxsize=8)
def _compiled(t: Transcription) -> Caller:
    """The conditions as a function of z, the data of graphs.py, nu and the directions v and n."""
    g = graphs(t)
    v, n = ca.MX.sym("v", t.size + 1), ca.MX.sym("n", t.size + 1)
    upper = lagrangian_hessian(t, g)
    bent = ca.mtimes(upper, v) + ca.mtimes(upper.T, v) - ca.diag(upper) * v
    of_lambda = ca.DM.triplet([t.size], [0], [1.0], t.size + 1, 1)
    gradient = ca.mtimes(g.jacobian.T, g.nu) - of_lambda
    forms = ca.vertcat(ca.dot(v, bent), ca.dot(n, bent))
    function = ca.Function(
        "conditions", [g.z, g.data, g.nu, v, n], [ca.densify(g.residual), ca.densify(gradient), ca.densify(forms)]
    )
    return caller(function, [t.size + 1, g.data.numel(), t.size, t.size + 1, t.size + 1], [t.size, t.size + 1, 2])


def data_of(setting: Setting) -> Array:
    """The data vector of collocation/graphs.py."""
    return np.concatenate([setting.fractions, setting.p, setting.dp, setting.scale])


# What the multipliers tell of other parameters


def parameter_slopes(orbit: Orbit, multipliers: Array, names: tuple[str, ...]) -> Array:
    """The derivatives of lambda at a fold by parameters.

    multipliers: (size,) of the equations on its mesh. Returns (k,) d lambda/d q.
    """
    t, u, setting = unknowns_of(orbit)
    problem = orbit.problem
    sizes = [problem.unit(name) or 1.0 for name in names]
    settings = [replace(setting, dp=problem.direction(n) * size) for n, size in zip(names, sizes, strict=True)]
    columns = _parameter_columns(t, u, settings)
    return np.array([0.0 - float(multipliers @ c) / size for c, size in zip(columns, sizes, strict=True)])


@alone
def _parameter_columns(t: Transcription, u: Array, settings: list[Setting]) -> list[Array]:
    """dG/d lambda at u along the dp of each setting."""
    g, z = graphs(t), np.append(u, 0.0)
    column = ca.Function("parameter_column", [g.z, g.data], [ca.densify(g.jacobian[:, t.size])])
    return [np.array(column(z, data_of(setting))).ravel() for setting in settings]


@kept(maxsize=8)
def fold_conditions(t: Transcription, free: tuple[int, ...]) -> tuple[ca.Function, ca.Function]:
    """The conditions of a fold as functions of parameters, and their sparse Jacobian.

    With nu = S n, S the largest |nu| at the start, so that n is of size one, and some parameters p_i = exp(q_i):

                  q                    (u, lambda)       n
        G         G_q                  [G_u, G_lambda]   0
        G_u^T n   d/dq (G_u^T n)       H_u               G_u^T
        S n.G_l   S d/dq (n.G_lambda)  S H_lambda        S G_lambda^T

    with H the Hessian of n . G in (u, lambda), mapped over the mesh (collocation/graphs.py); only the columns of q are
    differentiated at the level of the whole mesh.

    free: indices of the k parameters that q stands for, by their logarithms.
    Returns functions of (q, z = (u, lambda), n, data, S): the equations, and their Jacobian in (q, z, n).  `data` is
    that of collocation/graphs.py, `data_of`; the free parameters in it are overruled by q.
    """
    g = graphs(t)
    parts = ca.Function("parts", [g.z, g.data], [g.residual, g.jacobian])
    curvature = ca.Function("curvature", [g.z, g.data, g.nu], [lagrangian_hessian(t, g)])
    q, z, n = ca.MX.sym("q", len(free)), ca.MX.sym("z", t.size + 1), ca.MX.sym("n", t.size)
    data, scale = ca.MX.sym("data", g.data.numel()), ca.MX.sym("S")
    entries = [t.intervals + i for i in free]
    place = ca.DM(ca.Sparsity.triplet(data.numel(), len(free), entries, list(range(len(free)))), 1.0)
    keep = np.ones(data.numel())
    keep[entries] = 0.0
    moved = ca.DM(keep) * data + ca.densify(place @ ca.exp(q))
    residual, jacobian = parts(z, moved)
    stationary = ca.mtimes(jacobian.T, n)  # (size + 1): G_u^T n, then n . G_lambda
    weights = ca.vertcat(ca.DM.ones(t.size), scale)
    equations = ca.vertcat(residual, weights * stationary)
    columns = [ca.jtimes(equations, q, ca.DM(np.eye(len(free))[:, k])) for k in range(len(free))]
    H = curvature(z, moved, n)
    H = H + ca.triu(H, False).T
    S = ca.diag(weights)
    empty = ca.MX(t.size, t.size)
    rest = ca.blockcat([[jacobian, empty], [ca.mtimes(S, H), ca.mtimes(S, jacobian.T)]])
    whole = ca.horzcat(*map(ca.densify, columns), rest)
    inputs = [q, z, n, data, scale]
    return (
        ca.Function("fold_conditions", inputs, [equations]),
        ca.Function("fold_conditions_jacobian", inputs, [whole]),
    )
