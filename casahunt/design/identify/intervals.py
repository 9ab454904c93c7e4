"""Intervals of parameters by profile likelihood: how far one can go while the others make up for it.

    D_j(z_j) = min of D over all other unknowns,    interval:  D_j - D_min <= t^2 f

t: two-sided 95 % point of Student's distribution with the degrees of freedom that the samples leave; f >= 1: by how
much the residuals scatter more than the noise says (judgement.py).  sqrt(D_j - D_min) is nearly linear in z_j: secants
through the best point end in two or three refits, each from where the linear model says that the others will be.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from .climb import LEAST_DAMPING, climb, expected, gain, step, too_long, within
from .fit import MOST_OF_A_STEP, NEXT_TO_NOTHING, Array, Point, Question, at
from .likelihood import Noise
from .start import SCALE

NORMAL_95 = 1.959964
FAR_OUT_FACTOR = 10.0
"""A parameter that may be ten times as large, or ten times its scale, is not bounded; one that bends the friction, at
the largest speed of a slip: its slope at next to nothing does not say how far it may go."""
MOST_REFITS = 24
END_NEAR, END_CLOSE = 0.1, 0.03
"""Relative distance from the end of an interval, at which its slope is as good as a refit; and between two refits on
both sides of a jump of the deviance."""
STEP_HALVINGS, NEXT_TO_NO_STEP = 10, 0.02
"""Of a step that is too long; and part of it that is next to nothing."""
SHORT_WAY = 1e-6
"""Of an unknown: so far no other one comes to its end."""
BETWEEN_REFITS = 0.15
"""Part of what is between two refits that the next one keeps from either."""
LITTLE_RISE = 0.1
"""Of the deviance per sample: up to there the model is linear in all unknowns."""
MOST_UNSURE = 1
"""Refits of one end that may stop short of their optimum."""
MOST_REFIT_STEPS = 150
REFIT = 0.02
"""Decrease of the deviance that is expected where a refit ends: a two hundredth of the rise at the end of an interval.
With a tenth of that the ends are the same to three digits, behind a third more cycles."""
NO_RISE = 0.1
"""Root of the deviance's rise, in units of that at the end, below which it says nothing."""
BELOW_BEST = 0.2
"""Decrease of the deviance below the best that shows that it was none."""
UNSURE_PART = 0.1
"""Part of the rise by which a refit may lie above its optimum: the end of the interval is then off by a twentieth."""
STRIDE_GROWTH = 1.5
"""Of strides behind one that was too long."""
OUR_PART, FOLLOWED_PART, FAR_LONGER, LITTLE_LONGER = 0.5, 0.3, 0.5, 0.01
"""Part of the rise that may be there because another parameter is followed no further; by which factor it is then
followed further, and how much longer the interval is there, relatively, if it has no end: more than a little of what
the parameter is, too."""
LONGEST_STRIDE = 3.0
"""Factor by which a step outwards may be longer than the last one."""
MODEL_RISE = 2.0
"""Of what the deviance is to rise by, as much as the linear model may expect of a step."""


class BetterFound(Exception):
    """A refit came out below the best point: climb from there."""

    def __init__(self, point: Point) -> None:
        super().__init__()
        self.point = point


class Unsettled(Exception):
    """A refit stopped short of its optimum: where the interval ends is not known."""


@dataclass(frozen=True)
class Interval:
    """What a parameter may be: low, high; 0 and infinity where the record does not bound it."""

    low: float
    high: float


def student_95(freedom: float) -> float:
    """Two-sided 95 % point of Student's distribution, by the first terms of Cornish and Fisher's expansion."""
    z, n = NORMAL_95, max(freedom, 3.0)
    return z + (z**3 + z) / (4 * n) + (5 * z**5 + 16 * z**3 + 3 * z) / (96 * n**2)


def profile(question: Question, best: Point, noises: Sequence[Noise], j: int, rise: float) -> Interval:
    """The interval of parameter j in which the deviance rises by less than `rise`.

    Raises BetterFound: a refit came out below the best point; Unsettled: one stopped short of its optimum.
    """
    ends = []
    for sign in (-1, 1):
        z = best.z.copy()
        z[j] += _end(question, best, noises, j, sign, rise)
        ends.append(float(question.numbers(z)[j]) if math.isfinite(z[j]) else 0.0 if sign < 0 else math.inf)
    return Interval(*ends)


