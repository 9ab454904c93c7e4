"""Friction of axes of parts from records that scipy's DOP853 makes, with events."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from belt_support import recorded
from command_line import is_picture, one_json, run

from casahunt import Drive, InputError, Record, Servo, identify, load_uncertainty
from casahunt.design.identify.axis import check_axis, rigid
from casahunt.servo.parts import (
    INTEGRATOR,
    P_PI,
    SWITCH,
    TWO_MASSES,
    TWO_MASSES_LOAD_SEEN,
    Loop,
    load_loop,
    loop_of,
    transfer_function,
)
from problems import belt as problem

FILE = Path(problem.__file__).with_name("belt.toml")
TRUE = {"static": 0.8, "coulomb": 0.55, "viscous": 0.02, "stribeck_velocity": 0.08}
STATED = {"static": 0.6, "coulomb": 0.45, "viscous": 0.04, "stribeck_velocity": 0.05}
NOISE = 1e-5
"""Of the positions [rad]; the amplitude is 0.04."""


@pytest.fixture(scope="module")
def belt() -> Loop:
    return load_loop(FILE)


@pytest.fixture(scope="module")
def record(belt) -> Record:
    times, position = recorded(belt.parameters, -0.045, 80, 5e-3)
    settled = times > 20
    noise = np.random.default_rng(3).normal(0, NOISE, times.size)
    return Record((times - 20)[settled], (position + noise)[settled])


def assert_true(found) -> None:
    assert found.status.ok and found.judgement.explained
    for name, value in TRUE.items():
        low, high = found.intervals[name]
        assert low < value < high and found.values[name] == pytest.approx(value, rel=0.05)


@pytest.mark.slow
def test_friction_of_a_belt_axis_from_its_motor(belt, record):
    """From values far off; taken as one inertia, the Stribeck velocity is another one."""
    found = identify([record], belt.replace(**STATED))
    assert_true(found)
    assert found.model is None and found.servo.value("load_inertia") == 0.004
    low, high = identify([record], rigid(belt), 1.0, advise=False).intervals["friction.stribeck_velocity"]
    assert not low < TRUE["stribeck_velocity"] < high


@pytest.mark.slow
def test_friction_of_a_cascade_whose_load_is_seen(belt):
    """The controller has position and speed of the load, and the record is of that."""
    shared = {name: belt.value(name) for name in belt.parameters if name not in ("kp", "ki", "kd")}
    gains = {"kp": 4.0, "ki": 30.0, "kd": 0.12}
    Kp = float(min(np.roots([gains["kd"], -gains["kp"], gains["ki"]]).real))
    cascade = {"velocity_gain": 0.12, "position_gain": Kp, "reset_time": gains["kd"] * Kp / gains["ki"]}
    loop = Loop((TWO_MASSES_LOAD_SEEN, SWITCH, P_PI, INTEGRATOR), {**shared, **cascade})
    times, position = recorded({**belt.parameters, **gains}, -0.045, 80, 5e-3, load_seen=True)
    settled = times > 20
    noise = np.random.default_rng(4).normal(0, NOISE, times.size)
    found = identify([Record((times - 20)[settled], (position + noise)[settled])], loop.replace(**STATED))
    assert_true(found)


def test_one_inertia_has_the_gains_of_the_loop(belt):
    servo = rigid(belt)
    assert servo.inertia == pytest.approx(0.0052) and servo.torque_gains(2.0) == pytest.approx((8.0, 0.24, 60.0))
    plain = rigid(loop_of(Servo(), "switch", 0.04))
    assert plain.torque_gains(0.1) == pytest.approx(Servo().torque_gains(0.1))


@pytest.mark.parametrize(("parts", "asked", "sentence"), [
    (None, {"free": ["kp"]}, "free = kp: must be one of static, .*the friction of 'Switch friction'"),
    (None, {"free": []}, "must be at least one parameter, each once"),
    (None, {"drive": Drive(sample_time=1e-3)}, "drive: must be left out, a loop of parts is fitted as a continuous"),
    (None, {"torque": True}, "torque: must be left out, of a loop of parts positions alone are fitted"),
    ((TWO_MASSES, SWITCH, transfer_function([0.16, 2.0, 6.28], [0.001, 1.0, 0.0])), {},
     "'linear controller': gives no kd"),
])  # fmt: skip
def test_what_cannot_be_sought_says_why(belt, parts, asked, sentence):
    loop = belt if parts is None else Loop(parts)
    still = Record(np.arange(100.0), np.zeros(100))
    still = replace(still, torque=np.zeros(100)) if asked.pop("torque", False) else still
    with pytest.raises(InputError, match=sentence):
        check_axis(loop, **{"free": ["static"], "drive": None, "records": [still], **asked})
    with pytest.raises(InputError, match="model = 'switch': must be left out"):
        identify([still], belt, model="switch")


@pytest.mark.slow
def test_the_commands(capsys, tmp_path, record):
    """The files that it writes are read by the commands that go on; `cure` goes on by itself."""
    path, out = tmp_path / "belt.csv", tmp_path / "found"
    rows = [f"{t:.4f},{x:.8f}" for t, x in zip(record.times, record.position, strict=True)]
    path.write_text("\n".join(["time,position", *rows, ""]))
    stated = [word for name, value in STATED.items() for word in ("--set", f"{name}={value}")]
    words = path, "--servo", FILE, *stated, "--quiet"
    code, said, err = run(capsys, "identify", *words, "--json", "--out", out, "--plot", tmp_path / "fit.png")
    assert (code, err) == (0, "") and is_picture(tmp_path / "fit.png")
    found = one_json(said)["parameters"]
    assert found["static"]["low"] < 0.8 < found["static"]["high"]
    again = load_loop(out / "servo.toml")
    assert again.value("static") == found["static"]["value"] and again.value("load_inertia") == 0.004
    assert load_uncertainty(out / "friction.toml", again).intervals["static"][0] == found["static"]["low"]
    code, said, err = run(capsys, "cure", *words, "--only", "leak", "--jobs", 1)
    said = " ".join(said.split())
    assert "the model explains what was recorded" in said and "cheapest remedy: leak" in said
    assert "of the values as found" in said
