"""The linear loop of a controller by gains: several crossovers, delay, against poles and polynomials' roots."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from casahunt import Friction, Pid, Servo
from casahunt.design.tune.loop_set import loop_box
from casahunt.servo.gains import integral_gain, lowest_stable_gain, typical_gain
from casahunt.servo.linear.linear_loop import linear_loop
from casahunt.servo.linear.margins import margins
from casahunt.servo.linear.open_loop import open_loop
from casahunt.servo.linear.sampled_loop import Lag

UNEVEN = Servo().replace(**{"controller.lead_time": 0.09, "controller.integral_time": 0.21})
COMPLEX = Servo(controller=Pid(kp=1.0, ki=6.0, kd=0.15))
STEEP = COMPLEX.replace(**{"controller.ki": 40.0})


def generator(servo: Servo, gain: float, delay: float, points: int = 50) -> np.ndarray:
    """Rightmost poles of the loop with delay: Chebyshev collocation of its solution operator's generator."""
    J, sigma2, c = servo.inertia, servo.friction.viscous, servo.controller
    kp, ki, kd = (gain * servo.motor_gain * value for value in (c.kp, c.ki, c.kd))
    A = np.array([[-sigma2 / J, 0, 0], [1, 0, 0], [0, 1, 0]])
    B = np.array([[-kd / J, -kp / J, -ki / J], [0, 0, 0], [0, 0, 0]])
    if delay == 0:
        return np.linalg.eigvals(A + B)
    k = np.arange(points + 1)
    x = np.cos(np.pi * k / points)
    weights = np.where((k == 0) | (k == points), 2, 1) * (-1.0) ** k
    D = np.outer(weights, 1 / weights) / (x[:, None] - x[None, :] + np.eye(points + 1))
    D = (D - np.diag(D.sum(axis=1))) * 2 / delay
    M = np.kron(D, np.eye(3))
    M[:3] = 0
    M[:3, :3], M[:3, -3:] = A, B
    return np.linalg.eigvals(M)


def random_loops(n: int, seed: int) -> list[tuple[Servo, float]]:
    rng = np.random.default_rng(seed)
    loops = []
    for _ in range(n):
        kp, (J, ki, kd) = 10 ** rng.uniform(-1.5, 1), 10 ** rng.uniform(-1, 1, 3)
        friction = Friction(viscous=float(rng.choice([0.0, 0.1, 0.4, 2.0])))
        servo = Servo(inertia=J, motor_gain=1.0, controller=Pid(kp=kp, ki=ki, kd=kd), friction=friction)
        loops.append((servo, float(rng.choice([0.0, 0.01, 0.1, 0.5, 2.0]))))
    return loops


RETURNING = (
    (0.28, 5.0, 1.886, 0.8, 5.16, 2.0),
    (0.52, 5.0, 0.964, 0.52, 5.24, 2.0),
    (0.13, 5.0, 0.383, 0.13, 1.13, 2.0),
    (0.15, 5.0, 0.351, 0.12, 2.34, 4.0),
)
"""J, sigma2, kp, ki, kd, D of loops that are stable beyond a whole turn of phase: delay makes them unstable, and stable
again where |L| rises, or the gain's limit is at a turn below -360 degrees."""


def returning_loops() -> list[tuple[Servo, float]]:
    loops = []
    for J, sigma2, kp, ki, kd, delay in RETURNING:
        controller, friction = Pid(kp=kp, ki=ki, kd=kd), Friction(viscous=sigma2)
        loops.append((Servo(inertia=J, motor_gain=1.0, controller=controller, friction=friction), delay))
    return loops


@pytest.mark.parametrize("n", [20, pytest.param(120, marks=pytest.mark.slow)])
def test_margins_are_where_poles_cross(n):
    """Stable where no pole is to the right; on the axis at both gain factors, and nowhere between them."""
    several = 0
    for servo, delay in [*returning_loops(), *random_loops(n, seed=1)]:
        found, poles = margins(servo, 1.0, delay=delay), generator(servo, 1.0, delay)
        several += len(linear_loop(servo, 1.0).gain_crossovers) > 1
        assert abs(poles.real.max()) < 1e-6 or found.stable == (poles.real.max() < 0)
        assert found.stable == (found.phase_margin > 0)
        if not found.stable:
            continue
        for factor in (found.lowest_factor, found.highest_factor):
            if 1e-3 < factor < 1e3:
                assert np.abs(generator(servo, factor, delay).real).min() < 1e-5
        between = max(found.lowest_factor, 0.05) * 1.01, min(found.highest_factor, 20) * 0.99
        for factor in np.geomspace(*between, 5) if between[0] < between[1] else ():
            assert generator(servo, float(factor), delay).real.max() < 1e-6
        # As much phase as the margin says is missing: a rotation by it puts a pole on the axis, L = -1.
        s = 1j * found.frequency
        L = complex(open_loop(servo, 1.0).response(np.array([found.frequency]))[0]) * np.exp(-s * delay)
        assert L * np.exp(-1j * np.radians(found.phase_margin)) == pytest.approx(-1, abs=1e-8)
    assert several > n / 20


def test_the_worst_loop_of_a_set_is_that_of_all_crossovers():
    """phi by crossovers bisected for many loops at once, against those from the roots of a polynomial."""
    several = 0
    for servo, delay in [*returning_loops(), *random_loops(300, seed=2)]:
        found = linear_loop(servo, 1.0).gain_crossovers
        several += len(found) > 1
        # Without delay phi is between -90 and 180 degrees, as the margins are.
        least = min(math.radians(c.margin) - c.frequency * delay for c in found)
        assert loop_box(servo, {}, Lag(delay)).worst(1.0, (1.0, 1.0)).phase == pytest.approx(least, abs=1e-7)
    assert several > 15


def test_times_and_gains_of_the_right_size():
    """1/|zero|, the derivative's first; J/(cm tau_i^2) without derivative action, in both forms."""
    for controller in (COMPLEX.controller, Pid(kp=3.0, ki=1.0, kd=0.2), UNEVEN.controller, UNEVEN.controller.pid()):
        kp, kd, ki = controller.torque_gains(1.0)
        assert sorted(controller.corners) == pytest.approx(sorted(1 / np.abs(np.roots([kd, kp, ki]))), rel=1e-12)
    assert Pid(kp=2.0, ki=4.0, kd=0.0).corners == (0.0, 0.5)
    times = UNEVEN.replace(**{"controller.lead_time": 0.0})
    other = replace(times, controller=times.controller.pid())
    assert integral_gain(other) == pytest.approx(integral_gain(times), rel=1e-14)
    assert typical_gain(times) == integral_gain(times) == pytest.approx(0.026 / (16 * 0.21**2))


def test_poles_are_the_roots_of_the_characteristic_polynomial():
    loop = linear_loop(COMPLEX, 0.6)
    expected = np.roots([0.026, 0.6 * 16 * 0.15 + 0.1, 0.6 * 16 * 1.0, 0.6 * 16 * 6.0])
    np.testing.assert_allclose(np.sort_complex(loop.poles), np.sort_complex(expected), rtol=1e-12)
    limit = lowest_stable_gain(STEEP)
    for factor, stable in ((0.999, False), (1.001, True)):
        roots = np.roots([0.026, limit * factor * 16 * 0.15 + 0.1, limit * factor * 16, limit * factor * 16 * 40.0])
        assert (roots.real.max() < 0) == stable == linear_loop(STEEP, limit * factor).stable
