"""A slip of the Switch servo under a constant torque m: its Taylor series, and where it stops.

    J v' = m - s g(v) - sigma2 v,   g(v) = Fc + (Fs - Fc) exp(-(v/vs)^2),   s = sgn v

With y = s v/vs and the time tau = t/h in a step of h,

    y' = h (a + b w - c y),   w = 1 - exp(-y^2),   w' = 2 y y' (1 - w)
    a = (s m - Fs)/(J vs),    b = (Fs - Fc)/(J vs),   c = sigma2/J                       [1/s]

so that nothing cancels at breakaway, where y = 0 and s m is next to Fs.  The coefficients of y in tau follow from each
other; a step is as long as the last ones are below rounding.  For constant m the equation is autonomous and of first
order: y goes one way, and the end of a step tells whether it has stopped inside.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ... import effort
from ...compiled import Caller, caller, kept
from ..friction import Friction

ORDER = 20
"""Of the series."""
LAST_COEFFICIENTS = 1e-17
"""Of the last two coefficients, relative to the largest |y| of the step."""
LEAST_SHARE, TAKEN_OFF = 0.2, 0.9
"""Factors of a step: at least so much of it when it is tried again, and what its estimate is multiplied by."""
UNSEEN_FROM = 8.0
"""y from which exp(-y^2) is so small that the series of a step down to y = 0 would not show it: there y is halved at
most.  From here down 1e-28 is seen, as it grows by (2 y y')^20/20!."""
LOOKED = 256
"""Steps between two reports of the work."""
NEWTON_MOST = 60
"""Steps of a root between two ends, by Newton's method where it stays between them, else halved."""


@kept(None)
def _series() -> Caller:
    """(y, h a, h b, h c) -> the coefficients of y in tau (ORDER + 1,), and y(1), integral of y, last coefficients."""
    y0, a, b, c = (ca.SX.sym(name) for name in "yabc")
    y, w, square = [y0], [-ca.expm1(-y0 * y0)], [y0 * y0]  # square: y^2
    for k in range(ORDER):
        y.append(((a if k == 0 else 0) + b * w[k] - c * y[k]) / (k + 1))
        square.append(sum(y[i] * y[k + 1 - i] for i in range(k + 2)))
        # w' = (y^2)' (1 - w)
        known = [ca.exp(-y0 * y0), *(-u for u in w[1:])]
        w.append(sum((j + 1) * square[j + 1] * known[k - j] for j in range(k + 1)) / (k + 1))
    end, way = sum(reversed(y)), sum(u / (k + 1) for k, u in reversed(list(enumerate(y))))
    tail = ca.fmax(ca.fabs(y[-1]), ca.fabs(y[-2]))
    compiled = ca.Function("slip", [ca.vertcat(y0, a, b, c)], [ca.vertcat(end, way, tail, *y)])
    return caller(compiled, [(4,)], [(ORDER + 4,)])


class Slips:
    """The slips of one servo.

    J, friction: its inertia and friction; z: it has no bristle.
    """

    z = 0.0

    def __init__(self, J: float, friction: Friction) -> None:
        Fs, Fc, vs, sigma2 = friction.static, friction.coulomb, friction.stribeck_velocity, friction.viscous
        self.static, self._vs, self._steps = Fs, vs, 0
        self._a, self._b, self._c = 1 / (J * vs), (Fs - Fc) / (J * vs), sigma2 / J
        buffers = _series().buffers
        (self._given,), (self._found,), self._evaluate = buffers.inputs, buffers.outputs, buffers.trigger

    def __call__(self, x: float, v: float, m: float, lasts: float) -> tuple[float, float, list[float]]:
        """(x1, v) after `lasts` seconds of the torque m, and the times [s] of the stops inside."""
        now, stops = 0.0, []
        while now < lasts:
            if v == 0 and abs(m) <= self.static:
                break
            forward = v > 0 or v == 0 and m > 0
            y, way, taken, stopped = self._slip(abs(v) / self._vs, m if forward else -m, lasts - now)
            now = lasts if taken == lasts - now else now + taken
            x, v = (x + self._vs * way, self._vs * y) if forward else (x - self._vs * way, -self._vs * y)
            if stopped:
                v = 0.0  # not -0
                stops.append(now)
        return x, v, stops

    def _slip(self, y: float, m: float, longest: float) -> tuple[float, float, float, bool]:
        """(y, integral of y, time, whether it stops there) of one step from y >= 0, of `longest` seconds at most."""
        given, found, h = self._given, self._found, longest
        a = (m - self.static) * self._a
        while True:
            given[:] = y, h * a, h * self._b, h * self._c
            self._evaluate()
            self._steps += 1
            if self._steps % LOOKED == 0:
                effort.pieces(LOOKED)
            end, way, tail = found[:3].tolist()
            allowed = LAST_COEFFICIENTS * max(y, abs(end))
            if tail <= allowed:
                if y <= UNSEEN_FROM or end >= y / 2:
                    break
                h *= y / 2 / (y - end)
                continue
            # nan and inf, too: a series far beyond its radius
            share = (allowed / tail) ** (1 / ORDER) if tail < np.inf and allowed < np.inf else 0.0
            h *= max(TAKEN_OFF * share, LEAST_SHARE)
        if end > 0:
            return end, h * way, h, False
        series = found[3:].tolist()
        tau = first_zero(series)
        return 0.0, h * integral(series, tau), h * tau, True


def first_zero(series: list[float]) -> float:
    """The place in (0, 1] where a polynomial is zero that begins positive and ends negative; by its coefficients."""
    low, high, tau = 0.0, 1.0, 1.0
    for _ in range(NEWTON_MOST):
        value = slope = 0.0
        for coefficient in reversed(series):
            slope = slope * tau + value
            value = value * tau + coefficient
        if value > 0:
            low = tau
        else:
            high = tau
        step = value / slope if slope else 0.0
        following = tau - step
        if not low <= following <= high or slope == 0:
            following = (low + high) / 2
        if following == tau or high - low <= np.spacing(high):
            break
        tau = following
    return tau


def value_at(series: list[float], tau: float) -> float:
    """Of the polynomial."""
    value = 0.0
    for coefficient in reversed(series):
        value = value * tau + coefficient
    return value


def integral(series: list[float], tau: float) -> float:
    """Of the polynomial from 0 to tau."""
    total = 0.0
    for k in range(len(series) - 1, -1, -1):
        total = total * tau + series[k] / (k + 1)
    return total * tau
