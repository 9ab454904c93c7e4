"""What commands, pictures and results say of a linear axis: in its units, of the numbers that stand for it in SI."""

from __future__ import annotations

import csv
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest
from command_line import one_json, run
from servo_files import linear_axis

from casahunt import (
    Demands,
    Drive,
    InputError,
    NoOrbit,
    Options,
    Units,
    basin,
    find_fold,
    find_orbit,
    load,
    load_orbit,
    pictures,
    remedies,
    save_orbit,
    simulate,
    simulate_sampled,
    tune,
)
from casahunt.axis_units import shown, shown_in
from casahunt.quantities import in_si
from casahunt.servo.units import value_of
from casahunt.views.answers.tune import worst_values
from problems.ball_screw import BY_HAND, TOML

QUICK = {
    "orbit": (), "fold": ("--details",), "loop": ("--details",), "equilibria": ("--details",), "basin": ("--details",),
    "map": ("--details",), "simulate": ("--set-point", "0", "--position", "57 um", "--time", "2", "--details"),
    "remedies": ("--only", "leak", "--details"),
}  # fmt: skip


SCREW_AXIS = linear_axis(
    "Switch friction",
    mass=2.16, static=133.0, coulomb=113.0, stribeck_velocity=0.00406, viscous=347.0, position_gain=36.4,
    velocity_gain=264.0, reset_time=0.0246,
)  # fmt: skip


def said(text: str) -> str:
    """The answer, without the explanations of words, in one line."""
    return " ".join(text.split("what the words mean")[0].split())


SLOW = "map", "remedies"


@pytest.mark.parametrize("command", [pytest.param(c, marks=[pytest.mark.slow] if c in SLOW else []) for c in QUICK])
def test_nothing_is_said_in_radians(capsys, command, tmp_path):
    code, out, err = run(capsys, command, TOML, *QUICK[command], "--csv", tmp_path / "out.csv", "--quiet")
    assert code == 0, err
    text = said(out)
    assert not re.search(r"\d rad\b(?!/s)|V/rad|N m\b|degrees\)", text), text
    assert bool(re.findall(r"\d rad/s", text)) == (command == "loop")  # where they are frequencies
    header = (tmp_path / "out.csv").read_text().partition("\n")[0]
    assert "_rad" not in header.replace("crossover_rad_per_s", "") and "Nm" not in header
    assert ("crossover_rad_per_s" in header) == (command == "loop")
    assert shown() == Units()  # what a command shows is its own affair


def quantity_behind(text: str, words: str, unit: str) -> float:
    """The quantity behind some words of an answer, in SI."""
    return in_si(words, re.search(rf"{words} +([-\d.e]+ \S+)", text)[1].rstrip(",;."), (unit,))


def test_the_numbers_are_those_of_the_axis_in_si(capsys):
    servo = load(TOML)
    orbit, fold, border = (
        find_orbit(BY_HAND, "switch", 1.0), find_fold(BY_HAND, "switch"), basin(BY_HAND, "switch", 1.0)
    )  # fmt: skip
    own = find_orbit(servo, "switch", 1.0)
    assert (own.amplitude, own.period) == (orbit.amplitude, orbit.period)  # to the last bit
    assert find_fold(servo, "switch").gain == fold.gain
    _, out, _ = run(capsys, "orbit", TOML, "--quiet")
    assert quantity_behind(said(out), "amplitude", "m") == pytest.approx(orbit.amplitude, rel=1e-3)
    _, out, _ = run(capsys, "fold", TOML, "--quiet")
    assert quantity_behind(said(out), "up to gain", "V/m") == pytest.approx(fold.gain, rel=1e-3)
    _, out, _ = run(capsys, "basin", TOML, "--quiet")
    assert quantity_behind(said(out), "sticks within", "m") == pytest.approx(border.border, rel=1e-3)


