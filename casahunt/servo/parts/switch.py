"""Switch friction as a part of a loop: it reads the rate v and the pull; gives friction, direction and `moving`.

     slip with the sign s: F = s g(v) + sigma2 v;   stick while -Fs_back <= pull <= Fs,   of the pull at standstill

`SWITCH` has one set of numbers, Fs_back = Fs, `BY_DIRECTION` one for each direction, tabulated.py a curve F(v).  On
the load of two masses it is another part, whose signals and parameters begin with load_: modes are then products.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import casadi as ca

from ..friction import stribeck
from .part import ABOVE_ZERO, Edge, Function, Law, Part, PartMode

Torque = Callable[[Any, Any], Any]
"""(v, p) -> F of a slip with the sign p.sign."""


def switch_friction(
    name: str, parameters: Mapping[str, float], torque: Torque, *, back: str = "static",
    scale: Callable[[Any], Any] = lambda p: p.stribeck_velocity, at: str = "",
    ranges: Mapping[str, tuple[float, float]] | None = None, **more: Any,
) -> Part:  # fmt: skip
    """The part of these numbers.

    back: the name of the static friction on the way back; scale: a rate at which friction changes [rad/s]; at: what the
    names of signals, modes and events begin with, and those of the parameters that are not given by name.
    """
    rate, pull = (at or "motor_") + "rate", at + "pull"
    called = at.replace("_", " ")
    divisors = {at + "static", at + back, at + "stribeck_velocity"} & set(parameters)

    def relative(x: Any, s: Any, p: Any) -> Any:
        return getattr(s, rate) / scale(p)

    def standing(s: Any) -> Any:  # asked at the end of a slip, what compensates friction by its sign still does
        return getattr(s, pull) - (0 if at else s.compensation)

    def forward(x: Any, s: Any, p: Any) -> Any:
        return standing(s) / getattr(p, at + "static") - 1

    def backward(x: Any, s: Any, p: Any) -> Any:
        return standing(s) / getattr(p, at + back) + 1

    def after_stop(x: Any, s: Any, p: Any) -> str:
        state = "slip+" if forward(x, s, p) > 0 else "slip-" if backward(x, s, p) < 0 else "stick"
        return called + state

    def starts(sign: float, beyond: Function) -> Function:
        return lambda x, s, p: sign * getattr(s, rate) > 0 or getattr(s, rate) == 0 and sign * beyond(x, s, p) > 0

    slips = Law(
        gives={at + "friction": lambda x, s, p: torque(getattr(s, rate), p), at + "moving": lambda x, s, p: 1.0,
               at + "direction": lambda x, s, p: p.sign},
        holds=lambda x, s, p: p.sign * relative(x, s, p),
        feature=lambda x, s, p: ca.exp(-(relative(x, s, p) ** 2)),
    )  # fmt: skip
    sticks = Law(
        gives={at + "friction": lambda x, s, p: getattr(s, pull), at + "moving": lambda x, s, p: 0.0,
               at + "direction": lambda x, s, p: 0.0},
        holds=lambda x, s, p: ca.fmin(-forward(x, s, p), backward(x, s, p)),
    )  # fmt: skip
    plus, minus = f"{called}slip+", f"{called}slip-"
    return Part(
        name, (), parameters, ranges={**dict.fromkeys(divisors, ABOVE_ZERO), **(ranges or {})}, **more,
        modes=(
            PartMode(plus, slips, (Edge(f"{called}stop", relative, -1, after_stop),), +1, where=starts(+1, forward)),
            PartMode(minus, slips, (Edge(f"{called}stop", relative, +1, after_stop),), -1, where=starts(-1, backward)),
            PartMode(f"{called}stick", sticks, (Edge(f"{called}breakaway+", forward, +1, plus),
                                                Edge(f"{called}breakaway-", backward, -1, minus))),
        ),
    )  # fmt: skip


def _stribeck(at: str) -> dict[str, Any]:
    """The Stribeck curve of the parameters whose names begin so."""

    def torque(v: Any, p: Any) -> Any:
        static, coulomb, velocity, viscous = (getattr(p, at + name) for name in TABLE_1)
        return p.sign * stribeck(v, static, coulomb, velocity) + viscous * v

    return {
        "parameters": {at + name: value for name, value in TABLE_1.items()},
        "torque": torque, "at": at, "scale": lambda p: getattr(p, at + "stribeck_velocity"),
    }  # fmt: skip


TABLE_1 = {"static": 0.53, "coulomb": 0.44, "stribeck_velocity": 0.02, "viscous": 0.1}
SWITCH = switch_friction("Switch friction", **_stribeck(""))
LOAD_SWITCH = switch_friction("Switch friction of the load", **_stribeck("load_"))
NO_FRICTION = Part(
    "no friction",
    gives={"friction": lambda x, s, p: 0.0, "moving": lambda x, s, p: 1.0, "direction": lambda x, s, p: 0.0},
)
"""Of a motor without any: it is the load that has it."""


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
