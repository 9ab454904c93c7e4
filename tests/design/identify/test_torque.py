"""The torque of the motor as a second measured output: what it tells, how it is read, what is refused."""

from __future__ import annotations

import json

import numpy as np
import pytest
from command_line import run

from casahunt import Controller, InputError, Options, Pid, Record, Servo, find_orbit, identify
from casahunt.design.identify.fit import Question, at
from casahunt.design.identify.likelihood import Noise
from casahunt.design.identify.start import scales_of
from casahunt.design.identify.suitable import data_of, suitable
from casahunt.design.identify.torque import torque_of
from casahunt.design.record.file import read_record
from casahunt.orbits import state_sensitivity
from casahunt.servo.servo import flatten
from scripts.peers.hunting_record import motion

GAIN, FREE = 0.04, (
    "friction.static", "friction.coulomb", "friction.viscous", "servo.inertia", "servo.motor_gain"
)  # fmt: skip
WRONG = {"friction.static": 0.8, "friction.coulomb": 0.6, "friction.viscous": 0.2, "servo.motor_gain": 22.0,
         "servo.inertia": 0.04}  # fmt: skip


@pytest.fixture(scope="module")
def record():
    """Of Table 1's servo by another integrator: 1 % noise, torque with 4 % and an offset."""
    orbit, rng = find_orbit(Servo(), "switch", GAIN), np.random.default_rng(1)
    t = np.arange(0.0, 8 * orbit.period, orbit.period / 400)
    x, m = motion(Servo(), "switch", GAIN, orbit.amplitude, t)
    later = t >= 1.5 * orbit.period
    n = int(later.sum())
    x = x[later] + 0.3 + 0.01 * orbit.amplitude * rng.standard_normal(n)
    return Record(t[later], x, "made", None, m[later] + 0.07 + 0.02 * rng.standard_normal(n))


@pytest.mark.slow
def test_a_position_tells_no_size_of_torques_and_a_torque_does(record):
    alone = Record(record.times, record.position, "made")
    servo = Servo().replace(**WRONG)
    blind, seeing = (identify([r], servo, GAIN, free=FREE, advise=False) for r in (alone, record))
    assert not blind.bounded and seeing.bounded and seeing.judgement.explained
    truth = flatten(Servo())
    for name, (low, high) in seeing.intervals.items():
        assert low <= truth[name] <= high
        assert high - low < 0.2 * (blind.intervals[name][1] - blind.intervals[name][0])
    assert seeing.torque_noises[0] == pytest.approx(0.02, rel=0.05) and blind.torque_noises == (None,)
    assert np.ptp(seeing.intervals["servo.motor_gain"]) < 0.02 * truth["servo.motor_gain"]


def test_a_torque_that_is_not_that_of_the_servo_is_not_explained(record):
    """With a sign of its own no motor gain makes it fit."""
    turned = Record(record.times, record.position, "turned", None, -record.torque)
    with pytest.raises(InputError, match="turned"):
        identify([turned], Servo(), GAIN, free=FREE, advise=False)


@pytest.mark.parametrize("controller", [Controller(), Pid(kp=2.0, ki=6.28, kd=0.159)])
def test_slopes_of_the_torque_are_those_of_differences(controller):
    servo = Servo(controller=controller)
    names = ("friction.static", "servo.motor_gain", servo.controller_names[0], servo.controller_names[1])
    orbit = find_orbit(servo, "switch", GAIN, options=Options(tol=1e-10))
    times = np.linspace(0.07, 0.93, 6) * orbit.period  # beside events
    found = torque_of(orbit, state_sensitivity(orbit, times, names), names)
    truth, rest = flatten(servo), Options(tol=1e-10)
    for k, name in enumerate(names):
        h = 1e-5 * truth[name]
        ends = []
        for sign in (1, -1):
            other = find_orbit(servo.replace(**{name: truth[name] + sign * h}), "switch", GAIN, options=rest)
            ends.append(torque_of(other, state_sensitivity(other, times, ()), ()).value)
        slope = (ends[0] - ends[1]) / (2 * h)
        assert found.derivatives[k] == pytest.approx(slope, rel=1e-4, abs=1e-4 * np.abs(slope).max())


