"""A curve of folds in batches: many of its points at once, predicted from one of them.

    a fold, expanded in ln q -> the next places in a batch (fold_ensemble.py) -> those that follow
           ^                                                                  |        | none
           +---- the last of them, expanded <---------------------------------+        v
                                                                 left to the single way (two_parameters.py)

A fold follows another where it has converged, is confirmed, is of the same kind and near where it was expected, and
the slopes of both explain the change of the first parameter between them: the batch does not leap to another sheet of
folds, nor over a cusp, next to which nothing converges.  Where q is not positive there is no logarithm to expand in,
nor a slope; the first parameter keeps its sign.

In a batch a fold takes 1.5 ms where step by step it takes 18 (a slip-stick cycle of two phases), or 6 ms against 55
(a stiff one of twelve).
"""

from __future__ import annotations

from collections.abc import Generator, Sequence
from contextlib import suppress

import numpy as np

from ..errors import InputError, NoOrbit
from .fold_ensemble import expansion_at, expansion_beside, folds_near
from .fold_expansion import Expansion
from .surface import LARGEST_CHANGE, Place, Sought, SpecialOrbit, explained

Array = np.ndarray

PLACES_TOGETHER = 6
"""Places of a batch: what lies farther is better predicted from one of them."""
CHANGE_BETWEEN = 0.3
"""Of the parameter from one place to the next, as its slope tells: a cubic of points and their slopes is then right to
1e-4."""
NEXT_TO_ZERO = 0.1
"""Part of its unit to which a parameter is reckoned relative to its value; closer to zero it would never get there."""


def folds_ahead(first: Place, sense: float) -> Generator[SpecialOrbit]:
    """The folds behind one on its curve, as far as batches lead; sense: +1 towards larger c, -1 towards smaller."""
    sought, last, c, at = first.sought, first.special, first.position, first.position
    end = 1.0 if sense > 0 else 0.0
    assert last is not None
    if not last.orbit.problem.value(sought.vary):
        return
    try:
        base: Expansion | None = expansion_at(last.orbit, sought.vary, (sought.axis.vary,), sought.options.tol)
    except (NoOrbit, InputError):
        return
    while base is not None and c != end:
        change = abs(last.slope * sought.axis.rate(c)) / _size(sought, last)
        count = max(1, int(np.ceil(abs(end - c) * max(1 / sought.spacing, change / CHANGE_BETWEEN) - 1e-9)))
        places = [float(x) for x in np.linspace(c, end, count + 1)[1 : 1 + PLACES_TOGETHER]]
        fresh = c == at
        for place, found in zip(places, _computed(sought, base, places), strict=True):
            if found is None or not _follows(sought, found, place, last, c):
                break
            yield found
            last, c = found, place
        if c == places[-1]:
            continue
        if fresh and c == at:
            return
        base, at = expansion_beside(base, _parameters(sought, base, [c])[0], sought.options.tol), c


def _follows(sought: Sought, found: SpecialOrbit, place: float, last: SpecialOrbit, c: float) -> bool:
    """Whether a fold is the next one of the curve."""
    before, after = (each.orbit.problem.value(sought.vary) for each in (last, found))
    first, second = (each.slope * sought.axis.rate(at) * (place - c) for each, at in ((last, c), (found, place)))
    size = min(_size(sought, each) for each in (last, found))
    near = before * after > 0 and abs(after - before) <= LARGEST_CHANGE * size
    return near and explained(after - before, first, second, size)


def _size(sought: Sought, fold: SpecialOrbit) -> float:
    """What a change of the first parameter is relative to."""
    problem = fold.orbit.problem
    return max(abs(problem.value(sought.vary)), NEXT_TO_ZERO * abs(problem.unit(sought.vary)))


def _parameters(sought: Sought, base: Expansion, places: Sequence[float]) -> Array:
    """(m, np) parameters of the problems at places of q."""
    p = np.repeat(base.problem.vector()[None], len(places), axis=0)
    p[:, base.problem.names.index(sought.axis.vary)] = [sought.axis.value(c) for c in places]
    return p


def _computed(sought: Sought, base: Expansion, places: Sequence[float]) -> list[SpecialOrbit | None]:
    """The folds at a few places; None where there is none."""
    other = sought.axis.vary
    folds = folds_near(base, _parameters(sought, base, places), sought.options.tol, slopes_by=(other,))
    numbers = np.array([
        folds.values, folds.value_errors, folds.periods, folds.period_errors, folds.amplitudes, folds.amplitude_errors
    ])  # fmt: skip
    out: list[SpecialOrbit | None] = []
    for i, (c, solution) in enumerate(zip(places, folds.solutions, strict=True)):
        out.append(None)
        q, value = sought.axis.value(c), float(folds.values[i])
        if solution is None or q <= 0:
            continue
        with suppress(InputError):  # the equations know nothing of the values that a parameter may have
            there = base.problem.with_value(other, q).with_value(sought.vary, value)
            orbit, across = solution.orbit(there, numbers[:, i])
            slope = value * float(folds.slopes[i, 0]) / q
            out[-1] = SpecialOrbit(orbit, float(folds.errors[i]), slope, across, how="batch")
    return out
