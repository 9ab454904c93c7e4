"""What the console says of numbers and time: no digit that is not known, no NaN in JSON, and where a long step is; what
is there stays on a disk that is full.
"""

from __future__ import annotations

import ast
import json
import math
import os
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from command_line import NUMBER, contents, run
from file_support import ROOT, cheap_tuning, full_disk, posix, results
from matplotlib.figure import Figure

import casahunt
from casahunt import cli, effort, files, load_branch
from casahunt.checks import error_text, finite_or_none
from casahunt.views.answers.answer import complex_text
from casahunt.views.commands import fold_map as command_fold_map
from casahunt.views.commands import progress
from casahunt.views.pictures import plotting
from problems import table1

SLOW = [pytest.param(tol, marks=pytest.mark.slow) for tol in ("1e-2", "1e-8")]


@pytest.mark.parametrize("tol", ["1e-6", *SLOW])
def test_digits_shown_are_digits_known(capsys, tmp_path, tol):
    """What a text shows is right to five units of its last digit, and to twice the tolerance."""
    table = table1.REFERENCE["switch"]
    stable, unstable = (next(row for row in table[b] if row["K"] == 0.4) for b in ("stable", "unstable"))
    fold, diagram = table["fold"], ["diagram", "--model", "switch", "--from", "0.4", "--out", tmp_path]
    shown = [
        (["orbit", "--gain", "0.4"], rf"amplitude +({NUMBER}) rad", stable["amplitude"]),
        (["orbit", "--gain", "0.4"], rf"period +({NUMBER}) s", stable["period"]),
        (["fold"], rf"gain there +({NUMBER}) V/rad", fold["K"]),
        (["fold"], rf"on a finer mesh .*: ({NUMBER}) V/rad", fold["K"]),
        (["fold"], rf"period there +({NUMBER}) s", fold["period"]),
        (["basin", "--gain", "0.4"], rf"border +({NUMBER}) rad", unstable["amplitude"]),
        (["basin", "--gain", "0.4"], rf"  stable cycle .* = ({NUMBER}) rad", stable["amplitude"]),
        (diagram, rf"fold at gain = ({NUMBER})", fold["K"]),
    ]
    said: dict[str, str] = {}
    for words, pattern, truth in shown:
        if words[0] not in said:
            said[words[0]] = run(capsys, *words, "--tol", tol, "--quiet", "--details")[1].partition("\ndetails\n")[2]
        number = re.search(pattern, said[words[0]])[1]
        unit = 10.0 ** -len(number.partition(".")[2])
        assert abs(float(number) - truth) <= max(5.5 * unit, 1e-9 * truth), (words, number, truth)
        assert abs(float(number) - truth) <= 2 * float(tol) * truth


@pytest.mark.slow
def test_digits_of_multipliers_are_digits_known(capsys):
    """To five units of the last digit; on the map, the amplitude and the period too."""
    table = table1.REFERENCE["switch"]
    stable, unstable = (next(row for row in table[b] if row["K"] == 0.4) for b in ("stable", "unstable"))
    for branch, row in (("stable", stable), ("unstable", unstable)):
        said = run(capsys, "orbit", "--gain", "0.4", "--branch", branch, "--quiet", "--details")[1]
        assert_known(re.search(rf"half multiplier +({NUMBER})", said)[1], row["mu"])
    said = run(capsys, "map", "--gain", "0.4", "--quiet", "--details")[1]
    found = re.findall(rf"a = ({NUMBER}) rad.*\n +period = ({NUMBER}) s, half multiplier P' = ({NUMBER})", said)
    for numbers, row in zip(found, (unstable, stable), strict=True):
        assert_known(numbers[0], row["amplitude"])
        assert_known(numbers[1], row["period"])
        assert_known(numbers[2], row["mu"])


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


@pytest.mark.slow
@pytest.mark.parametrize("tol", ["1e-4", "1e-8"])
def test_digits_of_a_tuning_a_fold_curve_and_samples_are_digits_known(capsys, tmp_path, tol):
    K = table1.REFERENCE["switch"]["fold"]["K"]
    curve = ("fold-curve", "--model", "switch", "--vary", "servo.motor_gain", "--from", "16", "--to", "17")
    bounds = tmp_path / "u.toml"
    bounds.write_text('[interval]\n"servo.motor_gain" = [16.0, 17.0]\n')  # K cm is a constant of the servo
    for words, pattern, truth in [
        (("tune",), rf"\ndetails\n  gain +({NUMBER}) V/rad", 1.1 * K),
        (("tune",), rf"hunting +possible up to gain ({NUMBER}) V/rad\n", K),
        (("tune",), rf"fold once more +({NUMBER}) V/rad;", K),
        ((*curve, "--points", "2"), rf"\n +16 +({NUMBER}) ", K),
        (("uncertainty", "--uncertainty", bounds, "--samples", "2"), rf"as given +up to gain ({NUMBER}) V/rad", K),
        (("uncertainty", "--uncertainty", bounds, "--samples", "2"), rf"worst corner +({NUMBER}) ", K),
    ]:
        said = run(capsys, *words, "--tol", tol, "--quiet", "--details")[1].partition("\ndetails\n")[2]
        said = f"\ndetails\n{said}"
        assert_known(re.search(pattern, said)[1], truth)


