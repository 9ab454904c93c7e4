"""The scan of the event map by half cycles: where a cycle is, and evidence that there is none.

Two facts that the rest of the program needs: where to start a boundary value problem without any help from the user,
and whether P(a) < a all over the scanned range.  The latter supports the claim that there is no cycle, and does not
prove it: two fixed points just below a fold fit between any two motions.

On log a, y(a) = log P(a)/a crosses zero downwards at a stable cycle (or at one past its symmetry breaking) and upwards
at an unstable one.  A scan walks inwards and takes every change of sign to its end, a fixed point or a jump; where none
is left it climbs every peak of y between motions that stick nearer, not the highest one alone: far out an unstable
linear loop throws the servo out further, and the peak that counts lies below that.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace

import numpy as np

from ...axis_units import quantity, several
from ...motion import MarchFailure
from ...roots import Bracket
from .half_cycle import HalfCycle, StickMap

SCAN_POINTS = 44
SCAN_LOW, SCAN_HIGH = 1e-4, 20.0
"""Scanned stick positions, in units of Fs/kp, where the proportional torque equals static friction."""
MOST_FAILURES = 8
"""Motions in a row that may fail from the start before the scan is given up."""
ALLOWED_FAILURES = 0.2
"""Part of the scanned motions that may fail before the scan proves nothing."""
LOCAL = 0.005
"""Width in log a of the difference quotient for the slope of the map."""
NEAR_FOLD = 0.4
"""Ratios P(a)/a above this at the best grid point are worth a search for the maximum between points."""
GROWING = 1.001
"""P(a)/a above which a motion grows beyond doubt."""
NOT_A_JUMP = 0.1
"""|log P(a)/a| of the motion at the end of a bracket, above which P jumps across a there: no fixed point."""
FEW_STEPS, MOST_STEPS = 8, 60
"""Regula falsi steps before every second one halves the bracket, and all of them."""
CLOSE_ENOUGH = 1e-3
"""|P/a - 1| at which a fixed point is located."""
EDGE, SMALLEST_RATIO = 0.02, 1e-3
"""Part of a bracket that false position keeps off its ends; P/a below which smaller does not count."""
MOST_CLIMBING, NARROW = 30, 1e-5
"""Motions in search of a peak of P/a, and width in log a at which it is found."""
GOLDEN = (3 - math.sqrt(5)) / 2
LEFT_OPEN, FORETOLD, IN_VAIN = 0.01, 2, 12
"""Part of what a peak lacks to one that does not count; times in a row that parabolas foretell P/a to that part, or
that no motion gains as much (at the edge of a jump), after which it stays below one."""
KEPT_OFF = 0.02
"""Part of the range that a motion keeps off those that are there."""


Try = Callable[[float], HalfCycle | None]
"""The motion from a stick position; None where it cannot be computed."""
Point = tuple[float, float]
"""(log a, P(a)/a)."""


@dataclass(frozen=True, eq=False)
class Scan:
    """What a search for fixed points saw.

    Attributes
    ----------
    low, high : scanned range of stick positions [rad].
    best : largest ratio P(a)/a found, and `best_at` where.
    upper : half cycle next to the outermost stable fixed point, or None.
    failures : stick positions at which the motion could not be computed.
    motions : motions computed.
    """

    low: float
    high: float
    best: float
    best_at: float
    upper: HalfCycle | None
    failures: tuple[float, ...]
    motions: int

    @property
    def conclusive(self) -> bool:
        """Enough of the motions were computed to say that there is no cycle."""
        return len(self.failures) <= ALLOWED_FAILURES * self.motions

    def sentence(self) -> str:
        """The evidence in words."""
        if self.motions == 0:
            failed = len(self.failures)
            high = quantity(self.high, "rad", ".3g")
            return f"none of {failed} motions from stick positions below {high} could be computed"
        text = f"scanned stick positions from {several((self.low, self.high), 'rad', '.3g', ' to ')}: "
        if self.best > GROWING:
            text += (
                f"motions grow (from {quantity(self.best_at, 'rad')} to {self.best:.4g} times that distance) and no "
                "stable cycle bounds them, as with an unstable linear loop"
            )
        elif self.best > 0:
            text += (
                f"the servo comes to rest at most at {self.best:.6g} times the distance it started from "
                f"(at {quantity(self.best_at, 'rad')})"
            )
        else:
            text += "the servo never gets across the set point"
        if self.failures:
            text += f"; {len(self.failures)} of the motions could not be computed"
        return text


def scan(P: StickMap) -> Scan:
    """Find the stable fixed point of the map without a guess, the outermost one.

    Returns scan: a half cycle next to the fixed point, None where none was found, and the largest |P(a)|/a.
    """
    grid = [float(a) for a in P.unit * np.geomspace(SCAN_HIGH, SCAN_LOW, SCAN_POINTS)]
    failures: list[float] = []

    def at(a: float) -> HalfCycle | None:
        try:
            return P(a)
        except MarchFailure:
            failures.append(a)
            return None

    seen, upper = _inwards(at, grid)
    if upper is None:
        found = _highest_peak(at, seen)
        if found is not None:
            peak, beyond = found
            seen.append(peak)
            upper = _fixed_point(at, peak, beyond) if peak.ratio >= 1 else None
    best = max(seen, key=lambda r: r.ratio, default=None)
    at_best = (best.ratio, best.start) if best else (float("nan"), float("nan"))
    return Scan(grid[-1], grid[0], *at_best, upper, tuple(failures), len(seen))


def _inwards(at: Try, grid: Iterable[float]) -> tuple[list[HalfCycle], HalfCycle | None]:
    """(motions, stable fixed point) seen from the outside inwards, until one is found."""
    seen: list[HalfCycle] = []
    for k, a in enumerate(grid, 1):
        run = at(a)
        if run is None:
            if k >= MOST_FAILURES and not seen:
                break
            continue
        outside = seen[-1] if seen else None
        seen.append(run)
        if outside is not None and outside.ratio < 1 <= run.ratio:
            upper = _fixed_point(at, run, outside)
            if upper is not None:
                return seen, upper
    return seen, None


def _highest_peak(at: Try, seen: list[HalfCycle]) -> tuple[HalfCycle, HalfCycle] | None:
    """(peak, outer neighbour) where P(a)/a, below one on the grid, exceeds one or is largest."""
    ordered = sorted(seen, key=lambda r: r.start)
    peaks = [
        (inner, middle, outer)
        for inner, middle, outer in zip(ordered, ordered[1:], ordered[2:], strict=False)
        if inner.ratio <= middle.ratio >= outer.ratio and NEAR_FOLD < middle.ratio < 1
    ]
    best: tuple[HalfCycle, HalfCycle] | None = None
    for inner, middle, outer in sorted(peaks, key=lambda peak: -peak[1].ratio):
        top = _highest(at, inner, middle, outer)
        if best is None or top.ratio > best[0].ratio:
            best = (top, outer)
        if top.ratio >= 1:
            break
    return best


def _highest(at: Try, inner: HalfCycle, best: HalfCycle, outer: HalfCycle) -> HalfCycle:
    """The motion with the largest ratio between two others.

    With y = P(a)/a over x = log a, known at x1 < x2 < x3, y2 the largest, the next motion starts at the top of the
    parabola through the three, or where the golden section looks if the last one was not where a parabola expected it.
    The climb ends as soon as y > 1, and where what is left open cannot lead there: parabolas have foretold y, or many
    motions in a row have gained nothing, measured by what the peak lacks to one.

    inner, best, outer: three motions by increasing stick position; the middle one leads farthest out.
    Returns one whose ratio exceeds one as soon as there is one; else the one with the largest ratio.
    """
    low, top, high = ((float(np.log(run.start)), run.ratio) for run in (inner, best, outer))
    foretold, golden, in_vain = 0, False, 0
    for _ in range(MOST_CLIMBING):
        if best.ratio >= 1 or high[0] - low[0] < NARROW or foretold == FORETOLD or in_vain == IN_VAIN:
            break
        x, expected = _golden(low, top, high) if golden else _vertex(low, top, high)
        run = at(float(np.exp(x)))
        ratio = -math.inf if run is None else run.ratio
        open_to_it = LEFT_OPEN * (1 - best.ratio)
        golden = not abs(ratio - expected) < open_to_it
        foretold = 0 if golden else foretold + 1
        in_vain = 0 if ratio > best.ratio + open_to_it else in_vain + 1
        if run is not None and ratio > best.ratio:
            best = run
            low, top, high = (low, (x, ratio), top) if x < top[0] else (top, (x, ratio), high)
        else:
            low, high = ((x, ratio), high) if x < top[0] else (low, (x, ratio))
    return best


def _golden(low: Point, top: Point, high: Point) -> Point:
    """Where the golden section looks next, and what the parabola expects there."""
    side = low if top[0] - low[0] > high[0] - top[0] else high
    x = top[0] + GOLDEN * (side[0] - top[0])
    return x, _parabola(low, top, high, x)


def _vertex(low: Point, top: Point, high: Point) -> Point:
    """The top of the parabola through three points, kept off them, and its height."""
    left, right = top[0] - low[0], high[0] - top[0]
    falls = (top[1] - low[1]) / left, (top[1] - high[1]) / right
    curved = falls[0] + falls[1]
    if not 0 < curved < math.inf:
        return _golden(low, top, high)
    x = top[0] + (falls[0] * right - falls[1] * left) / (2 * curved)
    aside = KEPT_OFF * (high[0] - low[0])
    if abs(x - top[0]) < aside:
        x = top[0] + math.copysign(aside, right - left)
    x = min(max(x, low[0] + aside), high[0] - aside)
    return x, _parabola(low, top, high, x)


def _parabola(low: Point, top: Point, high: Point, x: float) -> float:
    """The parabola through three points at x; no number where a motion has failed."""
    if not math.isfinite(low[1] + high[1]):
        return math.nan
    first = (top[1] - low[1]) / (top[0] - low[0])
    second = ((high[1] - top[1]) / (high[0] - top[0]) - first) / (high[0] - low[0])
    return top[1] + (x - top[0]) * (first + second * (x - low[0]))


def _fixed_point(at: Try, above: HalfCycle, below: HalfCycle) -> HalfCycle | None:
    """A half cycle close to the fixed point between `above` (P >= a) and `below` (P < a); None where P jumps across a.

    Close enough for the boundary value problem, which needs no more.
    """
    best = _narrowed(at, above, below)
    if abs(np.log(max(best.ratio, 1e-300))) > NOT_A_JUMP:
        return None
    beside = at(best.start * (1 + LOCAL))
    if beside is None or min(beside.ratio, best.ratio) <= 0:
        return best
    return replace(best, slope=float(np.log(beside.ratio / best.ratio) / np.log1p(LOCAL)))


def _narrowed(at: Try, above: HalfCycle, below: HalfCycle) -> HalfCycle:
    """The motion whose P/a is closest to one, by false position in (log a, log P/a) and by halving in turn."""
    best = min(above, below, key=lambda r: abs(r.ratio - 1))
    if abs(best.ratio - 1) < CLOSE_ENOUGH:
        return best
    bracket = Bracket(*_place(above), *_place(below))
    for k in range(MOST_STEPS):
        if not bracket.holds(bracket.middle):
            break
        run = at(float(np.exp(bracket.at(0.5 if k % 2 and k > FEW_STEPS else bracket.share(EDGE)))))
        if run is None:
            break
        best = min(best, run, key=lambda r: abs(r.ratio - 1))
        if abs(best.ratio - 1) < CLOSE_ENOUGH:
            break
        bracket = bracket.told(*_place(run))
    return best


def _place(run: HalfCycle) -> tuple[float, float]:
    """(log a, log P/a); the latter not below what a servo that comes to rest would make of it."""
    return float(np.log(run.start)), float(np.log(max(run.ratio, SMALLEST_RATIO)))
