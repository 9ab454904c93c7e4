"""The extended system of a fold: the equations, and a slope of the parameter that vanishes.

    G(u, lambda) = 0,    g(u, lambda) = d lambda/d a = 0,       a = w . (x_0 - x_0*, ln T_1 - ln T_1*)

With a row w along the curve, G is regular at a fold while a is held, and one factorisation of the bordered matrix
gives Newton's step n at fixed a and the tangent v with da = 1, whose last entry is g.  Newton's step of the extended
system is

    (u, lambda) += n + da v,     da = -g/g',

g' from the slopes at the last two points: its steps at fixed a leave the way between them as it was gone.  Only sums of
a member's own numbers enter, so that one fold is a batch of one.
"""

from __future__ import annotations

import math

import numpy as np

Array = np.ndarray

FIRST_WAY = 1e-6
"""First way along the curve where of the bend only the sign is known: shorter than all but the sharpest folds are wide,
and long enough for two slopes to differ by more than rounding."""
ACCEPTED_STEP = 0.1
"""A Newton step below this lets the tangent be accepted."""
CLEAN_STEP = 0.01
"""Of the way between two points: their slopes are compared where Newton's steps at both are smaller than that.  With a
tenth, a step that was 7 % of the way made a bend a hundred times too small."""
LARGEST_WAY = 0.1
"""Of one step along the curve, in scaled units: where the bend was expected ten times too small, ways of 0.3 left
Newton's steps no time to lead back to the curve."""
REDUCED = 0.5
"""Part of the last slope that is left where the bend is about right."""
MOST_TURNS = 16
"""Steps: from the cubic between two orbits that lie on the same side of the fold it took up to 13."""


class Turn:
    """How far B members go along their curves to where their slopes vanish.

    bend: (B,) d2 lambda/d a2, about; the sign is that of the extremum that is sought, and no slopes make it another;
    infinite where only that is known, NaN where any extremum will do.
    """

    def __init__(self, bend: Array) -> None:
        self.bend = np.array(bend, dtype=float)
        self._slope, self._way = np.full(len(self.bend), np.nan), np.zeros(len(self.bend))
        self._step = np.full(len(self.bend), np.inf)

    def way(self, members: Array | slice, step: Array, length: Array, slope: Array) -> Array:
        """(b,) ways along the curve of some members, NaN where the slope bends the other way.

        step, length, slope: (b,) sizes of Newton's steps at fixed a, and of the tangents; d lambda/d a.
        """
        chosen = np.arange(len(self.bend))[members].tolist()
        asked = zip(chosen, step.tolist(), length.tolist(), slope.tolist(), strict=True)
        return np.array([self._of_one(*one) for one in asked])

    def _of_one(self, b: int, step: float, length: float, slope: float) -> float:
        """By numbers: arrays of one number take as long as those of hundreds."""
        bend, gone, last = float(self.bend[b]), float(self._way[b]), float(self._slope[b])
        limit = CLEAN_STEP * abs(gone) * length
        began = gone != 0 and bool(self._step[b] <= limit)
        clean = began and step <= limit
        if clean and ((fresh := (slope - last) / gone) * bend > 0 or math.isnan(bend)):
            self.bend[b] = bend = fresh
        unknown = not math.isfinite(bend)
        if unknown:
            first = _over(-FIRST_WAY if slope * bend > 0 else FIRST_WAY, length)
            way = first if step <= CLEAN_STEP * FIRST_WAY else 0.0
        else:
            way = -_over(slope, bend)
        longest = _over(LARGEST_WAY, length)
        way = max(min(way if step <= ACCEPTED_STEP else 0.0, longest), -longest)
        # Where the slope has not vanished as it should, the bend is told first, from the corrected point at the same a.
        if began and not clean and (unknown or not abs(slope) <= REDUCED * abs(last)):
            way = 0.0
        elif unknown and clean:
            way = math.nan
        if gone == 0 or way != 0:
            self._slope[b], self._step[b], self._way[b] = slope, step, way
        return way

    def rise(self, members: Array | slice, way: Array, slope: Array) -> Array:
        """(b,) changes of lambda that their ways bring."""
        bend = self.bend[members]
        return way * (slope + np.where(np.isfinite(bend), bend, 0.0) / 2 * way)


def _over(a: float, b: float) -> float:
    """a/b, infinite or not a number where b is zero."""
    return a / b if b else math.nan if a == 0 else math.copysign(math.inf, a) * math.copysign(1.0, b)
