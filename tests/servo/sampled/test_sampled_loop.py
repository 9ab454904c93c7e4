"""The difference equations and the motion between samples, against another program and by hand."""

from __future__ import annotations

import math
import shutil
from dataclasses import replace

import numpy as np
import pytest
from built_case import SERVO

from casahunt import Drive, InputError, effort, find_orbit, simulate_sampled
from casahunt.servo.drive import REMEDIES, SHARES
from casahunt.servo.sampled.motion import Ending, judge
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
    Drive(sample_time=1e-3, noise=1e-4),
    Drive(sample_time=1e-3, noise=1e-3, seed=3, encoder=2000, delay=1.5e-3, dwell=0.5, derivative="filtered"),
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


def test_rest_with_noise_is_as_far_as_its_torque_lets_one_tell():
    """A dead band of many deviations keeps the sum, and it stays in many more samples; a sum of noise wanders off."""
    keeps, wanders = (
        simulate_sampled(SERVO, 1.0, Drive(sample_time=1e-3, noise=1e-5, dead_band=band), time=30.0)
        for band in (0.02, 0.0)
    )
    assert keeps.verdict.kind == "at rest" and "noise proves no rest for ever" in keeps.verdict.sentence
    longer = simulate_sampled(SERVO, 1.0, keeps.drive, time=60.0)
    assert np.ptp(longer.states[0, round(keeps.rests_since / 1e-3) :]) == 0
    assert wanders.verdict.kind == "hunting"


def test_a_torque_on_its_way_to_breakaway_is_no_rest_with_noise():
    """Stuck 1 urad beside the set point it winds up for 0.4/(33.6 1e-6) s; of 20 s all are stuck, and some as many."""
    drive = Drive(sample_time=1e-3, noise=1e-9)
    near, far = (
        simulate_sampled(SERVO, 1.0, drive, set_point=0.0, position=x, time=20.0).verdict for x in (1e-6, 4.5e-4)
    )
    assert near.kind == "at rest" and far.kind == "undecided"
    assert simulate_sampled(SERVO, 1.0, drive, set_point=0.0, position=4.5e-4, time=40.0).stops.size


@pytest.mark.parametrize("samples", [1, 2, 3])
def test_a_motion_of_few_samples_shows_no_rest(samples):
    motion = simulate_sampled(SERVO, 1.0, Drive(sample_time=1e-3, noise=1e-9), position=1 - 1e-6, time=samples * 1e-3)
    assert not motion.stops.size and motion.verdict.kind in ("undecided", "at rest")


def test_of_swings_with_noise_some_are_smaller_by_chance():
    """Twelve in a row, each smaller than the one before, are not; the last four are."""
    rng = np.random.default_rng(2)
    sizes = np.concatenate([1 + 0.1 * rng.standard_normal(8), [1.0, 0.97, 0.94, 0.91, 0.88]])
    x = np.cumsum(sizes * (-1.0) ** np.arange(13))
    kinds = [judge(np.arange(13.0), x, Ending(np.nan, False, "", 0.0, 0.0, noise=noise)).kind for noise in (0.0, 1e-3)]
    assert kinds == ["decaying", "undecided"]


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


@pytest.mark.parametrize("encoder", [0, 2000])
def test_noise_is_added_before_a_reading_is_counted(encoder):
    """It is what numpy's generator of this seed draws."""
    drive = Drive(sample_time=1e-3, encoder=encoder, noise=1e-3, seed=5)
    motion = simulate_sampled(SERVO, 1.0, drive, time=5.0)
    read = 1.0 + motion.states[0, :-1] + 1e-3 * np.random.default_rng(5).standard_normal(5000)
    q = drive.count
    e = (q * np.floor(read / q + 0.5) if q else read) - 1.0
    assert np.ptp(e) > 0.01
    assert motion.states[2, 1:] == pytest.approx(np.cumsum(1e-3 * e), abs=1e-12)


@pytest.mark.slow
def test_with_noise_it_moves_as_another_program_says():
    """Two masses, filters, delay and counts, from the first sample to the last."""
    if shutil.which("cc") is None:
        pytest.skip("needs cc")
    from scripts.axes import Axis, as_built

    seen = [as_built(Axis(51, number)) for number in (0, 6, 13)]
    assert {outcome for outcome, _, _ in seen} == {"right"}
    assert all("noise 0:" not in said for _, said, _ in seen)


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
    ({"noise": -1e-3}, "drive.noise = -0.001: must be at least 0"),
    ({"seed": 1.5}, "drive.seed = 1.5: must be a whole number"),
    ({"seed": -1}, "drive.seed = -1: must be at least 0"),
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
