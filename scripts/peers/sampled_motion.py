"""Motions of a servo under a sampled controller, by scipy: the same difference equations, other integrator and events.

At t_k = k T the drive reads e_k = q floor(theta/q + 1/2) - theta_d (without an encoder x1), and forms

    w_k = (1 - leak T) w_{k-1} + T z_k  or  T (z_k + z_{k-1})/2,    z_k = e_k where |e_k| > dead band, else 0
    d_k = (e_k - e_{k-1})/T    or    d_k = d_{k-1} + (T/(T + Tf)) ((e_k - e_{k-1})/T - d_{k-1})
    u_k = -(kp e_k + ki w_k + kd d_k), to the nearest step of the torque,    m = u_k from t_k + delay on, before that 0

Remedies change what is above:

    e_k     from a_k, the reading: F_k = F_{k-1} + T/(T + Te) (a_k - F_{k-1}), F_{-1} = a_0, in its place; then of that
            only the part r within delta, and beyond it less by (1 - r) delta
    z_k     less by a shift delta beyond it, else 0; or 0 below the inner edge of hysteresis and until the outer one is
            passed, at first too; 0 where the last so many readings were the same as this one, `dwell` long
    w_{k-1} times a factor where e_k has the other sign than the last e that was not 0; where a_k = a_{k-1} != a_{k-2}
    u_k     more by a torque with the sign of a_k - a_{k-1}, before it is rounded

and a cascade P-PI, Kv = kd, Kp + 1/Tn = kp/kd, Kp/Tn = ki/kd, sums the velocity that it sees:

    w_k     more by T d_k/Kp,    u_k = -(kd Kp e_k + ki w_k + kd d_k)

with a_{-1} = a_{-2} = a_0.  Between changes of m the servo slips, J v' = m - sgn(v) g(v) - b v, by DOP853 with its
event v = 0, or is stuck.
Sample by sample, stuck or not: nothing is carried ahead.
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

Array = np.ndarray

TIGHT = {"method": "DOP853", "rtol": 3e-14, "atol": 1e-16}
"""scipy's own limit of the relative tolerance is 2.2e-14."""

NARROW = 0.5
"""Of the Stribeck velocity, by which v changes in a step at most."""


