"""The limits that continuation is bounded by: each answer changes where its limit is another one."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from test_branch import DUFFING
from test_elsewhere import BRUSSELATOR
from test_grazing_curve import DAMPED

from casahunt.collocation.solve import Solution
from casahunt.continuation import (
    bifurcations,
    branch_off,
    follow,
    recut,
    reunion,
    vanishing,
    ways_to_end,
)
from casahunt.errors import Status
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import Options, find_cycle, sequences, starts
from casahunt.orbits.orbit import unknowns_of
from problems import belt

OPTIONS = Options(tol=1e-8)


@pytest.fixture(scope="module")
def van_der_pol():
    field = {"field": lambda x, p: {"x": x.v, "v": p.mu * (1 - x.x**2) * x.v - x.x}}
    return find_cycle(System("van der Pol", ("x", "v"), {"mu": 1.0}, (Mode("smooth", **field),)), x=2.0, v=0.0)


@pytest.fixture(scope="module")
def sticking():
    """Cut where the block turns, so that the stick stands between two phases of the slip."""
    slip, stick = DAMPED.modes
    turns = Event("turns", lambda x, p: x.v / p.belt, -1, to="slip")
    system = replace(DAMPED, modes=(replace(slip, ends=(*slip.ends, turns)), stick))
    found = []
    for speed in (0.6, 0.61):
        orbit = find_cycle(system, "slip", x=0.7, v=0.59, parameters={"belt": speed})
        first = (orbit.signature.index(("slip", "turns")) + 1) % 3
        start = orbit.problem.starting_at(first, *unknowns_of(orbit))
        found.append(vanishing.solved_at(orbit.problem, start, OPTIONS))
    return found


# bifurcations.py, reunion.py


def fake(mu, period=1.0, error=0.0):
    multipliers = SimpleNamespace(trusted=True, half=np.array([1.0, mu]))
    return SimpleNamespace(multipliers=multipliers, period=period, parameter_error=error)


@pytest.mark.parametrize(
    "mus, periods, error, slope, passed",
    [
        ((0.9, 1.1), (1, 1), 0.0, 1e-3, True),
        ((0.9, 0.8), (1, 1), 0.0, 1e-3, False),  # none goes through
        ((0.9, 1 + 1e-7), (1, 2), 1e-9, 1e-3, True),  # AT_ONE: may be on either side, and the slope is sure
        ((0.9, 1 + 1e-7), (1, 2), 1e-9, 5e-9, False),  # NOISE_OF_SLOPE
        ((0.9, 1 + 1e-7), (1, 1.005), 1e-9, 5e-9, True),  # LASTS: the period stands still too
    ],
)
def test_a_slope_that_is_rounding_is_no_fold(mus, periods, error, slope, passed):
    orbits = [fake(mu, period, error) for mu, period in zip(mus, periods, strict=True)]
    point = SimpleNamespace(row=np.array([1.0, slope]))
    assert bifurcations.TURN.passed(orbits[0], point, orbits[1], point) is passed


@pytest.fixture(scope="module")
def lopsided():
    (lost,) = follow(find_cycle(DUFFING, x=0.0, v=0.0), "A", to=2.5, options=OPTIONS).special
    return branch_off(lost, "A")


@pytest.mark.parametrize(
    "before, after, met",
    [
        (1e-4, -1e-4, True),
        (3e-6, -3e-6, False),
        (1e-4, 1e-9, True),  # the step has gone over to the symmetric cycles: on which side of zero, rounding decides
        (1e-4, -1e-9, True),
        (1e-4, 5e-5, False),
        (1e-9, 1e-4, False),  # and there is no way back from where a branch begins
    ],
)
def test_what_is_hardly_lopsided_has_met_nothing(lopsided, before, after, met):
    """LOPSIDED: a symmetric cycle that is computed whole is off its image by rounding, now and then on either side."""
    half = lopsided.arcs[len(lopsided.arcs) // 2].states[0, 0]

    def off(by):
        states = lopsided.arcs[0].states.copy()
        states[0, 0, :2] = -half[:2] + [by * lopsided.scale[0], 0.0]
        return replace(lopsided, arcs=(replace(lopsided.arcs[0], states=states), *lopsided.arcs[1:]))

    assert (reunion.reunion(off(before), off(after), 1e-9) is not None) is met


# ways_to_end.py


def standing(change, period, monkeypatch, slowest=1e-9, size=1.0):
    """Two cycles, the parameter changing by so much between them."""
    monkeypatch.setattr(ways_to_end, "_slowest", lambda orbit: slowest)
    monkeypatch.setattr(ways_to_end, "ranges", lambda orbit: np.array([orbit.size]))
    problem = SimpleNamespace(value=lambda name: 1.0, distance=lambda name, value: change)
    return [SimpleNamespace(period=T, problem=problem, size=s) for T, s in ((1.0, 1.0), (period, size))]


@pytest.mark.parametrize(
    "change, period, slowest, size, stuck, said",
    [
        (1e-8, 2.0, 1e-6, 1.0, False, "homoclinic"),
        (1e-6, 2.0, 1e-6, 1.0, False, ""),  # STANDS_STILL
        (1e-6, 2.0, 1e-6, 1.0, True, "homoclinic"),
        (1e-3, 2.0, 1e-6, 1.0, True, ""),  # NEARLY_STILL
        (1e-8, 2.0, 1e-4, 1.0, False, ""),  # AT_AN_EQUILIBRIUM
        (1e-8, 2.0, 1e-4, 1.0, True, "homoclinic"),
        (1e-8, 2.0, 1e-2, 1.0, True, ""),  # NEXT_TO_ONE
        (1e-8, 0.4, 1e-9, 0.4, False, "shrink to nothing"),
        (1e-8, 0.6, 1e-9, 0.4, False, ""),  # SHRINKS, of the period
        (1e-8, 0.4, 1e-9, 0.6, False, ""),  # and of the ranges
    ],
)
def test_when_cycles_run_out(monkeypatch, change, period, slowest, size, stuck, said):
    found = ways_to_end.runs_out(*standing(change, period, monkeypatch, slowest, size), "K", stuck=stuck)
    assert said in found and bool(found) == bool(said)


def test_a_hopf_point_lies_where_the_amplitude_leads(monkeypatch):
    """Two large cycles whose squares lead elsewhere have shrunk to nothing yet; the equilibrium has its Hopf point."""
    before, last = (find_cycle(BRUSSELATOR, x=1.0, y=1.0, parameters={"b": b}) for b in (3.2, 2.9))
    assert ways_to_end.hopf_point(before, last, "b") is None
    monkeypatch.setattr(ways_to_end, "AS_FORETOLD", 10.0)
    assert ways_to_end.hopf_point(before, last, "b").value == pytest.approx(2.0, rel=1e-9)


# recut.py


def test_when_a_plane_is_left(van_der_pol, monkeypatch):
    assert recut.cut_by_planes(van_der_pol) and not recut.left_behind(van_der_pol)
    steepness = recut._steepness_of_ends(van_der_pol)
    monkeypatch.setattr(recut, "WORTH_ANOTHER", 2 * steepness)
    assert recut.left_behind(van_der_pol)
    monkeypatch.undo()
    monkeypatch.setattr(recut, "PLANE_EDGE", 0.6)
    assert recut._steepness_of_ends(van_der_pol) == 0 and recut.left_behind(van_der_pol)
    monkeypatch.undo()
    monkeypatch.setattr(recut, "BETTER", 100.0)
    assert recut.recut(van_der_pol, "mu", OPTIONS) is None
    monkeypatch.undo()
    again = recut.recut(van_der_pol, "mu", OPTIONS)
    assert again.period == pytest.approx(van_der_pol.period, rel=1e-7)
    monkeypatch.setattr(recut, "SAME_PERIOD", -1.0)
    assert recut.recut(van_der_pol, "mu", OPTIONS) is None


def test_the_middle_of_a_symmetric_cycle_is_zero(van_der_pol, monkeypatch):
    """Not rounding: a symmetry maps the plane x = 0 to itself, and no other."""
    assert 0.0 in [plane.level for plane in recut._planes(van_der_pol)]


# vanishing.py, sequences.py


def test_a_phase_vanishes_only_where_it_shrinks(sticking, monkeypatch):
    first, next_ = sticking
    short = replace(next_.arcs[1], duration=0.5 * first.arcs[1].duration)
    later = replace(next_, arcs=(next_.arcs[0], short, next_.arcs[2]))
    assert vanishing.vanishing_soon(first, next_, "belt", OPTIONS) is None  # SOON
    monkeypatch.setattr(vanishing, "solved_at", lambda problem, start, options: later)
    monkeypatch.setattr(vanishing, "touched", lambda orbit, vary, options: replace(orbit, problem=far))
    far = later.problem.with_value("belt", 0.62)
    assert vanishing.vanishing_soon(first, later, "belt", OPTIONS) is not None
    far = later.problem.with_value("belt", 0.8)  # AS_FAR: four of the last steps away
    assert vanishing.vanishing_soon(first, later, "belt", OPTIONS) is None


def test_a_shrinking_that_does_not_converge_is_given_up(sticking, monkeypatch):
    """SLOWEST: else the way to nothing would be tried in ever smaller steps for ever."""
    t, u, setting = unknowns_of(sticking[0])
    failing = Solution(u, 0.0, Status.NOT_CONVERGED, 0, 1.0, None, "newton")
    monkeypatch.setattr(vanishing, "newton", lambda *args, **how: failing)
    assert vanishing._shrunk(t, u, setting, 1, 1e-10) is None


def test_a_long_phase_is_none_that_may_vanish(sticking, monkeypatch):
    short = sticking[0]
    assert short.arcs[1].duration < 0.5 * short.arcs[0].duration
    assert short.problem.vanishing(*unknowns_of(short))[0] == 1
    assert starts.may_vanish([arc.duration for arc in short.arcs]) == 1
    assert [starts.may_vanish(durations) for durations in ([1.0], [1.0, 0.6], [0.4, 1.0])] == [None, None, 0]
    for first in range(3):
        turned = short.problem.starting_at(first, *unknowns_of(short)) if first else unknowns_of(short)
        assert (first + starts.strongest(turned)) % 3 == 0
    monkeypatch.setattr(sequences, "VANISHES_BELOW", 0.1)
    assert short.problem.vanishing(*unknowns_of(short)) is None


def test_a_motion_that_does_not_come_back_is_no_cycle(monkeypatch):
    orbit = next(belt.cycles()).orbit
    start, posed = unknowns_of(orbit), orbit.problem.asked()
    again = sequences.marched(posed, start)
    assert orbit.signature in [found[0].cycle.signature for found in again] and len(again) == 2
    monkeypatch.setattr(sequences, "RESTARTS", 1)
    assert len(sequences.marched(posed, start)) == 1
    monkeypatch.undo()
    monkeypatch.undo()
    monkeypatch.setattr(sequences, "CLOSES", 0.0)
    assert sequences.marched(posed, start) == []


def test_an_event_that_is_zero_by_rounding_is_not_crossed():
    orbit = next(belt.cycles()).orbit
    posed, mode = orbit.problem.asked(), "slip"
    p = orbit.problem.vector()
    speed = p[list(orbit.problem.names).index("belt")]
    for above, crossed in ((3e-16, False), (1e-6, True)):  # EVENT_AT_ZERO
        v = np.array([speed, speed * (1 + above), -0.5, -1.0])
        found = sequences._crossing(posed, mode, np.linspace(0, 1, 4), np.array([np.zeros(4), v]), -1.0, p)
        assert (found is not None) is crossed
