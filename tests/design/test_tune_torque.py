"""A tuning with a largest torque: at a step from rest the motor is asked for kp times the step at once."""

import dataclasses
import json
import math

import pytest
from command_line import one_json, run

from casahunt import Demands, InputError, NoOrbit, Options, Servo, Uncertainty, find_fold, find_orbit, simulate, tune
from casahunt.axis_units import Units, shown_in
from casahunt.design.tune.best_gain import Given
from casahunt.design.tune.check import scanned, verified
from casahunt.design.tune.tasks import stated
from casahunt.servo.parts import LOADS, loop_of, series

STEP, KP, MOTOR = 1.0, 2.0, 16.0
"""The largest step of the tasks [rad]; Table 1's: kp of the controller at K = 1, motor gain [N m/V]."""


def given(demands, uncertainty=None):
    return Given(Servo(), "switch", demands, uncertainty, (), {}, "settling", Options())


@pytest.mark.slow
def test_the_gain_that_the_torque_leaves():
    """The fastest servo would take more: what is allowed is taken at the start of the step, and not exceeded."""
    tuning = tune(Servo(), "switch", demands=Demands(max_torque=30.0), cost="settling")
    assert tuning.gain == pytest.approx(30 / (MOTOR * KP * STEP), rel=1e-12) and tuning.binding == ("largest torque",)
    peaks = [task.motion.peak_torque for task in tuning.verification.tasks]
    assert max(peaks) == pytest.approx(30.0, rel=1e-9) and tuning.verification.ok
    assert tune(Servo(), "switch", cost="settling").gain > tuning.gain


def test_what_is_possible_is_said_where_it_cannot_be_met():
    needed = 1.1 * find_fold(Servo(), "switch").gain
    with pytest.raises(NoOrbit) as refused:
        tune(Servo(), "switch", demands=Demands(max_torque=5.0))
    said = str(refused.value)
    assert "the largest torque of 5 N m on a step of 1 rad allows gains of at most 0.15625" in said
    assert f"{needed:.6g} takes {needed * MOTOR * KP:.4g} N m" in said and "casahunt remedies" in said
    assert "hunting margin" in said and "phase margin" not in said


def test_the_strongest_motor_of_the_set():
    """The step may begin with kp of any servo of the set."""
    uncertain = Uncertainty({"servo.motor_gain": (15.0, 18.0)})
    assert given(Demands(max_torque=30.0), uncertain).largest_gain(Servo()) == pytest.approx(30 / (18 * KP), rel=1e-12)
    assert given(Demands(), uncertain).largest_gain(Servo()) == math.inf


def test_a_lead_makes_the_first_torque_larger_and_a_low_pass_does_not_hide_it():
    """A lead passes lead_pole/lead_zero of a jump at once; a low-pass lets that of the controller come later."""
    plain = loop_of(Servo(), "switch", 0.1)
    lead = plain.with_parts(series("lead"), lead_zero=10.0, lead_pole=80.0)
    most = given(Demands(max_torque=30.0))
    assert most.first_torque(lead) == pytest.approx(8 * MOTOR * KP * STEP, rel=1e-12)
    assert most.first_torque(plain.with_parts(series("low-pass"))) == pytest.approx(MOTOR * KP * STEP, rel=1e-12)


@pytest.mark.parametrize("load", [-8.42, -2.69, 2.6])
def test_a_load_is_not_multiplied_by_the_gain(load):
    """A step against it begins with kp times the step and what the integral carries, as `simulate` counts it."""
    axis = loop_of(Servo(), "switch", 1.0).with_parts(LOADS, load_torque=load)
    most = given(Demands(max_torque=30.0))
    assert most.largest_gain(axis) == pytest.approx((30 - abs(load)) / (MOTOR * KP * STEP), rel=1e-9)
    axis = axis.replace(gain=most.largest_gain(axis))
    step = math.copysign(STEP, load)
    assert stated(axis, axis.value("gain"), 0.1, STEP)[f"a step of {step:g} rad from rest"]["set_point"] == step
    motion = simulate(axis, time=1e-3, set_point=step, start=axis.carrying)
    assert motion.peak_torque == pytest.approx(30.0, rel=1e-9)


@pytest.mark.slow
def test_what_the_simulated_tasks_take_is_held_against_it():
    """Apart from the search: were its torque too small, the tasks would speak against it."""
    found = given(Demands())
    answer, _ = found.answer(None)
    taken = answer.gain * MOTOR * KP * STEP
    found.demands = dataclasses.replace(found.demands, max_torque=0.9 * taken)
    (against,) = verified(answer, found).against
    assert against == f"nominal friction, a step of 1 rad from rest: takes {taken:.6g} N m, more than {0.9 * taken:g}"


@pytest.mark.slow
@pytest.mark.parametrize("cost", ["gain", "settling"])
def test_other_times_take_less_torque(cost):
    """With the times as given 22.8 N m; 20 are enough with more lead, and no task takes more."""
    tuning = tune(Servo(), "switch", demands=Demands(max_torque=20.0), free=["lead_time", "integral_time"], cost=cost)
    assert tuning.gain_only is None and tuning.verification.ok and "largest torque" in tuning.binding
    assert tuning.servo.torque_gains(tuning.gain)[0] * STEP <= 20 * (1 + 1e-9)
    assert max(task.motion.peak_torque for task in tuning.verification.tasks) <= 20 * (1 + 1e-6)


@pytest.mark.slow
def test_the_command(capsys, tmp_path):
    words = ("tune", "--quiet")
    code, out, err = run(capsys, *words, "--max-torque", 25, "--json", "--out", tmp_path)
    record = one_json(out)
    assert (code, err) == (0, "") and record["demands"]["max_torque"] == 25
    assert record == json.loads((tmp_path / "tune.json").read_text())
    page = (tmp_path / "tune.html").read_text()
    assert 'data-key="demands/max_torque"' in page and 'data-key="verification/tasks/0/peak_voltage"' in page
    for task in record["verification"]["tasks"]:
        assert task["peak_voltage"] == pytest.approx(task["peak_torque"] / MOTOR)
    code, out, err = run(capsys, *words, "--max-torque", 5)
    assert (code, out) == (1, "") and "the largest torque of 5 N m" in err and err.count("\n") == 1


@pytest.mark.parametrize("torque", [0.0, -1.0, math.nan, "much"])
def test_what_is_no_torque(capsys, torque):
    if not isinstance(torque, str):
        with pytest.raises(InputError, match="max-torque"):
            Demands(max_torque=torque)
    code, out, err = run(capsys, "tune", "--max-torque", torque)
    assert (code, out) == (2, "") and "max-torque" in err


def test_a_cycle_that_speaks_against_it_has_the_units_of_the_axis():
    """1 m of the axis is 1000 mm in the sentence."""
    loop = loop_of(Servo(), "switch", 0.4)
    size = 1000 * find_orbit(loop).amplitude
    with shown_in(Units("linear", "mm")):
        sentence, seen = scanned(loop, None, 0.4)
    assert seen == "cycle" and f"a cycle of {size:.4g} mm and" in sentence
