"""The difference equations and the motion between samples, against another program and by hand."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from built_case import SERVO

from casahunt import Drive, InputError, effort, find_orbit, simulate_sampled
from casahunt.servo.drive import REMEDIES, SHARES
from scripts import sampled

CASES = range(1, 50, 5)
"""Of the script's; all that a drive can is in them."""
MANY = 1500
"""Samples of one of them."""


@pytest.mark.parametrize("seed", [1, 7, 9, 10, 14, 17])
def test_another_program_has_the_same_motion(seed):
    found = sampled.compared(seed, 600)
    assert found["off"] <= sampled.AGREES
    assert found["horizon"] >= 400


@pytest.mark.parametrize("seed", [1, 7, 9])
def test_another_program_has_the_same_motion_of_lugre_friction(seed):
    found = sampled.compared(seed, 100, lugre=True)
    assert found["off"] <= sampled.AGREES and found["horizon"] == 101


@pytest.mark.parametrize("seed", [0, 4, 26, 31, 34, 45])
def test_another_program_has_the_same_motion_with_remedies(seed):
    found = sampled.compared(seed, 500, remedies=True)
    assert found["off"] <= sampled.AGREES and found["horizon"] >= 400


@pytest.mark.slow
@pytest.mark.parametrize("seed", CASES)
def test_cases_with_remedies(seed):
    assert sampled.compared(seed, MANY, remedies=True)["off"] <= sampled.AGREES


def test_each_remedy_of_the_cases_acts():
    """Or the comparison says nothing of it: without it the motion is another one."""
    acts = dict.fromkeys(REMEDIES, 0)
    for seed in CASES:
        one = sampled.remedied(sampled.case(seed))
        motion = sampled.ours(one, 1000)
        for key in (key for key in REMEDIES if getattr(one["drive"], key) != getattr(Drive, key)):
            shares = {share: getattr(Drive, share) for share, of in SHARES.items() if of == key}
            drive = replace(one["drive"], **{key: getattr(Drive, key), **shares})
            acts[key] += not np.allclose(sampled.ours({**one, "drive": drive}, 1000).states, motion.states, 1e-6, 1e-9)
    assert min(acts.values()) > 0


@pytest.mark.slow
@pytest.mark.parametrize("seed", [0, 2, 3, 8, 11])
def test_cases_of_lugre_friction(seed):
    assert sampled.compared(seed, 250, lugre=True)["off"] <= sampled.AGREES


@pytest.mark.slow
def test_lugre_friction_hunts_and_rests_with_a_dead_band():
    """Next to the Switch servo's, by some per cent; at rest its bristles creep, by less than they bend."""
    hunts, rests = (
        simulate_sampled(SERVO, 1.0, Drive(sample_time=1e-3, encoder=2000, dead_band=band), model="lugre", time=12.0)
        for band in (0.0, 0.018)
    )
    assert np.ptp(hunts.states[0, 6000:]) == pytest.approx(2 * 0.0188, rel=0.05)
    assert rests.verdict.kind == "at rest" and "bristles bend" in rests.verdict.sentence


@pytest.mark.slow
@pytest.mark.parametrize("seed", CASES)
def test_cases_of_another_program(seed):
    found = sampled.compared(seed, MANY)
    assert found["off"] <= sampled.AGREES
    assert found["horizon"] >= 1000


