"""Where the search for a fold begins: motions beside stable cycles, at gains raised as long as there is one."""

from __future__ import annotations

import math

import pytest
from map_support import watched

from casahunt import Options, Servo, find_orbit
from casahunt.servo import find_orbit as orbits
from casahunt.servo.event_map.fixed_points import fixed_points
from casahunt.servo.event_map.half_cycle import StickMap, half_cycle
from casahunt.servo.event_map.secant_search import BESIDE_A_CYCLE, climbed, near_stable
from problems import table1

FOLD = table1.REFERENCE["switch"]["fold"]["K"]


def rigid(gain: float) -> StickMap:
    return StickMap("switch", Servo(), gain)


def beside(gain: float):
    found = near_stable(rigid(gain), rigid(gain).typical, close=BESIDE_A_CYCLE)
    assert found is not None
    return found


def test_motions_of_a_climb_lie_beside_stable_cycles():
    """The map to rounding has a stable fixed point where each of them foretells it, to the square of its distance."""
    places = climbed(rigid(0.05), beside(0.05))
    assert [gain for gain, _ in places][-1] > FOLD / 2
    for gain, motion in places:
        assert gain < FOLD and motion.slope < -0.1
        near = fixed_points(Servo(), gain, 0.7 * motion.fixed, 1.4 * motion.fixed, points=5).fixed
        assert near and near[-1].multiplier < 1
        assert motion.fixed == pytest.approx(near[-1].amplitude, rel=0.05)


def test_a_slope_known_from_another_gain_saves_a_motion():
    known = beside(0.1)
    P, motions = watched(rigid(0.1))
    again = near_stable(P, known.fixed, close=BESIDE_A_CYCLE, slope=known.slope)
    assert again is not None and len(motions) == 1 and again.slope == known.slope


def test_a_motion_that_shrinks_shows_no_cycle_unless_it_hardly_does():
    """Above the fold P < a everywhere: at 0.66 by no more than a tenth, which is beside no cycle."""
    ratios = []
    for gain in (0.66, 0.7):
        P, motions = watched(rigid(gain))
        assert near_stable(P, 0.0016, close=BESIDE_A_CYCLE, slope=-1.5) is None
        ratios += [run.ratio for _, _, run, _ in motions]
    assert ratios and max(ratios) < 1
    assert max(ratios) > math.exp(-BESIDE_A_CYCLE), "a case in which it matters"


def test_who_creeps_to_rest_is_not_waited_for():
    """A motion above the fold creeps for 8 s; one beside a cycle moves for 0.2 s."""
    slow = half_cycle("switch", Servo(), 0.7185, 0.001577)
    assert slow.moving > 5
    assert rigid(0.7185)(0.001577, longest=2.0).position == 0
    P, motions = watched(rigid(0.3))
    climbed(P, beside(0.3))
    assert motions and max(longest for *_, longest in motions) < 5


def test_where_no_motion_can_be_computed_none_is_tried(monkeypatch):
    """Patched: a servo whose motions take for ever would take as long where they were tried."""
    monkeypatch.setattr(orbits, "stiff_at", lambda *_: True)
    assert find_orbit(Servo(), "switch", 0.5, branch="unstable").half_multiplier > 1


@pytest.mark.parametrize("gain", [0.05, 0.4])
def test_the_unstable_cycle_from_next_to_the_fold(monkeypatch, orbit, gain):
    """The same as from inside the stable cycle, and from that cycle itself.

    Patched: ways that are quicker and always arrive here, so that the next one is gone.
    """
    direct = orbit("switch", gain, "unstable")
    monkeypatch.setattr(orbits, "inner_cycle", lambda *_: None)
    next_to_it = find_orbit(Servo(), "switch", gain, branch="unstable", options=Options(tol=1e-9))
    assert next_to_it.gain == gain
    assert next_to_it.amplitude == pytest.approx(direct.amplitude, rel=3e-9)
    monkeypatch.setattr(orbits, "near_typical", lambda *_, **__: None)
    round_it = find_orbit(Servo(), "switch", gain, branch="unstable", options=Options(tol=1e-9))
    assert round_it.amplitude == pytest.approx(direct.amplitude, rel=3e-9)
    assert round_it.period == pytest.approx(direct.period, rel=3e-9)
