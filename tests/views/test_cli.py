"""The command line: what it prints and writes, how it refuses, and what an interrupt leaves behind."""

from __future__ import annotations

import contextlib
import csv
import io
import json
import math
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from casahunt import Branch, NoOrbit, Orbit, Servo, __version__, cli, find_orbit
from casahunt.checks import error_text, finite_or_none
from casahunt.continuation import special_points as monitor
from casahunt.design.diagram import DiagramPoint, diagram
from casahunt.design.diagram_files import CSV_COLUMNS, csv_row
from casahunt.servo.saved import load_branch, load_orbit
from casahunt.servo.servo import dump
from casahunt.views.commands import console
from casahunt.views.commands import diagram as command_diagram
from casahunt.views.commands import fold as command_fold
from casahunt.views.commands import orbit as command_orbit
from casahunt.views.commands.console import complex_text
from problems import table1

ROOT = Path(__file__).parents[2]
ORBIT_KEYS = {
    "model", "gain", "branch", "amplitude", "period", "half_multiplier", "multipliers", "stable", "error_estimate",
    "status", "unknowns", "iterations", "wall_s",
}  # fmt: skip
FOLD_KEYS = {"model", "gain", "amplitude", "period", "error_estimate", "status", "wall_s"}
NUMBER = r"[+-]?[0-9.]+(?:e[+-]?[0-9]+)?"
PROGRESS = re.compile(
    rf"(switch|lugre) +K = {NUMBER}  amplitude = {NUMBER} rad  period = {NUMBER} s  "
    rf"(mu|lambda) = ({NUMBER}|not trusted|\+1 \(fold\))  iterations = \d+"
)


def run(capsys, *words: object) -> tuple[int, str, str]:
    """(exit code, standard output, standard error) of a command line, in this process."""
    capsys.readouterr()
    code = cli.main([str(word) for word in words])
    out, err = capsys.readouterr()
    return code, out, err


def one_json(text: str) -> dict:
    """The one JSON object that `text` is; NaN and infinity are no JSON."""

    def refuse(name):
        raise AssertionError(f"{name} is no JSON")

    assert text.endswith("\n") and text.count("\n") == 1
    found = json.loads(text, parse_constant=refuse)
    assert isinstance(found, dict)
    return found


def contents(folder: Path) -> dict[str, bytes | None]:
    """Every file below a folder with its bytes, every folder with None."""
    return {str(p.relative_to(folder)): p.read_bytes() if p.is_file() else None for p in sorted(folder.rglob("*"))}


def rows_of(path: Path) -> list[dict[str, str]]:
    """The rows of a CSV file, each of them complete."""
    text = path.read_bytes().decode("ascii")
    assert text.endswith("\n")
    header, *rows = csv.reader(text.splitlines())
    assert tuple(header) == CSV_COLUMNS
    assert all(len(row) == len(header) for row in rows)
    return [dict(zip(header, row, strict=True)) for row in rows]


def is_picture(path: Path) -> bool:
    return path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 10_000  # an empty page takes less


# orbit ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("model", "size"), [("switch", 1e-8), ("lugre", 1e-7)])
@pytest.mark.parametrize("gain", [0.04, 0.2, 0.6])
def test_orbit_json(capsys, model, size, gain):
    """The reference table, through the whole program, to the digits that the table has."""
    code, out, err = run(capsys, "orbit", "--model", model, "--gain", gain, "--tol", "1e-9", "--json")
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
    code, out, err = run(capsys, "orbit", "--gain", 0.2, "--tol", "1e-9", "--json", "--full")
    full = one_json(out)
    assert code == 0 and full["half_multiplier"] is None and full["unknowns"] > half["unknowns"]
    assert "lambda = +0.2703" in err
    for key in ("amplitude", "period", "log10_abs_half_multiplier"):
        assert full[key] == pytest.approx(half[key], rel=1e-8)
    out = run(capsys, "orbit", "--gain", 0.2, "--full")[1]
    assert re.search(r"^  multiplier +0\.270", out, re.MULTILINE) and "half multiplier" not in out


@pytest.mark.parametrize("solver", ["ipopt", "newton"])
def test_orbit_text(capsys, solver):
    code, out, err = run(capsys, "orbit", "--gain", 0.1, "--solver", solver)
    assert code == 0 and "Traceback" not in err
    assert out.startswith("switch servo at gain 0.1: stable hunting cycle\n")
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
    _, out, err = run(capsys, "orbit", "--gain", 0.3)
    assert "unknown stability" in out and "not to be trusted" in out and "mu = not trusted" in err
    assert "-0.58" not in out + err
    row = dict(zip(CSV_COLUMNS, map(str, csv_row(orbit, "")), strict=True))
    assert (row["half_multiplier"], row["log10_abs_half_multiplier"], row["stable"]) == ("nan", "nan", "")


def test_version_and_help(capsys):
    for words, text in (
        (["--version"], f"casahunt {__version__}"),
        (["--help"], "diagram"),
        *(([command, "--help"], "--set") for command in cli.COMMANDS),
    ):
        with pytest.raises(SystemExit) as end:
            cli.main(words)
        assert not end.value.code and text in capsys.readouterr().out


