"""problems/dead_band.py against event maps: the fold's value by one, an unstable cycle by scipy's DOP853, here."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.integrate import solve_ivp

from casahunt import effort
from casahunt.continuation import follow
from casahunt.orbits import Options
from problems import dead_band
from problems.dead_band import FOLD, NARROW, PARAMETERS

TOL = 1e-8
LARGEST_WORK = 2e5
"""Collocation intervals: were every step looked at inside for tori, as often as it can be halved, ten times as many."""
KP, KD, KI, J, FS, FC, VS, B = (PARAMETERS[name] for name in ("kp", "kd", "ki", "J", "Fs", "Fc", "vs", "b"))


@pytest.fixture(scope="module")
def branch():
    with effort.counting_work(None, limit=LARGEST_WORK) as watch:
        found = follow(dead_band.stable_cycle(), "delta", to=1.0, back=NARROW, options=Options(tol=TOL))
    assert watch.work > 0
    return found


@pytest.mark.slow
def test_the_fold(branch):
    (fold,) = branch.special
    assert fold.kind == "fold" and fold.value == pytest.approx(FOLD, rel=TOL) and not branch.missed


@pytest.mark.slow
def test_both_cycles_reach_the_narrow_band(branch):
    first, last = branch.orbits[0], branch.orbits[-1]
    assert branch.end.kind == "range" and branch.values[0] == branch.values[-1] == NARROW
    assert first.stable and not last.stable and last.amplitude < first.amplitude


def half_cycle(a: float, delta: float) -> tuple[float, float]:
    """(stick position, time) half a cycle after a breakaway at x1 = -a; the time in closed form while it sticks."""
    state, time = np.array([-a, 0.0, (KP * a - FS) / KI]), 0.0
    for inside, edge in ((False, -delta), (True, delta), (False, np.inf)):

        def field(t: float, x: np.ndarray, inside: bool = inside) -> list[float]:
            friction = FC + (FS - FC) * np.exp(-((x[1] / VS) ** 2)) + B * x[1]
            m = -(KP * x[0] + KD * x[1] + KI * x[2])
            return [x[1], (m - friction) / J, 0.0 if inside else x[0]]

        def leaves(t: float, x: np.ndarray, edge: float = edge) -> float:
            return min(x[0] - edge, 1.0)

        def stops(t: float, x: np.ndarray) -> float:
            return x[1]

        leaves.terminal = stops.terminal = True
        leaves.direction, stops.direction = 1, -1
        motion = solve_ivp(field, (0, 100), state, "DOP853", events=(leaves, stops), rtol=1e-12, atol=1e-15)
        state, time = motion.y[:, -1], time + motion.t[-1]
        assert motion.t_events[int(not np.isfinite(edge))].size == 1, "it crosses the band, and stops behind it"
    m = -(KP * state[0] + KI * state[2])
    assert abs(m) < FS and state[0] > delta
    return float(state[0]), float(time + (m + FS) / (KI * state[0]))


@pytest.mark.slow
def test_unstable_cycles_are_fixed_points_of_the_event_map(branch):
    """From where they stick the map leads back there, and away from beside it."""
    turned = int(np.argmax(branch.values))
    seen = [orbit for orbit in branch.orbits[turned + 1 :] if 1 < abs(orbit.half_multiplier) < 300]
    assert len(seen) > 1
    for orbit in seen:
        a, delta, mu = orbit.amplitude, orbit.problem.value("delta"), orbit.half_multiplier
        error = 10 * max(orbit.error_estimate, 1e-11)
        position, time = half_cycle(a, delta)
        assert position == pytest.approx(a, rel=error * (1 + abs(mu)))
        assert 2 * time == pytest.approx(orbit.period, rel=error * (1 + abs(mu)))
        step = 1e-6 * a / abs(mu)
        slope = (half_cycle(a + step, delta)[0] - half_cycle(a - step, delta)[0]) / (2 * step)
        assert slope == pytest.approx(mu, rel=1e-3)
