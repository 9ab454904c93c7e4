"""Remedies of the sampled controller: what each makes of readings, by hand."""

from __future__ import annotations

import math

import pytest
from built_case import SERVO

from casahunt import Drive, InputError, cause_of, simulate_sampled
from casahunt.servo.drive import with_remedy
from casahunt.servo.parts import REMEDIES as OF_LOOPS
from scripts.sampled import built

T = 0.1


def run_by(drive, x, w=0.0):
    """The controller of a drive from a reading and a sum on."""
    return built(SERVO, 1.0, drive, 0.0, (x, 0.0, w)).controller


def sums(readings, start=0.0, **remedies):
    """The sum behind each reading."""
    controller = run_by(Drive(sample_time=T, **remedies), readings[0], start)
    found = []
    for a in readings:
        controller.sample(a)
        found.append(controller.Y[controller.names.index("x3")] / T)
    return pytest.approx(found)


def test_a_reset_acts_where_the_error_changes_its_sign_and_zero_has_none():
    assert sums([3, 0, 3, -1, 0, 0, -1, 2], 0.0, reset=0.5) == [3, 3, 6, 2, 2, 2, 1, 2.5]
    assert sums([0, 0, 1], 4 * T, reset=0.5) == [4, 4, 5]


def test_a_reset_at_a_stop_acts_at_the_first_reading_that_stays():
    assert sums([1, 1, 2, 2, 2, 3, 4, 4], reset_at_stop=0) == [1, 2, 4, 2, 4, 7, 11, 4]


def test_a_shifted_dead_band_is_continuous():
    assert sums([1.0, 1.5, -3.0, 0.2], shifted_dead_band=1.0) == [0.0, 0.5, -1.5, -1.5]


def test_hysteresis_has_two_edges():
    assert sums([1.5, 2.5, 1.5, 1.0, 0.9, 1.5, -2.1], hysteresis=2.0) == [0.0, 2.5, 4.0, 5.0, 5.0, 5.0, 2.9]
    assert sums([1.5, 2.5, 1.5, 2.5], hysteresis=2.0, enter_ratio=1.0) == [0.0, 2.5, 2.5, 5.0]


def test_a_freeze_begins_when_the_reading_has_stayed_for_the_dwell_time():
    assert sums([1, 2, 2, 2, 2, 3], dwell=2 * T) == [1, 3, 5, 5, 5, 8]
    assert sums([1, 1, 1], dwell=2 * T) == [1, 1, 1]


def test_an_error_dead_band_leaves_a_part_of_the_error():
    assert sums([0.5, 3.0, -3.0, -0.5], error_dead_band=1.0, remaining_gain=0.2) == [0.1, 2.3, 0.1, 0.0]
    controller = run_by(Drive(sample_time=T, error_dead_band=1.0), 0.9)
    assert controller.sample(0.9) == 0


def test_an_error_filter_is_one_by_the_backward_rule():
    """Te = T: half of the way at each sample; the derivative is of what it gives."""
    drive = Drive(sample_time=T, error_filter_time=T)
    controller = run_by(drive, 0.0)
    kp, kd, ki = SERVO.torque_gains(1.0)
    controller.sample(0.0)
    assert controller.sample(1.0) == pytest.approx(-(kp * 0.5 + kd * 0.5 / T + ki * 0.5 * T))
    assert controller.sample(1.0) == pytest.approx(-(kp * 0.75 + kd * 0.25 / T + ki * 1.25 * T))


def test_a_feedforward_acts_while_the_reading_changes():
    plain, helped = (run_by(Drive(sample_time=T, reset=0.999, compensated=share), 0.0)
                     for share in (0.0, 0.5))  # fmt: skip
    more = [helped.sample(a) - plain.sample(a) for a in (0.0, 1.0, 1.0, 3.0, 2.0)]
    assert more == pytest.approx([0, 0.15, 0, 0.15, -0.15])


def test_second_numbers_are_those_of_the_loops_of_parts():
    """A size that was found for one is then the size of the other."""
    assert {"enter_ratio", "remaining_gain"} <= {name for one in OF_LOOPS if one.part for name in one.part.parameters}
    for remedy in (one for one in OF_LOOPS if one.part):
        for name, value in remedy.part.parameters.items():
            if name in ("enter_ratio", "remaining_gain", "reset", "reset_at_stop"):
                assert getattr(Drive, name) == value


@pytest.mark.parametrize("remedy", [{"reset": 0.6832}, {"shifted_dead_band": 0.01409}, {"hysteresis": 0.02158},
                                    {"dwell": 0.9567}])  # fmt: skip
def test_with_a_fine_drive_the_remedy_of_the_continuous_loop_ends_hunting(remedy):
    """Ten per cent beyond where hunting ends there, at samples and counts so fine that nothing else differs; a third
    of the remedy ends nothing."""
    drive = Drive(sample_time=1e-4, **remedy)
    assert simulate_sampled(SERVO, 1.0, drive, time=15.0).verdict.kind in ("at rest", "decaying")
    less = {"reset": 0.9, "shifted_dead_band": 0.004, "hysteresis": 0.007, "dwell": 2.9}
    drive = Drive(sample_time=1e-4, **{key: less[key] for key in remedy})
    assert simulate_sampled(SERVO, 1.0, drive, time=20.0).verdict.kind == "hunting"


def test_the_dead_band_that_ends_it_stands_in_the_place_of_another():
    motion = simulate_sampled(SERVO, 1.0, Drive(sample_time=1e-3, encoder=2000, hysteresis=0.004), time=20.0)
    band = cause_of(motion).dead_band
    assert motion.verdict.kind == "hunting" and band > 0
    drive = with_remedy(motion.drive, "dead_band", band)
    assert drive.hysteresis == 0
    assert simulate_sampled(SERVO, 1.0, drive, time=20.0).verdict.kind == "at rest"


def test_a_filter_that_is_on_its_way_is_no_rest():
    """Stuck, with a reading that is not integrated, but an error that comes to it only by and by."""
    drive = Drive(sample_time=1e-3, dead_band=0.02, error_filter_time=1.0)
    controller = run_by(drive, 0.01)
    controller.sample(0.01)
    assert controller.stays_within(-0.4, 0.4)
    controller.Y[controller.names.index("filtered")] = 0.05
    controller.Y[-2] = 0.05  # the last error: nothing but the dead band's mode tells
    assert not controller.stays_within(-0.4, 0.4)


def test_a_freeze_that_is_still_to_come_is_no_rest():
    controller = run_by(Drive(sample_time=1e-3, dwell=0.01), 0.01)
    rests = [controller.sample(0.01) < math.inf and controller.stays_within(-0.4, 0.4) for _ in range(12)]
    assert rests == [False] * 9 + [True] * 3


def test_it_is_not_steady_before_the_stop_is_seen():
    """Stuck since the last sample, whose reading changed: the next one, which finds it stopped, resets the sum."""
    controller = run_by(Drive(sample_time=T, reset_at_stop=0.5), 1.0)
    controller.sample(1.0), controller.sample(2.0)
    assert not controller.stays(2.0)
    controller.sample(2.0)
    assert controller.stays(2.0) and controller.Y[0] == pytest.approx(3.5 * T)


def test_lugre_friction_without_an_encoder_never_stops():
    for key, value in (("dwell", 0.1), ("reset_at_stop", 0.5)):
        with pytest.raises(InputError, match=f"drive.{key}: needs an encoder or the model 'switch'"):
            simulate_sampled(SERVO, 1.0, Drive(sample_time=1e-3, **{key: value}), model="lugre")
