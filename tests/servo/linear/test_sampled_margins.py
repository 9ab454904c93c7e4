"""The margins of the loop as built, against eigenvalues of the matrix that takes it from sample to sample."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.linalg import expm

from casahunt import Controller, Drive, Friction, Pid, Servo, margins
from casahunt.servo.linear.pulse_transfer import pulse_transfer
from casahunt.servo.parts import loop_of


def response(servo: Servo, gain: float, drive: Drive, omega: np.ndarray) -> np.ndarray:
    """L of casahunt."""
    return pulse_transfer(loop_of(servo, "switch", gain), drive).response(omega)


def held(servo: Servo, lasts: float) -> np.ndarray:
    """exp of [x, v, m]' = [v, (m - sigma2 v)/J, 0]."""
    J, sigma2 = servo.inertia, servo.friction.viscous
    return expm(np.array([[0, 1, 0], [0, -sigma2 / J, 1 / J], [0, 0, 0]]) * lasts)


def opened(servo: Servo, gain: float, drive: Drive) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """A, b, c of the state (x, v, torques on their way, f, w, d, e) at the samples: u = -c s, behind it A s + b u.

    f, w, d, e are of the sample before; the equations are those of controller.py, written down once more.
    """
    T, trapezoid = drive.sample_time, drive.integration == "trapezoid"
    kp, kd, ki = servo.torque_gains(gain)
    late = int(drive.delay // T)
    part = drive.delay - late * T
    n = 2 + late + 1
    size = n + 4
    one = np.eye(size)
    x, v, (f0, w0, d0, e0) = one[0], one[1], one[n:]
    f = f0 + T / (T + drive.error_filter_time) * (x - f0)
    e = f
    w = (1 - drive.leak * T) * w0 + T * ((e0 + e) / 2 if trapezoid else e)
    filter_time = drive.filter_of(servo.controller)
    d = d0 + T / (T + filter_time) * ((e - e0) / T - d0)
    c = kp * e + ki * w + kd * d
    waiting = [*one[2:n], np.zeros(size)]  # the last one is u, which b has
    A, b = np.zeros((size, size)), np.zeros(size)
    u_at = late + 1
    first, then = held(servo, part), held(servo, T - part)
    state = np.array([x, v, waiting[0]])
    state = first @ state
    state = then @ np.array([state[0], state[1], waiting[1]])
    A[:2] = state[:2]
    if u_at == 1:
        b[:2] += then[:2, 2]
    A[2:n] = waiting[1:]
    b[n - 1] = 1.0
    A[n:] = f, w, d, e
    return A, b, c


def radius(servo: Servo, gain: float, drive: Drive) -> float:
    """Largest size of an eigenvalue of the closed loop."""
    A, b, c = opened(servo, gain, drive)
    return float(np.abs(np.linalg.eigvals(A - np.outer(b, c))).max())


def random_loop(random: np.random.Generator) -> tuple[Servo, Drive]:
    """A servo whose crossover is at some 10 rad/s at gain 1, and a drive with up to two samples at that frequency."""
    zeta = random.uniform(0.2, 1.5)
    by_gains = Pid(kp=1.0, ki=random.uniform(0.2, 6.0), kd=zeta * random.uniform(0.02, 0.3))
    by_times = Controller(lead_time=random.uniform(0.05, 0.4), integral_time=random.uniform(0.1, 1.0))
    viscous = random.choice([0.0, 1e-9, 0.02, 0.3, 3.0])
    servo = Servo(
        inertia=float(random.choice([0.005, 0.01, 0.03])), motor_gain=1.0,
        controller=by_gains if random.random() < 0.5 else by_times,
        friction=Friction(static=0.5, coulomb=0.4, stribeck_velocity=0.1, viscous=float(viscous)),
    )  # fmt: skip
    T = float(10 ** random.uniform(-4, -1))
    filtered = random.random() < 0.5
    drive = Drive(
        sample_time=T, delay=float(random.choice([0.0, 0.3, 1.0, 2.6, 7.0, 40.5])) * T,
        derivative="filtered" if filtered else "difference",
        filter_time=float(random.uniform(0.1, 5) * T) if filtered and random.random() < 0.7 else None,
        integration=str(random.choice(["rectangle", "trapezoid"])),
        leak=float(random.choice([0.0, 0.0, 0.5])), error_filter_time=float(random.choice([0.0, 0.0, 0.02])),
    )  # fmt: skip
    return servo, drive


@pytest.mark.parametrize("seed", range(8))
def test_the_response_is_that_of_the_matrices(seed):
    random = np.random.default_rng(seed)
    servo, drive = random_loop(random)
    A, b, c = opened(servo, 0.7, drive)
    omega = random.uniform(0.01, 1.0, 5) * math.pi / drive.sample_time
    for w, value in zip(omega, response(servo, 0.7, drive, omega), strict=True):
        z = np.exp(1j * w * drive.sample_time)
        exact = c @ np.linalg.solve(z * np.eye(b.size) - A, b)
        assert abs(value - exact) < 1e-9 * abs(exact)


@pytest.mark.parametrize("seed", range(100, 106))
def test_limits_are_where_an_eigenvalue_crosses_the_unit_circle(seed):
    """One per cent within each limit that is told the loop is stable, one per cent beyond it is not."""
    random = np.random.default_rng(seed)
    seen = {True: 0, False: 0}
    limits = 0
    for _ in range(25):
        servo, drive = random_loop(random)
        gain = float(10 ** random.uniform(-2, 1))
        found, size = margins(servo, gain, drive=drive), radius(servo, gain, drive)
        assert found.stable is bool(size < 1), (servo, gain, drive)
        assert (found.phase_margin > 0) is found.stable
        seen[found.stable] += 1
        if not found.stable:
            assert math.isnan(found.lowest_factor) and math.isnan(found.highest_factor)
            continue
        A, b, c = opened(servo, gain, drive)
        z = np.exp(1j * found.frequency * drive.sample_time)
        L = c @ np.linalg.solve(z * np.eye(b.size) - A, b)
        assert abs(L) == pytest.approx(1, rel=1e-6)
        off = np.angle(-L) - math.radians(found.phase_margin)
        assert math.remainder(off, 2 * math.pi) == pytest.approx(0, abs=1e-6)
        low, high = found.lowest_factor, found.highest_factor
        assert low < 1 < high < math.inf
        for within, beyond in ((1.01 * low, 0.99 * low), (0.99 * high, 1.01 * high)):
            if beyond:
                limits += 1
                assert radius(servo, gain * within, drive) < 1 < radius(servo, gain * beyond, drive)
        for between in np.geomspace(max(1.01 * low, 1e-3), 0.99 * high, 7):
            assert radius(servo, gain * between, drive) < 1
    assert min(seen.values()) > 3 and limits > 10


def test_a_loop_that_turns_many_times_below_its_crossover_is_unstable():
    """With a thousand samples of delay no loop is stable whose crossover lies far above 1/D."""
    servo, T = Servo(), 1e-4
    for gain in np.geomspace(10, 1000, 15):
        found = margins(servo, gain, drive=Drive(sample_time=T, delay=1000 * T))
        assert found.frequency > 20 / (1000 * T) and not found.stable and found.phase_margin <= 0


@pytest.mark.parametrize("delay", [0.0, 0.03, 0.1])
def test_a_real_pole_may_leave_the_unit_circle_at_minus_one(delay):
    """Viscous friction that stops the servo within a sample: it goes to and fro from sample to sample."""
    friction = Friction(static=0.5, coulomb=0.4, stribeck_velocity=0.1, viscous=3.0)
    servo = Servo(inertia=0.005, motor_gain=1.0, controller=Pid(kp=1.0, ki=1.0, kd=1e-3), friction=friction)
    drive = Drive(sample_time=0.1, delay=delay)
    limit = margins(servo, 1.0, drive=drive).highest_factor
    for within, beyond in ((0.99, 1.01), (0.5, 2.0), (0.01, 10.0)):
        at, out = (margins(servo, factor * limit, drive=drive) for factor in (within, beyond))
        assert at.stable and not out.stable
        assert radius(servo, within * limit, drive) < 1 < radius(servo, beyond * limit, drive)
    A, b, c = opened(servo, limit, drive)
    values = np.linalg.eigvals(A - np.outer(b, c))
    assert bool(abs(values + 1).min() < 1e-9) is (delay == 0)  # with one a pair leaves it first


def test_a_servo_whose_loop_is_larger_than_one_at_every_frequency():
    """No crossover up to pi/T: it is unstable."""
    servo, drive = Servo(), Drive(sample_time=0.1)
    assert radius(servo, 1e3, drive) > 1
    assert (np.abs(response(servo, 1e3, drive, np.linspace(0.1, 1, 200) * math.pi / 0.1)) > 1).all()
    found = margins(servo, 1e3, drive=drive)
    assert not found.stable and found.frequency == pytest.approx(math.pi / 0.1) and found.phase_margin <= 0
