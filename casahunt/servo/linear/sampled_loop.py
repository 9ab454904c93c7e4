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

To first order in all its lags it is the loop of another servo (`as_continuous`), dry friction and all.  The controller
sees position, velocity and sum late by

    d   = D + h + Te
    d_v = d + h + Tf        of a difference of two readings
    d_w = d, or d - h       by trapezoids; by rectangles, which count the present reading in full

and x1(t - d) = x1 - d x2 + O(d2), x2(t - d_v) = x2 - d_v x2' + O(d2), x3(t - d_w) = x3 - d_w x1 + O(d2) make its torque
-kp x1(t - d) - kd x2(t - d_v) - ki x3(t - d_w) that of a continuous loop with J - kd d_v, kd - kp d, kp - ki d_w.  Of
Table 1 and seven other servos amplitude and period of the cycle are off by 0.3 to 0.85 (omega d_v)^2, omega^2 = kp/J,
with delays or filters from 0.05 to 0.2/omega.
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
from ..servo import Servo


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


def lags_of(drive: Drive, servo: Servo) -> tuple[float, float, float]:
    """How late the controller of a drive sees position, velocity and sum, d, d_v, d_w [s]."""
    h = drive.sample_time / 2
    d = drive.delay + h + drive.error_filter_time
    return d, d + h + drive.filter_of(servo.controller), d if drive.integration == "trapezoid" else d - h


def as_continuous(servo: Servo, gain: float, drive: Drive) -> Servo:
    """The servo whose continuous loop moves as that of a drive does, to first order.  Raises InputError: none does."""
    (d, d_v, d_w), pid = lags_of(drive, servo), servo.controller.pid()
    inertia = servo.inertia - gain * servo.motor_gain * pid.kd * d_v
    kp, kd = pid.kp - pid.ki * d_w, pid.kd - pid.kp * d
    if min(inertia, kp) <= 0 or kd < 0:
        raise InputError(
            f"drive: its lag of {d_v:.3g} s is no small one in this loop, which moves as no continuous one does: it "
            "needs a shorter sample time, delay or filter, or a lower gain"
        )
    return dataclasses.replace(servo, inertia=inertia, controller=Pid(kp=kp, ki=pid.ki, kd=kd))
