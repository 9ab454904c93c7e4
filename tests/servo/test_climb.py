"""Where the search for a fold begins: motions beside stable cycles, at gains raised as long as there is one."""

from __future__ import annotations

import math

import pytest

from casahunt import NoOrbit, Options, Servo, find_orbit
from casahunt.errors import Status
from casahunt.servo import cold_start, find_fold
from casahunt.servo import find_orbit as orbits
from casahunt.servo.cold_start import quickly_at
from casahunt.servo.event_map import near
from casahunt.servo.event_map.fixed_points import fixed_points
from casahunt.servo.event_map.half_cycle import StickMap, half_cycle
from casahunt.servo.event_map.near import BESIDE_A_CYCLE, climbed, near_stable
from problems import table1

FOLD = table1.REFERENCE["switch"]["fold"]["K"]


def rigid(gain: float) -> StickMap:
    return StickMap("switch", Servo(), gain)


def beside(gain: float):
    found = near_stable(rigid(gain), rigid(gain).typical, close=BESIDE_A_CYCLE)
    assert found is not None
    return found


@pytest.fixture
def motions(monkeypatch):
    """The motions of `near_stable`, as (gain, P/a)."""
    seen = []

    honest = StickMap.__call__

    def watched(P, a, **how):
        run = honest(P, a, **how)
        seen.append((P.gain, run.ratio))
        return run

    monkeypatch.setattr(StickMap, "__call__", watched)
    return seen


def test_motions_of_a_climb_lie_beside_stable_cycles():
    """The map to rounding has a stable fixed point where each of them foretells it, to the square of its distance."""
    places = climbed(rigid(0.05), beside(0.05))
    assert [gain for gain, _ in places][-1] > FOLD / 2
    for gain, motion in places:
        assert gain < FOLD and motion.slope < -0.1
        near = fixed_points(Servo(), gain, 0.7 * motion.fixed, 1.4 * motion.fixed, points=5).fixed
        assert near and near[-1].multiplier < 1
        assert motion.fixed == pytest.approx(near[-1].amplitude, rel=0.05)


def test_a_slope_known_from_another_gain_saves_a_motion(motions):
    known = beside(0.1)
    del motions[:]
    again = near_stable(rigid(0.1), known.fixed, close=BESIDE_A_CYCLE, slope=known.slope)
    assert again is not None and len(motions) == 1 and again.slope == known.slope


def test_a_motion_that_shrinks_shows_no_cycle_unless_it_hardly_does(motions):
    """Above the fold P < a everywhere: at 0.66 by no more than a tenth, which is beside no cycle."""
    for gain in (0.66, 0.7):
        assert near_stable(rigid(gain), 0.0016, close=BESIDE_A_CYCLE, slope=-1.5) is None
    assert motions and all(ratio < 1 for _, ratio in motions)
    assert any(ratio > math.exp(-BESIDE_A_CYCLE) for _, ratio in motions), "a case in which it matters"


def test_who_creeps_to_rest_is_not_waited_for(monkeypatch):
    """A motion above the fold creeps for 8 s; one beside a cycle moves for 0.2 s."""
    slow = half_cycle("switch", Servo(), 0.7185, 0.001577)
    assert slow.moving > 5
    assert rigid(0.7185)(0.001577, longest=2.0).position == 0
    waited = []

    def watched(*arguments, longest=math.inf, **how):
        waited.append(longest)
        return near_stable(*arguments, longest=longest, **how)

    start = beside(0.3)
    monkeypatch.setattr(near, "near_stable", watched)
    climbed(rigid(0.3), start)
    assert max(waited) < 5


def test_gains_that_are_proved_to_have_no_cycle_are_not_tried(monkeypatch, motions):
    start = beside(0.1)
    del motions[:]
    monkeypatch.setattr(near, "no_cycle", lambda servo, model, gain: "proved" if gain > 0.3 else "")
    assert [gain for gain, _ in climbed(rigid(0.1), start)] == [0.1, 0.2, pytest.approx(0.28)]
    assert all(gain <= 0.3 for gain, _ in motions)


