"""Regions of attraction against the Taylor engine, which shares nothing with them but the servo."""

from __future__ import annotations

import math
from types import SimpleNamespace

import numpy as np
import pytest

from casahunt import Options, Servo, find_orbit
from casahunt.errors import InputError
from problems import table1
from problems.taylor import Flow, _root, _step, _value, switch_half_cycle
from scripts.report import attraction as rests_or_hunts
from scripts.report.attraction import attraction, first_stick, swing

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
            while True:
                grid = np.linspace(0, h, 33)
                speeds = np.array([sign * _value(c, s)[1] for s in grid])
                # A series made far above vs knows nothing of the Stribeck peak: it may not come near it in between.
                if np.max(np.abs(speeds - speeds[0])) <= max(flow.vs, speeds[0] - 7 * flow.vs):
                    break
                h *= 0.7
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


@pytest.mark.parametrize(
    ("x1", "start", "vs", "static", "least", "caught"),
    [
        (-0.05, 0.01, 1e-7, 1.1, 3e-8, True),  # into a narrow Stribeck peak
        (-0.05, 0.01, 1e-7, 1.1, 1e-5, False),  # above it
        (-0.05, 0.01, 0.02, 0.44, -1e-5, True),  # no peak: only through zero
        (-0.05, 0.01, 0.02, 0.44, 1e-5, False),
        (-5.0, 1.85e-6, 7e-8, 1.1, 2e-8, True),  # the first step ends as far beyond the dip as it began before it
        (-5.0, 1.85e-6, 3e-8, 1.1, 4e-8, True),  # the same, no stage of the step near the peak
    ],
)
def test_a_dip_of_the_speed_is_not_stepped_over(x1, start, vs, static, least, caught):
    """A speed that falls from `start` to `least` and rises again, were friction Coulomb's."""
    gain = 0.04
    smooth = SERVO.replace(**{"friction.static": SERVO.friction.coulomb})
    servo = SERVO.replace(**{"friction.stribeck_velocity": vs, "friction.static": static})
    kp, _, ki = servo.torque_gains(gain)
    low, high = -kp * x1 / ki - 0.3, -kp * x1 / ki + 0.3  # of x3: the less, the more torque
    for _ in range(80):
        middle = (low + high) / 2
        low, high = (middle, high) if dip(smooth, gain, np.array([x1, start, middle])) > least else (low, middle)
    state = np.array([x1, start, low])
    position, reversals, fell = followed(servo, gain, state)
    assert fell == caught
    found = first_stick(servo, gain, state[:, None])
    assert found.position[0] == pytest.approx(position, abs=2 * CLOSE * abs(x1))
    assert (found.reversals[0], found.falling[0]) == (reversals, fell)


def dip(servo: Servo, gain: float, x: np.ndarray) -> float:
    """The least velocity of a slip with Coulomb friction, as if nothing were at x2 = 0: a linear system, one series."""
    speed = np.polynomial.Polynomial(Flow(servo, gain, "switch").series(x, 1.0)[1])
    grid = np.linspace(0, 0.2, 401)
    t, rate = float(grid[np.argmin(speed(grid))]), speed.deriv()
    for _ in range(8):
        t = float(np.clip(t - rate(t) / rate.deriv()(t), 0, grid[-1]))
    return float(speed(t))


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
    for gain in np.geomspace(0.01, 1, 60):
        edge = SERVO.friction.static / SERVO.torque_gains(gain)[2]
        at_the_edge = first_stick(SERVO, gain, np.array([[0, 0], [0, 0], [edge, -edge]]))
        assert at_the_edge.time.tolist() == [0, 0], gain
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


def mapped(monkeypatch, P) -> tuple[SimpleNamespace, SimpleNamespace]:
    """Cycles with the amplitudes 1 (unstable) and 2 (stable) [rad], and P in the place of the event map."""
    monkeypatch.setattr(rests_or_hunts, "swing", lambda servo, gain, a: P(a))
    return tuple(SimpleNamespace(servo=SERVO, gain=0.1, amplitude=a) for a in (1.0, 2.0))  # type: ignore[return-value]


@pytest.mark.parametrize(("bend", "reach"), [(0.5, 1.0), (1.0, math.sqrt(0.5)), (32.0, 0.125)])
def test_the_interval_of_hunting_is_as_wide_as_motions_show(monkeypatch, bend, reach):
    """|P - 2| = |d|/2 + bend |d|^3, d = a - 2, is less than |d| up to |d| = sqrt(1/(2 bend)): to either side."""
    P = lambda a: 2 - (a - 2) / 2 - bend * (a - 2) ** 3  # noqa: E731
    low, high = rests_or_hunts._hunting(*mapped(monkeypatch, P))
    for d in (2 - low, high - 2):
        assert 0.95 * reach < d <= reach and abs(P(2 + d) - 2) < d
    assert rests_or_hunts._hunting(*mapped(monkeypatch, lambda a: 2 + 1.01 * (a - 2))) == (2, 2)
    above = lambda a: np.where(a > 2.25, 3.0, 2.0)  # noqa: E731  # P(a) is no nearer there
    low, high = rests_or_hunts._hunting(*mapped(monkeypatch, above))
    assert 0.24 < 2 - low <= 0.25 and high - 2 == pytest.approx(2 - low, rel=1e-12)


@pytest.mark.parametrize("border", [0.9, 0.3])
def test_rest_is_shown_up_to_where_a_motion_grows(monkeypatch, border):
    """P(a)/a = (1 + a/border)/2 is less than 1 below the border; the last motion that shrinks counts."""
    unstable, _ = mapped(monkeypatch, lambda a: a * (1 + a / border) / 2)
    found = rests_or_hunts._resting(unstable)
    assert 0.9 * border < found < border
    assert rests_or_hunts._resting(mapped(monkeypatch, lambda a: 0.9 * a)[0]) == 1
    assert rests_or_hunts._resting(mapped(monkeypatch, lambda a: 1.1 * a)[0]) == 0


@pytest.mark.slow
def test_the_trapping_set_ends_where_swings_leave_it():
    """mu = -0.89, and further out P overshoots: the interval is no wider than the motions show."""
    keys = "inertia", "motor_gain", "lead_time", "integral_time", "static", "coulomb", "stribeck_velocity", "viscous"
    values = 0.0126425, 29.109, 0.252257, 0.242681, 0.70947, 0.421059, 0.0102243, 0.510541
    sections = ["servo"] * 2 + ["controller"] * 2 + ["friction"] * 4
    servo = SERVO.replace(**{f"{s}.{k}": v for s, k, v in zip(sections, keys, values, strict=True)})
    unstable, stable = (find_orbit(servo, "switch", 1.15, branch=branch) for branch in ("unstable", "stable"))
    low, high = attraction(unstable, stable, np.zeros((3, 1))).hunting
    A = stable.amplitude
    beyond: list[bool] = []
    distances = np.array([0.5, 0.9, 0.99, 1.2]) * (high - A)
    for side in (-1, 1):
        P = np.array([switch_half_cycle(servo, 1.15, float(A + side * d))[0] for d in distances])
        nearer = np.abs(P - A) < distances
        assert nearer[:3].all()
        beyond.append(bool(nearer[3]))
    assert not all(beyond)
    assert high - A < 0.6 * (A - unstable.amplitude)


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
