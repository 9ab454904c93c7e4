"""Equilibria: the segment by the equations of motion, the generalised Jacobian by differences and dense grids."""

from __future__ import annotations

import json

import numpy as np
import pytest

from casahunt import Servo, cli, simulate
from casahunt.servo.equilibria import equilibria
from casahunt.servo.gains import lowest_stable_gain
from casahunt.servo.linear.linear_loop import linear_loop
from casahunt.servo.parts import (
    BY_DIRECTION,
    DEAD_BAND,
    FREEZE,
    INERTIA,
    INTEGRATOR,
    LEAK,
    LOAD_SWITCH,
    LOADS,
    LUGRE,
    PID_BY_GAINS,
    PID_BY_TIMES,
    REMEDIES,
    SWITCH,
    TWO_MASSES,
    Loop,
    loop_of,
    transfer_function,
)

SMOOTH = Servo().replace(**{"friction.viscous": 0.02})  # sigma2 < J/(tau_i + tau_d): unstable members at small gains


def field(servo: Servo, gain: float, x: np.ndarray) -> np.ndarray:
    """The LuGre servo written out once more, from the report's state equation."""
    f = servo.friction
    kp, kd, ki = servo.torque_gains(gain)
    g = f.coulomb + (f.static - f.coulomb) * np.exp(-((x[1] / f.stribeck_velocity) ** 2))
    rate = x[1] - f.stiffness * abs(x[1]) * x[3] / g
    friction = f.stiffness * x[3] + f.damping * rate + f.viscous * x[1]
    return np.array([x[1], (-kp * x[0] - kd * x[1] - ki * x[2] - friction) / servo.inertia, x[0], rate])


def cubic(servo: Servo, gain: float, c: float) -> np.ndarray:
    """The cubic factor of det(s - A) J of a member of the generalised Jacobian, by hand: highest power first."""
    f = servo.friction
    kp, kd, ki = servo.torque_gains(gain)
    return np.array([servo.inertia, kd + f.viscous + f.damping * c, kp + f.stiffness * c, ki])


@pytest.mark.parametrize("share", [-1.0, -0.3, 0.0, 0.7, 1.0])
def test_segment_and_one_sided_jacobians(share):
    """At z = q the field vanishes; c = 1 -+ share are the derivatives from x2 > 0 and from x2 < 0."""
    servo, gain = Servo(), 0.1
    found = equilibria(servo, "lugre", gain)
    (rests,) = found.rests
    order = [rests.names.index(name) for name in ("x1", "x2", "x3", "x4")]
    ends = rests.corners[np.argsort(rests.corners[:, order[3]])][:, order]
    at = ends[0] + (1 + share) / 2 * (ends[1] - ends[0])
    q = share * found.bristle_limit
    integral = -servo.friction.stiffness * q / servo.torque_gains(gain)[2]
    assert at == pytest.approx([0, 0, integral, q], rel=1e-14, abs=1e-18)
    assert np.max(np.abs(field(servo, gain, at))) < 1e-13
    for side in (1.0, -1.0):
        h = 1e-9 * side  # small beside vs: the Stribeck curve moves by (h/vs)^2
        A = rests.members(np.array([1 - side * share]))[0][np.ix_(order, order)]
        for k in range(4):
            step = np.where(np.arange(4) == k, h, 0.0)
            column = (field(servo, gain, at + step) - field(servo, gain, at)) / h
            assert column == pytest.approx(A[:, k], rel=1e-5, abs=1e-3)


def test_bristle_set_is_invariant():
    """z z' <= 0 at |z| = Fs/sigma0 for every velocity: no motion gets to the fixed points beyond."""
    limit = Servo().friction.static / Servo().friction.stiffness
    for v in np.concatenate([-np.geomspace(1e-6, 10, 50), np.geomspace(1e-6, 10, 50)]):
        assert limit * field(Servo(), 0.1, np.array([0.0, v, 0.0, limit]))[3] <= 1e-18


@pytest.mark.parametrize("servo", [Servo(), SMOOTH])
@pytest.mark.parametrize("gain", [1e-3, 0.01, 0.1])
def test_members_against_the_cubic_by_hand(servo, gain):
    """All members stable but for the zero if and only if the condition holds; eigenvalues are the roots."""
    found = equilibria(servo, "lugre", gain)
    roots = [np.roots(cubic(servo, gain, c)).real.max() for c in found.c]
    assert found.largest == pytest.approx(roots, rel=1e-6, abs=1e-8)
    assert found.c[0] == 0 and found.c[-1] == 2
    assert (max(roots) < 0) == found.sharp_holds == found.linear_stable == linear_loop(servo, gain).stable
    if found.simple_holds:
        assert found.sharp_holds