# fold -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("model", "size"), [("switch", 1e-9), ("lugre", 1e-8)])
def test_fold_json(capsys, model, size):
    code, out, err = run(capsys, "fold", "--model", model, "--tol", "1e-9", "--json")
    found, known = one_json(out), table1.REFERENCE[model]["fold"]
    assert code == 0 and set(found) >= FOLD_KEYS
    assert found["model"] == model and found["status"] == "converged"
    assert found["gain"] == pytest.approx(known["K"], rel=size)
    assert found["amplitude"] == pytest.approx(known["amplitude"], rel=1e-6)
    assert found["period"] == pytest.approx(known["period"], rel=1e-6)
    assert 0 < found["error_estimate"] <= 1e-9 and found["wall_s"] > 0
    assert PROGRESS.fullmatch(err.strip())[3] == "+1 (fold)"


def test_fold_text(capsys):
    code, out, err = run(capsys, "fold", "--quiet", "--set", "friction.static=0.5")
    assert (code, err) == (0, "")
    gain = float(re.match(rf"switch servo: hunting is possible up to gain ({NUMBER})\n", out)[1])
    # The fold depends on Fs, Fc and vs through (Fs - Fc)/vs alone: vs = 0.03 has the same one.
    assert one_json(run(capsys, "fold", "--json", "--set", "friction.stribeck_velocity=0.03")[1])["gain"] == (
        pytest.approx(gain, rel=1e-5)
    )


# diagram ----------------------------------------------------------------------------------------------------


def test_diagram(capsys, tmp_path):
    """Pictures and data; twice into the same folder, which is made with its parents."""
    out = tmp_path / "new" / "folder"
    command = ["diagram", "--model", "switch", "--from", "0.3", "--out", out]
    code, text, err = run(capsys, *command)
    assert code == 0
    assert set(contents(out)) == {*command_diagram.PICTURES, "switch.csv", "switch.npz"}
    assert all(is_picture(out / name) for name in command_diagram.PICTURES)

    rows, branch = rows_of(out / "switch.csv"), load_branch(out / "switch.npz")
    points = [row for row in rows if not row["special"]]
    assert len(points) == len(branch.orbits) > 20
    assert [float(row["gain"]) for row in points] == list(branch.gains)
    assert [float(row["amplitude_rad"]) for row in points] == list(branch.amplitudes)
    assert [float(row["period_s"]) for row in points] == list(branch.periods)
    assert [float(row["half_multiplier"]) for row in points] == list(branch.half_multipliers)
    assert float(points[0]["gain"]) == float(points[-1]["gain"]) == 0.3
    assert all(row["status"] == "converged" and float(row["error_estimate"]) <= 1e-6 for row in rows)
    assert all(float(row["trivial_multiplier_error"]) < 1e-5 for row in points)
    assert all(int(row["unknowns"]) > 50 and int(row["iterations"]) >= 1 for row in rows)

    # Stable, superstable, fold, unstable: the fold divides the two.
    kinds = [row["special"] for row in rows]
    assert kinds.count("fold") == kinds.count("superstable") == 1
    fold = kinds.index("fold")
    assert kinds.index("superstable") < fold
    assert {row["stable"] for row in rows[:fold]} == {"True"} and rows[fold]["stable"] == ""
    assert {row["stable"] for row in rows[fold + 1 :]} == {"False"}
    known = table1.REFERENCE["switch"]["fold"]
    assert float(rows[fold]["gain"]) == pytest.approx(known["K"], rel=1e-6)
    assert float(rows[fold]["amplitude_rad"]) == pytest.approx(known["amplitude"], rel=1e-5)
    assert float(rows[fold]["period_s"]) == pytest.approx(known["period"], rel=1e-5)
    assert [special.kind for special in branch.special] == ["superstable", "fold"]

    # A progress line per point, a sentence per special point, the same sentences in the summary.
    lines = err.splitlines()
    assert sum(bool(PROGRESS.fullmatch(line)) for line in lines) == len(points)
    assert len(lines) == len(rows)
    for special in branch.special:
        assert f"switch  {special.meaning}" in lines and f"  {special.meaning}" in text.splitlines()
    assert text.startswith(f"switch: {len(points)} points; ") and text.endswith(f"written to {out}\n")

    files, gains = set(contents(out)), [float(row["gain"]) for row in rows]
    code, text, err = run(capsys, *command, "--quiet", "--json")
    assert (code, err) == (0, "")
    assert one_json(text)["out"] == str(out)
    assert set(contents(out)) == files
    assert [float(row["gain"]) for row in rows_of(out / "switch.csv")] == pytest.approx(gains, rel=1e-9)


def test_diagram_of_both_models(capsys, tmp_path):
    code, text, err = run(capsys, "diagram", "--from", 0.55, "--out", tmp_path, "--json", "--quiet")
    assert (code, err) == (0, "")
    found = one_json(text)
    assert set(found) >= {"out", "branches", "failures", "wall_s"} and found["failures"] == []
    assert set(contents(tmp_path)) == {*command_diagram.PICTURES, "switch.csv", "switch.npz", "lugre.csv", "lugre.npz"}
    for branch, model in zip(found["branches"], ("switch", "lugre"), strict=True):
        fold = next(special for special in branch["special"] if special["kind"] == "fold")
        assert branch["model"] == model
        assert fold["gain"] == pytest.approx(table1.REFERENCE[model]["fold"]["K"], rel=1e-6)
        assert branch["gain_range"][0] == 0.55
        assert branch["gain_range"][1] <= fold["gain"] * (1 + 1e-6)
        assert branch["points"] == len(load_branch(tmp_path / f"{model}.npz").orbits)