class _Seen(NamedTuple):
    """A place on a profile: how far out, root of the rise of the deviance there, and slope of that root."""

    reach: float
    root: float
    slope: float


def _end(question: Question, best: Point, noises: Sequence[Noise], j: int, sign: int, rise: float) -> float:
    """How far z_j goes to one side; infinite where nothing bounds it."""
    way = _way(best, j, sign)
    first = math.sqrt(max(float(way @ best.curvature @ way), 1e-12))
    q, wanted = question.numbers(best.z), math.sqrt(rise)
    least = question.scales[j] / (SCALE if question.bends[j] else 1.0)
    q[j] = FAR_OUT_FACTOR * max(q[j], least) if sign > 0 else 0.0
    farthest = abs(float(question.unknowns(q)[j] - best.z[j]))  # before it is said that nothing bounds it
    if farthest == 0 or wanted > 2 * first * farthest and not (sign > 0 and question.bends[j]):
        return sign * math.inf  # next to nothing already, or the others make up for all of it, as linear as it is
    point, below, above, stride, unsure = best, _Seen(0.0, 0.0, first), None, math.inf, 0
    for _ in range(MOST_REFITS):
        by = min(_next(below, above, wanted, farthest) - below.reach, stride)
        room = MODEL_RISE * rise - (point.deviance - best.deviance) if above is None else math.inf
        dz = _outwards(point, j, sign * by, room)
        by = abs(float(dz[j]))
        reach = below.reach + by
        trial = _refit(question, best, point, dz, noises, j)
        if trial is not None and trial.deviance < best.deviance - BELOW_BEST:
            raise BetterFound(trial)
        if trial is None or expected(trial, j) > UNSURE_PART * max(rise, trial.deviance - best.deviance):
            stride, unsure = by / 2, unsure + (trial is not None)
            if unsure > MOST_UNSURE:
                break
            if by < END_NEAR * reach and trial is None and above is None:
                return sign * reach  # the model has no cycle beyond
            continue
        seen = _seen(best, trial, j, sign, first, wanted)
        if seen.root < (1 + END_NEAR) * wanted and _only_ours(question, best, trial, noises, j, seen, first, wanted):
            return sign * math.inf
        more = (wanted - seen.root) / seen.slope if seen.slope > 0 else math.inf
        if abs(seen.root / wanted - 1) < END_NEAR and abs(more) < 2 * END_NEAR * reach:
            return sign * (reach + more if reach + more < farthest else math.inf)
        if seen.root > wanted:
            above = seen
        else:
            below, point, stride = seen, trial, STRIDE_GROWTH * stride
            if reach >= farthest:
                return sign * math.inf
        if above is not None and above.reach - below.reach < END_CLOSE * above.reach:
            return sign * above.reach
    raise Unsettled


def _seen(best: Point, point: Point, j: int, sign: int, first: float, wanted: float) -> _Seen:
    """A refit on a profile.  Where there is no rise its slope is none either, but `first`, that at the best point: its
    deviance is known to some hundredths."""
    root = math.sqrt(max(point.deviance - best.deviance, 1e-12))
    slope = first if root < NO_RISE * wanted else -float(_way(point, j, sign) @ point.gradient) / root
    return _Seen(abs(float(point.z[j] - best.z[j])), root, slope)


def _only_ours(
    question: Question, best: Point, point: Point, noises: Sequence[Noise], j: int, seen: _Seen, first: float,
    wanted: float,
) -> bool:  # fmt: skip
    """Whether an interval ends there only because another parameter that may not be nothing is followed no further: a
    little further it ends far off."""
    ours, above = question.lowest == NEXT_TO_NOTHING, point.deviance - best.deviance
    if not np.any(ours & (point.z[: point.k] <= point.lowest)):
        return False
    further = replace(question, lowest=np.where(ours, FOLLOWED_PART * question.lowest, question.lowest))
    near = replace(point, lowest=further.unknowns(np.zeros(point.k)))
    if expected(near, j) < OUR_PART * above:
        return False
    again = _refit(further, best, near, step(near, LEAST_DAMPING, j), noises, j)
    if again is None or point.deviance - again.deviance < OUR_PART * above:
        return False
    sign = 1 if point.z[j] > best.z[j] else -1
    ahead = _seen(best, again, j, sign, first, wanted)
    return wanted - ahead.root > ahead.slope * max(FAR_LONGER * seen.reach, LITTLE_LONGER * abs(point.z[j]))


