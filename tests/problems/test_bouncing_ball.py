"""problems/bouncing_ball.py against its closed form."""

from __future__ import annotations

from problem_support import assert_true

from problems import bouncing_ball


def test_true():
    for found in bouncing_ball.cycles():
        assert_true(found)
        assert found.orbit.stable == (max(map(abs, found.truth.multipliers)) < 1)
