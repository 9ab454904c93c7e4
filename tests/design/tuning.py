"""What the tests of tuning share: the time of Table 1, and a phase margin of their own."""

from __future__ import annotations

import math

import numpy as np

from casahunt import Servo

TIME = 1 / (2 * np.pi)


def crossover_phase(servo: Servo, gain: float, delay: float) -> float:
    """Phase margin [deg] by the complex response on the frequency axis; unwrapped from omega = 0 on."""
    c, f = servo.controller, servo.friction

    def response(omega):
        s = 1j * omega
        lead = (c.lead_time * s + 1) * (c.integral_time * s + 1)
        plant = servo.motor_gain / (s * (servo.inertia * s + f.viscous))
        return gain * lead / (c.integral_time * s) * plant * np.exp(-s * delay)

    low, high = 1e-6, 1e8
    for _ in range(60):
        middle = math.sqrt(low * high)
        low, high = (middle, high) if abs(response(middle)) > 1 else (low, middle)
    way = np.geomspace(1e-6, low, 1000)
    turned = np.unwrap(np.angle(response(way)))
    return math.degrees(turned[-1] - turned[0])  # -180 degrees at omega = 0
