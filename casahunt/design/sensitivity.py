"""How much the fold gain moves with every parameter of the servo, all at once.

The fold is where K = K_fold (1 + lambda) is largest, and its adjoint gives the derivatives of lambda
(continuation/fold.py):

    dK_fold/dq = K_fold d lambda/d q.

The elasticity q/K dK/dq is the per cent of K for one per cent of q.  Exact symmetries of the Switch servo: the
elasticities of motor_gain and of the Stribeck velocity are -1, and that of (Fs - Fc) is 1; stiffness and damping have
none.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ..axis_units import in_its_units
from ..continuation import Fold
from ..export import Columns
from ..results import Result
from ..servo.parts.table import unit_of
from ..servo.servo import PARAMETERS, PID_PARAMETERS
from ..servo.units import column

NAMES = tuple(dict.fromkeys(name for name in (*PARAMETERS, *PID_PARAMETERS) if name != "gain"))
"""Parameters that a fold gain may depend on; the controller's are those of one of its two forms."""


@dataclass(frozen=True, repr=False)
class Sensitivities(Result):
    """Derivatives of a fold gain, or of the fold of a loop of parts in any of its parameters.

    Attributes
    ----------
    fold : the fold.
    derivatives : dK/dq by parameter name, in V/rad per unit of q.
    elasticities : q/K dK/dq by parameter name, dimensionless; 0 where q is 0.

    Examples
    --------
    >>> from casahunt import Servo, find_fold, fold_sensitivities
    >>> slopes = fold_sensitivities(find_fold(Servo(), "switch"))
    >>> round(slopes.elasticities["servo.motor_gain"], 6)  # exact: only the product with the gain counts
    -1.0
    """

    _quantities = ("parameter = fold.parameter", "value = fold.value ~ fold.value_error", "elasticities")
    _details = ("derivatives",)

    fold: Fold[Any]
    derivatives: dict[str, float]
    elasticities: dict[str, float]

    def linear(self, changes: dict[str, float]) -> float:
        """Fold gain for small absolute changes of parameters, to first order."""
        return self.fold.value + sum(self.derivatives[name] * change for name, change in changes.items())

    def _columns(self) -> Columns:
        fold, names, unit = self.fold, list(self.elasticities), unit_of(self.fold.parameter)
        return {
            "model": [getattr(fold.orbit, "model", "loop")] * len(names),
            "parameter": names,
            "unit": [unit_of(name) for name in names],
            "value": [fold.orbit.problem.value(name) for name in names],
            column(f"fold_{fold.parameter}", unit): [fold.value] * len(names),
            column(f"fold_{fold.parameter}_error", unit): [fold.absolute_error] * len(names),
            f"{column('slope', unit)}_per_unit": [self.derivatives[name] for name in names],
            "elasticity": [self.elasticities[name] for name in names],
        }


@in_its_units
def fold_sensitivities(fold: Fold[Any]) -> Sensitivities:
    """The derivatives of a fold gain with respect to every servo, controller and friction parameter.

    Parameters
    ----------
    fold
        from `find_fold`, or that of a loop of parts from `casahunt.continuation.largest` or `smallest`.

    Returns
    -------
    Sensitivities; measured against finite differences of recomputed folds at tolerance 1e-10: 1e-7 or better.

    Examples
    --------
    >>> from casahunt import Servo, find_fold, fold_sensitivities
    >>> slopes = fold_sensitivities(find_fold(Servo(), "switch"))
    >>> round(slopes.derivatives["friction.static"], 3)  # V/rad per N m
    7.428
    >>> round(slopes.linear({"friction.static": 0.001}), 4)
    0.6548
    """
    value, moves = fold.orbit.problem.value, fold.sensitivities
    return Sensitivities(fold, moves, {name: value(name) * slope / fold.value for name, slope in moves.items()})
