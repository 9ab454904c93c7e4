"""A fold as constraints of a larger optimisation problem: its conditions of first order.

    maximise lambda   subject to  G(u, lambda; q) = 0:      G = 0,    G_u^T nu = 0,    nu . G_lambda = 1

in u, nu (size each) and lambda: the extended system of bifurcation theory with the left null vector nu, the adjoint of
the fold.  The equations are those that IPOPT is given (collocation/graphs.py).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..collocation.graphs import graphs, lagrangian_hessian
from ..collocation.interval import interval_map
from ..collocation.transcription import Setting, Transcription
from ..compiled import kept
from ..orbits.bordering import curve_border, row_along
from .fold import Fold, unknowns_along

Array = np.ndarray

LEAST_LAMBDA = -0.9
"""lambda of a fold as a constraint: the parameter stays above zero."""


@dataclass(frozen=True, eq=False)
class FoldConstraints:
    """A fold as constraints of a larger optimisation problem, with exact Jacobian: see the module.

    Attributes
    ----------
    equations, jacobian : functions of (q, z, n): q the logarithms of the free parameters, z the unknowns of the cycle
        and lambda (value of the fold = what it is here times 1 + lambda), n the multipliers; and by all three, sparse.
    right : what the equations must be.
    z, lowest, n : where z starts, the smallest it may be, and where n starts.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.continuation import FoldConstraints, largest
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> fold = largest(find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True), "g")
    >>> conditions = FoldConstraints.of(fold, ("omega",))
    >>> q = np.log([fold.orbit.problem.value("omega")])
    >>> left = np.array(conditions.equations(q, conditions.z, conditions.n)).ravel() - conditions.right
    >>> bool(np.abs(left).max() < 1e-5)
    True
    """

    equations: Callable[..., Any]
    jacobian: Callable[..., Any]
    right: Array
    z: Array
    lowest: Array
    n: Array

    @classmethod
    def of(cls, fold: Fold[Any], free: tuple[str, ...]) -> FoldConstraints:
        """The conditions of a fold.

        Parameters
        ----------
        fold, free
            the fold, and the names of the free parameters, all above zero.

        Returns
        -------
        FoldConstraints.
        """
        problem = fold.orbit.problem
        t, u, setting = unknowns_along(fold.orbit, fold.parameter)
        equations, jacobian = fold_conditions(t, tuple(problem.names.index(name) for name in free))
        data, nu = data_of(setting), _multipliers(t, u, setting)
        S = float(np.max(np.abs(nu)))
        lowest = np.full(t.size + 1, -np.inf)
        lowest[t.size - t.phases : t.size] = 0.0  # durations
        lowest[-1] = LEAST_LAMBDA
        right = np.append(np.zeros(2 * t.size), 1.0)
        return cls(
            lambda q, z, n: equations(q, z, n, data, S), lambda q, z, n: jacobian(q, z, n, data, S),
            right, np.append(u, 0.0), lowest, nu / S,
        )  # fmt: skip


def data_of(setting: Setting) -> Array:
    """The data vector of collocation/graphs.py."""
    return np.concatenate([setting.fractions, setting.p, setting.dp, setting.scale])


def _multipliers(
    t: Transcription, u: Array, setting: Setting
) -> Array:
    """(size,) nu at a fold: those of the node system, and of the stage rows what takes the stages out of L.

    Of an interval, with stages X, stage rows c and node rows e:    nu_c c_X + nu_e e_X = 0.
    """
    E, n, d, z = t.elements, t.n, t.degree, np.append(u, 0.0)
    lin, border = t.linearise(u, setting), curve_border(t, u, row_along(t, u, setting))
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
    return np.concatenate([nu.ravel(), closed, psi[E * n : -1]])


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