def _outwards(point: Point, j: int, by: float, room: float) -> Array:
    """The step with z_j further by so much, or less, of which no rise of the deviance beyond the room is expected; the
    shortest that is tried, where that is expected of all.

    The others go by bends, where one of them comes to its end: what made up for z_j until then does so no more.
    Where that leaves next to nothing, they stay behind along what is hardly known.
    """

    def fits(dz: Array) -> bool:
        return too_long(point, dz) == 1 and -gain(point, dz) <= room

    dz = step(point, LEAST_DAMPING, j, by)
    if fits(dz):
        return dz
    short, long = 0.0, by
    for _ in range(STEP_HALVINGS):
        middle = (short + long) / 2
        if fits(step(point, LEAST_DAMPING, j, middle)):
            short = middle
        else:
            long = middle
    dz = step(point, LEAST_DAMPING, j, short or long)
    if abs(dz[j]) > NEXT_TO_NO_STEP * abs(by):
        return dz
    for _ in range(STEP_HALVINGS):
        behind = within(point, MOST_OF_A_STEP, j, by)
        if -gain(point, behind) <= room:
            return max(dz, behind, key=lambda each: float(abs(each[j])))
        by /= 2
    return dz


def _way(point: Point, j: int, sign: int) -> Array:
    """How all unknowns go along a profile."""
    return (step(point, LEAST_DAMPING, j, sign * SHORT_WAY) - step(point, LEAST_DAMPING, j)) / SHORT_WAY


def _refit(question: Question, best: Point, near: Point, dz: Array, noises: Sequence[Noise], j: int) -> Point | None:
    """The likeliest point with the z_j behind a step; None where the model has no cycle.

    From where the linear model says that the others will be.  Where that is not near enough, which the period of a
    record of many soon makes, the way is that of the stretched problem, whose slips stay where they are.
    """

    def refitted(point: Point | None, stretched: bool) -> Point | None:
        return point and climb(
            question, point, noises, stretched=stretched, held=j, settled=REFIT, most=MOST_REFIT_STEPS,
        )  # fmt: skip

    z = near.z + dz
    z[: near.k] = np.maximum(z[: near.k], near.lowest)
    trial = at(question, z, noises, near)
    samples = sum(data.times.size for data in question.records)
    if trial is not None and trial.deviance - best.deviance > LITTLE_RISE * samples:
        again = refitted(at(question, z, noises, trial, stretched=True), True)
        trial = again and at(question, again.z, noises, again)
    return refitted(trial, False)


def _next(below: _Seen, above: _Seen | None, wanted: float, most: float) -> float:
    """Where the rise is expected that is wanted: by the slope on the inner side of it, or between both sides."""
    if above is None:
        ahead = below.reach + (wanted - below.root) / below.slope if below.slope > 0 else math.inf
        return min(ahead, below.reach * LONGEST_STRIDE or math.inf, most)
    width, s = above.reach - below.reach, np.linspace(BETWEEN_REFITS, 1 - BETWEEN_REFITS, 101)
    left = (1 + 2 * s) * below.root + s * width * below.slope
    right = (3 - 2 * s) * above.root - (1 - s) * width * above.slope
    cubic = (1 - s) ** 2 * left + s**2 * right
    return below.reach + width * float(s[np.argmin(np.abs(cubic - wanted))])


def marginal_information(question: Question, point: Point) -> Array:
    """(k, k) curvature of half the deviance in the logarithms of the parameters, phases and offsets refitted."""
    H, k = point.curvature, len(question.free)
    rest = H[k:, k:]
    J = H[:k, :k] - H[:k, k:] @ np.linalg.lstsq(rest, H[k:, :k], rcond=1e-13)[0]
    by_logarithm = np.where(
        question.bends, question.numbers(point.z) / question.slopes(point.z), np.maximum(point.z[:k], NEXT_TO_NOTHING)
    )
    return np.asarray(J * by_logarithm[:, None] * by_logarithm)
