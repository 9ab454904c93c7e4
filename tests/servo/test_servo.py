"""The servo as validated records, and TOML in and out: every wrong input is one sentence."""

from __future__ import annotations

import dataclasses
from functools import partial

import numpy as np
import pytest
from servo_files import dump

from casahunt.errors import InputError
from casahunt.servo.controller import Controller, Pid
from casahunt.servo.friction import Friction
from casahunt.servo.parts.file import load
from casahunt.servo.servo import KEYS, PARAMETERS, Servo, flatten, unflatten, with_overrides
from problems import table1

# Table 1 of the report, typed in once more.
TABLE_1 = {
    "servo.inertia": 0.026,
    "servo.motor_gain": 16.0,
    "controller.lead_time": 0.15915494309189535,
    "controller.integral_time": 0.15915494309189535,
    "friction.static": 0.53,
    "friction.coulomb": 0.44,
    "friction.stribeck_velocity": 0.02,
    "friction.viscous": 0.1,
    "friction.stiffness": 22000.0,
    "friction.damping": 7.58,
    "friction.stick_band": 1e-6,
    "friction.stick_rate": 10.0,
}
MAY_BE_ZERO = {"controller.kd", "controller.lead_time", "friction.viscous", "friction.damping"}


def refusal(call, *arguments) -> str:
    """The message of the InputError that `call` must raise: one line."""
    with pytest.raises(InputError) as caught:
        call(*arguments)
    message = str(caught.value)
    assert "\n" not in message
    return message


@pytest.fixture
def file(tmp_path):
    """Write a servo file and return its path."""

    def write(text: str | bytes):
        path = tmp_path / "servo.toml"
        path.write_bytes(text if isinstance(text, bytes) else text.encode())
        return path

    return write


# Values ---------------------------------------------------------------------------------------------------


def test_default_is_table_1():
    assert flatten(Servo()) == TABLE_1
    assert set(KEYS) == set(TABLE_1) | set(GAINS)


def test_problem_file_is_table_1():
    assert table1.servo() == Servo()


def test_records_are_frozen():
    for record, name in ((Servo(), "inertia"), (Controller(), "lead_time"), (Friction(), "static")):
        with pytest.raises(dataclasses.FrozenInstanceError):
            setattr(record, name, 1.0)


def test_torque_gains_are_the_coefficients_of_the_controller():
    """cm C(s) = cm K (tau_d s + 1)(tau_i s + 1)/(tau_i s) = kp + kd s + ki/s."""
    servo = Servo(motor_gain=7.0, controller=Controller(lead_time=0.3, integral_time=0.7))
    kp, kd, ki = servo.torque_gains(0.2)
    for s in (1.0, -2.5, 0.4 + 3j):
        transfer = 7.0 * 0.2 * (0.3 * s + 1) * (0.7 * s + 1) / (0.7 * s)
        assert kp + kd * s + ki / s == pytest.approx(transfer, rel=1e-14)


def test_parameter_vector_follows_its_names():
    servo = Servo().replace(**{"friction.static": 0.5, "servo.inertia": 0.03})
    p = servo.parameters(0.25)
    expected = TABLE_1 | {"friction.static": 0.5, "servo.inertia": 0.03, "gain": 0.25}
    np.testing.assert_array_equal(p, [expected[name] for name in PARAMETERS])


def test_replace_leaves_the_original_alone():
    servo = Servo()
    changed = servo.replace(**{"friction.viscous": 0.2})
    assert changed.friction.viscous == 0.2
    assert servo == Servo()
    assert flatten(changed) == TABLE_1 | {"friction.viscous": 0.2}


# Ranges ---------------------------------------------------------------------------------------------------


GAINS = ("controller.kp", "controller.ki", "controller.kd")


def alone(key, value):
    """A servo file's values with one of them stated, and the other two gains of a controller by gains."""
    return {name: 1.0 for name in GAINS if key in GAINS} | {key: value}


