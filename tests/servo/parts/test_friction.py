"""Friction as parts: a table of it, and friction on either of two masses or on both."""

import math

import casadi as ca
import numpy as np
import pytest

from casahunt import InputError, Options, Servo, find_orbit
from casahunt.orbits import find_cycle
from casahunt.servo.parts import (
    BY_DIRECTION,
    FEEDFORWARD,
    INERTIA,
    INTEGRATOR,
    LOAD_SWITCH,
    NO_FRICTION,
    PID_BY_GAINS,
    SWITCH,
    TWO_MASSES,
    TWO_MASSES_LOAD_SEEN,
    WITH_EXPONENT,
    Loop,
    friction_table,
)
from casahunt.servo.parts.tabulated import interpolated
from casahunt.servo.parts.verbs import loop_cycle

CONTROLLER = (PID_BY_GAINS, INTEGRATOR)
TABLE = np.array([0.0, 0.01, 0.02, 0.05, 0.2, 1.0]), np.array([0.53, 0.5, 0.46, 0.44, 0.45, 0.54])
HALVES = {"inertia": 0.013, "load_inertia": 0.013, "shaft_damping": 1.0}


def cycle_of(*parts, **values):
    loop = Loop(parts, values)
    start = loop.state(x1=-0.05, **({"load_angle": -0.05} if "load_inertia" in values else {}))
    return find_cycle(loop.system, loop.mode_at(**start), start=start, follow="gain", tol=1e-9)


@pytest.fixture(scope="module")
def plain():
    return find_orbit(Servo(), "switch", 0.04, options=Options(tol=1e-9))


@pytest.mark.parametrize("entries", [
    TABLE, (TABLE[0][1:], TABLE[1][1:]), ([0.0, 1.0], [0.4, 0.5]), ([0.0, 0.1, 1.0], [0.4, 0.5, 0.6]),
    ([0.0, 0.01, 0.02, 0.03, 0.04, 0.05], [0.5, 0.4, 0.41, 0.41, 0.3, 0.301]),
])  # fmt: skip
def test_the_cubic_is_that_of_scipy(entries):
    scipy_interpolate = pytest.importorskip("scipy.interpolate")
    v = ca.SX.sym("v")
    curve = ca.Function("curve", [v], [interpolated(tuple(zip(*entries, strict=True)), v)])
    at = np.linspace(entries[0][0], entries[0][-1], 501)
    expected = scipy_interpolate.PchipInterpolator(*entries)(at)
    assert np.asarray(curve(at[None, :])).ravel() == pytest.approx(expected, abs=1e-15)
    beyond = np.asarray(curve(np.array([[1.0, 2.0, 3.0]]) * entries[0][-1])).ravel()
    assert np.diff(beyond, 2) == pytest.approx(0.0, abs=1e-15) and (np.diff(beyond) >= 0).all()


def test_a_table_of_the_stribeck_curve_gives_its_cycle(plain):
    """In the second order of the distance of its entries, and not better: the slope at an entry is of the second."""
    errors = []
    for n in (16, 32, 64):
        u = np.linspace(0, 1, n + 1)
        v = 0.08 * u / (1 - 0.95 * u)  # denser where the curve falls
        table = friction_table(v, 0.44 + 0.09 * np.exp(-((v / 0.02) ** 2)) + 0.1 * v)
        errors.append(abs(cycle_of(INERTIA, table, *CONTROLLER).period / plain.period - 1))
    assert errors[-1] < 1e-4 and 1.7 < np.log2(errors[0] / errors[-1]) / 2 < 2.7


def test_a_table_of_both_signs_is_friction_by_direction():
    v, m = TABLE
    both = np.r_[-v[::-1], v], np.r_[-1.1 * m[::-1], m]
    lopsided = cycle_of(INERTIA, friction_table(*both), *CONTROLLER)
    turned = cycle_of(INERTIA, friction_table(-both[0][::-1], -both[1][::-1]), *CONTROLLER)
    assert not lopsided.half and len(lopsided.arcs) == 4
    assert [turned.period, turned.amplitude] == pytest.approx([lopsided.period, lopsided.amplitude], rel=1e-8)
    one = cycle_of(INERTIA, friction_table(*TABLE), *CONTROLLER)
    same = cycle_of(INERTIA, friction_table(np.r_[-v[::-1], v], np.r_[-m[::-1], m]), *CONTROLLER)
    assert one.half and same.period == pytest.approx(one.period, rel=1e-9)


