"""The event map of the Switch servo in decimal arithmetic: Taylor series with as many digits as asked for.

From breakaway at x1 = -a, x2 = 0, m = Fs, i.e. x3 = (kp a - Fs)/ki, the servo slips until x2 = 0; a stop with
|m| > Fs reverses at once, one with |m| <= Fs sticks.  Where it sticks first is P(a); |m| = Fs again after

    (m - s Fs)/(ki x1),   s = -sign(x1).

Symmetric cycles are the fixed points P(a) = a, mu = P'(a) their half multiplier, and at the fold P(a) = a, P'(a) = 1.
The slope comes from the variational equation dx' = (df/dx) dx, started with dx = (-1, 0, kp/ki).  At a stop it becomes
the derivative of the state at the stop, dx + x' dt with dt = -dx2/x2': (dx1, 0, dx3 - x1 dx2/x2'), as x1' = 0 there.

Per step the coefficients follow from (Griewank and Walther, Evaluating Derivatives, chapter 13)

    w = -(x2/vs)^2,   e = exp w:  k e_k = sum_j j w_j e_{k-j},   J x2' = m - s (Fc + (Fs - Fc) e) - sigma2 x2.

No CasADi, no collocation, floating point for the choice of steps only, and nothing but Python's `decimal`: 34 digits
cost about a tenth of a second a half cycle.  `cycle` and `fold` polish what a guess says to nearly all digits.
"""

from __future__ import annotations

import decimal
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from decimal import Decimal
from operator import mul
from typing import Any

import numpy as np

from casahunt import Servo
from casahunt.servo.controller import Controller

DIGITS = 34
FAR = 0.8
"""Velocities in units of vs sqrt(digits ln 10) at which exp(-(v/vs)^2) is zero to all digits are 1; a step from
farther out may not come closer than this and a bit, for the exponential has no visible coefficients there."""
MOST_STEPS, MOST_SLIPS = 1_500, 30
LOOKS = 16
"""Places in a step at which the sign of the velocity is looked at."""
FIRST_STEPS = 20
"""Newton steps from the guess: where P falls like an exponential each gains a factor e."""
FLAT = "1e-8"
"""|P' - P/a| that counts as zero at a peak of P(a)/a, whose height is known to the square of it or better."""
THROWN_OUT = 30
"""A motion whose turning points grow by more than this has no stick to come."""


class Lost(Exception):
    """The motion, or the iteration, does not get to an end; the message says which."""


@dataclass(frozen=True)
class Half:
    """From breakaway at x1 = -a to the next one.

    Attributes
    ----------
    position : where it sticks next, x1 [rad]; P(a) > 0 beyond the set point.
    slope : dP/da.
    duration : of slips and stick [s].
    largest : largest |x1| on the way [rad].
    slips : number of slips.
    """

    position: Decimal
    slope: Decimal
    duration: Decimal
    largest: Decimal
    slips: int


@dataclass(frozen=True)
class Truth:
    """A symmetric cycle to nearly all digits: gain, stick position a, amplitude, full period, half multiplier; relative
    error of amplitude and period where the engine's digits are too few, else 0."""

    gain: Decimal
    a: Decimal
    amplitude: Decimal
    period: Decimal
    mu: Decimal
    noise: float = 0.0


def shape(servo: Servo, real: Callable[[float], Any]) -> tuple[Any, Any, Any]:
    """(kp, kd, ki) at K cm = 1 in numbers of a kind, of a controller by times or by gains."""
    c = servo.controller
    if isinstance(c, Controller):
        lead, integral = real(c.lead_time), real(c.integral_time)
        return 1 + lead / integral, lead, 1 / integral
    return real(c.kp), real(c.kd), real(c.ki)


