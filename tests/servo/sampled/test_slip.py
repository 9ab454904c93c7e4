"""A slip under a constant torque, against quadrature of the time that each speed takes."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad

import problems
from casahunt import Friction, Servo
from casahunt.servo.parts import load_loop, loop_of
from casahunt.servo.sampled.plant import Plant, first_rise, plant_of

J, FS, FC, VS, SIGMA2 = 0.012, 0.4, 0.3, 0.05, 0.02
FRICTION = Friction(static=FS, coulomb=FC, stribeck_velocity=VS, viscous=SIGMA2)


SERVO = Servo(inertia=J, friction=FRICTION)
FAR = 32 * VS


def slips(x: float, v: float, m: float, lasts: float, servo: Servo = SERVO) -> tuple[float, float, list[float]]:
    """(x1, v) after so many seconds of a torque, and the times of the stops."""
    plant = Plant(plant_of(loop_of(servo, "switch", 1.0))[0], {"x1": x, "x2": v, "held": m})
    stops = plant(m, lasts)
    return float(plant.x[0]), float(plant.x[1]), stops


def rate(v: float, m: float) -> float:
    """v' of a slip with v > 0."""
    return (m - FC - (FS - FC) * math.exp(-((v / VS) ** 2)) - SIGMA2 * v) / J


def until_stop(v: float, m: float) -> tuple[float, float]:
    """(time, way) until a slip stops: dt = dv/v', dx = v dv/v'."""
    pieces = [VS * k / 2 for k in range(1, 13) if VS * k / 2 < v]
    how = {"points": pieces or None, "limit": 400, "epsabs": 0.0, "epsrel": 1e-13}
    return tuple(-quad(lambda u, k=k: u**k / rate(u, m), 0, v, **how)[0] for k in (0, 1))


SPEEDS, TORQUES = (1e-6, 0.01, 0.05, 0.3, 2.0), (0.35, 0.0, -0.39, -6.0, -300.0)
STOPPING = [(v, m) for v in SPEEDS for m in TORQUES if m < FC or v < 0.03]
"""Speeds and torques; above Fc a fast slip does not stop."""


@pytest.mark.parametrize("v, m", STOPPING)
def test_a_slip_stops_when_and_where_its_speeds_say(v, m):
    """Fast ones too, whose drop of the friction is passed in a small part of a step."""
    time, way = until_stop(v, m)
    x, end, stops = slips(0.0, v, m, 1.5 * time if m > -FS else time * (1 + 1e-9))
    assert stops[0] == pytest.approx(time, rel=1e-11)
    assert x == pytest.approx(way, rel=1e-11)
    assert abs(end) <= abs(rate(0.0, m)) * time * 1e-8
    mirrored = slips(0.0, -v, -m, stops[0])
    assert mirrored[0] == pytest.approx(-way, rel=1e-11)


def test_it_passes_the_drop_of_the_friction_however_fast_it_comes():
    """A step from far above would not see the drop: its series does not show it."""
    v = FAR
    time, way = until_stop(v, -11.6)
    x, _, stops = slips(0.0, v, -11.6, 2 * time)
    assert stops[0] == pytest.approx(time, rel=1e-12)


def test_it_stays_stuck_up_to_static_friction_and_breaks_away_beyond():
    assert slips(0.3, 0.0, FS, 1.0) == (0.3, 0.0, [])
    x, v, stops = slips(0.3, 0.0, -FS - 1e-9, 1e-3)
    assert x < 0.3 and not stops
    assert v == pytest.approx(-1e-9 / J * 1e-3, rel=0.1)  # next to rest nothing has cancelled
    assert slips(0.3, 0.0, -FS - 1e-9, 1e-3)[1] == v


@pytest.mark.parametrize("v", [0.01, -0.01])
def test_what_has_stopped_has_no_sign(v):
    end = slips(0.0, v, 0.0, 1.0)[1]
    assert end == 0 and math.copysign(1.0, end) == 1


def test_a_reversal_goes_on_to_the_other_side():
    x, v, stops = slips(0.0, 0.1, -6.0, 1e-3)
    assert len(stops) == 1 and v < 0 and math.copysign(1.0, v) == -1


def test_a_polynomial_that_leaves_zero_and_comes_back_at_once_rises_where_it_comes_back():
    """-a t + b t^2: at a/b, however soon; one that begins on zero and rises does so there."""
    for a, b in ((2e-4, 0.031), (1e-9, 1.0), (0.3, 0.31)):
        assert first_rise(np.array([0.0, -a, b, 0.0])) == pytest.approx(a / b, rel=1e-12)
    assert first_rise(np.array([0.0, 1e-3, -1.0])) == 0.0
    assert first_rise(np.array([0.0, -1.0, 0.5])) == math.inf and first_rise(np.zeros(4)) == math.inf


def test_a_motor_that_breaks_away_where_its_rate_is_rounding_moves():
    """A ringing load pulls it off: v = pull' t^2/(2 J) at first, pull' = k w + d w' by the load; v' is a rounding."""
    axis = load_loop(Path(problems.__file__).with_name("belt_axis.toml"))
    state = {"x1": 3.1169853548191835e-05, "load_angle": 2.5994138151376754e-05, "load_rate": -0.002165096021109549}
    for name in ("stick", "slip-"):
        plant = Plant(plant_of(axis)[0], state | {"held": -49.96694637052056})
        plant._enter(name)
        t = 2e-5
        plant(-49.96694637052056, t)
        k, d, w = axis.value("shaft_stiffness"), axis.value("shaft_damping"), state["load_rate"]
        bends = (k * (state["x1"] - state["load_angle"]) - d * w) / axis.value("load_inertia")
        v = plant.x[plant.names.index("x2")]
        assert v == pytest.approx((k * w + d * bends) * t**2 / 2 / axis.value("inertia"), rel=0.02)