@pytest.mark.parametrize(("velocity", "torque", "more", "sentence"), [
    ([0.0, 0.02, 0.02], [0.5, 0.4, 0.4], {}, r"entry 3: velocity = 0.02 behind 0.02 rad/s: velocities must rise"),
    ([0.0, 0.02, 0.01], [0.5, 0.4, 0.4], {}, r"entry 3: velocity = 0.01 behind 0.02"),
    ([0.0, 0.02], [0.5, -0.4], {}, r"entry 2: torque = -0.4 at 0.02 rad/s: must have the sign of the velocity"),
    ([-0.1, 0.0, 0.02], [0.5, 0.5, 0.4], {}, r"entry 1: torque = 0.5 at -0.1 rad/s: must have the sign"),
    ([0.0, 0.02], [0.5, float("nan")], {}, r"entry 2: torque = nan: must be a finite number"),
    ([0.0, "fast"], [0.5, 0.4], {}, r"entry 2: velocity = 'fast': must be a finite number"),
    ([0.0], [0.5], {}, r"1 entries with v >= 0: must be at least 2"),
    ([-0.1, 0.0, 0.1], [-0.4, 0.5, 0.4], {}, r"1 entries with v <= 0: must be at least 2"),
    ([-0.1, 0.0], [-0.4, -0.5], {}, r"0 entries with v >= 0: must be at least 2"),
    ([0.0, 0.02, 0.1], [0.5, 0.4], {}, r"3 velocities and 2 torques"),
    ([0.0, 0.02], [0.5, 0.4], {"static": 0.4}, r"static = 0.4: must be at least the table's at v = 0, 0.5 N m"),
])  # fmt: skip
def test_tables_that_are_refused(velocity, torque, more, sentence):
    with pytest.raises(InputError, match=sentence):
        friction_table(velocity, torque, **more)


def test_a_number_that_no_part_has_is_named():
    loop = Loop((INERTIA, friction_table(*TABLE), *CONTROLLER, FEEDFORWARD), {"compensated": 0.1})
    with pytest.raises(InputError, match="no part of the loop has the parameter 'coulomb'"):
        loop.system  # noqa: B018


def test_modes_of_both_masses_are_products():
    loop = Loop((TWO_MASSES, SWITCH, LOAD_SWITCH, *CONTROLLER))
    flows = {mode.name: mode.flow is not None for mode in loop.system.modes}
    assert len(flows) == 9 and [name for name, flow in flows.items() if flow] == ["stick, load stick"]
    assert loop.mode_at(**loop.state(x2=0.1, load_rate=-0.1)) == "slip+, load slip-"
    assert loop.mode_at(**loop.state(load_angle=0.1)) == "slip+, load slip-"  # the shaft pulls both towards each other


@pytest.mark.parametrize("plant", [pytest.param(TWO_MASSES, marks=pytest.mark.slow), TWO_MASSES_LOAD_SEEN])
def test_friction_of_both_masses_adds_up_where_the_shaft_is_stiff(plain, plant):
    half = {"static": 0.265, "coulomb": 0.22, "viscous": 0.05}
    half |= {f"load_{name}": value for name, value in half.items()} | HALVES
    two = [cycle_of(plant, SWITCH, LOAD_SWITCH, *CONTROLLER, **half, shaft_stiffness=k).period for k in (5e4, 1e5)]
    assert 2 * two[1] - two[0] == pytest.approx(plain.period, rel=1e-8)


def test_friction_of_the_load_alone(plain):
    """With a stiff shaft that of the plain servo; and by direction of the motor beside it, 9 modes again."""
    stiff = cycle_of(TWO_MASSES_LOAD_SEEN, NO_FRICTION, LOAD_SWITCH, *CONTROLLER, **HALVES, shaft_stiffness=1e5)
    assert {arc.mode for arc in stiff.arcs} <= {"load slip+", "load slip-", "load stick"}
    assert stiff.period == pytest.approx(plain.period, rel=1e-4)
    assert len(Loop((TWO_MASSES, BY_DIRECTION, LOAD_SWITCH, *CONTROLLER)).system.modes) == 9


@pytest.mark.parametrize("exponent", [0.7, 1.0, 2.0])
def test_an_exponent_of_the_stribeck_curve(exponent, plain):
    """A slip by scipy from the brink at the cycle's place ends as far on the other side; of 2 it is the servo's own."""
    integrate = pytest.importorskip("scipy.integrate")
    loop = Loop((INERTIA, WITH_EXPONENT, *CONTROLLER), {"stribeck_exponent": exponent, "gain": 0.04})
    cycle = loop_cycle(loop, options=Options(tol=1e-9))
    a, (kp, kd, ki) = cycle.amplitude, Servo().torque_gains(0.04)

    def rate(t, y):
        friction = 0.44 + 0.09 * math.exp(-((max(y[1], 0.0) / 0.02) ** exponent)) + 0.1 * y[1]
        return [y[1], (-(kp * y[0] + kd * y[1] + ki * y[2]) - friction) / 0.026, y[0]]

    def stop(t, y):
        return y[1] if t > 1e-3 else 1.0

    stop.terminal = True
    start = [-a, 0.0, (kp * a - 0.53 * (1 + 1e-12)) / ki]
    slip = integrate.solve_ivp(rate, (0, 10), start, events=stop, rtol=1e-12, atol=1e-14, method="DOP853")
    assert slip.y[0, -1] == pytest.approx(a, rel=1e-7)
    if exponent == 2.0:
        assert cycle.period == pytest.approx(plain.period, rel=2e-9)