@pytest.mark.slow
def test_diagram_as_it_is_asked_for(tmp_path):
    """The main job of the program, in a process of its own: both models, all the way down."""
    done = process("diagram", "--out", tmp_path / "out", "--json")
    assert done.returncode == 0, done.stderr
    found = one_json(done.stdout)
    assert [branch["gain_range"][0] for branch in found["branches"]] == [0.0321, 0.0321]
    for model, period in (("switch", 3318), ("lugre", 1273)):  # at the lower end of the unstable branches
        rows = rows_of(tmp_path / "out" / f"{model}.csv")
        assert float(rows[-1]["gain"]) == 0.0321 and rows[-1]["stable"] == "False"
        assert float(rows[-1]["period_s"]) == pytest.approx(period, abs=1)
        assert all(row["status"] == "converged" for row in rows)
    assert all(is_picture(tmp_path / "out" / name) for name in command_diagram.PICTURES)


def test_earlier_results_are_replaced(capsys, tmp_path):
    """By new ones of the same name, and not before those are there: without a cycle nothing is touched."""
    for name in (*command_diagram.PICTURES, "switch.csv", "switch.npz", "lugre.csv", "notes.txt"):
        (tmp_path / name).write_text("old")
    before = contents(tmp_path)
    code, out, err = run(capsys, "diagram", "--model", "switch", "--from", 0.8, "--out", tmp_path)
    assert (code, out) == (1, "")
    assert contents(tmp_path) == before
    # Between the two folds only the Switch servo hunts: the LuGre table of another servo is no longer called so.
    code, out, err = run(capsys, "diagram", "--from", 0.63, "--out", tmp_path, "--quiet")
    assert code == 1 and out.startswith("switch: ")
    denial, left = err.splitlines()
    assert "no hunting limit cycle of the lugre servo at gain 0.63" in denial
    assert "lugre.csv.old is of an earlier run" in left
    after = contents(tmp_path)
    assert set(after) == {*command_diagram.PICTURES, "switch.csv", "switch.npz", "lugre.csv.old", "notes.txt"}
    assert {name for name, content in after.items() if content == b"old"} == {"lugre.csv.old", "notes.txt"}


def walk_that_ends(with_what):
    """A stand-in for the diagram: two points, then `with_what`."""

    def diagram(servo, model, *, start, options, natural, begun):
        yield DiagramPoint(find_orbit(servo, model, start), ())
        yield DiagramPoint(find_orbit(servo, model, start * 1.1), ())
        if isinstance(with_what, BaseException):
            raise with_what
        return with_what

    return diagram


@pytest.mark.parametrize("end", ["no step converged: try this", NoOrbit("no step converged: try this")], ids=type)
def test_branch_that_does_not_come_back(capsys, tmp_path, monkeypatch, end):
    """Exit code 1, and what has been computed is drawn and kept."""
    monkeypatch.setattr(command_diagram, "diagram", walk_that_ends(end))
    command = ["diagram", "--model", "switch", "--from", 0.3, "--out", tmp_path, "--quiet", "--json"]
    code, out, err = run(capsys, *command)
    assert code == 1 and one_json(out)["failures"] == [err.removeprefix("casahunt diagram: ").rstrip("\n")]
    assert err.startswith("casahunt diagram: the branch of the switch servo was followed from gain 0.3 to gain 0.33")
    assert "no step converged: try this" in err and "--tol" in err
    assert len(rows_of(tmp_path / "switch.csv")) == len(load_branch(tmp_path / "switch.npz").orbits) == 2
    assert is_picture(tmp_path / "diagram.png")


@pytest.mark.parametrize(("kind", "expected"), [("fold", 1), ("symmetry breaking", 0)])
def test_a_special_point_that_is_not_located(capsys, tmp_path, monkeypatch, kind, expected):
    """Said, and kept with the branch, also by a run that is taken up; a diagram without its fold has failed."""
    # The multiplier falls through 0.5 next to the fold, where it is 1.
    passed = replace(monitor.SYMMETRY_BREAKING, value=lambda orbit, point: orbit.half_multiplier - 0.5)
    monitors = (monitor.FOLD if kind == "fold" else passed,)
    locate = monitor.locate
    monkeypatch.setattr(monitor, "locate", lambda *a, **k: None if a[2].kind == kind else locate(*a, **k))
    monkeypatch.setattr(command_diagram, "diagram", partial(diagram, monitors=monitors))
    monkeypatch.setattr(command_diagram, "_pictures", lambda *_: None)
    command = ["diagram", "--model", "switch", "--from", 0.6, "--out", tmp_path, "--quiet", "--json"]
    code, out, err = run(capsys, *command)
    assert code == expected
    (branch,) = one_json(out)["branches"]
    gaps = branch["missed"]
    assert branch["special"] == [] and gaps and all(gap["kind"] == kind for gap in gaps)
    assert err == "".join(f"casahunt diagram: switch: {gap['meaning']}\n" for gap in gaps)
    bounds = [float(bound) for bound in re.findall(r"between gain = (\S+) and (\S+) was not located", err)[0]]
    assert all(0.6 <= bound < table1.REFERENCE["switch"]["fold"]["K"] for bound in bounds) and bounds[0] != bounds[1]
    assert one_json(out)["failures"] == [gap["meaning"] for gap in gaps if kind == "fold"]
    assert [(m.kind, m.meaning) for m in load_branch(tmp_path / "switch.npz").missed] == [
        (gap["kind"], gap["meaning"]) for gap in gaps
    ]
    again = run(capsys, *command, "--resume")
    assert (again[0], again[2]) == (code, err) and one_json(again[1])["branches"] == [branch]


