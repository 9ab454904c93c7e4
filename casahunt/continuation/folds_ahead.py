"""A curve of folds in batches: many of its points at once, predicted from one of them.

    a fold, expanded in ln q -> the next places in a batch (fold_ensemble.py) -> those that follow
           ^                                                                  |        | none
           +---- the last of them, expanded <---------------------------------+        v
                                                                 left to the single way (two_parameters.py)

A fold follows another where it has converged, is confirmed, is of the same kind and near where it was expected, and
the slopes of both explain the change of the first parameter between them: the batch does not leap to another sheet of
folds, nor over a cusp, next to which nothing converges.  Where q is not positive there is no logarithm to expand in,
nor a slope; nor where the first parameter may be zero.

In a batch a fold takes 1.5 ms where step by step it takes 18 (a slip-stick cycle of two phases), or 6 ms against 55
(a stiff one of twelve).  Symbols: q the second parameter, c its place in its range, m places at once.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ..errors import InputError, NoOrbit
from .curve import parameter_value
from .fold_ensemble import expansion_at, expansion_beside, folds_near
from .fold_expansion import Expansion
from .sheet import Sheet, explained, growth, relative
from .special_charts import SpecialOrbit

Array = np.ndarray

PLACES_TOGETHER = 6
"""Places of a batch: what lies farther is better predicted from one of them."""
FEWEST = 3
"""Places that follow a fold just expanded: where fewer do, the single way is quicker."""
STEEPEST_STEP = 1 / 128
"""Part of the spacing below which no place is put between two."""
GROWTH_BETWEEN = 0.3
"""Of the parameter from one point to the next, at most: a cubic of points and their slopes is then right to 1e-4."""


@dataclass(frozen=True, eq=False)
class _Known:
    """The last fold that is known: its place, the growth of the parameter to it and d ln(parameter)/dc there."""

    c: float
    growth: float
    steepness: float


def folds_ahead(sheet: Sheet, first: SpecialOrbit, sense: float, tol: float) -> Generator[SpecialOrbit]:
    """The folds that follow one on its curve, as far as batches lead.

    sheet, first: that fold; sense, tol: +1 towards larger c, -1 towards smaller; relative error of every fold.
    """
    axis = sheet.axis
    if not relative(sheet.orbit.problem, sheet.vary):
        return
    try:
        base = expansion_at(first.orbit, sheet.vary, (axis.vary,), tol)
    except (NoOrbit, InputError):
        return
    at = sheet.position
    last = _known(sheet, at, first)
    pending = _places(at, 1.0 if sense > 0 else 0.0, sheet.spacing)
    while pending:
        found = _computed(sheet, base, pending[:PLACES_TOGETHER], tol)
        fresh = last.c == at
        points, last, steep = _that_follow(sheet, last, found, pending)
        yield from points
        pending = pending[len(points) :]
        if len(points) == len(found):
            continue
        if fresh and not steep and len(points) < FEWEST:
            return
        if steep:
            if abs(pending[0] - last.c) < STEEPEST_STEP * sheet.spacing:
                return
            pending.insert(0, (pending[0] + last.c) / 2)
        if last.c != at:
            following = expansion_beside(base, _parameters(base, axis.vary, np.array([axis.value(last.c)]))[0], tol)
            if following is None:
                return
            base, at = following, last.c


def _known(sheet: Sheet, c: float, special: SpecialOrbit) -> _Known:
    value = parameter_value(special.orbit, sheet.vary)
    return _Known(c, growth(sheet.orbit.problem, sheet.vary, value), special.slope / value * sheet.axis.rate(c))


def _that_follow(
    sheet: Sheet, last: _Known, found: list[SpecialOrbit | None], places: list[float]
) -> tuple[list[SpecialOrbit], _Known, bool]:
    """(those found that follow the last one, the last of them, whether the parameter changes much then)."""
    points: list[SpecialOrbit] = []
    for point, place in zip(found, places, strict=False):
        if point is None:
            break
        there = _known(sheet, place, point)
        rise, m = there.growth - last.growth, place - last.c
        steep = abs(rise) > GROWTH_BETWEEN
        if steep or not explained(rise, last.steepness * m, there.steepness * m):
            return points, last, steep
        points.append(point)
        last = there
    return points, last, False


def _places(c: float, end: float, spacing: float) -> list[float]:
    """Equally far from each other, from behind c to the end."""
    count = max(1, int(np.ceil(abs(end - c) / spacing - 1e-9)))
    return [float(x) for x in np.linspace(c, end, count + 1)[1:-1]] + [end]


def _parameters(base: Expansion, vary: str, values: Array) -> Array:
    """(m, np) parameters of the problems at values of q."""
    p = np.repeat(base.problem.vector()[None], values.size, axis=0)
    p[:, base.problem.names.index(vary)] = values
    return p


def _computed(sheet: Sheet, base: Expansion, places: list[float], tol: float) -> list[SpecialOrbit | None]:
    """The folds at a few places; None where there is none."""
    axis = sheet.axis
    values = np.array([axis.value(c) for c in places])
    folds = folds_near(base, _parameters(base, axis.vary, values), tol, slopes_by=(axis.vary,))
    numbers = np.array([
        folds.values, folds.value_errors, folds.periods, folds.period_errors, folds.amplitudes, folds.amplitude_errors
    ])  # fmt: skip
    out: list[SpecialOrbit | None] = []
    for i, (q, solution) in enumerate(zip(values.tolist(), folds.solutions, strict=True)):
        out.append(None)
        if solution is None or q <= 0:
            continue
        value = float(folds.values[i])
        with suppress(InputError):  # the equations know nothing of the values that a parameter may have
            there = base.problem.with_value(axis.vary, q).with_value(sheet.vary, value)
            orbit, across = solution.orbit(there, numbers[:, i])
            slope = value * float(folds.slopes[i, 0]) / q
            out[-1] = SpecialOrbit(orbit, float(folds.errors[i]), slope, across, how="batch")
    return out
