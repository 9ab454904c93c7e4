"""casahunt simulate as built, and what other commands say where the servo file has a table [drive]."""

from __future__ import annotations

import csv
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import one_json, run

from casahunt import InputError, Servo, cli
from casahunt.design.remedies.cures import Cure
from casahunt.servo.sampled.check import AsBuilt
from casahunt.views.commands import remedies as remedies_command
from casahunt.views.commands.identify import fit_of
from casahunt.views.commands.remedies import Table, table_lines
from casahunt.views.commands.taken import taken_from_table_1

SERVO = """
[servo]
inertia = 0.012
motor_gain = 4.2
[controller]
kp = 1.0
ki = 8.0
kd = 0.05
[friction]
static = 0.40
coulomb = 0.30
stribeck_velocity = 0.05
viscous = 0.02
"""
DRIVE = "[drive]\nsample_time = 0.001\nencoder = 2000\n"


def parsed(*words):
    return cli._parsed([str(word) for word in words])


@pytest.fixture
def built(tmp_path):
    path = tmp_path / "built.toml"
    path.write_text(SERVO + DRIVE)
    return path


def test_the_keys_of_the_file_are_the_options(capsys, tmp_path, built):
    plain = tmp_path / "plain.toml"
    plain.write_text(SERVO)
    code, out, _ = run(capsys, "simulate", built, "--gain", 1, "--time", 40, "--json", "--quiet")
    by_file = one_json(out)
    words = ("--sample-time", 0.001, "--encoder", 2000)
    other, out, _ = run(capsys, "simulate", plain, "--gain", 1, "--time", 40, *words, "--json", "--quiet")
    by_options = one_json(out)
    by_file.pop("wall_s"), by_options.pop("wall_s")
    assert code == other == 0 and by_file == by_options
    assert by_file["verdict"] == "hunting" and by_file["cause"]["kind"] == "quantisation"
    assert by_file["drive"]["encoder"] == 2000 and by_file["readings"][1] > by_file["readings"][0]


def test_every_option_arrives(capsys, built):
    """Each as it is given, in the place of the file's."""
    words = {"delay": 0.002, "encoder": 4096.0, "quantise_torque": 0.01, "derivative": "filtered", "filter_time": 0.01,
             "integration": "trapezoid", "leak": 0.5, "sample_time": 0.002, "hysteresis": 0.004, "enter_ratio": 0.7,
             "dwell": 0.6, "reset": 0.8, "reset_at_stop": -0.5, "error_dead_band": 0.001, "remaining_gain": 0.1,
             "error_filter_time": 0.003, "compensated": 0.2, "noise": 1e-5, "seed": 3}  # fmt: skip
    none = {"dead_band": 0.0, "shifted_dead_band": 0.0}
    given = [part for key, value in words.items() for part in (f"--{key.replace('_', '-')}", value)]
    _, out, _ = run(capsys, "simulate", built, "--gain", 1, "--time", 1, *given, "--json", "--quiet")
    assert one_json(out)["drive"] == words | none
    overrides = [part for key, value in words.items() for part in ("--set", f"drive.{key}={value}")]
    _, out, _ = run(capsys, "simulate", built, "--gain", 1, "--time", 1, *overrides, "--json", "--quiet")
    assert one_json(out)["drive"] == words | none
    for key in none:
        words = (f"--{key.replace('_', '-')}", 0.003)
        _, out, _ = run(capsys, "simulate", built, "--gain", 1, "--time", 1, *words, "--json", "--quiet")
        assert one_json(out)["drive"][key] == 0.003


def test_lugre_friction_is_simulated_too(capsys, built):
    words = ("--model", "lugre", "--time", 1, "--bristle", 1e-6, "--json", "--quiet")
    code, out, _ = run(capsys, "simulate", built, "--gain", 1, *words)
    found = one_json(out)
    assert code == 0 and found["model"] == "lugre" and found["bristle"] != 0 and found["cause"] is None


def test_a_sample_time_of_zero_is_the_continuous_loop(capsys, built):
    code, out, _ = run(capsys, "simulate", built, "--gain", 1, "--time", 20, "--sample-time", 0, "--json", "--quiet")
    found = one_json(out)
    assert code == 0 and found["type"] == "Trajectory" and found["period"] == pytest.approx(2.4942, rel=1e-4)


