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

from ...servo.parts.loop import Loop
from ...servo.servo import Servo, flatten
from .fit import Array, Point, Question, seen_by, state_at
from .intervals import NORMAL_95, Interval
from .start import MOTOR_GAIN
from .torque import torque_of

OF_CONTROLLER, GAIN, MOTOR_OF_A_LOOP = 3, "gain", "motor_gain"
"""Numbers of a controller; the factor of them that a record is taken at; and what one by times needs besides."""


def unread(question: Question, point: Point) -> Array:
    """(n, k) by how much the parameters may be off, a row for each gain of the controller and each record; and one for
    each swing of its simulation."""
    found, k = [np.zeros((0, len(question.free)))], len(question.free)
    rows = iter(point.rows)
    for i, (data, orbit) in enumerate(zip(question.records, point.orbits, strict=True)):
        own = [next(rows) for _ in range(1 + (data.passage is not None) + (data.torque is not None))]
        if not data.count and data.apart is None:
            continue
        given = _controller(question.servo if isinstance(question.servo, Loop) else orbit.servo)
        names, seen = tuple(given), seen_by(question.servo)
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
        size = e * np.array(list(given.values()))
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


def _controller(servo: Servo | Loop) -> dict[str, float]:
    """Three numbers of the controller, with which its three gains go, or what stands for them."""
    if isinstance(servo, Loop):
        own = [name for part in servo.present if "kp" in part.gives for name in part.parameters if name != GAIN]
        return {name: servo.value(name) for name in sorted(own, key=MOTOR_OF_A_LOOP.__eq__)[:OF_CONTROLLER]}
    names = (*servo.controller_names, MOTOR_GAIN)[:OF_CONTROLLER]
    return {name: flatten(servo)[name] for name in names}


def widened(ends: Sequence[Interval], q: Array, off: Array) -> list[Interval]:
    """Intervals of parameters q (k,) that may also be off by `off` (n, k)."""
    by = NORMAL_95 * np.linalg.norm(off, axis=0)
    return [
        Interval(max(float(at - math.hypot(at - end.low, each)), 0.0), float(at + math.hypot(end.high - at, each)))
        for end, at, each in zip(ends, q, by, strict=True)
    ]
