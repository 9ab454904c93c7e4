"""PID controllers as parts of a loop: they read error, error_rate and integral, and give the torque demanded.

    m = -(kp e + kd e' + ki x3)     [N m], of a controller by times or by gains (controller.py)

    the integrator   x3' = integrates * integrand - leak_rate x3 + unwinding
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ..controller import torque_gains_of_gains, torque_gains_of_times
from .part import Law, Part, PartMode


def _by_times(p: Any) -> tuple[Any, Any, Any]:
    return torque_gains_of_times(p.gain * p.motor_gain, p.lead_time, p.integral_time)


def _by_gains(p: Any) -> tuple[Any, Any, Any]:
    return torque_gains_of_gains(p.gain * p.motor_gain, p.kp, p.ki, p.kd)


def _demand(gains: Callable[[Any], tuple[Any, Any, Any]]) -> Callable[[Any, Any, Any], Any]:
    def demand(x: Any, s: Any, p: Any) -> Any:
        kp, kd, ki = gains(p)
        return -(kp * s.error + kd * s.error_rate + ki * s.integral)

    return demand


PID_BY_TIMES = Part(
    "PID by times", (),
    {"motor_gain": 16.0, "lead_time": 1 / (2 * math.pi), "integral_time": 1 / (2 * math.pi), "gain": 0.04},
    gives={"demand": _demand(_by_times), "kp": lambda x, s, p: _by_times(p)[0], "ki": lambda x, s, p: _by_times(p)[2]},
)  # fmt: skip
PID_BY_GAINS = Part(
    "PID by gains", (), {"motor_gain": 16.0, "kp": 2.0, "ki": 2 * math.pi, "kd": 1 / (2 * math.pi), "gain": 0.04},
    gives={"demand": _demand(_by_gains), "kp": lambda x, s, p: _by_gains(p)[0], "ki": lambda x, s, p: _by_gains(p)[2]},
)  # fmt: skip

INTEGRATOR = Part(
    "integrator", ("x3",),
    gives={"integral": lambda x, s, p: x.x3},
    modes=(PartMode("", Law({
        "x3": lambda x, s, p: s.integrates * s.integrand - s.leak_rate * x.x3 + s.unwinding,
    })),),
)  # fmt: skip
"""x3 [rad s]."""
