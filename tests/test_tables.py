"""Every CSV file that a command writes, read back with csv, float() and numpy, beside the JSON of the same run."""

from __future__ import annotations

import csv
import io
import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

import casahunt
from casahunt import cli, load_branch
from casahunt.export import cell, table

WORDS = {"model", "parameter", "status", "special", "mode"}
TRUTHS = {"stable"}


def run_json(capsys, *words: object):
    capsys.readouterr()
    code = cli.main([*map(str, words), "--json", "--quiet"])
    out, err = capsys.readouterr()
    assert code == 0, err
    return json.loads(out)


def columns_of(path: Path) -> dict[str, list]:
    """Every column: words as they are, everything else through float(), and the same from numpy."""
    with path.open(newline="", encoding="ascii") as stream:
        header, *rows = csv.reader(stream)
    assert rows and all(len(row) == len(header) for row in rows)
    cells = dict(zip(header, zip(*rows, strict=True), strict=True))
    assert all(value in ("True", "False", "") for name in TRUTHS & set(header) for value in cells[name])
    numbers = [name for name in header if name not in WORDS | TRUTHS]
    found = {name: [float(value) for value in cells[name]] for name in numbers}
    read = np.atleast_1d(np.genfromtxt(path, delimiter=",", names=True, usecols=[header.index(n) for n in numbers]))
    for name, field in zip(numbers, read.dtype.names, strict=True):
        assert np.array_equal(read[field], found[name], equal_nan=True), name
    return found | {name: list(cells[name]) for name in header if name not in numbers}


def test_diagram(capsys, tmp_path):
    run_json(capsys, "diagram", "--model", "switch", "--from", 0.62, "--out", tmp_path)
    found, branch = columns_of(tmp_path / "switch.csv"), load_branch(tmp_path / "switch.npz")
    plain = [i for i, special in enumerate(found["special"]) if not special]
    assert [found["gain"][i] for i in plain] == branch.gains.tolist()
    assert [found["period_s"][i] for i in plain] == branch.periods.tolist()
    assert [found["half_multiplier"][i] for i in plain] == [orbit.half_multiplier for orbit in branch.orbits]
    assert [found["error_estimate"][i] for i in plain] == [orbit.error_estimate for orbit in branch.orbits]


def test_fold_curve(capsys, tmp_path):
    path = tmp_path / "curve.csv"
    words = ("--model", "switch", "--vary", "friction.static", "--from", 0.52, "--to", 0.54, "--points", 2)
    (curve,) = run_json(capsys, "fold-curve", *words, "--csv", path)["curves"]
    found = columns_of(path)
    for column, key in (
        ("value", "value"), ("gain", "gain"), ("amplitude_rad", "amplitude"), ("period_s", "period"),
        ("slope", "slope"), ("elasticity", "elasticity"), ("error_estimate", "error_estimate"),
    ):  # fmt: skip
        assert found[column] == [point[key] for point in curve["points"]]
    assert set(found["parameter"]) == {"friction.static"}


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_simulate(capsys, tmp_path, model):
    path = tmp_path / "motion.csv"
    said = run_json(capsys, "simulate", "--model", model, "--gain", 0.1, "--time", 3, "--csv", path, "--step", 0.5)
    found = columns_of(path)
    assert found["time_s"] == [0.5 * i for i in range(7)]
    for name in ("position", "velocity", "integral", "bristle"):
        column = [values for key, values in found.items() if key.startswith(name)]
        assert [values[-1] for values in column] == ([] if said[name] is None else [said[name]])


VALUES = [
    0.1, -0.0, 5e-324, 1.7976931348623157e308, math.nan, math.inf, 3, True, np.float64(1 / 3), np.float32(0.1),
    np.int64(-7), np.bool_(True), np.str_("a"), 'a "b", c\nd', "", None,
]  # fmt: skip


def test_values_come_back():
    stream = io.StringIO(newline="")
    table(stream, ["value", "next"])([value, 1.0] for value in VALUES)
    _, *rows = csv.reader(io.StringIO(stream.getvalue(), newline=""))
    for value, (text, other) in zip(VALUES, rows, strict=True):
        assert other == "1.0"
        if value is None or isinstance(value, str):
            assert text == (value or "")
        elif isinstance(value, bool | np.bool_):
            assert text == str(bool(value))
        else:
            assert np.array_equal(float(text), float(value), equal_nan=True) and "float" not in text


def test_mistakes_are_not_written():
    write = table(io.StringIO(), ["a", "b"])
    with pytest.raises(ValueError, match="a row of 1 values in a table of 2 columns"):
        write([[1.0]])
    for value in (1j, [1.0], np.zeros(1), object()):
        with pytest.raises(TypeError, match="must be a number, a truth value or text"):
            cell(value)


def test_there_is_no_other_writer():
    """A module with a CSV writer of its own would not be read back here."""
    package = Path(casahunt.__file__).parent
    other = re.compile(r"csv\.(Dict)?[wW]riter|savetxt\(")
    others = [path.name for path in package.rglob("*.py") if other.search(path.read_text("utf-8"))]
    assert others == ["export.py"]
