"""The fold curve in batches: many of its points at once, predicted from one of them.

    a fold, expanded in ln q -> the next places in a batch (continuation/fold_ensemble.py) -> those that follow
           ^                                                                                |        | none
           +---- the last of them, expanded <-----------------------------------------------+        v
                                                                           left to the single way (curve.py)

A fold follows another where it has converged, is confirmed, is of the same kind and near where it was expected, and
the slopes of both explain the change of the gain between them: the batch does not leap to another sheet of folds, nor
over a cusp, next to which nothing converges.  Where q is not positive there is no logarithm to expand in, nor a slope.

Symbols: c the place of q in its range, m places at once.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass

import numpy as np

from ...continuation.fold_ensemble import expansion_at, expansion_beside, folds_near
from ...continuation.fold_expansion import Expansion
from ...continuation.sheet import ASTRAY, SLACK_OF_GROWTH, Axis
from ...errors import InputError, NoOrbit, Status
from .charts import Problem
from .points import FoldPoint

Array = np.ndarray

IN_BATCH = "batch"
PLACES_TOGETHER = 6
"""Places of a batch: what lies farther is better predicted from one of them."""
FEWEST = 3
"""Places that follow a fold just expanded: where fewer do, the single way is quicker."""
STEEPEST_STEP = 1 / 128
"""Part of the spacing below which no place is put between two."""
GROWTH_BETWEEN = 0.3
"""Of the gain from one point to the next, at most: the cubic of the points and their slopes is then right to 1e-4."""


@dataclass(frozen=True, eq=False)
class _Known:
    """The last fold that is known: its place, ln K and d ln K/dc there."""

    c: float
    growth: float
    steepness: float


def points_in_batches(problem: Problem, first: FoldPoint, sense: float) -> Generator[FoldPoint]:
    """The points that follow one, as far as batches lead."""
    axis, tol = problem.axis, problem.options.tol
    try:
        base = expansion_at(first.orbit, "gain", (axis.vary,), tol)
    except (NoOrbit, InputError):
        return
    c = axis.place(first.value)
    at, last = c, _known(axis, c, first)
    end = 1.0 if sense > 0 else 0.0
    pending = _places(c, end, problem.spacing)
    while pending:
        found = _computed(problem, base, pending[:PLACES_TOGETHER])
        fresh = last.c == at
        points, last, steep = _that_follow(axis, last, found, pending)
        yield from points
        pending = pending[len(points) :]
        if len(points) == len(found):
            continue
        if fresh and not steep and len(points) < FEWEST:
            return
        if steep:
            if abs(pending[0] - last.c) < STEEPEST_STEP * problem.spacing:
                return
            pending.insert(0, (pending[0] + last.c) / 2)
        if last.c != at:
            following = expansion_beside(base, _parameters(base, axis.vary, np.array([axis.value(last.c)]))[0], tol)
            if following is None:
                return
            base, at = following, last.c


def _known(axis: Axis, c: float, point: FoldPoint) -> _Known:
    return _Known(c, float(np.log(point.gain)), point.slope / point.gain * axis.rate(c))


def _that_follow(
    axis: Axis, last: _Known, found: list[FoldPoint | None], places: list[float]
) -> tuple[list[FoldPoint], _Known, bool]:
    """(those of the points found that follow the last one, the last of them, whether the gain changes much then)."""
    points: list[FoldPoint] = []
    for point, place in zip(found, places, strict=False):
        if point is None:
            break
        there = _known(axis, place, point)
        steep = abs(there.growth - last.growth) > GROWTH_BETWEEN
        if steep or not _explained(last, there):
            return points, last, steep
        points.append(point)
        last = there
    return points, last, False


def _places(c: float, end: float, spacing: float) -> list[float]:
    """Equally far from each other, from behind c to the end."""
    count = max(1, int(np.ceil(abs(end - c) / spacing - 1e-9)))
    return [float(x) for x in np.linspace(c, end, count + 1)[1:-1]] + [end]


def _parameters(base: Expansion, vary: str, values: Array) -> Array:
    """(m, np) parameters of the servos at values of q."""
    p = np.repeat(base.problem.vector()[None], values.size, axis=0)
    p[:, base.problem.names.index(vary)] = values
    return p


def _computed(problem: Problem, base: Expansion, places: list[float]) -> list[FoldPoint | None]:
    """The folds at a few places; None where there is none."""
    axis, tol = problem.axis, problem.options.tol
    values = np.array([axis.value(c) for c in places])
    folds = folds_near(base, _parameters(base, axis.vary, values), tol, slopes_by=(axis.vary,))
    numbers = np.array([
        folds.values, folds.value_errors, folds.periods, folds.period_errors, folds.amplitudes, folds.amplitude_errors
    ])  # fmt: skip
    out: list[FoldPoint | None] = []
    for i, (value, solution) in enumerate(zip(values.tolist(), folds.solutions, strict=True)):
        if solution is None or value <= 0:
            out.append(None)
            continue
        gain = float(folds.values[i])
        there = base.problem.with_value(axis.vary, value).with_value("gain", gain)
        orbit, curvature = solution.orbit(there, numbers[:, i])
        slope, error = gain * float(folds.slopes[i, 0]) / value, float(folds.errors[i])
        out.append(FoldPoint(value, gain, slope, orbit, error, curvature, Status.CONVERGED, how=IN_BATCH))
    return out


def _explained(a: _Known, b: _Known) -> bool:
    """Whether the slopes of two folds explain the change of the gain between them, as `Sheet.agrees`."""
    rise, m = b.growth - a.growth, b.c - a.c
    first, second = a.steepness * m, b.steepness * m
    least = ASTRAY * max(abs(rise), abs(first), abs(second)) + SLACK_OF_GROWTH
    return bool(abs(rise - (first + second) / 2) <= least)
