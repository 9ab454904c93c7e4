"""The fold of the oscillator with hard excitation and shear: located, confirmed, refused."""

from __future__ import annotations

from dataclasses import replace

import casadi as ca
import numpy as np
import pytest
from hard_excitation_support import LARGEST, NU, B, c_of, cycle

from casahunt import NoOrbit, Options
from casahunt.collocation.graphs import graphs
from casahunt.collocation.transcription import Setting, transcribe
from casahunt.continuation import fold as folds
from casahunt.continuation import fold_check
from casahunt.continuation.fold import located
from casahunt.continuation.fold_check import confirmed, next_fold
from casahunt.continuation.fold_conditions import data_of, fold_conditions
from casahunt.continuation.special_points import SpecialPoint
from casahunt.errors import InputError, Status
from casahunt.orbits import adapt
from casahunt.orbits.adapt import finished, solve_adaptively
from casahunt.orbits.orbit import unknowns_of
from problems import stuart_landau as sl


@pytest.mark.parametrize("solver", ["newton", "ipopt"])
def test_the_next_fold(solver):
    found = next_fold(cycle(3.59), "c", Options(tol=1e-8, solver=solver))
    assert c_of(found.orbit) == pytest.approx(LARGEST, rel=1e-9) and found.kind == "fold"
    assert found.orbit.amplitude**2 == pytest.approx(B / (2 * LARGEST), rel=1e-4)
    assert found.orbit.solver == solver


def test_the_next_fold_must_be_a_motion_on_halves_too(monkeypatch):
    below = cycle(3.59)
    monkeypatch.setattr(
        adapt, "judged_on_halves", lambda t, verdict, better: replace(verdict, unclear=np.ones(t.intervals, bool))
    )
    with pytest.raises(NoOrbit, match="was not located"):
        next_fold(below, "c", Options(tol=1e-8))


@pytest.mark.parametrize("solver", ["newton", "ipopt"])
def test_a_fold_is_confirmed_or_refused(solver, monkeypatch):
    options = Options(tol=1e-4, solver=solver)
    beside = cycle(LARGEST * (1 - 1e-8), tol=1e-11)
    fold = confirmed(SpecialPoint("fold", beside, ""), "c", options)
    assert fold.value == c_of(beside) and fold.confirmed_value == pytest.approx(LARGEST, rel=1e-9)
    assert 0.95e-8 < fold.value_error < 1.2e-8  # what the halved mesh leaves itself is allowed for
    assert fold.error_estimate >= fold.value_error and fold.status is Status.CONVERGED
    r, f = beside.amplitude, np.sqrt(B / (2 * LARGEST))
    assert 0.99 < fold.orbit.amplitude_error / abs(f / r - 1) < 1.2
    for name, expected in (("nu", NU / (1 - NU)), ("b", 2.0), ("omega", 0.0), ("shear", 0.0)):
        relative = fold.sensitivities[name] * fold.orbit.problem.value(name) / fold.value
        assert relative == pytest.approx(expected, abs=1e-3)  # r is 1e-4 off
    monkeypatch.setattr(fold_check, "turned_orbit", lambda *a: None)  # nor is it located anew
    with pytest.raises(NoOrbit, match=r"not confirmed: the turning point is at 3\.6") as caught:
        confirmed(SpecialPoint("fold", beside, ""), "c", replace(options, tol=5e-9))
    assert caught.value.status is Status.TOLERANCE_NOT_REACHED
    for kind in ("a corner", "superstable"):
        with pytest.raises(InputError, match="must be a fold"):
            confirmed(SpecialPoint(kind, beside, ""), "c", options)


def test_a_fold_that_no_step_along_the_branch_finds(monkeypatch):
    """As the optimum next to the larger of the two orbits."""
    monkeypatch.setattr(folds, "locate_special_point", lambda *arguments, **options: None)
    special = located(cycle(3.55), cycle(3.58, -1), "c", Options(tol=1e-8))
    assert c_of(special.orbit) == pytest.approx(LARGEST, rel=1e-8)


def test_a_fold_at_which_no_duration_moves():
    """Without shear the period is always the same; the first node measures the way."""
    found = cycle(3.59)
    problem = replace(found.problem, values=(*found.problem.values[:4], 0.0))
    t, u, setting = unknowns_of(found)
    start = t, u, replace(setting, p=problem.vector())
    options = Options(tol=1e-8)
    still = finished(solve_adaptively(problem, start, options, solver="newton"), problem, options, 0.0, "the cycle")
    fold = next_fold(still, "c", options)
    assert c_of(fold.orbit) == pytest.approx(LARGEST, rel=1e-8)
    assert fold.orbit.period == pytest.approx(still.period, rel=1e-9)


# The conditions of a fold ------------------------------------------------------------------------------------------


def test_the_conditions_of_a_fold_and_their_jacobian():
    """At a point that is no fold of anything: against the equations at p, and against CasADi's own derivative."""
    t = transcribe(sl.TWO_CLOCKS, (3, 2), 2, "gauss")
    rng = np.random.default_rng(3)
    z, n, scale = rng.uniform(0.2, 1, t.size + 1), rng.standard_normal(t.size), 37.0
    z[-1] = 0.01
    p, dp = np.array([0.25, 1.5, 0.8, 0.2]), np.array([0.3, 1.0, -0.5, 0.2])
    setting = Setting(rng.dirichlet(np.full(3, 5.0)).tolist() + [0.4, 0.6], p, np.array([0.5, 0.7]), dp)
    free = (1, 3)
    q = np.log([1.4, 0.3])
    conditions, jacobian = fold_conditions(t, free)
    arguments = (q, z, n, data_of(setting), scale)
    g = graphs(t)
    parts = ca.Function("parts", [g.z, g.data], [g.residual, g.jacobian])
    there = data_of(replace(setting, p=np.array([0.25, 1.4, 0.8, 0.3])))
    residual, J = (np.array(ca.DM(x).full()) for x in parts(z, there))
    expected = np.concatenate([residual.ravel(), J[:, :-1].T @ n, [scale * (n @ J[:, -1])]])
    found = np.array(conditions(*arguments)).ravel()
    np.testing.assert_allclose(found, expected, rtol=1e-12, atol=1e-12 * scale)

    symbols = [ca.MX.sym(name, size) for name, size in (("q", 2), ("z", t.size + 1), ("n", t.size))]
    own = ca.jacobian(conditions(*symbols, data_of(setting), scale), ca.vertcat(*symbols))
    reference = np.array(ca.Function("own", symbols, [ca.densify(own)])(q, z, n))
    placed = np.array(ca.DM(jacobian(*arguments)).full())
    assert np.abs(reference[:, :2]).max() > 0.1, "q moves the equations"
    np.testing.assert_allclose(placed, reference, rtol=0, atol=1e-13 * np.abs(reference).max())
