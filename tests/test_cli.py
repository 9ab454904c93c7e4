"""The command line: wrong input is exit code 2, one sentence and nothing written; no such orbit is exit code 1; as a
process: output that cannot be written, interrupts, crashes.
"""

from __future__ import annotations

import contextlib
import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from command_line import PROGRESS, ROOT, contents, one_json, process, rows_of, run
from servo_files import ROTARY, dump

from casahunt import Branch, cli
from casahunt.servo.saved import load_branch
from casahunt.views.commands.output import MEANINGS
from problems import taylor

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
    (["--set", "friction.breakaway=1"], ["did you mean 'friction.static'? (known: friction.static, friction.coulomb"]),
    (["--set", "static=0.5"], ["unknown key 'static'", "did you mean 'friction.static'?"]),
    (["--set", "gain=0.5"], ["unknown key 'gain'"]),
    (["--set", "friction.static"], ["--set 'friction.static': must have the form section.key=value"]),
    (["--set", "friction.static=high"], ["friction.static = 'high'", FINITE]),
    (["--set", "friction.static=0,55"], ["friction.static = '0,55'", f"{FINITE}; decimals take a point, 0.55"]),
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
    (["drop.toml"], ["friction.static = 0.1: must be at least 0.44", "is not in the file, and taken from Table 1"]),
    (["zero.toml", "drop.toml"], ["'drop.toml': must be left out, one servo file is enough"]),
    (["--tool", "1e-6"], ["unknown option '--tool'", "did you mean '--tol'?"]),
    (["--sett=friction.static=1"], ["unknown option '--sett'", "did you mean '--set'?"]),
    (["--qiet"], ["unknown option '--qiet'", "did you mean '--quiet'?"]),
    (["--ki", "3"], ["unknown option '--ki': a number of the servo file is given by --set controller.ki=VALUE"]),
    (["--motor-gain=3"], ["unknown option '--motor-gain'", "--set servo.motor_gain=VALUE"]),
    (["--xyzzy"], ["unknown option '--xyzzy' (known: --", "--tol, "]),
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
    code, out, err = run(capsys, "orbit", *words, "--plot", "a.png", "--save", "a.npz", "--json", "--details")
    told = json.loads(out)
    assert code == 1 and told["status"] in (None, "not_found") and f"{told['refused']} ({told['evidence']})" in err
    assert err.startswith("casahunt orbit: no hunting limit cycle") and err.count("\n") == 1
    for part in parts:
        assert part in err
    assert not contents(tmp_path)


def test_no_fold_without_hunting(capsys):
    code, out, err = run(capsys, "fold", *NO_DROP, "--json", "--details")
    assert code == 1 and "static equals Coulomb friction" in json.loads(out)["refused"]
    assert run(capsys, "fold", *NO_DROP, "--quiet")[1] == ""
    assert err.startswith("casahunt fold: no hunting limit cycle") and "scanned" in err and err.count("\n") == 1


def test_words_of_an_error_are_explained_below_it_once(capsys):
    cases = (["--gain", "0.8"], "fold: ", "bristle"), (["--gain", "1", *NO_DROP], "stick position: ", "fold: ")
    for words, told, untold in cases:
        assert run(capsys, "orbit", *words)[2].count("\n") == 1  # in plain words
        words = [*words, "--details"]
        code, out, err = run(capsys, "orbit", *words)
        complaint, _, explained = err.partition(MEANINGS)
        assert (code, out, complaint.count("\n")) == (1, "", 1)
        assert explained.count(f"  {told}") == 1 and untold not in explained
        assert max(map(len, explained.splitlines())) <= 80
        assert run(capsys, "orbit", *words, "--quiet") == (code, out, complaint)


