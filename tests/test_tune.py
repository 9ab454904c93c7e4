"""Tuning against folds computed apart, closed forms, and what must be refused."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import pytest

from casahunt import Options, Servo, find_fold
from casahunt.cli import main
from casahunt.delayed_loop import crossover, margins
from casahunt.errors import InputError, NoOrbit
from casahunt.fold_conditions import data_of, fold_conditions
from casahunt.linear_loop import linear_loop
from casahunt.orbit import direction_of, unknowns_of
from casahunt.tune import Demands, Tuning, check_bounds, tune
from casahunt.uncertainty import Uncertainty
from problems import table1

TIGHT = Options(tol=1e-9)
TIME = 1 / (2 * np.pi)


@pytest.fixture(scope="module")
def servo() -> Servo:
    return Servo()


@pytest.fixture(scope="module")
def plain(servo) -> Tuning:
    """Table 1, gain only, at a tight tolerance."""
    return tune(servo, "switch", demands=Demands(margin=0.1), options=TIGHT)


@pytest.fixture
def unscanned(monkeypatch):
    """Leave out the scan of the event map, which `plain` has shown and which takes seconds."""
    monkeypatch.setattr("casahunt.tune._scanned", lambda *_: ("not scanned", True))


# The equations


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_fold_conditions_hold_at_a_fold_and_their_jacobian_is_the_derivative(servo, model):
    fold = find_fold(servo, model)
    t, u, setting = unknowns_of(fold.orbit)
    data = data_of(replace(setting, dp=direction_of("gain") * fold.gain))
    equations, jacobian = fold_conditions(t)
    size = float(np.max(np.abs(fold.multipliers)))
    q = np.log([servo.controller.lead_time, servo.controller.integral_time])
    x = np.concatenate([q, u, [0.0], fold.multipliers / size])

    def value(x):
        z = x[2 : 3 + t.size]
        return np.array(equations(x[:2], z, x[3 + t.size :], data, size)).ravel()

    held = value(x)
    assert np.max(np.abs(held[:-1])) < 1e-8  # residual of the orbit and of IPOPT's dual
    assert held[-1] == pytest.approx(1.0, abs=1e-8)
    v, h = np.random.default_rng(1).normal(size=x.size), 1e-6
    difference = (value(x + h * v) - value(x - h * v)) / (2 * h)
    z = x[2 : 3 + t.size]
    exact = np.array(jacobian(x[:2], z, x[3 + t.size :], data, size)) @ v
    # h^2 of a third derivative, and eps/h of the values
    assert np.max(np.abs(difference - exact)) < 1e-9 * np.max(np.abs(exact)) + 1e-7


def test_margins_without_delay_are_those_of_the_linear_loop(servo):
    steep = servo.replace(**{"friction.viscous": 0.01})  # with a lower limit of the gain
    for each, gain in ((servo, 0.7), (steep, 0.04), (steep, 2.0)):
        ours, theirs = margins(each, gain), linear_loop(each, gain)
        assert ours.frequency == pytest.approx(theirs.gain_crossovers[0].frequency, rel=1e-9)
        assert ours.phase_margin == pytest.approx(theirs.gain_crossovers[0].margin, abs=1e-7)
        assert ours.stable == theirs.stable
        assert ours.lowest_factor == pytest.approx(theirs.lowest_factor, rel=1e-9)
        assert ours.highest_factor == theirs.highest_factor == math.inf


def test_margins_with_delay(servo):
    free, late = margins(servo, 0.7), margins(servo, 0.7, delay=0.004)
    assert late.phase_margin == pytest.approx(free.phase_margin - math.degrees(free.frequency * 0.004), abs=1e-9)
    # At the largest gain the loop is just stable: no phase margin is left.
    edge = margins(servo, 0.7 * late.highest_factor * (1 - 1e-9), delay=0.004)
    assert 0 < edge.phase_margin < 1e-6
    assert not margins(servo, 0.7 * late.highest_factor * 1.001, delay=0.004).stable
    assert crossover(servo, 0.7, 0.5) > crossover(servo, 0.7) > crossover(servo, 0.7, 2.0)


# The gain alone


def test_table_1_with_ten_per_cent(plain):
    reference = table1.REFERENCE["switch"]["fold"]["K"]
    assert plain.gain == pytest.approx(1.1 * reference, rel=1e-9)
    assert plain.gain >= 1.1 * plain.fold_gain  # never below its bound
    assert plain.binding == ("hunting margin",)
    assert plain.verification.ok and plain.status.ok
    assert plain.verification.scan_clear
    assert [task.motion.verdict.kind for task in plain.verification.tasks] == ["at rest"] * 3


def test_a_larger_phase_margin_takes_over(unscanned, servo):
    found = tune(servo, "switch", demands=Demands(phase_margin=85))
    assert found.binding == ("phase margin",)
    loop = linear_loop(servo, found.gain)
    assert loop.gain_crossovers[0].margin == pytest.approx(85, abs=1e-6)


def test_the_worst_friction_of_a_set_counts(unscanned, servo):
    # The fold rises with static and falls with Coulomb friction (signs of the elasticities).
    box = {"friction.static": (0.525, 0.535), "friction.coulomb": (0.438, 0.442)}
    found = tune(servo, "switch", uncertainty=Uncertainty(box))
    worst = find_fold(servo.replace(**{"friction.static": 0.535, "friction.coulomb": 0.438}), "switch")
    assert found.gain == pytest.approx(1.1 * worst.gain, rel=1e-6)
    assert found.corner == pytest.approx({"friction.static": 0.535, "friction.coulomb": 0.438})
    assert found.verification.ok
    assert {task.friction for task in found.verification.tasks} == {"nominal", "worst"}


# Controller times


def test_a_longer_lead_lowers_the_gain_to_its_bound(unscanned, servo):
    found = tune(servo, "switch", free=["lead_time"], bounds={"lead_time": (0.15, 0.18)}, options=Options(tol=1e-8))
    # Swapping the times leaves the motion alone with K/tau_i fixed: another servo's fold gives the answer.
    swapped = servo.replace(**{"controller.lead_time": TIME, "controller.integral_time": 0.18})
    expected = 1.1 * find_fold(swapped, "switch", options=Options(tol=1e-8)).gain * TIME / 0.18
    assert found.servo.controller.lead_time == pytest.approx(0.18, rel=1e-6)
    assert found.gain == pytest.approx(expected, rel=1e-6)
    assert found.gain_only is not None and found.cost_value < found.gain_only
    assert found.binding == ("hunting margin", "upper bound of lead_time")


@pytest.mark.slow
@pytest.mark.parametrize("cost", ["gain", "high-frequency", "settling"])
def test_freed_times_never_cost_more(unscanned, servo, cost):
    found = tune(
        servo, "switch", cost=cost, free=["lead_time", "integral_time"], demands=Demands(delay=0.002, phase_margin=50)
    )
    assert found.gain_only is not None and found.cost_value <= found.gain_only
    assert found.verification.ok
    assert margins(found.servo, found.gain, delay=0.002).phase_margin >= 50 - 1e-3


@pytest.mark.slow
def test_no_point_of_a_grid_is_better(unscanned, servo):
    lead, integral = (0.14, 0.18), (0.15, 0.19)
    found = tune(
        servo, "switch", cost="high-frequency", free=["lead_time", "integral_time"],
        bounds={"lead_time": lead, "integral_time": integral},
    )  # fmt: skip
    for a in np.linspace(*lead, 4):
        for b in np.linspace(*integral, 4):
            other = servo.replace(**{"controller.lead_time": float(a), "controller.integral_time": float(b)})
            assert found.cost_value <= 1.1 * find_fold(other, "switch").gain * a * (1 + 1e-6)


@pytest.mark.slow
def test_lugre(servo):
    found = tune(servo, "lugre", free=["lead_time"], bounds={"lead_time": (0.15, 0.18)})
    expected = find_fold(servo.replace(**{"controller.lead_time": 0.18}), "lugre").gain
    assert found.gain == pytest.approx(1.1 * expected, rel=1e-5)
    assert found.verification.ok


# What cannot be met, and what is wrong


def test_what_is_in_the_way_is_said(servo, plain):
    with pytest.raises(NoOrbit, match="in the way is the phase margin of 60 degrees") as error:
        tune(servo, "switch", demands=Demands(phase_margin=60, delay=0.01))
    best = margins(servo, plain.gain, delay=0.01).phase_margin  # it falls with the gain, which may not fall
    assert f"it is {best:.5g} degrees at best" in str(error.value)
    assert "held by the hunting margin" in str(error.value)
    with pytest.raises(NoOrbit, match=r"in the way is the hunting margin: .* must be at least 0.712073.*allow 0.5 "):
        tune(servo, "switch", bounds={"gain": (0.1, 0.5)})


WRONG = [
    (["--margin", "-0.1"], "margin = -0.1: must be at least 0"),
    (["--margin", "nan"], "margin = nan: must be a finite number"),
    (["--free", "motor_gain"], "unknown free 'motor_gain'"),
    (["--cost", "speed"], "unknown cost 'speed'"),
    (["--model", "lugree"], "unknown model 'lugree'"),
    (["--bounds", "lead_time=0.1"], "must have the form NAME=LOW,HIGH"),
    (["--bounds", "lead=0.1,1"], "unknown bounds 'lead'"),
    (["--bounds", "lead_time=0.1,1"], "must be left out unless --free lead_time is given"),
    (["--free", "lead_time", "--bounds", "lead_time=1,0.1"], "the first must be less than the second"),
    (["--free", "lead_time", "--bounds", "lead_time=0.5,1"], "must contain the servo's own value"),
    (["--bounds", "gain=0,1"], "bounds gain = 0: must be greater than 0"),
    (["--phase-margin", "200"], "phase-margin = 200: must be at most 180"),
    (["--gain-margin", "0.5"], "gain-margin = 0.5: must be at least 1"),
    (["--delay", "-1"], "delay = -1: must be at least 0"),
    (["--gain", "0"], "gain = 0: must be greater than 0"),
    (["--set", "controller.lead_time=0"], "controller.lead_time = 0: must be greater than 0"),
    (["--uncertainty", "missing.toml"], "no such file"),
]


@pytest.mark.parametrize("arguments, sentence", WRONG)
def test_wrong_input_is_one_sentence_and_code_2(arguments, sentence, capsys, tmp_path):
    assert main(["tune", *arguments, "--out", str(tmp_path / "out")]) == 2
    said = capsys.readouterr()
    assert said.out == "" and sentence in said.err and said.err.count("\n") == 1
    assert not (tmp_path / "out").exists()


def test_an_empty_set_is_refused(capsys, tmp_path):
    for text in ("", "[interval]\n"):
        (tmp_path / "set.toml").write_text(text)
        assert main(["tune", "--uncertainty", str(tmp_path / "set.toml")]) == 2
        assert "set.toml" in capsys.readouterr().err


def test_a_time_is_not_free_and_uncertain(servo):
    with pytest.raises(InputError, match="it is in the uncertainty set"):
        tune(servo, "switch", free=["lead_time"], uncertainty=Uncertainty({"controller.lead_time": (0.15, 0.16)}))
    assert check_bounds(servo, ["lead_time"], {})["lead_time"] == pytest.approx((TIME / 2, TIME * 2))


def test_a_task_that_cannot_be_met_is_code_1(capsys):
    assert main(["tune", "--bounds", "gain=0.1,0.5", "--json"]) == 1
    said = capsys.readouterr()
    assert said.out == "" and "in the way is the hunting margin" in said.err


def test_json(unscanned, capsys):
    assert main(["tune", "--json", "--quiet"]) == 0
    record = json.loads(capsys.readouterr().out)
    for key in ("model", "gain", "lead_time", "integral_time", "cost", "fold_gain", "margin", "worst", "binding",
                "verification", "status", "wall_s"):  # fmt: skip
        assert key in record
    assert record["status"] == "converged" and record["before"] is None


def test_a_motion_that_grows_speaks_against_a_tuning(servo, plain):
    from casahunt.tune import _scanned

    assert not _scanned(servo, "switch", 0.9 * plain.fold_gain)[1]
    assert _scanned(servo, "lugre", plain.gain)[1]
    assert not _scanned(servo, "lugre", 0.5 * plain.fold_gain)[1]


def test_a_servo_that_cannot_hunt_is_left_to_its_margins(servo):
    found = tune(servo.replace(**{"friction.static": 0.44}), "switch")
    assert found.fold_gain == 0 and found.verification.ok
    assert linear_loop(servo, found.gain).gain_crossovers[0].margin == pytest.approx(30, abs=1e-5)
