"""The friction that explains the report's averages, and the figures of docs/report.md."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from casahunt import Servo, find_fold
from casahunt.servo.servo import flatten
from scripts.peers.hunting_record import positions
from scripts.report.averages import averages, explained
from scripts.report.study import GAIN, MEASURED_AMPLITUDE, MEASURED_PERIOD

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "report.md").read_text(encoding="utf-8")
ROWS = re.findall(r"^\| ([^|]*) \| ([\d.]+) \(([^)]*) %\) \| ([\d.]+) \(([^)]*) %\) \| ?([\d.]*) ?\|$", PAGE, re.M)
NAMES = {
    "Stribeck velocity": "friction.stribeck_velocity", "viscous friction": "friction.viscous",
    "inertia": "servo.inertia", "nothing": "",
}  # fmt: skip


def given(text):
    """The servo of a row, static and Coulomb friction those of Table 1."""
    name = next(key for key in NAMES if text.startswith(key))
    return Servo().replace(**{NAMES[name]: float(text[len(name) :].split()[0])}) if NAMES[name] else Servo()


@pytest.mark.parametrize("row", [ROWS[0], *(pytest.param(r, marks=pytest.mark.slow) for r in ROWS[1:])], ids=str)
def test_the_table_of_the_page(row):
    text, static, of_static, coulomb, of_coulomb, fold = row
    found = explained(given(text), "switch")
    for name, said, change in zip(found.values, (static, coulomb), (of_static, of_coulomb), strict=True):
        assert found.values[name] == pytest.approx(float(said), abs=6e-5)
        assert found.values[name] / flatten(Servo())[name] - 1 == pytest.approx(float(change) / 100, abs=6e-4)
    if fold:
        assert find_fold(found.servo, "switch").gain == pytest.approx(float(fold), abs=6e-4)


def test_all_rows_are_found():
    assert len(ROWS) == 7


def test_another_integrator_finds_the_averages():
    servo = explained(Servo(), "switch").servo
    t = np.arange(0.0, 12 * MEASURED_PERIOD, 0.002)
    x = positions(servo, "switch", GAIN, MEASURED_AMPLITUDE, t)
    late, times = x[t > 4 * MEASURED_PERIOD], t[t > 4 * MEASURED_PERIOD]
    assert (late.max(), late.min()) == pytest.approx((MEASURED_AMPLITUDE, -MEASURED_AMPLITUDE), rel=1e-5)
    up = np.flatnonzero((late[:-1] < 0) & (late[1:] >= 0))
    assert np.diff(times[up]).mean() == pytest.approx(MEASURED_PERIOD, rel=1e-4)


@pytest.mark.parametrize(("model", "amplitude", "period"), [("switch", 0.0500, 10.28), ("lugre", 0.0495, 10.38)])
def test_the_table_of_the_report_is_off(model, amplitude, period):
    """By the independent cycles of problems/table1.py."""
    said = np.log([amplitude / MEASURED_AMPLITUDE, period / MEASURED_PERIOD])
    assert averages(Servo(), model) == pytest.approx(said, abs=2e-3)
    assert f"{amplitude:.4f} rad" in PAGE and f"{period} s" in PAGE


@pytest.mark.slow
def test_lugre_friction_is_about_the_same():
    switch, lugre = (explained(Servo(), model).values for model in ("switch", "lugre"))
    assert all(abs(switch[name] - lugre[name]) < 2e-3 for name in switch)


@pytest.mark.slow
def test_without_viscous_friction_the_fold_is_lowest():
    found = explained(Servo().replace(**{"friction.viscous": 0.0}), "switch")
    assert find_fold(found.servo, "switch").gain == pytest.approx(0.57, abs=5e-3)