@dataclass
class SampledServo:
    """J, Fs, Fc, vs, b of the plant; kp, ki, kd in torque; T and the rest of the drive; 0: there is none of it."""

    J: float
    Fs: float
    Fc: float
    vs: float
    b: float
    kp: float
    ki: float
    kd: float
    T: float
    delay: float = 0.0
    encoder: float = 0.0
    torque_step: float = 0.0
    filter_time: float = 0.0
    trapezoid: bool = False
    dead_band: float = 0.0
    set_point: float = 0.0
    leak: float = 0.0
    shift: float = 0.0
    edges: tuple[float, float] = (0.0, 0.0)
    """Of hysteresis: inner and outer."""
    dwell: float = 0.0
    at_sign: float = 1.0
    at_stop: float = 1.0
    error_band: tuple[float, float] = (0.0, 0.0)
    """delta, r."""
    error_filter: float = 0.0
    friction: float = 0.0
    """Torque of the feedforward."""
    proportional: float = 0.0
    """Kp of a cascade P-PI [1/s]; 0: a PID."""

    def motion(self, x: float, v: float, w: float, samples: int) -> tuple[Array, Array]:
        """(states (3, samples + 1) x1, x2, w at the samples, times of stops inside them [s])."""
        q = 2 * math.pi / self.encoder if self.encoder else 0.0
        late, part = divmod(self.delay, self.T)
        torques = deque([0.0] * (int(late) + 2), maxlen=int(late) + 2)
        states, stops = np.empty((3, samples + 1)), []
        e_before = z_before = filtered = None
        d = sign = 0.0
        integrates, readings, same = False, deque(maxlen=3), 0
        for k in range(samples):
            states[:, k] = x, v, w
            a = q * math.floor((self.set_point + x) / q + 0.5) - self.set_point if q else x
            while len(readings) < 3:
                readings.append(a)  # before the first sample, too
            readings.append(a)
            same = same + 1 if a == readings[1] else 0
            e = a
            if self.error_filter:
                filtered = a if filtered is None else filtered
                e = filtered = filtered + self.T / (self.T + self.error_filter) * (a - filtered)
            delta, r = self.error_band
            if delta:
                e = r * e if -delta <= e <= delta else e - (1 - r) * (delta if e > 0 else -delta)
            if e * sign < 0:
                w *= self.at_sign
            sign = math.copysign(1.0, e) if e else sign
            if a == readings[1] != readings[0]:
                w *= self.at_stop
            inner, outer = self.edges
            if outer:
                integrates = (abs(e) >= inner) if integrates else (abs(e) > outer)
            z = e if abs(e) > self.dead_band and (integrates or not outer) else 0.0
            if self.shift:
                z = e - self.shift if e > self.shift else e + self.shift if e < -self.shift else 0.0
            if self.dwell and same * self.T >= self.dwell:
                z = 0.0
            rate = 0.0 if e_before is None else (e - e_before) / self.T
            w -= self.leak * self.T * w
            w += self.T * (z + (z if z_before is None else z_before)) / 2 if self.trapezoid else self.T * z
            d += self.T / (self.T + self.filter_time) * (rate - d)
            w += self.T * d / self.proportional if self.proportional else 0.0
            e_before, z_before = e, z
            kp = self.kd * self.proportional or self.kp
            u = -(kp * e + self.ki * w + self.kd * d) + self.friction * float(np.sign(a - readings[1]))
            if self.torque_step:
                u = self.torque_step * math.floor(u / self.torque_step + 0.5)
            torques.append(u)
            for m, lasts, at in ((torques[0], part, 0.0), (torques[1], self.T - part, part)):
                x, v, found = self.piece(x, v, m, lasts)
                stops += [k * self.T + at + t for t in found]
        states[:, samples] = x, v, w
        return states, np.array(stops)

    bristle: tuple[float, float] = (0.0, 0.0)
    """Of LuGre friction: sigma0, sigma1; 0: Switch."""
    z: float = 0.0

    def piece(self, x: float, v: float, m: float, lasts: float) -> tuple[float, float, list[float]]:
        """(x, v) after a time of constant torque, and the times of the stops in it."""
        if self.bristle[0]:
            return self.slide(x, v, m, lasts)
        now, stops = 0.0, []
        while lasts - now > 0:
            if v == 0 and abs(m) <= self.Fs:
                return x, 0.0, stops
            s = math.copysign(1.0, v if v != 0 else m)

            def field(t: float, y: Array, s: float = s) -> list[float]:
                drop = (self.Fs - self.Fc) * math.expm1(-((y[1] / self.vs) ** 2))  # g - Fs: nothing cancels at rest
                return [y[1], (m - s * self.Fs - s * drop - self.b * y[1]) / self.J]

            def stop(t: float, y: Array, s: float = s, begins: float = now if v == 0 else -1.0) -> float:
                return s * y[1] if t > begins else 1.0

            stop.terminal, stop.direction = True, -1  # type: ignore[attr-defined]
            hastens = (abs(m) + self.Fs + self.b * abs(v)) / self.J
            longest = NARROW * self.vs / hastens  # or a step would pass over the drop of the friction, unseen
            found: Any = solve_ivp(field, (now, lasts), [x, v], events=stop, max_step=longest, **TIGHT)
            now, (x, v) = float(found.t[-1]), found.y[:, -1]
            if found.status == 1:
                v = 0.0
                stops.append(now)
        return float(x), float(v), stops

    def slide(self, x: float, v: float, m: float, lasts: float) -> tuple[float, float, list[float]]:
        """As `piece`, of LuGre friction: from one change of sign of v to the next."""
        sigma0, sigma1 = self.bristle
        now, stops = 0.0, []
        while lasts - now > 0:
            s = math.copysign(1.0, v if v != 0 else m - sigma0 * self.z)

            def field(t: float, y: Array, s: float = s) -> list[float]:
                g = self.Fc + (self.Fs - self.Fc) * math.exp(-((y[1] / self.vs) ** 2))
                rate = y[1] - sigma0 * s * y[1] * y[2] / g
                return [y[1], (m - sigma0 * y[2] - sigma1 * rate - self.b * y[1]) / self.J, rate]

            def turn(t: float, y: Array, s: float = s, begins: float = now if v == 0 else -1.0) -> float:
                return s * y[1] if t > begins else 1.0

            turn.terminal, turn.direction = True, -1  # type: ignore[attr-defined]
            hastens = (abs(m) + self.Fs + self.b * abs(v)) / self.J
            longest = NARROW * self.vs / hastens
            with np.errstate(all="ignore"):  # a first step of scipy's may be far too long
                found: Any = solve_ivp(field, (now, lasts), [x, v, self.z], events=turn, max_step=longest, **TIGHT)
            now, (x, v, self.z) = float(found.t[-1]), found.y[:, -1]
            if found.status == 1:
                v = 0.0
                stops.append(now)
        return float(x), float(v), stops
