"""problems/circle.py against its closed form."""

from __future__ import annotations

from problem_support import assert_true

from problems import circle


def test_true():
    for found in circle.cycles():
        assert_true(found)
        assert found.orbit.extrema("z").amplitude < 1e-8
