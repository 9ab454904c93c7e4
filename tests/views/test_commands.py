"""`casahunt orbit` and `casahunt fold`: what they print and write."""

from __future__ import annotations

import math
import re
from dataclasses import replace

import numpy as np
import pytest
from command_line import NUMBER, PROGRESS, contents, is_picture, one_json, run
from servo_files import dump

from casahunt import Branch, Orbit, Servo, __version__, cli, find_orbit
from casahunt.servo.saved import load_orbit
from casahunt.views.commands import orbit as command_orbit
from problems import table1

ORBIT_KEYS = {
    "model", "gain", "branch", "amplitude", "period", "half_multiplier", "multipliers", "stable", "error_estimate",
    "status", "unknowns", "iterations", "wall_s",
}  # fmt: skip
FOLD_KEYS = {"model", "gain", "amplitude", "period", "error_estimate", "status", "wall_s"}


@pytest.mark.parametrize(("model", "size"), [("switch", 1e-8), ("lugre", 1e-7)])
@pytest.mark.parametrize("gain", [0.04, 0.2, 0.6])
def test_orbit_json(capsys, model, size, gain):
    """The reference table, through the whole program, to the digits that the table has."""
    code, out, err = run(capsys, "orbit", "--model", model, "--gain", gain, "--tol", "1e-9", "--json", "--details")
    assert code == 0
    found = one_json(out)
    assert set(found) >= ORBIT_KEYS
    row = next(row for row in table1.REFERENCE[model]["stable"] if row["K"] == gain)
    assert (found["model"], found["gain"], found["branch"]) == (model, gain, "stable")
    assert found["amplitude"] == pytest.approx(row["amplitude"], rel=size)
    assert found["period"] == pytest.approx(row["period"], rel=size)
    assert found["half_multiplier"] == pytest.approx(row["mu"], rel=1e-6)
    assert found["stable"] is True and found["multipliers_trusted"] is True
    assert found["status"] == "converged" and 0 < found["error_estimate"] <= 1e-9
    assert found["unknowns"] > 50 and found["iterations"] >= 1 and found["wall_s"] > 0
    assert all(len(pair) == 2 and all(math.isfinite(x) for x in pair) for pair in found["multipliers"])
    values = sorted((complex(*pair) for pair in found["multipliers"]), key=abs)
    assert len(values) == (3 if model == "switch" else 4)
    assert values[-1] == pytest.approx(1, abs=1e-8)
    assert values[-2] == pytest.approx(row["mu"] ** 2, rel=1e-6)
    assert [PROGRESS.fullmatch(line)[1] for line in err.splitlines()] == [model]


@pytest.mark.parametrize(("model", "gain"), [("switch", 0.1), ("switch", 0.4), ("lugre", 0.4)])
def test_unstable_branch(capsys, model, gain):
    command = ["orbit", "--model", model, "--gain", gain, "--branch", "unstable", "--tol", "1e-9", "--json", "--quiet"]
    code, out, err = run(capsys, *command)
    found = one_json(out)
    row = next(row for row in table1.REFERENCE[model]["unstable"] if row["K"] == gain)
    assert (code, err, found["branch"], found["stable"]) == (0, "", "unstable", False)
    assert found["amplitude"] == pytest.approx(row["amplitude"], rel=1e-7)
    assert found["period"] == pytest.approx(row["period"], rel=1e-7)
    assert found["half_multiplier"] == pytest.approx(row["mu"], rel=1e-4)
    assert found["log10_abs_half_multiplier"] == pytest.approx(math.log10(row["mu"]), abs=1e-4)


def test_full_cycle(capsys):
    """Without its symmetry the cycle is the same one; it has no half multiplier."""
    half = one_json(run(capsys, "orbit", "--gain", 0.2, "--tol", "1e-9", "--json")[1])
    code, out, err = run(capsys, "orbit", "--gain", 0.2, "--tol", "1e-9", "--json", "--full", "--details")
    full = one_json(out)
    assert code == 0 and full["half_multiplier"] is None and full["unknowns"] > half["unknowns"]
    assert "lambda = +0.2703" in err
    for key in ("amplitude", "period", "log10_abs_half_multiplier"):
        assert full[key] == pytest.approx(half[key], rel=1e-8)
    out = run(capsys, "orbit", "--gain", 0.2, "--full", "--details")[1]
    assert re.search(r"^  multipliers +1, 0\.2703", out, re.MULTILINE) and "half multiplier" not in out


