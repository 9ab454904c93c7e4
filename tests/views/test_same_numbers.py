"""The JSON object of a command is the mapping of its result: every key of `to_dict`, with the same value."""

from __future__ import annotations

import csv
import json

import pytest

import casahunt
from casahunt import Servo
from casahunt.cli import main

SERVO = Servo()
SAME = {
    "orbit --gain 0.1": (lambda: casahunt.find_orbit(SERVO, "switch", 0.1), None),
    "orbit --gain 0.1 --full": (
        lambda: casahunt.find_orbit(SERVO, "switch", 0.1, options=casahunt.Options(half=False)), None,
    ),
    "fold": (lambda: casahunt.find_fold(SERVO, "switch"), None),
    "loop --gain 0.1": (lambda: casahunt.linear_loop(SERVO, 0.1), "loops"),
    "equilibria --gain 0.1": (lambda: casahunt.equilibria(SERVO, "switch", 0.1), None),
    "equilibria --gain 0.1 --model lugre": (lambda: casahunt.equilibria(SERVO, "lugre", 0.1), None),
    "map --gain 0.6 --from 1e-3 --to 3e-3 --points 10": (
        lambda: casahunt.fixed_points(SERVO, 0.6, 1e-3, 3e-3, points=10), None,
    ),
    "basin --gain 0.5": (lambda: casahunt.basin(SERVO, "switch", 0.5), None),
    "simulate --gain 0.04 --time 20": (lambda: casahunt.simulate(SERVO, "switch", 0.04, time=20.0), None),
    "fold-curve --model switch --vary friction.static --from 0.53 --to 0.54 --points 2": (
        lambda: casahunt.fold_curve(SERVO, "switch", vary="friction.static", start=0.53, end=0.54, points=2), "curves",
    ),
    "fold-map --vary friction.static 0.5 0.53 --and friction.coulomb 0.44 0.51 --points 2": (
        lambda: casahunt.fold_map(
            SERVO, "switch", ("friction.static", "friction.coulomb"), [0.5, 0.53], [0.44, 0.51],
        ), None,
    ),
}  # fmt: skip
"""By command: the result, and the list that it is the first entry of."""


def but_times(value: object) -> object:
    """A value without the times in it."""
    if isinstance(value, dict):
        return {key: but_times(item) for key, item in value.items() if key != "wall_s"}
    return [but_times(item) for item in value] if isinstance(value, list) else value


@pytest.mark.parametrize("command", SAME)
def test_the_object_and_the_table_are_those_of_the_result(command, capsys, tmp_path):
    make, within = SAME[command]
    made = make()
    table = tmp_path / "table.csv"
    assert main([*command.split(), "--json", "--quiet", "--csv", str(table)]) == 0
    printed = json.loads(capsys.readouterr().out)
    printed = but_times(printed[within][0] if within else printed)
    mapping = but_times(json.loads(json.dumps(made.to_dict(table=False))))
    assert {key: printed[key] for key in mapping} == mapping
    if command.startswith("orbit"):  # a row of its numbers; the table of an orbit is its motion
        (row,) = csv.DictReader(table.read_text().splitlines())
        assert float(row["period_s"]) == made.period
        return
    (casahunt.fold_sensitivities(made) if command == "fold" else made).to_csv(tmp_path / "own.csv")
    assert table.read_text() == (tmp_path / "own.csv").read_text()
