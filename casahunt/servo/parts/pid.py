"""PID controllers as parts of a loop: they read error, derivative and integral, and give the torque demanded.

    m = -(kp e + kd derivative + ki x3)     [N m], of a controller by times or by gains (controller.py)

    the integrator   x3' = integrates * integrand - leak_rate x3 + unwinding
    run by a drive   x3 -> (1 - T leak_rate) x3 + T (z + (z_last - z) share + unwinding),  z = integrates * integrand,
                     share = 1/2 by the trapezoid rule, else 0
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

from ..controller import torque_gains_of
from .part import ABOVE_ZERO, Function, Law, Part, PartMode


def pid_of(gains: Callable[[Any], tuple[Any, Any, Any]]) -> dict[str, Function]:
    """What a PID gives whose torque gains (kp, kd, ki) these are, of the parameters."""

    def demand(x: Any, s: Any, p: Any) -> Any:
        kp, kd, ki = gains(p)
        return -(kp * s.error + kd * s.derivative + ki * s.integral)

    each = {name: (lambda x, s, p, k=k: gains(p)[k]) for k, name in enumerate(("kp", "kd", "ki"))}
    return {"demand": demand, **each}


PID_BY_TIMES = Part(
    "PID by times", (),
    {"motor_gain": 16.0, "lead_time": 1 / (2 * math.pi), "integral_time": 1 / (2 * math.pi), "gain": 0.04},
    ranges=dict.fromkeys(("integral_time", "gain"), ABOVE_ZERO),
    gives=pid_of(lambda p: torque_gains_of(p.gain * p.motor_gain, p.lead_time, p.integral_time)),
)  # fmt: skip
PID_BY_GAINS = Part(
    "PID by gains", (), {"motor_gain": 16.0, "kp": 2.0, "ki": 2 * math.pi, "kd": 1 / (2 * math.pi), "gain": 0.04},
    ranges={"gain": ABOVE_ZERO}, gives=pid_of(lambda p: torque_gains_of(p.gain * p.motor_gain, p.kp, p.ki, p.kd)),
)  # fmt: skip


def _summed(x: Any, s: Any, p: Any) -> Any:
    z, T = s.integrates * s.integrand, p.sample_time
    return (1 - T * s.leak_rate) * x.x3 + T * (z + (p.last_integrand - z) * p.trapezoid / 2 + s.unwinding)


INTEGRATOR = Part(
    "integrator", ("x3",),
    gives={"integral": lambda x, s, p: x.x3},
    modes=(PartMode("", Law({
        "x3": lambda x, s, p: s.integrates * s.integrand - s.leak_rate * x.x3 + s.unwinding,
    }, sampled={"x3": _summed})),),
)  # fmt: skip
"""x3 [rad s]."""
