"""Records of servos as drives make them: counts of the encoder at every so many samples, from a step on.

The difference equations are those of sampled_motion.py.  Between changes of the torque Runge-Kutta's formula of order 4
with steps by the bend of the friction, whose zero of v is found within a step;
LuGre friction as there.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .sampled_motion import SampledServo

Array = np.ndarray

FINE = 0.15
"""Longest step, in units of the time constants of the slip."""
HALVINGS = 60
"""Of a step in which the servo stops."""


@dataclass
class DriveServo(SampledServo):
    """A servo that is followed fast."""

    def record(self, start: float, samples: int, every: int, first: int = 0) -> tuple[Array, Array]:
        """(times [s], positions as read) of every so many samples, from a step of -start at rest, or later, on."""
        q = 2 * math.pi / self.encoder if self.encoder else 0.0
        states, _ = self.motion(-start, 0.0, 0.0, samples)
        at = np.arange(first, samples, every)
        x = states[0, at]
        return at * self.T, q * np.floor(x / q + 0.5) if q else x

    def piece(self, x: float, v: float, m: float, lasts: float) -> tuple[float, float, list[float]]:
        """(x, v) after a time of constant torque, and the times of the stops in it."""
        if self.bristle[0]:
            return self.slide(x, v, m, lasts)
        now, stops = 0.0, []
        Fs, J, b, drop, vs = self.Fs, self.J, self.b, self.Fs - self.Fc, self.vs
        rate = (drop / vs + b) / J
        while lasts > now:
            if v == 0 and abs(m) <= Fs:
                return x, 0.0, stops
            s = math.copysign(1.0, v if v != 0 else m)
            hastens = (abs(m) + Fs) / J
            left = lasts - now
            # far above the Stribeck velocity the friction hardly bends; near it a step changes v by a part of it
            fast = abs(v) - hastens * left > 6 * vs
            n = 1 if fast else max(1, math.ceil(left * max(rate, hastens / vs * FINE) / FINE))
            h = left / n
            for _ in range(n):
                x1, v1 = self.step(x, v, m, s, h)
                if s * v1 > 0 or (v == 0 and v1 == 0):
                    x, v, now = x1, v1, now + h
                    continue
                low, high = 0.0, h
                for _ in range(HALVINGS):
                    middle = (low + high) / 2
                    low, high = (middle, high) if s * self.step(x, v, m, s, middle)[1] > 0 else (low, middle)
                x, v, now = self.step(x, v, m, s, high)[0], 0.0, now + high
                stops.append(now)
                break
            else:
                return x, v, stops
        return x, v, stops

    def step(self, x: float, v: float, m: float, s: float, h: float) -> tuple[float, float]:
        """(x, v) a time h later, of a slip with the sign s."""
        J, b, Fc, drop, vs = self.J, self.b, self.Fc, self.Fs - self.Fc, self.vs
        exp = math.exp

        def a(v: float) -> float:
            r = v / vs
            return (m - s * (Fc + (drop * exp(-r * r) if r * r < 700 else 0.0)) - b * v) / J

        k1 = a(v)
        v2 = v + h / 2 * k1
        k2 = a(v2)
        v3 = v + h / 2 * k2
        k3 = a(v3)
        v4 = v + h * k3
        k4 = a(v4)
        return x + h * (v + 2 * v2 + 2 * v3 + v4) / 6, v + h * (k1 + 2 * k2 + 2 * k3 + k4) / 6
