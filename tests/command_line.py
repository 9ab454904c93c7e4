"""A command line, and what it prints and writes, for the tests of the commands."""

from __future__ import annotations

import csv
import json
import re
import subprocess
import sys
from pathlib import Path

from casahunt import cli
from casahunt.continuation.branch import COLUMNS

ROOT = Path(__file__).parents[1]


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
    assert tuple(header) == ("gain", "amplitude_rad", "period_s", *COLUMNS)
    assert all(len(row) == len(header) for row in rows)
    return [dict(zip(header, row, strict=True)) for row in rows]


def is_picture(path: Path) -> bool:
    return path.read_bytes().startswith(b"\x89PNG") and path.stat().st_size > 10_000  # an empty page takes less


def process(*words: object, **kwargs) -> subprocess.CompletedProcess:
    command = [sys.executable, "-m", "casahunt", *(str(word) for word in words)]
    return subprocess.run(command, cwd=ROOT, text=True, **{"capture_output": True, **kwargs})
