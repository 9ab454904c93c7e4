"""TAB at a real bash offers what can stand there; a program that is not asked imports nothing for it."""

from __future__ import annotations

import io
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from casahunt import cli
from casahunt.servo.servo import KEYS
from casahunt.views.commands import completion

ROOT = Path(__file__).parents[2]
BASH = shutil.which("bash")
ASK = """
eval "$(python -m argcomplete.scripts.register_python_argcomplete casahunt)"
ask() {
    COMP_LINE="$1"; COMP_POINT=${#1}; COMP_TYPE=9; COMPREPLY=()
    _python_argcomplete casahunt
    echo "${COMPREPLY[*]}"
}
"""
OFFERED = [
    ("casahunt examples guides example_fo", "example_fold|example_fold_map"),
    ("casahunt fold", "fold|fold-curve|fold-map"),
    ("casahunt orbit --set friction.sti", "friction.stiffness=|friction.stick_band=|friction.stick_rate="),
    ("casahunt fold-curve --vary servo.", "servo.inertia|servo.motor_gain"),
    ("casahunt tune --free l", "lead_time "),
    ("casahunt orbit problems/table1.", "problems/table1.toml "),
    ("casahunt simulate --csv problems/table1.", ""),
    ("casahunt orbit --model sw", "switch "),
    ("casahunt glossary half", "half\\ multiplier "),
]


@pytest.mark.skipif(BASH is None or os.name != "posix", reason="no bash")
def test_bash_is_told_what_can_stand_there(tmp_path):
    pytest.importorskip("argcomplete")
    program = tmp_path / "casahunt"
    program.write_text(f"#!{sys.executable}\nimport sys\nfrom casahunt.cli import main\nsys.exit(main())\n")
    program.chmod(0o755)
    path = os.pathsep.join([str(tmp_path), str(Path(sys.executable).parent), os.environ["PATH"]])
    asked = OFFERED[1:2]
    script = ASK + "".join(f"ask '{line}'\n" for line, _ in asked)
    run = subprocess.run(
        [BASH, "--norc", "-c", script], cwd=ROOT, text=True, capture_output=True, timeout=60,
        env={**os.environ, "PATH": path, "PYTHONPATH": str(ROOT)},
    )  # fmt: skip
    assert run.stderr == ""
    said = [sorted(line.split(" ")) for line in run.stdout.split("\n")[:-1]]
    assert said == [sorted(words.split("|")) for _, words in asked]


class Answered(Exception):
    """What the end of the process stands for here."""


@pytest.mark.parametrize(("line", "words"), OFFERED)
def test_what_can_stand_there(monkeypatch, line, words):
    argcomplete = pytest.importorskip("argcomplete")
    asked = {"_ARGCOMPLETE": "1", "COMP_LINE": line, "COMP_POINT": str(len(line)), "COMP_TYPE": "9", "IFS": "\v"}
    for name, value in asked.items():
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("_ARGCOMPLETE_IFS", "\v")
    monkeypatch.chdir(ROOT)

    def leave(code):
        raise Answered

    stream = io.StringIO()
    autocomplete = argcomplete.autocomplete
    monkeypatch.setattr(type(autocomplete), "_init_debug_stream", lambda self: None)  # handle 9, for a real shell
    monkeypatch.setattr(
        argcomplete, "autocomplete", lambda *a, **k: autocomplete(*a, **k, exit_method=leave, output_stream=stream)
    )
    with pytest.raises(Answered):
        completion.answer(cli.build_parser())
    assert sorted(filter(None, stream.getvalue().split("\v"))) == sorted(filter(None, words.split("|")))


def test_every_argument_of_words_or_files_is_completed():
    """Of all commands; what takes a number offers no names of files."""
    pytest.importorskip("argcomplete")
    parser = cli.build_parser()
    completion.completers(parser)
    commands = next(action for action in parser._actions if action.dest == "command").choices
    offers = {}
    for name, command in commands.items():
        for action in command._actions:
            if action.nargs != 0:
                offers[name, action.dest] = getattr(action, "completer", None)
    assert not [place for place, completer in offers.items() if completer is None]
    assert offers["orbit", "set"]("friction.static") == ["friction.static="]
    assert len(offers["simulate", "set"]("")) == len(KEYS)
    assert type(offers["simulate", "time"]).__name__ == "SuppressCompleter"
    assert {"file", "records", "servo", "uncertainty", "csv", "plot", "save"} == set(completion.FILES)


def test_nothing_is_imported_for_it_unasked():
    code = "import sys\nfrom casahunt.cli import main\nmain(['glossary'])\nassert 'argcomplete' not in sys.modules"
    environment = {name: value for name, value in os.environ.items() if name != "_ARGCOMPLETE"}
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True, capture_output=True, env=environment)


def test_without_argcomplete_the_shell_gets_no_answer(monkeypatch):
    monkeypatch.setitem(sys.modules, "argcomplete", None)
    assert completion.answer(cli.build_parser()) is None
