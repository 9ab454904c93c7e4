"""Controllers as parts of a loop: they read error, error_rate and integral, and give the torque demanded.

    m = -(kp e + kd e' + ki x3)     [N m], of a controller by times or by gains (controller.py)

    the integrator   x3' = integrates * integrand - leak_rate x3 + unwinding
"""

from __future__ import annotations

import math

from ..controller import torque_gains_of_times
from .part import Law, Part, PartMode


def _by_times(x, s, p):
    kp, kd, ki = torque_gains_of_times(p.gain * p.motor_gain, p.lead_time, p.integral_time)
    return -(kp * s.error + kd * s.error_rate + ki * s.integral)


PID_BY_TIMES = Part(
    "PID by times", (),
    {"motor_gain": 16.0, "lead_time": 1 / (2 * math.pi), "integral_time": 1 / (2 * math.pi), "gain": 0.04},
    gives={"demand": _by_times},
)

INTEGRATOR = Part(
    "integrator", ("x3",),
    gives={"integral": lambda x, s, p: x.x3},
    modes=(PartMode("", Law({
        "x3": lambda x, s, p: s.integrates * s.integrand - s.leak_rate * x.x3 + s.unwinding,
    })),),
)  # fmt: skip
