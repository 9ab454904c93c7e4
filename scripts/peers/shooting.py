"""Single shooting with scipy.integrate.solve_ivp as a peer.

The way of the report (section 4.3): the motion is simulated for some swings from a stuck servo, then Newton on
x(T) - x(0) = 0 with the state at a section and the period as unknowns and a finite-difference Jacobian, the
monodromy matrix.  Half a period is shot, x(T/2) + x(0) = 0, which halves the work.

    Switch   section: breakaway (x2 = 0, m = Fs); slip and stick integrated one after the other, with events
    LuGre    section: x1 = 0 in mid-slip; Radau with the analytical Jacobian

`switch_reduced` is what a patient user can make of the Switch servo by hand: the stick in closed form, one unknown
a, the stick position, residual P(a) - a.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import solve_ivp

from casahunt import Servo

Array = np.ndarray
MOST_ITERATIONS = 15
SWINGS = 4
"""Half periods simulated before Newton starts."""


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


def _slip(servo: Servo, gain: float) -> Callable[[float, Array], list[float]]:
    """The Switch servo in a slip with x2 > 0."""
    kp, kd, ki = _gains(servo, gain)
    J, sigma2 = servo.inertia, servo.friction.viscous

    def slip(t: float, x: Array) -> list[float]:
        torque = -(kp * x[0] + kd * x[1] + ki * x[2])
        return [x[1], (torque - _stribeck(servo, x[1]) - sigma2 * x[1]) / J, x[0]]

    return slip


def _stick(t: float, x: Array) -> list[float]:
    return [0.0, 0.0, x[0]]


def _stop(t: float, x: Array) -> float:
    return x[1] if t > 1e-6 else 1.0


_stop.terminal, _stop.direction = True, -1  # type: ignore[attr-defined]


def switch_map(servo: Servo, gain: float, a: float, rtol: float) -> tuple[float, float]:
    """(next stick position, half period) from breakaway at x1 = -a."""
    kp, _, ki = _gains(servo, gain)
    Fs = servo.friction.static
    start = [-a, 0.0, (kp * a - Fs) / ki]
    slip = _slip(servo, gain)
    done = solve_ivp(slip, (0, 1e4), start, method="DOP853", rtol=rtol, atol=rtol * 1e-3 * a, events=_stop)
    if not done.success or not done.t_events[0].size:
        raise Failed("the slip does not end")
    x1, _, x3 = done.y[:, -1]
    if x1 <= 0:
        raise Failed(f"the servo stops at x1 = {x1:.3g} before it has crossed the set point")
    return float(x1), float(done.t[-1] + (Fs - (kp * x1 + ki * x3)) / (ki * x1))


def switch_reduced(servo: Servo, gain: float, a: float, rtol: float) -> Shot:
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


def _half_of(servo: Servo, gain: float) -> Callable[[float, float, float], tuple[Array, float]]:
    """(x1, x3, tolerance) of a breakaway with positive torque -> (state at the next breakaway, time)."""
    kp, _, ki = _gains(servo, gain)
    f, slip = servo.friction, _slip(servo, gain)

    def breakaway(t: float, x: Array) -> float:
        return f.static - abs(kp * x[0] + ki * x[2]) if t > 1e-6 else 1.0

    breakaway.terminal, breakaway.direction = True, -1  # type: ignore[attr-defined]

    def half(x1: float, x3: float, tolerance: float) -> tuple[Array, float]:
        atol = tolerance * 1e-3 * np.array([abs(x1), abs(x1), f.static / ki])
        how = {"method": "DOP853", "rtol": tolerance, "atol": atol}
        one = solve_ivp(slip, (0, 1e4), [x1, 0.0, x3], events=_stop, **how)
        if not one.t_events[0].size:
            raise Failed("the slip does not end")
        two = solve_ivp(_stick, (0, 1e5), [one.y[0, -1], 0.0, one.y[2, -1]], events=breakaway, **how)
        if not two.t_events[0].size:
            raise Failed("the servo comes to rest")
        if two.y[0, -1] * x1 > 0:
            raise Failed("the servo stops before it has crossed the set point")
        return two.y[:, -1], float(one.t[-1] + two.t[-1])

    return half


def _switch_simulated(servo: Servo, gain: float) -> Array:
    """(x1, x3, T/2) after some swings from a stuck servo."""
    kp, _, ki = _gains(servo, gain)
    half = _half_of(servo, gain)
    a = 0.1 * servo.friction.static / kp
    x1, x3, sign, time = -a, (kp * a - servo.friction.static) / ki, 1.0, 0.0
    for _ in range(SWINGS):
        end, time = half(sign * x1, sign * x3, 1e-6)
        x1, x3, sign = sign * end[0], sign * end[2], -sign
    return np.array([sign * x1, sign * x3, time])


def _bounded(move: Array) -> Array:
    """A Newton step in units of the unknowns, or Failed where it leads too far."""
    if not np.isfinite(move).all() or np.max(np.abs(move)) > 0.5:
        raise Failed(f"Newton wants to move by {np.max(np.abs(move)):.2g} of the unknowns")
    return move


def switch(servo: Servo, gain: float, unknowns: Array | None, rtol: float) -> Shot:
    """Newton on (x1, x3, T/2) at breakaway; `unknowns` None starts from a simulation."""
    kp, _, ki = _gains(servo, gain)
    Fs, half = servo.friction.static, _half_of(servo, gain)
    # On the section m = Fs the two unknowns are tied: x1 alone is free.
    u = _switch_simulated(servo, gain) if unknowns is None else unknowns.copy()
    for _ in range(MOST_ITERATIONS):
        start = np.array([u[0], 0.0, (-Fs - kp * u[0]) / ki])
        end, time = half(start[0], start[2], rtol)
        residual = np.array([end[0] + start[0], end[2] + start[2]]) / np.abs(start[[0, 2]])
        columns = []
        for j in (0, 2):
            moved = start.copy()
            step = max(np.sqrt(rtol), 1e-7) * abs(start[j])
            moved[j] += step
            other, _ = half(moved[0], moved[2], rtol)
            change = np.array([other[0] + moved[0], other[2] + moved[2]]) / np.abs(start[[0, 2]]) - residual
            columns.append(change / step * abs(start[j]))
        move = _bounded(-np.linalg.lstsq(np.array(columns).T, residual, rcond=1e-6)[0])
        u[0] += move[0] * abs(start[0])
        if abs(move[0]) < 100 * rtol:
            end, time = half(u[0], (-Fs - kp * u[0]) / ki, rtol)
            return Shot(np.array([u[0], 0.0, time]), abs(u[0]), 2 * time)
    raise Failed(f"Newton did not converge in {MOST_ITERATIONS} iterations")


def _lugre_field(servo: Servo, gain: float) -> tuple[Callable[..., Any], Callable[..., Any]]:
    """(x', its Jacobian) of the LuGre servo as functions of t and x."""
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

    return field, jacobian


def _lugre_simulated(servo: Servo, gain: float) -> Array:
    """(x2, x3, x4, T/2) at x1 = 0 after some swings from a stuck servo."""
    kp, _, ki = _gains(servo, gain)
    f, (field, jacobian) = servo.friction, _lugre_field(servo, gain)

    def centre(t: float, x: Array) -> float:
        return x[0] if t > 1e-6 else -1.0

    a = 0.1 * f.static / kp
    x, time = np.array([-a, 0.0, (kp * a - f.static) / ki, 0.999 * f.static / f.stiffness]), 0.0
    for k in range(SWINGS):
        centre.terminal, centre.direction = True, 1 if k % 2 == 0 else -1  # type: ignore[attr-defined]
        atol = 1e-8 * np.array([a, 1.0, f.static / ki, f.static / f.stiffness])
        done = solve_ivp(field, (0, 1e5), x, method="Radau", jac=jacobian, rtol=1e-6, atol=atol, events=centre)
        if not done.t_events[0].size:
            raise Failed("the servo comes to rest")
        x, time = done.y[:, -1], float(done.t[-1])
    sign = 1.0 if x[1] > 0 else -1.0
    return np.array([sign * x[1], sign * x[2], sign * x[3], time])


def lugre(servo: Servo, gain: float, unknowns: Array | None, rtol: float) -> Shot:
    """Newton on x(T/2) + x(0) from (x2, x3, x4, T/2) at x1 = 0; `unknowns` None starts from a simulation."""
    f, (field, jacobian) = servo.friction, _lugre_field(servo, gain)
    u = _lugre_simulated(servo, gain) if unknowns is None else unknowns.copy()
    size = np.array([1e-3, abs(u[0]), abs(u[1]), f.static / f.stiffness])

    def shoot(u: Array) -> tuple[Array, float]:
        start = np.array([0.0, u[0], u[1], u[2]])
        done = solve_ivp(field, (0, u[3]), start, method="Radau", jac=jacobian, rtol=rtol, atol=rtol * 1e-2 * size)
        if not done.success:
            raise Failed(f"solve_ivp: {done.message}")
        return (done.y[:, -1] + start) / size, float(np.max(np.abs(done.y[0])))

    scale = np.array([size[1], size[2], size[3], u[3]])
    for _ in range(MOST_ITERATIONS):
        residual, _ = shoot(u)
        matrix = np.empty((4, 4))
        for j in range(4):
            step = max(np.sqrt(rtol), 1e-7) * scale[j]
            moved = u.copy()
            moved[j] += step
            matrix[:, j] = (shoot(moved)[0] - residual) / step * scale[j]
        move = _bounded(-np.linalg.solve(matrix, residual))
        u = u + move * scale
        if np.max(np.abs(move)) < 100 * rtol:
            return Shot(u, shoot(u)[1], 2 * u[3])
    raise Failed(f"Newton did not converge in {MOST_ITERATIONS} iterations")
