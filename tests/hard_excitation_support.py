"""The oscillator with hard excitation and shear (problems/stuart_landau.py), of which every cycle is known.

The largest c with a cycle is b^2/(4 (1 - nu)), where r^2 = b/(2 c).
"""

from __future__ import annotations

import numpy as np
import pytest

from casahunt import Options
from casahunt.collocation.transcription import Setting, transcribe
from casahunt.continuation.curve import parameter_value
from casahunt.orbits.adapt import finished, solve_adaptively
from casahunt.orbits.orbit import Orbit
from problems import stuart_landau as sl
from problems.fixed_sequence import FixedSequence

NU, OMEGA, B, SHEAR = 0.6, 1.5, 2.4, 0.6
LARGEST = B**2 / (4 * (1 - NU))
TOL = 1e-9


def values(c: float) -> tuple[float, ...]:
    return NU, OMEGA, B, c, SHEAR


def period(square):
    return sl.sheared_period(square, *values(0.0))


def square(c: float, branch: int = 1) -> float:
    """r^2 on the stable (1) or the unstable (-1) part of the branch."""
    return sl.sheared_square(*values(c), larger=branch > 0)


def cycle(c: float, branch: int = 1, *, tol: float = TOL, intervals: int = 8) -> Orbit:
    """From the exact circle."""
    problem = FixedSequence(sl.SHEARED, values(c), followed="c", scheme=(8, "gauss"))
    t = transcribe(sl.SHEARED, (intervals,), 8, "gauss")
    angles = 2 * np.pi / intervals * (np.arange(intervals)[:, None] + t.scheme.points)
    w = np.stack([np.cos(angles), np.sin(angles)], axis=2).reshape(intervals, -1)
    u = t.pack(w, np.vstack([w[:, :2], w[0, :2]]), np.array([period(square(c, branch))]))
    scale = np.full(2, np.sqrt(square(c, branch)))
    setting = Setting(np.full(intervals, 1 / intervals), problem.vector(), scale, np.zeros(5))
    options = Options(tol=tol)
    solved = solve_adaptively(problem, (t, u, setting), options, solver="newton")
    return finished(solved, problem, options, 0.0, "the cycle")


def c_of(orbit: Orbit) -> float:
    return parameter_value(orbit, "c")


def assert_true(orbit: Orbit, branch: int, rel: float = 1e-8) -> None:
    exact = square(c_of(orbit), branch)
    assert orbit.amplitude**2 == pytest.approx(exact, rel=rel)
    assert orbit.period == pytest.approx(period(exact), rel=rel)
