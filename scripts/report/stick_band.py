"""The Switch servo of the report's simulation, with a stick band of width eta instead of an exact stick.

Controller (see servo/controller.py):   m = -(kp x1 + kd x2 + ki x3),   J x2' = m - F,   x1' = x2,   x3' = x1.

    slip+, slip-               |x2| > eta:              F = sgn(x2) g(x2) + sigma2 x2
    stick                      |x2| <= eta, |m| <= Fs:  F = m + J alpha x2, which is x2' = -alpha x2
    transition+, transition-   |x2| <= eta, |m| > Fs:   F = Fs sgn(m)

This is the report's section 3.2 made consistent.  Printed there, the stick force lacks J and has the wrong
sign, the transition force has the wrong sign for the u of that section, and F lacks sigma2 x2 in slip; the
stick rows and the slip rows of its state equation are right.

As eta -> 0 the motion tends to that of the exact Switch servo (servo/problem.py), with a difference of the
order of sqrt(eta): the time to cross the band at breakaway is sqrt(2 J eta/(ki |x1|)).

Written as any user writes a system, like servo/problem.py; eta [rad/s] and alpha [1/s], p.stick_band and
p.stick_rate, are the entries STICK_BAND of the parameter vector, its last.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from casahunt import Servo
from casahunt.hybrid import Event, Mode, System
from casahunt.servo.controller import torque_gains_of
from casahunt.servo.friction import stribeck
from casahunt.servo.problem import STATES
from casahunt.servo.servo import called

STICK_BAND = ("friction.stick_band", "friction.stick_rate")
"""Entries of the parameter vector behind those of the servo."""


def motor_torque(x: Any, p: Any) -> Any:
    """m, of a controller by its times [N m]."""
    kp, kd, ki = torque_gains_of(p.gain * p.motor_gain, p.lead_time, p.integral_time)
    return -(kp * x.x1 + kd * x.x2 + ki * x.x3)


def _slip(x: Any, p: Any) -> dict[str, Any]:
    """That of the exact servo."""
    F = p.sign * stribeck(x.x2, p.static, p.coulomb, p.stribeck_velocity) + p.viscous * x.x2
    return {"x1": x.x2, "x2": (motor_torque(x, p) - F) / p.inertia, "x3": x.x1}


def _moves_forward(x: Any, p: Any) -> Any:
    return p.sign * x.x2 / p.stribeck_velocity


def _stribeck_drop(x: Any, p: Any) -> Any:
    return ca.exp(-((x.x2 / p.stribeck_velocity) ** 2))


def _torque_up(x: Any, p: Any) -> Any:
    return motor_torque(x, p) / p.static - 1


def _torque_down(x: Any, p: Any) -> Any:
    return motor_torque(x, p) / p.static + 1


def _stick(x: Any, p: Any) -> dict[str, Any]:
    """The velocity dies out at the rate alpha."""
    return {"x1": x.x2, "x2": -p.stick_rate * x.x2, "x3": x.x1}


def _transition(x: Any, p: Any) -> dict[str, Any]:
    """Static friction is overcome, with p.sign = sgn(m)."""
    return {"x1": x.x2, "x2": (motor_torque(x, p) - p.sign * p.static) / p.inertia, "x3": x.x1}


def _above(x: Any, p: Any) -> Any:
    return (x.x2 - p.stick_band) / p.stribeck_velocity


def _below(x: Any, p: Any) -> Any:
    return (x.x2 + p.stick_band) / p.stribeck_velocity


def _in_band(x: Any, p: Any) -> str:
    m = motor_torque(x, p)
    return "stick" if abs(m) <= p.static else ("transition+" if m > 0 else "transition-")


_OUT = (Event("slip+", _above, +1, to="slip+"), Event("slip-", _below, -1, to="slip-"))

MODES_WITH_BAND = (
    Mode("slip+", _slip, sign=+1, holds=_moves_forward, feature=_stribeck_drop,
         ends=(Event("band", _above, -1, to=_in_band),)),
    Mode("slip-", _slip, sign=-1, holds=_moves_forward, feature=_stribeck_drop,
         ends=(Event("band", _below, +1, to=_in_band),)),
    Mode("stick", _stick, ends=(Event("breakaway+", _torque_up, +1, to="transition+"),
                                Event("breakaway-", _torque_down, -1, to="transition-"))),
    Mode("transition+", _transition, sign=+1, ends=(*_OUT, Event("stick", _torque_up, -1, to="stick"))),
    Mode("transition-", _transition, sign=-1, ends=(*_OUT, Event("stick", _torque_down, +1, to="stick"))),
)


def band_system(servo: Servo, gain: float) -> System:
    """A Switch servo with its stick band as a system like any user's.

    servo, gain: the problem; gain K > 0 [V/rad]. Returns system with the parameters of `parameters`, by the last parts
    of their names. Raises InputError: a value out of range.
    """
    values = map(float, parameters(servo, gain))
    names = called(servo.names + STICK_BAND)
    return System("servo with a stick band", STATES["switch"], dict(zip(names, values, strict=True)), MODES_WITH_BAND)


def parameters(servo: Servo, gain: float) -> np.ndarray:
    """The parameter vector of the servo with a stick band.

    servo, gain: the problem; gain K [V/rad]. Returns `Servo.names`, then STICK_BAND: eta [rad/s] and alpha [1/s].
    """
    return np.append(servo.parameters(gain), [servo.friction.stick_band, servo.friction.stick_rate])


def mode_of(x: Any, p: Any) -> str:
    """The mode at any state.

    Returns "slip+" or "slip-" outside the band, in it "stick", "transition+" or "transition-".
    """
    if abs(x.x2) > p.stick_band:
        return "slip+" if x.x2 > 0 else "slip-"
    return _in_band(x, p)
