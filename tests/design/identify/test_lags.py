"""Records of drives as built, made by servo/sampled, which shares nothing with the fit."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest

from casahunt import Drive, InputError, Record, Servo, find_orbit, identify, simulate_sampled
from casahunt.design.identify.suitable import drive_taken
from casahunt.servo.linear.sampled_loop import as_continuous, lag_of
from scripts.peers.hunting_record import measured

GAIN = 0.1
TRUE = {"friction.static": 0.53, "friction.coulomb": 0.44, "friction.viscous": 0.1, "friction.stribeck_velocity": 0.02}
"""Table 1 of the report."""
DRIVES = {
    "difference": Drive(sample_time=2e-3, delay=6e-3),
    "trapezoid": Drive(sample_time=2e-3, delay=6e-3, integration="trapezoid"),
    "filtered": Drive(sample_time=1e-3, delay=4e-3, derivative="filtered", filter_time=2e-3),
    "error filter": Drive(sample_time=2e-3, error_filter_time=4e-3),
}


def motion(drive: Drive, whole: float = 10.0):
    orbit = find_orbit(Servo(), "switch", GAIN)
    found = simulate_sampled(Servo(), GAIN, drive, set_point=0.0, position=-orbit.amplitude, time=whole * orbit.period)
    assert found.verdict.kind == "hunting"
    return found


def scaled(drive: Drive, factor: float) -> Drive:
    times = {key: factor * getattr(drive, key) for key in ("sample_time", "delay", "error_filter_time")}
    return dataclasses.replace(drive, **times, filter_time=drive.filter_time and factor * drive.filter_time)


@pytest.mark.parametrize("name", DRIVES)
def test_the_continuous_servo_moves_as_the_drive_does_to_second_order(name):
    """Lags twice as long are four times as far off in amplitude."""
    off, plain = [], []
    for factor in (1.0, 2.0):
        drive = scaled(DRIVES[name], factor)
        seen = motion(drive).verdict.amplitude
        effective = as_continuous(Servo(), GAIN, drive)
        off.append(abs(find_orbit(effective, "switch", GAIN).amplitude / seen - 1))
        plain.append(abs(find_orbit(Servo(), "switch", GAIN).amplitude / seen - 1))
    assert off[0] < 0.7 * plain[0] and 3.4 < off[1] / off[0] < 4.4


@pytest.mark.slow
@pytest.mark.parametrize("name", ["difference", "filtered"])
def test_the_friction_of_a_drive_is_found(name):
    """Its delay alone is taken for friction where it is not taken into account."""
    drive = DRIVES[name]
    found, T = motion(drive), find_orbit(Servo(), "switch", GAIN).period
    times = np.arange(3 * T, 9 * T, T / 400)
    x = np.interp(times, np.arange(found.states.shape[1]) * drive.sample_time, found.states[0])
    record = Record(times, measured(x, 0.01 * found.verdict.amplitude, 0.0, 0.3, np.random.default_rng(5)))
    start = Servo().replace(**{"friction.static": 0.7, "friction.viscous": 0.2})
    inside = {}
    for given in (drive, None):
        ends = identify([record], start, GAIN, drive=given, advise=False).intervals
        inside[given] = [low <= TRUE[key] <= high for key, (low, high) in ends.items()]
    assert all(inside[drive]) and not all(inside[None])


def test_lags_are_taken_where_they_can_be():
    drive, record, free = DRIVES["difference"], Record(np.arange(9.0), np.arange(9.0)), list(TRUE)
    assert lag_of(drive, Servo()) == pytest.approx(8e-3) and lag_of(DRIVES["filtered"], Servo()) == pytest.approx(7e-3)
    kp, _, _ = Servo().torque_gains(GAIN)
    assert drive_taken([record], Servo(), [GAIN], free, drive) == (drive, pytest.approx(kp / 0.026 * 8e-3**2 / 2))
    with_torque = dataclasses.replace(record, torque=np.arange(9.0))
    more = [*free, "servo.inertia"]
    for each, names, of in ((record, free, None), (record, more, drive), (with_torque, free, drive)):
        assert drive_taken([each], Servo(), [GAIN], names, of) == (None, 0.0)
    late = Drive(sample_time=2e-3, delay=0.05)
    assert as_continuous(Servo(), GAIN, late).inertia > 0
    with pytest.raises(InputError, match="its lag of 0.052 s is too long for a fit.*shorter sample time"):
        drive_taken([record], Servo(), [GAIN], free, late)
    slow = Drive(sample_time=0.5)
    with pytest.raises(InputError, match="its lag of 0.5 s is no small one in this loop.*shorter sample time"):
        drive_taken([record], Servo(), [GAIN], free, slow)
