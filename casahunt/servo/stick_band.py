"""The Switch servo of the report's simulation, with a stick band of width eta instead of an exact stick.

Controller (see controller.py):   m = -(kp x1 + kd x2 + ki x3),   J x2' = m - F,   x1' = x2,   x3' = x1.

    slip+, slip-               |x2| > eta:              F = sgn(x2) g(x2) + sigma2 x2
    stick                      |x2| <= eta, |m| <= Fs:  F = m + J alpha x2, which is x2' = -alpha x2
    transition+, transition-   |x2| <= eta, |m| > Fs:   F = Fs sgn(m)

This is the report's section 3.2 made consistent.  Printed there, the stick force lacks J and has the wrong
sign, the transition force has the wrong sign for the u of that section, and F lacks sigma2 x2 in slip; the
stick rows and the slip rows of its state equation are right.

As eta -> 0 the motion tends to that of the exact Switch servo (hunting.SWITCH), with a difference of the
order of sqrt(eta): the time to cross the band at breakaway is sqrt(2 J eta/(ki |x1|)).

Symbols: eta [rad/s] and alpha [1/s] are the entries servo.STICK_BAND of the parameter vector, its last.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from ..hybrid.system import Event, Exit, Mode, System
from .hunting import BREAKAWAY_DOWN, BREAKAWAY_UP, SWITCH, motor_torque
from .servo import PARAMETERS, Servo

_NAMES = ("servo.inertia", "friction.static", "friction.stribeck_velocity")
_J, _FS, _VS = (PARAMETERS.index(name) for name in _NAMES)
_ETA, _ALPHA = -2, -1


def parameters(servo: Servo, gain: float) -> np.ndarray:
    """The parameter vector of the servo with a stick band.

    Parameters
    ----------
    servo, gain
        the problem; gain K [V/rad].

    Returns
    -------
    `Servo.names`, then servo.STICK_BAND: eta [rad/s] and alpha [1/s].
    """
    return np.append(servo.parameters(gain), [servo.friction.stick_band, servo.friction.stick_rate])


def band_stick(x: Any, p: Any, sign: Any) -> Any:
    """In the band with |m| <= Fs: the velocity dies out at the rate alpha.

    Parameters
    ----------
    x
        (3,) state with |x2| <= eta.
    p
        parameters as `parameters` gives them.
    sign
        not used.

    Returns
    -------
    (3,) x'.
    """
    return ca.vertcat(x[1], -p[_ALPHA] * x[1], x[0])


def band_transition(x: Any, p: Any, sign: Any) -> Any:
    """In the band with sign m > Fs: static friction is overcome.

    Parameters
    ----------
    x
        (3,) state with |x2| <= eta.
    p
        parameters as `parameters` gives them.
    sign
        that of the motor torque m.

    Returns
    -------
    (3,) x'.
    """
    return ca.vertcat(x[1], (motor_torque(x, p) - sign * p[_FS]) / p[_J], x[0])


def _above(x: Any, duration: Any, p: Any) -> Any:
    return (x[1] - p[_ETA]) / p[_VS]


def _below(x: Any, duration: Any, p: Any) -> Any:
    return (x[1] + p[_ETA]) / p[_VS]


def mode_in_band(x: np.ndarray, p: np.ndarray) -> str:
    """The mode at |x2| <= eta.

    Parameters
    ----------
    x
        (3,) state.
    p
        parameters as `parameters` gives them.

    Returns
    -------
    "stick", "transition+" or "transition-".
    """
    m = float(motor_torque(x, p))
    return "stick" if abs(m) <= p[_FS] else ("transition+" if m > 0 else "transition-")


def mode_of(x: np.ndarray, p: np.ndarray) -> str:
    """The mode at any state.

    Parameters
    ----------
    x
        (3,) state.
    p
        parameters as `parameters` gives them.

    Returns
    -------
    "slip+" or "slip-" outside the band, else as `mode_in_band`.
    """
    if abs(x[1]) > p[_ETA]:
        return "slip+" if x[1] > 0 else "slip-"
    return mode_in_band(x, p)


def _to(name: str) -> Any:
    return lambda x, p: name


_INTO = {"slip+": Event("band", _above), "slip-": Event("band", _below)}
_OUT = (Exit(Event("slip+", _above), +1, _to("slip+")), Exit(Event("slip-", _below), -1, _to("slip-")))

REGULARISED = System(
    "switch",
    SWITCH.states,
    {name: SWITCH.modes[name] for name in ("slip+", "slip-")}
    | {"stick": Mode("stick", band_stick)}
    | {f"transition{sign}": Mode(f"transition{sign}", band_transition, float(f"{sign}1")) for sign in "+-"},
    {
        "slip+": (Exit(_INTO["slip+"], -1, mode_in_band),),
        "slip-": (Exit(_INTO["slip-"], +1, mode_in_band),),
        "stick": (
            Exit(BREAKAWAY_UP, +1, _to("transition+")),
            Exit(BREAKAWAY_DOWN, -1, _to("transition-")),
        ),
        "transition+": (*_OUT, Exit(Event("stick", BREAKAWAY_UP.function), -1, _to("stick"))),
        "transition-": (*_OUT, Exit(Event("stick", BREAKAWAY_DOWN.function), +1, _to("stick"))),
    },
)
"""The hybrid automaton; its parameter vector is that of `parameters`."""
