"""An independent engine for the tests: Taylor series with events, no collocation, no CasADi.

Servo: x1' = x2, J x2' = m - F, x3' = x1, m = -(kp x1 + kd x2 + ki x3), friction as in the report.
Every right-hand side is a chain of sums, products, quotients and one exponential, whose Taylor
coefficients follow from recurrences (Griewank and Walther, Evaluating Derivatives, chapter 13):

    w = u v:    w_k = sum_j u_j v_{k-j}
    w = u / v:  w_k = (u_k - sum_{j<k} w_j v_{k-j}) / v_0
    w = exp u:  k w_k = sum_{j>=1} j u_j w_{k-j}

The step is chosen from the last coefficients; events are roots of the polynomial in the step.
"""

from __future__ import annotations

import math

import numpy as np

from casahunt.servo.controller import Pid
from casahunt.servo.servo import Servo

ORDER = 22
EPS = 1e-17


class Flow:
    """One smooth piece of the motion: Taylor coefficients of all states at a point."""

    def __init__(self, servo: Servo, gain: float, model: str) -> None:
        f, c = servo.friction, servo.controller
        factor = gain * servo.motor_gain
        self.J = servo.inertia
        if isinstance(c, Pid):
            self.kp, self.ki, self.kd = factor * c.kp, factor * c.ki, factor * c.kd
        else:
            self.kp, self.kd = factor * (1 + c.lead_time / c.integral_time), factor * c.lead_time
            self.ki = factor / c.integral_time
        self.Fs, self.Fc, self.vs, self.s2 = f.static, f.coulomb, f.stribeck_velocity, f.viscous
        self.s0, self.s1 = f.stiffness, f.damping
        self.model = model

    def torque(self, x: np.ndarray) -> float:
        return -(self.kp * x[0] + self.kd * x[1] + self.ki * x[2])

    def series(self, x: np.ndarray, sign: float) -> np.ndarray:
        """Taylor coefficients of the motion.

        x: (n,) state; sign: friction direction, +1 or -1. Returns (n, ORDER + 1).
        """
        n = x.size
        a = np.zeros((n, ORDER + 1))
        a[:, 0] = x
        dw, e, q = np.zeros(ORDER + 1), np.zeros(ORDER + 1), np.zeros(ORDER + 1)  # dw_k = k w_k
        g, zv = np.zeros(ORDER + 1), np.zeros(ORDER + 1)
        v = a[1]
        e[0] = math.exp(-((v[0] / self.vs) ** 2))
        for k in range(ORDER):
            if k:
                dw[k] = -k * (v[: k + 1] @ v[k::-1]) / self.vs**2
                e[k] = dw[1 : k + 1] @ e[k - 1 :: -1] / k
            g[k] = (self.Fs - self.Fc) * e[k] + (self.Fc if k == 0 else 0.0)
            m = -(self.kp * a[0, k] + self.kd * v[k] + self.ki * a[2, k])
            if self.model == "switch":
                friction = sign * g[k] + self.s2 * v[k]
            else:
                zv[k] = v[: k + 1] @ a[3, k::-1]
                q[k] = (zv[k] - q[:k] @ g[k:0:-1]) / g[0]
                rate = v[k] - self.s0 * sign * q[k]
                friction = self.s0 * a[3, k] + self.s1 * rate + self.s2 * v[k]
                a[3, k + 1] = rate / (k + 1)
            a[0, k + 1] = v[k] / (k + 1)
            a[1, k + 1] = (m - friction) / self.J / (k + 1)
            a[2, k + 1] = a[0, k] / (k + 1)
        return a


def _value(a: np.ndarray, h: float | np.ndarray) -> np.ndarray:
    """(n,) the motion at one time, (n, m) at several."""
    return a @ np.power.outer(h, np.arange(ORDER + 1)).T


