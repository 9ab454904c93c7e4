"""The conditions of a fold as equations, with their exact Jacobian, to be constraints of a larger optimisation problem.

A fold of G(u, lambda; q) = 0 is where, with multipliers nu of the equations,

    G(u, lambda; q) = 0,    G_u^T nu = 0,    nu . G_lambda = 1         (2 size + 1 equations)

in u, nu (size each) and lambda: the Karush-Kuhn-Tucker conditions of the largest lambda, and at the same time the
extended system of bifurcation theory with the left null vector.  Here q are the logarithms of some parameters,

    p_i = exp(q_i)   for i in `free`,

unknowns as well.  nu = S n with a number S, the largest |nu| at the start, so that n is of size one.  Jacobian:

              q                    (u, lambda)       n
    G         G_q                  [G_u, G_lambda]   0
    G_u^T n   d/dq (G_u^T n)       H_u               G_u^T
    S n.G_l   S d/dq (n.G_lambda)  S H_lambda        S G_lambda^T

with H the Hessian of n . G in (u, lambda), mapped over the mesh (collocation/graphs.py); only the columns of q are
differentiated at the level of the whole mesh.  Symbols as in collocation/graphs.py.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..collocation.graphs import graphs, lagrangian_hessian
from ..collocation.transcription import Setting, Transcription
from ..compiled import kept


@kept(maxsize=8)
def fold_conditions(t: Transcription, free: tuple[int, ...]) -> tuple[ca.Function, ca.Function]:
    """The conditions of a fold as functions of parameters, and their sparse Jacobian.

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


def data_of(setting: Setting) -> np.ndarray:
    """The data vector of collocation/graphs.py."""
    return np.concatenate([setting.fractions, setting.p, setting.dp, setting.scale])
