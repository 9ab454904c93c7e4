"""Sensitivities of the fold gain: finite differences of recomputed folds, and exact symmetries."""

from __future__ import annotations

from functools import cache

import pytest

from casahunt import Fold, Options, Servo, find_fold
from casahunt.design.sensitivity import NAMES, fold_sensitivities
from casahunt.servo.parts import loop_of

STEP = 2e-4
"""Relative step of the five-point difference: its own error is STEP^4, the folds' 1e-11/STEP."""


@cache
def fold_of(model: str) -> Fold:
    """The fold of Table 1, for all tests that read it."""
    return find_fold(Servo(), model, options=Options(tol=1e-10))


def difference(model, name, value):
    def gain(at):
        tol = 1e-11 if model == "switch" else 1e-10
        return find_fold(Servo().replace(**{name: at}), model, options=Options(tol=tol)).gain

    below2, below, above, above2 = (gain(value * (1 + k * STEP)) for k in (-2, -1, 1, 2))
    return (below2 - 8 * below + 8 * above - above2) / (12 * STEP * value)


@pytest.mark.parametrize("model", ["switch", pytest.param("lugre", marks=pytest.mark.slow)])
@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("friction.static", 0.53),
        pytest.param("friction.stribeck_velocity", 0.02, marks=pytest.mark.slow),
        pytest.param("friction.coulomb", 0.44, marks=pytest.mark.slow),
        pytest.param("friction.viscous", 0.1, marks=pytest.mark.slow),
        pytest.param("controller.lead_time", Servo().controller.lead_time, marks=pytest.mark.slow),
        pytest.param("servo.motor_gain", 16.0, marks=pytest.mark.slow),
    ],
)
def test_against_finite_differences(model, name, value):
    slopes = fold_sensitivities(fold_of(model))
    assert slopes.derivatives[name] == pytest.approx(difference(model, name, value), rel=1e-6)


def test_exact_symmetries():
    servo = Servo()
    slopes = fold_sensitivities(fold_of("switch"))
    d, f = slopes.derivatives, servo.friction
    assert set(d) == set(servo.names) - {"gain"} < set(NAMES)
    assert slopes.elasticities["servo.motor_gain"] == pytest.approx(-1, rel=1e-8)
    assert d["friction.coulomb"] == pytest.approx(-d["friction.static"], rel=1e-8)
    through = (f.static - f.coulomb) / f.stribeck_velocity
    assert d["friction.stribeck_velocity"] == pytest.approx(-through * d["friction.static"], rel=1e-8)
    assert d["friction.stiffness"] == d["friction.damping"] == 0


def test_swapping_the_controller_times():
    """tau_i <-> tau_d leaves K/tau_i alone: at equal times the two elasticities differ by one, in sum they are -1."""
    for model in ("switch", "lugre"):
        e = fold_sensitivities(fold_of(model)).elasticities
        assert e["controller.integral_time"] - e["controller.lead_time"] == pytest.approx(1, rel=1e-7)


def test_linear_prediction():
    slopes = fold_sensitivities(fold_of("switch"))
    near = find_fold(Servo().replace(**{"friction.static": 0.5301}), "switch", options=Options(tol=1e-10))
    assert slopes.linear({"friction.static": 1e-4}) == pytest.approx(near.gain, rel=1e-5)


def test_a_loop_has_those_of_the_servo_that_it_is():
    own, of_loop = (fold_sensitivities(find_fold(*asked)) for asked in (
        (Servo(), "switch"), (loop_of(Servo(), "switch", 0.1),)))  # fmt: skip
    assert repr(of_loop).startswith("<Sensitivities: parameter gain, value 0.64733908")
    one, other = own._columns(), of_loop._columns()
    assert list(one) == list(other) and set(other["model"]) == {"loop"}
    there = {name: slope for name, slope in zip(other["parameter"], other["slope_V_per_rad_per_unit"], strict=True)}
    for name, slope in own.derivatives.items():
        if name.startswith("friction.") and slope:
            assert there[name.split(".")[1]] == pytest.approx(slope, rel=1e-5)
