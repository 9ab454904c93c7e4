"""Nothing that a command writes is what it reads; in its folder nothing is replaced that casahunt has not written, nor
removed that nothing new replaces; one run at a time in a folder.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
from functools import partial
from pathlib import Path

import pytest
from command_line import contents, run
from file_support import ROOT, cheap_tuning, posix, results
from servo_files import dump

from casahunt import Servo, cli, files, find_orbit, pictures
from casahunt.errors import InputError
from casahunt.views.commands import diagram as command_diagram
from casahunt.views.commands import fold_curve as command_fold_curve
from casahunt.views.commands import orbit as command_orbit
from casahunt.views.commands import output_paths
from casahunt.views.commands import record as command_record
from casahunt.views.commands import tune as command_tune
from casahunt.views.commands import uncertainty as command_uncertainty
from casahunt.views.commands.console import folder

UNCERTAIN = '[interval]\n"friction.static" = [0.52, 0.54]\n'
RECORD = "time_s,position_rad\n0,0\n1,1\n2,0\n3,1\n4,0\n"


# What is read ------------------------------------------------------------------------------------------------


@pytest.fixture
def inputs(tmp_path, monkeypatch):
    """A folder with an input of every kind, under the endings of outputs; nothing is to be computed there."""

    def computed(*args, **kwargs):
        raise AssertionError("computed")

    for module, name in (
        (command_orbit, "find_orbit"), (command_fold_curve, "fold_curve"), (command_uncertainty, "find_fold"),
        (command_record, "measured"), (command_diagram, "diagram"), (command_tune, "tune"),
    ):  # fmt: skip
        monkeypatch.setattr(module, name, computed)
    monkeypatch.chdir(tmp_path)
    for end in ("csv", "png", "npz"):
        Path(f"servo.{end}").write_text(dump(Servo()))
    Path("uncertain.csv").write_text(UNCERTAIN)
    Path("record.csv").write_text(RECORD)
    return tmp_path


COMMANDS = {
    "servo": (["orbit", "servo.csv", "--gain", 0.1, "--csv"], "csv", "servo.csv", "the servo file"),
    "picture": (["orbit", "servo.png", "--gain", 0.1, "--plot"], "plot", "servo.png", "the servo file"),
    "archive": (["orbit", "servo.npz", "--gain", 0.1, "--save"], "save", "servo.npz", "the servo file"),
    "uncertainty": (["uncertainty", "--uncertainty", "uncertain.csv", "--csv"], "csv", "uncertain.csv",
                    "the uncertainty file"),
    "tuning": (["tune", "--uncertainty", "uncertain.csv", "--csv"], "csv", "uncertain.csv", "the uncertainty file"),
    "record": (["record", "record.csv", "--csv"], "csv", "record.csv", "the record"),
    "records": (["identify", "servo.csv", "record.csv", "--gain", 0.1, "--csv"], "csv", "record.csv", "the record"),
}  # fmt: skip
NAMES = {
    "same": lambda path: path.name,
    "dot": lambda path: f"./{path.name}",
    "absolute": str,
    "round about": lambda path: f"there/../{path.name}",
    "link": lambda path: os.symlink(path.name, path.with_name(f"link{path.suffix}")) or f"link{path.suffix}",
    "hard link": lambda path: os.link(path, path.with_name(f"hard{path.suffix}")) or f"hard{path.suffix}",
}


@posix
@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("command", COMMANDS)
def test_no_output_is_an_input(capsys, inputs, command, name):
    words, key, file, what = COMMANDS[command]
    (inputs / "there").mkdir()
    other = NAMES[name](inputs / file)
    before = {path: path.read_bytes() for path in inputs.iterdir() if path.is_file()}
    code, out, err = run(capsys, *words, other)
    said = f"{key} = {other!r}: must be another file than {what} {file!r}, which is read\n"
    assert (code, out, err) == (2, "", f"casahunt {words[0]}: {said}")
    assert {path: path.read_bytes() for path in inputs.iterdir() if path.is_file()} == before


@posix
def test_nor_is_a_file_in_the_folder(capsys, inputs):
    """By the names that the command gives them itself; an input beside them is none of its business."""
    for words, name in ((["diagram", "--model", "switch"], "switch.csv"), (["tune"], "tune.json")):
        os.makedirs("out", exist_ok=True)
        os.replace("servo.csv", f"out/{name}")
        os.symlink(f"out/{name}", "mine.toml")
        code, out, err = run(capsys, *words, "mine.toml", "--out", "out")
        said = f"out = {os.path.join('out', name)!r}: must be another file than the servo file 'mine.toml'"
        assert (code, out) == (2, "") and said in err and err.count("\n") == 1
        os.remove("mine.toml")
        os.replace(f"out/{name}", "servo.csv")
    with pytest.raises(AssertionError, match="computed"):
        run(capsys, "diagram", "servo.csv", "--out", ".", "--model", "switch", "--quiet")


@posix
def test_nor_the_file_of_another_output(capsys, inputs):
    os.symlink("a.csv", "a.png")
    code, out, err = run(capsys, "orbit", "--gain", 0.1, "--csv", "a.csv", "--plot", "a.png")
    assert (code, out) == (2, "")
    assert err == "casahunt orbit: plot = 'a.png': must be another file than that of csv\n"
    assert not Path("a.csv").exists()


@posix
def test_nor_what_the_shell_leads_there(tmp_path):
    """What `>>` adds to; what `>` has emptied before the program begins nobody can save."""
    (tmp_path / "servo.toml").write_text(dump(Servo()))
    where = {"cwd": tmp_path, "env": {**os.environ, "PYTHONPATH": str(ROOT)}, "capture_output": True, "text": True}
    command = f"{sys.executable} -m casahunt orbit servo.toml --gain 0.1 --quiet >> servo.toml"
    done = subprocess.run(["sh", "-c", command], **where)
    said = "standard output: must be another file than the servo file 'servo.toml', which is read"
    assert (done.returncode, done.stderr) == (2, f"casahunt orbit: {said}\n")
    assert (tmp_path / "servo.toml").read_text() == dump(Servo())


def test_every_file_of_every_command_is_known():
    """To the guard: no argument that names a file is left out."""
    parser = cli.build_parser()
    (commands,) = (action for action in parser._actions if isinstance(action, argparse._SubParsersAction))
    actions = [action for command in commands.choices.values() for action in command._actions]
    named = {a.dest for a in actions if isinstance(a.metavar, str) and "." in a.metavar}
    assert named == {*output_paths.READ, *output_paths.WRITTEN}
    for command in commands.choices.values():
        assert ("out" in {a.dest for a in command._actions}) == (command.get_default("results") is not None)


# What casahunt has not written -------------------------------------------------------------------------------

RUNS = {
    "diagram": ["diagram", "--model", "switch", "--from", 0.6],
    "tune": ["tune"],
}
THEIRS = {
    "diagram.png": b"\x89PNG\r\n\x1a\n...tEXtSoftware\x00Matplotlib version3.11.2, https://matplotlib.org/",
    "switch.csv": b"gain,amplitude\n0.1,0.2\n",
    "switch.npz": b"PK\x03\x04 another program's arrays",
    "tune.html": b"<title>my notes</title>",
    "tune.json": b"{}\n",
    "phase_portrait.png": b"",
}


@pytest.mark.parametrize("name", THEIRS)
def test_what_casahunt_has_not_written_is_never_replaced(capsys, tmp_path, monkeypatch, name):
    """Nor moved; asked before anything is computed, whatever its permissions."""
    runs = [words for command, words in RUNS.items() if (command == "tune") == name.startswith("tune")]
    for module, what in ((command_diagram, "diagram"), (command_tune, "tune")):
        monkeypatch.setattr(module, what, lambda *a, **k: pytest.fail("computed"))
    (tmp_path / name).write_bytes(THEIRS[name])
    for mode in (0o644, 0o444):
        (tmp_path / name).chmod(mode)
        for words in runs:
            code, out, err = run(capsys, *words, "--out", tmp_path, "--quiet")
            assert (code, out) == (2, "") and err.count("\n") == 1
            assert f"the folder holds a {name} that this version of casahunt did not write; move it away" in err
            assert contents(tmp_path) == {name: THEIRS[name]}


@posix
def test_what_is_no_file_is_not_opened(capsys, tmp_path):
    """A pipe would never end."""
    os.mkfifo(tmp_path / "diagram.png")
    code, _, err = run(capsys, *RUNS["diagram"], "--out", tmp_path)
    assert code == 2 and "did not write" in err


@pytest.mark.parametrize("name", ["diagram.png", "switch.npz", "tune.json"])
def test_what_is_protected_stays(capsys, tmp_path, name):
    """Also casahunt's own, and from who may write everything."""
    old = results("switch")[name]
    (tmp_path / name).write_bytes(old)
    (tmp_path / name).chmod(0o444)
    words = RUNS["tune" if name.startswith("tune") else "diagram"]
    code, out, err = run(capsys, *words, "--out", tmp_path, "--quiet")
    assert (code, out) == (2, "") and f"{name} in the folder is protected from being written" in err
    with pytest.raises(InputError, match="Permission denied"):
        files.set_aside([tmp_path / name])
    with pytest.raises(InputError, match="Permission denied"), files.whole_text(tmp_path / name):
        pass
    assert contents(tmp_path) == {name: old}


