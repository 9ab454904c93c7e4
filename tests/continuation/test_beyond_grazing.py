"""What is accepted of two cycles next to each other, and where it is not; cycles made by hand."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from casahunt import Options, Servo, find_orbit
from casahunt.continuation import beyond_grazing, follow, vanishing
from casahunt.continuation.curve import solved_at
from casahunt.continuation.poincare_section import same_events
from casahunt.hybrid import Event, Mode, System
from casahunt.orbits import find_cycle
from casahunt.orbits.orbit import unknowns_of
from casahunt.orbits.simulated_phases import rotated


def sampled(period=2.0, x=(1.0, -1.0), v=(3.0, 0.0)):
    """A cycle of two states with these extremes."""
    states = np.array([[x[0], x[1], 0.0], [v[0], v[1], 1.0]])
    named = SimpleNamespace(states=("x", "v"))
    problem = SimpleNamespace(vocabulary=lambda _: named)
    return SimpleNamespace(period=period, problem=problem, cycle=named, sample=lambda: (np.zeros(3), states))


@pytest.mark.parametrize(
    ("other", "alike"),
    [
        ({}, True), ({"period": 2.09}, True), ({"period": 2.11}, False), ({"period": 1.89}, False),
        ({"x": (1.09, -1.09)}, True), ({"x": (1.11, -1.0)}, False), ({"x": (1.0, -0.89)}, False),
        ({"v": (3.14, 0.14)}, True), ({"v": (3.0, 0.16)}, False), ({"v": (-3.0, 0.0)}, False),
    ],
)  # fmt: skip
def test_a_cycle_behind_a_grazing_is_nearly_the_same(other, alike):
    """A twentieth of the period, and of the range of every state; all else is another branch."""
    assert beyond_grazing._alike(sampled(), sampled(**other)) is alike


@pytest.mark.parametrize(
    ("before", "after", "same", "shrinks"),
    [
        ((4.0, 5.0), (1e-6, 5.0), True, True), ((4.0, 5.0), (3.9, 5.0), True, False),
        ((1e-6, 5.0), (1e-7, 5.0), True, False), ((4.0, 5.0), (5.0, 1e-6), True, False),
        ((4.0, 5.0), (1e-6, 5.0), False, False),
    ],
)  # fmt: skip
def test_a_first_phase_that_has_become_short(monkeypatch, before, after, same, shrinks):
    monkeypatch.setattr(vanishing, "beside_the_plane", lambda orbit: np.inf)

    def orbit(durations, signature):
        arcs = [SimpleNamespace(duration=duration) for duration in durations]
        return SimpleNamespace(arcs=arcs, problem=SimpleNamespace(), signature=signature)

    assert vanishing.first_shrinks(orbit(before, "phases"), orbit(after, "phases" if same else "others")) is shrinks


@pytest.mark.parametrize("first", [0, 1])
def test_the_other_half_of_a_cycle_is_no_other_one(first):
    """Slip and stick of one direction, then those of the other; and a cycle that only slips has other events."""
    asked = Options(tol=1e-8)
    orbit = find_orbit(Servo(), "switch", 0.04)
    other = solved_at(orbit.problem, rotated(orbit.problem.asked(), unknowns_of(orbit), 1), asked)
    assert len({*orbit.signature, *other.signature}) == 3 and other.period == pytest.approx(orbit.period, rel=1e-6)
    assert same_events(*((orbit, other) if first else (other, orbit)))
    assert not same_events(orbit, find_orbit(Servo(), "lugre", 0.04))


TWO_LIMITS = System(
    "two limits", states=("x", "y"), parameters={"limit": 3.0},
    modes=(
        Mode("rise", field=lambda x, p: {"x": 1.0, "y": 2.0},
             ends=(Event("top", lambda x, p: x.x - 1, +1, to="rise", reset=lambda x, p: {"x": 0.0, "y": 0.0}),
                   Event("limit", lambda x, p: x.y / p.limit - 1, +1, to="stand"))),
        Mode("stand", field=lambda x, p: {"x": 0.0, "y": 0.0}),
    ),
)  # fmt: skip
"""x rises to 1 and y to 2 in the same time; below 2, y is at its limit first, and nothing moves any more."""


def test_where_two_events_are_met_at_once():
    branch = follow(find_cycle(TWO_LIMITS, x=0.1, y=0.2), "limit", to=1.0)
    assert branch.end.kind == "grazing" and "two events are met at once" in str(branch.end)
    assert branch.end.value == pytest.approx(2.0, rel=1e-12) and branch.values.min() >= 2 - 1e-12
    assert branch.end.error < 1e-6


def test_an_end_that_was_not_located_is_known_to_fewer_digits(monkeypatch):
    """As if the place at which two events are met could not be found: its error covers how far the last cycle is."""
    monkeypatch.setattr(beyond_grazing, "corner_at", lambda *_: None)
    branch = follow(find_cycle(TWO_LIMITS, x=0.1, y=0.2), "limit", to=1.0)
    assert branch.end.kind == "grazing" and "met with no speed" in str(branch.end)
    assert 1e-5 < branch.end.error < 1e-4 and abs(branch.end.value - 2) < branch.end.error
