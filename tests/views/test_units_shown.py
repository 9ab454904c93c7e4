"""What commands, pictures and results say of a linear axis: in its units, of the numbers that stand for it in SI."""

from __future__ import annotations

import csv
import math
import re

import numpy as np
import pytest
from command_line import one_json, run

from casahunt import Options, Units, basin, find_fold, find_orbit, load, pictures, simulate
from casahunt.axis_units import shown
from casahunt.quantities import in_si
from problems.ball_screw import BY_HAND, TOML

QUICK = {
    "orbit": (), "fold": ("--details",), "loop": ("--details",), "equilibria": ("--details",), "basin": ("--details",),
    "map": ("--details",), "simulate": ("--set-point", "0", "--position", "57 um", "--time", "2", "--details"),
    "remedies": ("--only", "leak", "--details"),
}  # fmt: skip


def said(text: str) -> str:
    """The answer, without the explanations of words, in one line."""
    return " ".join(text.split("what the words mean")[0].split())


@pytest.mark.parametrize("command", QUICK)
def test_nothing_is_said_in_radians(capsys, command, tmp_path):
    code, out, err = run(capsys, command, TOML, *QUICK[command], "--csv", tmp_path / "out.csv", "--quiet")
    assert code == 0, err
    text = said(out)
    assert not re.search(r"\d rad\b(?!/s)|V/rad|N m\b|degrees\)", text), text
    rates = re.findall(r"\d rad/s", text)
    assert not rates or command == "loop"  # where they are frequencies
    header = (tmp_path / "out.csv").read_text().partition("\n")[0]
    assert "_rad" not in header.replace("crossover_rad_per_s", "") and "Nm" not in header
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


def test_a_rotary_axis_in_degrees(capsys, tmp_path):
    path = tmp_path / "servo.toml"
    path.write_text('[units]\nangle = "deg"\ntorque = "mN m"\n[friction]\nstatic = "530 mN m"\n')
    _, plain, _ = run(capsys, "simulate", "--gain", "0.04", "--time", "30", "--quiet")
    _, out, _ = run(capsys, "simulate", path, "--gain", "0.04", "--time", "30 s", "--quiet", "--set-point", "1")
    amplitude = re.search(r"amplitude +(\S+) rad \((\S+) degrees\)", plain)
    assert f"amplitude        {float(amplitude[2]):g} deg\n" in out
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
