"""Friction of axes of parts from records that scipy's DOP853 makes, with events."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from belt_support import recorded
from command_line import is_picture, one_json, run

from casahunt import Drive, InputError, Record, Servo, identify, load_uncertainty, simulate_sampled
from casahunt.design.identify.axis import check_axis, lags_taken, rigid
from casahunt.servo.parts import (
    BY_DIRECTION,
    INERTIA,
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
    (None, {"torque": True}, "torque: must be left out, of a loop of parts positions alone are fitted"),
    ((TWO_MASSES, SWITCH, transfer_function([0.16, 2.0, 6.28], [0.001, 1.0, 0.0])), {},
     "'linear controller': gives no kd"),
])  # fmt: skip
def test_what_cannot_be_sought_says_why(belt, parts, asked, sentence):
    loop = belt if parts is None else Loop(parts)
    still = Record(np.arange(100.0), np.zeros(100))
    still = replace(still, torque=np.zeros(100)) if asked.pop("torque", False) else still
    with pytest.raises(InputError, match=sentence):
        check_axis(loop, **{"free": ["static"], "records": [still], **asked})
    with pytest.raises(InputError, match="model = 'switch': must be left out"):
        identify([still], belt, model="switch")


SLIDE = {
    "inertia": 8.81, "load_inertia": 10.2, "shaft_stiffness": 2.13e6, "shaft_damping": 685.0, "motor_gain": 1.0,
    "gain": 1.0, "position_gain": 33.6, "velocity_gain": 901.0, "reset_time": 0.0338, "static": 57.3, "coulomb": 29.2,
    "stribeck_velocity": 1.86e-3, "viscous": 582.0,
}  # fmt: skip
"""A linear axis [kg, m, N, s] of 0.29 mm and 0.8 s."""
DRIVE = Drive(sample_time=4.8e-4, delay=6.7e-4, encoder=2 * np.pi / 1e-6)
"""Counts of a micrometre."""


def as_read(loop: Loop, seen: str, every: int) -> Record:
    """Every so many readings of its drive, two periods behind the start."""
    motion = simulate_sampled(loop, None, DRIVE, set_point=0.0, position=-3e-4, time=9.0)
    kept = np.flatnonzero(motion.times[:-1] > 2.0)[::every]
    x = motion.states[motion.names.index(seen)][kept]
    return Record(motion.times[kept], DRIVE.count * np.floor(x / DRIVE.count + 0.5))


@pytest.mark.slow
@pytest.mark.parametrize(("plant", "seen", "every"), [(TWO_MASSES, "x1", 1), (TWO_MASSES_LOAD_SEEN, "load_angle", 4)])
def test_friction_of_an_axis_as_its_drive_runs_it(plant, seen, every):
    """Sampling, delay and counts are followed; without them what is found is the friction of no such axis."""
    loop = Loop((plant, SWITCH, P_PI, INTEGRATOR), SLIDE)
    record, stated = as_read(loop, seen, every), loop.replace(static=70.0, coulomb=40.0, viscous=300.0)
    found = identify([record], stated, drive=DRIVE)
    assert found.status.ok and found.judgement.explained and found.records[0].drive is DRIVE
    for name, (low, high) in found.intervals.items():
        assert low < SLIDE[name] < high and found.values[name] == pytest.approx(SLIDE[name], rel=0.05)
    try:
        low, high = identify([record], stated).intervals["viscous"]
    except InputError:  # it does not explain it
        return
    assert not low < SLIDE["viscous"] < high


def test_where_friction_differs_by_direction_no_drive_is_taken():
    """Its swings to and fro differ, and are compared as one."""
    values = {name: SLIDE[name] for name in SLIDE if name[:4] not in ("load", "shaf")}
    loop = Loop((INERTIA, BY_DIRECTION, P_PI, INTEGRATOR), values)
    assert lags_taken(loop, [1.0], DRIVE) == (None, 0.0) and lags_taken(loop, [1.0], None) == (None, 0.0)
    plain = Loop((INERTIA, SWITCH, P_PI, INTEGRATOR), values)
    drive, left_out = lags_taken(plain, [1.0], DRIVE)
    kp = 901.0 * (33.6 + 1 / 0.0338)
    assert drive is DRIVE and left_out == pytest.approx(np.sqrt(kp / 8.81) * (4.8e-4 + 6.7e-4), rel=1e-9)


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