def test_what_is_left_is_what_it_took_so_far(monkeypatch):
    """30 of 120 in 10 s: 30 s for the other 90, said only where it is known and worth saying."""
    monkeypatch.setattr(effort.time, "monotonic", lambda: 110.0)
    assert effort.left(30, 120, 100.0) == ", about 30 s left"
    assert effort.left(1, 120, 100.0) == ", about 20 min left"
    assert effort.left(0, 120, 100.0) == effort.left(120, 120, 100.0) == effort.left(119.9, 120, 100.0) == ""


def test_a_map_says_how_long_it_will_still_take(capsys, monkeypatch, telling_at_once):
    """In its grid, and between its neighbours: never more than all of it takes, and on a stream that is no terminal."""
    monkeypatch.setattr(effort, "WORTH_SAYING", 0.0)
    assert cli.main(["map", "--gain", "0.1", "--from", "1e-3", "--to", "0.02", "--points", "9", "--details"]) == 0
    said = capsys.readouterr().err
    assert re.search(r"5 of 9 motions of the first grid, about \d+ s left\n", said)
    assert re.search(r"1\d motions computed, the last one from the stick position \S+ rad, about \d+ s left\n", said)
    assert cli.main(["map", "--gain", "0.1", "--from", "1e-3", "--to", "0.02", "--points", "9", "--quiet"]) == 0
    assert capsys.readouterr().err == ""


def test_a_fold_map_says_how_long_it_will_still_take(capsys, monkeypatch, telling_at_once):
    """From the first report on: what came before it is not what follows."""
    now = 100.0
    monkeypatch.setattr(effort.time, "monotonic", lambda: now)
    progress.begin(every=True)
    report = command_fold_map._reporter(100)
    for count in (40, 60, 100):
        report(count)
        now += 10.0
    assert capsys.readouterr().err.splitlines() == [
        "40 of 100 folds computed", "60 of 100 folds computed, about 20 s left", "100 of 100 folds computed",
    ]  # fmt: skip


VARY = ["--model", "switch", "--vary", "friction.static", "--from", 0.52, "--to", 0.54, "--points", 2]
WRITERS = {
    "npz": (["orbit", "--gain", 0.1, "--save", "a.npz"], ["a.npz"]),
    "csv": (["simulate", "--gain", 0.1, "--time", 1, "--csv", "a.csv"], ["a.csv"]),
    "table": (["orbit", "--gain", 0.1, "--csv", "a.csv"], ["a.csv"]),
    "points": (["fold-curve", *VARY, "--csv", "a.csv"], ["a.csv"]),
    "html": (["tune", "--out", "."], ["tune.html", "tune.json"]),
    "picture": (["loop", "--gain", 0.1, "--plot", "a.png"], ["a.png"]),
}


@pytest.mark.parametrize("what", WRITERS)
def test_a_full_disk_says_so_and_leaves_what_was_there(capsys, tmp_path, monkeypatch, what):
    words, names = WRITERS[what]
    cheap_tuning(monkeypatch)
    monkeypatch.chdir(tmp_path)
    old = {name: results().get(name, b"old") for name in names}
    for name in names:
        Path(name).write_bytes(old[name])
    with monkeypatch.context() as patch:
        full_disk(patch)
        code, out, err = run(capsys, *words, "--quiet", "--json")
    # What was computed is said all the same; a curve ends with its first point that cannot be kept.
    assert code == 1 and err.count("\n") == 1
    assert out == "" if what == "points" else isinstance(json.loads(out), dict)
    assert "could not be written" in err and "the disk is full" in err
    assert contents(tmp_path) == old
    assert run(capsys, *words, "--quiet", "--json")[0] == 0
    assert set(contents(tmp_path)) == set(names) and not set(contents(tmp_path).values()) & set(old.values())


@pytest.mark.parametrize("full", [[0], [1], [0, 1]])
def test_the_result_and_every_file_stand_for_themselves(capsys, tmp_path, monkeypatch, full):
    """The archive and the picture of an orbit, each on a disk of its own."""
    paths = [tmp_path / "a.npz", tmp_path / "a.png"]
    command = ["orbit", "--gain", 0.1, "--save", paths[0], "--plot", paths[1], "--quiet"]
    full_disk(monkeypatch, numbers=full)
    code, out, err = run(capsys, *command)
    assert code == 1 and out.startswith("switch servo at gain 0.1 V/rad: hunts\n") and "period" in out
    said = "; ".join(f"{str(paths[i])!r}: the disk is full" for i in full)
    assert err == f"casahunt orbit: the output could not be written: {said}\n"
    assert set(contents(tmp_path)) == {path.name for i, path in enumerate(paths) if i not in full}


