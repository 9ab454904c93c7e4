"""Where eigenvalues of equilibria pass the imaginary axis, between points of their curve.

    mu_1, ..., mu_n    eigenvalues of f_x by decreasing real part: sorted, these are continuous along the curve
    F = lambda'        changes its sign at a fold
    F = mean Re mu_k   of all k that change their sign in a step: smooth where those pass together

    y = y(F) at F = 0 of the polynomial through points on both sides, at distances h that shrink as long as it gets
    better known; error: what it differs by without one of them, and how far the Re mu_k are from zero there

Where curves cross, a point at a distance d of the crossing is known to rounding / d: the points on both sides are not
that near, and their eigenvalues go on smoothly through it.  Behind and before each place they are counted again, real
ones and pairs apart: what passes there is told by that, and what the place does not explain is looked for beside it.

Two that pass at one place in opposite directions change no count: from above the smallest positive Re mu_k comes down
to zero and leaves it, from below Re mu_k+1.  F = Re mu_k on one side, Re mu_k+1 on the other is the smooth one, and its
zero is such a place where both vanish there to their errors.
"""

from __future__ import annotations

import math
from bisect import bisect_left
from collections.abc import Callable, Iterator
from typing import NamedTuple

import numpy as np

from .equilibrium import BOUNDARY, BRANCH_POINT, FOLD_POINT, HOPF, Curve, Place
from .locating import NODES, at_zero

Array = np.ndarray
Known = tuple[float, float]
"""A value and its error."""

TOO_FAR, SAME_CURVE = 0.25, 0.9
"""A point between two others lies no farther from where they foretell it, as a part of their distance, and has a
tangent of which the cosine with theirs is no less."""
NEARER_ROUNDS, WORSE = 30, 3
"""So many times h shrinks; after so many in a row that tell less than the best it does so no more."""
SHRINKS, NEAREST, POINTS_COVER = 0.4, 1e-5, 5
"""Factor of h, its least value as a part of the line; first value, as a part of what the points are to cover."""
KNOWN_PLACE = 1e-3
"""Error of a place, as a part of the step, with which it counts as located."""
COUNTED_AT, MIDDLES = 10.0 ** np.arange(-6, 0), np.array([0.5, 0.4, 0.6, 0.25, 0.75])
"""Distances from a place, as parts of the step, at which eigenvalues are counted, and places at which a step is cut:
the first at which they are known."""
SHORTEST_PART = 1e-4
"""A step is looked at inside to this length: zeros that are nearer to each other are one point."""
CUTS_OF_A_STEP = 12
"""Times that a step is cut because of what is not explained."""
WINDOW, VANISHES = 20.0, 10.0
"""Errors of a place that the nearest of these are away, at least; errors within which an eigenvalue is zero."""
CHANGE = "change of stability"


class At(NamedTuple):
    """A place on the curve, how far along a line it lies, the error of that, and that of the parameter."""

    place: Place
    s: float
    wide: float
    error: float


class Passed(NamedTuple):
    """What is passed at a place; how many real eigenvalues or pairs."""

    kind: str
    at: At
    many: int


class Lost(NamedTuple):
    """What is passed between two places and was not located."""

    kind: str
    before: Place
    after: Place


def turns_back(before: Place, middle: Place, after: Place) -> bool:
    """Whether an eigenvalue comes nearer to the imaginary axis and leaves it, as many being on each side of it."""
    signs = np.array([before.signs, after.signs])
    k = int(np.sum(signs[0] > 0))
    if np.any(signs[:, :k] <= 0) or np.any(signs[:, k:] > 0) or not 0 < k < signs.shape[1]:
        return False
    f = np.abs([place.mu[k - 1 : k + 1].real for place in (before, middle, after)])
    return bool(np.any((f[1] < f[0]) & (f[1] < f[2])))