def test_what_comes_while_it_computes_stays(capsys, tmp_path, monkeypatch):
    """Before the first point, and between the last one and the pictures."""
    real = command_diagram.diagram

    def late(name, *args, report, **kwargs):
        if name == "switch.csv":
            (tmp_path / name).write_bytes(b"mine")
        branch = real(*args, report=report, **kwargs)
        if name == "time_traces.png":
            (tmp_path / name).write_bytes(b"mine")
        return branch

    for name in ("switch.csv", "time_traces.png"):
        for path in tmp_path.iterdir():
            path.unlink()
        monkeypatch.setattr(command_diagram, "diagram", partial(late, name))
        code, _, err = run(capsys, *RUNS["diagram"], "--out", tmp_path, "--quiet")
        assert code == 2 and f"holds a {name} that this version of casahunt did not write" in err
        assert (tmp_path / name).read_bytes() == b"mine"


def test_what_comes_while_it_tunes_stays(capsys, tmp_path, monkeypatch):
    cheap_tuning(monkeypatch)
    monkeypatch.setattr(
        command_tune, "evidence_page", lambda *_: (tmp_path / "tune.html").write_text("mine") and "<html>"
    )
    code, _, err = run(capsys, "tune", "--out", tmp_path, "--quiet", "--json")
    assert code == 2 and "holds a tune.html that this version of casahunt did not write" in err
    assert contents(tmp_path) == {"tune.html": b"mine"}


