"""problems/impact_oscillator.py against Taylor series in extended precision."""

from __future__ import annotations

from problem_support import assert_true

from problems import impact_oscillator


def test_true():
    for found in impact_oscillator.cycles():
        assert_true(found)
        assert found.orbit.stable == (abs(found.truth.multipliers[0]) < 1)
