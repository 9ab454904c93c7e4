"""Many solutions on meshes of parts, corrected at once, against one by one; multipliers of many orbits."""

from __future__ import annotations

from dataclasses import replace
from functools import cache

import numpy as np
import pytest

from casahunt.collocation import batched_newton
from casahunt.collocation.batched_newton import Member, solve_batch
from casahunt.collocation.mesh import divided
from casahunt.collocation.newton import newton
from casahunt.hybrid.examples import ball, belt
from casahunt.orbits import Orbit, find_cycle
from casahunt.orbits.batched_multipliers import know_multipliers
from casahunt.orbits.multiplier_mesh import NO_STEP
from casahunt.orbits.orbit import unknowns_of
from casahunt.orbits.simulated_phases import rotated
from problems import impact_oscillator


@cache
def sliding(speed: float, tol: float = 1e-4) -> Orbit:
    """A block on a belt that runs at this speed: slips, and sticks in closed form."""
    return find_cycle(belt, "slip", parameters={"belt": speed}, tol=tol, x=0.0, v=0.0)


@cache
def striking() -> Orbit:
    """An oscillator whose velocity jumps at a wall."""
    start = {"x": 0.0, "v": 0.0}
    return find_cycle(impact_oscillator.SYSTEM, tol=1e-5, parameters={"w": 1.0, "d": 1.0}, start=start)


def member(orbit: Orbit, seed: int = 0, most: int = 4, finer: int = 1, held: bool = False) -> Member:
    """Every interval of an orbit's mesh in some parts, drawn; the parameter is held, or the first node in some way.

    From a mesh that is `finer` than the orbit's.
    """
    t, u, setting = unknowns_of(orbit)
    if orbit.arcs[0].mode == "slip":  # where it breaks away nothing moves with the parameter: from the stick on
        t, u, setting = rotated(orbit.problem.asked(), (t, u, setting), 1)
    t, u, fractions = divided(t, u, setting.fractions, np.full(t.intervals, finer))
    setting = replace(setting, fractions=fractions)
    rng = np.random.default_rng(seed)
    parts, weights = rng.integers(1, most + 1, t.intervals), np.zeros((t.phases + 1, t.n))
    weights[0] = rng.standard_normal(t.n)
    border = t.system.border(nodes=weights, parameter=0.0) if held else t.system.border(parameter=1.0)
    return Member(t, u, setting, parts, border)


def shaken(one: Member, size: float = 1e-4) -> Member:
    """Away from the solution."""
    return replace(one, u=one.u * (1 + size * np.random.default_rng(5).standard_normal(one.u.size)))


def assert_one_by_one(members: list[Member]) -> None:
    """What is found in a batch is what Newton's method finds, on a mesh with a node system of its own."""
    for one, found in zip(members, solve_batch(members, NO_STEP), strict=True):
        t, u, setting = one.place()
        alone = newton(t, u, setting, border=one.border, accuracy=NO_STEP)
        assert found is not None and alone.status.ok
        same, v, other = found.place()
        assert same == t
        setting = setting.moved(alone.parameter)
        np.testing.assert_allclose(other.p, setting.p, rtol=1e-11, atol=1e-11)
        np.testing.assert_array_equal(other.fractions, setting.fractions)
        np.testing.assert_allclose(v, alone.u, rtol=1e-11, atol=1e-11)
        lin = t.linearise(v, setting)
        assert lin.residual_norm() < 1e-11
        np.testing.assert_allclose(found.maps[:, :, 1:], lin.maps[:, :, 1:], rtol=1e-9, atol=1e-10)
        np.testing.assert_allclose(found.events[1:], lin.events[1:], rtol=1e-9, atol=1e-10)
        np.testing.assert_array_equal(found.closure, lin.closure)


def test_meshes_of_their_own():
    assert_one_by_one([member(sliding(0.1), 1), member(sliding(0.3), 2, finer=2), member(sliding(0.25), 3, finer=3)])


def test_starts_some_way_off():
    """Each takes as many steps as it needs."""
    assert_one_by_one([member(sliding(0.1)), shaken(member(sliding(0.3))), shaken(member(sliding(0.25)), 1e-2)])


