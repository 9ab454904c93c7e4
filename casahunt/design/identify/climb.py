"""The way to the likeliest unknowns: Levenberg and Marquardt's, with steps of bounded reach.

    (H + mu diag H) dz = J's,   H = J'CJ        mu: the least with which no parameter changes by more than the reach

Records of many periods know the period far better than all else, so the deviance has narrow curved valleys: a step goes
all the way across, as far as the reach along, bent as the bottom is, and the next ones bring it back there.

Symbols: k parameters, z unknowns, mu damping.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np

from .fit import MOST_OF_A_STEP, Array, Point, Question, at
from .likelihood import Noise

LEAST_DAMPING, MOST_DAMPING, DAMPING_HALVINGS = 1e-13, 1e8, 6
"""And halvings of the logarithm between, which know it to a factor of two."""
FIRST_DAMPING, LESS_DAMPING = 1e-3, 0.1
"""Of steps that start far off, and by which factor that of the next one is less: along what is hardly known they would
stay short."""
ACTIVE_SETS, PULLS = 4, 1e-12
"""Sets that are looked at for each parameter; and part of the gradient with which one leaves its end."""
SHORTEST_STEP = 1e-6
"""Relative change of the parameters below which no step is tried."""
POOR_STEP, REACH_CUT = 0.25, 0.3
"""Part of the expected gain of a step below which the next ones are shorter, by which factor."""
REACH_GROWTH, NEXT_GROWTH = 3.0, 1.5
"""Factors by which a step may be longer than the one before, until one has been too long, and from then on: in a valley
that goes on as it is every other step was in vain, and cost five cycles."""
BACKWARDS, FAR_BACK, BACK_PART = -0.5, 0.5, 0.4
"""Cosine of two steps below which the second one goes back, and part of the first one that it goes back by more; of it
so much is gone: the curvature leaves out how the slopes turn, so steps along what is hardly known may overshoot by
nearly twice, again and again."""
RESTORATIONS = 6
"""Steps that may follow one to a larger deviance, until it counts as taken in vain: a record of many periods knows the
period far better than all else, so a long step along what it hardly knows leaves the bottom of a curved valley by its
square, and the next ones come back to it."""
SMALL_PART, MOST_BENT = 0.1, 1.0
"""Of a step, where its curvature is looked at; and acceleration, in units of the step, above which it is none."""
ACROSS_VALLEY, RESTORED_PART = 0.9, 0.5
"""Part of what was lost that such a step is to bring back, so that it goes across the valley, and not along it once
more; and that by which the excess of the deviance falls in each."""
MOST_FIT_STEPS = 120
FIRST_STEPS = 40
"""Of the stretched fit: one that takes more leads nowhere."""
FIT_SETTLED = 0.01
"""Decrease of the deviance that is expected of a next step, below which there is none: a tenth of a standard
deviation."""
ROUGHLY_SETTLED = 1.0
"""The same of a fit that only leads to the next one, whose noise is another."""


def climb(
    question: Question,
    point: Point,
    noises: Sequence[Noise],
    *,
    stretched: bool = False,
    held: int | None = None,
    settled: float = FIT_SETTLED,
    most: int = MOST_FIT_STEPS,
    far: bool = False,
) -> Point:
    """The likeliest unknowns from a point, evaluated with these noises; `held`: one of them that stays as it is;
    far: they are far off, and steps that are too long are cut instead of damped."""
    reach, growth, mu, before, curved = MOST_OF_A_STEP, REACH_GROWTH, FIRST_DAMPING, np.zeros(point.k), False
    while most > 0 and reach >= SHORTEST_STEP and expected(point, held) >= settled:
        dz = _cut(point, step(point, mu, held), reach) if far else within(point, reach, held)
        way = dz[: point.k] / point.steps
        size, last_size = np.linalg.norm(way), np.linalg.norm(before)
        if not far and way @ before < BACKWARDS * size * last_size and size > FAR_BACK * last_size:
            reach = max(BACK_PART * _length(point, dz), SHORTEST_STEP / BACK_PART)
            dz = within(point, reach, held)
            way = dz[: point.k] / point.steps
        before = way
        hoped, most, last = gain(point, dz), most - 1, math.inf
        trial = None if curved else at(question, _moved(point, dz), noises, point, stretched=stretched)
        if curved or trial is not None and trial.deviance > point.deviance:
            curved, most = True, most - 2
            dz = _bent(question, point, dz, noises, held, stretched)
            trial = at(question, _moved(point, dz), noises, point, stretched=stretched)
        for _ in range(RESTORATIONS):
            if trial is None or not 0 < trial.deviance - point.deviance < RESTORED_PART * last:
                break
            last, most = trial.deviance - point.deviance, most - 1
            trial = at(question, _moved(trial, _across(trial, hoped + last, held)), noises, trial, stretched=stretched)
        length, part = _length(point, dz), -1.0
        if trial is not None and trial.deviance <= point.deviance:
            part, point = (point.deviance - trial.deviance) / hoped, trial
        if part < POOR_STEP:
            reach, growth = REACH_CUT * length, NEXT_GROWTH
        else:
            mu *= LESS_DAMPING
            reach = min(growth * reach, MOST_OF_A_STEP)
    return point


def settled_from(
    question: Question,
    z: Array,
    noises: Sequence[Noise],
    *,
    near: Point | None = None,
    settled: float = FIT_SETTLED,
    most: int = MOST_FIT_STEPS,
) -> Point | None:
    """The likeliest unknowns from far off: of the stretched problem, which has no narrow valleys, and from there.

    None where there is no cycle.
    """
    point = at(question, z, noises, near, stretched=True)
    if point is not None:
        point = climb(question, point, noises, stretched=True, most=FIRST_STEPS, settled=ROUGHLY_SETTLED, far=True)
        point = at(question, point.z, noises, point)
    return None if point is None else climb(question, point, noises, most=most, settled=settled)


def expected(point: Point, held: int | None = None) -> float:
    """Decrease of the deviance that is expected of a step without damping: 0 at an optimum."""
    return gain(point, step(point, LEAST_DAMPING, held))


def gain(point: Point, dz: Array) -> float:
    """Decrease of the deviance that is expected of a step."""
    return float(dz @ (2 * point.gradient - point.curvature @ dz))


def step(point: Point, mu: float, held: int | None = None, by: float = 0.0) -> Array:
    """The best damped step in which no free parameter goes below next to nothing; what is held is moved `by` so much.

    By active sets (Lawson and Hanson, Solving Least Squares Problems, 1974, ch. 23): on the way to where the free ones
    are best those that come to their ends stay there, until they would rather leave.
    """
    dz, free = np.zeros(point.z.size), np.ones(point.z.size, bool)
    if held is not None:
        dz[held], free[held] = by, False
    lowest, ended = np.full(point.z.size, -np.inf), np.zeros(point.z.size, bool)
    lowest[: point.k] = np.minimum(point.lowest - point.z[: point.k], 0.0)
    H, damped = point.curvature, mu * np.diag(point.curvature)
    for _ in range(ACTIVE_SETS * (point.k + 1)):
        way = np.zeros(dz.size)
        given = point.gradient - H[:, ~free] @ dz[~free]
        way[free] = _solution(H[np.ix_(free, free)], given[free], mu) - dz[free]
        short = free & (dz + way < lowest)
        if short.any():
            parts = np.divide(lowest - dz, way, out=np.full(dz.size, np.inf), where=short)
            first = int(np.argmin(parts))
            dz += parts[first] * way
            dz[first], free[first], ended[first] = lowest[first], False, True
            continue
        dz += way
        pull = np.where(ended, point.gradient - H @ dz - damped * dz, 0.0)
        leaves = int(np.argmax(pull))
        if pull[leaves] <= PULLS * float(np.max(np.abs(point.gradient))):
            break
        free[leaves], ended[leaves] = True, False
    return dz


def within(point: Point, reach: float, held: int | None, by: float = 0.0) -> Array:
    """The step of least damping that changes no parameter by more: damping shortens it along what is hardly known, and
    it goes all the way across.  What is held is moved `by` so much, or less where that alone is too long."""
    _, dz = _damped(point, held, lambda dz: _length(point, dz) <= reach, by)
    return _cut(point, dz, reach)


def _cut(point: Point, dz: Array, reach: float) -> Array:
    """A step no longer than the reach."""
    return dz * min(1.0, reach / max(_length(point, dz), SHORTEST_STEP))


def _bent(
    question: Question, point: Point, dz: Array, noises: Sequence[Noise], held: int | None, stretched: bool
) -> Array:
    """A step with its geodesic acceleration a, along which the values v that are compared go as the step says:

        dz + a/2,   J'WJ a = -J'W v'',   v'' = 2/h ((v(z + h dz) - v(z))/h - J dz)

    Transtrum and Sethna, Improvements to the Levenberg-Marquardt algorithm for nonlinear least-squares minimization,
    arXiv:1201.5885 (2012).  In slips as short as samples such steps are five to ten times as long.
    """
    near = at(question, _moved(point, SMALL_PART * dz), noises, point, stretched=stretched)
    if near is None:
        return dz
    pull = np.zeros(dz.size)
    for here, there in zip(point.rows, near.rows, strict=True):
        bend = ((there.values - here.values) / SMALL_PART - here.J @ dz) * 2 / SMALL_PART
        pull -= here.J.T @ (here.weights * bend)
    free = np.append(point.z[: point.k] + dz[: point.k] > point.lowest, np.full(dz.size - point.k, True))
    if held is not None:
        free[held] = False
    a = np.zeros(dz.size)
    a[free] = _solution(point.curvature[np.ix_(free, free)], pull[free], LEAST_DAMPING)
    return dz + a / 2 if _length(point, a) < MOST_BENT * _length(point, dz) else dz


def _across(point: Point, lost: float, held: int | None) -> Array:
    """The step of most damping of which most of what was lost is expected: none along what is hardly known."""
    wanted = ACROSS_VALLEY * min(lost, expected(point, held))
    dz, _ = _damped(point, held, lambda dz: gain(point, dz) < wanted)
    return dz / too_long(point, dz)


def _damped(
    point: Point, held: int | None, enough: Callable[[Array], bool], by: float = 0.0
) -> tuple[Array, Array]:
    """Steps of nearly the same damping: with the second one it is enough, with the first one not."""
    low, high = math.log(LEAST_DAMPING), math.log(MOST_DAMPING)
    less, more = step(point, LEAST_DAMPING, held, by), step(point, MOST_DAMPING, held, by)
    if enough(less):
        return less, less
    for _ in range(DAMPING_HALVINGS):
        dz = step(point, math.exp((low + high) / 2), held, by)
        if enough(dz):
            more, high = dz, (low + high) / 2
        else:
            less, low = dz, (low + high) / 2
    return less, more


def _moved(point: Point, dz: Array) -> Array:
    """The unknowns behind a step."""
    z = point.z + dz
    z[: point.k] = np.maximum(z[: point.k], point.lowest)
    return z


def _length(point: Point, dz: Array) -> float:
    """By how much a step changes the parameters, relatively."""
    return float(np.max(np.abs(dz[: point.k]) / point.steps, initial=0.0))


def too_long(point: Point, dz: Array) -> float:
    """By which factor a step changes a parameter by too much; one where it does not."""
    return max(1.0, _length(point, dz) / MOST_OF_A_STEP)


def _solution(H: Array, g: Array, mu: float) -> Array:
    """Of (H + mu diag H) dz = g."""
    diagonal = np.diag(H)
    scale = 1 / np.sqrt(np.maximum(diagonal, 1e-12 * np.max(diagonal, initial=1e-300)))
    A = H * scale[:, None] * scale + mu * np.eye(g.size)
    return np.asarray(scale * np.linalg.lstsq(A, g * scale, rcond=1e-15)[0])
