"""The loop as built: a sampled controller, and between its torques the exact motion of the servo.

At t_k = k T the drive reads theta in counts of q = 2 pi/encoder and forms, theta_d being the set point,

    e_k = q floor(theta/q + 1/2) - theta_d         (without an encoder theta - theta_d)
    z_k = e_k where |e_k| > dead_band, else 0
    w_k = (1 - leak T) w_{k-1} + T z_k             rectangle
    w_k = (1 - leak T) w_{k-1} + T (z_{k-1} + z_k)/2     trapezoid
    r_k = (e_k - e_{k-1})/T
    d_k = r_k                                      difference
    d_k = d_{k-1} + T/(T + Tf) (r_k - d_{k-1})     filtered, Tf d' + d = r by the backward rule
    u_k = -(kp e_k + ki w_k + kd d_k)              to the nearest multiple of quantise_torque
    m   = u_k for t_k + delay <= t < t_{k+1} + delay, and 0 before the first of them

with e_{-1} = e_0, z_{-1} = z_0, d_{-1} = 0.  Under a constant m the Switch servo slips (slip.py) or is stuck; it breaks
away only where m changes to |m| > Fs, and the only event between two changes is a stop.  The LuGre servo (bristle.py)
is never stuck and never proven to rest: it is followed sample by sample.

While it is stuck e_k does not change: w_k and d_k are sums and powers, and all samples up to the breakaway are one
array.  It rests for ever, and that is a proof, where it is stuck, d_k -> 0 and w_k (to z/leak, or with z = 0 constant)
go to their limits, each in one direction, and the torques of the four corners of their ranges and those that are on
their way are all within Fs.

Symbols: T sample time, q count, Tf filter time [s]; e, z, w, d, u as above; kp, ki, kd the torque gains.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ... import effort
from ..drive import Drive
from ..servo import Servo
from .bristle import Bristles
from .slip import Slips

Array = np.ndarray

FEWEST_AHEAD, MOST_AHEAD = 64, 65536
"""Samples of a stick that are looked at at once: at first, and at most."""


@dataclass(frozen=True, eq=False)
class Sampled:
    """The states at the samples.

    Attributes
    ----------
    states : (3, n + 1) theta - theta_d [rad], theta' [rad/s], w [rad s]: its sum before the sample.
    torque : (n,) u [N m].
    stops : times of the stops [s].
    rests_from : sample from which it is known to rest for ever; -1 where it is not.
    """

    states: Array
    torque: Array
    stops: Array
    rests_from: int


class SampledLoop:
    """One servo with its drive, at one gain and set point.

    servo, gain, drive: the loop; set_point: theta_d [rad]; start: theta - theta_d, theta', w at the start; bristle: of
    LuGre friction at the start [rad]; None: Switch.
    """

    def __init__(
        self, servo: Servo, gain: float, drive: Drive, set_point: float, start: tuple[float, float, float],
        bristle: float | None = None,
    ) -> None:  # fmt: skip
        friction, self.drive = servo.friction, drive
        self.kp, self.kd, self.ki = servo.torque_gains(gain)
        self.sticks = bristle is None
        self.slips: Slips | Bristles = Slips(servo.inertia, friction)
        if bristle is not None:
            self.slips = Bristles(servo.inertia, friction, bristle)
        kp, kd = servo.controller.shape
        filter_time = drive.filter_time if drive.filter_time is not None else kd / kp / 10
        T = self.T = drive.sample_time
        self.share = T / (T + filter_time) if drive.derivative == "filtered" else 1.0
        self.half, self.kept, self.leak = drive.integration == "trapezoid", 1 - drive.leak * T, drive.leak
        self.q, self.theta_d, self.band, self.step = drive.count, set_point, drive.dead_band, drive.quantise_torque
        late, self.part = divmod(drive.delay, T)
        self.waiting = [0.0] * (int(late) + 1)
        """Torques on their way, the one that acts at the sample first."""
        self.x, self.v, self.w = start
        self.d = 0.0
        self.e = self.error(self.x)
        self.z = self.integrand(self.e)

    def error(self, x: float) -> float:
        """e as it is read."""
        return self.q * math.floor((self.theta_d + x) / self.q + 0.5) - self.theta_d if self.q else x

    def integrand(self, e: float) -> float:
        """z."""
        return e if abs(e) > self.band else 0.0

    def run(self, samples: int, farthest: float) -> Sampled:
        """The motion; it ends early where |theta - theta_d| exceeds `farthest` [rad]."""
        self.states, self.torque = np.empty((3, samples + 1)), np.empty(samples)
        stops: list[float] = []
        k, rests_from = 0, -1
        effort.motion_begins()
        effort.at(lambda: f"followed to sample {k} of {samples}")
        while k < samples and abs(self.x) <= farthest:
            if self.sticks and self.v == 0:
                if self.rests():
                    rests_from = k
                    self._sit(k, samples - k)
                    k = samples
                    break
                k = self._stuck(k, samples)
                if k == samples:
                    break
            self._sample(k, stops)
            k += 1
        self.states[:, k] = self.x, self.v, self.w
        return Sampled(self.states[:, : k + 1], self.torque[:k], np.array(stops), rests_from)

    def _sample(self, k: int, stops: list[float]) -> None:
        """One sample, whatever it does."""
        self.states[:, k] = self.x, self.v, self.w
        e = self.error(self.x)
        z = self.integrand(e)
        self.w = self.kept * self.w + (self.T * (z + self.z) / 2 if self.half else self.T * z)
        self.d += self.share * ((e - self.e) / self.T - self.d)
        self.e, self.z = e, z
        u = self._to_step(-(self.kp * e + self.ki * self.w + self.kd * self.d))
        self.torque[k] = u
        self.waiting.append(u)
        now = k * self.T
        before = self.waiting.pop(0)
        for m, at, lasts in ((before, now, self.part), (self.waiting[0], now + self.part, self.T - self.part)):
            self.x, self.v, found = self.slips(self.x, self.v, m, lasts)
            stops += [at + t for t in found]

    def _to_step(self, u: float) -> float:
        return self.step * math.floor(u / self.step + 0.5) if self.step else u

    def rests(self) -> bool:
        """Whether a servo that is stuck rests for ever."""
        e, z, w, d = self._next()
        if max(map(abs, self.waiting)) > self.slips.static or z != 0 and not self.leak:
            return False
        last = z / self.leak if self.leak else w
        torques = (self._to_step(-(self.kp * e + self.ki * a + self.kd * b)) for a in (w, last) for b in (d, 0.0))
        return max(map(abs, torques)) <= self.slips.static

    def _next(self) -> tuple[float, float, float, float]:
        """(e, z, w, d) of the next sample of a stick."""
        e = self.error(self.x)
        z = self.integrand(e)
        w = self.kept * self.w + (self.T * (z + self.z) / 2 if self.half else self.T * z)
        return e, z, w, self.d + self.share * ((e - self.e) / self.T - self.d)

    def _ahead(self, count: int) -> tuple[Array, Array, Array]:
        """(w, d, u) of the next samples of a stick, (count,) each."""
        e, z, first, rate = self._next()
        n = np.arange(count)
        if self.leak:
            w = z / self.leak + (first - z / self.leak) * self.kept**n
        else:
            w = np.cumsum(np.concatenate([[first], np.full(count - 1, self.T * z)]))
        d = rate * (1 - self.share) ** n  # 0^0 is 1
        u = -(self.kp * e + self.ki * w + self.kd * d)
        return w, d, self.step * np.floor(u / self.step + 0.5) if self.step else u

    def _stuck(self, k: int, samples: int) -> int:
        """Go on to the sample in which it breaks away, or the last one; returns which."""
        count = FEWEST_AHEAD
        while k < samples:
            w, d, u = self._ahead(min(count, samples - k))
            # torques[j] acts up to the part of sample k + j, torques[j + 1] behind it
            torques = np.concatenate([self.waiting, u])
            beyond = np.flatnonzero(np.abs(torques) > self.slips.static)
            n = min(max(int(beyond[0]) - 1, 0), u.size) if beyond.size else u.size
            self._sit_through(k, n, w, d, u)
            k += n
            if n < u.size:
                return k
            count = min(2 * count, MOST_AHEAD)
            effort.pieces(1)
        return k

    def _sit_through(self, k: int, n: int, w: Array, d: Array, u: Array) -> None:
        """Take over the first n samples of what is ahead."""
        if n == 0:
            return
        self.states[0, k : k + n], self.states[1, k : k + n] = self.x, 0.0
        self.states[2, k], self.states[2, k + 1 : k + n] = self.w, w[: n - 1]
        self.torque[k : k + n] = u[:n]
        self.waiting = [*self.waiting, *u[:n].tolist()][-len(self.waiting) :]
        self.w, self.d = float(w[n - 1]), float(d[n - 1])
        self.e = self.error(self.x)
        self.z = self.integrand(self.e)

    def _sit(self, k: int, n: int) -> None:
        """Rest to the end."""
        while n:
            taken = min(n, MOST_AHEAD)
            self._sit_through(k, taken, *self._ahead(taken))
            k, n = k + taken, n - taken