def test_a_long_pattern_has_the_time_to_and_fro_beside_its_period(capsys, built):
    """docs/howto/as_built.md: swings of 1.19, 1.29, 1.17 and 1.13 s repeat at 0.209 Hz; to and fro is half of that."""
    _, out, _ = run(capsys, "simulate", built, "--gain", 1, "--time", 40, "--quiet")
    found = re.search(r"period +(\S+) s \(of 4 swings, to and\s+fro in (\S+) s\)", out)
    assert float(found[1]) == pytest.approx(1.19 + 1.29 + 1.17 + 1.13, abs=0.02)
    assert float(found[2]) == pytest.approx(float(found[1]) / 2, rel=1e-3)


def test_its_lines_name_cause_and_cure(capsys, built):
    _, out, _ = run(capsys, "simulate", built, "--gain", 4.458, "--time", 200, "--quiet")
    text = " ".join(out.split())
    assert "half of its largest swing" in text  # the set point lies outside of it, so that it is no distance from there
    assert "the reading moves over 1" in text and "cause quantisation: without quantisation the same loop" in text
    assert "ends it a dead band of the integrator of 0.001571 rad, 0.5 counts" in text
    _, out, _ = run(capsys, "simulate", built, "--gain", 4.458, "--time", 200, "--dead-band", 0.001571, "--quiet")
    assert "at rest" in out.splitlines()[0] and "  cause " not in out


def test_table_and_picture(capsys, tmp_path, built):
    table, picture = tmp_path / "t.csv", tmp_path / "p.png"
    words = ("--time", 3, "--csv", table, "--plot", picture, "--quiet")
    assert run(capsys, "simulate", built, "--gain", 1, *words)[0] == 0
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert len(rows) == 3000 and list(rows[0])[:2] == ["time_s", "position_rad"]
    assert picture.read_bytes()[:4] == b"\x89PNG"


@pytest.mark.parametrize("words, said", [
    (("--set", "drive.encder=3"), "unknown key 'drive.encder'; did you mean 'drive.encoder'?"),
    (("--derivative", "filterd"), "did you mean 'filtered'?"),
    (("--dead-band", 0.1, "--hysteresis", 0.1), "dead_band and hysteresis exclude each other"),
    (("--encoder", "many"), "drive.encoder = 'many': must be a finite number"),
    (("--leak", "0,5"), "drive.leak = '0,5': must be a finite number; decimals take a point, 0.5"),
    (("--sample-time", 0, "--encoder", 100), "encoder: must be left out, it is of the loop as built, and without a"),
    (("--sample-time", 0, "--enter-ratio", 0.3), "enter-ratio: must be left out without hysteresis"),
    (("--sample-time", 0, "--dwell", 1, "--model", "lugre"), "dwell: must be left out, in the continuous loop it goes"),
    (("--sample-time", 0, "--leak", -1), "leak = -1: must be at least 0 (leak)"),
    (("--bristle", "1e-6"), "bristle = 1e-06: must be 0, as the switch servo has no bristle"),
    (("--time", "1e6"), "between 1 and 5000000 samples"),
])  # fmt: skip
def test_refusals(capsys, built, words, said):
    code, out, err = run(capsys, "simulate", built, "--gain", 1, *words)
    assert code == 2 and not out and said in err.splitlines()[-1] and err.count("casahunt simulate:") == 1


def test_what_the_continuous_loop_leaves_out_is_told(capsys, built):
    code, out, err = run(capsys, "simulate", built, "--gain", 1, "--time", 3, "--sample-time", 0)
    assert code == 0 and "as built" not in out and "taken as a continuous one: drive.encoder left out" in err


def test_without_a_sample_time_nothing_is_as_built(capsys):
    code, _, err = run(capsys, "simulate", "--gain", 1, "--encoder", 2000)
    assert code == 2 and "drive.sample_time: must be given" in err


