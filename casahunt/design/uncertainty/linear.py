"""The linear answer: what the gradient at the servo itself says.

    K(q) ~ K(q0) + g . (q - q0),    g = dK/dq at q0, exact (design/sensitivity.py)
    box: low, high = K(q0) + sum_i min, max(g_i (l_i - q0_i), g_i (h_i - q0_i));    covariance: std^2 = g . C g

Units: K in V/rad.  Symbols: k uncertain parameters, n servos, g (k,) gradient.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...servo.problem import HuntingFold
from ..sensitivity import fold_sensitivities
from .set import Array, Uncertainty, values_of


def linear_range(fold: HuntingFold, uncertainty: Uncertainty) -> tuple[float, float]:
    """Range of the linearised fold gain.

    fold: where it is linearised.
    Returns (low, high) [V/rad]: extremes over the intervals; mean -+ sigmas std for a covariance.
    """
    if uncertainty.covariance is not None:
        mean, std = linear_moments(fold, uncertainty)
        return mean - uncertainty.sigmas * std, mean + uncertainty.sigmas * std
    g, q = gradient(fold, uncertainty.parameters), values_of(fold.orbit.servo, uncertainty.parameters)
    ends = np.array([g * (bound - q) for bound in uncertainty.box(fold.orbit.servo)])
    return fold.gain + float(ends.min(axis=0).sum()), fold.gain + float(ends.max(axis=0).sum())


def linear_moments(fold: HuntingFold, uncertainty: Uncertainty) -> tuple[float, float]:
    """Moments of the linearised fold gain, with uniform distributions on intervals.

    fold: where it is linearised. Returns (mean, standard deviation) [V/rad].
    """
    g, servo = gradient(fold, uncertainty.parameters), fold.orbit.servo
    if uncertainty.covariance is not None:
        return fold.gain, float(np.sqrt(max(g @ uncertainty.covariance @ g, 0.0)))
    low, high = uncertainty.box(servo)
    shift = float(g @ ((low + high) / 2 - values_of(servo, uncertainty.parameters)))
    return fold.gain + shift, float(np.linalg.norm(g * uncertainty.std))


def linear_gains(fold: HuntingFold, names: Sequence[str], rows: Array) -> Array:
    """Linearised fold gains.

    fold: where it is linearised; rows: (n, k) their values. Returns (n,) [V/rad].
    """
    return fold.gain + (rows - values_of(fold.orbit.servo, names)) @ gradient(fold, names)


def gradient(fold: HuntingFold, names: Sequence[str]) -> Array:
    """The gradient dK/dq of the fold gain.

    fold: where it is taken. Returns (k,) [V/rad] per unit of each parameter.
    """
    derivatives = fold_sensitivities(fold).derivatives
    return np.array([derivatives[name] for name in names], dtype=float)
