"""The fold at which the parameter is smallest, on an oscillator whose fold and its derivatives are closed forms."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest

from casahunt import NoOrbit, Options
from casahunt.collocation.ipopt import solve
from casahunt.collocation.transcription import Setting, transcribe
from casahunt.continuation import fold_check, special_points_between
from casahunt.continuation.fold_check import confirmed
from casahunt.continuation.special_points import FOLD, SpecialPoint
from casahunt.continuation.walk import walk
from casahunt.errors import Status
from casahunt.orbits.adapt import finished, solve_adaptively
from casahunt.orbits.bordering import curve_border, row_along
from casahunt.orbits.orbit import Orbit, unknowns_of
from problems import stuart_landau as sl
from problems.fixed_sequence import FixedSequence

OMEGA, B, C = 1.5, 1.2, 0.9
SMALLEST = 1 - B**2 / (4 * C)
ELASTICITIES = {"b": -B * B / (2 * C) / SMALLEST, "c": B**2 / (4 * C**2) * C / SMALLEST, "omega": 0.0}
"""q/nu dnu/dq of the smallest nu."""


def stable_cycle(nu: float, options: Options) -> Orbit:
    """The larger cycle, from the exact circle."""
    r = np.sqrt((B + np.sqrt(B**2 - 4 * C * (1 - nu))) / (2 * C))
    problem = FixedSequence(sl.HARD, (nu, OMEGA, B, C), followed="nu", scheme=(8, "gauss"))
    t = transcribe(sl.HARD, (8,), 8, "gauss")
    angles = 2 * np.pi / 8 * (np.arange(8)[:, None] + t.scheme.points)
    w = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(8, -1)
    u = t.pack(w, np.vstack([w[:, :2], w[0, :2]]), np.array([2 * np.pi / OMEGA]))
    setting = Setting(np.full(8, 1 / 8), problem.vector(), np.full(2, r), np.zeros(4))
    return finished(solve_adaptively(problem, (t, u, setting), options, solver="newton"), problem, options, 0.0, "it")


@pytest.mark.parametrize("solver", ["ipopt", "newton"])
def test_where_it_lies_and_how_it_moves(solver):
    """Down from nu = 0.75 and round; how it moves, as of a largest parameter."""
    options = Options(tol=1e-9, solver=solver)
    start = stable_cycle(0.75, options)
    points = [start, *itertools.islice(walk(start, low=0.3, high=0.9, sense=-1.0, options=options), 12)]
    found = [
        s for pair in itertools.pairwise(points)
        for s in special_points_between(*pair, vary="nu", monitors=(FOLD,), options=options)[0]
    ]  # fmt: skip
    assert len(found) == 1
    fold = confirmed(found[0], "nu", options, sense=-1.0)
    assert fold.value == pytest.approx(SMALLEST, rel=1e-9)
    assert fold.confirmed_value == pytest.approx(SMALLEST, rel=1e-9)
    for name, expected in ELASTICITIES.items():
        relative = fold.sensitivities[name] * fold.orbit.problem.value(name) / fold.value
        assert relative == pytest.approx(expected, abs=1e-6)


@pytest.mark.parametrize("solver", ["ipopt", "newton"])
def test_a_point_beside_it_is_located_anew_or_refused(solver, monkeypatch):
    """Off by less than a tolerance it is confirmed, and the optimum lies at the fold itself, not beyond it."""
    options = Options(tol=1e-4, solver=solver)
    beside = stable_cycle(SMALLEST * (1 + 1e-8), Options(tol=1e-11))
    fold = confirmed(SpecialPoint("fold", beside, ""), "nu", options, sense=-1.0)
    assert fold.confirmed_value == pytest.approx(SMALLEST, rel=1e-9)
    assert 0.95e-8 < fold.value_error < 1.2e-8  # what the halved mesh leaves itself is allowed for
    smaller, special = Options(tol=5e-9, solver=solver), SpecialPoint("fold", beside, "")
    assert confirmed(special, "nu", smaller, sense=-1.0).value == pytest.approx(SMALLEST, rel=1e-11)
    monkeypatch.setattr(fold_check, "turned_orbit", lambda *a: None)
    with pytest.raises(NoOrbit, match="not confirmed: the turning point is at"):
        confirmed(special, "nu", smaller, sense=-1.0)


def test_what_the_mesh_does_to_its_place_is_mended_by_a_finer_one():
    """The period moves with the place along the branch, of first order, and the value of second."""
    coarse = stable_cycle(SMALLEST * (1 + 1e-4), Options(tol=1e-3))
    fold = confirmed(SpecialPoint("fold", coarse, ""), "nu", Options(tol=1e-10), sense=-1.0)
    assert fold.value == pytest.approx(SMALLEST, rel=1e-10) and fold.error_estimate <= 1e-10
    assert fold.orbit.period == pytest.approx(2 * np.pi / OMEGA, rel=1e-10)


def test_a_smallest_parameter_is_not_given_as_the_largest():
    """Newton's method finds extrema of the kind that it is told to find."""
    t, u, setting = unknowns_of(stable_cycle(SMALLEST * (1 + 5e-5), Options(tol=1e-9)))
    setting = replace(setting, dp=np.array([1.0, 0.0, 0.0, 0.0]) * setting.p[0])
    border = curve_border(t, u, row_along(t, u, setting))
    found = solve(t, u, setting, solver="newton", border=border, bend=np.inf)
    assert found.status is Status.CONVERGED and found.bend > 0
    assert setting.p[0] * (1 + found.parameter) == pytest.approx(SMALLEST, rel=1e-11)
    assert not solve(t, u, setting, solver="newton", border=border, bend=-np.inf).status.ok
