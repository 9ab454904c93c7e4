"""Given numbers in the loop as built."""

from __future__ import annotations

import math
from dataclasses import replace

import pytest
from built_case import SERVO

from casahunt import Drive, as_built, simulate_sampled
from casahunt.servo.drive import ENCODER_BORDER, below_border

DRIVE = Drive(sample_time=1e-3, encoder=2000)


def test_the_gain_that_ends_hunting_leaves_that_of_the_encoder():
    found = as_built(SERVO, 4.458, DRIVE)
    assert found.kind == "hunting" and not found.ends and "quantisation" in found.sentence
    band = found.dead_band
    assert band == pytest.approx(0.55 * DRIVE.count)  # on the edge of no reading
    assert as_built(SERVO, 4.458, replace(DRIVE, dead_band=band)).ends
    for theta_d in (0.1, 0.5, 1.0, 1.0005, 2.0):  # set points that the check has not seen
        motion = simulate_sampled(SERVO, 4.458, replace(DRIVE, dead_band=band), set_point=theta_d, time=60.0)
        assert motion.verdict.kind == "at rest"


def test_without_an_encoder_swings_die_out_above_the_fold():
    assert as_built(SERVO, 4.458, DRIVE.exact()).kind == "decaying"
    below = as_built(SERVO, 1.0, DRIVE.exact())
    assert below.kind == "hunting" and "quantisation" not in below.sentence
    assert as_built(SERVO, 1.0, replace(DRIVE.exact(), dead_band=below.dead_band)).ends


@pytest.mark.slow
def test_what_it_says_of_a_set_point_is_so():
    found = as_built(SERVO, 1.0, DRIVE)
    assert found.kind == "hunting" and not math.isnan(found.dead_band)
    assert found.worst.verdict.kind == "hunting"


def test_a_cycle_of_many_counts_needs_no_word():
    q = DRIVE.count
    assert below_border(1.01 * ENCODER_BORDER * q, DRIVE) == "" == below_border(1e-6, DRIVE.exact())
    assert below_border(0.99 * ENCODER_BORDER * q, DRIVE).startswith("19.8 counts")
    assert below_border(1e-6, None) == ""
