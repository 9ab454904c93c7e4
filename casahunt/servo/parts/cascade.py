"""A cascade P-PI: a position loop Kp, and in it a velocity loop with Kv and the reset time Tn.

    m = -K cm Kv (u + int u/Tn),   u = Kp e + e'

At a constant set point the PID with kp = Kv (Kp + 1/Tn), ki = Kv Kp/Tn, kd = Kv, times K cm, x3 the integral of e.
"""

from __future__ import annotations

from typing import Any

from ..controller import torque_gains_of
from .part import Part
from .pid import pid_of


def _gains(p: Any) -> tuple[Any, Any, Any]:
    kp = p.velocity_gain * (p.position_gain + 1 / p.reset_time)
    ki = p.velocity_gain * p.position_gain / p.reset_time
    return torque_gains_of(p.gain * p.motor_gain, kp, ki, p.velocity_gain)


P_PI = Part(
    "cascade P-PI", (),
    {"motor_gain": 16.0, "position_gain": 6.283185307179586, "velocity_gain": 0.15915494309189535,
     "reset_time": 0.15915494309189535, "gain": 0.04},
    gives=pid_of(_gains),
)  # fmt: skip
"""Kp [1/s], Kv [s], Tn [s]: at Kp = 1/tau_i, Kv = tau_d, Tn = tau_d the PID by times with tau_d = tau_i."""