@pytest.mark.parametrize("command", ["orbit", "fold", "basin"])
def test_a_wrong_key_is_refused_by_every_command(capsys, tmp_path, command):
    path = tmp_path / "wrong.toml"
    path.write_text(SERVO + "[drive]\nsample_time = 0.001\nencodr = 2000\n")
    gain = () if command == "fold" else ("--gain", 1)
    code, _, err = run(capsys, command, path, *gain)
    assert code == 2 and "unknown key 'drive.encodr'; did you mean 'drive.encoder'?" in err


def test_a_loop_of_parts_is_run_as_the_servo_of_its_parts_is(capsys, tmp_path):
    """By options, and by its table [drive]: Table 1 as a file of parts."""
    path = tmp_path / "loop.toml"
    text = '[loop]\nparts = ["one inertia", "Switch friction", "PID by times", "integrator"]\n[values]\ngain = 0.04\n'
    path.write_text(text)
    asked = ["--sample-time", 0.002, "--encoder", 2000, "--time", 20, "--json"]
    _, servo, _ = run(capsys, "simulate", "--gain", 0.04, *asked)
    code, loop, _ = run(capsys, "simulate", path, *asked)
    path.write_text(f"{text}[drive]\nsample_time = 0.002\nencoder = 2000\n")
    _, table, _ = run(capsys, "simulate", path, "--time", 20, "--json")
    keys = ("position", "velocity", "integral", "peak_torque", "number_of_stops")
    servo, loop, table = ({key: one_json(text)[key] for key in keys} for text in (servo, loop, table))
    assert code == 0 and loop == table == pytest.approx(servo, rel=1e-9)


@pytest.mark.parametrize("words", ["orbit --gain 1", "orbit --gain 50", "fold", "map --gain 1", "equilibria --gain 1"])
def test_an_answer_for_the_continuous_loop_says_so(capsys, tmp_path, built, words):
    """In the answer, in the refusal, or beside it; not where the file has no drive."""
    command, *rest = words.split()
    bare = tmp_path / "bare.toml"
    bare.write_text(SERVO)
    for path, sometimes in ((built, True), (bare, False)):
        _, out, err = run(capsys, command, path, *rest)
        said = " ".join((out + err).split())
        assert ("of the continuous loop: [drive] of the servo file changes nothing here" in said) == sometimes


def test_an_orbit_of_few_counts_is_told(capsys, built):
    _, out, _ = run(capsys, "orbit", built, "--gain", 1, "--quiet")
    assert "as built the amplitude is 5.92 counts of the encoder: below 20" in " ".join(out.split())
    _, out, _ = run(capsys, "orbit", built, "--gain", 1, "--json", "--quiet")
    assert one_json(out)["as_built"].startswith("5.92 counts")
    fine = ("--set", "drive.encoder=20000")
    _, out, _ = run(capsys, "orbit", built, "--gain", 1, *fine, "--json", "--quiet")
    assert one_json(out)["as_built"] is None
    _, out, _ = run(capsys, "fold", built, "--quiet")
    assert "as built the amplitude is 0.699 counts" in " ".join(out.split())


def test_a_stribeck_velocity_that_is_taken_from_table_1_is_told(capsys, tmp_path):
    path, key = tmp_path / "sheet.toml", "friction.stribeck_velocity"
    path.write_text(re.sub("stribeck_velocity.*\n", "", SERVO))
    _, _, err = run(capsys, "orbit", path, "--gain", 1)
    assert err.count(f"{key} is not in the servo file: 0.02 rad/s of Table 1 is taken") == 1
    assert f"try others with --set {key}=VALUE" in err
    for more in (["--quiet"], ["--set", f"{key}=0.05"]):
        _, _, err = run(capsys, "orbit", path, "--gain", 1, *more)
        assert key not in err


