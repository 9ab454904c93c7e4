"""The likeliest model of records, of all starts; and whether it is at another gain that a model explains them.

    K -> c K,  F -> c F,  J -> c J    leaves every motion as it is

So where inertia matters a wrong gain is seen, and where it does not any gain explains a record, with a friction that is
wrong by the same factor: then positions do not tell.  It is the gain that does not fit where no friction explains a
record, and one does once the motor gain, with which all torque goes, is free too; where the same model with F/c
explains it at the gain as it is stated, that is what the starts have missed.

And it is positions that are cut off, where a model explains all samples but those at the ends, and goes beyond these.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from .climb import FIRST_STEPS, MOST_FIT_STEPS, ROUGHLY_SETTLED, settled_from
from .clipped import CLIPPED_SHARE
from .fit import Array, Data, Point, Question, at, sharpened
from .judgement import judged
from .likelihood import Noise
from .noise import with_noise
from .start import MOTOR_GAIN, STRIBECK, lowest_of, scales_of, starts

ONE_POINT, RIVAL = 1.0, 30.0
"""Difference of the deviances of one point reached twice; and of another optimum that the counts may prefer."""
OTHER_GAIN = 1.25
"""Factor from which on a gain is another one: less makes up for what a model lacks, such as a filter or a delay."""
FARTHEST_GAIN = 100.0
"""And up to which it is one that was mistaken: three times the factors that are tried (start.py)."""
BEYOND_NOISE = 3.0
"""Standard deviations of the noise, besides half a count, from which on a model goes beyond the end of a record."""
FEWEST_COUNTS = 10.0
"""Of the amplitude, below which rounding decides how a servo hunts, and a gain that fits says nothing."""


def best_of_starts(
    question: Question, most: int = MOST_FIT_STEPS, may_be: Callable[[Point], bool] = lambda _: True
) -> tuple[Point, list[Noise]] | None:
    """The likeliest point of those that the starts lead to, and the noise of each record.

    Starts are gone from until two of them lead to one point, with rounding as an error like any other; what may then
    still be the likeliest is told by the counts.  None where no start hunts, or the likeliest end may
    not be.
    """
    plain = _plain(question)
    ends: list[Point] = []
    for z in starts(question):
        point = settled_from(question, z, plain, settled=ROUGHLY_SETTLED, most=most)
        if point is None:
            continue
        again = any(abs(point.deviance - end.deviance) < ONE_POINT for end in ends)
        ends.append(point)
        if again:
            break
    ends.sort(key=lambda end: end.deviance)
    if not ends or not may_be(ends[0]):
        return None
    likely = [ends[0]]
    for end in ends[1:]:
        if ONE_POINT < end.deviance - likely[-1].deviance and end.deviance - ends[0].deviance < RIVAL:
            likely.append(end)
    found = [with_noise(question, end, plain) for end in likely]
    return min(found, key=lambda each: each[0].deviance)


def _plain(question: Question) -> list[Noise]:
    """Noise of each record with rounding as an error like any other."""
    return [Noise(data.size, 0.0) for data in question.records]


def gain_that_fits(question: Question) -> tuple[float, Array] | None:
    """The factor of the gain with which the model explains the records, and unknowns from which it is tried without.

    None where none was found; asked where it does not explain them as they are stated.
    """
    few = any(data.amplitude < FEWEST_COUNTS * data.quantum for data in question.records)
    if few or MOTOR_GAIN in question.free:
        return None
    free, servo = (*question.free, MOTOR_GAIN), question.servo
    scales, lowest = scales_of(question.records[0], servo, free), lowest_of(servo, free)
    freed = replace(question, free=free, scales=scales, lowest=lowest)

    def factor_of(point: Point) -> float:
        return freed.values(point.z)[MOTOR_GAIN] / float(servo.motor_gain)

    def another(point: Point) -> bool:
        return math.log(OTHER_GAIN) < abs(math.log(factor_of(point))) < math.log(FARTHEST_GAIN)

    found = best_of_starts(freed, FIRST_STEPS, another)
    if found is None:
        return None
    freed, point = sharpened(freed, *found)
    if not another(point) or not judged(freed, point, found[1]).explained:
        return None
    values, factor = freed.values(point.z), factor_of(point)
    torques = [name for name in question.free if name.startswith(("servo.inertia", "friction.")) and name != STRIBECK]
    own = [values[name] / (factor if name in torques else 1.0) for name in question.free]
    return factor, np.concatenate([question.unknowns(np.array(own)), point.z[len(free) :]])


def explained_from(question: Question, z: Array) -> tuple[Point, list[Noise]] | None:
    """The likeliest point to which these unknowns lead, if the model explains the records there, and the noise."""
    point = settled_from(question, z, _plain(question), settled=ROUGHLY_SETTLED)
    if point is None:
        return None
    point, noises = with_noise(question, point, _plain(question))
    sharp, best = sharpened(question, point, noises)
    return (point, noises) if judged(sharp, best, noises).explained else None


def cut_off(question: Question, near: Point) -> tuple[Data, float, float] | None:
    """A record whose positions are cut off, at which end [rad], and how far its model goes beyond that [rad]; or None.

    Without the samples at the ends a model explains the records, from `near` on, and where these are it goes beyond.
    Asked where none explains them with all samples.
    """
    at_ends = [_at_ends(data) for data in question.records]
    if not any(mask.any() for mask in at_ends):
        return None
    kept = replace(question, records=tuple(d.only(~mask) for d, mask in zip(question.records, at_ends, strict=True)))
    found = explained_from(kept, near.z)
    if found is None:
        return None
    point, noises = found
    whole = at(question, point.z, noises, point)
    if whole is None:
        return None
    for data, mask, x, noise in zip(question.records, at_ends, whole.positions, noises, strict=True):
        for end, sign in ((data.position.max(), 1), (data.position.min(), -1)):
            beyond = sign * (x - end)[mask & (data.position == end)]
            if beyond.size and np.median(beyond) > data.quantum / 2 + BEYOND_NOISE * noise.sigma:
                return data, float(end), float(beyond.max())
    return None


def _at_ends(data: Data) -> Array:
    """(m,) which samples lie exactly at an end where many do, and their neighbours: of those the noise has chosen."""
    y = data.position
    mask = np.any([(y == end) & (np.mean(y == end) >= CLIPPED_SHARE) for end in (y.max(), y.min())], axis=0)
    return np.asarray(np.convolve(mask, np.ones(3), "same") > 0)
