"""Regions of attraction against the Taylor engine, which shares nothing with them but the servo."""

from __future__ import annotations

import math

import numpy as np
import pytest
from taylor import Flow, _root, _step, _value, switch_half_cycle

from casahunt import Options, Servo, find_orbit
from casahunt.attraction import attraction, first_stick, swing
from casahunt.errors import InputError
from problems import table1

SERVO = table1.servo()
CLOSE = 1e-6
"""Steps of error 1e-9, of which a swing takes a hundred, amplified where the slip lingers."""


def followed(servo: Servo, gain: float, state: np.ndarray) -> tuple[float, int, bool]:
    """(stick position, reversals, speed fell all the way) by Taylor series, each step watched at 32 times."""
    flow, x = Flow(servo, gain, "switch"), np.array(state, float)
    sign, reversals, fell = float(np.sign(x[1])), 0, True
    velocity = np.array([0.0, 1.0, 0.0])
    while True:
        if x[1] == 0:
            m = flow.torque(x)
            if abs(m) <= flow.Fs:
                return float(x[0]), reversals, fell
            sign, fell = float(np.sign(m)), False
        scale = np.array([max(abs(x[0]), 1e-6), max(abs(x[1]), 1e-6), flow.Fs / flow.ki])
        first = x[1] == 0
        while True:
            c = flow.series(x, sign)
            h = min(_step(c, scale, flow.vs), 1e-3 if first else math.inf)
            grid = np.linspace(0, h, 33)
            speeds = np.array([sign * _value(c, s)[1] for s in grid])
            below = np.flatnonzero(speeds[1:] < 0)
            if below.size and not first:
                i = int(below[0])
                fell &= bool((np.diff(speeds[: i + 1]) < 0).all())
                x = _value(c, _root(c, velocity, grid[i], grid[i + 1]))
                x[1] = 0.0
                reversals += abs(flow.torque(x)) > flow.Fs
                break
            fell &= bool((np.diff(speeds) < 0).all())
            x, first = _value(c, h), False


def slice_of(gain: float, x1: float, x2: float, count: int, seed: int) -> np.ndarray:
    """(3, count) random states with one x1, |x2| <= x2, x3 around the bound of the stick phase."""
    kp, _, ki = SERVO.torque_gains(gain)
    random = np.random.default_rng(seed)
    reach = 2.2 * SERVO.friction.static / ki
    x3 = random.uniform(-reach, reach, count) - kp * x1 / ki
    return np.stack([np.full(count, x1), random.uniform(-x2, x2, count), x3])


@pytest.mark.parametrize(
    ("gain", "x1", "x2", "count"),
    [
        (0.04, -0.8, 4.0, 8),
        (0.634, 0.0025, 0.5, 4),
        pytest.param(0.04, 0.4, 4.0, 40, marks=pytest.mark.slow),
        pytest.param(0.04, 0.0, 0.1, 20, marks=pytest.mark.slow),
        pytest.param(0.3, 0.01, 1.0, 20, marks=pytest.mark.slow),
    ],
)
def test_the_first_stick_is_that_of_the_taylor_engine(gain, x1, x2, count):
    states = slice_of(gain, x1, x2, count, seed=3)
    found = first_stick(SERVO, gain, states)
    for i, x in enumerate(states.T):
        position, reversals, fell = followed(SERVO, gain, x)
        size = max(abs(x1), abs(position), abs(x[1]) * math.sqrt(SERVO.inertia / SERVO.torque_gains(gain)[0]))
        assert found.position[i] == pytest.approx(position, abs=CLOSE * size)
        assert (found.reversals[i], found.falling[i]) == (reversals, fell)


def test_a_narrow_stribeck_peak_is_not_stepped_over():
    """Fs only within vs = 1e-4 rad/s of standstill: a motion at 3 rad/s that misses it sticks elsewhere."""
    servo = SERVO.replace(**{"friction.stribeck_velocity": 1e-4, "friction.static": 1.1})
    a = np.array([0.05, 0.3, 2.0])
    truth = [switch_half_cycle(servo, 0.04, float(x))[0] for x in a]
    assert swing(servo, 0.04, a) == pytest.approx(truth, rel=1e-5)


@pytest.mark.slow
def test_the_event_map_of_other_servos():
    """Four random servos, the map at three positions each."""
    random = np.random.default_rng(8)
    for _ in range(4):
        static = float(random.uniform(0.2, 3))
        servo = SERVO.replace(
            **{
                "friction.static": static,
                "friction.coulomb": static / float(random.uniform(1.05, 2)),
                "friction.stribeck_velocity": float(np.exp(random.uniform(np.log(5e-3), np.log(0.1)))),
                "servo.inertia": float(np.exp(random.uniform(np.log(5e-3), np.log(0.2)))),
            }
        )
        gain = 0.2
        unit = static / servo.torque_gains(gain)[0]
        a = unit * np.array([0.03, 0.2, 1.0])
        truth = np.array([switch_half_cycle(servo, gain, float(x), most_slips=60)[0] for x in a])
        found = swing(servo, gain, a)
        assert np.max(np.abs(found - truth) / a) < 1e-5, servo


