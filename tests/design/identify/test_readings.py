"""What readings that are rounded leave unknown: against fits to records of other gains, and of drives as built."""

from __future__ import annotations

import math

import numpy as np
import pytest

from casahunt import Record, Servo, find_orbit, identify
from casahunt.design.identify.fit import Data
from casahunt.design.identify.intervals import NORMAL_95, Interval
from casahunt.design.identify.readings import widened
from casahunt.servo.servo import flatten
from scripts.identify import AsBuilt

GAIN, NAME, COUNT = 0.04, "friction.static", 2e-4


def recorded(servo: Servo) -> Record:
    """Its cycle, four periods, with neither rounding nor more than a trace of noise."""
    orbit = find_orbit(servo, "switch", GAIN)
    t, states = orbit.sample(2000)
    times = np.arange(0.0, 4.2 * orbit.period, orbit.period / 200)
    noise = 1e-4 * orbit.amplitude * np.random.default_rng(2).standard_normal(times.size)
    return Record(times, np.interp(times % orbit.period, t, states[0]) + noise, "cycle")


@pytest.mark.parametrize("form", ["times", "gains"])
def test_friction_is_as_unsure_as_fits_to_other_gains_say(monkeypatch, form):
    """Records of loops whose gains are off by a count, one by one, fitted as if they were not."""
    servo = Servo() if form == "times" else Servo(controller=Servo().controller.pid())
    names = ("controller.kp", "controller.ki", "controller.kd") if form == "gains" else (
        "servo.motor_gain", "controller.lead_time", "controller.integral_time"
    )  # fmt: skip
    found = identify([recorded(servo)], servo, GAIN, free=[NAME], advise=False)
    off, moved = COUNT / (found.records[0].amplitude * math.sqrt(12)), []
    for name in names:
        other = servo.replace(**{name: flatten(servo)[name] * (1 + off)})
        seen = identify([recorded(other)], servo, GAIN, free=[NAME], advise=False)
        moved.append(seen.values[NAME] - found.values[NAME])
    monkeypatch.setattr(Data, "count", COUNT)
    wide = identify([recorded(servo)], servo, GAIN, free=[NAME], advise=False)
    for end, wider in zip(found.intervals[NAME], wide.intervals[NAME], strict=True):
        by = math.sqrt((wider - found.values[NAME]) ** 2 - (end - found.values[NAME]) ** 2)
        assert by == pytest.approx(NORMAL_95 * np.linalg.norm(moved), rel=0.05)


def test_what_has_no_end_has_none():
    ends = widened([Interval(0.0, math.inf), Interval(1.0, 3.0)], np.array([1.0, 2.0]), np.array([[9.0, 9.0]]))
    assert ends[0] == Interval(0.0, math.inf) and ends[1].low == 0.0
    assert ends[1].high == pytest.approx(2 + math.hypot(1, 9 * NORMAL_95))
    assert widened(ends, np.array([1.0, 2.0]), np.zeros((0, 2)))[1].high == pytest.approx(ends[1].high)


@pytest.mark.slow
def test_counts_that_come_back_in_each_swing_are_no_noise():
    """A drive whose amplitude is 21 counts hunts in step with them: nothing in its record scatters."""
    made = AsBuilt(13, 5, "switch", (2000.0, 20000.0))
    found = identify([made.record], made.starts[0], made.gain, drive=made.drive, advise=False)
    assert found.judgement.explained and found.judgement.unsteady < 0.01
    for name, (low, high) in found.intervals.items():
        assert low <= getattr(made.servo.friction, name.partition(".")[2]) <= high
    assert np.ptp(found.intervals[NAME]) < 0.2 * found.values[NAME]