def _step(a: np.ndarray, scale: np.ndarray, vs: float) -> float:
    # Several coefficients: a single one may pass through zero and promise too long a step.
    orders = np.arange(ORDER - 5, ORDER + 1)
    sizes = np.max(np.abs(a[:, orders]) / scale[:, None], axis=0)
    h = 0.8 * min(float(np.min((EPS / sizes[sizes > 0]) ** (1 / orders[sizes > 0]), initial=1e3)), 1e3)
    # Far above vs the exponential has no visible coefficients: it must not come back within a step.
    allowed = max(vs, abs(a[1, 0]) - 7 * vs)
    while abs(_value(a, h)[1] - a[1, 0]) > allowed:
        h *= 0.7
    return h


def _root(a: np.ndarray, row: np.ndarray, low: float, high: float) -> float:
    """Root of row . x(h) between low and high, by bisection and Newton."""
    c = row @ a
    f_low = float(np.polynomial.polynomial.polyval(low, c))
    for _ in range(60):
        middle = (low + high) / 2
        f = float(np.polynomial.polynomial.polyval(middle, c))
        if f * f_low > 0:
            low = middle
        else:
            high = middle
    h = (low + high) / 2
    derivative = np.polynomial.polynomial.polyder(c)
    for _ in range(3):
        slope = float(np.polynomial.polynomial.polyval(h, derivative))
        if slope:
            h -= float(np.polynomial.polynomial.polyval(h, c)) / slope
    return h


def switch_half_cycle(
    servo: Servo, gain: float, a: float, *, thrown_out: float = math.inf, most_slips: float = math.inf
) -> tuple[float, float, list[float]]:
    """The Switch servo from breakaway at x1 = -a until it sticks.

    servo, gain: the problem; gain K [V/rad]; a: stick position [rad], > 0; thrown_out: |x1| [rad] of a turning point
    beyond which the motion is not followed; most_slips: turning points without stick after which it is not followed.
    Returns stick position reached [rad], half period [s], slip durations [s]; for a motion that is not followed its
    |x1| and nan.
    """
    flow = Flow(servo, gain, "switch")
    x = np.array([-a, 0.0, (flow.kp * a - flow.Fs) / flow.ki])
    sign, time, slips = 1.0, 0.0, []
    velocity = np.array([0.0, 1.0, 0.0])
    while True:
        began, first = time, True
        scale = np.array([a, max(a, 1e-6), abs(flow.Fs / flow.ki)])
        while True:
            c = flow.series(x, sign)
            h = _step(c, scale, flow.vs)
            if first:
                # Velocity and acceleration vanish at breakaway: keep the first step inside the slip.
                h = min(h, 1e-3)
            samples = sign * _value(c, np.linspace(0, h, 9)[1:])[1]
            if not first and (samples < 0).any():
                i = int(np.flatnonzero(samples < 0)[0])
                h = _root(c, velocity, h * i / 8, h * (i + 1) / 8)
                x = _value(c, h)
                time += h
                break
            x, time, first = _value(c, h), time + h, False
        slips.append(time - began)
        x[1] = 0.0
        m = flow.torque(x)
        if abs(m) > flow.Fs and (abs(x[0]) > thrown_out or len(slips) >= most_slips):
            return abs(float(x[0])), math.nan, slips
        if abs(m) <= flow.Fs:
            way_out = -np.sign(x[0])
            return float(x[0]), time + (m - way_out * flow.Fs) / (flow.ki * x[0]), slips
        sign = float(np.sign(m))