def test_what_a_servo_file_leaves_to_table_1_is_told(capsys, tmp_path):
    """An answer would be one about another servo; friction that is sought in records is none."""
    path = tmp_path / "part.toml"
    everything = "servo.inertia, servo.motor_gain, friction.static, friction.coulomb, friction.viscous, controller"
    for left_out, said in (("inertia.*\n", "servo.inertia"), (r"\[controller\][^\[]*", "controller"),
                           ("viscous.*\n", "friction.viscous"), (r"[\s\S]*", everything)):  # fmt: skip
        path.write_text(re.sub(left_out, "", SERVO))
        _, _, err = run(capsys, "loop", path, "--gain", 1)
        assert "not in the servo file, and taken from Table 1 of the report: " in err and said in err
    path.write_text(re.sub("inertia.*\n", "", SERVO))
    assert "Table 1" not in run(capsys, "loop", path, "--gain", 1, "--set", "servo.inertia=0.02")[2]
    tables = {"servo": {"inertia": 1, "motor_gain": 1}, "controller": {"kp": 1}}
    assert not list(taken_from_table_1(Servo(), tables, [], sought=True))
    assert "friction.static" in next(taken_from_table_1(Servo(), tables, [], sought=False))


def test_a_distance_within_one_count_is_told(capsys, built):
    _, out, _ = run(capsys, "basin", built, "--gain", 1, "--quiet")
    assert "the drive cannot tell whether it is within it" in " ".join(out.split()) and "bring it to rest" not in out
    _, out, _ = run(capsys, "basin", built, "--gain", 1, "--quiet", "--set", "drive.encoder=1e9")
    assert "bring it to rest" in out and "the drive cannot tell" not in out


@pytest.mark.slow
def test_a_gain_that_hunts_as_built_is_not_recommended_alone(capsys, built):
    code, out, err = run(capsys, "tune", built, "--quiet")
    assert code == 1 and "does not do alone in the loop as built" in err
    first = " ".join(out.split("\n  hunting")[0].split())
    assert first.endswith("V/rad, but not alone: in the loop as built it hunts there, see below")
    assert "the continuous loop is verified" in " ".join(out.split())
    code, out, err = run(capsys, "tune", built, "--quiet", "--set", "drive.dead_band=0.01")
    assert code == 0 and "but not alone" not in out and not err


@pytest.mark.slow
def test_the_remedy_named_first_says_whether_it_was_checked(capsys, built, monkeypatch):
    """One that is cheaper cannot be checked: dither, if a step settles where its error is below 2 %."""
    monkeypatch.setattr("casahunt.design.remedies.price.settled_within", lambda hunting, step: 0.02)
    only = ("--only", "dither,leak", "--jobs", 1)
    _, out, _ = run(capsys, "remedies", built, "--gain", 1, *only, "--quiet")
    said = " ".join(out.split())
    assert "in the loop as built: every motion comes to rest with leak (see below); dither was not checked" in said


@pytest.mark.slow
def test_the_cheapest_that_holds_as_built_is_named(capsys, built, monkeypatch):
    """Not a cheaper one that hunts on there; where none holds, the cheapest, which does not do."""
    words = ("remedies", built, "--gain", 1, "--only", "leak,dead band", "--quiet")
    hunts = AsBuilt("hunting", "it hunts", "it is hunting", math.nan, None)
    does = {"leak": hunts, "dead band": AsBuilt("at rest", "it rests", "it rests", math.nan, None)}
    found, ask = [], remedies_command.remedies
    monkeypatch.setattr(remedies_command, "remedies", lambda *a, **k: (found or found.append(ask(*a, **k)) or found)[0])
    monkeypatch.setattr(remedies_command, "remedies_as_built", lambda *_: does)
    said = " ".join(run(capsys, *words)[1].split())
    assert "cheapest remedy that holds in the loop as built: dead band, 0.01714 rad (0.01714 rad at rest" in said
    assert "every motion comes to rest with dead band (see below); leak does not do" in said
    assert one_json(run(capsys, *words, "--json")[1])["best"] == "dead band"
    monkeypatch.setattr(remedies_command, "remedies_as_built", lambda *_: dict.fromkeys(does, hunts))
    code, out, err = run(capsys, *words)
    said = " ".join(out.split())
    assert "no remedy that holds in the loop as built was found; of the continuous loop: leak, 1.04 1/s" in said
    assert "(see below); leak does not do" in said
    assert code == 1 and "leak does not do in the loop as built: it hunts" in err
    assert "it is hunting" not in said  # what supports it stands in the details
    assert "it is hunting" in run(capsys, *words, "--details")[1]


