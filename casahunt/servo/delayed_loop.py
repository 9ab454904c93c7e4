"""The linear loop with a delay: how much phase, gain and delay it can lose.

    L(s) = C(s) P(s) exp(-s D)

The margins of a sampled loop, in which more is lost, are in sampled/linear.py.  Of the loop without delay
(linear_loop.py), w = omega^2, by times and by gains (kp' and so on: at K = 1):

    ln |L|^2 = ln( (K cm)^2 (tau_d^2 w + 1)(tau_i^2 w + 1) / (tau_i^2 w^2 (J^2 w + sigma2^2)) )
             = ln( (K cm)^2 (kp'^2 w + (kd' w - ki')^2) / (w^2 (J^2 w + sigma2^2)) )
    phi = arg L + pi = atan(tau_d omega) + atan(tau_i omega) - atan2(J omega, sigma2) - omega D    [rad]
        = atan2(kd' w - ki', kp' omega) + pi/2 - atan2(J omega, sigma2) - omega D

By times, |L| = c has one root for every c > 0 (Descartes, linear_loop.py), so |L| falls with omega, and the loop is
stable if and only if phi > 0 there (phi < pi; two integrators at omega = 0).  By gains, |L| may rise between two
frequencies and have three crossovers.  In either case the unstable poles are counted: those without delay, 0 or 2
(Routh), and two more, or less, for each of the delays (phi_0 + 2 pi k)/omega up to D at a crossover omega where |L|
falls, or rises (phi_0: without delay).  The phase margin is the least phi of all crossovers; phi > 0 at all of them is
stable, and where a loop is stable all the same, phi counts modulo 2 pi.  A stable loop stays so while the gain is
multiplied by anything between the two factors 1/|L|, phi a multiple of 2 pi, next to 1.

Source: Nyquist's criterion; to follow the poles through the crossovers as the delay grows is known as the direct method
of Walton and Marshall, and derived here.  Symbols as in linear_loop.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..checks import COMPUTED, require, sensible
from ..results import Result
from ..roots import boundary
from .controller import Pid
from .linear_loop import gain_crossovers, loop_polynomials, stable
from .servo import Servo, a_servo

FREQUENCIES = 4001
"""Frequencies at which phi is searched for changes of sign, six decades each way of the crossover."""

RISE = 1e-6
"""Step in ln omega that tells whether |L| rises at a crossover."""


@dataclass(frozen=True, repr=False)
class Margins(Result):
    """Margins of the loop with delay.

    Attributes
    ----------
    frequency : crossover |L| = 1 [rad/s]; that of the phase margin, where there are several.
    phase_margin : phi there [deg].
    lowest_factor, highest_factor : the gain may be multiplied by anything between them and the loop stays stable;
        0 and inf without such a limit; nan for an unstable loop.
    stable : no pole in the right half-plane; phase_margin > 0.

    Examples
    --------
    >>> from casahunt import Servo, margins
    >>> margins(Servo(), 0.1)
    <Margins: phase margin 52.2768 deg, frequency 11.9131 rad/s, lowest factor 0, highest factor inf, stable True>
    """

    _quantities = ("phase_margin [deg]", "frequency [rad/s]", "lowest_factor", "highest_factor", "stable")
    _details = ("crossover = frequency [rad/s]",)

    frequency: float
    phase_margin: float
    lowest_factor: float
    highest_factor: float
    stable: bool


def log_magnitude(J, cm, sigma2, k, q, y):  # type: ignore[no-untyped-def]
    """ln |L|^2 at omega = exp(y), for numbers, arrays and CasADi expressions.

    J, cm, sigma2: inertia [kg m2], motor gain [N m/V], viscous friction [N m s/rad]; k: ln K, K in V/rad; q: ln (tau_d,
    tau_i), times in s, or ln (kp', ki', kd'); y: ln omega, omega in rad/s; decides what comes back.
    Returns ln |L|^2, of the kind and shape of `y`.
    """
    exp, log, *_ = _functions_of(y)
    w = exp(2 * y)
    if _by_gains(q):
        kp, ki, kd = exp(q[0]), exp(q[1]), exp(q[2])
        square = kp**2 * w + (kd * w - ki) ** 2
        return 2 * k + 2 * math.log(cm) + log(square) - 4 * y - log(J**2 * w + sigma2**2)
    zeros = log(exp(2 * q[0]) * w + 1) + log(exp(2 * q[1]) * w + 1)
    return 2 * k + 2 * math.log(cm) + zeros - 2 * q[1] - 4 * y - log(J**2 * w + sigma2**2)


def phase(J, sigma2, D, q, y):  # type: ignore[no-untyped-def]
    """The phase phi = arg L + pi at omega = exp(y), for numbers, arrays and CasADi expressions.

    J, sigma2: inertia [kg m2], viscous friction [N m s/rad]; D: delay [s]; q: ln (tau_d, tau_i), times in s; y: ln
    omega, omega in rad/s; decides what comes back.
    Returns phi [rad], of the kind and shape of `y`.
    """
    exp, _, atan, atan2 = _functions_of(y)
    omega = exp(y)
    if _by_gains(q):
        lead = atan2(exp(q[2]) * omega - exp(q[1]) / omega, exp(q[0]))
        return lead + math.pi / 2 - atan2(J * omega, sigma2) - omega * D
    return atan(exp(q[0]) * omega) + atan(exp(q[1]) * omega) - atan2(J * omega, sigma2) - omega * D


def _by_gains(q: Any) -> bool:
    """Whether q are the logarithms of gains, three, rather than times, two."""
    return (q.shape[0] if hasattr(q, "shape") else len(q)) == 3


def _functions_of(y: Any) -> tuple[Callable[..., Any], ...]:
    """exp, log, atan and atan2 of numbers, or of CasADi expressions."""
    if isinstance(y, float | np.ndarray):
        return np.exp, np.log, np.arctan, np.arctan2
    return ca.exp, ca.log, ca.atan, ca.atan2


def _logarithms(servo: Servo) -> tuple[float, ...]:
    """ln (tau_d, tau_i) or (kp, ki, kd); -inf for a loop without derivative action."""
    c = servo.controller
    values = (c.kp, c.ki, c.kd) if isinstance(c, Pid) else (c.lead_time, c.integral_time)
    return tuple(math.log(value) if value > 0 else -math.inf for value in values)


def _log_magnitude(servo: Servo, gain: float, y: float) -> float:
    J, sigma2 = servo.inertia, servo.friction.viscous
    return float(log_magnitude(J, servo.motor_gain, sigma2, math.log(gain), _logarithms(servo), y))


def _phase(servo: Servo, delay: float, y: float | np.ndarray) -> np.ndarray:
    return np.asarray(phase(servo.inertia, servo.friction.viscous, delay, _logarithms(servo), y))


def crossover(servo: Servo, gain: float, level: float = 1.0) -> float:
    """The frequency [rad/s] at which |L| = level; the largest one where there are several.

    servo, gain: the loop; gain K > 0 [V/rad]; level: magnitude > 0. Returns omega [rad/s]. Raises InputError: gain not
    a finite number > 0.
    """
    sensible("gain", gain, power=COMPUTED)
    numerator, denominator = loop_polynomials(servo, gain)
    return gain_crossovers(numerator / level, denominator)[-1].frequency


def margins(servo: Servo, gain: float, *, delay: float = 0.0) -> Margins:
    """Margins of the loop.

    Parameters
    ----------
    servo, gain
        the loop.
    delay
        D [s], >= 0; of a sampled loop see `sampled_margins`.

    Returns
    -------
    Margins; of an unstable loop the factors are nan.

    Raises
    ------
    InputError : a value out of range.

    Examples
    --------
    >>> from casahunt import Servo, margins
    >>> found = margins(Servo(), 0.1, delay=0.01)  # [s]
    >>> round(found.phase_margin, 2), round(found.highest_factor, 2)  # degrees, and times the gain
    (45.45, 15.43)
    """
    a_servo(servo)
    sensible("gain", gain, power=COMPUTED)
    require("delay", delay, at_least=0)
    found = gain_crossovers(*loop_polynomials(servo, gain))
    y = np.log([c.frequency for c in found])
    phi = _phase(servo, delay, y)
    before, after = ([_log_magnitude(servo, gain, v + step) for v in y.tolist()] for step in (-RISE, RISE))
    rising = np.array(after) > np.array(before)
    turns = np.ceil(_phase(servo, 0.0, y) / (2 * np.pi)) - np.ceil(phi / (2 * np.pi))  # delays with phi = 2 pi k
    pairs = int(not stable(servo, gain)) + int(np.sum(np.where(rising, -turns, turns)))  # of unstable poles
    if pairs == 0 and not phi.min() > 0:
        phi = np.mod(phi, 2 * np.pi)
    i = int(np.argmin(phi))
    omega, margin = math.exp(y[i]), math.degrees(float(phi[i]))
    if pairs:
        return Margins(omega, min(margin, 0.0), math.nan, math.nan, False)
    factors = _factors(servo, gain, delay, math.exp(y[-1]))
    low, high = [f for f in factors if f < 1], [f for f in factors if f > 1]
    return Margins(omega, margin, max(low, default=0.0), min(high, default=math.inf), True)


def _factors(servo: Servo, gain: float, delay: float, omega: float) -> list[float]:
    """1/|L| where phi is a multiple of 2 pi, as many turns as there are up to `omega`, and one more."""
    grid = np.log(omega * np.geomspace(1e-6, 1e6, FREQUENCIES))
    values, found = _phase(servo, delay, grid), []
    for turn in range(2 + int(omega * delay / (2 * math.pi))):
        level = -2 * math.pi * turn
        for i in np.flatnonzero((values[:-1] > level) != (values[1:] > level)):
            rising = bool(values[i + 1] > level)
            ends = boundary(
                lambda y, up=rising, at=level: bool(_phase(servo, delay, y) > at) == up,  # type: ignore[misc]
                float(grid[i]), float(grid[i + 1]),
            )  # fmt: skip
            found.append(math.exp(-_log_magnitude(servo, gain, sum(ends) / 2) / 2))
    return found
