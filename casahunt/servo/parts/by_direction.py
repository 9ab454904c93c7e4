"""Switch friction that differs by direction: the numbers of the one way, and those of the way back."""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..friction import stribeck
from .part import Edge, Law, Part, PartMode


def _of(p: Any, name: str) -> Any:
    """A number of the direction in which the servo slips."""
    return (getattr(p, name) + getattr(p, f"{name}_back")) / 2 + p.sign * (
        getattr(p, name) - getattr(p, f"{name}_back")
    ) / 2


def _slip(x: Any, s: Any, p: Any) -> Any:
    g = stribeck(s.motor_rate, _of(p, "static"), _of(p, "coulomb"), p.stribeck_velocity)
    return p.sign * g + _of(p, "viscous") * s.motor_rate


def _rate(x: Any, s: Any, p: Any) -> Any:
    return s.motor_rate / p.stribeck_velocity


def _after_stop(x: Any, s: Any, p: Any) -> str:
    return "slip+" if s.pull > p.static else "slip-" if s.pull < -p.static_back else "stick"


_EITHER_WAY = Law(
    gives={"friction": _slip, "moving": lambda x, s, p: 1.0, "direction": lambda x, s, p: p.sign},
    holds=lambda x, s, p: p.sign * _rate(x, s, p),
    feature=lambda x, s, p: ca.exp(-(_rate(x, s, p) ** 2)),
)
_HELD = Law(
    gives={"friction": lambda x, s, p: s.pull, "moving": lambda x, s, p: 0.0, "direction": lambda x, s, p: 0.0},
    holds=lambda x, s, p: (1 - s.pull / p.static) * (1 + s.pull / p.static_back),
)

BY_DIRECTION = Part(
    "Switch friction by direction", (),
    {"static": 0.53, "coulomb": 0.44, "viscous": 0.1, "static_back": 0.53, "coulomb_back": 0.44, "viscous_back": 0.1,
     "stribeck_velocity": 0.02},
    modes=(
        PartMode("slip+", _EITHER_WAY, (Edge("stop", _rate, -1, _after_stop),), +1,
                 where=lambda x, s, p: s.motor_rate > 0 or s.motor_rate == 0 and s.pull > p.static),
        PartMode("slip-", _EITHER_WAY, (Edge("stop", _rate, +1, _after_stop),), -1,
                 where=lambda x, s, p: s.motor_rate < 0 or s.motor_rate == 0 and s.pull < -p.static_back),
        PartMode("stick", _HELD, (
            Edge("breakaway+", lambda x, s, p: s.pull / p.static - 1, +1, "slip+"),
            Edge("breakaway-", lambda x, s, p: s.pull / p.static_back + 1, -1, "slip-"),
        )),
    ),
)  # fmt: skip