def test_border_of_the_sharp_condition():
    """It is the Routh-Hurwitz limit of the linear loop; beside it the end of the segment changes sides."""
    limit = lowest_stable_gain(SMOOTH)
    assert limit > 0 and not equilibria(SMOOTH, "lugre", limit).simple_holds
    for factor in (0.999, 1.001):
        found = equilibria(SMOOTH, "lugre", limit * factor)
        assert found.sharp_holds == (factor > 1) == (found.threshold == 0)
        assert (np.roots(cubic(SMOOTH, limit * factor, 0.0)).real.max() < 0) == (factor > 1)


def test_threshold_is_where_members_change_sides():
    """The positive root of (kd + sigma2 + sigma1 c)(kp + sigma0 c) = J ki."""
    c, f = equilibria(SMOOTH, "lugre", 0.01).threshold, SMOOTH.friction
    kp, kd, ki = SMOOTH.torque_gains(0.01)
    D = kd + f.viscous
    roots = np.roots([f.damping * f.stiffness, D * f.stiffness + f.damping * kp, D * kp - SMOOTH.inertia * ki])
    assert c == pytest.approx(roots.max(), rel=1e-6)
    assert 0 < c < 1e-3  # a thin layer at the ends of the segment, since sigma0 is large


def test_simple_condition_of_table_1_is_the_report_s():
    """sigma2/J > pi for tau_i = tau_d = 1/(2 pi), report, section 4.1."""
    assert equilibria(Servo(), "lugre", 0.1).simple == pytest.approx((0.1 / 0.026, np.pi))
    other = Servo().replace(**{"controller.integral_time": 0.5})
    assert equilibria(other, "lugre", 0.1).simple[1] != pytest.approx(np.pi, rel=0.1)


def test_switch_strip_and_command(capsys, tmp_path):
    found = equilibria(Servo(), "switch", 0.1)
    kp, _, ki = Servo().torque_gains(0.1)
    assert (found.position_limit * kp, found.integral_limit * ki) == pytest.approx((0.53, 0.53), rel=1e-14)
    for model in ("switch", "lugre"):
        picture = tmp_path / f"{model}.png"
        assert cli.main(["equilibria", "--model", model, "--gain", "0.1", "--json", "--plot", str(picture)]) == 0
        record = json.loads(capsys.readouterr().out)
        assert record["model"] == model and "do not prove" in record["proves"] and picture.stat().st_size > 10_000
        assert cli.main(["equilibria", "--model", model, "--gain", "0.1"]) == 0
        assert "rad s" in capsys.readouterr().out
    assert cli.main(["equilibria"]) == cli.main(["equilibria", "--gain", "0"]) == 2
    other = equilibria(loop_of(Servo(), "switch", 0.2), gain=0.1)  # a gain beside the loop's takes its place
    assert other.integral_limit == pytest.approx(equilibria(Servo(), "switch", 0.1).integral_limit, rel=1e-12)


def loop(*parts, **values):
    return loop_of(Servo(), "switch", 0.04).with_parts(*parts, **values)


BY_HAND = "dead band", "shifted dead band", "hysteresis", "error dead band", "leak", "error filter", "feedforward"


@pytest.mark.parametrize("remedy", [remedy for remedy in REMEDIES if remedy.name in BY_HAND], ids=repr)
def test_rest_states_of_remedies_by_hand(remedy):
    """The corners in the plane of x1 and torque that stand with each remedy."""
    size = 0.01 if remedy.unit == "rad" else 0.1
    found = equilibria(loop(remedy.part, **{remedy.size: size}))
    kp, _, ki = Servo().torque_gains(0.04)
    by_hand = {tuple(np.round(each, 12)) for each in remedy.rests(size, {"static": 0.53, "kp": kp, "ki": ki})}
    seen = {(x[0], x[-1]) for rests in found.rests for x in np.round(rests.corners, 12) + 0.0}
    assert seen == by_hand and not found.not_answered


