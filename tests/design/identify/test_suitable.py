"""Records that cannot be fitted, and what is said of them; whole ones that are not refused."""

from __future__ import annotations

import numpy as np
import pytest

from casahunt import InputError, Record, Servo, find_orbit
from casahunt.design.identify.suitable import suitable

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
