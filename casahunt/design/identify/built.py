"""What the loop as built does beside the continuous one that is fitted: its own motion, computed where the fit ends.

    x1(t) = continuous(t; q) + [as built(t; q*) - continuous(t; q*)],    T likewise, by the ratio of the periods at q*

A continuous loop (`as_continuous`) leaves out what is of second order in the lags, some tenths of a per cent of the
amplitude, which a fit would take for per cents of friction; and the counts that the controller reads: a servo that
rests between two is read as nearer or farther, alike in every swing, which shifts the mean swing by a tenth of a count
to a whole one, and the period by per cents.  The drive is followed with its counts (servo/sampled); its mean swing
s -> x about its passages stands beside that of the cycle.  The fit goes on with that difference to another q*, until it
changes no more; the last change is the error that stays (judgement.py).
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import InputError
from ...servo.friction import Model
from ...servo.sampled.motion import simulate_sampled
from ..record.verdict import deviation
from ..record.waveform import SIDE
from .climb import climb
from .fit import Array, Data, Point, Question, at, seen_by
from .likelihood import Noise, Rows
from .noise import with_noise
from .swings import once_each, passages

LEAST_KNOWN = 1e-9
"""Information about the phase of a swing, below which it stays where it is."""
SETTLING, SWINGING = 3, 20
"""Periods of the drive that are left out, and those whose mean is taken."""
ABOUT = 2001
"""Times about a passage at which swings are compared."""
MOST_ROUNDS, FIRST_ROUNDS, SAME_SWING = 6, 2, 1e-4
"""Corrections, those that lead there, and the change of one, relative to the amplitude, after which there is none."""
MOST_BUILT = 1e6
"""That are followed, some seconds; of more, what lags leave out and a count are an error."""


def as_built(question: Question, best: Point, noises: Sequence[Noise]) -> tuple[Question, Point, list[Noise]]:
    """The question and its best point with the loop as built in the place of the continuous one.

    Raises InputError: the drive does not hunt with the friction found.
    """
    measured, noises = tuple(map(once_each, question.records)), list(noises)
    question, rounds = replace(question, records=measured), []
    best = at(question, best.z, noises, best) or best
    for left in reversed(range(MOST_ROUNDS if any(data.drive is not None for data in measured) else 0)):
        rows = iter(best.rows)
        measured = tuple(
            _aligned(first, last, next(row for row in rows if row.values.size > 1), question.own(i).start)
            for i, (first, last) in enumerate(zip(measured, question.records, strict=True))
        )
        servo, laid = question.servo_at(best.z), zip(measured, question.records, best.orbits, strict=True)
        rounds.append(tuple(_beside(first, last, orbit, servo, question.model) for first, last, orbit in laid))
        settled = max(data.left_out for data in rounds[-1]) < SAME_SWING
        settled = settled or all(data.apart is None for data in rounds[-1])
        last_ones = zip(*rounds[FIRST_ROUNDS:], strict=True)
        records = tuple(map(_pooled, last_ones)) if not (left or settled) else rounds[-1]
        question = replace(question, records=records)
        near = at(question, best.z, noises, best)
        if near is None:
            break
        best, noises = with_noise(question, climb(question, near, noises), noises)
        if settled:
            break
    return question, best, noises


def _pooled(each: Sequence[Data]) -> Data:
    """The mean of what was beside the cycle in several rounds, whose differences are errors: counts may bring the drive
    into another pattern with each friction, however near."""
    last, periods = each[-1], np.array([data.period for data in each])
    if last.apart is None or last.passage is None or last.drive is None:
        return last
    ratio, beside = float(periods.mean()) / last.period, np.array([data.beside for data in each])
    passage, other = ratio * last.passage, (beside - beside.mean(axis=0)) / math.sqrt(len(each) - 1)
    return replace(
        last, times=passage + last.times - last.passage, passage=passage, period=ratio * last.period,
        beside=beside.mean(axis=0), apart=np.column_stack([last.apart, other.T]),
        period_error=math.hypot(last.period_error, deviation(periods) / last.period),
        left_out=0.0,
    )  # fmt: skip


def _aligned(first: Data, last: Data, row: Rows, phase: int) -> Data:
    """A record whose swings lie where each fits best: few samples of a slip do not tell when it passes its level.

    first, last: as it was measured, and as it was fitted; row: what its positions say; phase: its unknown.
    """
    if last.passage is None:
        return first
    swing, J = np.unique(last.passage, return_inverse=True)[1], row.J[:, phase]
    late = np.bincount(swing, J * row.score) / np.maximum(np.bincount(swing, J * J * row.weights), LEAST_KNOWN)
    return replace(first, times=first.times - (late - late.mean())[swing] * last.period)


def _beside(first: Data, last: Data, orbit: Any, servo: Any, model: Model | None) -> Data:
    """A record with what its drive does beside the cycle of a continuous loop.

    first, last: as it was measured, and with what was taken for that before.
    """
    whole = (SETTLING + SWINGING) * orbit.period
    if first.drive is None or first.passage is None or first.rising is None:
        return first
    if whole > MOST_BUILT * first.drive.sample_time:
        return replace(first, left_out=first.left_out + first.count / first.amplitude)
    s = np.linspace(-orbit.period / 4, orbit.period / 4, ABOUT)
    times, states = orbit.sample(2 * ABOUT)
    three, place = np.concatenate([times[:-1] + k * orbit.period for k in range(3)]), seen_by(servo)
    cycle = _swings(three, np.tile(states[place, :-1], 3), s)[0].mean(axis=0)
    drive = replace(first.drive.quiet(), encoder=2 * math.pi / first.count if first.count else 0.0)
    seen = simulate_sampled(
        servo, first.gain, drive, model=model, set_point=0.0, position=-orbit.amplitude, time=whole,
    )  # fmt: skip
    read = seen.states[seen.names.index(seen.loop.system.states[place])]
    if seen.verdict.kind != "hunting":
        raise InputError(
            f"{first.name}: the drive that is described does not hunt with the friction that would explain it: "
            f"{seen.verdict.sentence}; are its sample time, delay and filter right?"
        )
    later = seen.times > SETTLING * orbit.period
    swings, lasts = _swings(seen.times[later], read[later], s)
    swing, period = swings.mean(axis=0), 2 * float(lasts.mean())
    apart, unsure = (swings - swing) / math.sqrt(len(swings) - 1), deviation(lasts[1:] + lasts[:-1]) / period
    ratio, at_samples = orbit.period / period, first.times - first.passage
    passage = ratio * first.passage
    beside = first.rising * np.interp(at_samples, s, swing - cycle)
    chance = (float(np.mean(apart**2)) / first.amplitude**2 + unsure**2) / len(swings)
    changed = float(np.mean((beside - last.beside) ** 2)) / first.amplitude**2
    changed += (first.period * ratio / last.period - 1) ** 2
    part = math.sqrt(1 / len(swings) + 1 / np.unique(first.passage).size)
    return replace(
        first, times=passage + at_samples, passage=passage, period=ratio * first.period, beside=beside,
        period_error=math.hypot(first.period_error, unsure / math.sqrt(len(swings))),
        apart=np.column_stack([part * first.rising * np.interp(at_samples, s, each) for each in apart]),
        left_out=math.sqrt(max(changed - 2 * chance, 0.0)),
    )  # fmt: skip


def _swings(t: Array, x: Array, s: Array) -> tuple[Array, Array]:
    """Of positions x (m,) the swings upwards (n, s) at times s about their passages; and how long they last (n,)."""
    at, rising = passages(t, x, SIDE * float(np.abs(x).max()))
    whole = slice(1, 2 * ((at.size - 1) // 2))
    each = [sign * np.interp(when + s, t, x) for when, sign in zip(at[whole], rising[whole], strict=True)]
    return np.array(each), np.diff(at[whole.start - 1 : whole.stop])
