"""Switch friction that differs by direction: the numbers of the one way, and those of the way back."""

from __future__ import annotations

from typing import Any

from ..friction import stribeck
from .switch import switch_friction


def by_sign(p: Any, forward: Any, back: Any) -> Any:
    """What is `forward` in a slip with the sign +1 and `back` in one with -1."""
    return (forward + back) / 2 + p.sign * (forward - back) / 2


def _torque(v: Any, p: Any) -> Any:
    static, coulomb, viscous = (
        by_sign(p, getattr(p, name), getattr(p, f"{name}_back")) for name in ("static", "coulomb", "viscous")
    )
    return p.sign * stribeck(v, static, coulomb, p.stribeck_velocity) + viscous * v


BY_DIRECTION = switch_friction(
    "Switch friction by direction",
    {"static": 0.53, "coulomb": 0.44, "viscous": 0.1, "static_back": 0.53, "coulomb_back": 0.44, "viscous_back": 0.1,
     "stribeck_velocity": 0.02},
    _torque, back="static_back",
)  # fmt: skip
