"""The command fold-curve: record, table, picture, progress, and what it refuses."""

from __future__ import annotations

import csv
import json

import pytest

from casahunt import cli


def test_command(capsys, tmp_path):
    table, picture = tmp_path / "curve.csv", tmp_path / "curve.png"
    words = ["fold-curve", "--model", "switch", "--vary", "friction.static", "--from", "0.5", "--to", "0.56"]
    code = cli.main([*words, "--points", "4", "--json", "--quiet", "--csv", str(table), "--plot", str(picture)])
    out, err = capsys.readouterr()
    assert (code, err) == (0, "")
    (record,) = json.loads(out)["curves"]
    assert {"model", "vary", "points", "special", "ended", "status", "wall_s"} <= set(record)
    assert record["special"] == []
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [float(row["gain"]) for row in rows] == [point["gain"] for point in record["points"]]
    assert picture.read_bytes().startswith(b"\x89PNG")
    assert cli.main([*words, "--points", "3", "--details"]) == 0
    out, err = capsys.readouterr()
    assert "friction.static reached" in out
    assert "K = " in err


@pytest.mark.parametrize(
    "words",
    [
        ["--vary", "friction.static", "--from", "0.3", "--to", "0.5"],
        ["--vary", "friction.static", "--from", "x", "--to", "0.5"],
        ["--vary", "friction.static", "--from", "0.5"],
        ["--vary", "friction.static", "--from", "0.5", "--to", "0.6", "--points", "2.5"],
        ["--vary", "friction.static", "--from", "0.5", "--to", "0.6", "--csv", "a.txt"],
        ["--vary", "friction.static", "--from", "0.5", "--to", "0.6", "--model", "switch", "--model", "switch"],
    ],
)
def test_command_refuses(words, capsys):
    assert cli.main(["fold-curve", *words]) == 2
    assert capsys.readouterr().out == ""
