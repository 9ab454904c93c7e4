"""What a drive hunts by: a case whose figures another program gave, and both causes."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from built_case import SERVO

from casahunt import Drive, Friction, Pid, Servo, cause_of, simulate_sampled
from casahunt.servo.sampled import check as cause
from casahunt.servo.sampled.check import smallest_dead_band, told_apart
from casahunt.servo.sampled.motion import Ending, judge, turning_points
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


@pytest.fixture(scope="module")
def seen():
    """Motion and cause by gain."""
    motions = {gain: simulate_sampled(SERVO, gain, DRIVE, time=time) for gain, time in ((1.0, 60.0), (4.458, 120.0))}
    return {gain: (motion, cause_of(motion)) for gain, motion in motions.items()}


@pytest.mark.slow
def test_it_hunts_at_half_the_frequency_by_its_encoder(seen):
    """1 ms and 2000 counts: the other program repeats every 4.78 s, the continuous loop every 2.49 s."""
    states, _ = peer(1.0).motion(-1.0, 0.0, 0.0, 26000)
    frequency = pattern_of(states[0, 12000:])
    assert frequency == pytest.approx(0.2093, rel=2e-3)
    motion, why = seen[1.0]
    assert motion.verdict.kind == "hunting" and motion.verdict.pattern == 4
    assert 1 / motion.verdict.period == pytest.approx(frequency, rel=2e-3)
    assert why.kind == "quantisation" and why.counts == pytest.approx(6.1, abs=0.2)
    assert 1 / why.without.period == pytest.approx(0.4003, rel=1e-3)


@pytest.mark.parametrize("gain, samples", [pytest.param(1.0, 12000, marks=pytest.mark.slow), (4.458, 30000)])
def test_its_dead_band_ends_it_and_less_does_not(seen, gain, samples):
    """In the other program, too; no gain does: it hunts on where the continuous loop has no cycle any more."""
    motion, why = seen[gain]
    assert motion.verdict.kind == "hunting" and why.kind == "quantisation"
    states, _ = peer(gain, why.dead_band).motion(-1.0, 0.0, 0.0, samples)
    assert np.ptp(states[0, samples // 2 :]) == 0
    states, _ = peer(gain, why.dead_band - DRIVE.count).motion(-1.0, 0.0, 0.0, samples)
    assert np.ptp(states[0, samples // 2 :]) > 0


def test_above_the_fold_the_reading_goes_to_and_fro_by_one_count():
    """For ever, or for 1000 s."""
    motion = simulate_sampled(SERVO, 4.458, DRIVE, time=1000.0)
    assert motion.verdict.kind == "hunting"
    low, high = motion.readings
    assert high - low == 1


FINE = Drive(sample_time=1e-3, encoder=40000, derivative="filtered")


def test_with_a_fine_encoder_it_is_stiction():
    fine = simulate_sampled(SERVO, 1.0, FINE, time=30.0)
    exact = simulate_sampled(SERVO, 1.0, fine.drive.exact(), time=30.0)
    assert told_apart(fine.verdict, exact.verdict)[0] == "stiction"
    short = simulate_sampled(SERVO, 1.0, fine.drive.exact(), time=3.0)
    assert short.verdict.kind == "undecided" and told_apart(fine.verdict, short.verdict)[0] == "not certain"


@pytest.mark.slow
def test_noise_is_asked_about_before_quantisation():
    """Of 3 mrad half of its torque is by noise; 1 urad does nothing."""
    causes = [
        cause_of(simulate_sampled(SERVO, 1.0, replace(FINE, noise=noise), time=60.0)) for noise in (1e-6, 3e-3)
    ]
    assert [cause.kind for cause in causes] == ["stiction", "noise"]
    assert causes[0].sentence.startswith("without quantisation")
    assert causes[1].sentence.startswith("without noise")


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


COARSE = Servo(
    inertia=0.0035, motor_gain=1.0, controller=Pid(kp=4, ki=30, kd=0.12),
    friction=Friction(static=0.8, coulomb=0.55, stribeck_velocity=0.08, viscous=0.02, stiffness=8e3, damping=3.0),
)  # fmt: skip


def test_a_servo_that_winds_up_by_torques_in_steps_is_not_on_its_way_to_rest():
    """Steps of 2 N m: stuck at x its integral goes from -1 to 1 N m, 2/(30 |x|) s, where its torque turns round."""
    drive = Drive(sample_time=1e-3, quantise_torque=2.0)
    for time in (100.0, 300.0, 1000.0):
        short = simulate_sampled(COARSE, 1.0, drive, time=time).verdict
        assert short.kind == "undecided" and "ends stuck" in short.sentence
    assert "its last swing is 0.000689 rad" in short.sentence
    motion = simulate_sampled(COARSE, 1.0, drive, time=3000.0)
    late = motion.states[0, 1_500_000:]
    waits = [2 / (30 * abs(x)) for x in (late.min(), late.max())]
    assert motion.verdict.kind == "hunting" and motion.verdict.period == pytest.approx(sum(waits), rel=5e-3)
    assert motion.verdict.amplitude == pytest.approx(np.ptp(late) / 2, rel=1e-2)


def test_a_servo_that_has_not_moved_shows_no_decay():
    motion = simulate_sampled(COARSE, 1.0, Drive(sample_time=1e-3), position=1 - 1e-5, time=10.0)
    assert motion.verdict.kind == "undecided" and not motion.states[1].any()


@pytest.mark.parametrize("step, kind", [(1e-3, "decaying"), (1.0, "undecided")])
def test_swings_within_what_changes_the_torque_do_not_show_that_they_die_out(step, kind):
    x = 0.9 ** np.arange(30.0) * (-1.0) ** np.arange(30)
    assert judge(np.arange(30.0), x, Ending(np.nan, False, "", 0.0, 0.0, step=step)).kind == kind


def test_a_lugre_servo_that_winds_up_is_not_at_rest():
    """Bristles do not move under a torque in steps that stays 0 for 40 s; its sum goes on. A leak ends that."""
    drive = Drive(sample_time=1e-3, quantise_torque=2.0)
    short, held = (
        simulate_sampled(COARSE, 1.0, replace(drive, leak=leak), model="lugre", time=6.0) for leak in (0.0, 5.0)
    )
    assert np.ptp(short.states[0, 3000:]) < 1e-4 and np.ptp(short.states[2, 3000:]) > 1e-3
    assert short.verdict.kind == "undecided" and held.verdict.kind == "at rest"


@pytest.mark.parametrize("step, beside, rests", [(0.0, 5e-6, True), (0.0, 1.5e-4, False), (0.5, 5e-6, False)])
def test_bristles_that_bend_to_the_set_point_are_at_rest(step, beside, rests):
    """8000 N m/rad and 0.8 N m: 0.1 mrad. By torques in steps they do not bend, and the sum goes on."""
    drive = Drive(sample_time=1e-3, quantise_torque=step)
    motion = simulate_sampled(COARSE, 1.0, drive, model="lugre", position=1 - beside, time=2.0)
    assert np.ptp(motion.states[0]) < 1e-4 and (motion.verdict.kind == "at rest") == rests


@pytest.mark.parametrize("shrinks, kind", [(0.0, "hunting"), (5e-3, "decaying")])
def test_swings_that_shrink_slowly_are_no_hunting(shrinks, kind):
    """By half a per cent a swing: two patterns in a row look alike, all differences have one sign."""
    t = np.arange(0, 40, 1e-3)
    x = np.cos(np.pi * t) * (1 - shrinks) ** t
    assert judge(t, x, Ending(np.nan, False, "", 0.0, 1.0)).kind == kind


def test_some_smaller_swings_of_a_chatter_are_no_decay():
    """The last four are, by chance; all of the last twelve of what dies out."""
    sizes = 1 + 0.3 * np.random.default_rng(3).uniform(-1, 1, 200)
    sizes[-8:] = np.sort(sizes[-8:])[::-1]
    for each, kind in ((sizes, "hunting"), (0.97 ** np.arange(200.0), "decaying")):
        x = each * (-1.0) ** np.arange(200)
        assert judge(np.arange(200.0), x, Ending(np.nan, False, "", 0.0, 0.0)).kind == kind


def test_swings_that_grow_are_no_hunting():
    """An unstable loop, cut off before it is far away: it has no amplitude."""
    x = 1.05 ** np.arange(120.0) * (-1.0) ** np.arange(120)
    found = judge(np.arange(120.0), x, Ending(np.nan, False, "", 0.0, 0.0))
    assert found.kind == "undecided" and np.isnan(found.amplitude) and "its swings grow" in found.sentence


@pytest.mark.parametrize("count, kind", [(1e-3, "decaying"), (1.0, "undecided")])
def test_swings_within_a_count_do_not_show_that_they_die_out(count, kind):
    """Nothing is read of them, and the integral goes on."""
    x = 0.5 + 0.4 * 0.9 ** np.arange(30.0) * (-1.0) ** np.arange(30)
    assert judge(np.arange(30.0), x, Ending(np.nan, False, "", count, 0.0)).kind == kind


def test_what_a_short_motion_does_not_decide_a_long_one_does(seen, monkeypatch):
    """What still decays after some periods is followed to the end; what rests or hunts by then is not."""
    motion, asked = seen[4.458][0], []

    def again(motion, drive, *, from_end=False, time=None):
        asked.append(time)
        wide = "at rest" if time is None else "decaying"
        return SimpleNamespace(verdict=SimpleNamespace(kind=wide if drive.dead_band > 1.2 * DRIVE.count else "hunting"))

    monkeypatch.setattr(cause, "again", again)
    monkeypatch.setattr(cause, "_sizes", lambda motion: np.arange(1.0, 6.0) * DRIVE.count)
    monkeypatch.setattr(cause, "SEEN_FOR", 2)
    assert smallest_dead_band(motion) == 2 * DRIVE.count
    assert None in asked and 2 * motion.verdict.mean_period in asked


def test_by_how_much_swings_repeat_is_said():
    t = np.arange(0, 40, 1e-3)
    x = np.cos(np.pi * t) * (1 + 0.005 * np.sin(9 * t))
    found = judge(t, x, Ending(np.nan, False, "", 0.0, 1.0))
    assert found.kind == "hunting" and found.sentence.startswith("each swing repeats, in size and time, to 0.")
    exact = judge(t, np.cos(np.pi * t), Ending(np.nan, False, "", 0.0, 1.0))
    assert exact.sentence == "each swing repeats, in size and time"
    x = (1 + 0.1 * np.sin(np.arange(80) ** 2)) * (-1.0) ** np.arange(80)  # a fifth apart, which half a count allows
    for count, kind in ((99.0, "hunting"), (101.0, "at rest")):  # an amplitude of 1 against a hundredth of a count
        assert judge(t, np.cos(np.pi * t), Ending(np.nan, False, "", count, 1.0)).kind == kind
    counted = judge(np.arange(80.0), x, Ending(np.nan, False, "", 1.0, 1.0)).sentence
    assert counted == "each swing repeats, in time to 0 %, in size to less than half a count"


def test_a_dead_band_that_ends_it_by_chance_is_passed_over(seen, monkeypatch):
    """One reading's band ends it, the next do not: the smallest one is behind them."""
    motion = seen[4.458][0]
    q = DRIVE.count

    def again(motion, drive, *, from_end=False, time=None):
        counts = drive.dead_band / q
        ends = 0.4 < counts < 0.6 or counts > 2.4
        return SimpleNamespace(verdict=SimpleNamespace(kind="at rest" if ends else "hunting"))

    wide = np.array([0.1, 0.5, 1.0, 1.5, 2.0, 2.5, 3.0, 3.5, 4.0]) * q
    monkeypatch.setattr(cause, "again", again)
    monkeypatch.setattr(cause, "_sizes", lambda motion: wide)
    assert smallest_dead_band(motion) == 2.5 * q
