"""problems/canudas.py against Taylor series in extended precision."""

from __future__ import annotations

from problem_support import assert_true

from problems import canudas


def test_true():
    (found,) = canudas.cycles()
    assert_true(found)
    assert found.orbit.half, "its symmetry is found"