def test_tables_are_in_the_unit_that_is_asked_for(capsys, tmp_path):
    path = tmp_path / "motion.csv"
    words = "--set-point", "1 mm", "--time", "1", "--csv", path, "--quiet"
    assert run(capsys, "simulate", TOML, *words)[0] == 0
    rows = list(csv.DictReader(path.read_text().splitlines()))
    assert list(rows[0]) == ["time_s", "position_mm", "velocity_mm_per_s", "integral_mm_s", "force_N", "mode"]
    motion = simulate(BY_HAND, "switch", 1.0, set_point=1e-3, time=1.0)
    table = motion.table()
    for name, column, factor in (("position_mm", "position_rad", 1e3), ("force_N", "torque_Nm", 1.0)):
        mine = np.array([float(row[name]) for row in rows])
        np.testing.assert_allclose(mine, factor * np.asarray(table[column]), rtol=1e-15, atol=0)
    own = simulate(load(TOML), "switch", 1.0, set_point=1e-3, time=1.0)
    own.to_csv(tmp_path / "python.csv")
    assert (tmp_path / "python.csv").read_text() == path.read_text()


def test_the_table_of_a_fold_curve_is_in_the_unit_that_is_asked_for(capsys):
    """A ball screw in millimetres: its amplitudes, of SI, 1000 times."""
    friction = BY_HAND.friction.static
    asked = "--vary", "friction.static", "--from", str(friction), "--to", str(1.01 * friction), "--points", "2"
    _, out, _ = run(capsys, "fold-curve", TOML, *asked, "--quiet")
    lines = out.splitlines()
    k = next(i for i, line in enumerate(lines) if "amplitude" in line)
    names, row = lines[k].replace("gain V/m", "gain").replace("period s", "period").split(), lines[k + 1].split()
    assert names[2:4] == ["amplitude", "mm"]
    assert float(row[2]) == pytest.approx(1e3 * find_fold(BY_HAND, "switch").orbit.amplitude, rel=1e-3)


def test_json_and_results_are_in_si_and_say_so(capsys):
    code, out, _ = run(capsys, "orbit", TOML, "--json", "--quiet")
    found, orbit = one_json(out), find_orbit(load(TOML), "switch", 1.0)
    assert code == 0 and found["amplitude"] == orbit.amplitude
    assert found["units"] == {
        "motion": "linear", "length": "m", "force": "N", "mass": "kg", "gain": "V/m", "time": "s",
    }  # fmt: skip
    assert {q.name: q.unit for q in orbit.quantities()} | {"gain": "V/m", "amplitude": "m"} == {
        q.name: q.unit for q in orbit.quantities()
    }
    assert "rad" not in repr(orbit) and "units" not in find_orbit(BY_HAND, "switch", 1.0).to_dict()
    assert list(orbit.to_dict()["table"]) == ["time_s", "x1_m", "x2_m_per_s", "x3_m_s"]


def test_sentences_of_python_results_are_in_the_units_of_their_servo():
    motion = simulate(load(TOML), "switch", 1.0, position=57e-6, set_point=0.0, time=2.0)
    assert "by 57.18 um to either side" in motion.verdict.sentence
    assert shown() == Units()
    rotary = simulate(BY_HAND, "switch", 1.0, position=57e-6, set_point=0.0, time=2.0)
    assert "by 5.718e-05 rad to either side" in rotary.verdict.sentence


def test_pictures_are_in_the_units_of_their_servo():
    orbit, hand = (find_orbit(servo, "switch", 1.0) for servo in (load(TOML), BY_HAND))
    above, _, below = pictures.time_traces([orbit])
    assert (above.get_ylabel(), below.get_ylabel()) == ("x₁ [um]", "x₃ [um s]")
    line, other = above.lines[0], pictures.time_traces([hand])[0].lines[0]
    assert np.abs(line.get_ydata()).max() == pytest.approx(1e6 * hand.amplitude, rel=1e-9)
    assert line.get_xdata() == pytest.approx(other.get_xdata())
    motion = simulate(load(TOML), "switch", 1.0, set_point=1e-3, time=1.0)
    three = pictures.motion(motion)
    assert [axes.get_ylabel() for axes in three] == ["position x [mm]", "velocity x' [mm/s]", "motor force F [N]"]
    assert three[0].lines[-1].get_ydata()[0] == 1.0  # the set point
    text = " ".join(text.get_text() for text in three[0].figure.findobj(match=lambda item: hasattr(item, "get_text")))
    assert not re.search(r"\brad\b|N m", text)


