"""Continuous loops with delay, or that stand for sampled ones, against L(s) and L(z) in complex numbers."""

from __future__ import annotations

import cmath
import math

import casadi as ca
import numpy as np
import pytest

from casahunt import Drive, Pid, Servo
from casahunt.design.tune.demands import Demands
from casahunt.servo.linear.linear_loop import linear_loop
from casahunt.servo.linear.margins import margins
from casahunt.servo.linear.pulse_transfer import pulse_transfer
from casahunt.servo.linear.sampled_loop import Lag, squared_size
from casahunt.servo.parts import loop_of

SERVOS = (
    Servo(),
    Servo().replace(**{"controller.lead_time": 0.0}),
    Servo().replace(**{"friction.viscous": 0.0, "controller.integral_time": 0.01, "servo.inertia": 0.5}),
)


def loop(servo: Servo, gain: float, delay: float, omega: float) -> complex:
    """L(i omega) = K cm (1 + tau_d s)(1 + tau_i s)/(tau_i s) / (s (J s + sigma2)) exp(-s D)."""
    s = complex(0, omega)
    lead, integral = servo.controller.lead_time, servo.controller.integral_time
    controller = gain * servo.motor_gain * (1 + lead * s) * (1 + integral * s) / (integral * s)
    return controller / (s * (servo.inertia * s + servo.friction.viscous)) * cmath.exp(-s * delay)


def crossover(servo: Servo, gain: float) -> float:
    """The largest frequency at which |L| = 1."""
    return linear_loop(servo, gain).gain_crossovers[-1].frequency


@pytest.mark.parametrize("servo", SERVOS)
def test_the_formulas_are_those_of_the_loop(servo):
    """|L|^2 and arg L + pi, to rounding; an expression gives what a number gives."""
    gain, lag, omegas, symbol = 0.3, Lag(delay=2e-3), np.geomspace(1e-2, 1e3, 11), ca.MX.sym("omega")
    own = (servo.inertia, servo.friction.viscous, *servo.torque_gains(gain))
    assert lag.seen(*own) == own
    function = ca.Function("f", [symbol], [squared_size(own, symbol), lag.phase(own, symbol)])
    for omega, phi in zip(omegas.tolist(), lag.phase(own, omegas), strict=True):
        L = loop(servo, gain, lag.delay, omega)
        size = squared_size(own, omega)
        assert size == pytest.approx(abs(L) ** 2, rel=1e-14)
        assert math.remainder(phi - math.pi - cmath.phase(L), 2 * math.pi) == pytest.approx(0, abs=2e-14)
        assert [float(v) for v in function(omega)] == pytest.approx([size, phi], rel=1e-14, abs=1e-13)


@pytest.mark.parametrize("integration", ["rectangle", "trapezoid"])
@pytest.mark.parametrize("late", [0, 1, 5])
@pytest.mark.parametrize("viscous, off", [(0.0, 1e-11), (0.1, 5e-5)])
def test_size_and_phase_are_those_of_the_sampled_loop(integration, late, viscous, off):
    """Exact without viscous friction; with it to the second order of sigma2 T/(2 J), here 0.019."""
    T, servo = 0.01, Servo(controller=Pid(kp=1.3, ki=4.0, kd=0.15)).replace(**{"friction.viscous": viscous})
    drive = Drive(sample_time=T, delay=late * T, integration=integration)
    omega = np.array([0.05, 0.2, 0.4, 0.6]) * math.pi / T
    exact = pulse_transfer(loop_of(servo, "switch", 0.7), drive).response(omega)
    lag, v = Demands(drive=drive).lag, np.tan(omega * T / 2) * 2 / T
    seen = lag.seen(servo.inertia, viscous, *servo.torque_gains(0.7))
    assert np.sqrt(squared_size(seen, v)) == pytest.approx(np.abs(exact), rel=off)
    turned = np.exp(1j * (lag.phase(seen, v) - math.pi)) / (exact / np.abs(exact))
    assert np.abs(np.angle(turned)).max() < off


@pytest.mark.parametrize("servo", SERVOS[::2])
def test_margins_are_where_the_loop_says(servo):
    """|L| = level at a crossover; at the gain factors L passes through -1."""
    for level in (0.1, 1.0, 30.0):
        assert abs(loop(servo, 0.3, 0.0, crossover(servo, 0.3 / level))) == pytest.approx(level, rel=1e-13)
    gain = 0.3 if servo.friction.viscous else 400.0
    found = margins(servo, gain, delay=1e-4)
    assert found.stable and 0 <= found.lowest_factor < 1 < found.highest_factor < math.inf
    arg = cmath.phase(loop(servo, gain, 1e-4, found.frequency))
    assert found.phase_margin == pytest.approx(math.degrees(arg + math.pi), abs=1e-11)
    for factor in filter(None, (found.lowest_factor, found.highest_factor)):
        at = loop(servo, gain, 1e-4, crossover(servo, gain * factor))
        assert abs(factor * at + 1) < 1e-11
