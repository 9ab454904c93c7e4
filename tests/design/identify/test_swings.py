"""Records of drives whose controller reads counts, made by an integrator that is not the package's."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest

from casahunt import Drive, Friction, InputError, Pid, Record, Servo, find_orbit, identify, simulate_sampled
from casahunt.design.identify.built import MOST_ROUNDS
from casahunt.design.identify.fit import Data
from casahunt.design.identify.judgement import judged
from casahunt.design.identify.likelihood import Rows
from casahunt.design.identify.swings import once_each, one_by_one, passages
from casahunt.design.record.waveform import counts_by, quantum
from scripts.peers.drive_record import DriveServo

T, COUNT = 1e-3, 1e-3
SCREW = Servo(
    inertia=0.03, motor_gain=1.0, controller=Pid(kp=240.0, ki=4500.0, kd=3.0),
    friction=Friction(static=90.0, coulomb=65.0, stribeck_velocity=2.0, viscous=0.8, stiffness=3e4, damping=30.0),
)  # fmt: skip
"""Axis of a ball screw, mm, N, s: 30 kg, P-PI of 30 1/s, 3 N s/mm and 20 ms, which reads counts of 1 um."""
TRUE = {"friction.static": 90.0, "friction.coulomb": 65.0, "friction.viscous": 0.8, "friction.stribeck_velocity": 2.0}
WRONG = SCREW.replace(**{"friction.static": 60.0, "friction.coulomb": 35.0, "friction.viscous": 0.3,
                         "friction.stribeck_velocity": 4.0})  # fmt: skip


def screw(step: float, seconds: float, every: int) -> Record:
    """From a step of the set point on, 57 counts of amplitude."""
    reads = 2 * math.pi / COUNT
    built = DriveServo(0.03, 90.0, 65.0, 2.0, 0.8, 240.0, 4500.0, 3.0, T, encoder=reads, proportional=30.0)
    return Record(*built.record(step, round(seconds / T), every), "screw")


@pytest.mark.slow
@pytest.mark.parametrize(("step", "seconds", "every"), [(1, 12, 5), (0.3, 20, 5), (1, 12, 17), (5, 30, 1)])
def test_the_axis_of_a_screw(step, seconds, every):
    """Its swings begin apart by more than a tenth of a slip, and each is logged by a few samples."""
    drive = Drive(sample_time=T, encoder=2 * math.pi / COUNT)
    found = identify([screw(step, seconds, every)], WRONG, 1.0, drive=drive, advise=False)
    assert found.judgement.explained and found.status.ok
    for name, (low, high) in found.intervals.items():
        assert low <= TRUE[name] <= high
    assert np.ptp(found.intervals["friction.static"]) < 0.1 * TRUE["friction.static"]


@pytest.mark.slow
def test_the_axis_of_a_screw_whose_drive_is_not_told():
    """Its periods differ, which no cycle of a continuous loop does."""
    try:
        found = identify([screw(1.0, 12.0, 5)], WRONG, 1.0, advise=False)
    except InputError as refusal:
        assert "drive" in str(refusal)
    else:
        assert not found.judgement.explained


@pytest.mark.slow
def test_what_lags_leave_out_is_computed_as_built(monkeypatch):
    """Exact readings, at samples so far apart that what is of second order moves friction by half a per cent."""
    built = DriveServo(0.03, 90.0, 65.0, 2.0, 0.8, 240.0, 4500.0, 3.0, 2 * T)
    record, off = Record(*built.record(0.06, 8000, 2), "exact"), {}
    for rounds in (MOST_ROUNDS, 0):
        monkeypatch.setattr("casahunt.design.identify.built.MOST_ROUNDS", rounds)
        drive = Drive(sample_time=2 * T)
        found = identify([record], SCREW, 1.0, drive=drive, advise=False, free=["friction.static"])
        off[rounds] = abs(found.values["friction.static"] / TRUE["friction.static"] - 1)
    assert off[MOST_ROUNDS] < 5e-4 < 0.003 < off[0]


@pytest.mark.slow
def test_counts_in_the_loop_move_the_period(monkeypatch):
    """With 40 of amplitude by four per cent: a fit to a drive without them takes that for friction."""
    friction = {"static": 0.59, "coulomb": 0.256, "stribeck_velocity": 0.0082, "viscous": 0.0055}
    pid = Pid(kp=21.5, ki=42.7, kd=2.37)
    servo = Servo(inertia=0.014, motor_gain=1.0, controller=pid, friction=Friction(**friction))
    built = DriveServo(0.014, *friction.values(), 21.5, 42.7, 2.37, 2 * T, encoder=37700.0)
    record, drive = Record(*built.record(0.04, 25000, 5), "counts"), Drive(sample_time=2 * T, encoder=37700.0)
    off = {}
    follow = simulate_sampled
    for counts in (True, False):
        if not counts:
            monkeypatch.setattr(
                "casahunt.design.identify.built.simulate_sampled",
                lambda servo, gain, drive, **how: follow(servo, gain, replace(drive, encoder=0.0), **how),
            )
        found = identify([record], servo, 1.0, drive=drive, advise=False, free=["friction.static"])
        off[counts] = abs(found.values["friction.static"] / friction["static"] - 1)
        assert found.judgement.explained == counts
    assert off[True] < 1e-3 < 2e-3 < off[False]


def test_what_rests_says_so_once():
    """Of counts in a row the first and the last; of counts that noise moves all, and of positions that are none."""
    level = np.array([0, 0, 0, 0, 1, 2, 2, 3, 3, 3, 3, 2, 2, 2, 0, 0, 0], float)
    t = np.arange(level.size, dtype=float)
    data = Data(t, level, 1.0, 4.0, 1e-4, 1.5, 1.0, 0.0, level, "counts", passage=t, rising=t)
    kept = once_each(data)
    assert kept.times.tolist() == [0, 3, 4, 5, 6, 7, 10, 11, 13, 14, 16]
    assert kept.passage is not None and np.array_equal(kept.passage, kept.times)
    assert once_each(replace(data, quantum=0.0)).times.size == t.size
    noisy = replace(data, position=level + np.resize([0.0, 1.0, 1.0], level.size))
    assert once_each(noisy).times.size == t.size


def test_a_few_readings_are_seen_to_be_counts_of_the_drive():
    """Nearly each of them is another one: without the drive's word they might be anything."""
    rng = np.random.default_rng(7)
    counts = 1e-3 * rng.permutation(400)[:60]
    assert quantum(counts) == 0.0 and counts_by(counts, 1e-3)
    assert not counts_by(counts, 0.0013) and not counts_by(counts, 0.0)
    assert not counts_by(counts + 1e-3 * rng.random(60), 1e-3)