def test_one_that_holds_as_built_and_costs_too_much_does_do_there(capsys, built, monkeypatch):
    """Where no other is within the limits: it said of the dead band that it does, and that it does not."""
    words = ("remedies", built, "--gain", 1, "--only", "dead band,gain", "--max-error", 1e-4, "--quiet")
    does = {"dead band": AsBuilt("at rest", "", "", math.nan, None), "gain": AsBuilt("hunting", "", "", math.nan, None)}
    monkeypatch.setattr(remedies_command, "remedies_as_built", lambda *_: does)
    code, out, _ = run(capsys, *words)
    said = " ".join(out.split())
    assert code == 1
    assert "no remedy with error at rest up to 0.0001 rad that holds in the loop as built was found" in said
    assert "of the continuous loop: gain, 4.458 V/rad" in said
    assert "comes to rest with dead band (see below); gain does not do" in said and "dead band does not do" not in said


@pytest.mark.slow
def test_the_linear_loop_and_a_tuning_have_the_delay_of_the_drive(capsys, built):
    """A delay of whole samples takes omega D of the phase at the crossover, and leaves that where it is."""
    loop = ("loop", built, "--gain", 1, "--set", "drive.delay=0.002", "--json", "--quiet")
    at_once, found = (one_json(run(capsys, *words)[1])["as_built"] for words in ((*loop[:4], *loop[6:]), loop))
    late = found["margins"][0]
    assert (found["drive"]["delay"], at_once["drive"]["delay"]) == (0.002, 0.0)
    lost = math.degrees(late["frequency"] * 0.002)
    assert late["phase_margin"] == pytest.approx(at_once["margins"][0]["phase_margin"] - lost, rel=1e-9)
    said = " ".join(run(capsys, *loop[:-2], "--quiet")[1].split())
    assert f"gain 1 V/rad as built: phase margin {late['phase_margin']:.4g} degrees, stable" in said
    assert "the sampled loop, 0.001 s; delay 0.002 s; derivative by difference; integral by rectangle;" in said
    said = " ".join(run(capsys, "loop", built, "--gain", 1, "--set", "drive.delay=0.3", "--quiet")[1].split())
    assert "gain 1 V/rad as a continuous loop: stable" in said and "gain 1 V/rad as built: unstable" in said
    assert "a picture (--plot) shows both" in said
    assert "as_built" not in one_json(run(capsys, "loop", "--gain", 1, "--json", "--quiet")[1])
    tuned = one_json(run(capsys, "tune", built, "--json", "--quiet")[1])["demands"]
    assert (tuned["delay"], tuned["sample_time"]) == (0.0, 0.001) and tuned["drive"]["encoder"] == 2000
    late = one_json(run(capsys, "tune", built, "--delay", 0.0005, "--json", "--quiet")[1])["demands"]
    assert late["delay"] == late["drive"]["delay"] == 0.0005 and late["drive"]["sample_time"] == 0.001
    tuned = one_json(run(capsys, "tune", built, "--sample-time", 0, "--json", "--quiet")[1])["demands"]
    assert tuned["sample_time"] == 0.0 and tuned["drive"] is None
    err = run(capsys, "tune", built, "--set", "drive.sample_time=0")[2]
    assert err.count("is taken as a continuous one: drive.encoder left out") == 1


def test_a_servo_without_a_drive_is_told_nothing_of_it(capsys):
    _, out, _ = run(capsys, "orbit", "--gain", 0.1, "--json", "--quiet")
    assert "as_built" not in one_json(out)


def test_a_tuning_is_checked_as_built(capsys, built):
    """The gain a tenth above the fold still hunts by a count; a dead band ends that."""
    _, out, _ = run(capsys, "tune", built, "--json", "--quiet")
    found = one_json(out)
    assert found["gain"] == pytest.approx(4.458, rel=1e-3) and found["as_built"]["kind"] == "hunting"
    assert found["as_built"]["dead_band"] == pytest.approx(0.55 * 2 * math.pi / 2000, rel=1e-6)


