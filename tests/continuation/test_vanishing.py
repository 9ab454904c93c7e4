"""Cycles that pass an event by less than counts, next to a grazing contact: problems/canudas_gain.py, whose reversal
dies.

The grazes, K = 13.58113302 and K = 3.333948552, are those that walks at tolerances of 1e-7 to 1e-9, from either side,
agree upon to ten digits; tests/problems checks the first one against another integrator.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from casahunt.continuation import follow, vanishing
from casahunt.continuation.special_points import GRAZING
from casahunt.continuation.vanishing import _on_the_way, change_of_phases, solved_at
from casahunt.continuation.walk import walk, walk_to_end
from casahunt.hybrid.examples import belt
from casahunt.orbits import Options, find_cycle
from casahunt.orbits.bordering import with_other_phases
from casahunt.orbits.orbit import unknowns_of
from casahunt.orbits.simulated_phases import rotated
from problems import canudas_gain

OPTIONS = Options(tol=canudas_gain.TOL)
DIES, IS_BORN = 13.58113302, 3.333948552


def at(K: float):
    parameters = {"K": K}
    return find_cycle(canudas_gain.SYSTEM, "backwards", tol=1e-7, parameters=parameters, x=1.0, v=0.0, w=0.0, z=0.0)


@pytest.fixture(scope="module")
def keeps_clear():
    """One phase, a little beyond the contact at which the reversal dies."""
    return at(13.6)


@pytest.mark.parametrize("K", [13.579, 13.57, 13.5])
def test_a_cycle_beyond_a_touch_has_its_reversal(keeps_clear, K):
    """The velocity comes below zero by less than the slack of the mode: one phase is a root there, and no cycle."""
    orbit = solved_at(keeps_clear.problem.with_value("K", K), unknowns_of(keeps_clear), OPTIONS)
    assert len(keeps_clear.arcs) == 1 and len(orbit.arcs) == 3
    # From a grazing contact on the duration of what is born goes like a square root.
    shortest = min(arc.duration for arc in orbit.arcs)
    assert shortest == pytest.approx(2.93e-3 * np.sqrt(DIES - K), rel=0.1)


def test_a_touch_far_from_the_last_cycle_is_come_to_by_steps(keeps_clear):
    """The reversal that dies is the last phase of the half cycle, and too long to be shrunk at once."""
    before = at(12.847)
    start = rotated(before.problem.asked(), unknowns_of(before), 2)  # the half cycle from its long phase on
    before = solved_at(before.problem, start, OPTIONS)
    assert len(before.arcs) == 3 and np.argmin([arc.duration for arc in before.arcs]) == 2
    contact = change_of_phases(before, keeps_clear, "K", OPTIONS)
    assert contact.problem.value("K") == pytest.approx(DIES, rel=1e-8)
    back = change_of_phases(keeps_clear, before, "K", OPTIONS)
    assert back.problem.value("K") == pytest.approx(DIES, rel=1e-8)


def test_a_touch_hangs_on_no_mesh():
    """A mesh of another cycle can be off by half a per cent of K."""
    before = at(13.4)
    contact = vanishing.orbit_at_contact(before, "K", OPTIONS)
    assert contact is not None and contact.problem.value("K") == pytest.approx(DIES, rel=1e-8)


@pytest.mark.parametrize("largest_step", [None, pytest.param(0.03, marks=pytest.mark.slow)])
def test_a_reversal_that_is_born_within_the_slack(largest_step):
    """Behind the fold the slack is 5 % of K wide: no step leads on from its edge with the phases of before."""
    branch = follow(at(44.0), "K", to=100.0, back=3.4, options=OPTIONS, monitors=())
    last = branch.orbits[-1]
    assert len(last.arcs) == 1
    on = follow(last, "K", to=3.1, options=OPTIONS, monitors=(GRAZING,), largest_step=largest_step)
    (born,) = on.special
    assert on.values[-1] == 3.1 and len(on.orbits[-1].arcs) == 3
    assert born.value == pytest.approx(IS_BORN, rel=1e-8)


def cycle(K: float, phases: int):
    return SimpleNamespace(problem=SimpleNamespace(value=lambda name: K), arcs=("arc",) * phases)


@pytest.mark.parametrize(("contact", "phases", "taken"), [
    (0.5, 1, True), (0.5, 3, True),  # between the two
    (1.01, 1, True), (1.01, 3, False), (5.0, 1, False), (-2.5, 1, False),
])  # fmt: skip
def test_which_touch_is_that_between_two_orbits(contact, phases, taken):
    """Beyond the cycle with fewer phases only next to it, and with as many phases."""
    assert _on_the_way(cycle(0.0, 3), cycle(contact, phases), cycle(1.0, 1), "K") is taken
    assert _on_the_way(cycle(1.0, 1), cycle(contact, phases), cycle(0.0, 3), "K") is taken


@pytest.mark.parametrize(("weights", "after", "left"), [
    ([0.6, 0.8, 0.0], 1.05, [0.6, 0.8, 0.0]),  # the same first phase
    ([0.6, 0.8, 0.0], 0.5, [0.6, 0.0, 0.0]), ([0.0, 0.6, 0.8], 2.0, [0.0, 0.0, 0.8]),
    ([0.01, 1.0, 0.01], 0.5, [0.01, 1.0, 0.01]),  # a canard: there is nothing else
])  # fmt: skip
def test_what_a_direction_says_with_other_phases(weights, after, left):
    np.testing.assert_array_equal(with_other_phases(np.array(weights), 1.0, after), left)


def test_a_walk_that_stands_at_the_end_of_its_range_is_over():
    start = find_cycle(belt, "slip", x=0.0, v=0.0)
    orbits, said = walk_to_end(walk(start, vary="belt", low=0.2, high=0.22))
    again, once_more = walk_to_end(walk(orbits[-1], vary="belt", low=0.2, high=0.22, previous=start))
    assert said == once_more == "belt reached 0.22, the end of the range" and not again
