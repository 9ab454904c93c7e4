"""Stiff bristles, which ring through hundreds of reversals before they stick."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from casahunt import Options, Servo, find_orbit

GAIN, TOLERANCE = 0.1, 1e-8


@pytest.mark.parametrize(("stiffness", "reversals"), [(1e6, 80), pytest.param(1e7, 250, marks=pytest.mark.slow)])
def test_a_stiff_bristle_rings_out(stiffness, reversals):
    """Half a cycle by an implicit Runge-Kutta method that knows no phases ends where the mirror image begins."""
    servo = Servo().replace(**{"friction.stiffness": stiffness})
    orbit = find_orbit(servo, "lugre", GAIN, options=Options(tol=TOLERANCE))
    assert len(orbit.arcs) >= reversals and orbit.error_estimate <= TOLERANCE
    kp, kd, ki = servo.torque_gains(GAIN)
    f = servo.friction

    def field(_: float, x: np.ndarray) -> list[float]:
        position, v, integral, z = x
        g = f.coulomb + (f.static - f.coulomb) * np.exp(-((v / f.stribeck_velocity) ** 2))
        rate = v - f.stiffness * abs(v) / g * z
        torque = -(kp * position + kd * v + ki * integral)
        return [v, (torque - f.stiffness * z - f.damping * rate - f.viscous * v) / servo.inertia, position, rate]

    states = orbit.sample(2000)[1]
    scale = np.abs(states).max(axis=1)
    end = solve_ivp(field, (0, orbit.period / 2), states[:, 0], method="Radau", rtol=1e-9, atol=1e-10 * scale).y[:, -1]
    assert np.abs((end + states[:, 0]) / scale).max() < 1e-7
