"""What becomes of motions with remedies that could not be followed: they come to rest by rounding, or grow."""

from __future__ import annotations

import numpy as np
import pytest
from servo_files import ROTARY

from casahunt import Friction, Pid, Servo, simulate
from casahunt.servo.outcome import Outcome
from casahunt.servo.parts import loop_of
from casahunt.views.commands.simulate import with_remedies

STIFF = Servo(
    inertia=4.5e-4, motor_gain=1.0, controller=Pid(kp=90, ki=4000, kd=0.28),
    friction=Friction(static=0.32, coulomb=0.21, stribeck_velocity=0.4, viscous=0.003),
)  # fmt: skip


@pytest.mark.parametrize("leak", [1.393, 1.4])
def test_a_slip_creeps_to_the_edge_of_the_errors_at_rest(leak):
    """Its torque there tends to static friction, which it neither exceeds nor falls below but for rounding."""
    loop = with_remedies(loop_of(ROTARY, "switch", 1.0), {"leak": leak})
    found = simulate(loop)
    assert found.duration == pytest.approx(100.0, rel=1e-12) and found.end_error < 1e-6
    assert found.end[0] == pytest.approx(0.8 / (4 + 30 / leak), rel=1e-9)


@pytest.mark.parametrize(("remedy", "at"), [({"reset": 0.7362}, 0.0), ({"shifted_dead_band": 0.004079}, 0.004079)])
def test_slips_shrink_to_rounding(remedy, at):
    """Each to a tenth of the one before; by rounding the error would go through zero, and reset the integrator.

    Until 8 s: beside the edge of a band by rounding, the integrator winds up by more than the tolerance in 100 s.
    """
    loop = with_remedies(loop_of(STIFF, "switch", 0.15), remedy)
    motion = simulate(loop, set_point=0.01, time=8.0)
    assert motion.end_error < 1e-6 and motion.end[0] == pytest.approx(at, abs=1e-8)
    assert np.abs(motion.signal("torque", [8.0])) == pytest.approx(0.32, rel=1e-6)  # breakaways follow to the end
    assert np.ptp(motion.states[:, motion.times > 5], axis=1).max() < 1e-9


def becomes(loop, time: float, start) -> tuple[float, Outcome]:
    """The largest |x1| of a motion, and what becomes of it."""
    found = simulate(loop, set_point=0.0, time=time, start=start)
    return float(np.abs(found.states[0]).max()), found.verdict


def test_what_stands_beside_its_set_point_is_at_rest():
    """A leak holds its torque within static friction for good: kp + ki/leak times the error."""
    loop = with_remedies(loop_of(ROTARY, "switch", 1.0), {"leak": 2.0})
    assert becomes(loop, 100.0, loop.at_rest(-1.0))[1].kind == "at rest"


UNSTABLE = {"error_filter_time": 0.0792}


def test_a_motion_grows_that_its_linear_loop_carries_away():
    """Without dry friction, which holds nothing back so far out: theta'' = (-kp f - kd f' - ki w - b theta')/J with
    the filtered error Tf f' = theta - f."""
    loop = with_remedies(loop_of(ROTARY, "switch", 1.0), UNSTABLE)
    J, b, Tf = ROTARY.inertia, 0.02, UNSTABLE["error_filter_time"]
    linear = np.diag([1.0, 0.0, 0.0], 1)
    linear[1] = -0.12 / Tf / J, -b / J, -30 / J, (0.12 / Tf - 4) / J
    linear[2:] = (0, 0, 0, 1), (1 / Tf, 0, 0, -1 / Tf)
    assert np.linalg.eigvals(linear).real.max() > 1
    assert [becomes(loop, time, loop.at_rest(-1.0))[1].kind for time in (1.28, 2.0)] == ["growing", "growing"]


@pytest.mark.parametrize(("start", "time"), [
    ({"x1": -5e3}, 1.0), ({"x2": 1e5}, 0.05), ({"x2": 1e5}, 1.0), ({"x3": -1e4}, 0.01),
])  # fmt: skip
def test_far_away_is_not_growing(start, time):
    """Begun so far away, or thrown or pushed there, it comes back."""
    loop = with_remedies(loop_of(ROTARY, "switch", 1.0), {"leak": 1.4})
    far, seen = becomes(loop, time, loop.state(**start))
    assert far > 1e3 and seen.kind in ("at rest", "decaying")
    assert becomes(loop, 1e-6, loop.state(**start))[1].kind in ("at rest", "decaying")
