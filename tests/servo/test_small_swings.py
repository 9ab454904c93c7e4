"""Small slips in closed form: loops made from their roots."""

from __future__ import annotations

import numpy as np
import pytest

from casahunt import Servo, simulate
from casahunt.servo.simulation.long_run import settles
from casahunt.servo.simulation.small_swings import creeps, distance


def with_roots(*roots: complex) -> Servo:
    """A servo of inertia 1 whose loop without dry friction has these roots at gain 1."""
    _, damping, kp, ki = np.poly(roots).real
    gains = {"controller.kp": kp, "controller.ki": ki, "controller.kd": damping}
    return Servo().replace(**{"servo.inertia": 1.0, "servo.motor_gain": 1.0, "friction.viscous": 0.0, **gains})


@pytest.mark.parametrize(("roots", "expected"), [
    ((-1, -2, -3), True), ((-1, -2, -300), True),  # three real exponentials have no third zero
    ((-1, -50 + 1j, -50 - 1j), True), ((-1, -1.5 + 9j, -1.5 - 9j), True),  # it turns, and that dies out in time
    ((-5, -1 + 1j, -1 - 1j), False), ((-3, -1 + 9j, -1 - 9j), False),  # what turns is what remains
    ((-5, 0.1 + 3j, 0.1 - 3j), False),  # it goes away
])  # fmt: skip
def test_whether_a_small_slip_stops(roots, expected):
    """The truth is the sum of exponentials itself: y, y', y'' = kp/ki, -1, 0 at the start, and x2 = y''."""
    servo = with_roots(*roots)
    kp, _, ki = servo.torque_gains(1.0)
    c = np.linalg.solve(np.vander(roots, 3, increasing=True).T.astype(complex), np.array([kp / ki, -1.0, 0.0]))
    t = np.linspace(0, 20, 400_001)[1:]
    x2 = (np.exp(np.outer(t, roots)) @ (c * np.square(roots))).real
    assert bool((x2 > 0).all()) is expected is creeps(servo, 1.0)


DAMPED = {
    "servo.inertia": 0.00833013,
    "servo.motor_gain": 27.1614,
    "controller.lead_time": 0.306233,
    "controller.integral_time": 0.387414,
    "friction.static": 1.26049,
    "friction.coulomb": 0.866749,
    "friction.stribeck_velocity": 0.0150762,
    "friction.viscous": 0.0537052,
}
"""A servo drawn at random."""


def test_rest_next_to_the_set_point_does_not_hang_on_rounding():
    """A march from there follows the last digits of the torque: at every third gain it had no end in 3000 intervals."""
    servo = Servo().replace(**DAMPED)
    for gain in 0.88383 * (1 + 1e-3 * np.arange(12)):
        ahead = settles(servo, "switch", gain, 4e-10)
        assert ahead.holds and ahead.motions >= 1, ahead.sentence


def test_a_servo_that_has_crept_to_the_set_point_is_at_rest():
    """Its slip ends 1e-16 rad beside it, and no march says where."""
    servo = Servo().replace(**DAMPED)
    for gain in 0.88383 * (1 + 1e-3 * np.arange(12)):
        motion = simulate(servo, "switch", gain, position=1.0048, time=380.0)
        assert motion.modes[-1] == "slip+" and motion.verdict.kind == "at rest", motion.verdict.sentence


@pytest.mark.slow
def test_a_servo_that_still_moves_has_not_crept_there():
    servo = Servo().replace(**DAMPED)
    moving = simulate(servo, "switch", 0.88383, position=1.0048, time=1.0)
    assert distance(servo, 0.88383, moving.end) > 1e-5 and moving.verdict.kind != "at rest"