def _turns_through(f: float, g: float, h: float) -> bool:
    """Whether the parabola through three values, the second one half-way, has zeros that their signs do not show."""
    if f * g < 0 or g * h < 0:
        return False
    bends, slope = 2 * (f - 2 * g + h), 4 * g - 3 * f - h
    turn = -slope / (2 * bends) if bends else math.nan
    return bool(0 < turn < 1 and (f + turn * (slope + turn * bends)) * g < 0)


def slope(place: Place) -> Known:
    """lambda' at a point."""
    return float(place.tangent[-1]), 0.0


class Line:
    """The curve between points of it, over the distance along the line between the outer ones, in units of the first.

    A point is sought from where the cubic through its neighbours and their tangents foretells it.
    """

    def __init__(self, curve: Curve, *places: Place) -> None:
        self.curve, self.units = curve, places[0].units
        way = (places[-1].y - places[0].y) / self.units
        self.length = float(np.linalg.norm(way))
        self.row = way / self.length
        alike = [curve.in_units(place, self.units) for place in places]
        self.seen = [(float((place.y - places[0].y) / self.units @ self.row), place) for place in alike]
        self.noise = 4 * np.finfo(float).eps * float(np.max(np.abs([place.y[-1] for place in places])))

    def at(self, s: float) -> Place | None:
        """The point at a distance; None where the steps there lead nowhere, or to another curve."""
        k = bisect_left(self.seen, s, key=lambda one: one[0])
        if k < len(self.seen) and self.seen[k][0] == s:
            return self.seen[k][1]
        j = min(max(k, 1), len(self.seen) - 1)
        (a, p), (b, q) = self.seen[j - 1], self.seen[j]
        t, between = (s - a) / (b - a), p.tangent + q.tangent
        if min(p.tangent @ self.row, q.tangent @ self.row) <= 0:
            return None
        first, last = (one.tangent / float(one.tangent @ self.row) * (b - a) * self.units for one in (p, q))
        guess = p.y + t * (first + t * (3 * (q.y - p.y) - 2 * first - last + t * (2 * (p.y - q.y) + first + last)))
        found = self.curve.corrected(guess, self.row, self.units)
        if found is None or not np.linalg.norm((found[0] - guess) / self.units) <= TOO_FAR * (b - a):
            return None
        tangent = self.curve.tangent(found[0], self.units, between)
        if tangent is None or float(tangent @ between) < SAME_CURVE * float(np.linalg.norm(between)):
            return None
        self.seen.insert(k, (s, self.curve.place(found[0], tangent, self.units)))
        return self.seen[k][1]

    def around(self, s: float, h: float, nodes: tuple[int, ...] = NODES) -> list[tuple[float, Place]]:
        """The points at multiples of a distance from a place, those that are found, half a step beyond it at most."""
        places = [s + k * h for k in nodes]
        return [(x, p) for x in places if abs(x - self.length / 2) <= self.length and (p := self.at(x)) is not None]

    def stations(self) -> list[float]:
        """Places along the line that part the zeros of everything that changes its sign at a special point."""
        return [0.0, *self._inside(0.0, self.length)]

    def _inside(self, low: float, high: float) -> list[float]:
        middle = (low + high) / 2
        three = [self.at(s) for s in (low, middle, high)] if high - low > SHORTEST_PART else [None]
        values = [[p.tangent[-1], p.inside, *p.signs * np.abs(p.mu.real)] for p in three if p is not None]
        if len(values) == 3 and any(_turns_through(*column) for column in zip(*values, strict=True)):
            return [*self._inside(low, middle), *self._inside(middle, high)]
        return [high] if len(values) < 3 or np.all(np.multiply(values[0], values[1]) >= 0) else [middle, high]

    def left(self, low: float, high: float) -> Passed | Lost | None:
        """Where the equilibrium leaves its mode between two places; None where it does not."""
        a, b = self.at(low), self.at(high)
        if a is None or b is None or a.inside <= 0 or b.inside > 0:
            return None
        at = self.zero(low, high, lambda place: (place.inside, 0.0))
        return Lost(BOUNDARY, a, b) if at is None else Passed(BOUNDARY, at, 1)

    def zero(self, low: float, high: float, f: Callable[[Place], Known]) -> At | None:
        """Where a smooth function vanishes between two places at which its signs differ; None where it is not told."""
        ends = self.at(low), self.at(high)
        assert ends[0] is not None and ends[1] is not None
        if f(ends[1])[0] == 0:
            return At(ends[1], high, 0.0, self.noise)
        was, best, worse = f(ends[0])[0], None, 0
        s, h = (low + high) / 2, (high - low) / POINTS_COVER
        for _ in range(NEARER_ROUNDS):
            nodes = self.around(s, h)
            for x, place in nodes:
                if low < x < high:
                    low, high = (x, high) if f(place)[0] * was > 0 else (low, x)
            at = self._through([(x, place, *f(place)) for x, place in nodes])
            beyond = math.inf if at is None else max(low - at.s, at.s - high)
            if at is None or beyond > WINDOW * at.wide + self.noise / self.units[-1]:
                s, h = (low + high) / 2, (high - low) / POINTS_COVER
            elif best is None or at.wide < best.wide:
                best, worse, s, h = at, 0, at.s, SHRINKS * h
            elif (worse := worse + 1) == WORSE:
                break
            else:
                s, h = best.s, SHRINKS * h
            if h <= NEAREST * self.length:
                break
        return best if best is not None and best.wide <= KNOWN_PLACE * self.length else None

    def _through(self, known: list[tuple[float, Place, float, float]]) -> At | None:
        """The zero of the polynomial through points, as (s, point, value, error); None where it is none."""
        if len(known) < len(NODES) - 1:
            return None
        s, f, errors = (np.array([one[k] for one in known]) for k in (0, 2, 3))
        rises = np.diff(f)
        if not (np.all(rises > 0) or np.all(rises < 0)) or f[0] * f[-1] > 0:
            return None
        y, tangents = (np.array([getattr(one[1], name) for one in known]) for name in ("y", "tangent"))
        at, found, every = float(at_zero(f, s)), np.asarray(at_zero(f, y)), np.arange(f.size)
        others = [(at_zero(f[every != k], s[every != k]), at_zero(f[every != k], y[every != k, -1])) for k in every]
        wide, by = (max(abs(float(o[i]) - v) for o in others) for i, v in enumerate((at, found[-1])))
        noise, tangent = float(np.max(errors)) / float(np.ptp(f)), np.asarray(at_zero(f, tangents))
        size = float(np.linalg.norm(tangent))
        if not (size > 0 and np.isfinite([size, *found]).all()):
            return None
        place = self.curve.place(found, tangent / size, self.units)
        return At(place, at, wide + noise * float(np.ptp(s)), by + noise * float(np.ptp(y[:, -1])) + self.noise)

    def passed(self, low: float, high: float, parts: int = CUTS_OF_A_STEP) -> Iterator[Passed | Lost]:
        """What is passed between two places of the line, in order."""
        a, b = self.at(low), self.at(high)
        assert a is not None and b is not None
        ranks, turns = np.flatnonzero(a.signs * b.signs < 0), bool(a.tangent[-1] * b.tangent[-1] < 0)
        size = float(np.max(np.abs(a.mu))) or 1.0
        if not (turns or ranks.size or a.orientation * b.orientation < 0):
            return
        at = self.zero(low, high, lambda p: slope(p) if turns else p.growth(ranks) if ranks.size else p.det(size))
        window = None if at is None else self._window(at, low, high)
        middle = next((s for s in low + MIDDLES * (high - low) if at is None and self._clear(s, low, high)), None)
        if at is not None and window is not None and parts:
            yield from self.passed(low, window[0], parts - 1)
            yield from self._told(at, *window, turns=turns)
            yield from self.passed(window[1], high, parts - 1)
        elif middle is not None and parts:
            yield from self.passed(low, middle, parts - 1)
            yield from self.passed(middle, high, parts - 1)
        else:
            yield Lost(FOLD_POINT if turns else CHANGE, a, b)

    def _clear(self, s: float, *ends: float) -> bool:
        """Whether the sign of each eigenvalue is known at a place that is known at one of the ends."""
        places = [self.at(one) for one in (s, *ends)]
        return all(p is not None and places[0] is not None and not p.unclear(places[0]) for p in places)

    def _window(self, at: At, low: float, high: float) -> tuple[float, float] | None:
        """The nearest places on both sides at which the sign of each eigenvalue is known that is known at the ends."""
        for aside in COUNTED_AT[COUNTED_AT * self.length >= WINDOW * at.wide] * self.length:
            sides = max(low, at.s - aside), min(high, at.s + aside)
            if self._clear(sides[0], low) and self._clear(sides[1], high):
                return sides
        return None

    def _told(self, at: At, low: float, high: float, *, turns: bool) -> Iterator[Passed]:
        """What passes at a place, by what is counted on both sides of it."""
        a, b = self.at(low), self.at(high)
        assert a is not None and b is not None
        ranks = np.flatnonzero(a.signs * b.signs < 0)
        if not turns and high - low > 2.1 * max(COUNTED_AT[0] * self.length, 10 * WINDOW * at.wide):  # no nearer
            at = at._replace(error=max(at.error, float(abs(b.y[-1] - a.y[-1])) / 2))
        if ranks.size and not turns:  # those that pass apart are as far from zero there
            rises = abs(float(np.mean(b.mu[ranks].real - a.mu[ranks].real)))
            off = float(np.max(np.abs(at.place.mu[ranks].real))) * abs(b.y[-1] - a.y[-1]) / rises
            at = at._replace(error=max(at.error, off))
        real, pairs = (abs(p - q) for p, q in zip(a.growing, b.growing, strict=True))
        if turns or real:
            yield Passed(FOLD_POINT if turns and real == 1 else BRANCH_POINT, at, max(real, 1))
        if pairs:
            yield Passed(HOPF, at, pairs)

    def beside(self) -> Iterator[Passed | Lost]:
        """What is passed where two eigenvalues on both sides of the axis come nearest, the ends having the same count.

        Where it is another one there, that shows the places; else they pass in opposite directions, or not at all.
        """
        k = int(np.sum(self.seen[0][1].signs > 0))
        s, h, best, steep = self.length / 2, self.length / 6, None, 0.0
        for _ in range(NEARER_ROUNDS):
            around = self.around(s, h, (*NODES[:3], 0, *NODES[3:]))
            s = min(around, key=lambda one: float(one[1].mu[k - 1].real - one[1].mu[k].real), default=(s, None))[0]
            if (middle := self.at(s)) is not None and np.any(middle.signs * self.seen[0][1].signs < 0):
                yield from self.passed(0.0, s)
                yield from self.passed(s, self.length)
                return
            known = [(x, p, *p.growth(np.array([k - 1 if x < s else k]))) for x, p in self.around(s, h)]
            at, h = self._through(known), SHRINKS * h
            if at is not None and (best is None or at.wide < best.wide):
                best, steep = at, float(np.ptp([one[2] for one in known]) / np.ptp([one[0] for one in known]))
        if best is None or best.wide > KNOWN_PLACE * self.length:
            return
        near = best.place.mu[k - 1 : k + 1].real, best.place.noise[k - 1 : k + 1]
        if np.all(np.abs(near[0]) <= VANISHES * (steep * (best.wide + self.noise / self.units[-1]) + near[1])):
            yield Passed(HOPF if self.seen[0][1].turning[k - 1] else BRANCH_POINT, best, 2)
