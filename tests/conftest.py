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


@pytest.fixture
def undrawn(monkeypatch):
    """`casahunt diagram` draws nothing: its pictures take seconds, and tests of their own look at them."""
    monkeypatch.setattr("casahunt.views.commands.diagram._pictures", lambda *_: None)


@pytest.fixture
def telling_at_once(monkeypatch):
    """Commands say where they are all the time, which they do every few seconds to a person."""
    monkeypatch.setattr("casahunt.views.commands.progress.TELL_EVERY", 0.0)


@pytest.fixture
def at_most(monkeypatch):
    """Called with a number: a mesh has no more intervals; to reach the true limit takes minutes and gigabytes."""
    return lambda intervals: monkeypatch.setattr("casahunt.orbits.adapt.MAX_INTERVALS", intervals)
