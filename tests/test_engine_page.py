"""docs/engine.md: every block runs, and gives what its comments promise."""

from __future__ import annotations

import importlib
import importlib.util
import math
import re
from pathlib import Path

import numpy as np
import pytest
from scipy.linalg import expm
from scipy.optimize import brentq

from problems import belt, table1

ROOT = Path(__file__).resolve().parent.parent
PAGE = ROOT / "docs" / "engine.md"


def blocks(path: Path) -> list[str]:
    return re.findall(r"```python\n(.*?)```", path.read_text(encoding="utf-8"), flags=re.DOTALL)


@pytest.fixture(scope="module")
def scope() -> dict:
    names: dict = {}
    for code in blocks(PAGE):
        exec(compile(code, PAGE.name, "exec"), names)  # the code is our own
    return names


def test_the_belt(scope):
    truth = belt.TRUTH[0.2]
    assert scope["orbit"].period == pytest.approx(truth.period, rel=1e-9) and scope["orbit"].error_estimate < 1e-9
    assert scope["faster"].period == pytest.approx(belt.TRUTH[0.5].period, rel=1e-8)
    assert scope["branch"].values[-1] == pytest.approx(0.5, rel=1e-12)
    assert scope["branch"].periods[-1] == pytest.approx(belt.TRUTH[0.5].period, rel=1e-7)
    position = scope["position"]
    assert (position.low.value, position.high.value) == pytest.approx(truth.extrema["x"], rel=1e-9)
    assert [c.event for c in scope["motion"].events[:2]] == ["catches up", "breaks away"]
    assert scope["motion"].error < 1e-7


def test_the_others(scope):
    assert scope["bouncing"].period == pytest.approx(2 * math.pi / 20, rel=1e-12)
    assert scope["halves"].period == pytest.approx(6.6632868593231301897, rel=1e-6) and scope["halves"].repeats == 2
    _, x = scope["over"].sample()
    assert x[0, -1] - x[0, 0] == pytest.approx(2 * math.pi, rel=1e-9)


def test_the_servo(scope):
    truth = next(row for row in table1.REFERENCE["switch"]["stable"] if row["K"] == 0.1)
    assert scope["hunting"].period == pytest.approx(truth["period"], rel=1e-9)
    assert scope["hunting"].amplitude == pytest.approx(truth["amplitude"], rel=1e-9)


def test_two_parameters(scope):
    """Closed forms of problems/bouncing_ball.py."""
    flips, g, w = scope["flips"], 9.81, 20.0
    a, r = flips.values.T
    slowest = math.pi * g * (1 - r) / (1 + r) / w**2
    assert a == pytest.approx((slowest**2 + (2 * g * (1 + r**2) / (1 + r) ** 2 / w**2) ** 2) ** 0.5, rel=1e-8)
    assert scope["slowest"].value == pytest.approx(slowest[0], rel=1e-8)
    assert scope["slowest"].sensitivities["r"] == pytest.approx(-2 * slowest[0] / (1 - 0.8**2), rel=1e-6)


def test_links_lead_somewhere():
    assert "](docs/engine.md)" in (ROOT / "README.md").read_text(encoding="utf-8")
    named = re.findall(r"`(casahunt(?:\.\w+)+)`", PAGE.read_text(encoding="utf-8"))
    assert named
    for name in named:
        module, _, attribute = name.rpartition(".")
        known = hasattr(importlib.import_module(module), attribute)
        assert known or importlib.util.find_spec(name) is not None, name


def test_what_is_printed(capsys):
    names: dict = {}
    for code in blocks(PAGE):
        exec(compile(code, PAGE.name, "exec"), names)
    said = capsys.readouterr().out
    promised = re.findall(r"# (mode .*|no cycle .* rest) ?\.*$", PAGE.read_text(encoding="utf-8"), re.MULTILINE)
    assert len(promised) == 2
    for sentence in (*promised, "12.00103129"):
        assert sentence in said


def test_the_brusselator(scope):
    """Hopf bifurcation at b = 1 + a^2, omega = a; x = a, y = b/a."""
    hopf = scope["hopf"]
    assert hopf.value == pytest.approx(2.0, rel=1e-10) and hopf.normal_form.omega == pytest.approx(1.0, rel=1e-10)
    assert hopf.equilibrium.states == pytest.approx({"x": 1.0, "y": 2.0}, rel=1e-10) and hopf.normal_form.l1 < 0
    assert 2 < scope["oscillation"].parameters["b"] < 2.1 and scope["oscillation"].stable
    settled = scope["find_cycle"](scope["brusselator"], parameters={"b": 3.0}, x=1.2, y=3.0)
    assert scope["grown"].periods[-1] == pytest.approx(settled.period, rel=1e-8) and not scope["rest"].missed


def test_the_converter(scope):
    """Its flip by the exact map of a turn, open and then closed, with the jump of the field at the ramp."""
    p = scope["converter"].parameters
    A = np.array([[-1 / (p["R"] * p["C"]), 1 / p["C"]], [-1 / p["L"], 0]])

    def flows(x, t, E):
        settled = -np.linalg.solve(A, [0.0, E / p["L"]])
        return settled + expm(A * t) @ (x - settled)

    def start(t, E):
        before, after = expm(A * t), expm(A * (p["T"] - t))
        zero = np.zeros(2)
        ends = flows(flows(zero, t, 0.0), p["T"] - t, E)
        return np.linalg.solve(np.eye(2) - after @ before, ends)

    def trace_and_determinant(E):
        rise = (p["high"] - p["low"]) / p["T"]
        t = brentq(lambda t: flows(start(t, E), t, 0.0)[0] - p["low"] - rise * t, 0.1 * p["T"], 0.99 * p["T"])
        x = flows(start(t, E), t, 0.0)
        rates = A @ x
        jump = np.eye(2) + np.outer([0.0, E / p["L"]], [1.0, 0.0]) / (rates[0] - rise)
        M = expm(A * (p["T"] - t)) @ jump @ expm(A * t)
        return 1 + np.trace(M) + np.linalg.det(M)

    flip = brentq(trace_and_determinant, 24.0, 25.0, xtol=1e-13)
    (special,) = scope["follow"](scope["regular"], "E", to=25.0).special
    assert special.kind == "flip" and special.value == pytest.approx(flip, rel=1e-8)
    assert scope["regular"].period == pytest.approx(p["T"], rel=1e-12)
