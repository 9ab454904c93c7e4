"""What the README shows works as it is written."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path

import pytest

from casahunt.cli import main
from casahunt.servo import KEYS

ROOT = Path(__file__).parents[1]
TEXT = (ROOT / "README.md").read_text()


def blocks(language: str) -> list[str]:
    return re.findall(rf"```{language}\n(.*?)```", TEXT, flags=re.DOTALL)


def test_python_example(capsys):
    """Runs, and prints the numbers that its comments promise."""
    (code,) = blocks("python")
    scope: dict = {}
    exec(compile(code, "README.md", "exec"), scope)  # the code is our own
    assert scope["orbit"].amplitude == pytest.approx(0.0500469727, rel=1e-8)
    assert scope["orbit"].period == pytest.approx(10.2814152, rel=1e-8)
    assert scope["orbit"].half_multiplier == pytest.approx(-0.1504772, rel=1e-6)
    assert scope["fold"].gain == pytest.approx(0.64733908365, rel=1e-9)
    assert capsys.readouterr().out


def test_servo_file_example():
    (text,) = blocks("toml")
    tree = tomllib.loads(text)
    assert {f"{section}.{key}" for section, table in tree.items() for key in table} <= set(KEYS)


COMMANDS = [
    line.split("#")[0].strip() for block in blocks("sh") for line in block.splitlines() if line.startswith("casahunt ")
]


@pytest.mark.slow
@pytest.mark.parametrize("command", COMMANDS)
def test_commands(command, tmp_path, monkeypatch, capsys):
    arguments = shlex.split(command)[1:]
    arguments = [str(ROOT / a) if a.endswith(".toml") else a for a in arguments]
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 0
    assert capsys.readouterr().out


def test_there_are_commands():
    assert len(COMMANDS) >= 5


def test_pictures_exist():
    for path in re.findall(r"!\[[^]]*\]\(([^)]+)\)", TEXT):
        assert (ROOT / path).stat().st_size > 10_000
