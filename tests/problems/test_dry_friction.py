"""problems/dry_friction.py against Taylor series in extended precision."""

from __future__ import annotations

from problem_support import assert_true

from problems import dry_friction


def test_true():
    sticks = []
    for found in dry_friction.cycles():
        assert_true(found)
        assert found.orbit.half, "its symmetry is found"
        sticks.append("stick" in [mode for mode, _ in found.orbit.signature])
    assert sticks == [False, True, False, True]
