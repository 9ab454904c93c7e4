"""Intervals of parameters by profile likelihood: how far one can go while the others make up for it.

    D_j(z_j) = min of D over all other unknowns,    interval:  D_j - D_min <= t^2 f

t: two-sided 95 % point of Student's distribution with the degrees of freedom that the samples leave; f >= 1: by how
much the residuals scatter more than the noise says (judgement.py).  sqrt(D_j - D_min) is nearly linear in z_j: secants
through the best point end in two or three refits, each from where the linear model says that the others will be.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from .fit import NEXT_TO_NOTHING, Array, Point, Question, at, climb, expected
from .likelihood import Noise

NORMAL_95 = 1.959964
FAR_OUT_FACTOR = 10.0
"""A parameter that may be ten times as large, or ten times its scale, is not bounded."""
MOST_REFITS = 12
END_NEAR = 0.03
"""Relative distance from the end of an interval, at which the secant is as good as a refit."""
MOST_UNSURE = 1
"""Refits of one end that may stop short of their optimum."""
MOST_REFIT_STEPS = 60
REFIT = 0.05
"""Decrease of the deviance that ends a refit: one per cent of the 3.84 of an interval."""
BELOW_BEST = 0.2
"""Decrease of the deviance below the best that shows that it was none."""
UNSURE_PART = 0.1
"""Part of the rise by which a refit may lie above its optimum: the end of the interval is then off by a twentieth."""
LONGEST_STRIDE = 3.0
"""Factor by which a step outwards may be longer than the last one."""
FIRST_REACH = 0.5
"""Of an unknown: the first step is no longer, however little is known."""


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


def _farthest(question: Question, best: Point, j: int, sign: int) -> float:
    """How far the unknown may go before it is said that nothing bounds it."""
    q, scale = question.numbers(best.z), question.scales[j]
    size = q[j]
    q[j] = max(FAR_OUT_FACTOR * size, FAR_OUT_FACTOR * scale) if sign > 0 else 0.0
    return abs(float(question.unknowns(q)[j] - best.z[j]))


def _end(question: Question, best: Point, noises: Sequence[Noise], j: int, sign: int, rise: float) -> float:
    """How far z_j goes to one side; infinite where nothing bounds it."""
    others = np.array([i for i in range(best.z.size) if i != j and best.z[i] > NEXT_TO_NOTHING])
    H = best.curvature
    follow = np.zeros(best.z.size)
    follow[others] = -np.linalg.lstsq(H[np.ix_(others, others)], H[others, j], rcond=1e-13)[0]
    follow[j] = 1.0
    bend = max(float(follow @ H @ follow), 1e-12)
    wanted, point, wall, ends, unsure = math.sqrt(rise), best, math.inf, False, 0
    below, above = (0.0, 0.0), (math.inf, math.inf)
    farthest = _farthest(question, best, j, sign)
    if farthest == 0 or best.z[j] > 0 and wanted > 2 * math.sqrt(bend) * farthest:
        return sign * math.inf  # next to nothing already, or the others make up for all of it
    reach = min(wanted / math.sqrt(bend), FIRST_REACH * max(best.z[j], 1.0), farthest)
    for _ in range(MOST_REFITS):
        trial = _refit(question, point, point.z + (sign * reach - (point.z[j] - best.z[j])) * follow, noises, j)
        if trial is not None and trial.deviance < best.deviance - BELOW_BEST:
            raise BetterFound(trial)
        if trial is None or expected(trial, j) > UNSURE_PART * max(rise, trial.deviance - best.deviance):
            wall, ends, reach = reach, trial is None, (below[0] + reach) / 2
            unsure += trial is not None
            if wall - below[0] < END_NEAR * wall or unsure > MOST_UNSURE:
                break
            continue
        seen = reach, math.sqrt(max(trial.deviance - best.deviance, 0.0))
        if abs(seen[1] / wanted - 1) < END_NEAR:
            return sign * seen[0] * wanted / seen[1]
        if seen[1] > wanted:
            above = seen
        else:
            below, point = seen, trial
            if reach >= farthest:
                return sign * math.inf
        reach = _next(below, above, wanted, min((below[0] + wall) / 2, farthest))
        if above[0] < math.inf and above[0] - below[0] < END_NEAR * above[0]:
            return sign * reach
    if ends and above[0] == math.inf and wall - below[0] < END_NEAR * wall:
        return sign * wall  # the model has no cycle beyond
    raise Unsettled


def _refit(question: Question, near: Point, z: Array, noises: Sequence[Noise], j: int) -> Point | None:
    """The likeliest point from z with z_j as it is; None where the model has no cycle.

    The way there is that of the stretched problem, whose slips stay where they are while the period is not yet right.
    """
    plain = [noise.plain for noise in noises]
    z[: near.k] = np.maximum(z[: near.k], NEXT_TO_NOTHING)
    trial = at(question, z, plain, near, stretched=True)
    if trial is None:
        return None
    trial = climb(question, trial, plain, stretched=True, held=j, settled=REFIT, most=MOST_REFIT_STEPS)
    trial = at(question, trial.z, noises, trial)
    return None if trial is None else climb(question, trial, noises, held=j, settled=REFIT, most=MOST_REFIT_STEPS)


def _next(below: tuple[float, float], above: tuple[float, float], wanted: float, most: float) -> float:
    """Where the rise is expected that is wanted, from (reach, root of the rise) on both sides of it."""
    if above[0] < math.inf:
        slope = (above[1] - below[1]) / (above[0] - below[0])
        return below[0] + (wanted - below[1]) / slope
    return min(below[0] * min(wanted / max(below[1], 1e-6), LONGEST_STRIDE), most)


def marginal_information(question: Question, point: Point) -> Array:
    """(k, k) curvature of half the deviance in the logarithms of the parameters, phases and offsets refitted."""
    H, k = point.curvature, len(question.free)
    rest = H[k:, k:]
    J = H[:k, :k] - H[:k, k:] @ np.linalg.lstsq(rest, H[k:, :k], rcond=1e-13)[0]
    by_logarithm = question.numbers(point.z) / question.rates(point.z)
    return np.asarray(J * by_logarithm[:, None] * by_logarithm)
