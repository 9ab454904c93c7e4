"""Continuous loops that have nearly the response of the loop of one inertia as built (pulse_transfer.py).

Without filters and a leak, and with a delay D of whole samples, it is a continuous loop at the frequency v =
tan(omega h)/h, h = T/2, with other gains, which loses more phase (`Lag`).  With s = i v the parts are

    difference quotient     s/(1 + s h)
    sum                     1/s + h by rectangles, 1/s by trapezoids
    plant behind its hold   (1 - s h) (1 + beta s)/(s (J' s + sigma2)),   J' = J x/tanh x, beta = (J' - J)/sigma2

with x = sigma2 h/J.  The lag 1 + s h goes into the gains as the filter of a derivative does, kp + ki/s + kd s/(1 + s h)
= (kp + ki h + ki/s + (kd + kp h) s)/(1 + s h), and what is left beside them has the size 1:

    L(i omega) = (kp' + ki/s + kd' s)/(s (J' s + sigma2)) (1 + beta s) (1 - s h)/(1 + s h) exp(-i omega D)

That is exact but for |1 + beta s|, of the second order in x.  h = 0 is the loop that is not sampled.

With every lag it is at low frequencies the loop of another servo (`as_continuous`), dry friction and all, which acts
on the inertia at once: the torque is -(ki + kp' s + kd' s^2 + j s^3 + O(s^4)) x1/s, the coefficients from L(z), and
J' = J + j.  For Table 1 and drives with delays or filters of 0.07 to 0.2/omega, omega^2 = kp/J, amplitude and period of
the cycle are off by 0.3 to 0.5 (omega d)^2, d the delay of the velocity (`lag_of`).
"""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...errors import InputError
from ..controller import Pid
from ..drive import Drive
from ..parts.plain_loop import loop_asked
from ..servo import Servo
from .pulse_transfer import pulse_transfer

ON_THE_CIRCLE = 32
"""Points of a third of the radius within which L has a series at least: to rounding."""


def squared_size(loop: Any, omega: Any) -> Any:
    """|L|^2 of a continuous loop, J, sigma2, kp, kd, ki, at omega [rad/s]; numbers, arrays or expressions."""
    J, sigma2, kp, kd, ki = loop
    w = omega**2
    return (kp**2 * w + (kd * w - ki) ** 2) / (w**2 * (J**2 * w + sigma2**2))


@dataclass(frozen=True)
class Lag:
    """Sampling and delay.

    Attributes
    ----------
    delay : D [s].
    half : h [s], half a sample; 0: the loop is not sampled.
    rectangle : whether the sum is one of rectangles.
    """

    delay: float = 0.0
    half: float = 0.0
    rectangle: bool = True

    def seen(self, J: Any, sigma2: Any, kp: Any, kd: Any, ki: Any) -> tuple[Any, Any, Any, Any, Any]:
        """J', sigma2, kp', kd', ki of the loop at v; numbers, arrays or expressions; to the second order in x."""
        p = kp + ki * self.half if self.rectangle else kp
        return J * (1 + (sigma2 * self.half / J) ** 2 / 3), sigma2, p + ki * self.half, kd + p * self.half, ki

    def phase(self, loop: Any, v: Any) -> Any:
        """phi = arg L + pi [rad] at v [rad/s] of a loop as it is seen, J', sigma2, kp', kd', ki; not modulo a turn."""
        J, sigma2, kp, kd, ki = loop
        by = ca if isinstance(v, ca.MX) else np
        phi = by.arctan2(kp * v, ki - kd * v**2) - by.arctan2(J * v, sigma2)
        if not self.half:
            return phi - v * self.delay
        return phi - (2 + self.delay / self.half) * by.arctan(v * self.half) + by.arctan(
            v * sigma2 * self.half**2 / (3 * J)
        )


def lag_of(drive: Drive, servo: Servo) -> float:
    """How late the controller of a drive sees the velocity [s], of a difference of two readings."""
    return drive.delay + drive.sample_time + drive.error_filter_time + drive.filter_of(servo.controller)


def as_continuous(servo: Servo, gain: float, drive: Drive) -> Servo:
    """The servo whose continuous loop moves as that of a drive at low frequencies.  Raises InputError: none does."""
    lag, K = lag_of(drive, servo), gain * servo.motor_gain
    s = np.exp(2j * np.pi * (np.arange(ON_THE_CIRCLE) + 0.5) / ON_THE_CIRCLE) / (3 * lag)
    L = pulse_transfer(loop_asked(servo, None, gain, usual="switch"), drive).response(-1j * s)
    law = L * s**2 * (servo.inertia * s + servo.friction.viscous)
    ki, kp, kd, more = (float(np.mean(law / s**k).real) for k in range(4))
    if min(servo.inertia + more, kp) <= 0 or kd < 0:
        raise InputError(
            f"drive: its lag of {lag:.3g} s is no small one in this loop, which moves as no continuous one does: it "
            "needs a shorter sample time, delay or filter, or a lower gain"
        )
    return dataclasses.replace(servo, inertia=servo.inertia + more, controller=Pid(kp=kp / K, ki=ki / K, kd=kd / K))
