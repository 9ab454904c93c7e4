"""The controller in its two forms; the gain K multiplies either.

    by times   C(s) = K (tau_d s + 1)(tau_i s + 1) / (tau_i s)        `Controller`: real zeros
    by gains   C(s) = K (kp' + ki'/s + kd' s)                         `Pid`: any PID, complex zeros too

with K in V/rad, tau_d, tau_i, kd' in s, ki' in 1/s, kp' a number.  The torque gains [N m/rad, N m s/rad, N m/(rad s)]
are, with the motor gain cm [N m/V], by times and by gains,

    kp = K cm (1 + tau_d/tau_i) = K cm kp',   kd = K cm tau_d = K cm kd',   ki = K cm/tau_i = K cm ki'.

The two forms are the same controller at the same K where kp' = 1 + tau_d/tau_i, kd' = tau_d and ki' = 1/tau_i
(`Controller.pid`).  Only the products with K cm count: at K = 1 V/rad kp', ki', kd' are the gains of the voltage, and
where also cm = 1 N m/V those of the torque.

    reset time   kp/ki = tau_i + tau_d                                [s]

In it alone the controller's shape stands in Routh's condition, (kd + sigma2) kp > J ki: kd + sigma2 > J ki/kp.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..checks import LARGEST, SMALLEST, floated, number, sensible, shown
from ..errors import InputError

Array = np.ndarray

_TABLE_1_TIME = 1 / (2 * np.pi)


def torque_gains_of(factor: Any, *numbers: Any) -> tuple[Any, Any, Any]:
    """The torque gains of a controller; numbers, arrays or expressions.

    factor: K cm [N m/rad]; numbers: tau_d, tau_i [s]; or kp, ki, kd, gains at K = 1: a number, [1/s], [s].
    Returns (kp, kd, ki) [N m/rad, N m s/rad, N m/(rad s)].
    """
    if len(numbers) == 2:
        lead_time, integral_time = numbers
        return factor * (1 + lead_time / integral_time), factor * lead_time, factor / integral_time
    kp, ki, kd = numbers
    return factor * kp, factor * kd, factor * ki


class _Law:
    """What both forms have."""

    def torque_gains(self, factor: float) -> tuple[float, float, float]:
        """(kp, kd, ki) [N m/rad, N m s/rad, N m/(rad s)] for K cm = `factor` [N m/rad]."""
        return torque_gains_of(factor, *vars(self).values())

    def response(self, gain: float, s: Array) -> Array:
        """The transfer function.

        Parameters
        ----------
        gain
            K [V/rad].
        s
            (m,) complex [1/s].

        Returns
        -------
        (m,) C(s) [V/rad].
        """
        kp, kd, ki = self.torque_gains(gain)
        return kp + kd * s + ki / s


@dataclass(frozen=True, kw_only=True)
class Controller(_Law):
    """A controller with real zeros, by its times.

    Attributes
    ----------
    lead_time : tau_d [s], >= 0.
    integral_time : tau_i [s], > 0.

    Examples
    --------
    >>> from casahunt import Controller, Servo
    >>> Servo(controller=Controller(lead_time=0.2, integral_time=0.5)).controller.reset_time
    0.7
    """

    lead_time: float = _TABLE_1_TIME
    integral_time: float = _TABLE_1_TIME

    def __post_init__(self) -> None:
        sensible("controller.lead_time", self.lead_time, zero=True)
        sensible("controller.integral_time", self.integral_time)
        floated(self)

    @property
    def reset_time(self) -> float:
        """kp/ki [s]."""
        return self.lead_time + self.integral_time

    @property
    def shape(self) -> tuple[float, float]:
        """(kp, kd) for K = 1."""
        return 1 + self.lead_time / self.integral_time, self.lead_time

    @property
    def corners(self) -> tuple[float, ...]:
        """Times 1/|zero| of C(s) [s], the derivative's first; 0 for one that is not there."""
        return self.lead_time, self.integral_time

    def pid(self) -> Pid:
        """The same controller by its gains."""
        kp, kd = self.shape
        return Pid(kp=kp, ki=1 / self.integral_time, kd=kd)


@dataclass(frozen=True, kw_only=True)
class Pid(_Law):
    """Any PID controller, by its gains; K multiplies all three.

    Attributes
    ----------
    kp : of the error, > 0.
    ki : of its integral [1/s], > 0.
    kd : of its derivative [s], >= 0.

    Examples
    --------
    >>> from casahunt import Pid, Servo
    >>> controller = Servo(controller=Pid(kp=1.0, ki=4.0, kd=0.15)).controller
    >>> [round(time, 3) for time in controller.corners], controller.reset_time  # s
    ([0.194, 0.194], 0.25)
    """

    kp: float
    ki: float
    kd: float

    def __post_init__(self) -> None:
        sensible("controller.kp", self.kp)
        if number("controller.ki", self.ki) == 0:
            raise InputError("controller.ki = 0: must be greater than 0 (it is the integral action that makes it hunt)")
        sensible("controller.ki", self.ki)
        sensible("controller.kd", self.kd, zero=True)
        if not SMALLEST <= self.reset_time <= LARGEST:
            raise InputError(
                f"controller.kp = {shown(self.kp)}, controller.ki = {shown(self.ki)}: kp/ki must be between "
                f"{SMALLEST:g} and {LARGEST:g} s"
            )
        floated(self)

    @property
    def reset_time(self) -> float:
        """kp/ki [s]."""
        return self.kp / self.ki

    @property
    def shape(self) -> tuple[float, float]:
        """(kp, kd) for K = 1."""
        return self.kp, self.kd

    @property
    def corners(self) -> tuple[float, ...]:
        """Times 1/|zero| of C(s) [s], the derivative's first; 0 for one that is not there.

        Without cancellation: the larger root of r^2 - (kp/ki) r + kd/ki is kp/ki at kd = 0, the smaller one kd/ki over
        it; complex ones have the size sqrt(kd/ki).
        """
        half = self.reset_time / 2
        square = half**2 - self.kd / self.ki
        long = half + float(np.sqrt(square)) if square > 0 else float(np.sqrt(self.kd / self.ki))
        return self.kd / self.ki / long, long

    def pid(self) -> Pid:
        """Itself."""
        return self


BY_TIMES, BY_GAINS = ("lead_time", "integral_time"), ("kp", "ki", "kd")
"""The numbers of the two forms."""


def controller_of(values: dict[str, float]) -> Controller | Pid:
    """The controller with these numbers.

    values: by name: all of kp, ki, kd, or times; those left out are the ones of Table 1. Returns controller, or Pid.
    Raises InputError: numbers of both forms, gains that are not all there, or a value out of range.
    """
    gains = [name for name in BY_GAINS if name in values]
    times = [name for name in BY_TIMES if name in values]
    if gains and times:
        raise InputError(
            f"controller.{gains[0]}, controller.{times[0]}: must not be given both; a controller is given by kp, ki "
            "and kd, or by lead_time and integral_time"
        )
    for name in BY_GAINS if gains else ():
        if name not in values:
            raise InputError(f"controller.{name}: must be given too: kp, ki and kd go together")
    return Pid(**values) if gains else Controller(**values)
