"""Tuning of axes of parts: as of the plain servo where they are one; poles of the whole loop; DOP853 with events."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
from belt_support import stops
from command_line import one_json, run

from casahunt import Demands, InputError, NoOrbit, Servo, Uncertainty, linear_loop, tune
from casahunt.design.tune.demands import cost_of
from casahunt.design.tune.loop_set import Table, allowed, loop_box, shortfall
from casahunt.design.tune.parts_set import parts_box
from casahunt.servo.linear.sampled_loop import Lag
from casahunt.servo.parts import (
    DEAD_BAND,
    DERIVATIVE_FILTER,
    INERTIA,
    INTEGRATOR,
    P_PI,
    SWITCH,
    TWO_MASSES_LOAD_SEEN,
    Loop,
    load_loop,
    loop_of,
    transfer_function,
)
from problems import belt as problem

FILE = Path(problem.__file__).with_name("belt.toml")
BOX = {"static": (0.76, 0.84), "load_inertia": (0.003, 0.005)}
DECAYED = 60
"""Stops after which nothing moves any more; where it hunts there are as many as are asked for."""


@pytest.fixture(scope="module")
def belt() -> Loop:
    return load_loop(FILE)


@pytest.fixture
def quickly(monkeypatch):
    """Leave out the motions from rest and most samples of the set: they take seconds, and have a test of their own."""
    monkeypatch.setattr("casahunt.design.tune.check.scanned", lambda *_: ("not asked", "clear"))
    monkeypatch.setattr("casahunt.design.tune.check._simulated", lambda *_: ([], []))


@pytest.mark.parametrize(
    ("demands", "binding"),
    [(Demands(), "hunting margin"), (Demands(phase_margin=85), "phase margin"),
     (Demands(phase_margin=79, delay=1e-3), "phase margin")],
)  # fmt: skip
def test_the_plain_servo_in_parts_is_tuned_as_it_is(quickly, unscanned, demands, binding):
    """The margins of one inertia in closed form, and by the response of the parts."""
    loop = loop_of(Servo(), "switch", 0.04)
    found, own = tune(loop, demands=demands), tune(Servo(), "switch", demands=demands)
    assert found.gain == pytest.approx(own.gain, rel=5e-5) and found.binding == own.binding == (binding,)
    assert found.verification.result == "verified"


@pytest.mark.parametrize("gain", [0.2, 0.7])
@pytest.mark.parametrize("name", ["phase margin", "gain margin (lowering)", "gain margin (raising)"])
def test_worst_loops_of_a_set_are_those_in_closed_form(name, gain):
    loop = loop_of(Servo(), "switch", 0.04)
    keys = {"inertia": "servo.inertia", "viscous": "friction.viscous", "static": "friction.static"}
    box = {"inertia": (0.02, 0.03), "viscous": (0.05, 0.1), "static": (0.5, 0.6)}
    parts = parts_box(loop, box, Lag(delay=2e-3))
    own = loop_box(Servo(), {keys[key]: ends for key, ends in box.items()}, Lag(delay=2e-3))
    assert parts.names == ("inertia", "viscous", "motor_gain")  # friction alone changes no linear loop
    a, b = (shortfall([each], Demands(), gain, name) for each in (parts, own))
    assert a[0] == pytest.approx(b[0], abs=2e-5)
    assert list(a[1].values.values()) == pytest.approx([b[1].values[keys[key]] for key in a[1].values])


def test_what_is_asked_of_a_load_that_is_seen_holds_by_its_poles():
    """A shaft behind the motor takes phase: with the largest gain that is allowed, and 1.999 times as much, every
    corner is stable by its poles, and with 2.001 times not."""
    numbers = {"inertia": 0.0012, "load_inertia": 0.004, "shaft_stiffness": 180.0, "shaft_damping": 0.05, "gain": 1.0,
               "motor_gain": 1.0, "position_gain": 8.0, "velocity_gain": 0.12, "reset_time": 0.3, "viscous": 0.02}
    loop = Loop((TWO_MASSES_LOAD_SEEN, SWITCH, P_PI, INTEGRATOR), numbers)
    ends = {"load_inertia": (0.0035, 0.0045), "shaft_stiffness": (150.0, 200.0)}
    boxes = [parts_box(loop, ends, Lag())]
    table = Table(boxes, Demands(), 0.01, 100.0)
    ((_, most),) = allowed(boxes, Demands(), table, "gain margin (raising)")
    corners = [loop.replace(load_inertia=i, shaft_stiffness=k) for i in (0.0035, 0.0045) for k in (150.0, 200.0)]
    stable = {factor: [linear_loop(each, factor * most).stable for each in corners] for factor in (1.0, 1.999, 2.001)}
    assert all(stable[1.0]) and all(stable[1.999]) and not all(stable[2.001])


@pytest.mark.slow
def test_a_tuned_belt_comes_to_rest_at_its_worst_values(belt):
    """From several starts, by DOP853."""
    found = tune(belt, uncertainty=Uncertainty(BOX))
    assert found.verification.result == "verified" and found.binding == ("hunting margin",)
    assert found.gain == pytest.approx(1.1 * found.fold_gain, rel=1e-9)
    assert found.corner == {"static": 0.84, "load_inertia": 0.005}
    amplitude = found.verification.fold.orbit.amplitude
    tuned = found.worst.replace(gain=found.gain).parameters
    for start in (0.5, 1.02, 3.0, 30.0):
        assert all(abs(x) < amplitude / 2 for _, x in stops(tuned, -start * amplitude, 2 * DECAYED)[DECAYED:])
    assert found.to_dict()["proves_not"][1].startswith("Optimum") and found.to_dict()["kd"] == 0.12


@pytest.mark.slow
def test_free_numbers_of_a_cascade(belt):
    """Settling of the linear loop: better than with the numbers as given, at a bound or between."""
    shared = {name: belt.value(name) for name in belt.parameters if name not in ("kp", "ki", "kd")}
    cascade = Loop(tuple(P_PI if part.name == "PID by gains" else part for part in belt.parts),
                   {**shared, "position_gain": 25.0, "velocity_gain": 0.12, "reset_time": 0.1})  # fmt: skip
    bounds = {"gain": (8.0, 20.0), "reset_time": (0.06, 0.2)}
    found = tune(cascade, free=["reset_time"], bounds=bounds, cost="settling")
    assert found.cost_value < found.gain_only and found.gain >= 1.1 * found.fold_gain
    assert 0.06 <= found.servo.value("reset_time") <= 0.2 and found.verification.ok


@pytest.mark.parametrize(("parts", "asked", "sentence"), [
    ((DEAD_BAND,), {}, "is not linear: dead band"),
    ((), {"free": ["position_gains"]}, "did you mean 'position_gain'"),
    ((), {"free": ["position_gain", "velocity_gain", "reset_time"]}, "must be 2 at most"),
    ((), {"free": ["static"]}, "unknown free 'static'"),
    ((), {"model": "switch"}, "must be left out, a loop has its friction as a part"),
    ((), {"demands": Demands(max_torque=0.5)}, "the largest torque of 0.5 N m"),
])  # fmt: skip
def test_what_cannot_be_tuned_says_why(quickly, parts, asked, sentence):
    loop = Loop((INERTIA, SWITCH, P_PI, INTEGRATOR, *parts), {"gain": 0.04} | ({"dead_band": 0.01} if parts else {}))
    with pytest.raises((InputError, NoOrbit), match=sentence):
        tune(loop, **asked)


def test_a_filter_time_may_be_free_and_a_controller_without_derivative_gain_has_no_such_cost():
    loop = Loop((INERTIA, SWITCH, P_PI, INTEGRATOR, DERIVATIVE_FILTER), {"gain": 0.04, "derivative_filter": 1e-3})
    assert loop.tunable_names[-1] == "derivative_filter"
    other = Loop((INERTIA, SWITCH, transfer_function([0.16, 2.0, 6.28], [0.001, 1.0, 0.0])), {"gain": 0.04})
    with pytest.raises(InputError, match="kd: 'linear controller' gives none"):
        cost_of("high-frequency", other, 1.0)
    assert cost_of("high-frequency", loop, 2.0) == pytest.approx(2 * loop.value("velocity_gain"))


def test_the_command(capsys, tmp_path, monkeypatch):
    monkeypatch.setattr("casahunt.design.tune.check.scanned", lambda *_: ("not asked", "clear"))
    out = tmp_path / "tuned"
    code, said, err = run(capsys, "tune", FILE, "--out", out, "--quiet", "--details")
    assert (code, err) == (0, "") and "loop: recommended gain 10.27 V/rad" in said
    assert "flexibility" not in said and "what is none of its parts" in said
    record = json.loads((out / "tune.json").read_text())
    assert record["servo"]["load_inertia"] == 0.004 and record["model"] is None
    page = (out / "tune.html").read_text()
    assert "motions from rest" in page and "load_inertia" in page.replace(" ", "_")
    code, said, err = run(capsys, "tune", FILE, "--max-torque", 10, "--quiet")
    assert (code, said) == (1, "") and "allows gains of at most 2.5; 10.2658 takes 41.06 N m" in err
    words = "tune", FILE, "--phase-margin", 45, "--json", "--quiet"
    assert one_json(run(capsys, *words)[1])["binding"] == ["hunting margin"]