@pytest.mark.parametrize("trouble", [KeyboardInterrupt(), ZeroDivisionError()], ids=repr)
def test_trouble_on_the_way_keeps_the_points(capsys, tmp_path, monkeypatch, trouble):
    monkeypatch.setattr(command_diagram, "diagram", walk_that_ends(trouble))
    command = ["diagram", "--model", "switch", "--from", 0.3, "--out", tmp_path / "out", "--quiet"]
    if isinstance(trouble, KeyboardInterrupt):
        assert run(capsys, *command) == (
            130, "", f"casahunt diagram: interrupted; the points computed so far are in {tmp_path / 'out'}\n"
        )  # fmt: skip
    else:
        with pytest.raises(ZeroDivisionError):
            run(capsys, *command)
    branch = load_branch(tmp_path / "out" / "switch.npz")
    assert len(rows_of(tmp_path / "out" / "switch.csv")) == len(branch.orbits) == 2
    assert branch.ended == "interrupted"


@pytest.mark.parametrize("words", [["orbit", "--gain", "0.1"], ["fold"], ["diagram", "--out", "new/out"]])
def test_interrupt_before_the_first_point(capsys, tmp_path, monkeypatch, words):
    def stop(*args, **kwargs):
        raise KeyboardInterrupt

    for module, name in ((command_orbit, "find_orbit"), (command_fold, "find_fold"), (command_diagram, "diagram")):
        monkeypatch.setattr(module, name, stop)
    monkeypatch.chdir(tmp_path)
    what = "; no point was computed" if words[0] == "diagram" else ""
    assert run(capsys, *words) == (130, "", f"casahunt {words[0]}: interrupted{what}\n")
    assert not contents(tmp_path)


# Wrong input: exit code 2, one sentence, nothing written ------------------------------------------------------

ORBIT = ["orbit", "--gain", "0.1", "--plot", "plot.png", "--save", "save.npz"]
DIAGRAM = ["diagram", "--out", "new/out"]
FOLD = ["fold"]
ANY = [ORBIT, DIAGRAM, FOLD]
FILES = {
    "file": b"mine",
    "broken.toml": b"[servo\n",
    "twice.toml": b"[servo]\ninertia = 1\ninertia = 2\n",
    "utf16.toml": "[servo]\n".encode("utf-16"),
    "key.toml": b"[friction]\nstatik = 0.5\n",
    "section.toml": b"[frictions]\nstatic = 0.5\n",
    "word.toml": b'[servo]\ninertia = "heavy"\n',
    "true.toml": b"[servo]\ninertia = true\n",
    "nan.toml": b"[friction]\nviscous = nan\n",
    "inf.toml": b"[friction]\nviscous = -inf\n",
    "zero.toml": b"[servo]\ninertia = 0\n",
    "drop.toml": b"[friction]\nstatic = 0.1\n",
}
FINITE = "must be a finite number"
NOT_NAN = "must be a finite number, not NaN or infinity"