def test_values_with_units_on_the_command_line(capsys):
    plain = run(capsys, "orbit", TOML, "--quiet", "--set", "friction.static=95")
    assert run(capsys, "orbit", TOML, "--quiet", "--set", "friction.static=0.095 kN") == plain
    assert run(capsys, "orbit", TOML, "--quiet", "--set", "friction.static = 95 N", "--gain", "0.001 V/mm") == plain
    code, out, err = run(capsys, "simulate", TOML, "--position", "57 deg")
    assert (code, out) == (2, "") and "position = '57 deg': must be in m" in err and "the axis is linear" in err
    code, out, err = run(capsys, "orbit", TOML, "--set", "friction.static=95 N m")
    assert (code, out) == (2, "") and "friction.static = '95 N m': must be in N" in err
    code, out, err = run(capsys, "simulate", "--gain", "0.04", "--position", "57 um")
    assert (code, out) == (2, "") and "must be in rad" in err and "the axis is rotary" in err


@pytest.mark.parametrize("encoder", [("--encoder", "2 um"), ("--set", "drive.encoder=2 um")])
def test_the_drive_of_a_linear_axis_is_changed_on_the_command_line(capsys, encoder):
    """A count was read twice, and refused as one of a turn; of a sample time only the number was taken."""
    words = ("--gain", "1", "--time", "0.02", "--sample-time", "0.5 ms", "--delay", "0.1 ms", "--json")
    found = one_json(run(capsys, "simulate", "problems/ball_screw.toml", *words, *encoder)[1])["drive"]
    assert 2 * math.pi / found["encoder"] == pytest.approx(2e-6, rel=1e-12)
    assert (found["sample_time"], found["delay"]) == pytest.approx((0.5e-3, 0.1e-3), rel=1e-12)


@pytest.mark.parametrize(("text", "turns"), [("45 Hz", 45), ("0.045 kHz", 45), ("2700 rpm", 45), ("45 rev/s", 45)])
@pytest.mark.parametrize("motion", ["rotary", "linear"])
def test_a_frequency_of_a_filter_has_its_unit(text, turns, motion):
    assert value_of("low_pass", text, Units(motion)) == pytest.approx(2 * math.pi * turns, rel=1e-15)
    for plain in ("0.8 1/ms", "800 1/s", "800 rad/s"):
        assert value_of("notch_frequency", plain, Units(motion)) == 800
    with pytest.raises(InputError, match="low_pass = '800 s': must be in 1/s or Hz"):
        value_of("low_pass", "800 s", Units(motion))


def test_states_of_a_load_are_in_the_units_of_the_axis(capsys, tmp_path):
    """On one file they stood in metres beside millimetres: as it swings, as its drive samples it, and in sentences."""
    belt = (Path(TOML).parent / "belt_axis.toml").read_text()
    files = {"swings.toml": belt[: belt.index("[drive]")], "sampled.toml": belt}
    for name, text in files.items():
        (tmp_path / name).write_text(text)
        words = "--time", "0.2", "--csv", tmp_path / f"{name}.csv", "--quiet"
        assert run(capsys, "simulate", tmp_path / name, *words)[0] == 0
        first, *_, last = csv.DictReader((tmp_path / f"{name}.csv").read_text().splitlines())
        assert float(first["load_angle_mm"]) == -1 and "load_rate_mm_per_s" in first
        assert float(last["load_angle_mm"]) == pytest.approx(float(last["position_mm"]) - 1, abs=0.05)  # the belt gives
    _, out, _ = run(capsys, "simulate", tmp_path / "swings.toml", "--time", "0.2", "--quiet")
    assert re.search(r"load_rate -?[.\de-]+ [um]m/s", " ".join(out.split()))


def test_a_fold_in_a_velocity_is_said_in_that_of_the_axis(capsys, tmp_path):
    """It was called 0.0157 rad/s. An own simulator hunts with 15.23 mm/s, by 0.309 mm, and rests with 16.17."""
    (tmp_path / "axis.toml").write_text(SCREW_AXIS)
    _, out, _ = run(capsys, "fold", tmp_path / "axis.toml", "--vary", "stribeck_velocity", "--quiet")
    ends = re.search(r"goes up to stribeck_velocity (\S+) mm/s", " ".join(out.split()))
    assert 15.23 < float(ends[1]) < 16.17


