"""The event map of the Switch servo in extended precision (64-bit mantissa): Taylor series with events by heyoka.

The same map as switch_digits.py, a hundred times faster and with 18 digits in place of 34: for long sweeps, up to
multipliers of `STEEPEST`, and for searches on fine grids.  The derivative of the state by a is integrated beside it,

    J v' = m - s g(v) - s2 v,    J dv' = dm - (s g'(v) + s2) dv,    g'(v) = -2 v/vs^2 (Fs - Fc) exp(-(v/vs)^2),

and at a stop, v = 0, the duration yields by -dv/v'.  Far above vs the exponential has no visible Taylor coefficients:
steps are kept short enough for the speed not to fall into the drop unseen.

Needs heyoka (`pip install heyoka`), which is no dependency of the package.
"""

from __future__ import annotations

from decimal import Decimal
from functools import lru_cache
from typing import Any

import numpy as np

from casahunt import Servo

from .switch_digits import MOST_SLIPS, THROWN_OUT, Half, Lost, SwitchMap, Truth, shape

LONG = np.longdouble
DIGITS = 18
MOST_STEPS = 20000
FAR = 7.0
"""Speed in vs beyond which exp(-(v/vs)^2) is below the last digit."""
STEEPEST, CLOSE = 1e7, 17
"""Largest |P'| at which the period is known to 1e-9 and better in spite of rounding; digits of a fixed point."""
SHARE = 0.3
"""Part of the allowed change of the speed that a step may make by acceleration and by jerk."""


@lru_cache(maxsize=1)
def _integrators() -> tuple[Any, Any]:
    """(without, with an event at v = 0)."""
    import heyoka as hy

    x1, v, x3, d1, dv, d3 = hy.make_vars("x1", "v", "x3", "d1", "dv", "d3")
    J, kp, kd, ki, Fs, Fc, vs, s2, s = (hy.par[i] for i in range(9))
    e = (Fs - Fc) * hy.exp(-(v / vs) * (v / vs))
    m, dm = -(kp * x1 + kd * v + ki * x3), -(kp * d1 + kd * dv + ki * d3)
    system = [
        (x1, v), (v, (m - s * (Fc + e) - s2 * v) / J), (x3, x1),
        (d1, dv), (dv, (dm + (s * 2.0 * v / (vs * vs) * e - s2) * dv) / J), (d3, d1),
    ]  # fmt: skip
    made = []
    for events in ([], [hy.t_event(v, fp_type=LONG)]):
        start, pars = np.ones(6, dtype=LONG), np.ones(9, dtype=LONG)
        made.append(hy.taylor_adaptive(system, state=start, pars=pars, fp_type=LONG, t_events=events))
    return made[0], made[1]


class LongMap(SwitchMap):
    """P(a) of one servo at one gain to some 18 digits; what SwitchMap offers, by another integrator."""

    def __init__(self, servo: Servo, gain: float | Decimal, digits: int = DIGITS) -> None:
        super().__init__(servo, gain, DIGITS)
        f = servo.friction
        factor = LONG(str(Decimal(gain))) * LONG(servo.motor_gain)
        self.pars = np.array([
            servo.inertia, *(factor * k for k in shape(servo, LONG)), f.static, f.coulomb,
            f.stribeck_velocity, f.viscous, 1.0,
        ], dtype=LONG)  # fmt: skip

    def _newton(self, a: Decimal, low: Decimal, high: Decimal) -> Truth | None:
        """The fixed point between low and high by the sign of P - a alone, which rounding spoils least."""
        ends = [(x, self._half(x)) for x in (low, high)]
        (low, below), (high, above) = ends
        f_low, f_high = below.position - low, above.position - high
        for k in range(200):
            if high - low <= abs(high).scaleb(-CLOSE):
                break
            middle = low - f_low * (high - low) / (f_high - f_low)
            if k % 3 == 2 or not low < middle < high:
                middle = (low + high) / 2
            half = self._half(middle)
            f = half.position - middle
            if f == 0 or abs(f / (1 - half.slope)) <= abs(middle).scaleb(-CLOSE):
                low = high = middle
                break
            if (f > 0) == (f_low > 0):
                low, f_low = middle, f
            else:
                high, f_high = middle, f
        a = (low + high) / 2
        half = self._half(a)
        if abs(half.position / a - 1) > Decimal("1e-3"):
            return None  # a jump
        amplitude = half.largest if half.largest > max(a, half.position) else a
        # The stick lasts (m + Fs)/(ki x1), with a for x1: P(a) is known |P'| times worse than a.
        period = 2 * (self.slipping + (half.duration - self.slipping) * half.position / a)
        return Truth(self.gain, a, amplitude, period, half.slope)

    def _half(self, a: Decimal) -> Half:
        _, kp, kd, ki, Fs = self.pars[:5]
        start = LONG(str(a))
        x = np.array([-start, 0, (kp * start - Fs) / ki, -1, 0, kp / ki], dtype=LONG)
        sign, time, largest = LONG(1), LONG(0), start
        for slips in range(1, MOST_SLIPS + 1):
            x, duration = self._long_slip(x, sign)
            time, largest = time + duration, max(largest, abs(x[0]))
            m = -(kp * x[0] + ki * x[2])
            if abs(m) <= Fs:
                self.slipping = _decimal(time)
                stick = (m + np.copysign(Fs, x[0])) / (ki * x[0])
                return Half(_decimal(x[0]), _decimal(x[3]), _decimal(time + stick), _decimal(largest), slips)
            if largest > THROWN_OUT * start:
                raise Lost("the motion is thrown out")
            sign = np.sign(m)
        raise Lost(f"no stick after {MOST_SLIPS} slips")

    def _long_slip(self, x: Any, sign: Any) -> tuple[Any, Any]:
        """(state and derivative by a at the stop, duration)."""
        first, ta = _integrators()
        J, kp, kd, ki, Fs, Fc, vs, s2, _ = self.pars
        pars = self.pars.copy()
        pars[8] = sign
        first.time, first.state[:], first.pars[:] = LONG(0), x, pars
        first.step(LONG(1e-2) * min(np.sqrt(J / kp), J / (kd + s2 + ki / kp)))  # leaves v = 0 without an eye on it
        if sign * first.state[1] <= 0:
            raise Lost("the slip ends before it has begun")
        ta.reset_cooldowns()
        ta.time, ta.state[:], ta.pars[:] = first.time, first.state, pars
        for _ in range(MOST_STEPS):
            x1, v, x3 = ta.state[:3]
            force = -(kp * x1 + kd * v + ki * x3) - s2 * v - sign * Fc
            drop = (Fs - Fc) * np.exp(-((v / vs) ** 2))
            rate = (abs(force) + drop) / J
            jerk = (kp * abs(v) + (kd + s2 + 2 * drop / vs) * rate + ki * abs(x1)) / J
            allowed = LONG(SHARE) * max(vs, abs(v) - LONG(FAR) * vs)
            outcome = int(ta.step(min(allowed / rate, np.sqrt(allowed / jerk)))[0].value)
            if outcome == -1:
                break
        else:
            raise Lost("the slip does not end")
        end = ta.state.copy()
        end[1] = 0
        rate = (-(kp * end[0] + ki * end[2]) - sign * Fs) / J
        end[5] -= end[0] * end[4] / rate
        end[4] = 0
        return end, ta.time


def _decimal(x: Any) -> Decimal:
    return Decimal(np.format_float_scientific(x, unique=True))
