"""What the loop as built does beside the continuous one that is fitted: its own motion, computed where the fit ends.

    x1(t) = continuous(t; q) + [as built(t; q*) - continuous(t; q*)],    T likewise, by the ratio of the periods at q*

lags.py leaves out what is of second order in the lags, some tenths of a per cent of the amplitude, which a fit would
take for per cents of friction.  The drive is followed without its counts (servo/sampled), which shift single swings and
hardly their mean; its mean swing s -> x about its passages stands beside that of the cycle.  The fit goes on with that
difference to another q*, until it changes no more; the last change is the error that stays (judgement.py).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ...errors import InputError
from ...servo.hunting import Model
from ...servo.problem import HuntingOrbit
from ...servo.sampled.motion import simulate_sampled
from ...servo.servo import Servo
from ..record.waveform import SIDE
from .climb import climb
from .fit import Array, Data, Point, Question, at
from .likelihood import Noise, Rows
from .noise import with_noise
from .swings import passages

LEAST_KNOWN = 1e-9
"""Information about the phase of a swing, below which it stays where it is."""
SETTLING, SWINGING = 3, 10
"""Periods of the drive that are left out, and those whose mean is taken."""
ABOUT = 201
"""Times about a passage at which swings are compared."""
MOST_ROUNDS, SAME_SWING = 6, 1e-4
"""Corrections, and the change of one, relative to the amplitude, after which there is none; what lags leave out that
is less is left out."""
MOST_BUILT = 1e6
"""That are followed, some seconds; of more, what lags leave out counts as an error."""


def as_built(question: Question, best: Point, noises: Sequence[Noise]) -> tuple[Question, Point, list[Noise]]:
    """The question and its best point with the loop as built in the place of the continuous one.

    Raises InputError: the drive does not hunt with the friction found.
    """
    measured, noises = question.records, list(noises)
    for _ in range(MOST_ROUNDS if any(data.lags is not None for data in measured) else 0):
        rows = iter(best.rows)
        measured = tuple(
            _aligned(first, last, next(row for row in rows if row.values.size > 1), question.own(i).start)
            for i, (first, last) in enumerate(zip(measured, question.records, strict=True))
        )
        servo, laid = question.servo_at(best.z), zip(measured, question.records, best.orbits, strict=True)
        records = tuple(_beside(first, last, orbit, servo, question.model) for first, last, orbit in laid)
        question = replace(question, records=records)
        near = at(question, best.z, noises, best)
        if near is None:
            break
        best, noises = with_noise(question, climb(question, near, noises), noises)
        if max(data.lags.left_out for data in records if data.lags is not None) < SAME_SWING:
            break
    return question, best, noises


def _aligned(first: Data, last: Data, row: Rows, phase: int) -> Data:
    """A record whose swings lie where each fits best: few samples of a slip do not tell when it passes its level.

    first, last: as it was measured, and as it was fitted; row: what its positions say; phase: its unknown.
    """
    if last.passage is None:
        return first
    swing, J = np.unique(last.passage, return_inverse=True)[1], row.J[:, phase]
    late = np.bincount(swing, J * row.score) / np.maximum(np.bincount(swing, J * J * row.weights), LEAST_KNOWN)
    return replace(first, times=first.times - (late - late.mean())[swing] * last.period)


def _beside(first: Data, last: Data, orbit: HuntingOrbit, servo: Servo, model: Model) -> Data:
    """A record with what its drive does beside the cycle of a continuous loop.

    first, last: as it was measured, and with what was taken for that before.
    """
    whole = (SETTLING + SWINGING) * orbit.period
    if first.lags is None or first.passage is None or first.rising is None:
        return first
    if first.lags.left_out < SAME_SWING or whole > MOST_BUILT * first.lags.drive.sample_time:
        return first
    s = np.linspace(-orbit.period / 4, orbit.period / 4, ABOUT)
    cycle, _ = _mean_swing(*_twice(orbit), s)
    drive = replace(first.lags.drive, encoder=0.0, quantise_torque=0.0)
    seen = simulate_sampled(
        servo, first.gain, drive, model=model, set_point=0.0, position=-orbit.amplitude, time=whole,
    )  # fmt: skip
    if seen.verdict.kind != "hunting":
        raise InputError(
            f"{first.name}: the drive that is described does not hunt with the friction that would explain it: "
            f"{seen.verdict.sentence}; are its sample time, delay and filter right?"
        )
    later = seen.times > SETTLING * orbit.period
    swing, period = _mean_swing(seen.times[later], seen.states[0, later], s)
    ratio = orbit.period / period
    passage = ratio * first.passage
    beside = first.rising * np.interp(first.times - first.passage, s, swing - cycle)
    changed = float(np.sqrt(np.mean((beside - last.beside) ** 2))) / first.amplitude
    changed += abs(first.period * ratio / last.period - 1)
    return replace(
        first, times=passage + first.times - first.passage, passage=passage, period=ratio * first.period, beside=beside,
        lags=first.lags._replace(left_out=changed),
    )  # fmt: skip


def _twice(orbit: HuntingOrbit) -> tuple[Array, Array]:
    """Times and positions of three periods."""
    times, states = orbit.sample(20 * ABOUT)
    t = np.concatenate([times[:-1] + k * orbit.period for k in range(3)])
    return t, np.tile(states[0, :-1], 3)


def _mean_swing(t: Array, x: Array, s: Array) -> tuple[Array, float]:
    """Of positions x (m,) the mean swing upwards at the times s about its passage, and the period."""
    at, rising = passages(t, x, SIDE * float(np.abs(x).max()))
    whole = slice(1, 2 * ((at.size - 1) // 2))
    each = [sign * np.interp(when + s, t, x) for when, sign in zip(at[whole], rising[whole], strict=True)]
    return np.mean(each, axis=0), 2 * float(np.mean(np.diff(at[whole.start - 1 : whole.stop])))
