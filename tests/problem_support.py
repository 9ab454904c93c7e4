"""A cycle of the gallery (problems/) held against what is known of it from outside."""

from __future__ import annotations

import pytest

from problems.gallery import Found, errors

PERIOD, EXTREMA, MULTIPLIERS = 1e-8, 1e-8, 1e-6
"""Largest errors at tol = 1e-9, as problems/gallery.py measures them."""
HONEST, ROUNDING = 10.0, 1e-11
"""A true error is at most so many times the estimated one, and rounding."""


def assert_true(found: Found) -> None:
    """Period, extrema and multipliers are right, and their estimated errors are."""
    orbit, truth = found.orbit, found.truth
    off = errors(orbit, truth)
    assert off["period"] < PERIOD
    assert off["period"] <= HONEST * orbit.period_error + ROUNDING
    for state, (low, high) in truth.extrema.items():
        assert off[state] < EXTREMA, state
        seen, size = orbit.extrema(state), max(abs(low), abs(high))
        assert seen.low.value == pytest.approx(low, rel=0, abs=HONEST * seen.low.error + ROUNDING * size), state
        assert seen.high.value == pytest.approx(high, rel=0, abs=HONEST * seen.high.error + ROUNDING * size), state
    if truth.multipliers is not None and orbit.multipliers.trusted:
        assert off["multipliers"] < MULTIPLIERS