@pytest.mark.parametrize("solver", ["ipopt", "newton"])
def test_orbit_text(capsys, solver):
    code, out, err = run(capsys, "orbit", "--gain", 0.1, "--solver", solver, "--details")
    assert code == 0 and "Traceback" not in err
    assert out.startswith("switch servo at gain 0.1 V/rad: hunts\n")
    for name, unit, value in (("amplitude", "rad", 0.0177084475), ("period", "s", 11.35587139)):
        found = re.search(rf"^  {name} +({NUMBER}) {unit}$", out, re.MULTILINE)
        assert float(found[1]) == pytest.approx(value, rel=1e-6)
    assert "half multiplier  -0.38791" in out and "status           converged" in out


def test_values_can_be_set(capsys, tmp_path):
    """--set, a servo file and the library mean the same servo; --set wins over the file."""
    servo = Servo(inertia=0.03).replace(**{"friction.static": 0.5})
    known = find_orbit(servo, "switch", 0.2)
    same = ["orbit", "--gain", "0.2", "--json", "--quiet"]
    by_set = one_json(run(capsys, *same, "--set", "servo.inertia=0.03", "--set", "friction.static=0.5")[1])
    (tmp_path / "servo.toml").write_text(dump(servo))
    by_file = one_json(run(capsys, *same, tmp_path / "servo.toml")[1])
    (tmp_path / "partial.toml").write_text("[servo]\ninertia = 0.03\n[friction]\nstatic = 0.6\n")
    by_both = one_json(run(capsys, *same, tmp_path / "partial.toml", "--set", "friction.static=0.5")[1])
    for found in (by_set, by_file, by_both):
        assert found["amplitude"] == pytest.approx(known.amplitude, rel=1e-12)
        assert found["period"] == pytest.approx(known.period, rel=1e-12)
    table = next(row for row in table1.REFERENCE["switch"]["stable"] if row["K"] == 0.2)
    assert one_json(run(capsys, *same, table1.TOML)[1])["period"] == pytest.approx(table["period"], rel=1e-6)


def test_plot_and_save(capsys, tmp_path):
    plot, save = tmp_path / "orbit.png", tmp_path / "orbit.npz"
    code, out, _ = run(capsys, "orbit", "--gain", 0.3, "--json", "--plot", plot, "--save", save)
    found = one_json(out)
    assert code == 0 and set(contents(tmp_path)) == {"orbit.png", "orbit.npz"}
    assert is_picture(plot)
    loaded = load_orbit(save)
    assert (loaded.amplitude, loaded.period, loaded.gain) == (found["amplitude"], found["period"], 0.3)
    for suffix, start in ((".svg", b"<?xml"), (".pdf", b"%PDF")):
        plot = tmp_path / f"orbit{suffix}"
        assert run(capsys, "orbit", "--gain", 0.3, "--plot", plot)[0] == 0
        assert plot.read_bytes().startswith(start)


def untrusted(orbit: Orbit) -> Orbit:
    """The same orbit with multipliers whose trivial one is not 1."""
    fresh = replace(orbit)
    fresh.__dict__["multipliers"] = replace(orbit.multipliers, trivial_error=0.5)
    return fresh


def test_untrusted_multipliers_are_not_shown(capsys, monkeypatch):
    orbit = untrusted(find_orbit(Servo(), "switch", 0.3))
    monkeypatch.setattr(command_orbit, "find_orbit", lambda *args, **kwargs: orbit)
    found = one_json(run(capsys, "orbit", "--gain", 0.3, "--json")[1])
    assert found["multipliers_trusted"] is False and found["trivial_multiplier_error"] == 0.5
    for key in ("half_multiplier", "log10_abs_half_multiplier", "multipliers", "stable"):
        assert found[key] is None
    _, out, err = run(capsys, "orbit", "--gain", 0.3, "--details")
    assert "whether the servo ends in it is not known" in " ".join(out.split())
    assert "not to be trusted" in out and "mu = not trusted" in err
    assert "-0.58" not in out + err
    table = Branch("gain", (orbit,))._columns()
    assert np.isnan([table["half_multiplier"], table["log10_abs_half_multiplier"]]).all() and table["stable"] == ("",)


def test_version_and_help(capsys):
    for words, text in (
        (["--version"], f"casahunt {__version__}"),
        (["--help"], "diagram"),
        (["help"], "diagram"),
        (["help", "orbit"], "casahunt orbit"),
        *(([command, "--help"], "--json") for command in cli.COMMANDS),
    ):
        with pytest.raises(SystemExit) as end:
            cli.main(words)
        assert not end.value.code and text in capsys.readouterr().out


