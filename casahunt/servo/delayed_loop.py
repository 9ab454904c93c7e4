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
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..checks import COMPUTED, require, sensible
from ..hybrid.roots import boundary
from .servo import Servo

FREQUENCIES = 4001
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
    """ln |L|^2 at omega = exp(y), for numbers, arrays and CasADi expressions.

    Parameters
    ----------
    J, cm, sigma2
        inertia [kg m2], motor gain [N m/V], viscous friction [N m s/rad].
    k
        ln K, K in V/rad.
    q
        ln (tau_d, tau_i), times in s.
    y
        ln omega, omega in rad/s; decides what comes back.

    Returns
    -------
    ln |L|^2, of the kind and shape of `y`.
    """
    exp, log, *_ = _functions_of(y)
    w = exp(2 * y)
    zeros = log(exp(2 * q[0]) * w + 1) + log(exp(2 * q[1]) * w + 1)
    return 2 * k + 2 * math.log(cm) + zeros - 2 * q[1] - 4 * y - log(J**2 * w + sigma2**2)


def phase(J, sigma2, D, q, y):  # type: ignore[no-untyped-def]
    """The phase phi = arg L + pi at omega = exp(y), for numbers, arrays and CasADi expressions.

    Parameters
    ----------
    J, sigma2
        inertia [kg m2], viscous friction [N m s/rad].
    D
        delay [s], half a sample time included.
    q
        ln (tau_d, tau_i), times in s.
    y
        ln omega, omega in rad/s; decides what comes back.

    Returns
    -------
    phi [rad], of the kind and shape of `y`.
    """
    exp, _, atan, atan2 = _functions_of(y)
    omega = exp(y)
    return atan(exp(q[0]) * omega) + atan(exp(q[1]) * omega) - atan2(J * omega, sigma2) - omega * D


def _functions_of(y: Any) -> tuple[Callable[..., Any], ...]:
    """exp, log, atan and atan2 of numbers, or of CasADi expressions."""
    if isinstance(y, float | np.ndarray):
        return np.exp, np.log, np.arctan, np.arctan2
    return ca.exp, ca.log, ca.atan, ca.atan2


def _log_times(servo: Servo) -> tuple[float, float]:
    """ln (tau_d, tau_i); -inf for a loop without lead."""
    lead, integral = servo.controller.lead_time, servo.controller.integral_time
    return math.log(lead) if lead > 0 else -math.inf, math.log(integral)


def _log_magnitude(servo: Servo, gain: float, y: float) -> float:
    J, sigma2 = servo.inertia, servo.friction.viscous
    return float(log_magnitude(J, servo.motor_gain, sigma2, math.log(gain), _log_times(servo), y))


def _phase(servo: Servo, delay: float, y: float | np.ndarray) -> np.ndarray:
    return np.asarray(phase(servo.inertia, servo.friction.viscous, delay, _log_times(servo), y))


def crossover(servo: Servo, gain: float, level: float = 1.0) -> float:
    """The frequency [rad/s] at which |L| = level.

    Parameters
    ----------
    servo, gain
        the loop; gain K > 0 [V/rad].
    level
        magnitude > 0.

    Returns
    -------
    omega [rad/s].

    Raises
    ------
    InputError : gain not a finite number > 0.
    """
    sensible("gain", gain, power=COMPUTED)
    low, high = boundary(lambda y: not _log_magnitude(servo, gain, y) > 2 * math.log(level), -60.0, 60.0)
    return math.exp((low + high) / 2)


def margins(servo: Servo, gain: float, *, delay: float = 0.0) -> Margins:
    """Margins of the loop.

    Parameters
    ----------
    servo, gain
        the loop.
    delay
        D [s], >= 0, half a sample time included.

    Returns
    -------
    Margins; of an unstable loop the factors are nan.

    Raises
    ------
    InputError : a value out of range.
    """
    require("delay", delay, at_least=0)
    omega = crossover(servo, gain)
    phi = float(_phase(servo, delay, math.log(omega)))
    if not phi > 0:
        return Margins(omega, math.degrees(phi), math.nan, math.nan, False)
    grid = np.log(omega * np.geomspace(1e-6, 1e6, FREQUENCIES))
    values = _phase(servo, delay, grid)
    above = [i for i in range(FREQUENCIES - 1) if grid[i] >= math.log(omega) and values[i + 1] <= 0]
    below = [i for i in range(FREQUENCIES - 1) if grid[i + 1] <= math.log(omega) and values[i] <= 0]

    def factor(i: int) -> float:
        rising = bool(values[i + 1] > 0)
        ends = boundary(lambda y: bool(_phase(servo, delay, y) > 0) == rising, float(grid[i]), float(grid[i + 1]))
        return math.exp(-_log_magnitude(servo, gain, sum(ends) / 2) / 2)

    return Margins(
        omega,
        math.degrees(phi),
        factor(below[-1]) if below else 0.0,
        factor(above[0]) if above else math.inf,
        True,
    )
