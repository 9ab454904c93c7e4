"""Steps to the likeliest unknowns, on deviances made by hand: their ends, narrow valleys, what is hardly known."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from casahunt.design.identify import climb as climbing
from casahunt.design.identify import fit as fitting
from casahunt.design.identify import intervals
from casahunt.design.identify.climb import climb
from casahunt.design.identify.fit import Point
from casahunt.design.identify.likelihood import Rows


def test_a_step_is_the_best_that_goes_below_no_end():
    """Against the best of all choices of what stays at its end, in 200 random problems; one parameter is held.

    What is clamped at once, because it would go too far while the others are free, may not belong there: the deviance
    was then expected to rise, and a climb had ended that had not.
    """
    rng = np.random.default_rng(3)
    for _ in range(200):
        A, z, ends = rng.standard_normal((6, 5)), rng.uniform(0, 1, 5), rng.uniform(-0.5, 0, 4)
        H, g, gains = A.T @ A, 3 * rng.standard_normal(5), []
        for ended in itertools.product([False, True], repeat=3):
            dz, free = np.array([*ends[:3] * ended, 0.1, 0.0]), np.array([not each for each in ended] + [False, True])
            dz[free] = np.linalg.solve(H[np.ix_(free, free)], g[free] - H[np.ix_(free, ~free)] @ dz[~free])
            if np.all(dz[:3] >= ends[:3]):
                gains.append(2 * g @ dz - dz @ H @ dz)
        point = Point(z, z[:4] + ends, np.ones(4), (), (), 0.0, g, H, ())
        dz = climbing.step(point, climbing.LEAST_DAMPING, 3, 0.1)
        assert np.all(dz[:3] >= ends[:3] - 1e-12) and dz[3] == 0.1
        assert climbing.gain(point, dz) == pytest.approx(max(gains), rel=1e-9, abs=1e-9)


def test_steps_that_go_back_are_shorter(monkeypatch):
    """What the curvature leaves out is 0.9 of it, so each step overshoots by nine tenths: it took 27."""
    evaluated = []

    def at(question, z, noises, near=None, *, stretched=False):
        evaluated.append(z)
        x, y = z - 5
        r = 10 * np.array([x, 0.45 + x * x, y - x])
        J = 10 * np.array([[1.0, 0.0], [2 * x, 0.0], [-1.0, 1.0]])
        return Point(z, np.full(2, -1e9), np.ones(2), (), (), float(r @ r), -J.T @ r, J.T @ J, ())

    monkeypatch.setattr(climbing, "at", at)
    found = climb(None, at(None, np.array([5.3, 5.3]), ()), (), settled=1e-9)
    assert found.z == pytest.approx([5.0, 5.0], abs=1e-4) and len(evaluated) < 24


def in_a_bent_valley(question, z, noises, near=None, *, stretched=False):
    """The bottom is y = x^2, of a width of 1e-3, and falls by 1 on the way to its end at x = 5."""
    x, y = z
    r, weights = np.array([y - x**2, x - 5.0]), np.array([1e6, 0.03])
    J = np.array([[-2 * x, 1.0], [1.0, 0.0]])
    rows = (Rows(float(r @ (weights * r)), r, -weights * r, weights, J),)
    H = J.T @ (weights[:, None] * J)
    steps = np.array([1.0, 100.0])
    return Point(z, np.full(2, -1e9), steps, (), (), rows[0].deviance, J.T @ rows[0].score, H, (), rows)


def test_a_step_goes_along_the_bottom_of_a_bent_valley():
    """Exactly, where it is bent as a parabola; straight where that is bent by more than the step, or not computed."""
    point = in_a_bent_valley(None, np.array([1.0, 1.0]), ())
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(climbing, "at", in_a_bent_valley)
        straight = climbing.step(point, 1e-13)
        bent = climbing._bent(None, point, straight, (), None, False)
        x, y = np.array([1.0, 1.0]) + bent
        assert straight == pytest.approx([4.0, 8.0], rel=1e-2) and y == pytest.approx(x**2, rel=1e-3)
        patch.setattr(climbing, "at", lambda *a, **k: None)
        assert climbing._bent(None, point, straight, (), None, False) is straight
        patch.setattr(climbing, "at", in_a_bent_valley)
        short = replace(point, steps=np.array([1.0, 4.0]))
        assert climbing._bent(None, short, straight, (), None, False) is straight


def test_the_way_along_a_bent_valley_is_short(monkeypatch):
    """Straight steps, which are restored across the valley, need three times as many evaluations."""
    evaluations = {}
    for bent in (True, False):
        called = evaluations[bent] = []
        monkeypatch.setattr(climbing, "at", lambda *a, called=called, **k: called.append(a) or in_a_bent_valley(*a))
        if not bent:
            monkeypatch.setattr(climbing, "_bent", lambda question, point, dz, *rest: dz)
        found = climb(None, in_a_bent_valley(None, np.array([1.0, 1.0]), ()), (), settled=1e-6, most=10_000)
        assert found.z == pytest.approx([5.0, 25.0], rel=2e-3)
    assert 3 * len(evaluations[True]) < len(evaluations[False])


def test_a_step_outwards_leaves_behind_what_is_hardly_known():
    """A deviance that hardly depends on z_1, which would go 1e4 times as far as z_0: it stays, and z_0 goes its way."""
    H = np.array([[1.0, -1e-5], [-1e-5, 1e-9]])
    point = Point(np.full(2, 5.0), np.full(2, -1e9), np.ones(2), (), (), 0.0, np.zeros(2), H, ())
    assert climbing.step(point, climbing.LEAST_DAMPING, 0, 0.3)[1] == pytest.approx(3e3, rel=1e-2)
    dz = intervals._outwards(point, 0, 0.3, 1.0)
    assert dz[0] == pytest.approx(0.3) and abs(dz[1]) <= fitting.MOST_OF_A_STEP
    near = replace(point, curvature=np.array([[1.0, -0.5], [-0.5, 0.5]]))
    assert intervals._outwards(near, 0, 0.3, 1.0) == pytest.approx([0.3, 0.3])


def test_a_step_outwards_ends_where_the_linear_model_expects_too_much():
    """One parameter makes up for another until it comes to its end: further on the deviance rises steeply."""
    H = np.array([[100.0, -100.0], [-100.0, 100.01]])
    free = Point(np.full(2, 5.0), np.full(2, -1e9), np.ones(2), (), (), 0.0, np.zeros(2), H, ())
    assert intervals._outwards(free, 0, 0.3, 0.5) == pytest.approx([0.3, 0.3], abs=1e-3)
    ends = replace(free, z=np.array([5.0, -4.9]), lowest=np.full(2, -5.0))
    dz = intervals._outwards(ends, 0, -0.3, 0.5)  # (dz_0 + 0.1)^2 * 100 = 0.5 behind the bend
    assert dz == pytest.approx([-0.1 - math.sqrt(0.005), -0.1], abs=1e-3) and -climbing.gain(ends, dz) <= 0.5
    nearly = replace(ends, z=np.array([5.0, -4.9999]))  # nor does the other one stay behind, where that leaves little
    assert -climbing.gain(nearly, intervals._outwards(nearly, 0, -0.4, 1e-4)) <= 1e-4


def test_a_step_goes_all_the_way_across_a_valley():
    """However short it is along: a deviance of curvature 1e8 across, at (1, 1), and of 1 along it, at (1, -1)."""
    across, along = np.array([1.0, 1.0]) / math.sqrt(2), np.array([1.0, -1.0]) / math.sqrt(2)
    H = 1e8 * np.outer(across, across) + np.outer(along, along)
    bottom = np.array([5.0, 5.0]) + 3 * along + 0.01 * across
    point = Point(np.full(2, 5.0), np.zeros(2), np.full(2, 5.0), (), (), 0.0, H @ (bottom - 5.0), H, ())
    dz = climbing.within(point, 0.1, None)
    assert climbing._length(point, dz) <= 0.1 < climbing._length(point, bottom - 5.0)
    assert across @ dz == pytest.approx(0.01, rel=1e-3) and 0.1 < along @ dz < 3
    back = climbing._across(point, 1e4, None)
    assert 0.0068 < across @ back < 0.01 and abs(along @ back) < 0.01  # 1 - sqrt(1 - 0.9) of the way
