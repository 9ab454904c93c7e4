"""Two small systems, which the examples of the engine take.

    belt    x' = v, m v' = F(v) - k x;  or stuck, x' = belt, while k x <= F_static
    ball    x' = v, v' = -g;            v -> -r v + (1 + r) w at an impact with the table a sin(omega t), w = its speed

The block on a belt sticks and slips (Leine et al., Nonlinear Dynamics 16, 1998); its period is 12.0010312948.  The ball
bounces once in every turn of the table, 2 pi/omega, where the table's amplitude a is large enough.
"""

from __future__ import annotations

import math
from typing import Any

import casadi as ca

from .language import Event, Mode, System


def _slip(x: Any, p: Any) -> dict[str, Any]:
    pull = p.static / (1 + p.decay * (p.belt - x.v))
    return {"x": x.v, "v": (pull - p.stiffness * x.x) / p.mass}


def _stick(x: Any, t: Any, p: Any) -> dict[str, Any]:
    return {"x": x.x + p.belt * t, "v": p.belt}


_CATCHES_UP = Event("catches up", lambda x, p: x.v - p.belt, direction=+1, to="stick")
_BREAKS_AWAY = Event("breaks away", lambda x, p: p.stiffness * x.x - p.static, direction=+1, to="slip")

belt = System(
    "block on a belt",
    states=("x", "v"),
    parameters={"mass": 1.0, "stiffness": 1.0, "static": 1.0, "decay": 3.0, "belt": 0.2},
    modes=(
        Mode("slip", field=_slip, holds=lambda x, p: p.belt - x.v, ends=(_CATCHES_UP,)),
        Mode("stick", flow=_stick, holds=lambda x, p: p.static - p.stiffness * x.x, ends=(_BREAKS_AWAY,)),
    ),
)
"""Start it in the mode "slip"."""


def _gap(x: Any, p: Any) -> Any:
    return (x.x - p.a * ca.sin(p.omega * x.t)) / p.a


def _bounce(x: Any, p: Any) -> dict[str, Any]:
    return {"v": -p.r * x.v + (1 + p.r) * p.a * p.omega * ca.cos(p.omega * x.t)}


def _fall(x: Any, t: Any, p: Any) -> dict[str, Any]:
    return {"x": x.x + x.v * t - p.g * t**2 / 2, "v": x.v - p.g * t}


ball = System(
    "ball on a shaking table",
    states=("x", "v"),
    parameters={"a": 0.012, "omega": 20.0, "g": 9.81, "r": 0.8},
    modes=(Mode("flight", flow=_fall, holds=_gap, ends=(Event("impact", _gap, -1, to="flight", reset=_bounce),)),),
    forcing_period=lambda p: 2 * math.pi / p.omega,
)
"""Its cycle is next to x = 0.0119, v = 1.54 at the time 0.07."""