def test_the_deviance_moves_as_its_slopes_say(record):
    servo, data = Servo().replace(**WRONG | {"servo.motor_gain": 16.5}), data_of(record, suitable(record), GAIN)
    question = Question((data,), servo, "switch", FREE, Options(tol=1e-9), scales_of(data, servo, FREE), np.zeros(5))
    values = flatten(Servo())
    z = np.array([*question.unknowns(np.array([values[n] * 1.002 for n in FREE])), 0.1, 0.0])
    noises = [Noise(data.size, 0.0)]
    point = at(question, z, noises)
    for i in range(z.size):
        h = np.zeros(z.size)
        h[i] = 1e-5
        up, down = at(question, z + h, noises), at(question, z - h, noises)
        slope = (up.deviance - down.deviance) / 2e-5
        assert -2 * point.gradient[i] == pytest.approx(slope, rel=1e-3, abs=1e-4 * np.abs(point.gradient).max())


def test_columns_of_torque_and_current(tmp_path):
    path = tmp_path / "record.csv"
    path.write_text("t,pos [rad],M [mNm],I (mA)\n0,0,500,2000\n1,1,600,2500\n2,2,700,3000\n")
    assert read_record(path, torque_column="M").torque == pytest.approx([0.5, 0.6, 0.7])
    found = read_record(path, current_column="4", torque_constant=0.3)
    assert found.torque == pytest.approx([0.6, 0.75, 0.9]) and found.after(1.0).torque == pytest.approx([0.75, 0.9])
    assert "torques from column 'I (mA)', in mA at 0.3 N m/A, converted to N m" in found.reading.sentence
    assert read_record(path, torque_column="M", torque_constant=2.0).torque == pytest.approx([1000, 1200, 1400])
    assert read_record(path).torque is None


@pytest.mark.parametrize(("words", "says"), [
    (("--current-column", "I"), "current-column: goes with --torque-constant"),
    (("--torque-constant", "0.1"), "torque-constant: goes with --current-column"),
    (("--torque-column", "M", "--current-column", "I", "--torque-constant", "1"), "must be one of them"),
    (("--torque-column", "moment"), "torque-column = 'moment'"),
    (("--torque-column", "I"), "is no unit of torque"),
    (("--current-column", "I", "--torque-constant", "-1"), "torque-constant = -1"),
])  # fmt: skip
def test_what_is_refused(capsys, tmp_path, words, says):
    path = tmp_path / "record.csv"
    path.write_text("t,pos,M,I (mA)\n0,0,0,0\n1,1,1,1\n2,2,1,1\n")
    code, out, err = run(capsys, "identify", path, "--gain", GAIN, *words, "--out", tmp_path / "out")
    assert (code, out) == (2, "") and says in err and not (tmp_path / "out").exists()


def test_the_command_fits_a_current(capsys, tmp_path, record):
    path = tmp_path / "record.csv"
    np.savetxt(path, np.column_stack([record.times, record.position, record.torque / 0.5]), delimiter=",",
               header="t,position,current [A]", comments="")  # fmt: skip
    code, out, _ = run(capsys, "identify", path, "--gain", GAIN, "--free", "friction.static,servo.motor_gain",
                       "--current-column", "current", "--torque-constant", "0.5", "--quiet", "--json")  # fmt: skip
    said = json.loads(out)
    assert code == 0 and said["records"][0]["torque_noise"] == pytest.approx(0.02, rel=0.05)
    assert said["parameters"]["servo.motor_gain"]["low"] < 16 < said["parameters"]["servo.motor_gain"]["high"]
