"""Motions with remedies that come to rest where events are met by rounding: they are followed to the end."""

from __future__ import annotations

import numpy as np
import pytest

from casahunt import Friction, Pid, Servo
from casahunt.servo.parts import loop_motion
from casahunt.views.commands.loops.remedied import with_remedies

ROTARY = Servo(
    inertia=0.0035, motor_gain=1.0, controller=Pid(kp=4, ki=30, kd=0.12),
    friction=Friction(static=0.8, coulomb=0.55, stribeck_velocity=0.08, viscous=0.02),
)  # fmt: skip
STIFF = Servo(
    inertia=4.5e-4, motor_gain=1.0, controller=Pid(kp=90, ki=4000, kd=0.28),
    friction=Friction(static=0.32, coulomb=0.21, stribeck_velocity=0.4, viscous=0.003),
)  # fmt: skip


@pytest.mark.parametrize("leak", [1.393, 1.4])
def test_a_slip_creeps_to_the_edge_of_the_errors_at_rest(leak):
    """Its torque there tends to static friction, which it neither exceeds nor falls below but for rounding."""
    loop = with_remedies(ROTARY, "switch", 1.0, {"leak": leak})
    found = loop_motion(loop, 100.0, start=loop.at_rest(-1.0), tol=1e-6).motion
    assert found.duration == pytest.approx(100.0, rel=1e-12) and found.error < 1e-6
    assert found.end["x1"] == pytest.approx(0.8 / (4 + 30 / leak), rel=1e-9)


@pytest.mark.parametrize(("remedy", "at"), [({"reset": 0.7362}, 0.0), ({"shifted_dead_band": 0.004079}, 0.004079)])
def test_slips_shrink_to_rounding(remedy, at):
    """Each to a tenth of the one before; by rounding the error would go through zero, and reset the integrator."""
    loop = with_remedies(STIFF, "switch", 0.15, remedy)
    motion = loop_motion(loop, 100.0, start=loop.at_rest(-0.01), tol=1e-6)
    assert motion.motion.error < 1e-6 and motion.motion.end["x1"] == pytest.approx(at, abs=1e-8)
    assert np.abs(motion.torque[-1]) == pytest.approx(0.32, rel=1e-6)  # breakaways follow each other to the end
    assert np.ptp(motion.states[:, motion.times > 50], axis=1).max() < 1e-9