# What is wrong in every command: (words added, parts of the sentence).
WRONG_EVERYWHERE = [
    (["--set", "friction.statik=1"], ["unknown key 'friction.statik'", "did you mean 'friction.static'?"]),
    (["--set", "static=0.5"], ["unknown key 'static'", "did you mean 'friction.static'?"]),
    (["--set", "gain=0.5"], ["unknown key 'gain'"]),
    (["--set", "friction.static"], ["--set 'friction.static': must have the form section.key=value"]),
    (["--set", "friction.static=high"], ["friction.static = 'high'", FINITE]),
    (["--set", "friction.static=nan"], ["friction.static = nan", NOT_NAN]),
    (["--set", "friction.viscous=-inf"], ["friction.viscous = -inf", NOT_NAN]),
    (["--set", "servo.inertia=0"], ["servo.inertia = 0: must be greater than 0"]),
    (["--set", "servo.inertia=-0.026"], ["servo.inertia = -0.026: must be greater than 0"]),
    (["--set", "friction.stribeck_velocity=0"], ["friction.stribeck_velocity = 0: must be greater than 0"]),
    (["--set", "friction.stribeck_velocity=-1"], ["friction.stribeck_velocity = -1: must be greater than 0"]),
    (["--set", "friction.static=0.43"], ["friction.static = 0.43: must be at least 0.44", "friction.coulomb"]),
    (["--set", "friction.static=0.4399999999999"], ["friction.static = 0.4399999999999: must be at least 0.44"]),
    (["--set", "friction.coulomb=0.6"], ["friction.static = 0.53: must be at least 0.6", "friction.coulomb"]),
    (["--set"], ["--set: must be followed by a value"]),
    (["--tol", "0"], ["tol = 0: must lie between 1e-12 and 0.01"]),
    (["--tol", "-1e-6"], ["tol = -1e-06: must lie between 1e-12 and 0.01"]),
    (["--tol", "1"], ["tol = 1: must lie between 1e-12 and 0.01"]),
    (["--tol", "1e-15"], ["tol = 1e-15: must lie between 1e-12 and 0.01"]),
    (["--tol", "nan"], ["tol = nan", NOT_NAN]),
    (["--tol", "small"], ["tol = 'small'", FINITE]),
    (["--model", "swich"], ["unknown model 'swich'", "did you mean 'switch'?", "switch, lugre"]),
    (["--model", "LUGRE"], ["unknown model 'LUGRE'", "did you mean 'lugre'?"]),
    (["--model", "dahl"], ["unknown model 'dahl' (known: switch, lugre)"]),
    (["missing.toml"], ["servo file 'missing.toml': no such file"]),
    (["folder.png"], ["servo file 'folder.png': cannot be read"]),
    (["broken.toml"], ["servo file 'broken.toml': not valid TOML"]),
    (["twice.toml"], ["servo file 'twice.toml': not valid TOML"]),
    (["utf16.toml"], ["servo file 'utf16.toml': not valid TOML"]),
    (["key.toml"], ["unknown key 'friction.statik'", "did you mean 'friction.static'?"]),
    (["section.toml"], ["unknown section 'frictions'", "did you mean 'friction'?"]),
    (["word.toml"], ["servo.inertia = 'heavy'", FINITE]),
    (["true.toml"], ["servo.inertia = True", FINITE]),
    (["nan.toml"], ["friction.viscous = nan", NOT_NAN]),
    (["inf.toml"], ["friction.viscous = -inf", NOT_NAN]),
    (["zero.toml"], ["servo.inertia = 0: must be greater than 0"]),
    (["drop.toml"], ["friction.static = 0.1: must be at least 0.44"]),
    (["zero.toml", "drop.toml"], ["'drop.toml': must be left out, one servo file is enough"]),
    (["--tool", "1e-6"], ["unknown option '--tool'", "did you mean '--tol'?"]),
    (["--sett=friction.static=1"], ["unknown option '--sett'", "did you mean '--set'?"]),
    (["--qiet"], ["unknown option '--qiet'", "did you mean '--quiet'?"]),
    (["--xyzzy"], ["unknown option '--xyzzy' (known: --tol, "]),
    (["--json=yes"], ["--json: takes no value, but was given 'yes'"]),
]
WRONG_SOMEWHERE = [
    ([], ["a command must be given: orbit, diagram, fold"]),
    (["--quiet"], ["COMMAND"]),
    (["orbt", "--gain", "0.1"], ["unknown command 'orbt'", "did you mean 'orbit'?"]),
    (["plot"], ["unknown command 'plot'", "(known: orbit, diagram, fold"]),
    (["orbit"], ["gain: must be given"]),
    (["orbit", "--gain"], ["--gain: must be followed by a value"]),
    (["orbit", "--gan", "0.1"], ["unknown option '--gan'", "did you mean '--gain'?"]),
    (["fold", "--gain", "0.1"], ["unknown option '--gain' (known: "]),
    (["orbit", "--from", "0.1"], ["unknown option '--from'"]),
    (["diagram", "--form", "0.1"], ["unknown option '--form'", "did you mean '--from'?"]),
    *(
        ([*command, value], [f"{key} = {shown}", what])
        for command, key in ((["orbit", "--gain"], "gain"), (["diagram", "--out", "new/out", "--from"], "from"))
        for value, shown, what in (
            ("0", "0", "must be greater than 0"),
            ("-0.1", "-0.1", "must be greater than 0"),
            ("-1e-3", "-0.001", "must be greater than 0"),
            ("nan", "nan", NOT_NAN),
            ("inf", "inf", NOT_NAN),
            ("-inf", "-inf", NOT_NAN),
            ("1e999", "1e999", FINITE),
            ("high", "'high'", FINITE),
            ("", "''", FINITE),
        )
    ),
    ([*ORBIT, "--branch", "unsable"], ["unknown branch 'unsable'", "did you mean 'unstable'?", "stable, unstable"]),
    ([*ORBIT, "--solver", "ipop"], ["unknown solver 'ipop'", "did you mean 'ipopt'?", "ipopt, newton"]),
    *(
        (["orbit", "--gain", "0.1", f"--{key}", path], [f"{key} = {path!r}: ", what])
        for key, end in (("plot", ".png"), ("save", ".npz"))
        for path, what in (
            (f"missing/a{end}", "there is no folder 'missing'"),
            (f"file/a{end}", "there is no folder 'file'"),
            (f"folder{end}", "must be a file, but is a folder"),
            ("a.txt", f"the name must end in {end}"),
            ("a", f"the name must end in {end}"),
            ("", f"the name must end in {end}"),
            ("x" * 300 + end, "cannot be written"),
        )
    ),
    (["diagram", "--out", "file/sub"], ["out = 'file/sub': the folder cannot be made (Not a directory)"]),
    (["diagram", "--out", "file"], ["out = 'file': the folder cannot be made (a file of that name exists)"]),
    (["diagram", "--out", "new/" + "x" * 300], ["the folder cannot be made (File name too long)"]),
    (["diagram", "--out", ""], ["out = '': the folder cannot be made (its name is empty)"]),
    (["diagram", "--out", "taken"], ["out = 'taken': the folder cannot be written into (switch.csv is a folder)"]),
    ([*DIAGRAM, "--model", "lugre", "--model", "lugre"], ["model = lugre, lugre: each model can be asked for once"]),
]
WRONG = [([*command, *more], parts) for command in ANY for more, parts in WRONG_EVERYWHERE] + WRONG_SOMEWHERE


