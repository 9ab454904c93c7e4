"""Shared orbits: computed once for all tests that only read them."""

from __future__ import annotations

import math
import os
from functools import cache

import pytest

# Tests run in as many processes as there are cores; threads of the linear algebra would only be in each other's way.
os.environ.setdefault("OMP_NUM_THREADS", "1")
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from casahunt import Options, Orbit, effort, find_orbit
from problems import table1

# On a busy machine any command may be silent for so long that it says where it is; test_effort.py has its own clock.
effort.EVERY = math.inf


@cache
def orbit_at(model: str, gain: float, branch: str = "stable", tol: float = 1e-9) -> Orbit:
    """A cycle of the servo of Table 1."""
    return find_orbit(table1.servo(), model, gain, branch=branch, options=Options(tol=tol))


@pytest.fixture
def orbit():
    """The cached `orbit_at`."""
    return orbit_at
