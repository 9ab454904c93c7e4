"""The set of rest positions that each remedy states, against motions from stuck states all over and beside it."""

import numpy as np
import pytest

from casahunt import Servo
from casahunt.motion import simulate
from casahunt.servo.parts import REMEDIES, loop_of
from casahunt.servo.parts.table import with_remedy

GAIN, LONG = 0.04, 2e4
"""Gain [V/rad]; seconds after which a stuck servo that can break away has."""
SIZES = {
    "dead band": 0.05, "shifted dead band": 0.04, "hysteresis": 0.06, "error dead band": 0.05, "leak": 0.27,
    "freeze": 4.0, "reset": 0.7, "reset at a stop": 0.5, "error filter": 0.01, "feedforward": 0.5, "dither": 0.008,
    "gain": 0.7, "derivative": 5.0, "integral": 1.0,
}  # fmt: skip
ABOUT = {name: remedy for remedy in REMEDIES if "switch" in remedy.needs for name in [remedy.name]}
DIRECTIONS = np.array([[np.cos(t), np.sin(t)] for t in np.linspace(0, 2 * np.pi, 73)])
PLACES, TORQUES = (0.0, 0.5, 0.98, 1.02, 1.3), (-0.98, -0.5, 0.0, 0.5, 0.98)
"""Starts: x1 in units of the largest stated, or of OFF where that is zero, and torques in units of static friction."""
OFF, NEAR = 0.05, 0.05
"""[rad]; by how much these may miss a corner, in those units."""


def numbers(loop):
    factor = loop.value("gain") * loop.value("motor_gain")
    return loop.parameters | {name: factor * loop.value(name) for name in ("kp", "kd", "ki")}


def rested(loop, x1, m):
    """(x1, torque) at which a servo stays that is stuck at x1 with the torque m at first; None where it moves."""
    p = numbers(loop)
    state = loop.state(x1=x1, **{name: x1 for part in loop.present for name in part.states if name == "filtered"})
    seen = float(loop.signal("error", loop.mode_at(**state), np.array([[value] for value in state.values()]))[0])
    state["x3"] = -(m + p["kp"] * seen) / p["ki"]
    mode, sizes, duration, done = loop.mode_at(**state), None, 1.0, 0.0
    while done < LONG:
        motion = simulate(loop.system, mode, start=state, duration=duration, sizes=sizes, tol=1e-7)
        if np.abs(motion.sample(4)[1][0] - x1).max() > 1e-9:
            return None
        mode, state, sizes = motion.phases[-1].mode, motion.end, sizes or motion.sizes
        done, duration = done + duration, 4 * duration
    end = np.array([[value] for value in motion.end.values()])
    return x1, float(loop.signal("torque", mode, end)[0])


@pytest.mark.parametrize("name", SIZES)
def test_a_servo_rests_where_it_is_said_to_and_nowhere_else(name):
    remedy, plain = ABOUT[name], loop_of(Servo(), "switch", GAIN)
    loop = with_remedy(plain, remedy, SIZES[name])
    p = numbers(loop)
    static = p["static"]
    corners = np.array(remedy.rests(SIZES[name], p))
    reach = max(abs(x1) for x1, _ in remedy.rests(SIZES[name], p))
    assert reach == np.abs(corners[:, 0]).max()
    unit = np.array([reach or OFF, static])
    ends = [rested(loop, x1 * unit[0], m * static) for x1 in PLACES for m in TORQUES]
    ends = np.array([end for end in ends if end is not None]) / unit
    reached = np.max(np.concatenate([ends, -ends]) @ DIRECTIONS.T, axis=0)  # as far as motions rest, by direction
    stated = np.max(corners / unit @ DIRECTIONS.T, axis=0)
    assert np.all(reached <= stated + 1e-6), "rests outside of the set"
    assert np.all(reached >= stated - NEAR), "moves in the set"


@pytest.mark.parametrize("x1", [-1.8, -1.2, 1.5])
def test_what_compensates_friction_by_the_sign_of_a_slip_holds_nothing(x1):
    """Where friction ends a slip that compensation helped, the servo sticks if |torque| <= Fs, or goes back."""
    remedy = ABOUT["feedforward"]
    loop = with_remedy(loop_of(Servo(), "switch", GAIN), remedy, 0.9)
    start = loop.state(x1=x1)
    motion = simulate(loop.system, loop.mode_at(**start), start=start, duration=3.0, tol=1e-8)
    times, states = motion.sample(8)
    ends = np.cumsum([phase.duration for phase in motion.phases])
    assert [phase.mode for phase in motion.phases[:2]] in (["slip+", "slip-"], ["slip-", "slip+"])
    for phase, begin, end in zip(motion.phases, ends - [phase.duration for phase in motion.phases], ends, strict=True):
        if phase.mode == "stick":
            inside = (times > begin) & (times < end)
            assert np.abs(loop.signal("torque", "stick", states[:, inside])).max() <= 0.53 * (1 + 1e-9)


def test_where_a_motion_begins_asks_each_part_in_the_modes_of_the_others():
    """Inside of a band on the error it is the integral alone that pulls: 0.98 Fs does not break the servo away."""
    loop = with_remedy(loop_of(Servo(), "switch", GAIN), ABOUT["error dead band"], 0.05)
    assert loop.mode_at(x1=0.0, x3=-0.98 * 0.53 / numbers(loop)["ki"]) == "stick, inside"


def test_every_remedy_has_its_set_tested():
    assert set(SIZES) == set(ABOUT)
