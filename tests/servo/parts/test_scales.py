"""The answer of an axis in other units of length and time is the same one: of a stage that moves by micrometres too."""

import numpy as np
import pytest

from casahunt import find_orbit, simulate
from casahunt.servo.parts import (
    INERTIA,
    INTEGRATOR,
    LOAD_SWITCH,
    LUGRE,
    NO_FRICTION,
    PID_BY_GAINS,
    PID_BY_TIMES,
    SWITCH,
    TORQUE_LIMIT,
    TWO_MASSES_LOAD_SEEN,
    Loop,
    series,
    transfer_function,
)
from casahunt.servo.parts.ahead import errors_of

DIMENSIONS = {
    "inertia": (-1, 2), "viscous": (-1, 1), "stribeck_velocity": (1, -1), "stiffness": (-1, 0), "damping": (-1, 1),
    "lead_time": (0, 1), "integral_time": (0, 1), "gain": (-1, 0),
}  # fmt: skip
"""Powers of the units of length and of time; the torque's stays."""


def in_units(loop, length, time):
    sizes = {name: DIMENSIONS.get(name, (0, 0)) for name in loop.parameters}
    return loop.replace(**{name: loop.value(name) * length**a * time**b for name, (a, b) in sizes.items()})


@pytest.mark.parametrize("friction", [SWITCH, LUGRE])
@pytest.mark.parametrize(("length", "time"), [(1e-6, 1.0), (1e4, 1e-3), (1e-5, 1e-4)])
def test_a_limited_torque_hunts_in_every_unit(friction, length, time):
    """From far away it winds up for ever: where "far" was a radian, a metre was taken for it."""
    loop = Loop((INERTIA, friction, PID_BY_TIMES, INTEGRATOR, TORQUE_LIMIT), {"gain": 0.1, "torque_limit": 0.7})
    cycle, other = find_orbit(loop), find_orbit(in_units(loop, length, time))
    assert other.amplitude / length == pytest.approx(cycle.amplitude, rel=1e-8)
    assert other.period / time == pytest.approx(cycle.period, rel=1e-8) and other.stable


def test_behind_a_filter_too():
    """A low-pass of 100 rad/s, whose torque begins with nothing; a controller by its transfer function, 2 + 6.28/s."""
    pid = INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR, TORQUE_LIMIT
    controller = transfer_function([0.16, 2, 6.28], [1e-3, 1, 0])
    for parts in ((*pid, series("low-pass")), (INERTIA, SWITCH, controller, TORQUE_LIMIT)):
        loop = Loop(parts, {"gain": 0.1, "torque_limit": 0.7})
        cycle, other = find_orbit(loop), find_orbit(in_units(loop, 1e-6, 1.0))
        assert errors_of(loop)[0] == pytest.approx(0.53 / (0.1 * 16 * 2), rel=0.01)  # kp = 2
        cycle, other = find_orbit(loop), find_orbit(in_units(loop, 1e-6, 1.0))
        assert other.amplitude / 1e-6 == pytest.approx(cycle.amplitude, rel=1e-8)
        assert other.period == pytest.approx(cycle.period, rel=1e-8)


def test_what_winds_down_from_far_away_does_not_hunt_there():
    """Under a torque of 0.6 N m it comes down from 1000 rad by half a per cent a swing, and from 100 rad to a cycle."""
    parts = INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR, TORQUE_LIMIT
    loop = Loop(parts, {"gain": 0.1, "torque_limit": 0.6})
    far, nearer = (simulate(loop, position=x, set_point=0.0, time=10.0).verdict for x in (1000.0, 100.0))
    assert far.kind == "undecided" and "becomes smaller from swing to swing" in far.sentence
    assert nearer.kind == "hunting" and nearer.amplitude == pytest.approx(find_orbit(loop).amplitude, rel=1e-3)
    assert (np.diff(far.swings) < 0).all()


def test_friction_of_the_load_alone_breaks_away_as_that_of_the_motor():
    """Fs/(K cm kp), whichever mass it acts on: 0.5 N m over 0.1 * 16 * 2 N m/rad, here of micrometres."""
    parts = TWO_MASSES_LOAD_SEEN, NO_FRICTION, LOAD_SWITCH, PID_BY_GAINS, INTEGRATOR
    loop = Loop(parts, {"gain": 0.1e6, "kp": 2.0, "motor_gain": 16.0, "load_static": 0.5, "load_coulomb": 0.4})
    assert errors_of(loop)[0] == pytest.approx(0.5 / 3.2e6, rel=1e-12)
