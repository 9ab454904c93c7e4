"""The likeliest model of records, of all starts; and whether it is at another gain that a model explains them.

    K -> c K,  F -> c F,  J -> c J    leaves every motion as it is

So where inertia matters a wrong gain is seen, and where it does not any gain explains a record, with a friction that is
wrong by the same factor: then positions do not tell.  It is the gain that does not fit where no friction explains a
record, and one does once the motor gain, with which all torque goes, is free too; where the same model with F/c
explains it at the gain as it is stated, that is what the starts have missed.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ...servo.servo import flatten
from .climb import FIRST_STEPS, MOST_FIT_STEPS, ROUGHLY_SETTLED, settled_from
from .fit import Array, Point, Question, sharpened
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
FEWEST_COUNTS = 10.0
"""Of the amplitude, below which rounding decides how a servo hunts, and a gain that fits says nothing."""


def best_of_starts(question: Question, most: int = MOST_FIT_STEPS) -> tuple[Point, list[Noise]] | None:
    """The likeliest point of those that the starts lead to, and the noise of each record.

    Starts are gone from until two of them lead to one point, with rounding as an error like any other; what may then
    still be the likeliest is told by the counts.  None where no start hunts.
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
    if not ends:
        return None
    ends.sort(key=lambda end: end.deviance)
    likely = [ends[0]]
    for end in ends[1:]:
        if ONE_POINT < end.deviance - likely[-1].deviance and end.deviance - ends[0].deviance < RIVAL:
            likely.append(end)
    found = [with_noise(question, end, plain) for end in likely]
    return min(found, key=lambda each: each[0].deviance)


def _plain(question: Question) -> list[Noise]:
    """Noise of each record with rounding as an error like any other."""
    return [Noise(data.size, 0.0) for data in question.records]


class OtherGain(NamedTuple):
    """The factor of the gain with which the model explains records, and unknowns from which it is tried without."""

    factor: float
    z: Array


def gain_that_fits(question: Question) -> OtherGain | None:
    """The other gain with which the model explains the records; None where none was found.

    Asked where it does not explain them as they are stated.
    """
    few = any(data.amplitude < FEWEST_COUNTS * data.quantum for data in question.records)
    if few or MOTOR_GAIN in question.free:
        return None
    free, servo = (*question.free, MOTOR_GAIN), question.servo
    scales, lowest = scales_of(question.records[0], servo, free), lowest_of(servo, free)
    freed = replace(question, free=free, scales=scales, lowest=lowest)
    found = best_of_starts(freed, FIRST_STEPS)
    if found is None:
        return None
    freed, point = sharpened(freed, *found)
    values = freed.values(point.z)
    factor = values[MOTOR_GAIN] / flatten(servo)[MOTOR_GAIN]
    other = math.log(OTHER_GAIN) < abs(math.log(factor)) < math.log(FARTHEST_GAIN)
    if not other or not judged(freed, point, found[1]).explained:
        return None
    own = [values[name] / (factor if _goes_with_torque(name) else 1.0) for name in question.free]
    return OtherGain(factor, np.concatenate([question.unknowns(np.array(own)), point.z[len(free) :]]))


def _goes_with_torque(name: str) -> bool:
    """Whether a parameter is one of F or J, which are divided by c where the gain is as it was stated."""
    return name == "servo.inertia" or name.startswith("friction.") and name != STRIBECK


def explained_from(question: Question, z: Array) -> tuple[Point, list[Noise]] | None:
    """The likeliest point to which these unknowns lead, if the model explains the records there, and the noise."""
    point = settled_from(question, z, _plain(question), settled=ROUGHLY_SETTLED)
    if point is None:
        return None
    point, noises = with_noise(question, point, _plain(question))
    sharp, best = sharpened(question, point, noises)
    return (point, noises) if judged(sharp, best, noises).explained else None
