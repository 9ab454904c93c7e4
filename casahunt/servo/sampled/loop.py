"""The loop as built: a sampled controller, and between its torques the exact motion of the servo.

At t_k = k T a controller reads theta and forms a torque u_k (controller.py, with remedies remedied.py), and

    m = u_k for t_k + delay <= t < t_{k+1} + delay, and 0 before the first of them

Under a constant m the Switch servo slips (slip.py) or is stuck; it breaks away only where m changes to |m| > Fs, and
the only event between two changes is a stop.  The LuGre servo (bristle.py) is never stuck and never proven to rest: it
is followed sample by sample.

While the servo is stuck its reading does not change, and all samples up to the breakaway are one array.  It rests for
ever, and that is a proof, where it is stuck and the torques on their way and all that the controller can still ask for
are within Fs.

Symbols: T sample time [s], w the controller's sum [rad s], d its derivative [rad/s], u, m torques [N m].
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ... import effort
from ..drive import Drive
from ..servo import Servo
from .bristle import Bristles
from .controller import Controller
from .remedied import Remedied
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
        friction = servo.friction
        kind = Remedied if drive.remedied else Controller
        self.controller = kind(servo, gain, drive, set_point, start[0], start[2])
        self.sticks = bristle is None
        self.slips: Slips | Bristles = Slips(servo.inertia, friction)
        if bristle is not None:
            self.slips = Bristles(servo.inertia, friction, bristle)
        T = self.T = drive.sample_time
        late, self.part = divmod(drive.delay, T)
        self.waiting = [0.0] * (int(late) + 1)
        """Torques on their way, the one that acts at the sample first."""
        self.x, self.v = start[:2]

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
        self.states[:, k] = self.x, self.v, self.controller.w
        return Sampled(self.states[:, : k + 1], self.torque[:k], np.array(stops), rests_from)

    def _sample(self, k: int, stops: list[float]) -> None:
        """One sample, whatever it does."""
        self.states[:, k] = self.x, self.v, self.controller.w
        u = self.controller.sample(self.x)
        self.torque[k] = u
        self.waiting.append(u)
        now = k * self.T
        before = self.waiting.pop(0)
        for m, at, lasts in ((before, now, self.part), (self.waiting[0], now + self.part, self.T - self.part)):
            self.x, self.v, found = self.slips(self.x, self.v, m, lasts)
            stops += [at + t for t in found]

    def rests(self) -> bool:
        """Whether a servo that is stuck rests for ever."""
        return max(map(abs, self.waiting)) <= self.slips.static and self.controller.stays_within(
            self.x, self.slips.static
        )

    def _stuck(self, k: int, samples: int) -> int:
        """Go on to the sample in which it breaks away, from which the controller is steady, or the last one; returns
        which."""
        count, steady = FEWEST_AHEAD, self.controller.steady(self.x)
        while k < samples:
            w, d, u = self.controller.ahead(self.x, min(count, samples - k))
            # torques[j] acts up to the part of sample k + j, torques[j + 1] behind it
            torques = np.concatenate([self.waiting, u])
            beyond = np.flatnonzero(np.abs(torques) > self.slips.static)
            n = min(max(int(beyond[0]) - 1, 0), u.size) if beyond.size else u.size
            self._sit_through(k, n, w, d, u)
            k += n
            if n < u.size or not steady and self.controller.steady(self.x):
                return k
            count = min(2 * count, MOST_AHEAD)
            effort.pieces(1)
        return k

    def _sit_through(self, k: int, n: int, w: Array, d: Array, u: Array) -> None:
        """Take over the first n samples of what is ahead."""
        if n == 0:
            return
        self.states[0, k : k + n], self.states[1, k : k + n] = self.x, 0.0
        self.states[2, k], self.states[2, k + 1 : k + n] = self.controller.w, w[: n - 1]
        self.torque[k : k + n] = u[:n]
        self.waiting = [*self.waiting, *u[:n].tolist()][-len(self.waiting) :]
        self.controller.go_on(self.x, n, float(w[n - 1]), float(d[n - 1]))

    def _sit(self, k: int, n: int) -> None:
        """Rest to the end."""
        while n:
            taken = min(n, MOST_AHEAD)
            self._sit_through(k, taken, *self.controller.ahead(self.x, taken))
            k, n = k + taken, n - taken
