"""Equilibria: the segment by the equations of motion, the generalised Jacobian by differences and dense grids."""

from __future__ import annotations

import json

import numpy as np
import pytest

from casahunt import InputError, Servo, cli
from casahunt.servo.equilibria import cubic, equilibria, member, threshold
from casahunt.servo.gains import lowest_stable_gain
from casahunt.servo.linear.linear_loop import linear_loop

SMOOTH = Servo().replace(**{"friction.viscous": 0.02})  # sigma2 < J/(tau_i + tau_d): unstable members at small gains


def field(servo: Servo, gain: float, x: np.ndarray) -> np.ndarray:
    """The LuGre servo written out once more, from the report's state equation."""
    f = servo.friction
    kp, kd, ki = servo.torque_gains(gain)
    g = f.coulomb + (f.static - f.coulomb) * np.exp(-((x[1] / f.stribeck_velocity) ** 2))
    rate = x[1] - f.stiffness * abs(x[1]) * x[3] / g
    friction = f.stiffness * x[3] + f.damping * rate + f.viscous * x[1]
    return np.array([x[1], (-kp * x[0] - kd * x[1] - ki * x[2] - friction) / servo.inertia, x[0], rate])


@pytest.mark.parametrize("share", [-1.0, -0.3, 0.0, 0.7, 1.0])
def test_segment_and_one_sided_jacobians(share):
    """At z = q the field vanishes; alpha = 1 and 0 are the derivatives from x2 > 0 and from x2 < 0."""
    servo, gain = Servo(), 0.1
    found = equilibria(servo, "lugre", gain)
    q = share * found.bristle_limit
    at = np.array([0, 0, -servo.friction.stiffness * q / servo.torque_gains(gain)[2], q])
    assert abs(at[2]) <= found.integral_limit * (1 + 1e-15)
    assert np.max(np.abs(field(servo, gain, at))) < 1e-13
    for alpha, side in ((1.0, 1.0), (0.0, -1.0)):
        h = 1e-9 * side  # small beside vs: the Stribeck curve moves by (h/vs)^2
        step = np.array([0, h, 0, 0])
        column = (field(servo, gain, at + step) - field(servo, gain, at)) / h
        assert column == pytest.approx(member(servo, gain, q, alpha)[:, 1], rel=1e-5, abs=1e-5)
    mean = (member(servo, gain, q, 0) + member(servo, gain, q, 1)) / 2
    assert member(servo, gain, q, 0.5) == pytest.approx(mean, rel=1e-14)


def test_bristle_set_is_invariant():
    """z z' <= 0 at |z| = Fs/sigma0 for every velocity: no motion gets to the fixed points beyond."""
    limit = Servo().friction.static / Servo().friction.stiffness
    for v in np.concatenate([-np.geomspace(1e-6, 10, 50), np.geomspace(1e-6, 10, 50)]):
        assert limit * field(Servo(), 0.1, np.array([0.0, v, 0.0, limit]))[3] <= 1e-18


@pytest.mark.parametrize("servo", [Servo(), SMOOTH])
@pytest.mark.parametrize("gain", [1e-3, 0.01, 0.1])
def test_sharp_condition_on_a_dense_grid(servo, gain):
    """All members stable but for the zero if and only if the condition holds; cubic and matrix agree."""
    found = equilibria(servo, "lugre", gain)
    limit = found.bristle_limit
    largest = []
    for q in limit * np.concatenate([np.linspace(-1, 1, 21), 1 - np.geomspace(1e-9, 1e-2, 20)]):
        for alpha in np.concatenate([np.linspace(0, 1, 11), 1 - np.geomspace(1e-9, 1e-2, 10)]):
            roots = np.roots(cubic(servo, gain, np.array([1 - (2 * alpha - 1) * q / limit]))[0])
            largest.append(float(np.max(roots.real)))
            if alpha == 1:
                values = np.linalg.eigvals(member(servo, gain, q, alpha))
                zero = np.argmin(np.abs(values))
                assert abs(values[zero]) < 1e-9 * np.max(np.abs(values))
    assert (max(largest) < 0) == found.sharp_holds == linear_loop(servo, gain).stable
    assert found.largest.max() <= max(largest) + 1e-9
    if found.simple_holds:
        assert found.sharp_holds


def test_border_of_the_sharp_condition():
    """It is the Routh-Hurwitz limit of the linear loop; beside it the end of the segment changes sides."""
    limit = lowest_stable_gain(SMOOTH)
    assert limit > 0 and not equilibria(SMOOTH, "lugre", limit).simple_holds
    for factor in (0.999, 1.001):
        found = equilibria(SMOOTH, "lugre", limit * factor)
        assert found.sharp_holds == (factor > 1) == (threshold(SMOOTH, limit * factor) == 0)
        assert (np.roots(cubic(SMOOTH, limit * factor, np.array([0.0]))[0]).real.max() < 0) == (factor > 1)


def test_threshold_is_where_members_change_sides():
    c = threshold(SMOOTH, 0.01)
    assert 0 < c < 1e-3  # a thin layer at the ends of the segment, since sigma0 is large
    for factor in (0.999, 1.001):
        assert (np.roots(cubic(SMOOTH, 0.01, np.array([c * factor]))[0]).real.max() < 0) == (factor > 1)


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
    with pytest.raises(InputError):
        member(Servo(), 0.1, 1.0, 0.5)
