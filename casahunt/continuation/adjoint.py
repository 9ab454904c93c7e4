"""How much a fold moves with every parameter of the problem, all at once, from its adjoint.

A fold solves   maximise lambda  subject to  G(u, lambda; q) = 0.   Its multipliers nu satisfy  G_u^T nu = 0  and
nu . G_lambda = 1, so that for any parameter q

    d lambda/d q = - nu . G_q.

G_q is the exact derivative of the collocation equations along q: the same compiled Jacobian with another direction dp.
One fold gives all the sensitivities; none is recomputed.

Along the tangent v of the branch, G_z v = 0 with z = (u, lambda), the second derivative of lambda tells a largest value
from a smallest one:

    d2 lambda/d s2 = - v . (nu . G)_zz v,      < 0 where it is the largest.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from ..collocation.graphs import graphs, lagrangian_hessian
from ..collocation.transcription import Setting, Transcription
from ..compiled import alone
from ..orbits.border import curve_border
from ..orbits.orbit import Orbit, unknowns_of
from .fold_conditions import data_of

Array = np.ndarray


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
def curvature(orbit: Orbit, multipliers: Array, dp: Array) -> float:
    """The second derivative of lambda along the branch at a fold.

    multipliers: (size,) of the equations on its mesh; dp: the way that the parameters go for lambda = 1.
    Returns d2 lambda/d s2, s the length in the first node.
    """
    t, u, setting = unknowns_of(orbit)
    setting = replace(setting, dp=dp)
    du, y = t.linearise(u, setting).tangent(curve_border(t, u, np.append(np.ones(t.n), [0.0, 0.0])))
    v = np.append(du, y[-1]) / np.linalg.norm(y[: t.n])
    g = graphs(t)
    bent = ca.Function("bent", [g.z, g.data, g.nu], [lagrangian_hessian(t, g)])
    upper = np.array(bent(np.append(u, 0.0), data_of(setting), multipliers).full())
    return 0.0 - float(v @ (upper + np.triu(upper, 1).T) @ v)


@alone
def _parameter_columns(t: Transcription, u: Array, settings: list[Setting]) -> list[Array]:
    """dG/d lambda at u along the dp of each setting."""
    g, z = graphs(t), np.append(u, 0.0)
    column = ca.Function("parameter_column", [g.z, g.data], [ca.densify(g.jacobian[:, t.size])])
    return [np.array(column(z, data_of(setting))).ravel() for setting in settings]
