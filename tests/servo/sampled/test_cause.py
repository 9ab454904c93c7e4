"""What a drive hunts by: a case whose figures another program gave, and both causes."""

from __future__ import annotations

import numpy as np
import pytest
from built_case import SERVO

from casahunt import Drive, cause_of, simulate_sampled
from casahunt.servo.sampled.verdict import turning_points
from scripts.peers.sampled_motion import SampledServo


DRIVE = Drive(sample_time=1e-3, encoder=2000)


def peer(gain: float, dead_band: float = 0.0) -> SampledServo:
    c = 4.2 * gain
    return SampledServo(
        0.012, 0.40, 0.30, 0.05, 0.02, c, 8 * c, 0.05 * c, 1e-3, encoder=2000, dead_band=dead_band, set_point=1.0
    )


def pattern_of(x: np.ndarray) -> float:
    """Frequency [Hz] of the repetition of a position, 1 ms apart: the first shift that gives it again."""
    x = x - x.mean()
    shifts = np.arange(1000, 6000)
    missed = np.array([np.abs(x[s:] - x[:-s]).mean() for s in shifts])
    good = shifts[missed < 1.2 * missed.min()]
    return 1e3 / float(good[good < good[0] + 100].mean())


def test_it_hunts_at_half_the_frequency_by_its_encoder():
    """1 ms and 2000 counts: the other program repeats every 4.78 s, the continuous loop every 2.49 s."""
    states, _ = peer(1.0).motion(-1.0, 0.0, 0.0, 40000)
    frequency = pattern_of(states[0, 15000:])
    assert frequency == pytest.approx(0.2093, rel=2e-3)
    motion = simulate_sampled(SERVO, 1.0, DRIVE, time=100.0)
    assert motion.verdict.kind == "hunting" and motion.verdict.pattern == 4
    assert 1 / motion.verdict.period == pytest.approx(frequency, rel=2e-3)
    cause = cause_of(motion)
    assert cause.kind == "quantisation" and cause.counts == pytest.approx(6.1, abs=0.2)
    assert 1 / cause.without.period == pytest.approx(0.4003, rel=1e-3)


@pytest.mark.parametrize("gain", [1.0, 4.458])
def test_its_dead_band_ends_it_and_less_does_not(gain):
    """In the other program, too; no gain does: it hunts on where the continuous loop has no cycle any more."""
    motion = simulate_sampled(SERVO, gain, DRIVE, time=100.0)
    cause = cause_of(motion)
    assert motion.verdict.kind == "hunting" and cause.kind == "quantisation"
    samples = 60000
    states, _ = peer(gain, cause.dead_band).motion(-1.0, 0.0, 0.0, samples)
    assert np.ptp(states[0, samples // 2 :]) == 0
    states, _ = peer(gain, cause.dead_band - DRIVE.count).motion(-1.0, 0.0, 0.0, samples)
    assert np.ptp(states[0, samples // 2 :]) > 0


def test_above_the_fold_the_reading_goes_to_and_fro_by_one_count():
    motion = simulate_sampled(SERVO, 4.458, DRIVE, time=400.0)
    assert motion.verdict.kind == "hunting"
    low, high = motion.readings
    assert high - low == 1
    late = simulate_sampled(SERVO, 4.458, DRIVE, time=2000.0)
    assert late.verdict.kind == "hunting" and late.readings == (low, high)


def test_with_a_fine_encoder_it_is_stiction():
    cause = cause_of(simulate_sampled(SERVO, 1.0, Drive(sample_time=1e-3, encoder=40000, derivative="filtered")))
    assert cause.kind == "stiction" and cause.counts > 100


def test_a_set_point_on_a_count_leaves_it_at_rest():
    motion = simulate_sampled(SERVO, 4.458, DRIVE, set_point=0.0, position=-1.0, time=100.0)
    assert motion.verdict.kind == "at rest" and cause_of(motion) is None


def test_nothing_that_quantises_has_no_cause():
    assert cause_of(simulate_sampled(SERVO, 1.0, Drive(sample_time=1e-3), time=30.0)) is None


def test_turning_points_are_where_it_turns_by_more_than_asked():
    x = np.array([0.0, 1.0, 1.0, 0.9, 1.05, -1.0, -0.9, -1.0, 1.0, 0.95])
    assert x[turning_points(x, 0.5)].tolist() == [0.0, 1.05, -1.0]


def test_swings_that_shrink_are_no_hunting():
    """Above its fold the loop without an encoder dies out."""
    motion = simulate_sampled(SERVO, 4.458, DRIVE.exact(), time=100.0)
    assert motion.verdict.kind == "decaying"