def test_motions_mirror_each_other():
    states = slice_of(0.04, 0.2, 2.0, 50, seed=5)
    a, b = first_stick(SERVO, 0.04, states), first_stick(SERVO, 0.04, -states)
    assert np.array_equal(a.position, -b.position) and np.array_equal(a.reversals, b.reversals)


def test_states_at_standstill():
    """Stuck ones stay: the ends of the segment of fixed points too; beyond them the servo slips."""
    ki = SERVO.torque_gains(0.04)[2]
    end = SERVO.friction.static / ki
    states = np.array([[0, 0, 0, 0.1, 0], [0, 0, 0, 0, 0], [0, end, -end, 0, 1.1 * end]])
    found = first_stick(SERVO, 0.04, states)
    assert found.position[:4].tolist() == [0, 0, 0, 0.1] and found.time[:4].tolist() == [0, 0, 0, 0]
    assert found.falling.tolist() == [True, True, True, True, False] and found.position[4] < 0


def test_a_damped_servo_creeps_to_the_set_point():
    """At K = 0.634 a small swing has real slow poles and never stops: P(a) = 0, in infinite time."""
    assert swing(SERVO, 0.634, np.array([1e-4])).tolist() == [0.0]
    kp, _, ki = SERVO.torque_gains(0.634)
    start = np.array([[-1e-4], [0.0], [(kp * 1e-4 - SERVO.friction.static * (1 + 1e-12)) / ki]])
    found = first_stick(SERVO, 0.634, start)
    assert found.position.tolist() == [0.0] and found.time.tolist() == [math.inf]


def cycles(gain: float):
    options = Options(tol=1e-9)
    return [find_orbit(SERVO, "switch", gain, branch=branch, options=options) for branch in ("unstable", "stable")]


def destiny(gain: float, a: float, unstable: float, stable: float) -> str:
    """Rest or hunting of a servo stuck at a, by the Taylor engine alone."""
    for _ in range(60):
        if a < 0.5 * unstable:
            return "rests"
        if abs(a / stable - 1) < 1e-3:
            return "hunts"
        a = abs(switch_half_cycle(SERVO, gain, a)[0])
    raise AssertionError("the Taylor engine did not decide")


@pytest.mark.slow
@pytest.mark.parametrize("gain", [0.1, 0.634])
def test_rest_and_hunting_are_those_of_the_taylor_engine(gain):
    unstable, stable = cycles(gain)
    beside = unstable.amplitude * np.array([0.99, 1.01])
    kp, _, ki = SERVO.torque_gains(gain)
    stuck = np.stack([beside, 0 * beside, -kp * beside / ki])
    states = np.hstack([stuck, slice_of(gain, 1.5 * stable.amplitude, 0.5, 10, seed=2)])
    found = attraction(unstable, stable, states)
    assert (found.rests ^ found.hunts).all()
    for i, x in enumerate(states.T):
        truth = destiny(gain, abs(followed(SERVO, gain, x)[0]), unstable.amplitude, stable.amplitude)
        assert found.rests[i] == (truth == "rests"), (gain, x)
    assert found.rests[:2].tolist() == [True, False]


def test_the_trapping_sets_are_shown_and_end_at_the_unstable_cycle():
    unstable, stable = cycles(0.04)
    found = attraction(unstable, stable, np.zeros((3, 1)))
    assert found.resting == unstable.amplitude
    low, high = found.hunting
    assert unstable.amplitude <= low < stable.amplitude < high
    for a in np.linspace(low * 1.001, high * 0.999, 5):
        P = switch_half_cycle(SERVO, 0.04, float(a))[0]
        assert abs(P - stable.amplitude) < abs(a - stable.amplitude)


def test_what_cannot_be_right_is_refused():
    unstable, stable = cycles(0.1)
    states = np.zeros((3, 2))
    with pytest.raises(InputError, match="unstable and a stable"):
        attraction(stable, unstable, states)
    with pytest.raises(InputError, match="same servo at the same gain"):
        attraction(unstable, cycles(0.04)[1], states)
    with pytest.raises(InputError, match=r"\(3, m\)"):
        first_stick(SERVO, 0.1, np.zeros((4, 2)))
    with pytest.raises(InputError, match=r"\(3, m\)"):
        first_stick(SERVO, 0.1, np.full((3, 2), np.nan))
    with pytest.raises(InputError, match="gain"):
        first_stick(SERVO, -1.0, states)
    with pytest.raises(InputError, match="a = "):
        swing(SERVO, 0.1, np.array([0.1, 0.0]))
    with pytest.raises(InputError, match="'switch'"):
        lugre = find_orbit(SERVO, "lugre", 0.1)
        attraction(unstable, lugre, states)
