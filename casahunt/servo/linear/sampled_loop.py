"""The linear loop as built: its exact frequency response.

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

Source: P(z), the pulse transfer function of a plant behind a hold with a delay, is derived here.
"""

from __future__ import annotations

import math

import numpy as np

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
