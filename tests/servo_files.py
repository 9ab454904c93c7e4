"""Servo files for the tests."""

from __future__ import annotations

from casahunt import Friction, Pid, Servo
from casahunt.servo.servo import flatten

ROTARY = Servo(
    inertia=0.0035, motor_gain=1.0, controller=Pid(kp=4, ki=30, kd=0.12),
    friction=Friction(static=0.8, coulomb=0.55, stribeck_velocity=0.08, viscous=0.02),
)  # fmt: skip
"""A rotary axis with a controller by gains."""


def dump(servo: Servo) -> str:
    """The servo as TOML text; `load` reads back exactly the same numbers."""
    lines: list[str] = []
    section = ""
    for key, value in flatten(servo).items():
        head, name = key.split(".")
        if head != section:
            lines += ([""] if lines else []) + [f"[{head}]"]
            section = head
        lines.append(f"{name} = {value!r}")
    return "\n".join(lines) + "\n"
