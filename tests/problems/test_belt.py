"""problems/belt.py against Taylor series in extended precision."""

from __future__ import annotations

from problem_support import assert_true

from problems import belt


def test_true():
    for found in belt.cycles():
        assert_true(found)
        assert sorted(mode for mode, _ in found.orbit.signature) == ["slip", "stick"]
