"""Gains of the right size, and stability, of the loop of one inertia without dry friction, in closed form.

    plant         P(s) = cm / (s (J s + sigma2))                            [rad/V]
    controller    C(s) = (kp + kd s + ki/s)/cm, times K: controller.py      [V/rad]
    closed loop   chi(s) = J s^3 + (kd + sigma2) s^2 + kp s + ki

Routh-Hurwitz, all coefficients being positive: chi is stable if and only if (kd + sigma2) kp > J ki, that is, with the
reset time kp/ki = tau_i + tau_d and kd = K cm kd', kd' = tau_d for a controller by times,

    K cm kd' + sigma2 > J / (kp/ki).

Without viscous friction this is K > J / (cm tau_d (tau_i + tau_d)), the report's lower bound (sections 2 and 5;
0.0321 for its Table 1).  With the viscous friction of Table 1, sigma2 = 0.1 > J/(tau_i + tau_d) = 0.0817, it holds
for every K > 0: the report's bound ignores sigma2.  A stable linear loop does not mean that the servo does not
hunt; dry friction is what hunting comes from.

Report: Hensen, van de Molengraft and Steinbuch, DCT 2001.021, section 2, Figure 1 and Table 1.
"""

from __future__ import annotations

import math

from .controller import Pid
from .servo import Servo


def routh_hurwitz_gain(servo: Servo) -> float:
    """Gain above which the loop without friction is stable, J / (cm kd' kp/ki); inf for no derivative action."""
    c = servo.controller
    if c.shape[1] == 0:
        return float("inf")
    return servo.inertia / (servo.motor_gain * c.shape[1] * c.reset_time)


def typical_gain(servo: Servo) -> float:
    """A gain of the right size, where a search for hunting begins.

    Returns `routh_hurwitz_gain`, or where that is infinite `integral_gain` [V/rad].
    """
    base = routh_hurwitz_gain(servo)
    return base if math.isfinite(base) else integral_gain(servo)


def integral_gain(servo: Servo) -> float:
    """The gain at which inertia and integral action are equally fast.

    Returns J/(cm tau_i^2) for a controller by times; J/(cm kp' (kp'/ki')^2) by gains, the same where there is no kd
    [V/rad].
    """
    c, base = servo.controller, servo.inertia
    if isinstance(c, Pid):
        return base / (servo.motor_gain * c.kp * c.reset_time**2)
    return base / (servo.motor_gain * c.integral_time**2)


def lowest_stable_gain(servo: Servo) -> float:
    """Gain above which the loop with viscous friction is stable; 0: for every K > 0; inf: for none."""
    c = servo.controller
    missing = servo.inertia / c.reset_time - servo.friction.viscous
    if c.shape[1] == 0:
        return 0.0 if missing < 0 else float("inf")
    return max(0.0, missing / (servo.motor_gain * c.shape[1]))