def lugre_half_cycle(servo: Servo, gain: float, x: np.ndarray, sign: float = 1.0) -> tuple[np.ndarray, float, float]:
    """The LuGre servo from x1 = 0 in mid-slip to the next x1 = 0.

    servo, gain: the problem; gain K [V/rad]; x: (4,) state; sign: that of x2.
    Returns (4,) state, time [s], largest |x1| [rad].
    """
    flow = Flow(servo, gain, "lugre")
    scale = np.array([np.max(np.abs(x[2] * flow.ki / flow.kp)), np.abs(x[1]), np.abs(x[2]), flow.Fs / flow.s0])
    time, largest = 0.0, 0.0
    velocity, position = np.array([0, 1.0, 0, 0]), np.array([1.0, 0, 0, 0])
    side = sign
    started = False
    while True:
        c = flow.series(x, sign)
        h = _step(c, scale, flow.vs)
        grid = np.linspace(0, h, 9)
        values = _value(c, grid).T
        reverse = np.flatnonzero(sign * values[1:, 1] < 0)
        cross = np.flatnonzero(side * values[1:, 0] < 0) if started else np.zeros(0, int)
        events = [(int(r[0]), row) for r, row in ((reverse, velocity), (cross, position)) if r.size]
        if events:
            i, row = min(events, key=lambda event: event[0])
            h = _root(c, row, grid[i], grid[i + 1])
            x = _value(c, h)
            time += h
            largest = max(largest, abs(x[0]))
            if row is position:
                return x, time, largest
            x[1] = 0.0
            sign = -sign
            # A first step off the reversal, so that x2 = 0 is not met again.
            c = flow.series(x, sign)
            tiny = 1e-3 * _step(c, scale, flow.vs)
            x, time = _value(c, tiny), time + tiny
        else:
            x, time = values[-1], time + h
        started = started or side * x[0] > 1e-3 * scale[0]
        largest = max(largest, abs(x[0]))


def switch_cycle(servo: Servo, gain: float, guess: float) -> tuple[float, float]:
    """The symmetric cycle of the Switch servo, by the secant method on P(a) = a.

    servo, gain: the problem; gain K [V/rad]; guess: its stick position [rad], about.
    Returns stick position [rad], which is its amplitude, and period [s].
    """
    a0, a1 = guess, guess * (1 + 1e-6)
    f0 = switch_half_cycle(servo, gain, a0)[0] - a0
    for _ in range(30):
        f1 = switch_half_cycle(servo, gain, a1)[0] - a1
        if f1 == f0 or abs(a1 - a0) <= 1e-15 * a1:
            break
        a0, a1, f0 = a1, a1 - f1 * (a1 - a0) / (f1 - f0), f1
    return a1, 2 * switch_half_cycle(servo, gain, a1)[1]


def switch_fold(servo: Servo, gain: float, guess: float) -> tuple[float, float]:
    """The fold of the Switch servo's symmetric cycles: the gain at which the largest of P(a) - a vanishes.

    P at nine Chebyshev points gives the polynomial whose largest value is taken, within 0.5 % of the guess and then
    within 0.1 % of the place found last; the gain by the secant method.

    gain, guess: the gain K [V/rad] and the stick position [rad] of the fold, about (to 1e-5 and 0.4 %).
    Returns gain [V/rad] and stick position [rad] of the fold.
    Raises ValueError: P(a) - a has no extremum, or several, near the guess.
    """
    points = np.cos(np.pi * (np.arange(9) + 0.5) / 9)

    def largest(gain: float, near: float, width: float) -> tuple[float, float]:
        a = near * (1 + width * points)
        over = [switch_half_cycle(servo, gain, float(x))[0] - x for x in a]
        surplus = np.polynomial.Chebyshev.fit(a, over, 8, domain=[near * (1 - width), near * (1 + width)])
        tops = np.asarray(surplus.deriv().roots(), dtype=complex)
        inside = [float(t.real) for t in tops if abs(t.imag) < 1e-9 * near and abs(t.real / near - 1) < width]
        if len(inside) != 1:
            raise ValueError(f"P(a) - a has {len(inside)} extrema near {near} rad at the gain {gain} V/rad")
        return inside[0], float(surplus(inside[0]))

    a, _ = largest(gain, guess, 0.005)
    k0, k1 = gain, gain * (1 + 1e-6)
    a, f0 = largest(k0, a, 0.001)
    for _ in range(20):
        a, f1 = largest(k1, a, 0.001)
        if f1 == f0 or abs(k1 - k0) <= 1e-13 * k1:
            break
        k0, k1, f0 = k1, k1 - f1 * (k1 - k0) / (f1 - f0), f1
    return k1, a