def test_newton_is_tried_once_more_from_a_motion_that_is_closer(monkeypatch):
    seen, honest = [], cold_start._at_once

    def lost_at_first(q):
        seen.append(abs(math.log(q.beside.ratio)))
        return None if len(seen) == 1 else honest(q)

    monkeypatch.setattr(cold_start, "_at_once", lost_at_first)
    start = beside(0.3)
    found = quickly_at(Servo(), "switch", 0.3, options=Options(), beside=start)
    assert found is not None and found.half_multiplier < 1
    assert seen[0] == abs(math.log(start.ratio)) and seen[1] < near.CLOSER
    assert quickly_at(Servo(), "switch", 0.3, options=Options(solver="ipopt"), beside=start) is None
    assert len(seen) == 2


def test_of_a_bristle_a_closer_rigid_motion_says_no_more(monkeypatch):
    asked = []
    monkeypatch.setattr(cold_start, "_at_once", asked.append)
    assert quickly_at(Servo(), "lugre", 0.3, options=Options(), beside=beside(0.3)) is None and len(asked) == 1


def test_where_no_motion_can_be_computed_none_is_tried(monkeypatch):
    monkeypatch.setattr(orbits, "stiff_at", lambda *_: True)
    monkeypatch.setattr(orbits, "near_typical", lambda *_, **__: pytest.fail("it takes for ever"))
    assert find_orbit(Servo(), "switch", 0.5, branch="unstable").half_multiplier > 1


def test_lower_gains_are_tried_before_the_careful_way(monkeypatch):
    """From the highest down, quickly; then again from the highest, carefully."""
    asked = []

    def lost(*arguments, options, beside=None):
        asked.append((arguments[2], beside is not None))
        if beside is None:
            raise NoOrbit("lost", Status.NOT_CONVERGED)

    monkeypatch.setattr(find_fold, "quickly_at", lost)
    monkeypatch.setattr(find_fold, "stable_at", lost)
    monkeypatch.setattr(find_fold, "SEARCH_FACTORS", 0)
    with pytest.raises(NoOrbit, match="though the event map"):
        find_fold.find_any_orbit(Servo(), "switch", options=Options())
    half = len(asked) // 2
    assert half >= 2 and [way for _, way in asked] == [True] * half + [False] * half
    gains = [gain for gain, _ in asked[:half]]
    assert gains == sorted(gains, reverse=True) == [gain for gain, _ in asked[half:]]


@pytest.mark.parametrize("gain", [0.05, 0.4])
def test_the_unstable_cycle_from_next_to_the_fold(monkeypatch, orbit, gain):
    """The same as from inside the stable cycle, and from that cycle itself, which is not computed otherwise."""
    direct = orbit("switch", gain, "unstable")
    monkeypatch.setattr(orbits, "inner_cycle", lambda *_: None)
    with monkeypatch.context() as patch:
        patch.setattr(orbits, "stable_at", lambda *_, **__: pytest.fail("it is not asked for"))
        next_to_it = find_orbit(Servo(), "switch", gain, branch="unstable", options=Options(tol=1e-9))
        assert next_to_it.gain == gain
        assert next_to_it.amplitude == pytest.approx(direct.amplitude, rel=3e-9)
    monkeypatch.setattr(orbits, "near_typical", lambda *_, **__: None)
    round_it = find_orbit(Servo(), "switch", gain, branch="unstable", options=Options(tol=1e-9))
    assert round_it.amplitude == pytest.approx(direct.amplitude, rel=3e-9)
    assert round_it.period == pytest.approx(direct.period, rel=3e-9)


def test_ipopt_alone_goes_the_long_way(monkeypatch):
    monkeypatch.setattr(orbits, "climbed", lambda *_, **__: pytest.fail("Newton's method starts it"))
    found = find_orbit(Servo(), "switch", 0.6, branch="unstable", options=Options(solver="ipopt"))
    assert found.half_multiplier > 1
