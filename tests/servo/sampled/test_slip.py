"""A slip under a constant torque, against quadrature of the time that each speed takes."""

from __future__ import annotations

import math

import pytest
from scipy.integrate import quad

from casahunt import Friction, Servo
from casahunt.servo.parts import loop_of
from casahunt.servo.sampled.plant import Plant, plant_of

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