class SwitchMap:
    """P(a) of one servo at one gain, to `digits` digits."""

    def __init__(self, servo: Servo, gain: float | Decimal, digits: int = DIGITS) -> None:
        self.context = decimal.Context(prec=digits, Emin=-(10**6), Emax=10**6)
        self.digits, self.order = digits, math.ceil(1.6 * digits)
        f = servo.friction
        with decimal.localcontext(self.context):
            self.gain = Decimal(gain)
            factor = self.gain * Decimal(servo.motor_gain)
            self.kp, self.kd, self.ki = (factor * k for k in shape(servo, Decimal))
            self.J, self.Fs, self.Fc = Decimal(servo.inertia), Decimal(f.static), Decimal(f.coulomb)
            self.vs, self.viscous = Decimal(f.stribeck_velocity), Decimal(f.viscous)
            self.far = self.vs * Decimal(math.sqrt(digits * math.log(10)))

    def half(self, a: Decimal | float) -> Half:
        """The motion from breakaway at x1 = -a."""
        with decimal.localcontext(self.context):
            return self._half(Decimal(a))

    def _half(self, a: Decimal) -> Half:
        zero = Decimal(0)
        x, d = [-a, zero, (self.kp * a - self.Fs) / self.ki], [Decimal(-1), zero, self.kp / self.ki]
        sign, time, largest = 1, zero, a
        for slips in range(1, MOST_SLIPS + 1):
            x, d, duration = self._slip(x, d, sign, a, starts_at_rest=slips == 1)
            time += duration
            largest = max(largest, abs(x[0]))
            m = self._torque(x)
            if abs(m) <= self.Fs:
                stick = (m + self.Fs.copy_sign(x[0])) / (self.ki * x[0])
                return Half(x[0], d[0], time + stick, largest, slips)
            if largest > THROWN_OUT * a:
                raise Lost("the motion is thrown out")
            sign = 1 if m > 0 else -1
        raise Lost(f"no stick after {MOST_SLIPS} slips")

    def _torque(self, x: Sequence[Decimal]) -> Decimal:
        return -(self.kp * x[0] + self.kd * x[1] + self.ki * x[2])

    def _slip(
        self, x: list[Decimal], d: list[Decimal], sign: int, a: Decimal, *, starts_at_rest: bool
    ) -> tuple[list[Decimal], list[Decimal], Decimal]:
        """(state, its derivative by a, duration) at the end of a slip."""
        time, first = Decimal(0), True
        scale = (a, min(self.vs, a), abs(self.Fs / self.ki))
        for _ in range(MOST_STEPS):
            c, dc, e = self._series(x, d, sign)
            if first and starts_at_rest:
                c[1][1] = Decimal(0)  # net torque zero at breakaway, exactly
            h = self._step(c, dc, e, scale)
            stop = self._stop(c[1], sign, h, first)
            if stop is not None:
                h = stop
            x, d = [_value(row, h) for row in c], [_value(row, h) for row in dc]
            time += h
            if stop is not None:
                x[1] = Decimal(0)
                rate = (self._torque(x) - sign * self.Fs) / self.J
                d = [d[0], Decimal(0), d[2] - x[0] * d[1] / rate]
                return x, d, time
            first = False
        raise Lost("the slip does not end")

    def _series(
        self, x: Sequence[Decimal], d: Sequence[Decimal], sign: int
    ) -> tuple[list[list[Decimal]], list[list[Decimal]], list[Decimal]]:
        """Taylor coefficients of the state, of its derivative by a, and of (Fs - Fc) exp(-(x2/vs)^2)/Fs."""
        c, dc = [[q] for q in x], [[q] for q in d]
        (x1, v, x3), (d1, dv, d3) = c, dc
        jw: list[Decimal] = []  # j w_j from j = 1
        e: list[Decimal] = []
        p: list[Decimal] = []  # v e
        unit, drop = -1 / (self.vs * self.vs), self.Fs - self.Fc
        steep = 2 * sign * drop * unit
        for k in range(self.order):
            back = v[::-1]
            w = unit * sum(map(mul, v, back))
            if k:
                jw.append(k * w)
                e.append(sum(map(mul, jw, e[::-1])) / k)  # type: ignore[arg-type]
            else:
                e.append(w.exp())  # type: ignore[union-attr]
            p.append(sum(map(mul, e, back)))  # type: ignore[arg-type]
            friction = sign * (drop * e[k] + (self.Fc if k == 0 else 0)) + self.viscous * v[k]
            change = steep * sum(map(mul, p, dv[::-1])) + self.viscous * dv[k]
            n = k + 1
            v.append(-(self.kp * x1[k] + self.kd * v[k] + self.ki * x3[k] + friction) / (self.J * n))
            dv.append(-(self.kp * d1[k] + self.kd * dv[k] + self.ki * d3[k] + change) / (self.J * n))
            x1.append(v[k] / n)
            x3.append(x1[k] / n)
            d1.append(dv[k] / n)
            d3.append(d1[k] / n)
        return c, dc, [q * drop / self.Fs for q in e]

    def _step(
        self, c: list[list[Decimal]], dc: list[list[Decimal]], e: list[Decimal], scale: Sequence[Decimal]
    ) -> Decimal:
        lowest = math.inf
        sizes = [max(abs(row[0]), Decimal(1)) for row in dc]
        for rows, units in ((c, scale), (dc, sizes), ([e], (Decimal(1),))):
            for row, unit in zip(rows, units, strict=True):
                for k in (len(row) - 1, len(row) - 2, len(row) - 4):
                    if row[k]:
                        lowest = min(lowest, (unit.adjusted() - row[k].adjusted() - self.digits - 1) / k)
        h = Decimal(10.0**lowest) if lowest < 6 else Decimal(10**6)
        speed = abs(c[1][0])
        allowed = max(self.vs, speed - self.far * (1 + Decimal(FAR) / 10))
        while abs(_value(c[1], h) - c[1][0]) > allowed:
            h *= Decimal("0.7")
        return h

    def _stop(self, v: list[Decimal], sign: int, h: Decimal, first: bool) -> Decimal | None:
        """The first time in (0, h] at which the velocity changes sign, or None."""
        scaled, power = [], Decimal(1)
        for q in v:
            scaled.append(float(q * power))
            power *= h
        values = sign * np.polynomial.polynomial.polyval(np.arange(1, LOOKS + 1) / LOOKS, scaled)
        if (values > 0).all():
            return None
        i = int(np.argmax(values <= 0))
        looks = [h * k / LOOKS for k in range(1, LOOKS + 1)]
        if i == 0 and first:
            raise Lost("the slip ends before it has begun")
        low, high = (looks[i - 1] if i else Decimal(0)), looks[i]
        slope = [k * q for k, q in enumerate(v)][1:]
        t = (low + high) / 2
        for _ in range(200):
            value = _value(v, t)
            if sign * value > 0:
                low = t
            else:
                high = t
            rate = _value(slope, t)
            step = value / rate if rate else Decimal(0)
            fresh = t - step
            if not low <= fresh <= high:
                fresh = (low + high) / 2
            if abs(fresh - t) <= abs(fresh).scaleb(-self.digits + 2):
                return fresh
            t = fresh
        return t

    def cycle(self, guess: float | Decimal, *, error: float = 1e-9, within: float = 1e-2) -> Truth:
        """The symmetric cycle nearest to a stick position, at most `within` away (relative).

        Newton on P(a) = a in a bracket that grows around the guess from its presumed `error`: where mu is 1e8, Newton
        by itself jumps over the nearest fixed point to another one.  Before that, between the guess and a place twice
        as far as a Newton step: next to a sharp fold P = a at two places closer to each other than the error.
        """
        with decimal.localcontext(self.context):
            a, limit = Decimal(guess), Decimal(within)
            width, found = Decimal(3 * error), None
            for _ in range(FIRST_STEPS):
                half = self._half(a)
                step = (half.position - a) / (1 - half.slope)
                far = a + 2 * step
                if abs(far / Decimal(guess) - 1) > 2 * width:
                    break
                if (self._excess(far) > 0) != (half.position > a):
                    found = self._newton(a, min(a, far), max(a, far))
                    break
                a += step
            a = Decimal(guess)
            while found is None and width < 10 * limit:
                width = min(width, limit)
                low, high = a * (1 - width), a * (1 + width)
                try:
                    if (self._excess(low) > 0) != (self._excess(high) > 0):
                        found = self._newton(a, low, high)
                except (Lost, ArithmeticError):  # so far out motions may come to a stop in another way
                    break
                width *= 10
            found = found or self._beside_the_peak(a, Decimal(3 * error))
            if found is None:
                raise Lost(f"no fixed point of the map within {within:g} of {float(a):.6g}")
            return found

    def _beside_the_peak(self, a: Decimal, error: Decimal) -> Truth | None:
        """The fixed point within `error` of a, on the same side of a peak of P(a)/a that is narrower than the error."""
        place, top = _peak(self, a)
        side = 1 if self._half(a).slope < 1 else -1
        end = place * (1 + side * error)
        if top.position <= place or self._excess(end) > 0 or abs(place / a - 1) > error:
            return None
        return self._newton((place + end) / 2, min(place, end), max(place, end))

    def _excess(self, a: Decimal) -> Decimal:
        return self._half(a).position - a

    def _newton(self, a: Decimal, low: Decimal, high: Decimal) -> Truth | None:
        """The fixed point between low and high, where P - a changes sign."""
        rising = self._excess(high) > 0
        for _ in range(120):
            half = self._half(a)
            step = (half.position - a) / (1 - half.slope)
            if max(abs(step), abs(half.position - a)) <= abs(a).scaleb(-self.digits // 2):
                return Truth(self.gain, a, half.largest, 2 * half.duration, half.slope)
            low, high = (low, a) if (half.position > a) == rising else (a, high)
            a += step
            if not low < a < high:
                a = (low + high) / 2
        return None


def _value(c: Sequence[Decimal], h: Decimal) -> Decimal:
    out = c[-1]
    for q in reversed(c[:-1]):
        out = out * h + q
    return out


def fold(
    servo: Servo, gain: float, a: float, *, digits: int = DIGITS, within: float = 1e-3
) -> Truth:
    """The fold next to a guess: P(a) = a and P'(a) = 1, by Newton with differences; failing that, by its peaks."""
    try:
        return _fold_by_newton(servo, gain, a, digits, within)
    except (Lost, ArithmeticError):
        return _fold_by_peaks(servo, gain, a, 3 * digits // 2, within)


def _fold_by_newton(servo: Servo, gain: float, a: float, digits: int, within: float) -> Truth:
    with decimal.localcontext(decimal.Context(prec=digits, Emin=-(10**6), Emax=10**6)):
        K, a_, K0 = Decimal(gain), Decimal(a), Decimal(gain)
        delta = Decimal(10) ** (-digits // 3)
        small = Decimal(10) ** (-digits // 2)

        def conditions(K: Decimal, a: Decimal) -> tuple[Decimal, Decimal, Half]:
            half = SwitchMap(servo, K, digits).half(a)
            return half.position / a - 1, half.slope - 1, half

        slopes, last = None, Decimal(1)
        for _ in range(25):
            f, g, half = conditions(K, a_)
            if slopes is None:
                fa, ga, _ = conditions(K, a_ * (1 + delta))
                fk, gk, _ = conditions(K * (1 + delta), a_)
                slopes = [(q - r) / delta for q, r in ((fa, f), (ga, g), (fk, f), (gk, g))]
            fa, ga, fk, gk = slopes
            det = fa * gk - ga * fk
            da, dk = -(f * gk - g * fk) / det, -(fa * g - ga * f) / det
            if abs(K * (1 + dk) / K0 - 1) > Decimal(within):
                raise Lost(f"no fold within {within:g} of the gain {gain:.6g}")
            K, a_ = K * (1 + dk), a_ * (1 + da)
            moved = max(abs(da), abs(dk))
            if moved < small:
                if abs(half.slope - 1) > Decimal("1e-6"):
                    raise Lost(f"the fold is narrower than {digits} digits: P' = {float(half.slope):.6g} there")
                return Truth(K, a_, half.largest, 2 * half.duration, half.slope)
            if moved > last / 1000:
                slopes = None  # of a place too far away to be of use again
            last = moved
        raise Lost("Newton on the fold does not converge")


def _fold_by_peaks(servo: Servo, gain: float, a: float, digits: int, within: float) -> Truth:
    """The gain at which the largest P(a)/a next to a guess is 1, by secants, however narrow the peak is."""
    with decimal.localcontext(decimal.Context(prec=digits, Emin=-(10**6), Emax=10**6)):
        K, before = Decimal(gain), None
        small, place = Decimal(FLAT) ** 2, Decimal(a)
        for _ in range(16):
            place, top = _peak(SwitchMap(servo, K, digits), place)
            excess = top.position / place - 1
            if abs(excess) < small:
                return Truth(K, place, top.largest, 2 * top.duration, top.slope)
            slope = -1 / K if before is None else (excess - before[1]) / (K - before[0])
            before = (K, excess)
            K -= excess / slope
            if abs(K / Decimal(gain) - 1) > Decimal(within):
                raise Lost(f"no fold within {within:g} of the gain {gain:.6g}")
        raise Lost("the gains of the peaks do not converge")


def _peak(the_map: SwitchMap, a: Decimal) -> tuple[Decimal, Half]:
    """(place, motion) of the largest P(a)/a next to a, where a P' - P changes its sign."""

    def tilt(a: Decimal) -> tuple[Decimal, Half]:
        half = the_map.half(a)
        return a * half.slope - half.position, half

    first, half = tilt(a)
    way, step = (1 if first > 0 else -1), Decimal("1e-14")
    near, far = a, a
    while True:  # outwards in growing steps
        near, far = far, a * (1 + way * step)
        if (tilt(far)[0] > 0) != (first > 0):
            break
        step *= 30
        if step > Decimal("0.03"):
            raise Lost("P(a)/a has no peak next to the guess")
    low, high = min(near, far), max(near, far)
    below, above = tilt(low)[0], tilt(high)[0]
    for k in range(400):
        # In turn by halves and by the secant, which is no good before the ends are of one size.
        share = below / (below - above) if k % 3 and 0 < below and above < 0 else Decimal("0.5")
        middle = low + (high - low) * min(max(share, Decimal("1e-4")), 1 - Decimal("1e-4"))
        value, half = tilt(middle)
        if abs(value) < Decimal(FLAT) * middle or not low < middle < high:
            return middle, half
        low, high, below, above = (middle, high, value, above) if value > 0 else (low, middle, below, value)
    raise Lost("the peak of P(a)/a is too narrow")
