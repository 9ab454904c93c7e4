"""problems/van_der_pol.py against Taylor series in extended precision."""

from __future__ import annotations

from problem_support import assert_true

from problems import van_der_pol


def test_true():
    for found in van_der_pol.cycles():
        assert_true(found)
        assert found.orbit.half, "its symmetry is found"
