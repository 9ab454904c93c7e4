"""How much the fold gain moves with every parameter of the servo, all at once.

The fold solves   maximise lambda  subject to  G(u, lambda; q) = 0   with K = K_fold (1 + lambda).  Its Lagrange
multipliers nu (IPOPT's lam_g, continuation/fold.py) satisfy  G_u^T nu = 0  and  nu . G_lambda = 1, so that for any
parameter q

    d lambda/d q = - nu . G_q,        dK_fold/dq = K_fold d lambda/d q.

G_q is the exact derivative of the collocation equations along q: the same compiled Jacobian with another direction
dp.  One fold gives all the sensitivities; none is recomputed.  The elasticity q/K dK/dq is the per cent of K for one
per cent of q.  Exact symmetries of the Switch servo: the elasticities of motor_gain and of the Stribeck velocity are
-1, and that of (Fs - Fc) is 1; stiffness and damping have none.

Symbols: n states, m parameters, size unknowns of the transcription.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import casadi as ca
import numpy as np

from ..collocation.graphs import graphs
from ..collocation.transcription import Setting, Transcription
from ..compiled import alone
from ..continuation.fold_conditions import data_of
from ..orbits.orbit import unknowns_of
from ..servo.problem import HuntingFold
from ..servo.servo import PARAMETERS, PID_PARAMETERS

Array = np.ndarray

NAMES = tuple(dict.fromkeys(name for name in (*PARAMETERS, *PID_PARAMETERS) if name != "gain"))
"""Parameters that a fold gain may depend on; the controller's are those of one of its two forms."""


@dataclass(frozen=True)
class Sensitivities:
    """Derivatives of a fold gain.

    Attributes
    ----------
    gain : the fold gain K.
    derivatives : dK/dq by parameter name, in V/rad per unit of q.
    elasticities : q/K dK/dq by parameter name, dimensionless; 0 where q is 0.
    """

    gain: float
    derivatives: dict[str, float]
    elasticities: dict[str, float]

    def linear(self, changes: dict[str, float]) -> float:
        """Fold gain for small absolute changes of parameters, to first order."""
        return self.gain + sum(self.derivatives[name] * change for name, change in changes.items())


def fold_sensitivities(fold: HuntingFold) -> Sensitivities:
    """The derivatives of a fold gain with respect to every servo, controller and friction parameter.

    Parameters
    ----------
    fold
        from `find_fold`; its multipliers are those of the optimisation problem on the mesh of its orbit.

    Returns
    -------
    Sensitivities; measured against finite differences of recomputed folds at tolerance 1e-10: 1e-7 or better.
    """
    t, u, setting = unknowns_of(fold.orbit)
    p = setting.p
    names = fold.orbit.servo.names
    sizes = {name: p[i] or 1.0 for i, name in enumerate(names) if name != "gain"}
    settings = [replace(setting, dp=fold.orbit.problem.direction(name) * sizes[name]) for name in sizes]
    derivatives: dict[str, float] = {}
    elasticities: dict[str, float] = {}
    for name, column in zip(sizes, _parameter_columns(t, u, settings), strict=True):
        relative = 0.0 - float(fold.multipliers @ column)
        derivatives[name] = fold.gain * relative / sizes[name]
        elasticities[name] = relative if p[names.index(name)] else 0.0
    return Sensitivities(fold.gain, derivatives, elasticities)


@alone
def _parameter_columns(t: Transcription, u: Array, settings: list[Setting]) -> list[Array]:
    """dG/d lambda at u along the dp of each setting."""
    g, z = graphs(t), np.append(u, 0.0)
    column = ca.Function("parameter_column", [g.z, g.data], [ca.densify(g.jacobian[:, t.size])])
    return [np.array(column(z, data_of(setting))).ravel() for setting in settings]
