"""What rounded readings leave unknown of the controller, and so of friction: no sample says so.

The controller of a drive sums what its encoder reads: a servo that sticks at x is read as x + r, |r| <= q/2, and the
same r may come back in each swing.  So friction is overcome at a time that is off by r/x, and torques are those of
gains that are off by as much.  With the gains g = (kp, kd, ki) each wrong by its own e = q/(a sqrt(12)), the amplitude
a, the optimum z of records with the weights W and the derivatives J moves by

    dz_g = (J'WJ)^-1 J'W (dx/d log g) e,        variance of z:  sum over gains and records of dz_g dz_g'

to which the periods of a record add nothing: it is no noise.  Nor do swings repeat: what those of the drive's own
simulation differ by (built.py) moves the mean swing of a record likewise.  Of a controller by times these and the motor
gain, with which all torque goes, stand for the gains, whose slopes have no limit where both times are equal.

Symbols: k parameters, m samples.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from ..nearby import values_of
from .fit import Array, Point, Question, seen_by, state_at
from .intervals import NORMAL_95, Interval
from .torque import torque_of

OF_CONTROLLER = 3
"""Numbers of a controller, with which its gains go; of one by times the motor gain is the third."""


def unread(question: Question, point: Point) -> Array:
    """(n, k) by how much the parameters may be off, a row for each gain of the controller and each record; and one for
    each swing of its simulation."""
    found, k = [np.zeros((0, len(question.free)))], len(question.free)
    rows = iter(point.rows)
    for i, (data, orbit) in enumerate(zip(question.records, point.orbits, strict=True)):
        own = [next(rows) for _ in range(1 + (data.passage is not None) + (data.torque is not None))]
        if not data.count and data.apart is None:
            continue
        servo, seen = getattr(orbit, "servo", question.servo), seen_by(question.servo)
        motor = (name for name in servo.names if name.endswith("motor_gain"))
        names = (*servo.controller_names, *motor)[:OF_CONTROLLER]
        laid, with_period, _ = state_at(orbit, data, point.z[question.own(i)][0], names, stretched=False)
        log_period = laid.period_derivatives / orbit.period
        moved = [laid.derivatives[:, seen] + log_period[:, None] * laid.rates[seen] * with_period]
        if data.passage is not None:
            moved.append(log_period[:, None] / data.period_error)
        if data.torque is not None:
            of_motor = torque_of(orbit, laid, names).derivatives
            moved.append(of_motor - of_motor.mean(axis=1)[:, None])
        pull = sum(each.J.T @ (each.weights[:, None] * by.T) for each, by in zip(own, moved, strict=True))
        e = data.count / (data.amplitude * math.sqrt(12))
        size = e * values_of(servo, names)
        if data.passage is not None:
            level = point.z[question.own(i)][1] * data.amplitude
            read = own[0].J.T @ (own[0].weights * (point.positions[i] - level))
            pull, size = np.column_stack([pull, read]), np.append(size, e)
        if data.apart is not None:
            moves = own[0].J.T @ (own[0].weights[:, None] * data.apart)
            pull, size = np.column_stack([pull, moves]), np.append(size, np.ones(data.apart.shape[1]))
        dz = np.linalg.lstsq(point.curvature, pull, rcond=None)[0][:k]
        found.append((question.slopes(point.z)[:, None] * dz * size).T)
    return np.concatenate(found)


def widened(ends: Sequence[Interval], q: Array, off: Array) -> list[Interval]:
    """Intervals of parameters q (k,) that may also be off by `off` (n, k)."""
    by = NORMAL_95 * np.linalg.norm(off, axis=0)
    return [
        Interval(max(float(at - math.hypot(at - end.low, each)), 0.0), float(at + math.hypot(end.high - at, each)))
        for end, at, each in zip(ends, q, by, strict=True)
    ]
