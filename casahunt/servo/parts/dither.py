"""Dither, by its averaged friction curve: an approximation for a dither that is fast against the motion of the servo.

The rate is v + a n, n normal with mean 0 and variance 1, a [rad/s] the size.  The mean of the friction of v + a n is

    Fc erf(v/(a sqrt2)) + (Fs - Fc) c exp(-c^2 (v/vs)^2) erf(c v/(a sqrt2)) + sigma2 v,   c = vs/sqrt(vs^2 + 2 a^2)

smooth, so that nothing sticks and the servo comes to rest at its set point alone.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import casadi as ca

from .part import Law, Part, PartMode
from .remedy import Corners, Remedy


def _mean(x: Any, s: Any, p: Any) -> Any:
    v, vs, a = s.motor_rate, p.stribeck_velocity, p.dither
    c = vs / ca.sqrt(vs**2 + 2 * a**2)
    reach = v / (a * ca.sqrt(2))
    peak = (p.static - p.coulomb) * c * ca.exp(-((c * v / vs) ** 2)) * ca.erf(c * reach)
    return p.coulomb * ca.erf(reach) + peak + p.viscous * v


DITHERED = Part(
    "dithered friction", (),
    {"dither": 0.0, "static": 0.53, "coulomb": 0.44, "stribeck_velocity": 0.02, "viscous": 0.1},
    modes=(PartMode("", Law(
        gives={"friction": _mean, "moving": lambda x, s, p: 1.0,
               "direction": lambda x, s, p: ca.erf(s.motor_rate / (p.dither * ca.sqrt(2)))},  # mean of the sign
        feature=lambda x, s, p: ca.erf(s.motor_rate / p.dither), stiff=True,
    )),),
)  # fmt: skip


def _rests(size: float, p: Mapping[str, float]) -> Corners:
    return ((0.0, 0.0),)


REMEDIES = (
    Remedy("dither", "dither", "rad/s", _rests, DITHERED, instead="Switch friction",
           scale="stribeck_velocity", first=0.05, last=100.0, needs=("switch",)),
)  # fmt: skip
