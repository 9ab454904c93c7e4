"""Single shooting with scipy.integrate.solve_ivp as a peer, the way the report did it (section 4.3).

Switch: from breakaway at x1 = -a (m = Fs) slip to x2 = 0, located by solve_ivp's event; the stick has a closed
form; the half cycle closes when the next stick position is +a.  One unknown a, residual P(a) - a.
LuGre: unknowns (x2, x3, x4) in the section x1 = 0 and the half period, residual x(T/2) + x(0) with x1 = 0.
Newton with a finite-difference Jacobian (the monodromy matrix of the report), tolerances passed on to solve_ivp.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import solve_ivp

from casahunt import Servo

Array = np.ndarray
MOST_ITERATIONS = 15


class Failed(Exception):
    """Newton or the integrator did not get there; the message says how."""


@dataclass(frozen=True, eq=False)
class Shot:
    """A converged shooting solution: its unknowns, amplitude max |x1| [rad] and full period [s]."""

    unknowns: Array
    amplitude: float
    period: float


def _gains(servo: Servo, gain: float) -> tuple[float, float, float]:
    return servo.torque_gains(gain)


def _stribeck(servo: Servo, v: float) -> float:
    f = servo.friction
    return f.coulomb + (f.static - f.coulomb) * np.exp(-((v / f.stribeck_velocity) ** 2))


def switch_map(servo: Servo, gain: float, a: float, rtol: float) -> tuple[float, float]:
    """(next stick position, half period) from breakaway at x1 = -a."""
    kp, kd, ki = _gains(servo, gain)
    J, sigma2, Fs = servo.inertia, servo.friction.viscous, servo.friction.static

    def slip(t: float, x: Array) -> list[float]:
        torque = -(kp * x[0] + kd * x[1] + ki * x[2])
        return [x[1], (torque - _stribeck(servo, x[1]) - sigma2 * x[1]) / J, x[0]]

    def stop(t: float, x: Array) -> float:
        return x[1] if t > 1e-6 else 1.0

    stop.terminal, stop.direction = True, -1  # type: ignore[attr-defined]
    start = [-a, 0.0, (kp * a - Fs) / ki]
    done = solve_ivp(slip, (0, 1e4), start, method="DOP853", rtol=rtol, atol=rtol * 1e-3 * a, events=stop)
    if not done.success or not done.t_events[0].size:
        raise Failed("the slip does not end")
    x1, _, x3 = done.y[:, -1]
    if x1 <= 0:
        raise Failed(f"the servo stops at x1 = {x1:.3g} before it has crossed the set point")
    return float(x1), float(done.t[-1] + (Fs - (kp * x1 + ki * x3)) / (ki * x1))


def switch(servo: Servo, gain: float, a: float, rtol: float) -> Shot:
    """Newton on P(a) - a."""
    for _ in range(MOST_ITERATIONS):
        position, half = switch_map(servo, gain, a, rtol)
        step = a * max(np.sqrt(rtol), 1e-7)
        slope = (switch_map(servo, gain, a + step, rtol)[0] - position) / step
        move = (position - a) / (1 - slope)
        if not np.isfinite(move) or abs(move) > 0.5 * a:
            raise Failed(f"Newton wants to move a by {move / a:.2g} of itself")
        a += move
        if abs(move) < 10 * rtol * a:
            return Shot(np.array([a]), a, 2 * half)
    raise Failed(f"Newton did not converge in {MOST_ITERATIONS} iterations")


def lugre(servo: Servo, gain: float, unknowns: Array, rtol: float) -> Shot:
    """Newton on x(T/2) + x(0) from (x2, x3, x4, T/2) at x1 = 0."""
    kp, kd, ki = _gains(servo, gain)
    f, J = servo.friction, servo.inertia

    def field(t: float, x: Array) -> list[float]:
        rate = x[1] - f.stiffness * abs(x[1]) * x[3] / _stribeck(servo, x[1])
        friction = f.stiffness * x[3] + f.damping * rate + f.viscous * x[1]
        return [x[1], (-(kp * x[0] + kd * x[1] + ki * x[2]) - friction) / J, x[0], rate]

    def jacobian(t: float, x: Array) -> list[list[float]]:
        g, s = _stribeck(servo, x[1]), np.sign(x[1])
        fall = -2 * x[1] / f.stribeck_velocity**2 * (g - f.coulomb)
        r2 = 1 - f.stiffness * x[3] * (s / g - abs(x[1]) * fall / g**2)
        r4 = -f.stiffness * abs(x[1]) / g
        row = [-kp / J, (-kd - f.damping * r2 - f.viscous) / J, -ki / J, (-f.stiffness - f.damping * r4) / J]
        return [[0, 1, 0, 0], row, [1, 0, 0, 0], [0, r2, 0, r4]]

    size = np.array([1e-3, abs(unknowns[0]), abs(unknowns[1]), f.static / f.stiffness])

    def shoot(u: Array) -> tuple[Array, float]:
        start = np.array([0.0, u[0], u[1], u[2]])
        done = solve_ivp(field, (0, u[3]), start, method="Radau", jac=jacobian, rtol=rtol, atol=rtol * 1e-2 * size)
        if not done.success:
            raise Failed(f"solve_ivp: {done.message}")
        return (done.y[:, -1] + start) / size, float(np.max(np.abs(done.y[0])))

    u = unknowns.copy()
    scale = np.array([size[1], size[2], size[3], u[3]])
    for _ in range(MOST_ITERATIONS):
        residual, amplitude = shoot(u)
        matrix = np.empty((4, 4))
        for j in range(4):
            step = max(np.sqrt(rtol), 1e-7) * scale[j]
            moved = u.copy()
            moved[j] += step
            matrix[:, j] = (shoot(moved)[0] - residual) / step * scale[j]
        move = -np.linalg.solve(matrix, residual)
        if not np.isfinite(move).all() or np.max(np.abs(move)) > 0.5:
            raise Failed(f"Newton wants to move by {np.max(np.abs(move)):.2g} of the unknowns")
        u = u + move * scale
        if np.max(np.abs(move)) < 100 * rtol:
            return Shot(u, shoot(u)[1], 2 * u[3])
    raise Failed(f"Newton did not converge in {MOST_ITERATIONS} iterations")
