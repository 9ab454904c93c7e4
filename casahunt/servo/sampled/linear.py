"""The linear loop as built: its exact frequency response, and from that its stability and margins.

Dry friction, counts, dead bands, resets and feedforward left out, the loop of controller.py, remedied.py and loop.py is
linear.  At z = exp(i omega T), with D = delay = l T + p, 0 <= p < T, and r = sigma2/J,

    L(z) = C(z) P(z)
    C(z) = f z/(z - 1 + f) (kp + ki W + kd s (z - 1)/(T (z - 1 + s)))
    W    = T z/(z - 1 + leak T), or T (z + 1)/2/(z - 1 + leak T)             rectangle, trapezoid
    f, s = T/(T + Te), T/(T + Tf)                                            1 without a filter
    P(z) = z^-l ((z - a) x(z) + E(T) v(z))/(J (z - 1) (z - a)),   a = exp(-r T)

x(z) and v(z) are what position and velocity have gained at the next sample, times J, by the torque that is held for
h = T - p, and by the one before it, 1/z, for p and then no longer:

    E(h) = (1 - exp(-r h))/r,   F(h) = (h - E(h))/r          velocity and position times J
    v(z) = E(h) + exp(-r h) E(p)/z
    x(z) = F(h) + (F(p) + E(h) E(p))/z

No pole of L is outside of the unit circle.  As the gain is raised from next to nothing, where two poles are unstable if
arg -L < 0 at low frequencies, and none if not, a pair of poles leaves the unit circle at each frequency at which
arg -L falls through 0, enters it where that rises, at the gain factor 1/|L|; and at pi/T a single one.

Source: Nyquist's criterion; P(z), the pulse transfer function of a plant behind a hold with a delay, is derived here.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ...checks import COMPUTED, sensible
from ..delayed_loop import FREQUENCIES, Margins, crossover
from ..drive import Drive
from ..servo import Servo, a_servo

Array = np.ndarray

LOWEST_SEEN = 1e-6
"""Lowest frequency looked at, in units of the crossover of the continuous loop or of pi/T."""
BISECTED = 60
"""Halvings of a step between two frequencies: to rounding."""
SERIES_BELOW, TERMS = 0.1, 10
"""Below this r h rounding would take digits of F(h), and so many terms of its series leave none out."""


def sampled_margins(servo: Servo, gain: float, drive: Drive) -> Margins:
    """Margins of the loop as built, dry friction and counts left out.

    Parameters
    ----------
    servo, gain
        the loop.
    drive
        how it is run: sample time, delay, derivative and its filter, integration, leak, error filter.

    Returns
    -------
    Margins; crossovers up to pi/T, where there is none that frequency; of an unstable loop the factors are nan.

    Raises
    ------
    InputError : gain not a finite number > 0.

    Examples
    --------
    >>> from casahunt import Drive, Servo, sampled_margins
    >>> found = sampled_margins(Servo(), 0.1, Drive(sample_time=0.01))  # [s]
    >>> round(found.phase_margin, 2), round(found.highest_factor, 2)  # degrees, and times the gain
    (47.76, 18.48)
    """
    a_servo(servo)
    sensible("gain", gain, power=COMPUTED)
    last = math.pi / drive.sample_time
    low = LOWEST_SEEN * min(crossover(servo, gain), last)
    omega = np.geomspace(low, last, FREQUENCIES)

    def turned(at: Array) -> Array:
        """-L."""
        return -sampled_response(servo, gain, drive, at)

    factors, change = _limits(turned, omega)
    unstable = 2 * int(turned(omega[:1])[0].imag < 0) + int(change[factors < 1].sum())
    at, _ = _crossings(lambda at: np.log(np.abs(turned(at))), omega)
    at = at if at.size else omega[-1:]
    phi = np.degrees(np.angle(turned(at)))
    phi = phi if unstable else np.mod(phi, 360)
    i = int(np.argmin(phi))
    frequency, margin = float(at[i]), float(phi[i])
    if unstable:
        return Margins(frequency, min(margin, 0.0), math.nan, math.nan, False)
    low_factor, high_factor = max(factors[factors < 1], default=0.0), min(factors[factors > 1], default=math.inf)
    return Margins(frequency, margin, float(low_factor), float(high_factor), True)


def _limits(turned: Callable[[Array], Array], omega: Array) -> tuple[Array, Array]:
    """Gain factors at which poles cross the unit circle, and how many leave it there; negative: enter it."""
    at, falls = _crossings(lambda at: turned(at).imag, omega[:-1])
    values, change = turned(at), np.where(falls, 2, -2)
    before, end = turned(omega[-2:])
    values = np.append(values, end.real)
    change = np.append(change, 1 if before.imag > 0 else -1)
    real = values.real > 0
    return 1 / np.abs(values[real]), change[real]


def _crossings(f: Callable[[Array], Array], omega: Array) -> tuple[Array, Array]:
    """Where a function changes its sign between the first and the last frequency, and whether it falls there."""
    above = f(omega) > 0
    i = np.flatnonzero(above[:-1] != above[1:])
    low, high, falls = omega[i], omega[i + 1], above[i]
    for _ in range(BISECTED):
        middle = (low + high) / 2
        same = (f(middle) > 0) == falls
        low, high = np.where(same, middle, low), np.where(same, high, middle)
    return (low + high) / 2, falls


def sampled_response(servo: Servo, gain: float, drive: Drive, omega: Array) -> Array:
    """(m,) L at frequencies [rad/s] up to pi/T."""
    T, J, r = drive.sample_time, servo.inertia, servo.friction.viscous / servo.inertia
    half = omega * T / 2
    z = np.exp(2j * half)
    above = 2j * np.sin(half) * np.exp(1j * half)  # z - 1, to rounding
    kp, kd, ki = servo.torque_gains(gain)
    f, s = T / (T + drive.error_filter_time), T / (T + drive.filter_of(servo.controller))
    mean = (z + 1) / 2 if drive.integration == "trapezoid" else z
    C = kp + ki * T * mean / (above + drive.leak * T) + kd * s * above / (T * (above + s))
    late, p = divmod(drive.delay, T)
    h = T - p
    v = _velocity(r, h) + math.exp(-r * h) * _velocity(r, p) / z
    x = _position(r, h) + (_position(r, p) + _velocity(r, h) * _velocity(r, p)) / z
    behind = above - math.expm1(-r * T)  # z - a
    P = np.exp(-2j * half * late) * (behind * x + _velocity(r, T) * v) / (J * above * behind)
    return np.asarray(f * z / (above + f) * C * P)


def _velocity(r: float, h: float) -> float:
    """E(h)."""
    return -math.expm1(-r * h) / r if r else h


def _position(r: float, h: float) -> float:
    """F(h)."""
    x = r * h
    if x < SERIES_BELOW:
        return h * h * sum((-x) ** k / math.factorial(k + 2) for k in range(TERMS))
    return (h - _velocity(r, h)) / r
