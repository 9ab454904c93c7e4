"""LuGre friction under a constant torque, against scipy's motion."""

from __future__ import annotations

import numpy as np
import pytest

from casahunt import Friction, Servo
from casahunt.servo.parts import loop_of
from casahunt.servo.sampled.plant import Plant, plant_of
from scripts.peers.sampled_motion import SampledServo

J = 0.012
NUMBERS = {"static": 0.4, "coulomb": 0.3, "stribeck_velocity": 0.05, "viscous": 0.02}


def both(friction: Friction, v: float, z: float, m: float, lasts: float) -> tuple[np.ndarray, np.ndarray]:
    """(x, v, z, changes of sign) of both programs."""
    loop = loop_of(Servo(inertia=J, friction=friction), "lugre", 1.0)
    ours = Plant(plant_of(loop)[0], {"x2": v, "x4": z, "held": m})
    theirs = SampledServo(J, 0.4, 0.3, 0.05, 0.02, 1.0, 1.0, 1.0, 1e-3)
    theirs.bristle, theirs.z = (friction.stiffness, friction.damping), z
    stops = ours(m, lasts)
    a, b, turns = theirs.slide(0.0, v, m, lasts)
    return np.array([*ours.x[:3], len(stops)]), np.array([a, b, theirs.z, len(turns)])


@pytest.mark.parametrize("seed", range(8))
def test_it_moves_as_scipy_says(seed):
    """Swinging on its bristles, slipping, and both; sizes of x, v, z of the case."""
    r = np.random.default_rng(seed)
    z, v, m = r.uniform(-1, 1) * 1.7e-5, 10 ** r.uniform(-5, 0) * r.choice([1, -1]), r.normal() * r.choice([0.3, 3])
    ours, theirs = both(Friction(**NUMBERS), float(v), float(z), float(m), 2e-3)
    assert ours == pytest.approx(theirs, rel=1e-9, abs=1e-14)


def test_soft_bristles_do_not_hide_the_drop_of_the_friction():
    """A long step from far above it would not see it."""
    soft = Friction(**NUMBERS, stiffness=1.0, damping=0.001)
    ours, theirs = both(soft, 1.6, 0.3, -11.6, 2e-3)
    assert ours == pytest.approx(theirs, rel=1e-10, abs=1e-14)
