"""problems/two_spirals.py against its closed form."""

from __future__ import annotations

from problem_support import assert_true

from problems import two_spirals


def test_true():
    for found in two_spirals.cycles():
        assert_true(found)