def test_a_parameter_that_is_free():
    """Next to a fold it must move."""
    members = [member(sliding(0.1), 1, held=True), member(sliding(0.3), 2), member(sliding(0.25), 3, held=True)]
    assert_one_by_one(members)
    found = solve_batch(members, NO_STEP)
    assert [one is not None and one.parameter != 0 for one in found] == [True, False, True]


def test_states_that_jump():
    orbit = striking()
    assert any(phase.reset for phase in orbit.cycle.phases)
    assert_one_by_one([member(orbit, seed) for seed in range(3)])


def test_more_intervals_than_are_eliminated_at_once(monkeypatch):
    """Patched: so many take seconds."""
    monkeypatch.setattr(batched_newton, "INTERVALS_AT_ONCE", 16)
    members = [member(sliding(0.1), 1, most=8), member(sliding(0.3), 2, most=8)]
    assert all(one.parts.sum() % batched_newton.ROUND_UP for one in members)
    assert_one_by_one(members)


def test_what_is_lost_is_none_and_disturbs_no_one():
    """Next to a solution: a start far from any, and one that is no number."""
    good = member(sliding(0.2))
    far = good.u.copy()
    far[: good.t.intervals * good.t.rows] += np.random.default_rng(3).standard_normal(good.t.intervals * good.t.rows)
    wrong = [replace(good, u=u) for u in (far, np.full(good.u.size, np.nan))]
    found = solve_batch([good, *wrong, good], NO_STEP)
    assert [one is None for one in found] == [False, True, True, False]
    np.testing.assert_allclose(found[0].nodes, solve_batch([good], NO_STEP)[0].nodes, rtol=1e-13, atol=1e-13)


def test_phases_last_longer_than_nothing():
    good = member(sliding(0.2))
    rows = batched_newton._Rows([good, good])
    at = rows.begun()
    at.T[:2] *= -1
    assert not batched_newton._is_solution(at, rows, 0, at.X[rows.nodes_of(0)])
    assert batched_newton._is_solution(at, rows, 1, at.X[rows.nodes_of(1)])


def test_a_step_to_phases_that_last_less_than_nothing(monkeypatch):
    """Is not gone on from, although the next would lead back.  Patched: the first step of one member."""
    step, steps = batched_newton._Rows.step, []

    def overshooting(self, lin):
        by = step(self, lin)
        steps.append(len(self.members))
        if len(steps) == 1:
            by.T[:2] -= 2 * unknowns_of(sliding(0.2))[1][-2:]
        return by

    monkeypatch.setattr(batched_newton._Rows, "step", overshooting)
    found = solve_batch([member(sliding(0.2))] * 2, NO_STEP)
    assert [one is None for one in found] == [True, False] and set(steps[1:]) == {1}


def test_stages_that_cannot_be_eliminated(monkeypatch):
    """Patched: rounding leaves no matrix of stages singular."""

    def singular(*_):
        raise np.linalg.LinAlgError

    monkeypatch.setattr(batched_newton._Rows, "_eliminated", singular)
    assert solve_batch([member(sliding(0.2))] * 2, NO_STEP) == [None, None]


def test_multipliers_of_many_are_those_of_each():
    """And nothing is done for those that are known, or whose solver is another one."""
    orbits = [replace(sliding(0.2)), replace(sliding(0.3)), replace(sliding(0.25), solver="ipopt")]
    known = orbits[1].multipliers
    alone = [replace(orbit).multipliers for orbit in orbits]
    know_multipliers(orbits)
    assert orbits[1].multipliers is known
    for orbit, other in zip(orbits, alone, strict=True):
        found = vars(orbit)["multipliers"]
        np.testing.assert_allclose(found.half, other.half, rtol=1e-9, atol=1e-12)
        assert found.error == pytest.approx(other.error, rel=0.1, abs=1e-11)


def test_a_cycle_without_intervals_is_left_to_others():
    orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    t, u, setting = unknowns_of(orbit)
    assert t.intervals == 0
    found = solve_batch([Member(t, u, setting, np.zeros(0, int), t.system.border(parameter=1.0))], NO_STEP)
    assert found == [None]
    assert orbit.multipliers.trusted
