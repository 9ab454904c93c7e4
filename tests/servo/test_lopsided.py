"""servo/lopsided.py: pairs that branch off where the half multiplier passes -1, against maps by Taylor series.

The gains of their special points stand in problems/canudas_gain.py, by Taylor series too.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from casahunt import NoOrbit, Options, Servo, diagram, find_orbit, load_orbit, save_orbit, with_lopsided
from problems import canudas_gain, canudas_servo
from problems.taylor import lugre_half_cycle, switch_half_cycle

CANUDAS = canudas_servo.servo()


@pytest.mark.slow
def test_two_swings_of_the_switch_servo():
    """P(a) = b and P(b) = a, by Taylor series, the swings lasting as long as the cycle's halves."""
    orbit = find_orbit(CANUDAS, "switch", 46.5, branch="lopsided", options=Options(tol=1e-9))
    sticks = [arc for arc in orbit.arcs if arc.mode == "stick"]
    a, b = (abs(arc.end[0]) for arc in sticks)
    assert orbit.gain == 46.5 and orbit.repeats == 1 and abs(a / b - 1) > 0.01 and len(sticks) == 2
    (first, time_1, _), (second, time_2, _) = (switch_half_cycle(CANUDAS, 46.5, x) for x in (a, b))
    assert [first, second] == pytest.approx([b, a], rel=1e-8)
    assert orbit.amplitude == pytest.approx(max(a, b), rel=1e-12)
    assert time_1 + time_2 == pytest.approx(orbit.period, rel=1e-8)
    h = 1e-5
    ends = [switch_half_cycle(CANUDAS, 46.5, a * by)[0] for by in (1 - h, 1 + h)]
    slope = np.diff([switch_half_cycle(CANUDAS, 46.5, end)[0] for end in ends])
    assert orbit.multipliers.full[1].real == pytest.approx(slope[0] / (2 * h * a), rel=1e-3)


@pytest.mark.slow
def test_the_lugre_servo_where_its_symmetric_cycle_is_unstable(tmp_path):
    """Two half cycles by Taylor series lead back; what is off comes back smaller by the multiplier."""
    symmetric = find_orbit(CANUDAS, "lugre", 48.44)
    orbit = find_orbit(CANUDAS, "lugre", 48.44, branch="lopsided", options=Options(tol=1e-9))
    assert symmetric.half_multiplier < -1 and not symmetric.stable and orbit.stable and orbit.gain == 48.44
    k = next(k for k, arc in enumerate(orbit.arcs) if arc.event == "centre")
    x, sign = orbit.arcs[k].end, np.sign(orbit.arcs[k].end[1])
    middle, first, _ = lugre_half_cycle(CANUDAS, 48.44, x, sign)
    back, second, _ = lugre_half_cycle(CANUDAS, 48.44, middle, -sign)
    assert np.max(np.abs(middle + x) / orbit.scale) > 1e-4  # no image of its own
    assert np.max(np.abs(back - x) / orbit.scale) < 1e-7
    assert first + second == pytest.approx(orbit.period, rel=1e-7)
    save_orbit(orbit, tmp_path / "orbit.npz")
    loaded = load_orbit(tmp_path / "orbit.npz")
    assert loaded.repeats == 1 and loaded.problem == orbit.problem and loaded.period == orbit.period


@pytest.mark.slow
def test_below_the_loss_of_symmetry_the_pair_comes_back_round_its_fold():
    """At 47.99 the symmetric cycle is stable; the pair that branches off above leads there first, unstable."""
    orbit = find_orbit(CANUDAS, "lugre", 47.99, branch="lopsided")
    assert canudas_gain.LOPSIDED_FOLD < orbit.gain == 47.99 < canudas_gain.FLIPS[0]
    assert orbit.multipliers.full[1].real > 1
    with pytest.raises(NoOrbit, match="does not prove"):
        find_orbit(CANUDAS, "lugre", 47.9, branch="lopsided")


@pytest.mark.slow
def test_the_pair_of_a_branch():
    branch = diagram(CANUDAS, "lugre", start=47.0, options=Options(tol=1e-7))
    whole = with_lopsided(branch, options=Options(tol=1e-7))
    (pair,) = whole.lopsided  # it meets the symmetric cycle at the other point: there no second one begins
    assert not whole.missed and not pair.missed and "own image" in pair.ended
    kinds = [special.kind for special in pair.special]
    assert kinds == ["fold", "flip", "flip", "symmetry breaking"]
    found = [special.orbit.gain for special in pair.special]
    expected = [canudas_gain.LOPSIDED_FOLD, *canudas_gain.FLIPS, canudas_gain.BREAKING[1]]
    assert found == pytest.approx(expected, rel=1e-7)  # the branch's tolerance
    assert "does not hunt" not in pair.special[0].meaning
    table = whole._columns()
    assert list(table)[-1] == "lopsided"
    others = len(pair.special) - 1  # the last one is the symmetric cycle that it meets
    assert sum(number == 1 for number in table["lopsided"]) == len(pair.orbits) + others
    assert replace(whole, lopsided=()).values.tolist() == branch.gains.tolist()


def test_a_cycle_that_keeps_its_symmetry():
    with pytest.raises(NoOrbit, match="was not seen to lose its symmetry"):
        find_orbit(Servo(), "switch", 0.5, branch="lopsided")
