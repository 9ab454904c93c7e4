"""Servo files for the tests."""

from __future__ import annotations

import json

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


def linear_axis(*parts: str, **values: float | str) -> str:
    """The file of an axis shown in mm: a P-PI cascade, and these parts; values in SI, or texts with their units."""
    named = [part if part.startswith("{") else f'"{part}"' for part in ("cascade P-PI", "integrator", *parts)]
    controller, plant = named[:2], named[2:] if "two masses" in parts else ['"one inertia"', *named[2:]]
    numbers = {"motor_gain": 1, "gain": 1} | values
    lines = "".join(f"{name} = {json.dumps(value)}\n" for name, value in numbers.items())
    every = ", ".join([*plant[:2], *controller, *plant[2:]])
    return f'[units]\nmotion = "linear"\nlength = "mm"\n[loop]\nparts = [{every}]\n[values]\n{lines}'