@posix
@pytest.mark.slow
def test_who_reads_nothing_gets_the_files(tmp_path):
    """Nobody reads the output any more (`| head -0`), or it goes to a full disk."""
    words = "orbit --gain 0.1 --save a.npz --plot a.png --quiet"
    said = "casahunt orbit: the output could not be written: "
    for where, code, says in (("| true", 141, ""), ("> /dev/full", 1, said)):
        command = f"{sys.executable} -m casahunt {words} {where}; exit ${{PIPESTATUS[0]}}"
        environment = {**os.environ, "PYTHONPATH": str(ROOT)}
        done = subprocess.run(["bash", "-c", command], cwd=tmp_path, env=environment, capture_output=True, text=True)
        assert done.returncode == code and done.stderr.startswith(says) and bool(done.stderr) == bool(says)
        assert set(contents(tmp_path)) == {"a.npz", "a.png"}
        for path in tmp_path.iterdir():
            path.unlink()


@pytest.mark.parametrize("number", [0, 1])
def test_files_that_belong_together_have_the_same_points(capsys, tmp_path, monkeypatch, number):
    """Archive and table of a diagram, the disk being full when the table is written for the first or second time."""
    full_disk(monkeypatch, numbers=[number])
    code, _, err = run(capsys, "diagram", "--model", "switch", "--from", 0.6, "--out", tmp_path, "--quiet")
    assert code == 1 and "the disk is full" in err
    if number == 0:
        assert not contents(tmp_path)
    else:
        assert set(contents(tmp_path)) == {"switch.csv", "switch.npz"}
        rows = (tmp_path / "switch.csv").read_text().splitlines()[1:]
        points = list(load_branch(tmp_path / "switch.npz").along())
        assert len(rows) == len(points) == 1


def test_files_take_their_places_together(tmp_path, monkeypatch):
    """All are whole, with the content on the disk, before the first is renamed; none where the block fails."""
    paths = [tmp_path / "a", tmp_path / "b"]
    synced, seen, replace, fsync = [], [], os.replace, os.fsync

    def watched(source, target):
        seen.append((len(synced), sorted(len(path.read_bytes()) for path in tmp_path.iterdir())))
        replace(source, target)

    monkeypatch.setattr(os, "fsync", lambda handle: (synced.append(handle), fsync(handle)))
    monkeypatch.setattr(os, "replace", watched)
    for text, trouble in (("old", None), ("newer", ZeroDivisionError), ("newer", None)):
        try:
            with files.together():
                for path in paths:
                    with files.whole_text(path) as stream:
                        stream.write(text)
                if trouble:
                    raise trouble
        except ZeroDivisionError:
            pass
        assert contents(tmp_path) == {path.name: b"old" if trouble else text.encode() for path in paths}
    assert seen == [(2, [3, 3]), (2, [3, 3]), (6, [3, 3, 5, 5]), (6, [3, 5, 5])]
    with files.whole_text(paths[0]) as stream:  # by itself again
        stream.write("latest")
    assert paths[0].read_text() == "latest"


@pytest.mark.parametrize("suffix", ["png", "pdf", "svg"])
def test_a_full_disk_leaves_the_old_picture(tmp_path, monkeypatch, suffix):
    path = tmp_path / f"a.{suffix}"
    path.write_text("old")
    figure = Figure()
    with monkeypatch.context() as patch:
        full_disk(patch)
        with pytest.raises(OSError, match="the disk is full"):
            plotting.save(figure, path)
    assert contents(tmp_path) == {path.name: b"old"}
    plotting.save(figure, path)
    assert path.read_bytes().startswith({"png": b"\x89PNG", "pdf": b"%PDF", "svg": b"<?xml"}[suffix])


def test_a_full_disk_ends_a_diagram(capsys, tmp_path, monkeypatch):
    """What was there stays, under another name where the new run had begun."""
    old = results("switch")["switch.csv"]
    (tmp_path / "switch.csv").write_bytes(old)
    full_disk(monkeypatch)
    code, out, err = run(capsys, "diagram", "--model", "switch", "--from", 0.6, "--out", tmp_path, "--quiet")
    assert (code, out) == (1, "") and "the disk is full" in err and "Traceback" not in err
    assert list(contents(tmp_path).values()) == [old]


def test_nobody_else_writes_files():
    """Every other way to a file would have to be made whole once more."""
    for path in Path(casahunt.__file__).parent.rglob("*.py"):
        if path.name == "files.py":
            continue
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(node, ast.Call):
                continue
            name = node.func.attr if isinstance(node.func, ast.Attribute) else getattr(node.func, "id", "")
            assert name not in ("write_text", "write_bytes", "savetxt", "unlink", "rmtree", "remove"), path
            if name == "open":
                modes = [a.value for a in node.args if isinstance(a, ast.Constant) and isinstance(a.value, str)]
                assert not any(set(mode) & set("wax+") for mode in modes), path
            if name in ("savefig", "savez"):
                assert ast.unparse(node.args[0]) in ("stream", "drawn"), path
