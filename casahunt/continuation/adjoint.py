"""How much a fold moves with every parameter of the problem, all at once, from its adjoint.

A fold solves   maximise lambda  subject to  G(u, lambda; q) = 0.   Its multipliers nu satisfy  G_u^T nu = 0  and
nu . G_lambda = 1, so that for any parameter q

    d lambda/d q = - nu . G_q.

G_q is the exact derivative of the collocation equations along q: the same compiled Jacobian with another direction dp.
One fold gives all the sensitivities; none is recomputed.
"""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np

from ..collocation.graphs import graphs
from ..collocation.transcription import Setting, Transcription
from ..compiled import alone
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
def _parameter_columns(t: Transcription, u: Array, settings: list[Setting]) -> list[Array]:
    """dG/d lambda at u along the dp of each setting."""
    g, z = graphs(t), np.append(u, 0.0)
    column = ca.Function("parameter_column", [g.z, g.data], [ca.densify(g.jacobian[:, t.size])])
    return [np.array(column(z, data_of(setting))).ravel() for setting in settings]
