"""scipy.integrate.solve_bvp as a peer.

Switch: the half cycle reduced by hand to one boundary value problem, as for AUTO-07p (switch.f90).
LuGre: the half period in units of itself, closed by x(1) = -x(0), with x1(0) = 0; T/2 is a parameter.
"""

from __future__ import annotations

import numpy as np
from scipy.integrate import solve_bvp

from casahunt import Orbit, Servo

from .shooting import Failed, Shot

Array = np.ndarray
MOST_NODES = 20_000


def start_of(orbit: Orbit) -> tuple[Array, Array, Array]:
    """(times in 0..1, states (n, m), parameters) of the boundary value problem of an orbit."""
    times, states = orbit.sample(4)
    length = orbit.arcs[0].duration if orbit.model == "switch" else orbit.period / 2
    inside = times <= length * (1 + 1e-12)
    times, states = times[inside] / times[inside][-1], states[:, inside]
    keep = np.concatenate([[True], np.diff(times) > 1e-14])
    return times[keep], states[:, keep], np.array([length])


def solve(servo: Servo, model: str, gain: float, start: tuple[Array, Array, Array], tol: float) -> Shot:
    """The half cycle at `gain` from the solution of a near-by problem."""
    kp, kd, ki = servo.torque_gains(gain)
    f, J = servo.friction, servo.inertia
    times, states, parameters = start
    size = np.max(np.abs(states), axis=1)

    def drop(v: Array) -> Array:
        return f.coulomb + (f.static - f.coulomb) * np.exp(-((v / f.stribeck_velocity) ** 2))

    def field(t: Array, y: Array, p: Array) -> Array:
        x = y * size[:, None]
        torque = -(kp * x[0] + kd * x[1] + ki * x[2])
        if model == "switch":
            rows = [x[1], (torque - drop(x[1]) - f.viscous * x[1]) / J, x[0]]
        else:
            rate = x[1] - f.stiffness * np.abs(x[1]) * x[3] / drop(x[1])
            friction = f.stiffness * x[3] + f.damping * rate + f.viscous * x[1]
            rows = [x[1], (torque - friction) / J, x[0], rate]
        return p[0] * np.vstack(rows) / size[:, None]

    def ends(y0: Array, y1: Array, p: Array) -> Array:
        a = y0 * size
        if model == "switch":
            torque = -(kp * a[0] + kd * a[1] + ki * a[2])
            return np.array([y0[1], torque / f.static - 1, y1[1], y0[0] + y1[0]])
        return np.append(y0 + y1, y0[0])

    found = solve_bvp(field, ends, times, states / size[:, None], p=parameters, tol=tol, max_nodes=MOST_NODES)
    if not found.success:
        raise Failed(f"solve_bvp: {found.message}")
    x = found.y * size[:, None]
    if model == "switch":
        half = found.p[0] - (x[2, 0] + x[2, -1]) / x[0, -1]
        return Shot(found.p, float(x[0, -1]), 2 * float(half))
    dense = found.sol(np.unique(np.concatenate([found.x, np.linspace(0, 1, 20_001)]))) * size[:, None]
    return Shot(found.p, float(np.max(np.abs(dense[0]))), 2 * float(found.p[0]))
