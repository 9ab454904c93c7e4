"""Two masses with a shaft: the motor, and a load that turns it.

    J x2' = moving (pull - F),                  x1' = moving x2                        the motor
    JL w' = load_moving (load_pull - F_load),   phi' = load_moving w                   the load
    shaft = k (x1 - phi) + d (x2 - w);   pull = torque + compensation + external - shaft
    load_pull = shaft - dL w + load_external

The controller sees the motor, or the load.  Both can have friction: that of the load is a part of its own.
"""

from __future__ import annotations

from typing import Any

from .part import ABOVE_ZERO, Law, Part, PartMode


def _shaft(x: Any, s: Any, p: Any) -> Any:
    return p.shaft_stiffness * (x.x1 - x.load_angle) + p.shaft_damping * (x.x2 - x.load_rate)


def _plant(name: str, load_is_seen: bool) -> Part:
    seen = {"angle": lambda x, s, p: x.load_angle, "rate": lambda x, s, p: x.load_rate} if load_is_seen else {}
    return Part(
        name, ("x1", "x2", "load_angle", "load_rate"),
        {"inertia": 0.026, "load_inertia": 0.026, "shaft_stiffness": 100.0, "shaft_damping": 0.0, "load_damping": 0.0},
        angles=("x1", "load_angle"), ranges=dict.fromkeys(("inertia", "load_inertia"), ABOVE_ZERO),
        gives={
            "motor_angle": lambda x, s, p: x.x1,
            "motor_rate": lambda x, s, p: x.x2,
            "pull": lambda x, s, p: s.torque + s.compensation + s.external - _shaft(x, s, p),
            "load_angle": lambda x, s, p: x.load_angle,
            "load_rate": lambda x, s, p: x.load_rate,
            "load_pull": lambda x, s, p: _shaft(x, s, p) - p.load_damping * x.load_rate + s.load_external,
            **seen,
        },
        modes=(PartMode("", Law({
            "x1": lambda x, s, p: s.moving * x.x2,
            "x2": lambda x, s, p: s.moving * (s.pull - s.friction) / p.inertia,
            "load_angle": lambda x, s, p: s.load_moving * x.load_rate,
            "load_rate": lambda x, s, p: s.load_moving * (s.load_pull - s.load_friction) / p.load_inertia,
        })),),
    )  # fmt: skip


TWO_MASSES = _plant("two masses", load_is_seen=False)
TWO_MASSES_LOAD_SEEN = _plant("two masses, load measured", load_is_seen=True)
