"""The friction torque along a motion, against the formulas of the report written out in numpy."""

from __future__ import annotations

import numpy as np
import pytest
from torque_support import friction_torque, sliding_torque

from casahunt import InputError, Servo, simulate

F = Servo().friction


def g(v):
    return F.coulomb + (F.static - F.coulomb) * np.exp(-((v / F.stribeck_velocity) ** 2))


def test_lugre_follows_its_bristle():
    """Section 3.1, with the sigma0 that its printed bristle equation lacks."""
    motion = simulate(Servo(), "lugre", 0.1, time=6)
    t, (_, v, _, z) = motion.dense()
    zdot = v - F.stiffness * np.abs(v) * z / g(v)
    expected = F.stiffness * z + F.damping * zdot + F.viscous * v
    assert friction_torque(motion, t) == pytest.approx(expected, abs=1e-9)


def test_switch_slides_on_its_curve_and_sticks_below_static_friction():
    motion = simulate(Servo(), "switch", 0.1, time=6)
    t = motion.dense()[0]
    x = motion.sample(t)
    torque, modes = friction_torque(motion, t), np.array(motion.mode_at(t))
    slip = np.isin(modes, ("slip+", "slip-")) & (np.abs(x[1]) > 1e-5)
    assert slip.sum() > 50
    assert torque[slip] == pytest.approx(sliding_torque(F, x[1, slip]), abs=1e-12)
    stick = modes == "stick"
    assert stick.sum() > 5
    assert torque[stick] == pytest.approx(motion.signal("torque", t)[stick], abs=1e-12)
    assert np.all(np.abs(torque[stick]) <= F.static + 1e-6)


def test_the_sliding_curve():
    assert sliding_torque(F, np.array([0.0, 1e-9, -1e-9, 1.0])) == pytest.approx([0, 0.53, -0.53, 0.54])


def test_a_time_outside_the_motion():
    with pytest.raises(InputError, match="must lie between"):
        friction_torque(simulate(Servo(), "switch", 0.1, time=1), np.array([2.0]))
