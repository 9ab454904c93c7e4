"""The phase of a linear loop with delay at its crossovers, for many loops at once.

With kappa = K cm g, where g is a factor by which the gain may be off, and w = omega^2, |L| g = 1 at

    kappa = tau_i w sqrt(J^2 w + sigma2^2) / sqrt((tau_d^2 w + 1)(tau_i^2 w + 1)),                       [N m/rad]
    phi   = atan(tau_d omega) + atan(tau_i omega) - atan2(J omega, sigma2) - omega D                       [rad]

(servo/delayed_loop.py; kappa rises with omega, so each kappa has one crossover).  For a controller by gains

    kappa = w sqrt(J^2 w + sigma2^2) / sqrt(kp'^2 w + (kd' w - ki')^2),
    phi   = atan2(kd' w - ki', kp' omega) + pi/2 - atan2(J omega, sigma2) - omega D,

kappa may fall between two frequencies, where the derivative of J^2 w^3 + sigma2^2 w^2 - kappa^2 (kp'^2 w + (kd' w -
ki')^2) has its zeros, and have three crossovers: phi is the least of them.

Symbols: m loops.
"""

from __future__ import annotations

import itertools

import numpy as np

Array = np.ndarray

LOG_OMEGA, BISECTIONS = (-60.0, 60.0), 60
"""ln omega between which the crossovers of loops by gains are bisected, and how often."""


def log_kappa(J: Array, sigma2: Array, *c_and_y: Array) -> Array:
    """The size of the gain at which loops cross.

    J, sigma2: inertia [kg m2], viscous friction [N m s/rad]; *c_and_y: the numbers of the controller, (tau_d, tau_i) or
    (kp', ki', kd'), and ln omega, omega in rad/s. Returns ln kappa, kappa in N m/rad.
    """
    *c, y = c_and_y
    w = np.exp(2 * y)
    if len(c) == 3:
        kp, ki, kd = c
        return 2 * y + np.log(J**2 * w + sigma2**2) / 2 - np.log(kp**2 * w + (kd * w - ki) ** 2) / 2
    lead, integral = c
    zeros = np.log(lead**2 * w + 1) + np.log(integral**2 * w + 1)
    return np.log(integral) + 2 * y + np.log(J**2 * w + sigma2**2) / 2 - zeros / 2


def phase_at(J: Array, sigma2: Array, *c_and_omega: Array, lag: float) -> Array:
    """The phase of loops.

    J, sigma2: inertia [kg m2], viscous friction [N m s/rad]; *c_and_omega: the numbers of the controller, (tau_d,
    tau_i) or (kp', ki', kd'), and omega [rad/s]; lag: D [s]. Returns phi [rad].
    """
    *c, omega = c_and_omega
    if len(c) == 3:
        kp, ki, kd = c
        lead = np.arctan2(kd * omega - ki / omega, kp)
        return lead + np.pi / 2 - np.arctan2(J * omega, sigma2) - omega * lag
    lead, integral = c
    return np.arctan(lead * omega) + np.arctan(integral * omega) - np.arctan2(J * omega, sigma2) - omega * lag


def crossovers(J: Array, sigma2: Array, kp: Array, ki: Array, kd: Array, goal: Array) -> Array:
    """All crossovers of loops by gains: bisection between the zeros of the derivative of the cubic, w1 <= w2.

    J, sigma2, kp, ki, kd: (m,) or numbers: inertia [kg m2], viscous friction [N m s/rad], the numbers of the
    controller; goal: (m,) ln kappa. Returns (3, m) ln omega; nan where there are fewer than three.
    """
    a, k2 = J**2, np.exp(2 * goal)
    b, c, d = sigma2**2 - k2 * kd**2, k2 * (2 * kd * ki - kp**2), -k2 * ki**2  # a w^3 + b w^2 + c w + d
    square = b**2 - 3 * a * c
    two = (square > 0) & (b < 0) & (c > 0)
    w2 = np.where(two, -b + np.sqrt(np.where(two, square, 0.0)), 1.0) / (3 * a)
    w1 = np.where(two, c, 1.0) / (3 * a * w2)
    low, high = np.full(goal.size, LOG_OMEGA[0]), np.full(goal.size, LOG_OMEGA[1])
    ends = [low, np.where(two, np.log(w1) / 2, low), np.where(two, np.log(w2) / 2, low), high]

    def cubic(y: Array) -> Array:
        w = np.exp(2 * y)
        return ((a * w + b) * w + c) * w + d

    found = np.full((3, goal.size), np.nan)
    for i, (left, right) in enumerate(itertools.pairwise(ends)):
        some = np.flatnonzero((cubic(left) < 0) != (cubic(right) < 0))
        if not some.size:
            continue
        low, high, up = left.copy(), right.copy(), cubic(left) < 0
        for _ in range(BISECTIONS):
            middle = (low + high) / 2
            below = (cubic(middle) < 0) == up
            low, high = np.where(below, middle, low), np.where(below, high, middle)
        found[i, some] = ((low + high) / 2)[some]
    return found


def crossover_phase(points: Array, lag: float) -> Array:
    """The phase of loops at their crossovers.

    points: (m, 5) or (m, 6): J, sigma2, the numbers of the controller, ln kappa; lag: D [s].
    Returns (m,) phi [rad]; the least one, where there are several crossovers.
    """
    if points.shape[1] == 6:
        found = crossovers(*points.T)
        phi = [phase_at(*points.T[:5], np.exp(y), lag=lag) for y in found]
        return np.asarray(np.nanmin(phi, axis=0))
    J, sigma2, lead, integral, goal = points.T
    low, high = np.full(goal.size, -60.0), np.full(goal.size, 60.0)
    J2, viscous2, lead2, integral2, k2 = J**2, sigma2**2, lead**2, integral**2, np.exp(2 * goal) / integral**2
    for _ in range(48):  # without logarithms: most of the time of a search is spent here
        middle = (low + high) / 2
        w = np.exp(2 * middle)
        below = w * w * (J2 * w + viscous2) < k2 * (lead2 * w + 1) * (integral2 * w + 1)
        low, high = np.where(below, middle, low), np.where(below, high, middle)
    y, h = (low + high) / 2, 1e-5
    slope = (log_kappa(J, sigma2, lead, integral, y + h) - log_kappa(J, sigma2, lead, integral, y - h)) / (2 * h)
    y = y - (log_kappa(J, sigma2, lead, integral, y) - goal) / slope
    return phase_at(J, sigma2, lead, integral, np.exp(y), lag=lag)
