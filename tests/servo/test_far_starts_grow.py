"""A rotary table with LuGre friction and a limited torque: from afar it winds up, near its set point it hunts."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from casahunt import Options, effort, find_orbit
from casahunt.servo.parts import INERTIA, INTEGRATOR, LUGRE, PID_BY_GAINS, TORQUE_LIMIT, Loop

VALUES = {
    "inertia": 0.8, "kp": 400.0, "ki": 3000.0, "kd": 12.0, "motor_gain": 1.0, "gain": 1.0, "static": 9.0,
    "coulomb": 6.0, "stribeck_velocity": 0.0087, "viscous": 2.0, "stiffness": 4e4, "damping": 60.0,
    "torque_limit": 12.0,
}  # fmt: skip


def amplitude_and_period():
    """Of the motion from 5 mrad beside the set point, when it has settled."""

    def rate(_, x):
        angle, v, z, integral = x
        torque = np.clip(-(400 * angle + 12 * v + 3000 * integral), -12, 12)
        bristle = v - 4e4 * abs(v) / (6 + 3 * np.exp(-((v / 0.0087) ** 2))) * z
        return [v, (torque - (4e4 * z + 60 * bristle + 2 * v)) / 0.8, bristle, angle]

    def up(_, x):
        return x[0]

    up.direction = 1
    done = solve_ivp(rate, (0, 30), [-5e-3, 0, 0, 0], method="LSODA", rtol=1e-10, atol=1e-13, max_step=0.02, events=up)
    return np.abs(done.y[0][done.t > 20]).max(), np.diff(done.t_events[0])[-1]


def test_a_cycle_is_found_although_motions_from_afar_grow():
    amplitude, period = amplitude_and_period()
    loop = Loop((INERTIA, LUGRE, PID_BY_GAINS, INTEGRATOR, TORQUE_LIMIT), VALUES)
    with effort.at_most(1e6):
        orbit = find_orbit(loop, options=Options(tol=1e-6))
    assert orbit.amplitude == pytest.approx(amplitude, rel=1e-5) and orbit.period == pytest.approx(period, rel=1e-5)


def test_what_is_allowed_in_all_is_so_of_a_part_of_it():
    """A part that may take more than is left ends as the whole does."""
    with pytest.raises(effort.PartGivenUp), effort.at_most(10), effort.at_most(100):
        effort.pieces(11)
