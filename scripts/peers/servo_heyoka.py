"""The hunting servo by Taylor series (heyoka, extra `bench`), reduced by hand as its patient user would, in doubles.

Switch   half a cycle is a slip that one integrator follows to x2 = 0, and a stick in closed form: P(a) is where it
         sticks that has broken away at x1 = -a; P' comes from the variational equations.
           cycle           secants on P(a) = a, after `SWINGS` swings from a stuck servo
           unstable cycle  the same in a bracket that grows around a neighbour's a: P' is 1e5 there
           fold            Newton on P(a) = a, P'(a) = 1 in (a, K), its Jacobian by differences, from near by
LuGre    y = (x2, x3, z) at x1 = 0 in mid-slip to the next x1 = 0, with x2 = 0 as the event at which |x2| takes its
         other branch; the cycle is y = -Phi(y), by Newton with differences, after `SWINGS` swings from a stuck servo.

Integrators are compiled once for all servos and gains: the numbers of the servo are heyoka's run-time parameters.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable

import heyoka as hy
import numpy as np

from casahunt import Servo

from .shooting import Failed, Shot

Array = np.ndarray
SWINGS = 4
"""Half cycles that are followed before Newton starts."""
STARTS = tuple(0.1 * 0.85**k for k in range(8))
"""Positions, in units of Fs/kp, at which the stuck servo is let go, until a motion from one goes on."""
ROUNDING, ROUNDED = 4e-16, 1e-12
"""Relative error of a position, and a residual that is rounding where it shrinks no more."""
FAR = 6.1
"""Velocity in units of vs from which exp(-(x2/vs)^2) is nothing: a Taylor series from there would not see it come."""
MOST_STEPS, MOST_REVERSALS = 40, 400
AT_REST = 0.1
"""A swing below this part of the first position is none."""
BLIND = 1e-6
"""A slip begins so long [s] without an eye on x2 = 0, where it begins."""
LONG, REST = 1e4, 60.0
"""Seconds in which a slip or half a cycle ends; of a stable cycle, whose servo has come to rest else."""
DIFFERENCE, NUDGE = 1e-7, 1e-9
WIDEN, WIDEST = 1e-4, 0.3
"""The bracket of an unstable cycle, relative to its neighbour: at first, and at most."""
KEEPS = 0.1
"""A Jacobian is kept while the residual falls to this part of itself."""


def _parameters(servo: Servo, gain: float) -> list[float]:
    f = servo.friction
    return [
        servo.inertia, *servo.torque_gains(gain), f.static, f.coulomb, f.stribeck_velocity, f.viscous, f.stiffness,
        f.damping,
    ]  # fmt: skip


class SwitchTaylor:
    """P(a) and P'(a) of Switch servos.

    Parameters
    ----------
    tol
        of the integrators.

    Attributes
    ----------
    compiling : seconds that building them took.
    """

    def __init__(self, tol: float) -> None:
        began = time.perf_counter()
        self.tol = tol
        x1, x2, x3, d1, d2, d3 = hy.make_vars("x1", "x2", "x3", "d1", "d2", "d3")
        J, kp, kd, ki, Fs, Fc, vs, s2 = (hy.par[i] for i in range(8))
        w = x2 / vs
        drop = (Fs - Fc) * hy.exp(-w * w)
        motion = [(x1, x2), (x2, (-(kp * x1 + kd * x2 + ki * x3) - Fc - drop - s2 * x2) / J), (x3, x1)]
        change = -(kp * d1 + kd * d2 + ki * d3) + (2 * drop * w / vs - s2) * d2
        varied = [*motion, (d1, d2), (d2, change / J), (d3, d1)]
        falling, rising = hy.event_direction.negative, hy.event_direction.positive
        self._pieces = {}
        for slopes, system in ((False, motion), (True, varied)):
            state = [0.0] * len(system)
            far = [(v, hy.subs(rate, {drop: hy.expression(0.0)})) for v, rate in system]
            self._pieces[slopes] = (
                hy.taylor_adaptive(system, state, tol=tol),
                hy.taylor_adaptive(
                    system, state, tol=tol,
                    t_events=[hy.t_event(x2, direction=falling), hy.t_event(x2 - FAR * vs, direction=rising)],
                ),
                hy.taylor_adaptive(far, state, tol=tol, t_events=[hy.t_event(x2 - FAR * vs, direction=falling)]),
            )  # fmt: skip
        self.compiling = time.perf_counter() - began

    def half(self, p: list[float], a: float, slope: bool = False, longest: float = LONG) -> tuple[float, float, float]:
        """(next stick position, half period, P' or nan) from breakaway at x1 = -a."""
        _, kp, kd, ki, Fs = p[:5]
        now, state = 0.0, [-a, 0.0, (kp * a - Fs) / ki] + [-1.0, 0.0, kp / ki] * slope
        blind, near, far = self._pieces[slope]
        for piece, until in ((blind, BLIND), (near, longest), (far, longest), (near, longest)):
            piece.time, piece.state[:], piece.pars[:] = now, state, p[: len(piece.pars)]
            if piece is not blind:
                piece.reset_cooldowns()
            outcome = int(piece.propagate_until(until)[0])
            now, state = piece.time, piece.state
            if piece is near and outcome == -1:
                break
        x1, _, x3 = state[:3]
        m = -(kp * x1 + ki * x3)
        if outcome != -1 or x1 <= 0 or abs(m) > Fs:
            raise Failed("the slip does not end in a stick beyond the set point")
        # x1' = 0 at the stop: when it comes changes nothing of where it is.
        return float(x1), float(now + (m + Fs) / (ki * x1)), float(state[3]) if slope else math.nan

    def _settled(self, p: list[float]) -> tuple[float, float]:
        """The last two stick positions of the first motion from a stuck servo that goes on."""
        for start in STARTS:
            a = start * p[4] / p[1]
            try:
                for _ in range(SWINGS):
                    before = a
                    a, half, _ = self.half(p, a, longest=REST)
                    if half > REST:
                        raise Failed("the servo comes to rest")
                return before, a
            except Failed:
                continue
        raise Failed("the servo comes to rest from everywhere")

    def cycle(self, servo: Servo, gain: float) -> Shot:
        """The stable cycle, from a stuck servo."""
        p = _parameters(servo, gain)
        old, a = self._settled(p)
        old_residual = a - old
        for _ in range(MOST_STEPS):
            position, half, _ = self.half(p, a)
            residual = position - a
            rounded = abs(residual) < ROUNDED * a and 2 * abs(residual) >= abs(old_residual)
            if abs(residual) <= self._small(a) or rounded:
                return Shot(np.array([a]), a, 2 * half)
            step = residual * (a - old) / (residual - old_residual)
            old, old_residual, a = a, residual, a - step
        raise Failed(f"no cycle after {MOST_STEPS} secants")

    def _small(self, a: float) -> float:
        return max(self.tol, ROUNDING) * a

    def unstable_cycle(self, servo: Servo, gain: float, near: float) -> Shot:
        """The cycle that motions leave, by Newton in a bracket around the stick position of a neighbour."""
        p = _parameters(servo, gain)

        def excess(a: float) -> float:
            try:
                return self.half(p, a)[0] - a
            except Failed:
                return math.nan

        width, low, high = WIDEN, near, near
        while excess(low) * excess(high) >= 0 or math.isnan(excess(low) * excess(high)):
            width *= 3
            if width > WIDEST:
                raise Failed(f"no sign changes within {WIDEST:g} of the neighbour")
            low, high = near * (1 - width), near * (1 + width)
        rising = excess(high) > 0
        a = (low + high) / 2
        for _ in range(3 * MOST_STEPS):
            position, half, slope = self.half(p, a, slope=True)
            residual = position - a
            low, high = (low, a) if (residual > 0) == rising else (a, high)
            move = residual / (1 - slope)
            if abs(move) <= self._small(a) or high - low <= 2 * ROUNDING * a:
                # The rounding of a is P' times as large in P, and in the time.
                other, longer, _ = self.half(p, a * (1 + NUDGE))
                half -= residual * (longer - half) / (other - position - NUDGE * a)
                return Shot(np.array([a + move]), a + move, 2 * half)
            a = a + move if low < a + move < high else (low + high) / 2
        raise Failed("Newton did not converge in its bracket")

    def fold(self, servo: Servo, gain: float, a: float) -> tuple[float, Shot]:
        """(gain, cycle) of the fold next to a guess."""

        def conditions(u: Array) -> tuple[Array, float]:
            position, half, slope = self.half(_parameters(servo, float(u[0])), float(u[1]), slope=True)
            return np.array([position / u[1] - 1, slope - 1]), half

        u, last, matrix = np.array([gain, a]), math.inf, None
        for _ in range(MOST_STEPS):
            f, half = conditions(u)
            size = float(np.max(np.abs(f)))
            if matrix is None or size > KEEPS * last:
                matrix = _differences(lambda v: conditions(v)[0], u, f, u)
            move = -u * np.linalg.solve(matrix, f)
            u = u + move
            # K is largest at the fold: an error of a enters by its square.
            if abs(move[0]) <= self._small(u[0]) and abs(move[1]) < 1e-8 * u[1]:
                return float(u[0]), Shot(u, float(u[1]), 2 * half)
            last = size
        raise Failed(f"no fold after {MOST_STEPS} steps")


def _differences(function: Callable[[Array], Array], u: Array, f: Array, scale: Array) -> Array:
    """The Jacobian for relative changes of u, by forward differences."""
    matrix = np.empty((f.size, u.size))
    for j in range(u.size):
        moved = u.copy()
        moved[j] += DIFFERENCE * scale[j]
        matrix[:, j] = (function(moved) - f) / DIFFERENCE
    return matrix


class LugreTaylor:
    """Phi(y) of LuGre servos.

    Parameters
    ----------
    tol
        of the integrators.

    Attributes
    ----------
    compiling : seconds that building them took.
    """

    def __init__(self, tol: float) -> None:
        began = time.perf_counter()
        self.tol = tol
        x1, x2, x3, z = hy.make_vars("x1", "x2", "x3", "z")
        J, kp, kd, ki, Fs, Fc, vs, s2, s0, s1, s = (hy.par[i] for i in range(11))
        g = Fc + (Fs - Fc) * hy.exp(-(x2 / vs) * (x2 / vs))
        rate = x2 - s0 * s * x2 * z / g
        m = -(kp * x1 + kd * x2 + ki * x3)
        system = [(x1, x2), (x2, (m - (s0 * z + s1 * rate + s2 * x2)) / J), (x3, x1), (z, rate)]
        self._blind = hy.taylor_adaptive(system, [0.0] * 4, tol=tol)
        self._seeing = hy.taylor_adaptive(system, [0.0] * 4, tol=tol, t_events=[hy.t_event(x2), hy.t_event(x1)])
        self.compiling = time.perf_counter() - began

    def half(
        self, p: list[float], x: Array, s: float, *, blind: bool = True, longest: float = LONG
    ) -> tuple[Array, float, float]:
        """(state at the next x1 = 0, time that it takes, largest |x1|) from a state that moves with sign s."""
        seeing, now, largest = self._seeing, 0.0, abs(x[0])
        if blind:
            self._blind.time, self._blind.state[:], self._blind.pars[:] = 0.0, x, [*p, s]
            self._blind.step()
            x, now = self._blind.state, self._blind.time
        seeing.reset_cooldowns()
        seeing.time, seeing.state[:], seeing.pars[:] = now, x, [*p, s]
        for _ in range(MOST_REVERSALS):
            outcome = int(seeing.propagate_until(longest)[0])
            if outcome == -2:
                return seeing.state.copy(), seeing.time, largest
            if outcome != -1:
                raise Failed(f"the servo does not come back: {outcome}")
            x1, _, x3, z = seeing.state
            largest = max(largest, abs(x1))
            seeing.state[1] = 0.0
            seeing.pars[10] = 1.0 if -(p[1] * x1 + p[3] * x3) > p[8] * z else -1.0
        raise Failed(f"no x1 = 0 after {MOST_REVERSALS} reversals")

    def _settled(self, p: list[float]) -> Array:
        """y after some swings of the first motion from a stuck servo that goes on."""
        kp, ki, Fs, s0 = p[1], p[3], p[4], p[8]
        for start in STARTS:
            a = start * Fs / kp
            x = np.array([-a, 0.0, (kp * a - Fs) / ki, 0.999 * Fs / s0])
            try:
                x, _, _ = self.half(p, x, 1.0, blind=False, longest=REST)
                for _ in range(SWINGS):
                    x, _, largest = self.half(p, x, 1.0 if x[1] > 0 else -1.0, longest=REST)
                    if largest < AT_REST * a:
                        raise Failed("the servo is at rest")
            except Failed:
                continue
            return -x[1:] if x[1] < 0 else x[1:]
        raise Failed("the servo comes to rest from everywhere")

    def cycle(self, servo: Servo, gain: float) -> Shot:
        """The stable cycle, from a stuck servo."""
        p = _parameters(servo, gain)
        y = self._settled(p)
        scale, last, matrix = np.abs(y), math.inf, None
        for _ in range(MOST_STEPS):
            f, half, largest = self._closure(p, y, scale)
            size = float(np.max(np.abs(f)))
            if size <= max(10 * self.tol, 1e-14) or (size < ROUNDED and size > last / 2):
                return Shot(np.append(y, half), largest, 2 * half)
            if matrix is None or size > KEEPS * last:
                matrix = _differences(lambda v: self._closure(p, v, scale)[0], y, f, scale)
            y = y - scale * np.linalg.solve(matrix, f)
            last = size
        raise Failed(f"no cycle after {MOST_STEPS} steps")

    def _closure(self, p: list[float], y: Array, scale: Array) -> tuple[Array, float, float]:
        end, half, largest = self.half(p, np.array([0.0, *y]), 1.0)
        return (end[1:] + y) / scale, half, largest
