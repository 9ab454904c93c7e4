"""Dry friction of one servo axis: the identified numbers, and the laws as CasADi expressions.

Stribeck curve (report, section 3):     g(v) = Fc + (Fs - Fc) exp(-(v/vs)^2)          [N m]
Switch model, slip with sign s = +-1:   F = s g(v) + sigma2 v
LuGre model (bristle deflection z):     z' = v - sigma0 |v| z / g(v)
                                        F  = sigma0 z + sigma1 z' + sigma2 v

The bristle equation is the report's state equation; the formula printed in its section 3.1 lacks
sigma0.  Both models have the same steady sliding friction, g(v) sgn(v) + sigma2 v.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, Literal

import casadi as ca

from ..checks import floated, require, sensible

Model = Literal["switch", "lugre"]
MODELS: tuple[Model, ...] = ("switch", "lugre")
BRISTLE = ("friction.stiffness", "friction.damping")
"""Parameters of the LuGre model alone."""

@dataclass(frozen=True, kw_only=True)
class Friction:
    """Identified friction parameters; the defaults are Table 1 of the report.

    Attributes
    ----------
    static : Fs, static friction torque [N m], at least `coulomb`.
    coulomb : Fc, Coulomb friction torque [N m], > 0.
    stribeck_velocity : vs [rad/s], > 0.
    viscous : sigma2 [N m s/rad], >= 0.
    stiffness : sigma0, bristle stiffness [N m/rad], > 0 (LuGre only).
    damping : sigma1, bristle damping [N m s/rad], >= 0 (LuGre only).
    stick_band, stick_rate : eta [rad/s] and alpha [1/s] of the report's regularised simulation alone, > 0.

    Examples
    --------
    >>> from casahunt import Friction, Servo
    >>> Servo(friction=Friction(static=0.5, coulomb=0.45)).friction.static
    0.5
    """

    static: float = 0.53
    coulomb: float = 0.44
    stribeck_velocity: float = 0.02
    viscous: float = 0.1
    stiffness: float = 2.2e4
    damping: float = 7.58
    stick_band: float = 1e-6
    stick_rate: float = 10.0

    def __post_init__(self) -> None:
        sensible("friction.coulomb", self.coulomb)
        sensible("friction.static", self.static)
        if self.static < self.coulomb:
            require("friction.static", self.static, at_least=self.coulomb, unit="friction.coulomb")
        sensible("friction.stribeck_velocity", self.stribeck_velocity)
        sensible("friction.viscous", self.viscous, zero=True)
        sensible("friction.stiffness", self.stiffness)
        sensible("friction.damping", self.damping, zero=True)
        sensible("friction.stick_band", self.stick_band)
        sensible("friction.stick_rate", self.stick_rate)
        floated(self)


def stribeck(v: Any, static: Any, coulomb: Any, stribeck_velocity: Any) -> Any:
    """The Stribeck curve g(v) as a CasADi expression.

    v: velocity [rad/s]; static, coulomb: Fs and Fc [N m]; stribeck_velocity: vs [rad/s].
    Returns g(v) = Fc + (Fs - Fc) exp(-(v/vs)^2) [N m].
    """
    return coulomb + (static - coulomb) * ca.exp(-((v / stribeck_velocity) ** 2))


def pairs_of(servo: Any) -> dict[str, str]:
    """The names of the Coulomb frictions by those of the static ones: of motor, load, and each direction."""
    pairs = {name: name.replace("static", "coulomb") for name in servo.names if "static" in name}
    return {static: coulomb for static, coulomb in pairs.items() if coulomb in servo.names}


def steepest(friction: Friction) -> float:
    """The largest drop -g'(v) of the Stribeck curve [N m s/rad]: at v = vs/sqrt(2)."""
    return math.sqrt(2 / math.e) * (friction.static - friction.coulomb) / friction.stribeck_velocity