def test_rest_states_of_loops_by_hand():
    """Without an integral |kp x1| <= Fs; a load torque moves the segment; a load with friction winds up its shaft."""
    proportional = Loop((INERTIA, SWITCH, transfer_function([0.2, 2.0], [0.01, 1.0])), {"gain": 0.04})
    assert equilibria(proportional).ranges["x1"] == pytest.approx((-0.53 / 1.28, 0.53 / 1.28), rel=1e-12)
    assert equilibria(loop(LOADS, load_torque=0.1)).ranges["torque"] == pytest.approx((-0.43, 0.63), rel=1e-12)
    two = Loop((TWO_MASSES, SWITCH, PID_BY_TIMES, INTEGRATOR, LOAD_SWITCH), {"load_static": 0.3, "load_coulomb": 0.2})
    found = equilibria(two)
    assert found.ranges["load_angle"] == pytest.approx((-3e-3, 3e-3), rel=1e-12)  # 0.3 N m by 100 N m/rad
    assert found.ranges["torque"] == pytest.approx((-0.83, 0.83), rel=1e-12) and found.ranges["x1"] == (0, 0)
    frozen = equilibria(loop(FREEZE, dwell=8.0))
    assert frozen.ranges["x1"] == (-np.inf, np.inf)
    assert {rests.mode for rests in frozen.rests} == {"stick, frozen"}  # before the dwell is over its clock runs
    assert frozen.ranges["torque"] == pytest.approx((-0.53, 0.53), rel=1e-9)


@pytest.mark.parametrize("values", [{}, {"shaft_damping": 0.5}, {"viscous": 0.0, "gain": 0.01}])
def test_members_of_two_masses_with_bristles(values):
    """At c = 0 the bristle takes no part: the eigenvalues beside the zero are the poles without dry friction."""
    bristles = Loop((TWO_MASSES, LUGRE, PID_BY_TIMES, INTEGRATOR), values)
    found, poles = equilibria(bristles), linear_loop(bristles).poles
    values = np.linalg.eigvals(found.rests[0].members(np.zeros(1))[0])
    values = values[np.argsort(np.abs(values))][1:]
    assert np.sort_complex(values) == pytest.approx(np.sort_complex(poles), rel=1e-7)
    assert (found.largest[0] < 0) == found.linear_stable


def test_a_loop_is_answered_in_words(capsys, tmp_path):
    path = tmp_path / "loop.toml"
    parts = '[loop]\nparts = ["one inertia", "Switch friction", "PID by times", "integrator", "dead band"]\n[values]\n'
    path.write_text(f"{parts}gain = 0.04\ndead_band = 0.01\n")
    assert cli.main(["equilibria", str(path), "--details", "--plot", str(tmp_path / "p.png")]) == 0
    said = " ".join(capsys.readouterr().out.split())
    assert "can stand still for ever up to 0.01 rad" in said and "without dry friction it is not linear" in said
    assert (tmp_path / "p.png").stat().st_size > 10_000
    assert cli.main(["equilibria", str(path), "--json"]) == 0
    record = json.loads(capsys.readouterr().out)
    assert record["ranges"]["x1"] == pytest.approx([-0.01, 0.01]) and "dead band" in record["parts"]


@pytest.mark.parametrize("values", [{}, {"leak": 0.1}, {"leak": 0.1, "dead_band": 0.01}, {"dead_band": 0.01}])
def test_a_motion_that_starts_between_the_corners_stays_there(values):
    """In every mode it can rest in; and beyond a corner it does not."""
    servo = loop(LEAK, DEAD_BAND, **values)
    for rests in equilibria(servo).rests:
        names, middle = rests.names[:-1], rests.corners.mean(axis=0)[:-1]
        for corner in rests.corners[:, :-1]:
            for part, stays in ((0.99, True), (1.01, False)):
                start = dict(zip(names, middle + part * (corner - middle), strict=True))
                seen = simulate(servo, set_point=0.0, time=50.0, start=start)
                moved = np.ptp(seen.states, axis=1).max()
                assert moved < 1e-12 if stays else moved > 1e-9, (rests.mode, corner, part)


def test_without_an_integral_it_rests_as_far_as_friction_holds_the_error():
    """kp |x1| <= Fs of each direction: nothing is taken of the integral, so that it may grow."""
    numbers = {"motor_gain": 1.0, "gain": 1.0, "kp": 2.0, "kd": 0.1, "static": 0.6, "static_back": 0.5}
    found = equilibria(Loop((INERTIA, BY_DIRECTION, PID_BY_GAINS, INTEGRATOR), numbers | {"ki": 0.0}))
    assert found.ranges["x1"] == pytest.approx((-0.6 / 2, 0.5 / 2), rel=1e-12)
    assert found.ranges["torque"] == pytest.approx((-0.5, 0.6), rel=1e-12) and found.ranges["x3"][1] == np.inf
    wound_up = equilibria(Loop((INERTIA, BY_DIRECTION, PID_BY_GAINS, INTEGRATOR), numbers | {"ki": 4.0}))
    assert wound_up.ranges["x1"] == (0.0, 0.0) and wound_up.ranges["x3"] == pytest.approx((-0.6 / 4, 0.5 / 4))
