"""Records that cannot be fitted, and what is said of them; whole ones that are not refused."""

from __future__ import annotations

import numpy as np
import pytest

from casahunt import InputError, Record, Servo, find_orbit
from casahunt.design.identify.suitable import suitable
from scripts.peers.hunting_record import measured, positions

ORBIT = find_orbit(Servo(), "switch", 0.04)
TIMES = np.arange(0.0, 6 * ORBIT.period, 0.02)


def cycle(t):
    times, states = ORBIT.sample(400)
    return np.interp(t % ORBIT.period, times, states[0])


def refused(y, t=TIMES):
    with pytest.raises(InputError) as info:
        suitable(Record(t, y, "made"))
    return str(info.value)


def test_a_part_of_a_period_is_not_at_rest():
    noise = 1e-4 * np.random.default_rng(0).normal(size=TIMES.size)
    t = TIMES[TIMES < 0.7 * ORBIT.period]
    assert "shows no whole period" in refused(cycle(t) + noise[: t.size], t)
    assert "at rest" in refused(np.full(TIMES.size, 0.3))


@pytest.mark.parametrize(("low", "high"), [(-0.9, 0.9), (-2.0, 0.95), (-0.95, 2.0)])
def test_noisy_positions_cut_off_at_one_end_or_both(low, high):
    y = cycle(TIMES) + 1e-4 * np.random.default_rng(0).normal(size=TIMES.size)
    suitable(Record(TIMES, y, "made"))
    assert "are clipped at" in refused(np.clip(y, low * ORBIT.amplitude, high * ORBIT.amplitude))


def test_noise_that_is_cut_off_where_it_rests():
    """Steps from and to the end are noise then, small beside those of a slip, as of a servo that rests there."""
    noise = 1e-4 * np.random.default_rng(0).normal(size=TIMES.size)
    assert "are clipped at" in refused(np.minimum(cycle(TIMES) + noise, ORBIT.amplitude + 2e-5))


@pytest.mark.parametrize("quantum", [0.0, 0.0005])
@pytest.mark.parametrize(("low", "high"), [(-0.9, 0.9), (-0.6, 0.6), (-2.0, 0.7), (-0.7, 2.0)])
def test_what_is_cut_off_has_corners_where_what_rests_has_none(quantum, low, high):
    """Clean positions and counts (one in 130 of the amplitude): the rest of a servo that sticks is as flat."""
    times = np.arange(0.0, 5 * ORBIT.period, 0.005)
    seen = cycle(times) + 0.3
    rounded = quantum * np.round(seen / quantum) if quantum else seen
    suitable(Record(times, rounded, "made"))
    y = np.clip(rounded, 0.3 + low * ORBIT.amplitude, 0.3 + high * ORBIT.amplitude)
    assert "are clipped at" in refused(quantum * np.round(y / quantum) if quantum else y, times)


@pytest.mark.parametrize("counts", [0.0, 2000.0, 20000.0])
def test_a_record_that_rests_at_its_ends_is_not_refused(counts):
    """Records by scipy of servos that stick for most of a period, or hardly at all."""
    for static, gain in ((0.53, 0.04), (0.53, 0.3), (0.46, 0.04), (0.8, 0.1)):
        servo = Servo().replace(**{"friction.static": static})
        orbit = find_orbit(servo, "switch", gain)
        t = np.arange(0.0, 6 * orbit.period, orbit.period / 700)
        x = positions(servo, "switch", gain, orbit.amplitude, t)
        suitable(Record(t, measured(x, 0.0, counts, 0.1, np.random.default_rng(0)), "made"))