@pytest.mark.parametrize(
    ("words", "models"), [
        (["--from", "0.8", "--model", "switch"], ["switch"]),
        pytest.param(NO_DROP, ["switch", "lugre"], marks=pytest.mark.slow),
    ],
)
def test_no_diagram_without_hunting(capsys, tmp_path, words, models):
    """One sentence per model, and no folder where there is nothing to put into it."""
    command = ["diagram", *words, "--out", tmp_path / "new" / "out", "--details"]
    code, text, err = run(capsys, *command)
    assert (code, text) == (1, "")
    complaints, _, explained = err.partition(MEANINGS)
    assert "stick position: " in explained
    for model, line in zip(models, complaints.splitlines(), strict=True):
        assert line.startswith(f"casahunt diagram: no hunting limit cycle of the {model} servo") and "scanned" in line
    assert not contents(tmp_path)
    code, text, again = run(capsys, *command, "--json", "--quiet")
    found = one_json(text)
    assert (code, again, found["out"], found["branches"]) == (1, complaints, None, [])
    assert [f"casahunt diagram: {failure}" for failure in found["failures"]] == complaints.splitlines()
    assert not contents(tmp_path)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["orbit"], "gain: must be given, for example --gain 0.1; 1 takes kp, ki and kd of a servo file"),
        (["loop"], "gain: must be given, for example --gain 0.1 --gain 0.4"),
        (["uncertainty"], "uncertainty: must be given, for example --uncertainty friction.toml"),
        (["simulate", "--gain", "0.1", "--plot", "a.txt"], "the name must end in .png or .pdf or .svg"),
        (["diagram", "--model", "lugre", "--model", "lugre"], "each model can be asked for once"),
    ],
)
def test_what_must_be_given_is_asked_for(capsys, words, said):
    code, out, err = run(capsys, *words)
    assert code == 2 and out == "" and said in err


def test_a_file_with_kp_ki_kd_needs_no_gain(capsys, tmp_path):
    """They are final: the amplitude is that of gain 1, by the Taylor engine; another gain multiplies them as ever."""
    path = tmp_path / "pid.toml"
    path.write_text(dump(ROTARY))
    amplitude, _ = taylor.switch_cycle(ROTARY, 1.0, 0.04)
    for words in ([], ["--gain", "1"]):
        code, out, _ = run(capsys, "orbit", str(path), "--json", "--quiet", *words)
        assert code == 0 and json.loads(out)["amplitude"] == pytest.approx(amplitude, rel=1e-7)
    assert json.loads(run(capsys, "loop", str(path), "--json", "--quiet")[1])["loops"][0]["gain"] == 1.0


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


@pytest.mark.skipif(os.name != "posix", reason="pipes")
@pytest.mark.parametrize(
    ("words", "said"), [(["glossary"], ""), (["orbit", "--gain", "5", "--json"], "no hunting limit cycle")]
)
def test_a_reader_that_has_gone_is_no_fault(words, said):
    """As `casahunt glossary | head -1`: quiet, with the exit code of SIGPIPE; also where what is found is a refusal."""
    reader, writer = os.pipe()
    os.close(reader)
    done = process(*words, capture_output=False, stdout=writer, stderr=subprocess.PIPE)
    os.close(writer)
    assert done.returncode == 141 and said in done.stderr and done.stderr.count("\n") == bool(said)


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
    assert 3 <= len(branch.orbits) == len([row for row in rows if not row["special"]])
    assert [float(row["gain"]) for row in rows][: len(branch.orbits)] == list(branch.gains)
    assert set(contents(out)) == {"lugre.csv", "lugre.npz"}


@pytest.mark.slow  # test_diagram_files.py kills a Switch diagram
@pytest.mark.skipif(os.name != "posix", reason="signals")
def test_crash(tmp_path):
    out = tmp_path / "out"
    with diagram_under_way(out) as running:
        running.kill()
        running.wait(timeout=60)
    rows = rows_of(out / "lugre.csv")
    assert len(rows) >= 3 and all(row["status"] == "converged" for row in rows)
    assert {name for name in contents(out) if not name.endswith(".partial")} == {"lugre.csv"}
