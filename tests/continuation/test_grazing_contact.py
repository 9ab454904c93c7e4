"""Branches on which a cycle grazes an event once more, against closed forms of the impact oscillator."""

from __future__ import annotations

import math

import numpy as np
import pytest
from scipy.optimize import fsolve

from casahunt.continuation import beyond_grazing, follow, grazing_contact, vanishing
from casahunt.orbits import Options, find_cycle
from problems import impact_oscillator

C, D, E = 0.1, 1.0, 0.8


def flown(t0: float, x0: float, v0: float, w: float, A: float, t: float) -> np.ndarray:
    """(x, v) of x'' = A cos(w t) - C x' - x at t: a damped oscillation about a forced one."""
    size = (1 - w**2) ** 2 + (C * w) ** 2
    a, b = A * (1 - w**2) / size, A * C * w / size

    def forced(t: float) -> np.ndarray:
        return np.array([a * np.cos(w * t) + b * np.sin(w * t), w * (b * np.cos(w * t) - a * np.sin(w * t))])

    x, v = np.array([x0, v0]) - forced(t0)
    own, z, s = math.sqrt(1 - C**2 / 4), C / 2, t - t0
    cos, sin = np.cos(own * s), np.sin(own * s) / own
    return np.exp(-z * s) * np.array([x * cos + (v + z * x) * sin, v * cos - (z * v + x) * sin]) + forced(t)


def grazing_frequency() -> float:
    """w at which the cycle with one impact a turn comes back to the stop in between, with no speed."""

    def missing(y: np.ndarray) -> np.ndarray:
        t0, v0, w, s = y
        x, v = flown(t0, D, v0, w, 1.0, t0 + 2 * np.pi / w)
        return np.concatenate([[x - D, -E * v - v0], flown(t0, D, v0, w, 1.0, t0 + s) - [D, 0.0]])

    y = fsolve(missing, [-0.67, -2.14, 0.7, 4.0], xtol=1e-12)
    assert np.max(np.abs(missing(y))) < 1e-12
    return float(y[2])


def fold_amplitude() -> float:
    """Least A of the cycles with one impact a turn at w = 1: A as a function of the speed behind it."""
    guess = np.array([0.0, 0.1])

    def amplitude(v0: float) -> float:
        nonlocal guess

        def missing(y: np.ndarray) -> np.ndarray:
            x, v = flown(y[0], D, v0, 1.0, y[1], y[0] + 2 * np.pi)
            return np.array([x - D, -E * v - v0])

        guess = fsolve(missing, guess, xtol=1e-12)
        assert np.max(np.abs(missing(guess))) < 1e-11
        return float(guess[1])

    guess[0] = np.pi / 2  # without impacts x = 10 A sin t
    speeds = -np.linspace(1e-4, 0.05, 200)
    values = [amplitude(v0) for v0 in speeds]
    i = int(np.argmin(values))
    assert 0 < i < len(values) - 1
    fit = np.polynomial.Polynomial.fit(speeds[i - 4 : i + 5], values[i - 4 : i + 5], 6)
    roots = fit.deriv().roots()
    at = roots[np.argmin(np.abs(roots - speeds[i]))].real
    return float(fit(at))


@pytest.mark.slow
def test_a_second_impact_is_born_and_the_branch_goes_on():
    """From one impact a turn at w = 1 through the grazing and round a fold to two of them at w = 0.7."""
    branch = follow(find_cycle(impact_oscillator.SYSTEM, x=0.0, v=0.0), "w", to=0.7)
    assert [special.kind for special in branch.special] == ["grazing", "fold"] and not branch.missed
    grazing, _ = branch.special
    w = grazing_frequency()
    assert grazing.orbit.problem.value("w") == pytest.approx(w, rel=1e-9)
    assert "mode 'free' meets 'impact' once more" in grazing.meaning and "goes on" in grazing.meaning
    assert len(grazing.orbit.arcs) == 1 and grazing.orbit.extrema("x").high.value == pytest.approx(1.0, abs=1e-8)
    ones = [orbit for orbit in branch.orbits if len(orbit.arcs) == 1]
    assert min(orbit.problem.value("w") for orbit in ones) > w * (1 - 1e-9)
    truth = impact_oscillator.TRUTH[0.7, 1.0]
    last = branch.orbits[-1]
    assert branch.values[-1] == 0.7 and len(last.arcs) == 2
    for name, (low, high) in truth.extrema.items():
        found = last.extrema(name)
        assert (found.low.value, found.high.value) == pytest.approx((low, high), abs=1e-7)


@pytest.mark.slow
def test_the_first_impact_is_born_where_the_linear_amplitude_reaches_the_stop():
    """A = d sqrt((k - w^2)^2 + (c w)^2) = 0.1; behind it the impacts are unstable, and stable behind their fold."""
    clear = find_cycle(impact_oscillator.SYSTEM, parameters={"A": 0.08}, x=0.0, v=0.0)
    branch = follow(clear, "A", to=0.2, options=Options(tol=1e-8))
    grazing, fold = branch.special
    assert grazing.kind == "grazing" and fold.kind == "fold" and not branch.missed
    assert grazing.orbit.problem.value("A") == pytest.approx(0.1, rel=1e-9)
    assert float(grazing.meaning.split("A = ")[1].split(":")[0]) == pytest.approx(0.1, rel=1e-9)
    assert fold.orbit.problem.value("A") == pytest.approx(fold_amplitude(), rel=1e-8)
    assert branch.values[-1] == 0.2 and branch.stable[-1]


@pytest.mark.slow
@pytest.mark.parametrize("hidden", ["_touching", "with_contact"])
def test_a_touch_that_leads_nowhere_ends_the_branch(monkeypatch, hidden):
    """Where it is not located no digit is claimed that is not known; where nothing follows, that is said."""
    monkeypatch.setattr(beyond_grazing, "_clear_of_it", lambda *args: None)
    if hidden == "_touching":
        monkeypatch.setattr(grazing_contact, "_grazing", lambda *args: "")
    else:
        monkeypatch.setattr(vanishing, "with_contact", lambda *args: ())
    branch = follow(find_cycle(impact_oscillator.SYSTEM, parameters={"A": 0.09}, x=0.0, v=0.0), "A", to=0.2)
    (special,) = branch.special
    assert "no cycle with these phases follows" in special.meaning and special.meaning in branch.ended
    said = special.meaning.split("A = ")[1].split(":")[0]
    assert float(said) == pytest.approx(0.1, rel=1e-3) and len(said) < 7
