"""Switch friction as a part of a loop: it reads the rate v and the pull; gives friction, direction and `moving`.

     slip with the sign s: F = s g(v) + sigma2 v;   stick while -Fs_back <= pull <= Fs,   of the pull at standstill

`SWITCH` has one set of numbers, Fs_back = Fs; by_direction.py one for each direction.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

from ..friction import stribeck
from .part import Edge, Law, Part, PartMode


def _rate(x: Any, s: Any, p: Any) -> Any:
    return s.motor_rate / p.stribeck_velocity


def _at_standstill(s: Any) -> Any:
    """The pull without what compensates friction by the sign of the slip: asked at its end, the slip still has one."""
    return s.pull - s.compensation


def switch_friction(
    name: str, parameters: Mapping[str, float], here: Callable[[Any, str], Any], static_back: str
) -> Part:
    """The part of these numbers.

    here: (p, name) -> a number in the direction of the slip, p.sign; static_back: the name of the static friction on
    the way back.
    """

    def slip(x: Any, s: Any, p: Any) -> Any:
        g = stribeck(s.motor_rate, here(p, "static"), here(p, "coulomb"), p.stribeck_velocity)
        return p.sign * g + here(p, "viscous") * s.motor_rate

    def forward(x: Any, s: Any, p: Any) -> Any:
        return _at_standstill(s) / p.static - 1

    def back(x: Any, s: Any, p: Any) -> Any:
        return _at_standstill(s) / getattr(p, static_back) + 1

    def after_stop(x: Any, s: Any, p: Any) -> str:
        return "slip+" if forward(x, s, p) > 0 else "slip-" if back(x, s, p) < 0 else "stick"

    slips = Law(
        gives={"friction": slip, "moving": lambda x, s, p: 1.0, "direction": lambda x, s, p: p.sign},
        holds=lambda x, s, p: p.sign * _rate(x, s, p),
        feature=lambda x, s, p: ca.exp(-(_rate(x, s, p) ** 2)),
    )
    sticks = Law(
        gives={"friction": lambda x, s, p: s.pull, "moving": lambda x, s, p: 0.0, "direction": lambda x, s, p: 0.0},
        holds=lambda x, s, p: -forward(x, s, p) * back(x, s, p),
    )
    return Part(
        name, (), parameters,
        modes=(
            PartMode("slip+", slips, (Edge("stop", _rate, -1, after_stop),), +1,
                     where=lambda x, s, p: s.motor_rate > 0 or s.motor_rate == 0 and forward(x, s, p) > 0),
            PartMode("slip-", slips, (Edge("stop", _rate, +1, after_stop),), -1,
                     where=lambda x, s, p: s.motor_rate < 0 or s.motor_rate == 0 and back(x, s, p) < 0),
            PartMode("stick", sticks, (Edge("breakaway+", forward, +1, "slip+"),
                                       Edge("breakaway-", back, -1, "slip-"))),
        ),
    )  # fmt: skip


SWITCH = switch_friction(
    "Switch friction", {"static": 0.53, "coulomb": 0.44, "stribeck_velocity": 0.02, "viscous": 0.1}, getattr, "static"
)
