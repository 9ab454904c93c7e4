"""The sampled controller: its difference equations, and whole sticks of them at once.

At t_k = k T it reads theta in counts of q = 2 pi/encoder and forms, theta_d being the set point,

    a_k = q floor(theta/q + 1/2) - theta_d         (without an encoder theta - theta_d)
    e_k = a_k                                      what remedied.py makes of it
    z_k = e_k where |e_k| > dead_band, else 0
    w_k = (1 - leak T) w_{k-1} + T z_k             rectangle
    w_k = (1 - leak T) w_{k-1} + T (z_{k-1} + z_k)/2     trapezoid
    r_k = (e_k - e_{k-1})/T
    d_k = r_k                                      difference
    d_k = d_{k-1} + T/(T + Tf) (r_k - d_{k-1})     filtered, Tf d' + d = r by the backward rule
    u_k = -(kp e_k + ki w_k + kd d_k)              to the nearest multiple of quantise_torque

with e_{-1} = e_0, z_{-1} = z_0, d_{-1} = 0.

While the servo is stuck a_k does not change: w_k and d_k are sums and powers, and all samples up to a breakaway are one
array.  The torque stays within limits for ever where d_k -> 0 and w_k (to z/leak, or with z = 0 constant) go to their
limits, each in one direction, and the torques of the four corners of their ranges are within them.

Symbols: T sample time, q count, Tf filter time [s]; a, e, z, w, d, u as above; kp, ki, kd the torque gains.
"""

from __future__ import annotations

import math

import numpy as np

from ..drive import Drive
from ..servo import Servo

Array = np.ndarray


class Controller:
    """A controller and its memory; x: theta - theta_d [rad] at the sample.

    servo, gain, drive: its numbers; set_point: theta_d [rad]; x, w: at the start.
    """

    def __init__(self, servo: Servo, gain: float, drive: Drive, set_point: float, x: float, w: float) -> None:
        self.kp, self.kd, self.ki = servo.torque_gains(gain)
        T = self.T = drive.sample_time
        self.share = T / (T + drive.filter_of(servo.controller))
        self.half, self.kept, self.leak = drive.integration == "trapezoid", 1 - drive.leak * T, drive.leak
        self.q, self.theta_d, self.band, self.step = drive.count, set_point, drive.dead_band, drive.quantise_torque
        self.w, self.d = w, 0.0
        self.begin(x)

    def begin(self, x: float) -> None:
        """What is remembered at the start besides w and d."""
        self.e, self.z = self.seen(x)

    def reading(self, x: float) -> float:
        """a."""
        return self.q * math.floor((self.theta_d + x) / self.q + 0.5) - self.theta_d if self.q else x

    def seen(self, x: float) -> tuple[float, float]:
        """(e, z) of a sample, where `steady`."""
        e = self.reading(x)
        return e, e if abs(e) > self.band else 0.0

    def sample(self, x: float) -> float:
        """u of a sample."""
        return self.torque(*self.seen(x))

    def torque(self, e: float, z: float, more: float = 0.0) -> float:
        """u of a sample; more: torque that is added."""
        self.w = self.kept * self.w + (self.T * (z + self.z) / 2 if self.half else self.T * z)
        self.d += self.share * ((e - self.e) / self.T - self.d)
        self.e, self.z = e, z
        u = more - (self.kp * e + self.ki * self.w + self.kd * self.d)
        return self._to_step(u) if self.step else u

    def steady(self, x: float) -> bool:
        """Whether from the next sample on e and z stay what `seen` says, as long as the servo does not move."""
        return True

    def stays_within(self, x: float, limit: float) -> bool:
        """Whether |u| <= limit for ever if the servo does not move."""
        if not self.steady(x):
            return False
        e, z, w, d = self._next(x)
        if z != 0 and not self.leak:
            return False
        last = z / self.leak if self.leak else w
        corners = [-(self.kp * e + self.ki * a + self.kd * b) for a in (w, last) for b in (d, 0.0)]
        return max(map(abs, map(self._to_step, corners) if self.step else corners)) <= limit

    def ahead(self, x: float, count: int) -> tuple[Array, Array, Array]:
        """(w, d, u) of the next samples if the servo does not move, (count,) each; where `steady`."""
        e, z, first, rate = self._next(x)
        n = np.arange(count)
        if self.leak:
            w = z / self.leak + (first - z / self.leak) * self.kept**n
        else:
            w = np.cumsum(np.concatenate([[first], np.full(count - 1, self.T * z)]))
        d = rate * (1 - self.share) ** n  # 0^0 is 1
        u = -(self.kp * e + self.ki * w + self.kd * d)
        return w, d, self.step * np.floor(u / self.step + 0.5) if self.step else u

    def go_on(self, x: float, n: int, w: float, d: float) -> None:
        """Be behind n samples of `ahead`, the last of them with w and d."""
        self.e, self.z = self.seen(x)
        self.w, self.d = w, d

    def _next(self, x: float) -> tuple[float, float, float, float]:
        """(e, z, w, d) of the next sample, where `steady`."""
        e, z = self.seen(x)
        w = self.kept * self.w + (self.T * (z + self.z) / 2 if self.half else self.T * z)
        return e, z, w, self.d + self.share * ((e - self.e) / self.T - self.d)

    def _to_step(self, u: float) -> float:
        return self.step * math.floor(u / self.step + 0.5)
