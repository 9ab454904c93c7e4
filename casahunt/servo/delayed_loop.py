"""The linear loop with a delay: how much phase, gain and delay it can lose.

    L(s) = C(s) P(s) exp(-s D),    D = delay + T_s/2        [s]

T_s is the sample time: a zero-order hold lags by half a sample, omega T_s/2, exactly; its loss of magnitude,
sin(x)/x with x = omega T_s/2, is left out.  Of the loop without delay (linear_loop.py):

    ln |L|^2 = ln( (K cm)^2 (tau_d^2 w + 1)(tau_i^2 w + 1) / (tau_i^2 w^2 (J^2 w + sigma2^2)) ),     w = omega^2
    phi = arg L + pi = atan(tau_d omega) + atan(tau_i omega) - atan2(J omega, sigma2) - omega D    [rad]

|L| = c has one root for every c > 0 (Descartes, linear_loop.py), so |L| falls with omega.  The loop is stable at the
gain K if and only if phi > 0 where |L| = 1 (phi < pi; two integrators at omega = 0), and at the gain f K if and only
if phi > 0 where |L| = 1/f.  So it is stable from K/f_low to K f_high if phi > 0 between the two frequencies.

Source: Nyquist's criterion; symbols as in linear_loop.py.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..checks import COMPUTED, require, sensible
from .servo import Servo

GRID = 4001
"""Frequencies at which phi is searched for changes of sign, six decades each way of the crossover."""


@dataclass(frozen=True)
class Margins:
    """Margins of the loop with delay.

    Attributes
    ----------
    frequency : crossover |L| = 1 [rad/s].
    phase_margin : phi there [deg].
    lowest_factor, highest_factor : the gain may be multiplied by anything between them and the loop stays stable;
        0 and inf without such a limit; nan for an unstable loop.
    stable : phase_margin > 0.
    """

    frequency: float
    phase_margin: float
    lowest_factor: float
    highest_factor: float
    stable: bool


def log_magnitude(J, cm, sigma2, k, q, y):  # type: ignore[no-untyped-def]
    """ln |L|^2 at omega = exp(y), for numbers and expressions: ln K = k, ln (tau_d, tau_i) = q."""
    exp, log = (ca.exp, ca.log)
    w = exp(2 * y)
    zeros = log(exp(2 * q[0]) * w + 1) + log(exp(2 * q[1]) * w + 1)
    return 2 * k + 2 * math.log(cm) + zeros - 2 * q[1] - 4 * y - log(J**2 * w + sigma2**2)


def phase(J, sigma2, D, q, y):  # type: ignore[no-untyped-def]
    """phi [rad] at omega = exp(y), for numbers and expressions."""
    omega = ca.exp(y)
    return ca.atan(ca.exp(q[0]) * omega) + ca.atan(ca.exp(q[1]) * omega) - ca.atan2(J * omega, sigma2) - omega * D


def crossover(servo: Servo, gain: float, level: float = 1.0) -> float:
    """The frequency [rad/s] at which |L| = level.

    Parameters
    ----------
    servo
        the servo.
    gain
        controller gain K > 0.
    level
        > 0.
    """
    sensible("gain", gain, power=COMPUTED)
    low, high = -60.0, 60.0
    for _ in range(200):
        middle = (low + high) / 2
        if _log_magnitude(servo, gain, middle) > 2 * math.log(level):
            low = middle
        else:
            high = middle
    return math.exp((low + high) / 2)


def _log_magnitude(servo: Servo, gain: float, y: float) -> float:
    lead, integral = servo.controller.lead_time, servo.controller.integral_time
    w = math.exp(2 * y)
    value = (gain * servo.motor_gain) ** 2 * (lead**2 * w + 1) * (integral**2 * w + 1)
    return math.log(value) - math.log(integral**2 * w**2) - math.log(
        servo.inertia**2 * w + servo.friction.viscous**2
    )


def _phase(servo: Servo, delay: float, omega: np.ndarray) -> np.ndarray:
    lead, integral = servo.controller.lead_time, servo.controller.integral_time
    lag = np.arctan2(servo.inertia * omega, servo.friction.viscous)
    return np.asarray(np.arctan(lead * omega) + np.arctan(integral * omega) - lag - omega * delay)


def margins(servo: Servo, gain: float, *, delay: float = 0.0) -> Margins:
    """Margins of the loop.

    Parameters
    ----------
    servo, gain
        the loop.
    delay
        D [s], >= 0, half a sample time included.

    Raises
    ------
    InputError : a value out of range.
    """
    require("delay", delay, at_least=0)
    omega = crossover(servo, gain)
    phi = float(_phase(servo, delay, np.array([omega]))[0])
    if not phi > 0:
        return Margins(omega, math.degrees(phi), math.nan, math.nan, False)
    grid = omega * np.geomspace(1e-6, 1e6, GRID)
    values = _phase(servo, delay, grid)
    above = [i for i in range(GRID - 1) if grid[i] >= omega and values[i + 1] <= 0]
    below = [i for i in range(GRID - 1) if grid[i + 1] <= omega and values[i] <= 0]

    def factor(i: int) -> float:
        low, high = math.log(grid[i]), math.log(grid[i + 1])
        rising = values[i + 1] > 0
        for _ in range(80):
            middle = (low + high) / 2
            if (float(_phase(servo, delay, np.array([math.exp(middle)]))[0]) > 0) == rising:
                high = middle
            else:
                low = middle
        return math.exp(-_log_magnitude(servo, gain, (low + high) / 2) / 2)

    return Margins(
        omega,
        math.degrees(phi),
        factor(below[-1]) if below else 0.0,
        factor(above[0]) if above else math.inf,
        True,
    )