@pytest.mark.parametrize("key", KEYS)
def test_negative_value(key):
    message = refusal(unflatten, alone(key, -0.5))
    bound = "at least 0" if key in MAY_BE_ZERO else "greater than 0"
    if key == "friction.coulomb":
        assert "friction.coulomb = -0.5: must be greater than 0" in message
    else:
        assert f"{key} = -0.5: must be {bound}" in message


@pytest.mark.parametrize("key", KEYS)
def test_zero(key):
    if key in MAY_BE_ZERO:
        assert flatten(unflatten(alone(key, 0.0)))[key] == 0.0
    else:
        assert f"{key} = 0: must be greater than 0" in refusal(unflatten, alone(key, 0.0))


@pytest.mark.parametrize("value", [float("nan"), float("inf"), -float("inf")])
def test_not_finite(value):
    for key in KEYS:
        assert f"{key} = {value!r}: must be a finite number" in refusal(unflatten, alone(key, value))


@pytest.mark.parametrize("value", [True, False, "0.5", None, [1.0], 1j, 10**400])
def test_not_a_number(value):
    for key in KEYS:
        message = refusal(unflatten, alone(key, value))
        assert message.startswith(f"{key} = {value!r}"[:40]), message
        assert "must be a finite number" in message and len(message) < 150


@pytest.mark.parametrize("value", [1e300, 1.7e308, 1.001e12, 0.999e-12, 1e-300, 5e-324])
def test_beyond_the_range_of_sensible_servos(value):
    """Key, value, range and why, in one sentence."""
    for key in KEYS:
        message = refusal(unflatten, {"friction.coulomb": 1e-12} | alone(key, value))
        assert message.startswith(f"{key} = {value:g}: must be ") and "between 1e-12 and 1e+12" in message
        assert "0 or between" in message if key in MAY_BE_ZERO else "0 or" not in message
        assert "double arithmetic" in message


def test_ends_of_the_range_belong_to_it():
    for end in (1e-12, 1e12):
        for key in KEYS:
            values = {"friction.coulomb": 1e-12, "friction.static": 1e12} | alone(key, end)
            assert flatten(unflatten(values))[key] == end


@pytest.mark.parametrize("value", [True, "0.026", float("nan"), 0.0, -1.0])
def test_records_check_themselves(value):
    """Not only the way in through a file."""
    for record, key in (
        (Servo, "servo.inertia"),
        (Servo, "servo.motor_gain"),
        (Controller, "controller.integral_time"),
        (partial(Pid, ki=1.0, kd=1.0), "controller.kp"),
        (partial(Pid, kp=1.0, kd=1.0), "controller.ki"),
        (Friction, "friction.coulomb"),
        (Friction, "friction.static"),
        (Friction, "friction.stribeck_velocity"),
        (Friction, "friction.stiffness"),
    ):
        message = refusal(lambda r=record, k=key: r(**{k.split(".")[1]: value}))
        assert key in message and "must be" in message


def test_static_below_coulomb():
    message = refusal(unflatten, {"friction.static": 0.4})
    assert "friction.static = 0.4: must be at least 0.44" in message
    assert "friction.coulomb" in message
    assert "friction.static = 0.53: must be at least 0.6" in refusal(unflatten, {"friction.coulomb": 0.6})


def test_static_equal_to_coulomb_is_a_servo():
    """Pure Coulomb friction is a valid servo; that it does not hunt is the answer, not an input error."""
    assert unflatten({"friction.static": 0.44}).friction.static == 0.44


@pytest.mark.parametrize("gain", [0.0, -0.1, float("nan"), float("inf"), True, "0.1"])
def test_gain(gain):
    message = refusal(Servo().parameters, gain)
    assert message.startswith("gain = ") and "must be" in message


# TOML -----------------------------------------------------------------------------------------------------


