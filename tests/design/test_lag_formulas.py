"""The formulas of the loop with delay, stated once for numbers and expressions, against L(s) in complex numbers."""

from __future__ import annotations

import cmath
import math

import casadi as ca
import numpy as np
import pytest

from casahunt import Servo
from casahunt.design.tune.lag import log_magnitude, phase
from casahunt.servo.linear.margins import crossover, margins

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


@pytest.mark.parametrize("servo", SERVOS)
def test_the_formulas_are_those_of_the_loop(servo):
    """ln |L|^2 and arg L + pi, to the rounding of their largest term; an expression gives what a number gives."""
    lead, integral = servo.controller.lead_time, servo.controller.integral_time
    q = (math.log(lead) if lead else -math.inf, math.log(integral))
    J, cm, sigma2, gain, delay = servo.inertia, servo.motor_gain, servo.friction.viscous, 0.3, 2e-3
    omegas = np.geomspace(1e-2, 1e3, 11)
    for y in np.log(omegas).tolist():
        size, phi = log_magnitude(J, cm, sigma2, math.log(gain), q, y), phase(J, sigma2, delay, q, y)
        L = loop(servo, gain, delay, math.exp(y))
        assert size == pytest.approx(2 * math.log(abs(L)), rel=1e-14, abs=1e-13)
        assert math.remainder(phi - math.pi - cmath.phase(L), 2 * math.pi) == pytest.approx(0, abs=2e-14)
        symbol = ca.MX.sym("y")
        both = [log_magnitude(J, cm, sigma2, math.log(gain), q, symbol), phase(J, sigma2, delay, q, symbol)]
        values = [float(v) for v in ca.Function("f", [symbol], both)(y)]
        assert values == pytest.approx([size, phi], rel=1e-14, abs=1e-13)
    many = phase(J, sigma2, delay, q, np.log(omegas))
    assert many.shape == omegas.shape and many[0] == pytest.approx(
        phase(J, sigma2, delay, q, math.log(1e-2)), rel=1e-14
    )


@pytest.mark.parametrize("servo", SERVOS[::2])
def test_margins_are_where_the_loop_says(servo):
    """|L| = level at a crossover; at the gain factors L passes through -1."""
    for level in (0.1, 1.0, 30.0):
        assert abs(loop(servo, 0.3, 0.0, crossover(servo, 0.3, level))) == pytest.approx(level, rel=1e-13)
    gain = 0.3 if servo.friction.viscous else 400.0
    found = margins(servo, gain, delay=1e-4)
    assert found.stable and 0 <= found.lowest_factor < 1 < found.highest_factor < math.inf
    arg = cmath.phase(loop(servo, gain, 1e-4, found.frequency))
    assert found.phase_margin == pytest.approx(math.degrees(arg + math.pi), abs=1e-11)
    for factor in filter(None, (found.lowest_factor, found.highest_factor)):
        at = loop(servo, gain, 1e-4, crossover(servo, gain, 1 / factor))
        assert abs(factor * at + 1) < 1e-11
