"""Independent truth: the stick map of a servo with a remedy, by scipy's DOP853 with events.

A servo that breaks away forward at x1 = -a with m = Fs stops at x1 = P(a): until it breaks away back only x3 changes,
and |m| = Fs there tells x3.  Cycles are P(a) = a; the border of hunting is the size at which the largest P(a) - a is
zero.
"""

import numpy as np
import pytest

scipy_integrate = pytest.importorskip("scipy.integrate")
scipy_optimize = pytest.importorskip("scipy.optimize")

TABLE_1 = {"J": 0.026, "Fs": 0.53, "Fc": 0.44, "vs": 0.02, "b": 0.1}
RTOL = 1e-12


def torque_gains(K):
    """(kp, kd, ki) of Table 1's controller, lead and integral time 1/(2 pi) s, motor gain 16 N m/V."""
    return 2 * 16 * K, 16 * K / (2 * np.pi), 2 * np.pi * 16 * K


def pieces(remedy, size, a):
    """[(x1 at the end of the piece or None for the stop, integrand(x1), factor of x3 behind it)] for a slip from -a."""
    one = 1.0
    if remedy == "dead band":
        return [(-size, lambda x: x, one), (size, lambda x: 0.0, one), (None, lambda x: x, one)]
    if remedy == "shifted dead band":
        return [(-size, lambda x: x + size, one), (size, lambda x: 0.0, one), (None, lambda x: x - size, one)]
    if remedy == "hysteresis":
        return [(-size / 2, lambda x: x, one), (size, lambda x: 0.0, one), (None, lambda x: x, one)]
    if remedy == "reset":
        return [(0.0, lambda x: x, size), (None, lambda x: x, one)]
    return [(None, lambda x: x, one)]


def stick_map(a, K, remedy, size, servo=TABLE_1, leak=0.0):
    """P(a), with a leak besides; nan where the servo does not get as far as that, or does not stick there."""
    kp, kd, ki = torque_gains(K)
    leak = size if remedy == "leak" else leak
    J, Fs, Fc, vs, b = (servo[name] for name in ("J", "Fs", "Fc", "vs", "b"))
    y = np.array([-a, 0.0, (kp * a - Fs) / ki])
    for end, integrand, factor in pieces(remedy, size, a):
        if end is not None and y[0] >= end:
            continue

        def field(t, y, integrand=integrand):
            m = -(kp * y[0] + kd * y[1] + ki * y[2])
            F = Fc + (Fs - Fc) * np.exp(-((y[1] / vs) ** 2)) + b * y[1]
            return [y[1], (m - F) / J, integrand(y[0]) - leak * y[2]]

        def stops(t, y):
            return y[1] if t > 0 else 1.0

        def reaches(t, y, end=end):
            return y[0] - (end if end is not None else np.inf)

        stops.terminal, stops.direction, reaches.terminal, reaches.direction = True, -1, True, 1
        events = [stops] if end is None else [stops, reaches]
        run = scipy_integrate.solve_ivp(field, (0, 1e3), y, "DOP853", events=events, rtol=RTOL, atol=1e-14)
        y = run.y[:, -1]
        if run.t_events[0].size:
            break
        y = y * [1, 1, factor]
    return y[0] if abs(kp * y[0] + ki * y[2]) <= Fs else np.nan


def surplus(K, remedy, size, low, high, servo=TABLE_1):
    """max of P(a) - a over low <= a <= high."""
    best = scipy_optimize.minimize_scalar(
        lambda a: a - stick_map(a, K, remedy, size, servo), bounds=(low, high), method="bounded",
        options={"xatol": 1e-7 * high},
    )  # fmt: skip
    return -best.fun


def border(K, remedy, near, low, high, servo=TABLE_1):
    """The size next to `near` at which the last cycle with low <= a <= high ends."""
    return scipy_optimize.brentq(
        lambda size: surplus(K, remedy, size, low, high, servo), near * 0.998, near * 1.002, xtol=1e-10 * near
    )