def test_round_trip_is_exact(file):
    rng = np.random.default_rng(3)
    for i in range(20):
        keys = [key for key in KEYS if key not in GAINS] if i % 2 else [key for key in KEYS if "_time" not in key]
        values = {key: float(rng.uniform(0.1, 1) * 10.0 ** rng.integers(-5, 6)) for key in keys}
        values["friction.static"] = values["friction.coulomb"] * float(rng.uniform(1, 3))
        servo = unflatten(values)
        assert flatten(load(file(dump(servo)))) == values


def test_left_out_keys_keep_table_1(file):
    assert load(file("")) == Servo()
    servo = load(file("[friction]\nviscous = 0.3\n"))
    assert flatten(servo) == TABLE_1 | {"friction.viscous": 0.3}


def test_integers_are_numbers(file):
    servo = load(file("[servo]\nmotor_gain = 16\n"))
    assert servo == Servo() and isinstance(servo.motor_gain, float)


@pytest.mark.parametrize(
    ("text", "wrong", "suggestion"),
    [
        ("[friction]\nstatik = 0.5\n", "friction.statik", "friction.static"),
        ("[servo]\ninertai = 0.5\n", "servo.inertai", "servo.inertia"),
        ("[controller]\nlead = 0.5\n", "controller.lead", "controller.lead_time"),
        ("[frictions]\nstatic = 0.5\n", "frictions", "friction"),
        ("[servo]\nstatic = 0.5\n", "servo.static", "friction.static"),
        ("[friction]\nlead_time = 0.5\n", "friction.lead_time", "controller.lead_time"),
    ],
)
def test_unknown_key_suggests_the_nearest(file, text, wrong, suggestion):
    message = refusal(load, file(text))
    assert f"{wrong!r}" in message
    assert f"did you mean {suggestion!r}?" in message


@pytest.mark.parametrize("section", ["servo", "friction"])
@pytest.mark.parametrize("word", ["saturation", "backlash", "mass", "delay", "gain", "j", "noise"])
def test_another_word_suggests_nothing(file, section, word):
    """`saturation` has half of the letters of `static`; a servo that is not in the model is not to be taken for one."""
    message = refusal(load, file(f"[{section}]\n{word} = 2\n"))
    assert f"'{section}.{word}'" in message and "did you mean" not in message


@pytest.mark.parametrize(
    ("word", "meant"),
    [
        ("coloumb", "friction.coulomb"), ("stribeck", "friction.stribeck_velocity"), ("lead", "controller.lead_time"),
        ("STATIC", "friction.static"), ("sattic", "friction.static"), ("static_friction", "friction.static"),
        ("kii", "controller.ki"), ("motorgain", "servo.motor_gain"),
    ],
)  # fmt: skip
def test_a_misspelling_and_a_beginning_suggest_what_is_meant(file, word, meant):
    assert f"did you mean {meant!r}?" in refusal(load, file(f"[friction]\n{word} = 2\n"))


def test_unknown_key_lists_the_known_ones(file):
    """Those of its table."""
    message = refusal(load, file("[servo]\nxyzzy = 1\n"))
    assert all((key in message) == key.startswith("servo.") for key in KEYS)
    assert "did you mean" not in message


def test_value_outside_any_table(file):
    assert "static = 0.5: must stand in its table [friction]" in refusal(load, file("static = 0.5\n"))


def test_section_that_is_no_table(file):
    assert "friction = 3: must be a table [friction]" in refusal(load, file("friction = 3\n"))


@pytest.mark.parametrize(
    "value", ["true", '"0.5"', "nan", "inf", "-inf", "[0.5]", "{ a = 1 }", "1979-05-27", "1" + 400 * "0"]
)
def test_value_in_a_file_that_is_no_finite_number(file, value):
    message = refusal(load, file(f"[friction]\nstatic = {value}\n"))
    assert message.startswith("servo file ") and "friction.static = " in message and "finite number" in message


def test_value_in_a_file_out_of_range(file):
    assert "servo.inertia = -1: must be greater than 0" in refusal(load, file("[servo]\ninertia = -1\n"))


