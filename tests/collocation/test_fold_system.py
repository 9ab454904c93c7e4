"""How far Newton's method goes along a curve to where its slope vanishes, on curves known in closed form."""

from __future__ import annotations

import numpy as np
import pytest

from casahunt.collocation.newton import LARGEST_WAY, MOST_TURNS, Turn

ONE = np.zeros(1, int)


def gone(turn, slope, a, *, off=0.0, length=1.0):
    """The place after one step from a, Newton's step there being `off`."""
    return a + float(turn.way(ONE, np.array([off]), np.array([length]), np.array([slope(a)]))[0])


@pytest.mark.parametrize("bend", [-2.0, -0.2, -200.0, -np.inf, np.nan])
def test_the_slope_of_a_cubic_vanishes(bend):
    """lambda = -a^2 + a^3/3 from a = 0.05; both of its turns are known, and that at 2 is the other kind."""
    turn, a = Turn(np.array([bend])), 0.05
    for _ in range(MOST_TURNS):
        a = gone(turn, lambda a: -2 * a + a**2, a)
    assert abs(a) < 1e-12 and turn.bend[0] == pytest.approx(-2.0, rel=1e-3)


def test_an_extremum_of_the_other_kind_is_none():
    turn, a = Turn(np.array([-np.inf])), 2.05
    a = gone(turn, lambda a: -2 * a + a**2, a)
    assert np.isnan(gone(turn, lambda a: -2 * a + a**2, a))


def test_slopes_beside_the_curve_are_not_compared():
    """Met on the way to a fold: 7 % of a way off the curve, the slopes differ by less than what that changes."""
    turn = Turn(np.array([-0.0733]))
    for off, slope in ((2.76e-4, -2.0003e-4), (2.96e-5, -1.979e-4)):
        way = turn.way(ONE, np.array([off]), np.array([1.44]), np.array([slope]))
    assert turn.bend[0] == -0.0733 and way[0] == pytest.approx(-1.979e-4 / 0.0733)


def test_a_bend_that_misses_is_told_again_at_the_same_place():
    """Ten times too small: after the way the slope is as large as before, and no way is gone until Newton's step is."""
    turn, slope = Turn(np.array([-0.2])), lambda a: -2 * a
    a = gone(turn, slope, 0.004)
    assert gone(turn, slope, a, off=1e-2) == a
    assert abs(gone(turn, slope, a, off=1e-6)) < 1e-12


def test_no_way_is_long_and_none_is_gone_beside_the_curve():
    turn = Turn(np.array([-1e-9, -1e-9]))
    way = turn.way(np.arange(2), np.array([0.0, 0.2]), np.array([4.0, 1.0]), np.array([1.0, 1.0]))
    assert way.tolist() == [LARGEST_WAY / 4, 0.0]
