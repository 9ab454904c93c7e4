"""How long a servo that is stuck beside its set point stays there.

    m = -(kp x1 + kd x2 + ki x3),   dm/dt = -ki x1 while it sticks:   |m| = Fs after (m + sign(x1) Fs)/(ki x1)

Units: x1 in rad, x2 in rad/s, x3 in rad s, m and Fs in N m.
"""

from __future__ import annotations

import math

import numpy as np

from ..cycles import motor_torque
from ..servo import Servo

STILL = 1e-3
"""LuGre counts as stuck below this part of the Stribeck velocity."""


def breaks_away_after(servo: Servo, gain: float, x: np.ndarray) -> float:
    """The time after which a servo that is stuck at the state x breaks away [s]; nan where it is not stuck, or at its
    set point."""
    ki, static = servo.torque_gains(gain)[2], servo.friction.static
    m = float(motor_torque(x, servo.parameters(gain)))
    if abs(float(x[1])) > STILL * servo.friction.stribeck_velocity or abs(m) > static or x[0] == 0:
        return math.nan
    return float((m + np.sign(x[0]) * static) / (ki * float(x[0])))
