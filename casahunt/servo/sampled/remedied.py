"""Remedies of the sampled controller: what it makes of the reading a_k, with its own memory and no other knowledge.

    f_k = a_k, or f_{k-1} + T/(T + Te) (a_k - f_{k-1})      error filter, Te = error_filter_time, f_{-1} = a_0
    e_k = f_k, or f_k - (1 - r) delta sgn f_k where |f_k| > delta, else r f_k
                                                        error dead band delta, r = remaining_gain
    z_k = e_k, or
          e_k where |e_k| > dead_band, else 0
          e_k - delta sgn e_k where |e_k| > delta, else 0   shifted dead band delta
          e_k while it integrates, else 0                   hysteresis: it begins where |e_k| > delta, and ends where
                                                        |e_k| < enter_ratio delta; before the first sample it does not
          0 where n_k T >= dwell                            freeze
    w_{k-1} -> reset w_{k-1}                            where sgn e_k is not what it was last; 0 has no sign: it counts
                                                        as the one before
    w_{k-1} -> reset_at_stop w_{k-1}                    where a_k = a_{k-1}, and a_{k-1} was not a_{k-2}
    u_k -> u_k + compensated Fc sgn(a_k - a_{k-1})      feedforward, 0 where a_k = a_{k-1}

n_k: samples since the reading changed, n_{-1} = 0 and a_{-1} = a_0.  A drive knows no other velocity: for it the servo
stands still where its reading stays.  All these come before the sum, the derivative and the torque of controller.py.

Where the servo is stuck, a_k has stayed for a sample, f_k has come to a_k to the last digit, and a freeze, if there is
one, has begun, everything but w and d is constant: the signs, whether hysteresis integrates, and so e and z.  Up to
there a stick is followed sample by sample, from there on as controller.py does, and with its proof of rest.
"""

from __future__ import annotations

import copy
import math

import numpy as np

from ..drive import Drive
from ..servo import Servo
from .controller import Array, Controller

SAMPLES_AT_ONCE = 64
"""Of a stick that is followed sample by sample."""


class Remedied(Controller):
    """A controller with remedies."""

    def __init__(self, servo: Servo, gain: float, drive: Drive, set_point: float, x: float, w: float) -> None:
        self.drive, T = drive, drive.sample_time
        self.filtered = T / (T + drive.error_filter_time)
        self.friction = drive.compensated * servo.friction.coulomb
        self.dwell = math.inf if drive.dwell is None else drive.dwell
        super().__init__(servo, gain, drive, set_point, x, w)

    def begin(self, x: float) -> None:
        """What is remembered at the start besides w and d."""
        self.a = self.f = self.reading(x)
        self.still, self.moved, self.integrates, self.side = 0, False, False, 0.0
        e = self._error(self.f)
        self.e, self.z = e, self._integrand(e, 1)

    def _error(self, f: float) -> float:
        """e."""
        delta, r = self.drive.error_dead_band, self.drive.remaining_gain
        if not delta:
            return f
        return f - math.copysign((1 - r) * delta, f) if abs(f) > delta else r * f

    def _integrand(self, e: float, still: int) -> float:
        """z; still: n."""
        shift, outer, size = self.drive.shifted_dead_band, self.drive.hysteresis, abs(e)
        if outer:
            self.integrates = size > outer or self.integrates and size >= self.drive.enter_ratio * outer
        if still * self.T >= self.dwell or outer and not self.integrates or size <= max(shift, self.band):
            return 0.0
        return e - math.copysign(shift, e) if shift else e

    def seen(self, x: float) -> tuple[float, float]:
        """(e, z), which stay, where `steady`."""
        return self.e, self.z

    def sample(self, x: float) -> float:
        """u of a sample."""
        drive, a = self.drive, self.reading(x)
        moved = a != self.a
        self.still = 0 if moved else self.still + 1
        self.f = self._filtered(a)
        e = self._error(self.f)
        side = math.copysign(1.0, e) if e else self.side
        if side * self.side < 0:
            self.w *= drive.reset
        if self.moved and not moved:
            self.w *= drive.reset_at_stop
        more = math.copysign(self.friction, a - self.a) if moved else 0.0
        self.a, self.moved, self.side = a, moved, side
        return self.torque(e, self._integrand(e, self.still), more)

    def _filtered(self, a: float) -> float:
        return self.f + self.filtered * (a - self.f) if self.drive.error_filter_time else a

    def steady(self, x: float) -> bool:
        """Whether the next sample finds what the last one did."""
        known = self.still > 0 and self.reading(x) == self.a and self._filtered(self.a) == self.f
        return known and (self.dwell == math.inf or self.still * self.T >= self.dwell)

    def ahead(self, x: float, count: int) -> tuple[Array, Array, Array]:
        """(w, d, u) of the next samples if the servo does not move: fewer than asked for, where it is not steady."""
        if self.steady(x):
            return super().ahead(x, count)
        after = copy.copy(self)
        found = []
        for _ in range(min(count, SAMPLES_AT_ONCE)):
            u = after.sample(x)
            found.append((after.w, after.d, u))
        w, d, u = np.array(found).T
        return w, d, u

    def go_on(self, x: float, n: int, w: float, d: float) -> None:
        """Be behind n samples of `ahead`."""
        if self.steady(x):
            self.still += n
            self.w, self.d = w, d
        else:
            for _ in range(n):
                self.sample(x)