def swinging(jitter: np.ndarray, each: int = 50) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Times, positions and passages of swings as steep as tanh that come early or late, two seconds each way."""
    at = 1.0 + 2 * np.arange(jitter.size) + jitter
    t = np.arange(0.0, 2 * jitter.size, 1 / each)
    y = -np.ones(t.size)
    for k, when in enumerate(at):
        y += (-1) ** k * (1 + np.tanh((t - when) / 0.2))
    return t, y, at


def test_swings_are_moved_to_where_they_repeat():
    jitter = 0.1 * np.random.default_rng(3).standard_normal(24)
    t, y, at = swinging(jitter)
    found, rising = passages(t, y, 0.25)
    assert np.abs(found - at).max() < 2e-3 and np.array_equal(rising, (-1.0) ** np.arange(24))
    moved = one_by_one(Data(t, y, 1.0, 4.0, 1e-4, 1.0, 0.0, 0.0, y, "swings"), 0.0)
    mean = float(np.mean(np.diff(at[::2]) / 2 + np.diff(at[1::2]) / 2))
    assert abs(moved.period - mean) < 3 * moved.period_error * mean and moved.period_error < 0.05
    beside = moved.times - moved.passage
    assert np.abs(moved.position - moved.rising * np.tanh(beside / 0.2)).max() < 0.02


def test_what_the_record_holds_of_a_swing_without_its_passage_is_left_out():
    """The second half of a slip at the beginning would be compared with a stick."""
    t, y, at = swinging(np.zeros(20))
    held = (t > at[0] + 0.05) & (t < at[-1] - 0.05)
    moved = one_by_one(Data(t[held], y[held], 1.0, 4.0, 1e-4, 1.0, 0.0, 0.0, y, "swings"), 0.0)
    assert moved.times.min() > at[0] + 0.6 and moved.times.max() < at[-1] - 0.6
    with pytest.raises(InputError, match="must hold more than 6 whole swings, not 5; record longer"):
        one_by_one(Data(t[:500], y[:500], 1.0, 4.0, 1e-4, 1.0, 0.0, 0.0, y, "swings"), 0.0)


def test_a_model_whose_period_is_another_does_not_fit(monkeypatch):
    """However little it leaves of the positions: where the period is one datum no residual shows it."""
    asked = []
    monkeypatch.setattr("casahunt.design.identify.identify.judged", lambda *of: asked.append(of) or judged(*of))
    t, states = find_orbit(Servo(), "switch", 0.04).sample(2000)
    times = np.arange(0.0, 40.0, 0.05)
    record = Record(times, np.interp(times % t[-1], t, states[0]), "cycle")
    identify([record], Servo(), 0.04, free=["friction.static"], advise=False)
    question, point, noises = asked[-1]
    for errors, fits in ((1.0, True), (10.0, False)):
        period = Rows(errors**2, np.zeros(1), np.zeros(1), np.ones(1), np.zeros((1, point.z.size)))
        assert judged(question, replace(point, rows=(*point.rows, period)), noises).fits == fits
