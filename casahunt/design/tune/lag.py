"""The linear loop of a search in closed form, and what sampling and delay do to it.

At s = i omega, w = omega^2, by times and by gains (kp' and so on: at K = 1), for numbers and CasADi expressions:

    ln |L|^2 = ln( (K cm)^2 (tau_d^2 w + 1)(tau_i^2 w + 1) / (tau_i^2 w^2 (J^2 w + sigma2^2)) )
             = ln( (K cm)^2 (kp'^2 w + (kd' w - ki')^2) / (w^2 (J^2 w + sigma2^2)) )
    phi = arg L + pi = atan(tau_d omega) + atan(tau_i omega) - atan2(J omega, sigma2) - omega D    [rad]
        = atan2(kd' w - ki', kp' omega) + pi/2 - atan2(J omega, sigma2) - omega D

By times, |L| = c has one root for every c > 0, so |L| falls with omega, and the loop is stable if and only if phi > 0
there (phi < pi; two integrators at omega = 0).  By gains, |L| may rise between two frequencies and have three
crossovers; phi > 0 at all of them is stable.  All that is exact is in servo/linear/margins.py.

At z = exp(i omega T), with s = i v and v = tan(omega h)/h, h = T/2, the parts of servo/linear/sampled_loop.py are

    difference quotient     s/(1 + s h)
    sum                     1/s + h by rectangles, 1/s by trapezoids
    plant behind its hold   (1 - s h) (1 + beta s)/(s (J' s + sigma2)),   J' = J x/tanh x, beta = (J' - J)/sigma2

with x = sigma2 h/J.  The lag 1 + s h goes into the gains as the filter of a derivative does, kp + ki/s + kd s/(1 + s h)
= (kp + ki h + ki/s + (kd + kp h) s)/(1 + s h), and what is left beside them has the size 1:

    L(i omega) = (kp' + ki/s + kd' s)/(s (J' s + sigma2)) (1 + beta s) (1 - s h)/(1 + s h) exp(-i omega D)

So loops of a drive are continuous ones with other gains at the frequency v, which lose more phase.  That is exact but
for |1 + beta s|, of the second order in x, a delay that is no whole number of samples, and what a drive may have
besides: a filter of the derivative or of the error, and a leak.  The checks have all of it.

h = 0 is the loop that is not sampled: v = omega.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np


@dataclass(frozen=True)
class Lag:
    """Sampling and delay.

    Attributes
    ----------
    delay : D [s].
    half : h [s], half a sample; 0: the loop is not sampled.
    rectangle : whether the sum is one of rectangles.
    """

    delay: float = 0.0
    half: float = 0.0
    rectangle: bool = True

    def seen(self, J: Any, sigma2: Any, kp: Any, ki: Any, kd: Any) -> tuple[Any, Any, Any, Any, Any]:
        """J', sigma2, kp', ki, kd' of numbers, arrays or expressions, to the second order in x."""
        p = kp + ki * self.half if self.rectangle else kp
        return J * (1 + (sigma2 * self.half / J) ** 2 / 3), sigma2, p + ki * self.half, ki, kd + p * self.half

    def lost(self, J: Any, sigma2: Any, v: Any) -> Any:
        """The phase [rad] that is lost at v [rad/s]; J: J'."""
        if not self.half:
            return v * self.delay
        atan = ca.atan if isinstance(v, ca.MX) else np.arctan
        return (2 + self.delay / self.half) * atan(v * self.half) - atan(v * sigma2 * self.half**2 / (3 * J))


def log_magnitude(J, cm, sigma2, k, q, y):  # type: ignore[no-untyped-def]
    """ln |L|^2 at omega = exp(y), for numbers, arrays and CasADi expressions.

    J, cm, sigma2: inertia [kg m2], motor gain [N m/V], viscous friction [N m s/rad]; k: ln K, K in V/rad; q: ln (tau_d,
    tau_i), times in s, or ln (kp', ki', kd'); y: ln omega, omega in rad/s; decides what comes back.
    Returns ln |L|^2, of the kind and shape of `y`.
    """
    exp, log, *_ = _functions_of(y)
    w = exp(2 * y)
    if _by_gains(q):
        kp, ki, kd = exp(q[0]), exp(q[1]), exp(q[2])
        square = kp**2 * w + (kd * w - ki) ** 2
        return 2 * k + 2 * math.log(cm) + log(square) - 4 * y - log(J**2 * w + sigma2**2)
    zeros = log(exp(2 * q[0]) * w + 1) + log(exp(2 * q[1]) * w + 1)
    return 2 * k + 2 * math.log(cm) + zeros - 2 * q[1] - 4 * y - log(J**2 * w + sigma2**2)


def phase(J, sigma2, D, q, y):  # type: ignore[no-untyped-def]
    """The phase phi = arg L + pi at omega = exp(y), for numbers, arrays and CasADi expressions.

    J, sigma2: inertia [kg m2], viscous friction [N m s/rad]; D: delay [s]; q: ln (tau_d, tau_i), times in s; y: ln
    omega, omega in rad/s; decides what comes back.
    Returns phi [rad], of the kind and shape of `y`.
    """
    exp, _, atan, atan2 = _functions_of(y)
    omega = exp(y)
    if _by_gains(q):
        lead = atan2(exp(q[2]) * omega - exp(q[1]) / omega, exp(q[0]))
        return lead + math.pi / 2 - atan2(J * omega, sigma2) - omega * D
    return atan(exp(q[0]) * omega) + atan(exp(q[1]) * omega) - atan2(J * omega, sigma2) - omega * D


def _by_gains(q: Any) -> bool:
    """Whether q are the logarithms of gains, three, rather than times, two."""
    return (q.shape[0] if hasattr(q, "shape") else len(q)) == 3


def _functions_of(y: Any) -> tuple[Callable[..., Any], ...]:
    """exp, log, atan and atan2 of numbers, or of CasADi expressions."""
    if isinstance(y, float | np.ndarray):
        return np.exp, np.log, np.arctan, np.arctan2
    return ca.exp, ca.log, ca.atan, ca.atan2
