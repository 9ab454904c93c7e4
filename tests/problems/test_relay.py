"""problems/relay.py against its closed form."""

from __future__ import annotations

from problem_support import assert_true

from problems import relay


def test_true():
    for found in relay.cycles():
        assert_true(found)
        assert found.orbit.half, "its symmetry is found"