@pytest.mark.parametrize(("model", "size"), [("switch", 1e-9), ("lugre", 1e-8)])
def test_fold_json(capsys, model, size):
    code, out, err = run(capsys, "fold", "--model", model, "--tol", "1e-9", "--json", "--details")
    found, known = one_json(out), table1.REFERENCE[model]["fold"]
    assert code == 0 and set(found) >= FOLD_KEYS
    assert found["model"] == model and found["status"] == "converged"
    assert found["gain"] == pytest.approx(known["K"], rel=size)
    assert found["amplitude"] == pytest.approx(known["amplitude"], rel=1e-6)
    assert found["period"] == pytest.approx(known["period"], rel=1e-6)
    assert 0 < found["error_estimate"] <= 1e-9 and found["wall_s"] > 0
    assert PROGRESS.fullmatch(err.strip())[3] == "+1 (fold)"


def test_fold_text(capsys):
    code, out, err = run(capsys, "fold", "--quiet", "--details", "--set", "friction.static=0.5")
    assert (code, err) == (0, "")
    plain = float(re.match(rf"switch servo: hunting is possible up to gain ({NUMBER}) V/rad\n", out)[1])
    gain = float(re.search(rf"^  gain there +({NUMBER}) V/rad$", out, re.MULTILINE)[1])
    assert plain == float(f"{gain:.4g}") != gain
    # The fold depends on Fs, Fc and vs through (Fs - Fc)/vs alone: vs = 0.03 has the same one.
    assert one_json(run(capsys, "fold", "--json", "--set", "friction.stribeck_velocity=0.03")[1])["gain"] == (
        pytest.approx(gain, rel=1e-5)
    )


def test_the_servo_file_stands_alone_or_behind_its_option_once(capsys, tmp_path):
    path = tmp_path / "mine.toml"
    path.write_text(dump(Servo().replace(**{"servo.inertia": 0.02})))
    answers = [run(capsys, "loop", *words, "--gain", 0.1) for words in ([path], ["--servo", path], [])]
    assert answers[0] == answers[1] and answers[0][0] == 0 and answers[2][1] != answers[0][1]
    code, out, err = run(capsys, "loop", path, "--servo", path, "--gain", 0.1)
    assert (code, out) == (2, "") and "one servo file is enough" in err


def test_a_servo_file_may_stand_behind_the_options_of_a_record(capsys):
    for words in (["mine.toml", "--gain", "1"], ["--gain", "1", "mine.toml"], ["--gain", "1", "--servo", "mine.toml"]):
        assert cli._parsed(["record", "drive.csv", *words]).servo_file == "mine.toml"
    code, out, err = run(capsys, "record", "drive.csv", "--gain", 1, "mine.toml", "yours.toml")
    assert (code, out) == (2, "") and "'yours.toml': must be left out, one servo file is enough" in err


def test_a_cycle_of_an_unstable_loop_is_not_all_that_happens(capsys):
    """By Routh and Hurwitz it is stable above K kd km = J ki/kp - sigma2, K = 0.7037: below, a step runs away."""
    words = [f"--set={key}={value}" for key, value in {
        "servo.inertia": 0.0035, "servo.motor_gain": 0.9, "controller.kp": 2.5, "controller.ki": 30,
        "controller.kd": 0.06, "friction.static": 0.12, "friction.coulomb": 0.08, "friction.viscous": 0.004,
    }.items()]  # fmt: skip
    for gain, away in ((0.70, True), (0.71, False)):
        out = run(capsys, "orbit", "--gain", gain, *words)[1]
        assert ("from far enough the servo leaves the set" in out) is away, gain
    out = run(capsys, "simulate", "--gain", 0.5, "--time", 10, *words)[1]
    assert "leaves the set point for good" in " ".join(out.split()) and "amplitude" not in out


def test_a_servo_file_among_the_records_is_told(capsys):
    code, out, err = run(capsys, "identify", "drive.csv", "mine.toml", "--gain", 1)
    assert (code, out) == (2, "") and "it is given as --servo mine.toml" in err


@pytest.mark.parametrize("how", [["--set", "friction.statik=1"], ["--set=friction.statik=1"]])
def test_a_misspelt_key_is_named_before_what_is_missed(capsys, how):
    code, out, err = run(capsys, "orbit", *how)
    assert (code, out) == (2, "") and "did you mean 'friction.static'" in err
    assert "gain: must be given" in run(capsys, "orbit", "--set", "friction.static=1")[2]
    assert "no such file" in run(capsys, "orbit", "loop.toml", "--set", "weight.mass=1")[2]