def test_the_cases_have_all_that_a_drive_can():
    """Or the comparison says nothing of it."""
    drives = [sampled.case(seed)["drive"] for seed in CASES]
    assert {d.derivative for d in drives} == {"difference", "filtered"}
    assert {d.integration for d in drives} == {"rectangle", "trapezoid"}
    assert {bool(d.encoder) for d in drives} == {bool(d.quantise_torque) for d in drives} == {True, False}
    assert {bool(d.dead_band) for d in drives} == {bool(d.leak) for d in drives} == {True, False}
    late = {(int(d.delay // d.sample_time) > 0, d.delay % d.sample_time > 0) for d in drives}
    assert late == {(False, False), (False, True), (True, False), (True, True)}


DRIVES = (
    Drive(sample_time=1e-3, encoder=2000),
    Drive(sample_time=1e-3, encoder=2000, delay=2.4e-3, integration="trapezoid", derivative="filtered"),
    Drive(sample_time=1e-3, delay=1e-3, quantise_torque=0.01, derivative="filtered", filter_time=0.02),
    Drive(sample_time=1e-3, encoder=2000, leak=0.5, integration="trapezoid"),
    Drive(sample_time=1e-3, encoder=2000, reset=0.8, hysteresis=0.008, integration="trapezoid", dwell=2.0),
    Drive(sample_time=1e-3, encoder=2000, delay=2e-3, error_filter_time=0.01, leak=0.01, reset_at_stop=0.9),
    Drive(sample_time=1e-3, encoder=2000, dwell=0.5),
    Drive(sample_time=1e-3, encoder=200, reset_at_stop=0.5),
    Drive(sample_time=1e-3, shifted_dead_band=1e-3, compensated=0.3, error_dead_band=1e-3, remaining_gain=0.5),
)


@pytest.mark.parametrize("drive", DRIVES)
def test_a_stick_taken_at_once_is_the_stick_sample_by_sample(drive):
    """To the rounding of the filter's powers, where there are any."""
    start = (-1.0, 0.0, 0.0)
    at_once = sampled.built(SERVO, 1.0, drive, 1.0, start).run(20000, math.inf)
    slow = sampled.built(SERVO, 1.0, drive, 1.0, start)
    slow._stuck, slow.rests, slow._row = (lambda k, samples: k), (lambda: False), (lambda *_: 0)
    one_by_one = slow.run(20000, math.inf)
    size = np.abs(one_by_one.states).max(axis=1)[:, None]
    assert np.abs(at_once.states - one_by_one.states).max(axis=1) == pytest.approx(0, abs=1e-9)
    assert (np.abs(at_once.states - one_by_one.states) / size).max() < 1e-9
    assert at_once.torque == pytest.approx(one_by_one.torque, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("drive", [
    Drive(sample_time=1e-3, encoder=2000, dead_band=0.02, derivative="filtered", delay=1.5e-3),
    Drive(sample_time=1e-3, encoder=2000, leak=1.1),
    Drive(sample_time=1e-3, encoder=2000, shifted_dead_band=0.0141),
    Drive(sample_time=1e-3, encoder=2000, hysteresis=0.0216, delay=1.5e-3),
    Drive(sample_time=1e-3, encoder=2000, dwell=0.5, integration="trapezoid"),
    Drive(sample_time=1e-3, encoder=2000, dead_band=0.02, error_filter_time=0.002),
])  # fmt: skip
def test_what_rests_for_ever_rests_sample_by_sample(drive):
    """The proof of rest is not a claim: nothing moves in many more samples."""
    motion = simulate_sampled(SERVO, 1.0, drive, time=10.0)
    assert motion.verdict.kind == "at rest" and 0 < motion.rests_since < 9
    slow = sampled.built(SERVO, 1.0, drive, 1.0, (-1.0, 0.0, 0.0))
    slow._stuck, slow.rests, slow._row = (lambda k, samples: k), (lambda: False), (lambda *_: 0)
    states = slow.run(50000, math.inf).states
    k = round(motion.rests_since / 1e-3)
    assert np.ptp(states[0, k:]) == 0 and not states[1, k:].any()


def test_a_leak_that_does_not_hold_it_is_no_rest():
    """Stuck, its torque within static friction, on the way to one beyond."""
    drive = Drive(sample_time=1e-3, leak=0.5)
    held, lost = (sampled.built(SERVO, 1.0, drive, 0.0, (x, 0.0, 0.0)) for x in (0.005, 0.006))
    kp, _, ki = SERVO.torque_gains(1.0)
    assert 0.005 * (kp + ki / 0.5) < 0.4 < 0.006 * (kp + ki / 0.5)
    assert held.rests() and not lost.rests()


def test_it_is_not_at_rest_where_a_torque_on_its_way_breaks_it_away():
    """Stuck with nothing to integrate, but what was asked for before is still to come."""
    drive = Drive(sample_time=1e-3, delay=5e-3, encoder=2000, dead_band=1.0)
    loop = sampled.built(SERVO, 1.0, drive, 0.0, (0.0, 0.0, 0.0))
    assert loop.rests()
    loop.waiting[-1] = 0.41
    assert not loop.rests()


def test_it_is_not_at_rest_where_its_last_reading_is_still_to_be_added():
    """A trapezoid takes half of the reading before, which the dead band of the present one does not see."""
    drive = Drive(sample_time=1e-3, encoder=2000, dead_band=1e-3, integration="trapezoid")
    loop = sampled.built(SERVO, 1.0, drive, 0.0, (0.0, 0.0, 0.0))
    assert loop.rests()
    loop.controller.Y[-1] = 100.0
    assert not loop.rests()


def test_it_is_not_at_rest_where_its_derivative_still_breaks_it_away():
    """The filtered one goes on behind the reading that has changed."""
    drive = Drive(sample_time=1e-3, encoder=2000, dead_band=1e-3, derivative="filtered", filter_time=0.01)
    loop = sampled.built(SERVO, 1.0, drive, 0.0, (0.0, 0.0, 0.0))
    assert loop.rests()
    loop.controller.Y[loop.controller.names.index("lagging")] = -0.03  # d = 3 rad/s; kd = 0.21 N m s/rad
    assert not loop.rests()


def test_torques_are_multiples_and_readings_are_counts():
    motion = simulate_sampled(SERVO, 1.0, Drive(sample_time=1e-3, encoder=2000, quantise_torque=0.01), time=5.0)
    steps = motion.torque / 0.01
    assert steps == pytest.approx(np.round(steps), abs=1e-9)
    q = motion.drive.count
    e = q * np.floor((1.0 + motion.states[0, :-1]) / q + 0.5) - 1.0
    w = np.cumsum(1e-3 * e)
    assert motion.states[2, 1:] == pytest.approx(w, abs=1e-12)


def test_a_delay_of_whole_samples_shifts_the_torque():
    """A motion from rest under a delay of three samples is the one without, three samples later, as long as it is
    stuck: at the start nothing acts."""
    late = simulate_sampled(SERVO, 1.0, Drive(sample_time=1e-3, delay=3e-3), time=0.01)
    assert not late.states[1, :4].any() and late.states[1, 4] > 0


def test_the_continuous_cycle_is_its_limit():
    """The error is of first order in the sample time: a tenth of it makes a tenth."""
    orbit = find_orbit(SERVO, "switch", 1.0)
    off = []
    for T in (1e-3, 1e-4):
        motion = simulate_sampled(SERVO, 1.0, Drive(sample_time=T), time=30.0)
        off.append(motion.verdict.period / orbit.period - 1)
    assert off[1] == pytest.approx(off[0] / 10, rel=0.2)


@pytest.mark.parametrize("change, words", [
    ({"sample_time": 0.0}, "drive.sample_time = 0: must be greater than 0"),
    ({"encoder": 0.5}, "drive.encoder = 0.5: must be at least 1"),
    ({"delay": 2.0}, "drive.delay = 2: must be at most 1"),
    ({"derivative": "filterd"}, "did you mean 'filtered'"),
    ({"integration": "tustin"}, "unknown drive.integration 'tustin'"),
    ({"filter_time": 0.01}, "drive.filter_time: must be left out"),
    ({"dead_band": -1.0}, "drive.dead_band = -1: must be at least 0"),
    ({"leak": 1000.0}, "drive.leak = 1000: must be less than 1/sample_time"),
    ({"reset": 1.5}, "drive.reset = 1.5: must be at most 1"),
    ({"reset_at_stop": math.nan}, "drive.reset_at_stop = nan: must be a finite number"),
    ({"dwell": 0.0}, "drive.dwell = 0: must be greater than 0"),
    ({"compensated": -1.0}, "drive.compensated = -1: must be at least 0"),
    ({"enter_ratio": 2.0, "hysteresis": 0.1}, "drive.enter_ratio = 2: must be at most 1"),
    ({"enter_ratio": 0.7}, "drive.enter_ratio: must be left out without drive.hysteresis"),
    ({"remaining_gain": 0.1}, "drive.remaining_gain: must be left out without drive.error_dead_band"),
    ({"dead_band": 0.1, "hysteresis": 0.1}, "dead_band and hysteresis exclude each other"),
])  # fmt: skip
def test_a_drive_that_is_none_is_refused(change, words):
    with pytest.raises(InputError) as refusal:
        replace(Drive(sample_time=1e-3), **change)
    assert words in str(refusal.value)


def test_too_many_samples_are_refused():
    with pytest.raises(InputError, match="between 1 and 5000000 samples"):
        simulate_sampled(SERVO, 1.0, Drive(sample_time=1e-6), time=100.0)


def test_a_motion_without_end_is_given_up():
    """The steps of slips are counted, so that the command line ends: friction that is stiff beyond measure."""
    stiff = SERVO.replace(**{"friction.viscous": 1e4})
    with effort.counting_work(None, limit=1e4), pytest.raises(effort.GivenUp, match=r"to sample \d+ of 100"):
        simulate_sampled(stiff, 1.0, Drive(sample_time=1.0), set_point=1e4, time=100.0)
