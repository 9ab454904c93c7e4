"""The linear loop as built: its exact frequency response, and continuous loops that have nearly the same.

Dry friction, counts, dead bands, resets and feedforward left out, the loop of controller.py, remedied.py and loop.py of
sampled/ is linear.  At z = exp(i omega T), with D = delay = l T + p, 0 <= p < T, and r = sigma2/J,

    L(z) = C(z) P(z)
    C(z) = f z/(z - 1 + f) (kp + ki W + kd s (z - 1)/(T (z - 1 + s)))
    W    = T z/(z - 1 + leak T), or T (z + 1)/2/(z - 1 + leak T)             rectangle, trapezoid
    f, s = T/(T + Te), T/(T + Tf)                                            1 without a filter
    P(z) = z^-l ((z - a) x(z) + E(T) v(z))/(J (z - 1) (z - a)),   a = exp(-r T)

x(z) and v(z) are what position and velocity have gained at the next sample, times J, by the torque that is held for
h = T - p, and by the one before it, 1/z, for p and then no longer:

    E(h) = (1 - exp(-r h))/r,   F(h) = (h - E(h))/r          velocity and position times J
    v(z) = E(h) + exp(-r h) E(p)/z
    x(z) = F(h) + (F(p) + E(h) E(p))/z

From here on h = T/2.  The loop is a continuous one at the frequency v = tan(omega h)/h, with other gains, which loses
more phase (`Lag`).  With s = i v the parts are

    difference quotient     s/(1 + s h)
    sum                     1/s + h by rectangles, 1/s by trapezoids
    plant behind its hold   (1 - s h) (1 + beta s)/(s (J' s + sigma2)),   J' = J x/tanh x, beta = (J' - J)/sigma2

with x = sigma2 h/J.  The lag 1 + s h goes into the gains as the filter of a derivative does, kp + ki/s + kd s/(1 + s h)
= (kp + ki h + ki/s + (kd + kp h) s)/(1 + s h), and what is left beside them has the size 1:

    L(i omega) = (kp' + ki/s + kd' s)/(s (J' s + sigma2)) (1 + beta s) (1 - s h)/(1 + s h) exp(-i omega D)

That is exact but for |1 + beta s|, of the second order in x, a delay that is no whole number of samples, filters and a
leak.  h = 0 is the loop that is not sampled.

To first order in all its lags it is the loop of another servo (`as_continuous`), dry friction and all.  The controller
sees position, velocity and sum late by

    d   = D + h + Te
    d_v = d + h + Tf        of a difference of two readings
    d_w = d, or d - h       by trapezoids; by rectangles, which count the present reading in full

and x1(t - d) = x1 - d x2 + O(d2), x2(t - d_v) = x2 - d_v x2' + O(d2), x3(t - d_w) = x3 - d_w x1 + O(d2) make its torque
-kp x1(t - d) - kd x2(t - d_v) - ki x3(t - d_w) that of a continuous loop with J - kd d_v, kd - kp d, kp - ki d_w.  Of
Table 1 and seven other servos amplitude and period of the cycle are off by 0.3 to 0.85 (omega d_v)^2, omega^2 = kp/J,
with delays or filters from 0.05 to 0.2/omega.

Source: P(z), the pulse transfer function of a plant behind a hold with a delay, is derived here.
"""

from __future__ import annotations

import dataclasses
import math
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ...errors import InputError
from ..controller import Pid
from ..drive import Drive
from ..servo import Servo

Array = np.ndarray

SERIES_BELOW, TERMS = 0.1, 10
"""Below this r h rounding would take digits of F(h), and so many terms of its series leave none out."""


def sampled_response(servo: Servo, gain: float, drive: Drive, omega: Array) -> Array:
    """(m,) L at frequencies [rad/s] up to pi/T."""
    T, J, r = drive.sample_time, servo.inertia, servo.friction.viscous / servo.inertia
    half = omega * T / 2
    z = np.exp(2j * half)
    above = 2j * np.sin(half) * np.exp(1j * half)  # z - 1, to rounding
    kp, kd, ki = servo.torque_gains(gain)
    f, s = T / (T + drive.error_filter_time), T / (T + drive.filter_of(servo.controller))
    mean = (z + 1) / 2 if drive.integration == "trapezoid" else z
    C = kp + ki * T * mean / (above + drive.leak * T) + kd * s * above / (T * (above + s))
    late, p = divmod(drive.delay, T)
    h = T - p
    v = _velocity(r, h) + math.exp(-r * h) * _velocity(r, p) / z
    x = _position(r, h) + (_position(r, p) + _velocity(r, h) * _velocity(r, p)) / z
    behind = above - math.expm1(-r * T)  # z - a
    P = np.exp(-2j * half * late) * (behind * x + _velocity(r, T) * v) / (J * above * behind)
    return np.asarray(f * z / (above + f) * C * P)


def _velocity(r: float, h: float) -> float:
    """E(h)."""
    return -math.expm1(-r * h) / r if r else h


def _position(r: float, h: float) -> float:
    """F(h)."""
    x = r * h
    if x < SERIES_BELOW:
        return h * h * sum((-x) ** k / math.factorial(k + 2) for k in range(TERMS))
    return (h - _velocity(r, h)) / r


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