@pytest.mark.parametrize(("words", "parts"), WRONG, ids=[" ".join(words)[:60] or "nothing" for words, _ in WRONG])
def test_wrong_input(capsys, tmp_path, monkeypatch, words, parts):
    for name, content in FILES.items():
        (tmp_path / name).write_bytes(content)
    for name in ("folder.png", "folder.npz", "taken", "taken/switch.csv"):
        (tmp_path / name).mkdir()
    (tmp_path / "taken" / "diagram.png").write_text("old")
    before = contents(tmp_path)
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, *words)
    assert (code, out) == (2, "")
    command = f"casahunt {words[0]}: " if words and words[0] in cli.COMMANDS else "casahunt: "
    assert err.startswith(command) and err.endswith("\n") and err.count("\n") == 1
    for part in parts:
        assert part in err
    assert contents(tmp_path) == before


def test_folder_without_permission(capsys, tmp_path, monkeypatch):
    """Asked of the system, not found out by failing after the computation."""
    monkeypatch.setattr(os, "access", lambda path, mode: False)
    for words in (
        ["orbit", "--gain", "0.1", "--plot", tmp_path / "a.png"],
        ["orbit", "--gain", "0.1", "--save", tmp_path / "a.npz"],
        ["diagram", "--out", tmp_path / "new" / "out"],
    ):
        code, out, err = run(capsys, *words)
        assert (code, out) == (2, "") and "(no permission)" in err and err.count("\n") == 1
    assert not contents(tmp_path)


# No such orbit: exit code 1 -----------------------------------------------------------------------------------

NO_DROP = ["--set", "friction.static=0.44"]  # Fs = Fc


@pytest.mark.parametrize(
    ("words", "parts"),
    [
        (["--gain", "0.8"], ["switch servo at gain 0.8", "0.8", "scanned stick positions from"]),
        (["--gain", "0.8", "--branch", "unstable"], ["switch servo at gain 0.8", "scanned stick positions from"]),
        (["--gain", "0.8", "--model", "lugre"], ["lugre servo at gain 0.8", "scanned stick positions from"]),
        (["--gain", "0.1", *NO_DROP], ["static equals Coulomb friction", "scanned"]),
        (["--gain", "0.1", "--set", "friction.coulomb=0.53", "--model", "lugre"], ["Coulomb friction", "scanned"]),
    ],
)
def test_no_hunting(capsys, tmp_path, monkeypatch, words, parts):
    monkeypatch.chdir(tmp_path)
    code, out, err = run(capsys, "orbit", *words, "--plot", "a.png", "--save", "a.npz", "--json")
    assert (code, out) == (1, "")
    assert err.startswith("casahunt orbit: no hunting limit cycle") and err.count("\n") == 1
    for part in parts:
        assert part in err
    assert not contents(tmp_path)


def test_no_fold_without_hunting(capsys):
    code, out, err = run(capsys, "fold", *NO_DROP, "--json")
    assert (code, out) == (1, "")
    assert err.startswith("casahunt fold: no hunting limit cycle") and "scanned" in err and err.count("\n") == 1


@pytest.mark.parametrize(
    ("words", "models"), [(["--from", "0.8", "--model", "switch"], ["switch"]), (NO_DROP, ["switch", "lugre"])]
)
def test_no_diagram_without_hunting(capsys, tmp_path, words, models):
    """One sentence per model, and no folder where there is nothing to put into it."""
    command = ["diagram", *words, "--out", tmp_path / "new" / "out"]
    code, text, err = run(capsys, *command)
    assert (code, text) == (1, "")
    for model, line in zip(models, err.splitlines(), strict=True):
        assert line.startswith(f"casahunt diagram: no hunting limit cycle of the {model} servo") and "scanned" in line
    assert not contents(tmp_path)
    code, text, again = run(capsys, *command, "--json", "--quiet")
    found = one_json(text)
    assert (code, again, found["out"], found["branches"]) == (1, err, None, [])
    assert [f"casahunt diagram: {failure}" for failure in found["failures"]] == err.splitlines()
    assert not contents(tmp_path)


# Processes ------------------------------------------------------------------------------------------------------


def process(*words: object, **kwargs) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "casahunt", *(str(word) for word in words)]
    return subprocess.run(command, cwd=ROOT, text=True, **{"capture_output": True, **kwargs})


