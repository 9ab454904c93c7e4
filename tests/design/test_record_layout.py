"""Records as drives and oscilloscopes write them: preambles, decimal commas, several channels, asked columns."""

from __future__ import annotations

import json

import numpy as np
import pytest

from casahunt import InputError, cli
from casahunt.design.record.file import read_record

T = np.arange(0.0, 12.0, 0.01)
Y = 0.05 * np.sin(2 * np.pi * T / 2)
SCOPE = """Model,DSO-X 3024
Date,2024-03-12,14:22
Sample Interval,0.01,s
Channel,CH1,CH2

"""
FILES = {
    "german drive": (
        "Antrieb 7\nAufzeichnung vom 12.03.2024\n\nZeit [s];Drehzahl [rpm];Istlage [rad]\n",
        lambda t, y: f"{t:.4f};12,5;{y:.9f}".replace(".", ","),
        {},
    ),
    "german scope": (
        "Gerät;MSO 5\n\nZeit (ms);Sollposition (rad);Istposition (rad)\n",
        lambda t, y: f"{1000 * t:.2f};0,3;{y:.9f}".replace(".", ","),
        {},
    ),
    "scope": (SCOPE + "second,Volt,Volt\n", lambda t, y: f"{t:.4f},{3.5},{y:.9f}",
              {"time_column": "1", "position_column": "3", "position_unit": "rad"}),
    "blanks and decimal commas": ("", lambda t, y: f"{t:.4f} {y:.9f}".replace(".", ","), {}),
    "tabs": ("logger v2\ntime\tposition\ns\trad\n", lambda t, y: f"{t:.4f}\t{y:.9f}", {}),
    "status behind": ("time_s;position_rad;state\n", lambda t, y: f"{t:.4f};{y:.9f};ok".replace(".", ","), {}),
    "skipped": ("1,1\n2,2\n3,3\ntime_s,position_rad\n", lambda t, y: f"{t:.4f},{y:.9f}", {"skip": 3}),
}  # fmt: skip


@pytest.mark.parametrize("kind", FILES)
def test_samples_are_found(tmp_path, kind):
    head, line, asked = FILES[kind]
    path = tmp_path / "record.csv"
    path.write_text(head + "\n".join(line(t, y) for t, y in zip(T, Y, strict=True)) + "\n", encoding="cp1252")
    record = read_record(path, **asked)
    assert record.times == pytest.approx(T, abs=1e-9) and record.position == pytest.approx(Y, abs=1e-8)
    said = record.reading.sentence
    assert ("commas taken as decimal signs" in said) == (kind in (*GERMAN, "status behind", FIRST))
    assert ("of preamble" in said) == (kind in (*GERMAN, "scope", "tabs", "skipped"))


GERMAN = ("german drive", "german scope")
FIRST = "blanks and decimal commas"


def test_what_was_left_out_is_counted(tmp_path):
    path = tmp_path / "record.csv"
    path.write_text(FILES["german drive"][0] + "\n".join(FILES["german drive"][1](t, y) for t, y in zip(T, Y)))  # noqa: B905
    assert "left out: 2 lines of preamble" in read_record(path, position_column="istlage").reading.sentence


@pytest.mark.parametrize(
    ("asked", "says"),
    [
        ({"position_column": "Lage"}, "position-column = 'Lage': .* has no such column .columns: 'Zeit .s.', 'Dreh"),
        ({"position_column": "4"}, "position-column = '4'"),
        ({}, "has no column 'position'"),
    ],
)
def test_a_column_that_is_not_there(tmp_path, asked, says):
    head, line, _ = FILES["german drive"]
    path = tmp_path / "record.csv"
    path.write_text(head.replace("Istlage", "Kanal 2") + "\n".join(line(t, y) for t, y in zip(T, Y, strict=True)))
    with pytest.raises(InputError, match=says):
        read_record(path, **asked)


def test_the_command_takes_them(capsys, tmp_path):
    head, line, _ = FILES["german drive"]
    path = tmp_path / "record.csv"
    path.write_text(head + "\n".join(line(t, y) for t, y in zip(T, Y, strict=True)))
    assert cli.main(["record", str(path), "--position-column", "Istlage", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["period"] == pytest.approx(2.0, rel=1e-3)
    assert cli.main(["record", str(path), "--position-column", "3", "--quiet"]) == 0
    assert "left out: 2 lines of preamble" in " ".join(capsys.readouterr().out.split())
