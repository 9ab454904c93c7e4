"""The loop as built as a continuous one, to first order in its lags: what a record of it is fitted by.

The controller of a drive (servo/sampled) sees positions, velocities and its sum late by

    d    = delay + T/2 + error filter       T/2: the torque is held for a sample
    d_v  = d + T/2                          of a difference of two readings; + filter time, where it is filtered
    d_w  = d, or d - T/2                    by trapezoids; by rectangles, which count the present reading in full

and x1(t - d) = x1 - d x2 + O(d2), x2(t - d_v) = x2 - d_v x2' + O(d2), x3(t - d_w) = x3 - d_w x1 + O(d2) make the torque
-K cm (kp x1(t - d) + kd x2(t - d_v) + ki x3(t - d_w)) that of a continuous loop of the same friction, with

    J -> J - K cm kd d_v,      kd -> kd - kp d,      kp -> kp - ki d_w

What is left is of second order: of Table 1 and seven other servos amplitude and period are off by
0.3 to 0.85 (omega d_v)^2, omega^2 = kp/J, with delays or filters from 0.05 to 0.2/omega.  built.py computes it where a
fit ends; how the motion changes with friction is known to the first order, so where half of that square is more than
`MOST_LEFT_OUT` the record is refused.

What quantisation does is not in it: swings.py takes each swing by itself, readings.py says what all of them leave
unknown.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import NamedTuple

from ...errors import InputError
from ...servo.controller import Pid
from ...servo.drive import Drive
from ...servo.servo import Servo
from ..record.file import Record

FRICTION = "friction."
"""Of which parameters begin that lags leave as they are."""
MOST_LEFT_OUT = 0.1
"""Of what lags leave out, in amplitudes."""
SHORTER = "record with a shorter sample time, delay or filter, or at a lower gain"
"""What helps against lags that are too long."""
SHAKEN = 0.02
"""Torque that a count makes by the derivative, as a part of static friction, above which it is told."""


class Lags(NamedTuple):
    """How late the controller of a drive sees position, velocity, sum [s]; what that leaves out, in amplitudes."""

    position: float
    velocity: float
    sum: float
    left_out: float
    drive: Drive


def lags_of(drive: Drive, servo: Servo, gain: float) -> Lags:
    """Those of a drive."""
    half = drive.sample_time / 2
    d = drive.delay + half + drive.error_filter_time
    d_v, kp = d + half + drive.filter_of(servo.controller), servo.torque_gains(gain)[0]
    d_w, left_out = d if drive.integration == "trapezoid" else d - half, kp / servo.inertia * d_v**2 / 2
    return Lags(d, d_v, d_w, left_out, drive)


def as_continuous(servo: Servo, gain: float, lags: Lags) -> Servo:
    """The servo whose continuous loop moves as that with lags does.  Raises InputError: they are too long for that."""
    pid = servo.controller.pid()
    inertia = servo.inertia - gain * servo.motor_gain * pid.kd * lags.velocity
    kp, kd = pid.kp - pid.ki * lags.sum, pid.kd - pid.kp * lags.position
    if min(inertia, kp) <= 0 or kd < 0:
        small = "is no small one in this loop, as a fit takes it to be"
        raise InputError(f"drive: its lag of {lags.velocity:.3g} s {small}: {SHORTER}")
    return dataclasses.replace(servo, inertia=inertia, controller=Pid(kp=kp, ki=pid.ki, kd=kd))


def lags_taken(
    records: Sequence[Record], servo: Servo, gains: Sequence[float], free: Sequence[str], drive: Drive | None
) -> Lags | None:
    """Those that are taken into account: where friction alone is sought, from positions alone.

    Raises InputError: they are too long for that.
    """
    of_friction = all(name.startswith(FRICTION) for name in free)
    if drive is None or not of_friction or any(record.torque is not None for record in records):
        return None
    lags = lags_of(drive, servo, max(gains))
    for gain in gains:
        as_continuous(servo, gain, lags)
    if lags.left_out > MOST_LEFT_OUT:
        raise InputError(
            f"drive: its lag of {lags.velocity:.3g} s is too long for a fit, which leaves out {lags.left_out:.2g} of "
            f"the amplitude then, more than {MOST_LEFT_OUT:g}: {SHORTER}"
        )
    return lags


def shaken_by(servo: Servo, gain: float, drive: Drive) -> float:
    """The torque that a count makes by the derivative, as a part of static friction; 0 without an encoder."""
    _, kd, _ = servo.torque_gains(gain)
    return kd * drive.count / (drive.sample_time + drive.filter_of(servo.controller)) / servo.friction.static