def test_process_orbit():
    """Neither CasADi nor IPOPT adds a word to what is printed."""
    done = process("orbit", "--gain", "0.1", "--json", "--quiet")
    assert (done.returncode, done.stderr) == (0, "")
    assert one_json(done.stdout)["period"] == pytest.approx(11.35587139, rel=1e-6)


def test_process_exit_codes():
    for words, code in ((["orbit", "--gain", "0"], 2), (["orbit", "--gain", "0.8"], 1), (["--version"], 0)):
        done = process(*words)
        assert done.returncode == code
        assert "Traceback" not in done.stderr and (done.stdout == "") == (code != 0)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="a device that is always full")
def test_output_that_cannot_be_written():
    with Path("/dev/full").open("w") as full:
        done = process("orbit", "--gain", "0.1", "--quiet", capture_output=False, stdout=full, stderr=subprocess.PIPE)
    assert done.returncode == 1
    assert done.stderr == "casahunt orbit: the output could not be written: No space left on device\n"


@contextlib.contextmanager
def diagram_under_way(out: Path):
    """A LuGre diagram of which at least three points are on disk, still running."""
    command = ["diagram", "--model", "lugre", "--tol", "1e-9", "--out", str(out)]
    running = subprocess.Popen(
        [sys.executable, "-m", "casahunt", *command],
        cwd=ROOT, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        # A test run started in the background ignores Ctrl-C, and its children would, too.
        preexec_fn=lambda: signal.signal(signal.SIGINT, signal.SIG_DFL),
    )  # fmt: skip
    try:
        deadline = time.monotonic() + 120
        path = out / "lugre.csv"
        while not path.exists() or path.read_bytes().count(b"\n") < 4:
            assert running.poll() is None, running.communicate()
            assert time.monotonic() < deadline
            time.sleep(0.01)
        yield running
    finally:
        running.kill()
        running.communicate()


@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_interrupt(tmp_path):
    out = tmp_path / "out"
    with diagram_under_way(out) as running:
        running.send_signal(signal.SIGINT)
        text, err = running.communicate(timeout=60)
    assert (running.returncode, text) == (130, "")
    *progress, last = err.splitlines()
    assert all(PROGRESS.fullmatch(line) or re.match(r"\d+ s: ", line) for line in progress)  # where a busy machine is
    assert last == f"casahunt diagram: interrupted; the points computed so far are in {out}"
    rows, branch = rows_of(out / "lugre.csv"), load_branch(out / "lugre.npz")
    assert isinstance(branch, Branch) and branch.ended == "interrupted"
    assert 3 <= len(branch.orbits) <= len(rows) <= len(branch.orbits) + 1
    assert [float(row["gain"]) for row in rows][: len(branch.orbits)] == list(branch.gains)
    assert set(contents(out)) == {"lugre.csv", "lugre.npz"}


@pytest.mark.slow  # test_files.py kills a Switch diagram
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_crash(tmp_path):
    out = tmp_path / "out"
    with diagram_under_way(out) as running:
        running.kill()
        running.wait(timeout=60)
    rows = rows_of(out / "lugre.csv")
    assert len(rows) >= 3 and all(row["status"] == "converged" for row in rows)
    assert abs(len(load_branch(out / "lugre.npz").orbits) - len(rows)) <= 1
    assert {name for name in contents(out) if not name.endswith(".partial")} == {"lugre.csv", "lugre.npz"}


# Digits ---------------------------------------------------------------------------------------------------------


SLOW = [pytest.param(tol, marks=pytest.mark.slow) for tol in ("1e-2", "1e-4", "1e-8")]


@pytest.mark.parametrize("tol", ["1e-6", *SLOW])
def test_digits_shown_are_digits_known(capsys, tmp_path, tol):
    """What a text shows is right to five units of its last digit, and to twice the tolerance."""
    table = table1.REFERENCE["switch"]
    stable, unstable = (next(row for row in table[b] if row["K"] == 0.4) for b in ("stable", "unstable"))
    fold, diagram = table["fold"], ["diagram", "--model", "switch", "--from", "0.4", "--out", tmp_path]
    shown = [
        (["orbit", "--gain", "0.4"], rf"amplitude +({NUMBER}) rad", stable["amplitude"]),
        (["orbit", "--gain", "0.4"], rf"period +({NUMBER}) s", stable["period"]),
        (["fold"], rf"up to gain ({NUMBER})", fold["K"]),
        (["fold"], rf"optimisation problem .*: ({NUMBER})", fold["K"]),
        (["fold"], rf"period there +({NUMBER}) s", fold["period"]),
        (["basin", "--gain", "0.4"], rf"within ({NUMBER}) rad", unstable["amplitude"]),
        (["basin", "--gain", "0.4"], rf"  stable cycle .* = ({NUMBER}) rad", stable["amplitude"]),
        (diagram, rf"fold at gain = ({NUMBER})", fold["K"]),
    ]
    said: dict[str, str] = {}
    for words, pattern, truth in shown:
        if words[0] not in said:
            said[words[0]] = run(capsys, *words, "--tol", tol, "--quiet")[1]
        number = re.search(pattern, said[words[0]])[1]
        unit = 10.0 ** -len(number.partition(".")[2])
        assert abs(float(number) - truth) <= max(5.5 * unit, 1e-9 * truth), (words, number, truth)
        assert abs(float(number) - truth) <= 2 * float(tol) * truth


