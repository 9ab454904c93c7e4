"""Plants: what the motor moves, as parts of a loop.

    one inertia     J x2' = pull - F,   x1' = x2;   pull = torque + compensation + external   [N m]

While the friction sticks (`moving` = 0) nothing of the inertia moves.
"""

from __future__ import annotations

from .part import ABOVE_ZERO, Law, Part, PartMode

INERTIA = Part(
    "one inertia", ("x1", "x2"), {"inertia": 0.026}, angles=("x1",), ranges={"inertia": ABOVE_ZERO},
    gives={
        "motor_angle": lambda x, s, p: x.x1,
        "motor_rate": lambda x, s, p: x.x2,
        "pull": lambda x, s, p: s.torque + s.compensation + s.external,
    },
    modes=(PartMode("", Law({
        "x1": lambda x, s, p: s.moving * x.x2,
        "x2": lambda x, s, p: s.moving * (s.pull - s.friction) / p.inertia,
    })),),
)  # fmt: skip
"""x1 [rad], x2 [rad/s]; inertia J [kg m2]."""