@pytest.mark.slow
def test_remedies_are_checked_as_built(capsys, built):
    only = ("--only", "dead band,gain,leak,reset,dither")
    _, out, _ = run(capsys, "remedies", built, "--gain", 1, *only, "--json", "--quiet")
    seen = one_json(out)["as_built"]
    assert seen["dead band"]["kind"] == "at rest" and seen["gain"]["kind"] == "hunting"
    assert seen["leak"]["kind"] == "at rest"
    assert seen["reset"]["kind"] == "hunting"  # between two counts no reading is zero: the integral never ends
    assert seen["dither"].startswith("not checked: its size is that of a vibration")


def test_a_size_that_no_drive_can_have_is_told(capsys, built):
    """The leak would forget more than all in one sample."""
    words = ("--only", "leak,dead band", "--set", "drive.sample_time=1", "--json", "--quiet")
    code, out, _ = run(capsys, "remedies", built, "--gain", 1, *words)
    seen = one_json(out)["as_built"]
    assert code == 0 and seen["leak"].startswith("not checked: drive.leak = 1.04")
    assert seen["dead band"]["kind"]


def test_a_band_of_the_drive_gives_way_to_the_one_that_is_checked(capsys, built):
    words = ("--only", "dead band", "--set", "drive.hysteresis=0.001", "--json", "--quiet")
    _, out, _ = run(capsys, "remedies", built, "--gain", 1, *words)
    assert one_json(out)["as_built"]["dead band"]["kind"] == "at rest"


@pytest.mark.parametrize("words", [(), ("--sample-time", 0)], ids=["no drive", "sample time 0"])
def test_a_remedy_of_the_table_is_tried_in_the_continuous_loop_by_one_option(capsys, built, words):
    """Table 1's servo hunts up to a leak of 0.2468 1/s; stuck beside the set point, friction holds
    |kp + ki/leak| |x1| <= Fs."""
    given = ("simulate", *([built] if words else []), *words, "--gain", 1 if words else 0.04, "--json", "--quiet")
    hunts = one_json(run(capsys, *given, "--leak", 0.1)[1])
    rests = one_json(run(capsys, *given, "--leak", 4.0)[1])
    assert hunts["verdict"] == "hunting" and rests["verdict"] == "at rest"
    assert "leak" in hunts["parts"] and rests["parameters"]["leak"] == 4.0
    p = rests["parameters"]
    held = rests["gain"] * p["motor_gain"] * (p["kp"] + p["ki"] / 4.0) * abs(rests["end"]["x1"])
    assert held <= p["static"]


@pytest.mark.parametrize("drive", [
    {"derivative": "filtered", "delay": 0.001},
    {"derivative": "difference", "delay": 0.0, "sample_time": 0.005},
    {"derivative": "filtered", "delay": 0.0034, "sample_time": 0.002, "integration": "trapezoid"},
])
def test_the_margins_are_those_of_the_loop_as_built(capsys, built, drive):
    """Up to the factor that `loop` says a small motion without friction dies out, beyond it grows: the sampled loop."""
    words = [part for key, value in drive.items() for part in ("--set", f"drive.{key}={value}")]
    words += ["--set", "drive.encoder=0"]
    found = one_json(run(capsys, "loop", built, "--gain", 1, *words, "--json", "--quiet")[1])["as_built"]
    limit = found["margins"][0]["highest_factor"]
    slick = ("--set", "friction.static=2e-4", "--set", "friction.coulomb=1e-4", "--set", "friction.viscous=0.02")
    for factor, kinds in ((0.98, ("at rest", "decaying", "hunting")), (1.02, ("growing",))):
        given = ("--gain", factor * limit, *words, *slick, "--time", 12, "--json", "--quiet")
        assert one_json(run(capsys, "simulate", built, *given)[1])["verdict"] in kinds


@pytest.mark.slow
def test_a_tuning_whose_drive_filters_too_long_is_spoken_against(capsys, built):
    words = ("--set", "drive.derivative=filtered", "--set", "drive.encoder=0", "--json", "--quiet")
    long = run(capsys, "tune", built, *words, "--set", "drive.filter_time=0.02")
    short = run(capsys, "tune", built, *words, "--set", "drive.filter_time=1e-4")
    assert one_json(short[1])["verification"]["result"] == "verified" and short[0] == 0
    assert one_json(long[1])["verification"]["result"] == "speaks against it" and long[0] == 1
    assert "misses the margins" in long[2]


