"""problems/rossler.py against Taylor series in extended precision."""

from __future__ import annotations

from problem_support import assert_true

from problems import rossler


def test_true():
    for found in rossler.cycles():
        assert_true(found)
        assert found.orbit.stable == (abs(found.truth.multipliers[0]) < 1)