@pytest.mark.parametrize(
    "text", ["[servo\n", "[servo]\ninertia = \n", "[servo]\ninertia = 1\ninertia = 2\n", b"\xff\xfe[servo]\n"]
)
def test_broken_toml(file, text):
    path = file(text)
    message = refusal(load, path)
    assert repr(str(path)) in message and "not valid TOML" in message and "point" not in message


@pytest.mark.parametrize("line", ["kd = 0,06", "kd = 0,06  # s", "kd=0,06"])
def test_a_decimal_comma_is_told(file, line):
    message = refusal(load, file(f"[controller]\nkp = 1\n{line}\n"))
    assert "not valid TOML" in message and message.endswith("; decimals take a point, 0.06")


@pytest.mark.parametrize(
    ("value", "what"),
    [
        ("1" * 5000, "number of too many digits"),
        ("[" * 20000 + "]" * 20000, "nested too deeply"),
        ("0x" + "1" * 5000, "servo.inertia = a value too long to be shown: must be a finite number"),
    ],
    ids=["digits", "brackets", "hexadecimal"],
)
def test_toml_beyond_the_limits_of_python(file, value, what):
    message = refusal(load, file(f"[servo]\ninertia = {value}\n"))
    assert message.startswith("servo file ") and what in message and len(message) < 300


def test_missing_file(tmp_path):
    path = tmp_path / "none.toml"
    message = refusal(load, path)
    assert repr(str(path)) in message and "no such file" in message


def test_folder_in_place_of_a_file(tmp_path):
    message = refusal(load, tmp_path)
    assert repr(str(tmp_path)) in message and "cannot be read" in message


# Overrides ------------------------------------------------------------------------------------------------


def test_overrides():
    servo = with_overrides(Servo(), ["friction.static=0.6", " servo.inertia = 3e-2 ", "friction.static=0.5"])
    assert flatten(servo) == TABLE_1 | {"friction.static": 0.5, "servo.inertia": 0.03}
    assert with_overrides(Servo(), []) == Servo()


def test_overrides_are_checked_together():
    """Fs and Fc may cross a range one at a time as long as the pair is right in the end."""
    servo = with_overrides(Servo(), ["friction.coulomb=0.7", "friction.static=0.8"])
    assert (servo.friction.coulomb, servo.friction.static) == (0.7, 0.8)


@pytest.mark.parametrize(
    ("text", "parts"),
    [
        ("friction.static", ["'friction.static'", "section.key=value"]),
        ("", ["''", "section.key=value"]),
        ("friction.statik=0.5", ["'friction.statik'", "did you mean 'friction.static'?"]),
        ("static=0.5", ["'static'", "did you mean 'friction.static'?"]),
        ("servo.static=0.5", ["'servo.static'", "did you mean 'friction.static'?"]),
        ("=0.5", ["unknown key ''"]),
        ("gain=0.5", ["'gain'"]),
        ("friction.static=abc", ["friction.static = 'abc'", "finite number"]),
        ("friction.static=", ["friction.static = ''", "finite number"]),
        ("friction.static=0.5=0.6", ["friction.static = '0.5=0.6'", "finite number"]),
        ("friction.static=nan", ["friction.static = nan", "finite number"]),
        ("friction.static=1e999", ["friction.static = inf", "finite number"]),
        ("friction.static=True", ["friction.static = 'True'", "finite number"]),
        ("friction.static=0.1", ["friction.static = 0.1", "at least 0.44"]),
        ("controller.integral_time=0", ["controller.integral_time = 0", "greater than 0"]),
    ],
)
def test_wrong_override(text, parts):
    message = refusal(with_overrides, Servo(), [text])
    for part in parts:
        assert part in message


def test_replace_refuses_unknown_keys():
    assert "did you mean 'friction.static'?" in refusal(lambda: Servo().replace(**{"friction.statik": 1.0}))
