"""Switch friction that differs by direction: the numbers of the one way, and those of the way back."""

from __future__ import annotations

from typing import Any

from .switch import switch_friction


def _here(p: Any, name: str) -> Any:
    """A number of the direction in which the servo slips."""
    forward, back = getattr(p, name), getattr(p, f"{name}_back")
    return (forward + back) / 2 + p.sign * (forward - back) / 2


BY_DIRECTION = switch_friction(
    "Switch friction by direction",
    {"static": 0.53, "coulomb": 0.44, "viscous": 0.1, "static_back": 0.53, "coulomb_back": 0.44, "viscous_back": 0.1,
     "stribeck_velocity": 0.02},
    _here, "static_back",
)  # fmt: skip
