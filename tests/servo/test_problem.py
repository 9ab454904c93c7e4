"""servo/problem.py: the servo's cycles are cycles of a system, with which the engine does what it does with any."""

from __future__ import annotations

import numpy as np
import pytest

from casahunt import Options, Servo, find_orbit
from casahunt.continuation import follow
from casahunt.orbits.adapt import solve_adaptively
from casahunt.orbits.orbit import unknowns_of
from casahunt.orbits.simulated_phases import expected, other_sequences, rotated
from casahunt.servo.problem import Hunting
from problems import table1


@pytest.mark.parametrize("model", ["switch", "lugre"])
def test_a_branch_of_any_system(model):
    """Round the fold that the report's servo has (problems/table1.py), by the verb that a user's cycles have."""
    K = table1.REFERENCE[model]["fold"]["K"]
    branch = follow(find_orbit(Servo(), model, 0.97 * K), "gain", to=2 * K)
    assert [special.value for special in branch.special if special.kind == "fold"] == pytest.approx([K], rel=1e-7)
    assert branch.ended.startswith("gain reached") and not branch.orbits[-1].stable


def test_the_same_cycle_from_another_phase_on():
    """Half a period from the stick on: the slip behind it is the mirror image of the first one."""
    orbit = find_orbit(Servo(), "switch", 0.3)
    t, u, _ = rotated(orbit.problem.asked(), unknowns_of(orbit), 1)
    assert t.cycle.signature == (("stick", "breakaway-"), ("slip-", "stop"))
    assert t.durations_of(u) == pytest.approx([arc.duration for arc in orbit.arcs[::-1]], rel=1e-12)


def test_a_whole_cycle_closes_by_itself():
    half = Hunting("switch", Servo(), 0.3)
    whole = half.whole()
    assert (half.closure.repeats, whole.closure.repeats) == (2, 1) and half != whole
    assert np.array_equal(half.closure.matrix, -np.eye(3)) and np.array_equal(whole.closure.matrix, np.eye(3))
    assert "does not hunt" in half.beyond_a_fold and "does not hunt" not in whole.beyond_a_fold
    assert find_orbit(Servo(), "switch", 0.3, options=Options(half=False)).problem == whole


def test_a_kink_too_weak_for_a_boundary_is_left_inside():
    """A slide of the ring-down, of either sign, as one whose sign is left open: the same cycle, and the same again."""
    orbit = find_orbit(Servo(), "lugre", 0.3)
    problem, start = orbit.problem, unknowns_of(orbit)
    signature = orbit.signature
    for k in (len(signature) // 2, len(signature) // 2 + 1):
        resorts = other_sequences(problem.asked(), start, k, soft=True)
        softer = next(found for found in resorts if ("slide", signature[k][1]) in found[0].cycle.signature)
        assert softer[0].cycle.signature == (*signature[:k], ("slide", signature[k][1]), *signature[k + 1 :])
        assert next(expected(problem.asked(), softer))[0].cycle == start[0].cycle
        again = solve_adaptively(problem, softer, Options(tol=1e-6), solver="newton")
        assert again.status.ok and again.t.cycle == softer[0].cycle
        period = 2 * np.sum(again.t.durations_of(again.solution.u))
        assert period == pytest.approx(orbit.period, rel=2e-6)  # the tolerances of both
        firmly = [found[0].cycle.signature for found in other_sequences(problem.asked(), start, k, soft=False)]
        assert all("slide" not in dict(found) for found in firmly)