@pytest.mark.parametrize(("mass", "leaves"), [(30.0, False), (34.0, True)])
def test_an_orbit_says_where_the_servo_leaves_it_for_good(capsys, tmp_path, mass, leaves):
    """Without dry friction the loop is stable for (viscous + Kv) (Kp + 1/Tn) > mass Kp/Tn: up to 31.8 kg."""
    (tmp_path / "axis.toml").write_text(SCREW_AXIS.replace("mass = 2.16", f"mass = {mass}"))
    code, out, _ = run(capsys, "orbit", tmp_path / "axis.toml", "--quiet")
    assert code == 0 and ("from far enough the servo leaves the set point for good" in said(out)) is leaves


def test_the_worst_values_of_a_set_have_their_units():
    with shown_in(Units("linear", "mm")):
        said = worst_values({"viscous": 330.4, "load_inertia": 5.684})
    assert said == "viscous = 0.3304 N s/mm, load_mass = 5.684 kg"


def test_where_no_step_is_stated_it_is_one_unit_of_length():
    """Not a metre: the force with which it begins is kp times a millimetre, 240 N/mm."""
    servo = load(TOML)
    assert simulate(servo, "switch", 1.0, time=0.5).peak_torque == pytest.approx(240.0, rel=1e-12)
    table = remedies(servo, "switch", 1.0, only=["reset"])
    assert table.step == 1e-3 and table.remedies[0].peak_torque == pytest.approx(240.0, rel=1e-12)
    assert simulate_sampled(servo, 1.0, Drive(sample_time=1e-3), time=1.0).set_point == 1e-3
    with pytest.raises(NoOrbit, match=r"100 N on a step of 0\.5 mm allows gains of at most 0\.833333"):
        tune(servo, "switch", demands=Demands(max_torque=100.0, step=5e-4))


@pytest.mark.slow
def test_the_table_of_a_diagram(capsys, tmp_path):
    out, words = tmp_path / "diagram", ("--model", "switch", "--from", "1.3 V/m", "--quiet")
    for _ in range(2):  # the second run knows the files of the first one as its own
        assert run(capsys, "diagram", TOML, *words, "--out", out)[0] == 0
    header, first, *_ = (out / "switch.csv").read_text().splitlines()
    assert header.startswith("gain,amplitude_mm,period_s")
    hand = find_orbit(BY_HAND, "switch", 1.3)
    assert float(first.split(",")[1]) == pytest.approx(1e3 * hand.amplitude, rel=1e-6)


def test_an_orbit_on_disk_keeps_its_units(tmp_path):
    save_orbit(find_orbit(load(TOML), "switch", 1.3), tmp_path / "orbit.npz")
    assert load_orbit(tmp_path / "orbit.npz").servo.units == load(TOML).units


@pytest.mark.slow
def test_the_page_of_remedies(capsys, tmp_path):
    code, _, err = run(capsys, "remedies", TOML, "--only", "leak", "--out", tmp_path / "page", "--quiet")
    assert code == 0, err
    page = (tmp_path / "page" / "remedies.html").read_text()
    page = re.sub(r'src="data:[^"]*"|<style>.*?</style>', "", page, flags=re.S)
    text = " ".join(re.sub(r"<[^>]+>", " ", page).replace("&nbsp;", " ").split())
    assert "57.18 um" in text and "servo: mass" in text
    assert not re.search(r"\brad\b|N m\b", text)
    assert json.loads((tmp_path / "page" / "remedies.json").read_text())["units"]["length"] == "m"


def test_parameters_go_by_their_names(capsys):
    ends = "--vary", "servo.mass", "29 kg", "31 kg", "--and", "friction.static", "88 N", "92 N"
    code, out, err = run(capsys, "fold-map", TOML, *ends, "--points", "2", "--json", "--quiet")
    assert code == 0, err
    found = one_json(out)
    low = find_fold(BY_HAND.replace(**{"servo.inertia": 29.0, "friction.static": 88.0}), "switch").gain
    assert found["gains"][0][0] == pytest.approx(low, rel=1e-5)


def test_the_page_of_explore_is_of_a_rotary_axis(capsys):
    code, out, err = run(capsys, "explore", TOML, "--no-browser")
    assert (code, out) == (2, "") and "leave [units] out" in err


