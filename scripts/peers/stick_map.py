"""The stick map of many Switch servos at once, by Taylor series with events in doubles (heyoka, extra `bench`).

    P(a): the next stick position from breakaway at x1 = -a;    max P(a)/a < 1: no cycle with sticking

A servo is a row of eight numbers, `FIELDS`.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any

import numpy as np

from casahunt.servo.servo import Servo

Array = np.ndarray

POINTS = 30
"""Stick positions of the first grid."""
MOST_SLIPS, MOST_STEPS, CHUNK = 40, 20_000, 50
"""Most slips of a motion, most steps of a slip, and how many are made between two looks at where it is."""
FAR = 7.0
"""Speed in vs from which exp(-(v/vs)^2) is below the last digit."""
AT_REST = 1e-4
"""A slip this near to the set point, at a torque this near to static friction, has no swing left: in parts of a, of
kp a, and of the least of vs and a sqrt(kp/J)."""
FARTHER, THROWN_OUT = 30.0, 1e3
"""A motion is thrown out that reverses this many a away without a stick, or slips this many in one go."""
TIMES = ("controller.lead_time", "controller.integral_time")
FIELDS = (
    "servo.inertia", "servo.motor_gain", *TIMES, "friction.static", "friction.coulomb", "friction.stribeck_velocity",
    "friction.viscous",
)  # fmt: skip


@lru_cache(maxsize=1)
def _slips() -> tuple[Any, Any]:
    """Integrators of a slip: without an eye on the speed, and one that ends at v = 0.

    With u from where the slip begins, in units of a, time in sqrt(J/kp), torques in kp a (names as in the servo's
    equations, so scaled), and m0 the torque beyond static friction at the beginning:

        u' = v,   v' = m0 - u - kd v - ki w + (Fs - Fc)(1 - exp(-(v/vs)^2)) - s2 v,   w' = u + x0.
    """
    import heyoka as hy

    u, v, w = hy.make_vars("u", "v", "w")
    kd, ki, drop, vs, s2, m0, x0 = (hy.par[i] for i in range(7))
    system = [
        (u, v), (v, m0 - (u + kd * v + ki * w) + drop * (1.0 - hy.exp(-(v / vs) * (v / vs))) - s2 * v), (w, u + x0),
    ]  # fmt: skip
    down = hy.event_direction.negative
    # From far above vs a step would not see the drop: it begins anew where the exponential can be seen.
    events = [hy.t_event(v, direction=down), hy.t_event(v - FAR * vs, direction=down, callback=lambda *_: True)]
    first, ta = (
        hy.taylor_adaptive(system, state=[0.0] * 3, pars=[1.0] * 7, tol=1e-15, t_events=seen) for seen in ([], events)
    )
    return first, ta


def stick_ratio(row: Array, gain: float, a: float) -> float:
    """P(a)/a of one servo: from breakaway at x1 = -a to the next stick.

    inf where it is thrown out; 0 where it comes to rest at the set point without a stop; nan where it was not followed
    to its end.
    """
    first, ta = _slips()
    J, cm, lead, integral, Fs, Fc, vs, s2 = row
    kp, kd, ki = gain * cm * (1 + lead / integral), gain * cm * lead, gain * cm / integral
    unit = math.sqrt(J / kp)
    kd, ki, s2, vs = kd * unit / J, ki * unit / kp, s2 * unit / J, vs * unit / a
    drop, Fs = (Fs - Fc) / (kp * a), Fs / (kp * a)
    x0, m0 = -1.0, 0.0
    for _ in range(MOST_SLIPS):
        for flow in (first, ta):
            flow.pars[:] = kd, ki, drop, vs, s2, m0, x0
        first.time, first.state[:] = 0.0, 0.0
        first.step(1e-2 / (1 + kd + s2 + ki))  # v = 0 at the start is no stop
        ta.time, ta.state[:] = 0.0, first.state
        ta.reset_cooldowns()
        if not ta.state[1] > 0:
            return math.nan
        for _ in range(MOST_STEPS // CHUNK):
            stopped = int(ta.propagate_until(1e300, max_steps=CHUNK)[0]) == -1
            u, v, w = ta.state
            m = m0 - (u + ki * w)
            if stopped:
                break
            if abs(x0 + u) < AT_REST and abs(v) < AT_REST * min(1, vs) and abs(m) < AT_REST:
                return 0.0
            if not abs(u) < THROWN_OUT:
                return math.inf
        else:
            return math.nan
        x0, m = x0 + u, m + Fs
        if m >= -Fs:  # at a stop more than Fs is rounding: the speed has fallen to nothing
            return abs(x0)
        if abs(x0) > FARTHER:
            return math.inf
        x0, m0 = -x0, -m - Fs
    return math.inf


def event_map(rows: Array, gain: Array | float, a: Array) -> Array:
    """P(a)/a (m,) of many servos (m, 8)."""
    gains = np.broadcast_to(np.asarray(gain, float), a.shape)
    return np.array([stick_ratio(*task) for task in zip(rows, gains.tolist(), a.tolist(), strict=True)])


def stick_positions(rows: Array, gain: float) -> Array:
    """(m, POINTS) stick positions at which the map is looked at, in view of Fs/kp."""
    kp = gain * rows[:, 1] * (1 + rows[:, 2] / rows[:, 3])
    return np.geomspace(3e-4, 10.0, POINTS) * (rows[:, 4] / kp)[:, None]


def largest_ratio(rows: Array, gain: float, *, rounds: int = 5) -> Array:
    """(m,) max over a of |P(a)|/a: below one no cycle with sticking exists; nan where a motion was not followed."""
    m = len(rows)
    grid = stick_positions(rows, gain)
    best = np.zeros(m)
    for k in range(rounds):
        n = grid.shape[1]
        values = event_map(np.repeat(rows, n, axis=0), gain, grid.ravel()).reshape(m, n)
        i = np.argmax(values, axis=1)  # the first nan, if there is one
        best = np.maximum(best, values[np.arange(m), i])
        if k < rounds - 1:
            low, high = grid[np.arange(m), np.maximum(i - 1, 0)], grid[np.arange(m), np.minimum(i + 1, n - 1)]
            grid = np.geomspace(low, high, 9).T
    return best


class Hunts:
    """Whether a servo of a set may hunt at a gain: one |P(a)| >= a will do, looked for first where the last one was."""

    def __init__(self) -> None:
        self.servo, self.point = 0, POINTS // 2

    def __call__(self, rows: Array, gain: float) -> bool:
        self.servo = min(self.servo, len(rows) - 1)
        grid = stick_positions(rows, gain)
        for i in np.argsort(np.arange(len(rows)) != self.servo, kind="stable"):
            for j in np.argsort(np.abs(np.arange(POINTS) - self.point), kind="stable"):
                if not stick_ratio(rows[i], gain, float(grid[i, j])) < 1:
                    self.servo, self.point = int(i), int(j)
                    return True
        return not (largest_ratio(rows, gain) < 1).all()


def row_of(servo: Servo) -> Array:
    f, c = servo.friction, servo.controller
    return np.array([servo.inertia, servo.motor_gain, c.lead_time, c.integral_time, f.static, f.coulomb,
                     f.stribeck_velocity, f.viscous])  # fmt: skip
