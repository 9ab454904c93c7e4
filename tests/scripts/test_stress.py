"""The stress script: a handful of its cases, and its verdicts where the answer is known to be wrong."""

from __future__ import annotations

import csv
import json
from dataclasses import replace

import pytest

from casahunt import Options, Servo, find_orbit
from scripts import stress
from scripts.extremes import desk as desk_module
from scripts.extremes.cases import NONE, REFUSED, SOLVED, WRONG, Case, grid
from scripts.extremes.desk import Desk


@pytest.mark.slow
def test_a_few_cases_and_the_files(tmp_path, capsys):
    code = stress.main(["--out", str(tmp_path), "--quick", "--rows", "Fs/Fc", "--limit", "2", "--jobs", "1",
                        "--no-extras"])  # fmt: skip
    whole = json.loads((tmp_path / "stress.json").read_text())
    assert code == 0
    assert whole["summary"]["all"]["cases"] == 2
    assert [case["verdict"] for case in whole["cases"]] == [NONE, SOLVED]
    with (tmp_path / "stress.csv").open() as file:
        assert len(list(csv.DictReader(file))) == 2
    assert (tmp_path / "stress.png").stat().st_size > 1000
    assert "solved where a cycle exists" in capsys.readouterr().out


@pytest.mark.slow
@pytest.mark.parametrize("model", ["switch", pytest.param("lugre", marks=pytest.mark.slow)])
def test_a_wrong_orbit_is_called_wrong(model, monkeypatch):
    """An answer that is off by 1e-4, with the estimate of a right one."""

    def lying(servo, which, gain, *, branch, options):
        orbit = find_orbit(servo, which, gain, branch=branch, options=options)
        if options.tol < 1e-6 or gain != case.share * fold:
            return orbit
        arcs = tuple(replace(arc, end=arc.end * (1 + 1e-4)) for arc in orbit.arcs)
        return replace(orbit, period=orbit.period * (1 + 1e-4), amplitude=orbit.amplitude * (1 + 1e-4), arcs=arcs)

    case = Case("K/K_fold", "0.3", model, "stable", share=0.3)
    desk = Desk(quick=True)
    fold = desk.fold(case)[0].gain
    monkeypatch.setattr(desk_module, "find_orbit", lying)
    assert desk.verdict(case).verdict == WRONG
    monkeypatch.setattr(desk_module, "find_orbit", find_orbit)
    assert desk.verdict(case).verdict == SOLVED


@pytest.mark.slow
def test_a_false_denial_is_called_wrong():
    case = Case("K/K_fold", "0.3", "switch", "stable", share=0.3)
    desk = Desk(quick=True)
    said = "no hunting limit cycle of the switch servo at gain 0.2"
    assert desk.refusal(case, Servo(), 0.2, 0.0, said, []).verdict == WRONG
    honest = "NOT_CONVERGED: the collocation equations did not converge"
    assert desk.refusal(case, Servo(), 0.2, 0.0, honest, []).verdict == REFUSED
    assert desk.refusal(case, Servo(), 0.9, 0.0, said, []).verdict == NONE
    assert desk.refusal(case, Servo(), 0.2, 0.0, "failed", []).verdict == WRONG


def test_the_grid_covers_what_it_promises():
    cases = grid(quick=False)
    values = {row: {c.column for c in cases if c.row == row} for row in {c.row for c in cases}}
    assert {"1e+07"} <= values["sigma0"] and {"0.489"} <= values["sigma1"]
    assert {"0.0001", "0.2"} <= values["vs"] and {"1", "3"} <= values["Fs/Fc"]
    assert {"0.001", "0.9999"} <= values["K/K_fold"] and {"0.01", "10"} <= values["tau_i"] & values["tau_d"]
    assert {"1e-12"} <= values["tolerance"] and values["degree, gauss"] == {str(d) for d in range(2, 10)}
    assert 50 <= len(grid(quick=True)) <= 70
    assert len(cases) > 300


@pytest.mark.parametrize("kind", ["gauss", "radau"])
def test_degree_two(kind):
    """A Switch slip starts with v ~ t^2: at degree 2 its sign is as clear as at any other."""
    truth = find_orbit(Servo(), "switch", 0.3, options=Options(tol=1e-11))
    for tol in (1e-4, 1e-7):
        found = find_orbit(Servo(), "switch", 0.3, options=Options(tol=tol, degree=2, kind=kind))
        error = max(abs(found.amplitude / truth.amplitude - 1), abs(found.period / truth.period - 1))
        assert error <= min(10 * found.error_estimate, tol)


@pytest.mark.slow
def test_nothing_is_wrong_on_a_part_of_the_quick_grid(tmp_path):
    """The whole of it takes some minutes; the script says how it went."""
    assert stress.main(["--out", str(tmp_path), "--quick", "--limit", "6", "--no-extras"]) == 0
    part = json.loads((tmp_path / "stress.json").read_text())
    assert part["summary"]["all"]["wrong"] == 0
