"""Sketches on the way claim no accuracy and see a mesh that is too rough; what is computed at their end is exact."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from casahunt import Options
from casahunt.collocation.admissibility import check_admissible
from casahunt.collocation.mesh import shape, transfer
from casahunt.collocation.node_system import Linearisation
from casahunt.continuation.walk import walk
from casahunt.orbits import find_cycle
from casahunt.orbits.adapt import refined, solve_adaptively
from casahunt.orbits.marched_mesh import remeshed, start_from_motion
from casahunt.orbits.orbit import unknowns_of
from casahunt.servo.cold_start import phases_of
from casahunt.servo.cold_start import unstable as is_unstable
from casahunt.servo.event_map.half_cycle import StickMap, half_cycle
from casahunt.servo.problem import Hunting
from problems import table1, van_der_pol

SKETCHED = Options(tol=1e-5, provisional=True)


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_a_provisional_orbit_claims_no_accuracy(orbit, model):
    """Down from 0.4: the unstable side is not met, the errors are infinite, and the end is the reference's."""
    start = orbit(model, 0.4)
    *_, last = walk(start, low=0.2, high=1.0, sense=-1.0, options=SKETCHED)
    assert last.gain == 0.2 and math.isinf(last.period_error) and math.isinf(last.amplitude_error)
    row = next(r for r in table1.REFERENCE[model]["stable"] if r["K"] == 0.2)
    assert last.amplitude == pytest.approx(row["amplitude"], rel=1e-4)
    exact = refined(last, Options(tol=1e-8))
    assert exact.error_estimate < 1e-8
    assert exact.amplitude == pytest.approx(row["amplitude"], rel=2e-8)
    assert exact.period == pytest.approx(row["period"], rel=2e-8)


def test_a_provisional_orbit_on_too_rough_a_mesh_gets_another():
    """Two intervals for van der Pol's oscillator: the last Legendre coefficients tell."""
    found = find_cycle(van_der_pol.SYSTEM, parameters={"mu": 1.0}, start={"x": 2.0, "v": 0.0}, tol=1e-6)
    t, u, setting = unknowns_of(found)
    t, u, fractions = transfer(t, u, setting.fractions, [np.linspace(0, 1, 3)] * len([c for c in t.counts if c]))
    start = t, u, replace(setting, fractions=fractions)
    solved = solve_adaptively(found.problem, start, SKETCHED, solver="newton")
    assert solved.status.ok and solved.t.intervals > t.intervals
    assert float(shape(solved.t, solved.solution.u).max()) < 0.1 * float(shape(t, u).max())


def test_what_a_motion_does_is_clear_before_it_is_solved():
    """A LuGre motion whose mesh for the tolerance leaves it unclear on one interval whether it creeps back."""
    servo, options = table1.servo(), Options(tol=1e-8)
    problem = Hunting("lugre", servo, 0.2)
    rigid = half_cycle("switch", servo, 0.2, 0.1 * servo.friction.static / servo.torque_gains(0.2)[0])
    motion = StickMap("lugre", servo, 0.2)(rigid.position, degree=7, kind="radau")
    start = start_from_motion(problem, *phases_of(motion, problem, options), options)
    assert not check_admissible(*remeshed(start, options)).unclear.any()


def test_the_side_of_the_fold_is_seen_at_a_glance_where_that_is_sure(orbit, monkeypatch):
    stable, unstable = orbit("switch", 0.4), replace(orbit("switch", 0.4, "unstable"))
    assert is_unstable(unstable) and "multipliers" not in vars(unstable)
    assert not is_unstable(stable)
    for glance in (1e9, np.nan, 1.5):  # beyond its digits, or too close to one
        monkeypatch.setattr(Linearisation, "return_map_eigenvalues", lambda *_, g=glance: np.array([g, 0.0]))
        assert not is_unstable(stable) and is_unstable(unstable)
