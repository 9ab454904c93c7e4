"""The command remedies: its table, its object, its files, and what it refuses."""

from __future__ import annotations

import csv
import math
import re
from types import SimpleNamespace

import numpy as np
import pytest
from command_line import is_picture, one_json, run
from matplotlib import image

from casahunt.design.remedies.cures import Cure
from casahunt.views.commands.output import LINE_WIDTH, MEANINGS
from casahunt.views.commands.remedies import (
    NOT_FOR_THE_WORST,
    Table,
    _row,
    _why_not,
    advice_of,
    none_within,
    table_details,
)

GAIN = ("remedies", "--gain", 0.04)
BAND, LEAK = 0.0433457242337, 0.246844841
"""Folds by independent event maps [rad], [1/s]."""
KEYS = {"name", "unit", "kind", "size", "size_error", "recommended", "rest_error", "peak_torque", "peak_voltage",
        "settling", "worst_size", "why"}  # fmt: skip


def test_the_table_is_read_at_a_glance(capsys):
    code, out, err = run(capsys, *GAIN, "--only", "dead band,gain", "--only", "feedforward", "--quiet")
    assert code == 0
    table, _, explained = out.partition(MEANINGS)
    lines = table.splitlines()
    assert max(map(len, out.splitlines())) <= LINE_WIDTH
    assert lines[0] == "switch servo at gain 0.04 V/rad hunts with 0.05005 rad and 10.28 s"
    assert " ".join(lines[1:3]).split()[:5] == ["cheapest", "remedy:", "dead", "band,", "0.04768"]
    band = next(line for line in lines if line.startswith("  dead band"))
    gain = next(line for line in lines if line.startswith("  gain"))
    assert band.split()[2:6] == ["from", "0.04335", "rad", "0.04768"]
    assert gain.split()[1:4] == ["from", "0.6473", "V/rad"]
    assert gain.split()[5] == "0" and float(gain.split()[6]) == pytest.approx(2 * 16 * 1.1 * 0.647339, rel=1e-3)  # kp
    said = " ".join(table.split())
    assert "feedforward hunting goes on up to 1, the last size looked at: it makes the friction of the slipping" in said
    assert "what the columns mean, and every digit: --details" in said and "10 % more of the remedy" not in said
    assert "dead band: a band of small errors" in explained and explained.count("feedforward: ") == 1
    said = " ".join(run(capsys, *GAIN, "--only", "gain", "--quiet", "--details")[1].split())
    assert "may stand still, with the size to choose" in said
    assert "10 % more of the remedy" in said and "step of 1 rad" in said
    assert "the error stays within 2 % of the way" in said and "in place of the present ones: gain: K" in said


@pytest.mark.slow
def test_where_less_is_more(capsys):
    out = run(capsys, *GAIN, "--only", "freeze", "--quiet")[1]
    row = next(line for line in out.splitlines() if line.startswith("  freeze"))
    assert row.split()[1:5] == ["up", "to", "4.641", "s"] and float(row.split()[5]) < 4.641


def test_the_object_and_the_table(capsys, tmp_path):
    path = tmp_path / "rows.csv"
    code, out, err = run(capsys, *GAIN, "--only", "dead band,leak,error dead band", "--json", "--quiet", "--csv", path)
    assert (code, err) == (0, "")
    found = one_json(out)
    assert {"servo", "model", "gain", "amplitude", "period", "best"} - {"servo"} <= set(found)
    rows = {row["name"]: row for row in found["remedies"]}
    assert set(rows) == {"dead band", "leak", "error dead band"} and all(set(row) >= KEYS for row in rows.values())
    for name, truth, unit in (("dead band", BAND, "rad"), ("leak", LEAK, "1/s")):
        row = rows[name]
        assert row["size"] == pytest.approx(truth, rel=1e-6) and row["unit"] == unit and row["kind"] == "fold"
        assert abs(row["size"] - truth) <= 3 * row["size_error"] + 2e-9 * truth
        assert row["rest_error"] > 0 and row["peak_torque"] == pytest.approx(16 * row["peak_voltage"])
    assert rows["error dead band"]["size"] is None and "the integral's content acts" in rows["error dead band"]["why"]
    cells = list(csv.DictReader(path.read_text(encoding="ascii").splitlines()))
    assert [row["remedy"] for row in cells] == [row["name"] for row in found["remedies"]]
    for row in cells:
        other = rows[row["remedy"]]
        for column, key in (("size", "size"), ("rest_error_rad", "rest_error"), ("peak_torque_Nm", "peak_torque")):
            value = float(row[column])
            assert value == other[key] or math.isnan(value) and other[key] is None


@pytest.mark.slow
def test_a_picture(capsys, tmp_path):
    path = tmp_path / "sizes.png"
    assert run(capsys, *GAIN, "--only", "leak", "--quiet", "--plot", path)[0] == 0
    assert is_picture(path)
    pixels = image.imread(path)[..., :3]
    red = (pixels[..., 0] > 0.7) & (pixels[..., 1] < 0.4) & (pixels[..., 2] < 0.4)
    assert np.count_nonzero(red) > 100  # the line at which hunting ends


