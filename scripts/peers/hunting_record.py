"""Records of a hunting servo by integrators of scipy and SUNDIALS, none of the engine: positions, noise, counts.

    slip    J x2' = -(kp x1 + kd x2 + ki x3) - F(x2)    DOP853, until x2 = 0
    stick   x1 constant, x3 linear, until the torque of the motor reaches static friction
    LuGre   z' = x2 - sigma0 |x2| z/g(x2),  F = sigma0 z + sigma1 z' + viscous x2;  LSODA
            x3' = x1 beyond a dead band, less leak x3, where it has a remedy;  CVODES, since LSODA fails at rest, where
            Radau of scipy takes 10,000 times as long
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from casahunt import Servo

Array = np.ndarray
TOLERANCES = {"rtol": 1e-9, "atol": 1e-13}
LUGRE_TOLERANCES = {"reltol": 1e-8, "abstol": 1e-9, "max_num_steps": 10**7}
"""Of states in units of the start and of the bristles' bend."""
HELD = 0.9
"""Part of the static friction that a LuGre servo holds at the start."""


def positions(
    servo: Servo, model: str, gain: float, start: float, times: Array, state: Array | None = None
) -> Array:
    """(m,) positions x1 [rad] at increasing times from 0, of a servo that is stuck at -start when they begin.

    state: of the LuGre servo at the start instead, where its transients last too long.
    """
    return motion(servo, model, gain, start, times, state)[0]


def remedied(
    servo: Servo, gain: float, start: float, times: Array, *, leak: float = 0.0, band: float = 0.0
) -> Array:
    """(m,) positions x1 [rad] of a LuGre servo with a leak [1/s] of its integrator, or a dead band [rad]."""
    kp, kd, ki = servo.torque_gains(gain)
    f, m = servo.friction, HELD * servo.friction.static
    sizes = ca.DM([start, start, start, f.static / f.stiffness])
    scaled = ca.SX.sym("y", 4)
    x, v, x3, z = ca.vertsplit(sizes * scaled)
    g = f.coulomb + (f.static - f.coulomb) * ca.exp(-((v / f.stribeck_velocity) ** 2))
    dz = v - f.stiffness * ca.fabs(v) * z / g
    friction = f.stiffness * z + f.damping * dz + f.viscous * v
    wound = ca.if_else(ca.fabs(x) > band, x, 0) - leak * x3
    rates = ca.vertcat(v, (-(kp * x + kd * v + ki * x3) - friction) / servo.inertia, wound, dz) / sizes
    way = ca.integrator("way", "cvodes", {"x": scaled, "ode": rates}, 0.0, list(map(float, times)), LUGRE_TOLERANCES)
    first = ca.vertcat(-start, 0.0, -(m - kp * start) / ki, m / f.stiffness) / sizes
    return start * np.array(way(x0=first)["xf"])[0]


def motion(
    servo: Servo, model: str, gain: float, start: float, times: Array, state: Array | None = None
) -> Array:
    """(2, m) positions x1 [rad] and torques of the motor [N m] in the same way."""
    return _switch(servo, gain, start, times) if model == "switch" else _lugre(servo, gain, start, times, state)


def measured(x: Array, noise: float, counts: float, level: float, rng: np.random.Generator) -> Array:
    """Positions about a level with normal noise [rad], rounded to the counts of a revolution (0: not)."""
    y = x + level + noise * rng.standard_normal(x.size)
    if not counts:
        return y
    q = 2 * math.pi / counts
    return q * np.round(y / q)


def _switch(servo: Servo, gain: float, start: float, times: Array) -> Array:
    kp, kd, ki = servo.torque_gains(gain)
    f, J = servo.friction, servo.inertia
    t, x, x3, out = 0.0, -start, 0.0, np.empty((2, times.size))
    while t < times[-1]:
        m = -(kp * x + ki * x3)
        side = math.copysign(1.0, m)
        if abs(m) <= f.static:
            side = -math.copysign(1.0, x)
            wait = (side * f.static - m) / (-ki * x)
            stuck = (times >= t) & (times < t + wait + 1e-15)
            out[0, stuck] = x
            out[1, stuck] = -(kp * x + ki * (x3 + x * (times[stuck] - t)))
            t, x3 = t + wait, x3 + x * wait

        def rate(_: float, y: Array, s: float = side) -> list[float]:
            v = y[1]
            friction = s * (f.coulomb + (f.static - f.coulomb) * math.exp(-((v / f.stribeck_velocity) ** 2)))
            return [v, (-(kp * y[0] + kd * v + ki * y[2]) - friction - f.viscous * v) / J, y[0]]

        def stop(_: float, y: Array, s: float = side) -> float:
            return s * y[1]

        stop.terminal, stop.direction = True, -1  # type: ignore[attr-defined]
        slip = solve_ivp(
            rate, (t, t + 1e4), [x, side * 1e-10, x3], events=stop, dense_output=True, method="DOP853", **TOLERANCES
        )
        inside = (times >= t) & (times <= slip.t[-1])
        if inside.any():
            y = slip.sol(times[inside])
            out[:, inside] = y[0], -(kp * y[0] + kd * y[1] + ki * y[2])
        t, (x, _, x3) = slip.t[-1], slip.y[:, -1]
    return out


def _lugre(servo: Servo, gain: float, start: float, times: Array, state: Array | None) -> Array:
    kp, kd, ki = servo.torque_gains(gain)
    f, J = servo.friction, servo.inertia

    def rate(_: float, y: Array) -> list[float]:
        x, v, x3, z = y
        g = f.coulomb + (f.static - f.coulomb) * math.exp(-((v / f.stribeck_velocity) ** 2))
        dz = v - f.stiffness * abs(v) * z / g
        friction = f.stiffness * z + f.damping * dz + f.viscous * v
        return [v, (-(kp * x + kd * v + ki * x3) - friction) / J, x, dz]

    m = HELD * f.static
    y = [-start, 0.0, -(m - kp * start) / ki, m / f.stiffness] if state is None else state
    found = solve_ivp(rate, (0.0, times[-1]), y, t_eval=times, method="LSODA", rtol=1e-8, atol=1e-12)
    if not found.success:
        raise RuntimeError(f"the LuGre servo was followed to {found.t[-1]:g} s only: {found.message}")
    return np.array([found.y[0], -(kp * found.y[0] + kd * found.y[1] + ki * found.y[2])])
