"""The loops that a search has in the place of sampled ones, against the sampled loop itself."""

from __future__ import annotations

import math

import numpy as np
import pytest

from casahunt import Drive, Pid, Servo
from casahunt.design.tune.demands import Demands
from casahunt.design.tune.loop_set import _loops_of, _phase, loop_box
from casahunt.servo.linear.sampled_loop import sampled_response


@pytest.mark.parametrize("integration", ["rectangle", "trapezoid"])
@pytest.mark.parametrize("late", [0, 1, 5])
@pytest.mark.parametrize("viscous, off", [(0.0, 1e-11), (0.1, 5e-5)])
def test_size_and_phase_are_those_of_the_sampled_loop(integration, late, viscous, off):
    """Exact without viscous friction; with it to the second order of sigma2 T/(2 J), here 0.019."""
    T, kappa = 0.01, 0.7 * 16.0
    servo = Servo(controller=Pid(kp=1.3, ki=4.0, kd=0.15)).replace(**{"friction.viscous": viscous})
    drive = Drive(sample_time=T, delay=late * T, integration=integration)
    omega = np.array([0.05, 0.2, 0.4, 0.6]) * math.pi / T
    exact = sampled_response(servo, 0.7, drive, omega)
    box = loop_box(servo, {}, Demands(drive=drive).lag)
    loop = _loops_of(box.low[None, :-1], box.lag)
    J, sigma2, kp, ki, kd = loop[:, 0]
    v = np.tan(omega * T / 2) * 2 / T
    size = kappa * np.hypot(kp * v, kd * v**2 - ki) / (v**2 * np.hypot(J * v, sigma2))
    assert size == pytest.approx(np.abs(exact), rel=off)
    turned = np.exp(1j * (_phase(loop, v, box.lag) - math.pi)) / (exact / np.abs(exact))
    assert np.abs(np.angle(turned)).max() < off
