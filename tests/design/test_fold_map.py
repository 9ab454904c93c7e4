"""The fold gain over two parameters, against the exact symmetries of the Switch servo and its reference fold."""

from __future__ import annotations

import csv
import json

import numpy as np
import pytest

from casahunt.cli import main
from casahunt.design.fold_map import NO_SERVO, fold_map
from casahunt.errors import InputError
from casahunt.orbits.adapt import Options
from problems import table1

FRICTION = ("friction.static", "friction.coulomb")
FOLD = table1.REFERENCE["switch"]["fold"]["K"]


def test_the_fold_depends_on_the_drop_of_the_friction_alone():
    """At one Stribeck velocity the fold gain is a function of static less Coulomb friction (docs/theory.md)."""
    seen = []
    first, second = np.array([0.525, 0.53, 0.535]), np.array([0.435, 0.44, 0.445])
    found = fold_map(table1.servo(), "switch", FRICTION, first, second, options=Options(tol=1e-8), report=seen.append)
    assert found.gains[1, 1] == pytest.approx(FOLD, rel=1e-8)
    for k in (-1, 0, 1):
        diagonal = np.diagonal(found.gains, k)
        assert diagonal == pytest.approx(np.full(diagonal.size, diagonal[0]), rel=3e-8)
    assert found.gains[2, 0] > found.gains[1, 0] > FOLD > found.gains[0, 1]
    assert found.status.ok and not found.failures and seen[-1] == 9
    assert str(found).startswith("switch servo: fold gain") and "3 x 3" in str(found)


@pytest.mark.slow
def test_folds_that_one_expansion_does_not_reach():
    """Drops of the friction from 0.02 to 1.55, from fold to fold and some alone; equal drops have equal folds."""
    static, coulomb = np.array([0.46, 0.53, 1.2, 1.99]), np.array([0.37, 0.44, 1.11])
    found = fold_map(table1.servo(), "switch", FRICTION, static, coulomb, options=Options(tol=1e-7))
    assert np.diagonal(found.gains) == pytest.approx(np.full(3, FOLD), rel=3e-7)
    assert set(found.failures) == {(0, 2), (1, 2)} and found.status.ok  # coulomb above static
    drops = [(static[i] - coulomb[j], found.gains[i, j]) for i, j in np.argwhere(found.gains > 0)]
    assert len(drops) == 10 and np.all(np.diff([gain for _, gain in sorted(drops) if gain != FOLD]) > -1e-6)


@pytest.mark.slow
def test_what_cannot_hunt_and_what_is_no_servo():
    values = np.array([0.44, 0.53])
    found = fold_map(table1.servo(), "switch", FRICTION, values, values)
    assert found.gains[1, 0] == pytest.approx(FOLD, rel=1e-6)
    assert found.gains[0, 0] == found.gains[1, 1] == 0  # no drop: proved
    assert np.isnan(found.gains[0, 1]) and found.failures == {(0, 1): NO_SERVO} and found.status.ok


@pytest.mark.parametrize(
    ("names", "first", "said"),
    [
        (("friction.static", "friction.static"), [0.5, 0.6], "two different parameters"),
        (("friction.statc", "friction.coulomb"), [0.5, 0.6], "friction.static"),
        (FRICTION, [0.6, 0.5], "increasing"),
        (FRICTION, [0.5], "2 to 200"),
        (FRICTION, [-0.5, 0.6], "friction.static"),
    ],
)
def test_axes_that_are_none(names, first, said):
    with pytest.raises(InputError, match=said):
        fold_map(table1.servo(), "switch", names, np.array(first), np.array([0.44, 0.45]))


def test_the_command_writes_table_picture_and_json(tmp_path, capsys):
    table, picture = tmp_path / "map.csv", tmp_path / "map.png"
    words = ["fold-map", "--vary", "friction.static", "0.52", "0.54", "--and", "controller.lead_time", "0.15", "0.16",
             "--points", "2", "--json", "--quiet", "--csv", str(table), "--plot", str(picture)]  # fmt: skip
    assert main(words) == 0
    record = json.loads(capsys.readouterr().out)
    rows = list(csv.DictReader(table.read_text().splitlines()))
    assert [float(row["gain"]) for row in rows] == pytest.approx(np.ravel(record["gains"]))
    assert {row["status"] for row in rows} == {"converged"} and picture.stat().st_size > 10_000
    words[3:5] = ["0.54", "0.52"]
    assert main(words) == 2
    assert "must begin below its end" in capsys.readouterr().err