def test_above_the_fold_it_is_said_that_the_drive_may_hunt_by_a_count(capsys, built):
    """At 4.458, where the continuous loop is proven to rest, this drive hunts; a dead band ends it."""
    _, out, _ = run(capsys, "fold", built, "--quiet")
    assert "above that gain" in out and "hunting by a count of the encoder" in re.sub(r"\s+", " ", out)
    assert one_json(run(capsys, "fold", built, "--json", "--quiet")[1])["beyond"].startswith("quantisation")
    code, _, err = run(capsys, "orbit", built, "--gain", 5.0)
    assert code == 1 and "hunting by a count of the encoder where the continuous loop rests (casahunt simulate" in err
    for words in (("--set", "drive.dead_band=0.004"), ("--set", "drive.encoder=0"), ("--set", "drive.sample_time=0")):
        assert "hunting by" not in run(capsys, "orbit", built, "--gain", 5.0, *words)[2]


def test_a_cycle_that_was_not_found_is_no_ground_for_counts(capsys, built):
    """Said where there is no cycle, and not where one was only not found."""
    _, _, err = run(capsys, "orbit", built, "--gain", 1.0, "--branch", "lopsided")
    assert "not found" in err or "was found" in err
    assert "hunting by a count" not in err


@pytest.mark.slow
def test_what_is_done_with_a_drive_is_said_of_a_fit(capsys, tmp_path, built):
    """Lags that are short are taken, others not; a count worth more than a fiftieth of static friction is told."""
    t = np.arange(0.0, 20.0, 0.01)
    record = tmp_path / "r.csv"
    np.savetxt(record, np.column_stack([t, 0.02 * np.sin(2 * np.pi * t)]), delimiter=",", header="time_s,position_rad")
    given = parsed("identify", record, "--servo", built, "--gain", 1)
    short, counts = fit_of(given)[1][-2:]
    worth = 0.05 * 4.2 * 2 * math.pi / 2000 / 1e-3 / 0.40  # kd q/T by Fs
    assert "delay and counts of [drive] are taken into account" in short
    assert f"jump by {worth:.2g} of static friction" in counts
    filtered = ("--set", "drive.derivative=filtered", "--set", "drive.filter_time=1e-3")
    counts = fit_of(parsed("identify", record, "--servo", built, "--gain", 1, *filtered))[1][-1]
    assert f"jump by {worth / 2:.2g} of static friction" in counts  # by T + Tf
    slow = ("--set", "drive.delay=0.05", "--set", "drive.encoder=0")
    slow = parsed("identify", record, "--servo", built, "--gain", 1, *slow)
    with pytest.raises(InputError, match="is too long for a fit|is no small one"):
        fit_of(slow)


def test_a_cycle_that_motions_leave_is_not_said_to_be_hunting():
    """Between where the stable cycles end and the fold."""
    table = SimpleNamespace(
        name="servo", gain=7.4, amplitude=7e-4, period=6.0, remedies=(), best="", stable=False, irregular=False,
        move=None,
    )
    first = next(table_lines(Table(table)))
    assert "has a hunting cycle, which motions leave again, of 0.0007 rad" in first
    table.stable = True
    assert "hunts with 0.0007 rad" in next(table_lines(Table(table)))
    table.irregular, kinds = True, ("decaying", "decaying", "hunting", "hunting")
    table.remedies = (Cure("gain", "V/rad", "motions", 7.25, 0.375, 8.0, stays=kinds),)
    lines = list(table_lines(Table(table)))
    assert "hunts irregularly, with up to 0.0007 rad and 6 s" in lines[0]
    assert any("as simulated motions show it, seen and not proved, to about 5 %" in line for line in lines)


@pytest.mark.slow
def test_the_size_of_dither_is_explained_where_it_is_named(capsys):
    said = [" ".join(run(capsys, "remedies", "--gain", 0.04, "--only", name, "--quiet", "--details")[1].split())
            for name in ("dither", "leak")]  # fmt: skip
    assert "root mean square of the velocity" in said[0] and "root mean square" not in said[1]
