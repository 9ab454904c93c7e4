"""LuGre friction as a part of a loop: it reads the rate v, gives the friction, and has the bristles' deflection.

    z' = v - sigma0 |v| z/g(v),   F = sigma0 z + sigma1 z' + sigma2 v;   the kink |v| splits it in modes (problem.py)
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from ..friction import stribeck
from .part import ABOVE_ZERO, Edge, Function, Law, Part, PartMode

WEAK = 1e-8
"""A reversal whose net torque |J v'| is below this part of Fs gets no phase boundary.

Measured at Table 1, tolerance 1e-9: with boundaries at every reversal above 1e-5 the mesh takes 80 to 110
intervals and 0.06 to 0.1 s and the multipliers are right to 1e-8; above 1e-2, 110 to 130 intervals, 0.5 to
1.1 s and 1e-4, because kinks inside intervals spoil the order."""


def _rate(speed: Function) -> Function:
    """z' with |v| as `speed` has it."""

    def rate(x: Any, s: Any, p: Any) -> Any:
        g = stribeck(s.motor_rate, p.static, p.coulomb, p.stribeck_velocity)
        return s.motor_rate - p.stiffness * speed(x, s, p) * x.x4 / g

    return rate


_bristle = _rate(lambda x, s, p: p.sign * s.motor_rate)
_bristle_either_way = _rate(lambda x, s, p: ca.fabs(s.motor_rate))


def _force(rate: Function) -> Function:
    """F with this z'."""
    return lambda x, s, p: p.stiffness * x.x4 + p.damping * rate(x, s, p) + p.viscous * s.motor_rate


def _feature(x: Any, s: Any, p: Any) -> Any:
    return ca.exp(-((s.motor_rate / p.stribeck_velocity) ** 2))


def _strength(x: Any, s: Any, p: Any) -> Any:
    """The net torque J v'/Fs at v = 0, whose sign is that of the motion to come."""
    return (s.pull - (p.stiffness * x.x4 + p.damping * s.motor_rate)) / p.static


def _after(x: Any, s: Any, p: Any) -> str:
    strength = _strength(x, s, p)
    return "slide" if abs(strength) < WEAK else ("slide+" if strength > 0 else "slide-")


def _centre(x: Any, s: Any, p: Any) -> Any:
    return s.motor_angle * s.kp / p.static


def _reversal(x: Any, s: Any, p: Any) -> Any:
    return s.motor_rate / p.stribeck_velocity


_SLIDE = Law(
    {"x4": _bristle},
    {"friction": _force(_bristle), "moving": lambda x, s, p: 1.0, "direction": lambda x, s, p: p.sign},
    holds=lambda x, s, p: p.sign * s.motor_rate * ca.sqrt(p.stiffness * p.inertia) / p.static,
    feature=_feature, stiff=True, slack=10 * WEAK,
)  # fmt: skip
_EITHER = Law(
    {"x4": _bristle_either_way},
    {"friction": _force(_bristle_either_way), "moving": lambda x, s, p: 1.0, "direction": lambda x, s, p: 0.0},
    feature=_feature, stiff=True, smooth=False,
)  # fmt: skip

LUGRE = Part(
    "LuGre friction", ("x4",),
    {"static": 0.53, "coulomb": 0.44, "stribeck_velocity": 0.02, "viscous": 0.1, "stiffness": 2.2e4, "damping": 7.58},
    ranges=dict.fromkeys(("static", "coulomb", "stribeck_velocity", "stiffness"), ABOVE_ZERO),
    modes=(
        PartMode("slide+", _SLIDE, (Edge("reversal", _reversal, -1, _after), Edge("centre", _centre, +1, "slide+")), +1,
                 "slide", lambda x, s, p: s.motor_rate > 0 or s.motor_rate == 0 and _strength(x, s, p) >= 0),
        PartMode("slide-", _SLIDE, (Edge("reversal", _reversal, +1, _after), Edge("centre", _centre, -1, "slide-")), -1,
                 "slide"),
        PartMode("slide", _EITHER, (
            Edge("centre", _centre, 0, lambda x, s, p: "slide+" if s.motor_rate > 0 else "slide-"),
        )),
    ),
)  # fmt: skip