@pytest.mark.slow
def test_identify_writes_the_axis(capsys, tmp_path):
    t, random = np.arange(0.0, 20.0, 0.002), np.random.default_rng(1)
    x = simulate(BY_HAND, "switch", 1.0, set_point=0.0, position=57e-6, time=20.0).sample(t)[0]
    rows = zip(t.tolist(), (1e3 * x + random.normal(0, 2e-5, t.size)).tolist(), strict=True)
    record = tmp_path / "record.csv"
    record.write_text("time [s],position [mm]\n" + "".join(f"{a!r},{b!r}\n" for a, b in rows))
    code, out, err = run(capsys, "identify", record, "--servo", TOML, "--quiet", "--out", tmp_path / "found")
    assert code == 0, err
    assert re.search(r"stribeck_velocity +2(\.0*\d*)? .* mm/s|stribeck_velocity +1\.99\d* .* mm/s", out)
    found = load(tmp_path / "found" / "servo.toml")
    assert found.units == load(TOML).units and found.friction.static == pytest.approx(90.0, rel=1e-3)


def test_a_rotary_axis_in_degrees(capsys, tmp_path):
    path = tmp_path / "servo.toml"
    path.write_text('[units]\nangle = "deg"\ntorque = "mN m"\n[friction]\nstatic = "530 mN m"\n')
    _, plain, _ = run(capsys, "simulate", "--gain", "0.04", "--time", "30", "--quiet")
    _, out, _ = run(capsys, "simulate", path, "--gain", "0.04", "--time", "30 s", "--quiet", "--set-point", "1")
    amplitude = re.search(r"amplitude +(\S+) rad \((\S+) degrees\)", plain)
    assert f"amplitude        {float(amplitude[2]):g} deg, half of its largest swing" in out
    torque = re.search(r"largest torque +(\S+) N m", plain)
    assert float(re.search(r"largest torque +(\S+) mN m", out)[1]) == pytest.approx(1e3 * float(torque[1]), rel=1e-3)


def test_records_in_mm(capsys, tmp_path):
    t = np.arange(0.0, 20.0, 0.005)
    x = simulate(BY_HAND, "switch", 1.0, set_point=0.0, position=57e-6, time=20.0).sample(t)[0]
    path = tmp_path / "record.csv"
    rows = zip(t.tolist(), (1e3 * x).tolist(), strict=True)
    path.write_text("time [s],position [mm]\n" + "".join(f"{a!r},{b!r}\n" for a, b in rows))
    code, out, _ = run(capsys, "record", path, TOML, "--gain", "1", "--json", "--quiet")
    found = one_json(out)
    orbit = find_orbit(BY_HAND, "switch", 1.0, options=Options(tol=1e-8))
    assert code == 0 and found["amplitude"] == pytest.approx(orbit.amplitude, rel=1e-3)
    _, out, _ = run(capsys, "record", path, TOML, "--gain", "1", "--quiet")
    assert "amplitude         57.18" in out and " um" in out and "rad" not in out
    code, _, err = run(capsys, "record", path)
    assert code == 2 and "'mm' is no unit of angle" in err
    assert math.isfinite(found["noise"])


def test_a_linear_axis_without_a_bristle_has_no_lugre_friction(capsys, tmp_path):
    """Nothing is taken from Table 1, whose bristle is that of a rotary servo; the Switch model needs none."""
    path = tmp_path / "axis.toml"
    lines = Path(TOML).read_text().splitlines(True)
    path.write_text("".join(line for line in lines if line.partition(" =")[0] not in ("stiffness", "damping")))
    for words in (("orbit", path, "--gain", 1, "--model", "lugre"), ("diagram", path)):
        code, _, err = run(capsys, *words)
        assert code == 2 and "friction.stiffness, friction.damping: must be given for the lugre model" in err
    given = "--set", "friction.stiffness=30 N/um", "--set", "friction.damping=30 N s/mm"
    assert run(capsys, "orbit", path, "--gain", 1, "--quiet")[0] == 0
    assert run(capsys, "orbit", path, "--gain", 1, "--model", "lugre", *given, "--quiet")[0] == 0