def test_digits_of_multipliers_are_digits_known(capsys):
    """To five units of the last digit; on the map, the amplitude and the period too."""
    table = table1.REFERENCE["switch"]
    stable, unstable = (next(row for row in table[b] if row["K"] == 0.4) for b in ("stable", "unstable"))
    for branch, row in (("stable", stable), ("unstable", unstable)):
        said = run(capsys, "orbit", "--gain", "0.4", "--branch", branch, "--quiet")[1]
        assert_known(re.search(rf"half multiplier +({NUMBER})", said)[1], row["mu"])
    said = run(capsys, "map", "--gain", "0.4", "--quiet")[1]
    found = re.findall(rf"a = ({NUMBER}) rad  mu = P' = ({NUMBER}) .* period = ({NUMBER}) s", said)
    for numbers, row in zip(found, (unstable, stable), strict=True):
        assert_known(numbers[0], row["amplitude"])
        assert_known(numbers[2], row["period"])


def assert_known(number: str, truth: float) -> None:
    """To five units of the last digit, where the reference has as many."""
    mantissa, _, exponent = number.partition("e")
    unit = 10.0 ** (int(exponent or 0) - len(mantissa.partition(".")[2]))
    assert abs(float(number) - truth) <= max(5.5 * unit, 1e-9 * abs(truth)), (number, truth)


def test_a_multiplier_shows_no_digits_below_its_error():
    assert complex_text(-0.150477177564, 3e-4) == "-0.1505"
    assert complex_text(105792.774812, 1e-5) == "105793"
    assert complex_text(0.5 - 0.25j, 1e-3) == "0.5-0.25j"
    assert complex_text(3e-7, 1e-6) == "0"
    assert complex_text(-2e-31, 1e-10, 3e-28) == "below 1e-27"


def test_what_is_not_finite_is_null_and_unknown():
    """JSON has no NaN and no infinity; a person is told that there is no estimate."""
    for missing in (math.nan, math.inf, -math.inf, np.float64("nan")):
        assert finite_or_none(missing) is None and error_text(missing) == "unknown"
    assert type(finite_or_none(np.float64(0.25))) is float and finite_or_none(-2) == -2.0
    assert error_text(1.26e-7) == "1.3e-07" and error_text(0.0) == "0.0e+00"


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["orbit"], "gain: must be given, for example --gain 0.1"),
        (["loop"], "gain: must be given, for example --gain 0.1 --gain 0.4"),
        (["uncertainty"], "uncertainty: must be given, for example --uncertainty friction.toml"),
        (["simulate", "--gain", "0.1", "--plot", "a.txt"], "the name must end in .png or .pdf or .svg"),
        (["diagram", "--model", "lugre", "--model", "lugre"], "each model can be asked for once"),
    ],
)
def test_what_must_be_given_is_asked_for(capsys, words, said):
    code, out, err = run(capsys, *words)
    assert code == 2 and out == "" and said in err


@pytest.mark.slow
@pytest.mark.parametrize("tol", ["1e-4", "1e-6", "1e-8"])
def test_digits_of_a_tuning_a_fold_curve_and_samples_are_digits_known(capsys, tmp_path, tol):
    K = table1.REFERENCE["switch"]["fold"]["K"]
    curve = ("fold-curve", "--model", "switch", "--vary", "servo.motor_gain", "--from", "16", "--to", "17")
    bounds = tmp_path / "u.toml"
    bounds.write_text('[interval]\n"servo.motor_gain" = [16.0, 17.0]\n')  # K cm is a constant of the servo
    for words, pattern, truth in [
        (("tune",), rf"recommended gain ({NUMBER})", 1.1 * K),
        (("tune",), rf"possible up to gain ({NUMBER})", K),
        (("tune",), rf"fold once more +({NUMBER});", K),
        ((*curve, "--points", "2"), rf"\n +16 +({NUMBER}) ", K),
        (("uncertainty", "--uncertainty", bounds, "--samples", "2"), rf"up to gain ({NUMBER});", K),
        (("uncertainty", "--uncertainty", bounds, "--samples", "2"), rf"worst corner +({NUMBER}) ", K),
    ]:
        said = run(capsys, *words, "--tol", tol, "--quiet")[1]
        assert_known(re.search(pattern, said)[1], truth)


def test_a_long_step_is_named_again(monkeypatch):
    monkeypatch.setattr(console, "REMIND_EVERY", 0.02)
    stream = io.StringIO()
    with console.telling(stream) as tell:
        tell("computing fold 3")  # not said: the first line comes after `TELL_EVERY`
        deadline = time.monotonic() + 5
        while stream.getvalue().count("computing fold 3 (for ") < 2 and time.monotonic() < deadline:
            time.sleep(0.01)
    assert stream.getvalue().count("computing fold 3 (for ") >= 2
    time.sleep(0.05)
    length = len(stream.getvalue())
    time.sleep(0.1)
    assert len(stream.getvalue()) == length
    with console.telling(stream) as tell:  # a reader that is gone ends nothing
        tell("computing fold 4")
        stream.close()
        time.sleep(0.1)
