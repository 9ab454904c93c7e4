"""Switch friction as a part of a loop: it reads the rate v and the pull; gives friction, direction and `moving`.

     slip with the sign s: F = s g(v) + sigma2 v;   stick while |pull| <= Fs
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..friction import stribeck
from .part import Edge, Law, Part, PartMode


def _slip(x: Any, s: Any, p: Any) -> Any:
    g = stribeck(s.motor_rate, p.static, p.coulomb, p.stribeck_velocity)
    return p.sign * g + p.viscous * s.motor_rate


def _rate(x: Any, s: Any, p: Any) -> Any:
    return s.motor_rate / p.stribeck_velocity


def _after_stop(x: Any, s: Any, p: Any) -> str:
    return "stick" if abs(s.pull) <= p.static else ("slip+" if s.pull > 0 else "slip-")


_SLIP = Law(
    gives={"friction": _slip, "moving": lambda x, s, p: 1.0, "direction": lambda x, s, p: p.sign},
    holds=lambda x, s, p: p.sign * _rate(x, s, p),
    feature=lambda x, s, p: ca.exp(-(_rate(x, s, p) ** 2)),
)
_STICK = Law(
    gives={"friction": lambda x, s, p: s.pull, "moving": lambda x, s, p: 0.0, "direction": lambda x, s, p: 0.0},
    holds=lambda x, s, p: 1 - (s.pull / p.static) ** 2,
)

SWITCH = Part(
    "Switch friction", (),
    {"static": 0.53, "coulomb": 0.44, "stribeck_velocity": 0.02, "viscous": 0.1},
    modes=(
        PartMode("slip+", _SLIP, (Edge("stop", _rate, -1, _after_stop),), +1,
                 where=lambda x, s, p: s.motor_rate > 0 or s.motor_rate == 0 and s.pull > p.static),
        PartMode("slip-", _SLIP, (Edge("stop", _rate, +1, _after_stop),), -1,
                 where=lambda x, s, p: s.motor_rate < 0 or s.motor_rate == 0 and s.pull < -p.static),
        PartMode("stick", _STICK, (
            Edge("breakaway+", lambda x, s, p: s.pull / p.static - 1, +1, "slip+"),
            Edge("breakaway-", lambda x, s, p: s.pull / p.static + 1, -1, "slip-"),
        )),
    ),
)  # fmt: skip
