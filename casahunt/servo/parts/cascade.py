"""A cascade P-PI: a position loop Kp, and in it a velocity loop with Kv and the reset time Tn.

    m = -K cm Kv (u + int u/Tn),   u = Kp e + e'

At a constant set point the PID with kp = Kv (Kp + 1/Tn), ki = Kv Kp/Tn, kd = Kv, times K cm, x3 the integral of e.

With the velocity filtered, v = e'/(1 + Tf s), the velocity loop sums what is filtered, which is the filtered error
d = e - Tf v: the PID whose derivative has that filter (filtered_derivative.py), and kd = Kv (1 - Tf/Tn).  Run by a
drive likewise: v_k = (d_k - d_(k-1))/T, and the sum of T v is d.
"""

from __future__ import annotations

from typing import Any

from ..controller import torque_gains_of
from .filtered_derivative import lagging
from .part import ABOVE_ZERO, Part
from .pid import pid_of


def _gains(p: Any, filter_time: Any = 0.0) -> tuple[Any, Any, Any]:
    kp = p.velocity_gain * (p.position_gain + 1 / p.reset_time)
    ki = p.velocity_gain * p.position_gain / p.reset_time
    return torque_gains_of(p.gain * p.motor_gain, kp, ki, p.velocity_gain * (1 - filter_time / p.reset_time))


P_PI = Part(
    "cascade P-PI", (),
    {"motor_gain": 16.0, "position_gain": 6.283185307179586, "velocity_gain": 0.15915494309189535,
     "reset_time": 0.15915494309189535, "gain": 0.04},
    ranges=dict.fromkeys(("reset_time", "gain"), ABOVE_ZERO), gives=pid_of(_gains),
)  # fmt: skip
"""Kp [1/s], Kv [s], Tn [s]: at Kp = 1/tau_i, Kv = tau_d, Tn = tau_d the PID by times with tau_d = tau_i."""
P_PI_FILTERED = lagging(Part(
    "cascade P-PI, velocity filtered", (), {**P_PI.parameters, "velocity_filter": 1e-3},
    ranges={**P_PI.ranges, "velocity_filter": ABOVE_ZERO}, gives=pid_of(lambda p: _gains(p, p.velocity_filter)),
), lambda x, s, p: p.velocity_filter)  # fmt: skip
"""The same with the time Tf [s] of a filter of the velocity."""
