"""Every format of every command on a disk that is full: what is there stays, and what is missing is said."""

from __future__ import annotations

import ast
import json
import os
import subprocess
import sys
from pathlib import Path

import pytest
from file_support import ROOT, cheap_tuning, contents, full_disk, posix, results, run
from matplotlib.figure import Figure

import casahunt
from casahunt import files, load_branch
from casahunt.views.pictures import plotting

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
    assert code == 1 and out.startswith("switch servo at gain 0.1 V/rad: stable hunting cycle") and "status" in out
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


@pytest.mark.parametrize("numbers", [[0], [1], [2], [3]])
def test_files_that_belong_together_have_the_same_points(capsys, tmp_path, monkeypatch, numbers):
    """Archive and table of a diagram, the disk being full at either file of either point."""
    full_disk(monkeypatch, numbers=numbers)
    code, _, err = run(capsys, "diagram", "--model", "switch", "--from", 0.6, "--out", tmp_path, "--quiet")
    assert code == 1 and "the disk is full" in err
    if numbers[0] < 2:
        assert not contents(tmp_path)
    else:
        assert set(contents(tmp_path)) == {"switch.csv", "switch.npz"}
        rows = (tmp_path / "switch.csv").read_text().splitlines()[1:]
        assert len(rows) == len(load_branch(tmp_path / "switch.npz").orbits) == 1


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