@pytest.mark.parametrize("most", [1.0, 9.0])
def test_beside_a_limit_of_torque_stands_what_the_step_takes_today(capsys, most):
    """At K = 0.25 the step of 1 rad begins with kp = 2 * 16 * 0.25 N m, whatever the remedy: not one is to blame."""
    words = "remedies", "--gain", 0.25, "--only", "gain", "--max-torque", most
    code, out, err = run(capsys, *words, "--quiet")
    for said in (" ".join(out.split()), err):
        assert "the present controller asks for 8 N m on a step of 1 rad" in said
        assert ("above that limit already" in said) == (most < 8)
    assert code == 1


@pytest.mark.slow
def test_limits(capsys):
    """The cheapest within them is named; where there is none, the table stands, and the exit code says it."""
    words = (*GAIN, "--only", "dead band,gain", "--quiet")
    code, out, _ = run(capsys, *words, "--max-error", "0.01")
    assert code == 0 and "cheapest remedy with error at rest up to 0.01 rad: gain, 0.7121" in " ".join(out.split())
    code, out, err = run(capsys, *words, "--max-error", "0.01", "--max-torque", "5")
    assert code == 1 and "none of these remedies ends it with error at rest up to 0.01 rad" in " ".join(out.split())
    assert "  gain " in out and err.startswith("casahunt remedies: no remedy ends hunting with error at rest")


def test_what_was_not_found_is_not_said_to_be_none(capsys):
    """A remedy whose cycles could not be followed: nobody knows whether it ends hunting."""
    rows = (Cure("leak", "1/s", "not found", why="stopped after 599 points"), Cure("reset", "", "none", why="goes on"))
    for remedies, none in ((rows, False), (rows[1:], True)):
        found = SimpleNamespace(best="", remedies=remedies, move=None)
        said = (none_within(Table(found)), advice_of(Table(found)))
        assert all(("was found" in sentence) is not none for sentence in said)
        assert ("leak" in said[0]) is not none


def test_the_worst_servo_of_a_set(capsys, tmp_path):
    path = tmp_path / "friction.toml"
    path.write_text('[interval]\n"friction.static" = [0.52, 0.54]\n')
    code, out, _ = run(capsys, *GAIN, "--only", "dead band", "--quiet", "--uncertainty", path)
    worst = re.search(r"the worst servo of the set: ([\d.]+) rad", out)
    assert code == 0 and worst and float(worst[1]) > BAND


def test_a_worst_servo_without_a_size_says_for_whom_the_size_to_choose_is():
    row = Cure("leak", "1/s", "fold", 1.0, 1e-9, 1.1, beyond=(1.1,), stays=("at rest",), worst_size=math.nan)
    assert any(f"the worst servo of the set: {NOT_FOR_THE_WORST}" in line for line in _row(row, True))


REFUSED = [
    (("--only", "dead bnad"), "unknown remedy 'dead bnad'; did you mean 'dead band'?"),
    (("--only", "leak, dithr"), "unknown remedy 'dithr'; did you mean 'dither'?"),
    (("--only", "quantisation"), "quantisation: is no remedy, and no part of a loop; casahunt simulate"),
    (("--only", "backlash"), "backlash: is no remedy, and no part of this model of a servo"),
    (("--only", ""), "unknown remedy ''"),
    (("--max-error", -1), "max_error = -1: must be greater than 0"),
    (("--max-torque", 0), "max_torque = 0: must be greater than 0"),
    (("--max-torque", "nan"), "max_torque = nan: must be a finite number"),
    (("--gain", -0.04), "gain = -0.04: must be greater than 0"),
    (("--model", "lugree"), "unknown model 'lugree'; did you mean 'lugre'?"),
    (("--uncertainty", "no such file.toml"), "no such file"),
    (("--csv", "rows.txt"), "rows.txt"),
]


@pytest.mark.parametrize(("words", "says"), REFUSED)
def test_what_is_refused_writes_nothing(capsys, tmp_path, monkeypatch, words, says):
    monkeypatch.chdir(tmp_path)
    written = [] if "--csv" in words else ["--csv", "rows.csv", "--plot", "sizes.png"]
    code, out, err = run(capsys, *GAIN, *words, *written)
    assert (code, out) == (2, "") and says in err and err.count("\n") == 1
    assert list(tmp_path.iterdir()) == []


def test_a_servo_that_does_not_hunt(capsys, tmp_path):
    code, out, err = run(capsys, "remedies", "--gain", 1, "--quiet", "--csv", tmp_path / "rows.csv")
    assert (code, out) == (1, "") and err.startswith("casahunt remedies: ") and list(tmp_path.iterdir()) == []


def test_why_cycles_could_not_be_followed_stands_in_the_details():
    """A mesh and Newton's method mean nothing to who asks for a remedy."""
    row = Cure("leak", "1/s", "not found", why="could be followed to 0.5 1/s", evidence="no step converged")
    (said,) = table_details(Table(SimpleNamespace(remedies=(row,))))
    assert "could be followed to 0.5 1/s (no step converged)" in said
    assert _why_not(row) == "not found: could be followed to 0.5 1/s"
