"""A PID by gains whose derivative is filtered, kd s/(1 + Tf s): its state d is the filtered error.

    Tf d' = e - d,   m = -(kp e + kd d' + ki x3)
"""

from __future__ import annotations

from typing import Any

from ..controller import torque_gains_of_gains
from .part import Law, Part, PartMode


def _gains(p: Any) -> tuple[Any, Any, Any]:
    return torque_gains_of_gains(p.gain * p.motor_gain, p.kp, p.ki, p.kd)


def _slope(x: Any, s: Any, p: Any) -> Any:
    return (s.error - x.lagging) / p.derivative_filter


def _demand(x: Any, s: Any, p: Any) -> Any:
    kp, kd, ki = _gains(p)
    return -(kp * s.error + kd * _slope(x, s, p) + ki * s.integral)


PID_WITH_FILTER = Part(
    "PID with a filtered derivative", ("lagging",),
    {"motor_gain": 16.0, "kp": 2.0, "ki": 6.283185307179586, "kd": 0.15915494309189535, "derivative_filter": 0.01,
     "gain": 0.04},
    gives={"demand": _demand, "kp": lambda x, s, p: _gains(p)[0], "ki": lambda x, s, p: _gains(p)[2]},
    modes=(PartMode("", Law({"lagging": _slope})),),
)  # fmt: skip
"""Tf [s]; with N instead, Tf = kd/(N kp)."""