def test_what_it_has_written_is_known_again(capsys, tmp_path, monkeypatch):
    """Every file of a folder, so that the next run replaces it (test_diagram.py runs twice)."""
    cheap_tuning(monkeypatch)
    (tmp_path / "notes.txt").write_text("mine")
    for words in (RUNS["diagram"], RUNS["tune"], RUNS["tune"]):
        assert run(capsys, *words, "--out", tmp_path, "--quiet", "--json")[0] == 0
    output_paths.keep_others(tmp_path, {name: old.removesuffix(b"\nold\n") for name, old in results("switch").items()})
    assert set(contents(tmp_path)) == {*results("switch"), "notes.txt"}


def test_pictures_say_who_drew_them(tmp_path):
    pictures.save(pictures.time_traces([find_orbit(Servo(), "switch", 0.1)]), tmp_path / "a.png")
    assert command_diagram.PICTURE_SIGN in (tmp_path / "a.png").read_bytes()[:200]


@pytest.mark.parametrize(
    ("words", "code"),
    [
        (["tune", "--bounds", "x=1,2"], 2),
        (["tune", "--bounds", "gain=2,1"], 2),
        (["tune", "--set", "controller.lead_time=0"], 2),
        (["tune", "--margin", "-1"], 2),
        (["diagram", "--from", "0.8", "--model", "switch"], 1),
        (["diagram", "--tol", "1"], 2),
    ],
    ids=lambda value: " ".join(value) if isinstance(value, list) else "",
)
def test_a_run_that_writes_nothing_touches_nothing(capsys, tmp_path, words, code):
    keep = tmp_path / "keep"
    keep.mkdir()
    for name, content in {**results("switch", "lugre"), "notes.txt": b"mine"}.items():
        (keep / name).write_bytes(content)
    before = {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in keep.iterdir()}
    assert run(capsys, *words, "--out", keep, "--quiet")[:2] == (code, "")
    assert {path.name: (path.read_bytes(), path.stat().st_mtime_ns) for path in keep.iterdir()} == before


# One run at a time -------------------------------------------------------------------------------------------


@pytest.fixture(params=["flock", "lock file"])
def lock(request, monkeypatch):
    """Both ways to lock a folder."""
    if request.param == "lock file":
        monkeypatch.setattr(files, "_flock", lambda *_: False)
    return request.param


@pytest.mark.parametrize("words", [["tune"], ["diagram", "--model", "switch", "--from", 0.6]], ids=lambda w: w[0])
def test_a_second_run_is_refused(capsys, tmp_path, monkeypatch, words, lock):
    cheap_tuning(monkeypatch)
    out = tmp_path / "out"
    with folder(str(out), {}):
        (out / "switch.csv").write_text("of the first run")
        before = contents(out)
        code, text, err = run(capsys, *words, "--out", out, "--quiet")
        assert (code, text) == (2, "") and err.count("\n") == 1
        assert f"out = {str(out)!r}: another run is writing into this folder" in err
        assert contents(out) == before
    assert set(contents(out)) == {"switch.csv"}


@pytest.mark.parametrize("trouble", [None, KeyboardInterrupt(), ZeroDivisionError()], ids=repr)
def test_the_folder_is_free_again(tmp_path, trouble, lock):
    out = tmp_path / "new" / "out"
    for _ in range(2):
        try:
            with folder(str(out), {}):
                assert out.is_dir()
                if trouble:
                    raise trouble
        except type(trouble) as error:
            assert error is trouble
        assert not list(tmp_path.iterdir())  # made, not used, unmade
