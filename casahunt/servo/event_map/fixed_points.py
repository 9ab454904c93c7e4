"""All fixed points of the event map of the Switch servo between two stick positions.

    P(a) = a,    mu = P'(a)

A logarithmic grid is halved until the motions between its points are foretold by the cubics through them (slopes.py
has P and its slopes); where P - a changes sign, Newton's method in a bracket finds the fixed point to rounding.

P jumps where a motion grazes: where a slip that would have gone on stops half-way, or a stop holds with |m| = Fs.
Jumps across P = a are reported as jumps, not as fixed points.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ...axis_units import in_its_units
from ...checks import COMPUTED, sensible
from ...errors import InputError
from ...motion import MarchFailure
from ...roots import Bracket
from ..servo import Servo, a_servo
from .data import FixedPoint, FixedPoints, Jump
from .scan import SCAN_HIGH, SCAN_LOW
from .slopes import EPS, STEEP, MapPoint, cubic_is_good, map_at, nothing_between, rounding

MAP_POINTS = 121
"""Of the first grid: a tenth from one to the next over the default range; it is halved where that is too coarse."""
MOST_POINTS, MOST_SLIPS_IN_ALL = 4000, 3000
"""Motions, and slips of all of them together, after which no interval is divided further.  A tenth does for most maps;
where far-out motions come back after dozens of slips or never, the jumps between the two have no end."""
SMALLEST_CROSSING = 1e-14
"""Relative width of an interval of a in which P - a changes sign that is not divided further."""
SMALLEST_JUMP = 1e-8
"""The same where it does not: places of jumps far from P = a are known no better, many slips on."""
MERGED = 1e-6
"""Relative distance below which two jumps count as one."""
ROUGH_MARCH, CLOSE = 1e-7, 1e-2
"""March of a scan, where P/a is not within CLOSE of one."""
MOST_BRACKET_STEPS = 400
"""Newton steps and halvings after which a bracket is left as it is."""


def default_range(servo: Servo, gain: float) -> tuple[float, float]:
    """The stick positions that a scan looks at by default: 1e-4 to 20 times Fs/kp.

    servo, gain: the problem; gain K [V/rad]. Returns lowest and highest stick position [rad].
    """
    kp, _, _ = a_servo(servo).torque_gains(gain)
    unit = servo.friction.static / kp
    return SCAN_LOW * unit, SCAN_HIGH * unit


@dataclass
class _Scan:
    """The state of one scan; `report` is told the number of motions computed, and where the last one started."""

    servo: Servo
    gain: float
    report: Callable[[int, float], None] | None = None
    points: dict[float, MapPoint] = field(default_factory=dict)
    tight: set[float] = field(default_factory=set)
    fixed: list[FixedPoint] = field(default_factory=list)
    jumps: list[Jump] = field(default_factory=list)
    unresolved: list[tuple[float, float]] = field(default_factory=list)
    failures: list[float] = field(default_factory=list)
    slips: int = 0

    def at(self, a: float, *, tight: bool = False) -> MapPoint | None:
        """The map at a, computed once for each precision; None where it fails."""
        try:
            if a not in self.points:
                self.points[a] = map_at(self.servo, self.gain, a, tol=ROUGH_MARCH)
                self.slips += self.points[a].slips
                if self.report is not None:
                    self.report(len(self.points), a)
            if a not in self.tight and (tight or abs(self.points[a].excess) < CLOSE):
                self.points[a] = map_at(self.servo, self.gain, a)
                self.slips += self.points[a].slips
                self.tight.add(a)
        except MarchFailure:
            self.failures.append(a)
            return None
        return self.points[a]


@in_its_units
def fixed_points(
    servo: Servo,
    gain: float,
    low: float | None = None,
    high: float | None = None,
    *,
    points: int = MAP_POINTS,
    report: Callable[[int, float], None] | None = None,
) -> FixedPoints:
    """All fixed points P(a) = a between two stick positions, or the evidence that there is none.

    What fits between two motions of the halved grid without disturbing them can be missed: the limit of every scan.

    Parameters
    ----------
    servo, gain
        the problem; gain K > 0 [V/rad].
    low, high
        range [rad]; default `default_range`.
    points
        size of the grid, at least 2.
    report
        called after every motion with the number of motions so far and the stick position [rad] of this one.

    Returns
    -------
    FixedPoints: fixed points by amplitude, jumps, and where the range was not resolved or a motion failed.

    Raises
    ------
    InputError : a value out of range, or high not above low.

    Examples
    --------
    >>> from casahunt import Servo, fixed_points
    >>> seen = fixed_points(Servo(), 0.6, 1e-3, 3e-3, points=10)
    >>> [round(1e3 * point.amplitude, 3) for point in seen.fixed]  # mrad
    [1.413, 1.778]
    """
    sensible("gain", gain, power=COMPUTED)
    default = default_range(servo, gain)
    low = default[0] if low is None else sensible("from", low, power=COMPUTED)
    high = default[1] if high is None else sensible("to", high, power=COMPUTED)
    if not high > low:
        raise InputError(f"to = {high:g}: must be greater than from = {low:g}")
    if points < 2:
        raise InputError(f"points = {points}: must be at least 2")
    state = _Scan(servo, gain, report)
    grid = [float(a) for a in np.geomspace(low, high, points)]
    grid[0], grid[-1] = low, high
    known = [p for p in map(state.at, grid) if p is not None]
    for left, right in zip(known, known[1:], strict=False):
        # Look between two neighbours, which are no fixed points themselves, for fixed points and jumps
        waiting = [(left, right)]
        while waiting:
            waiting += _halves(state, *waiting.pop())
    for p in known:
        if p.excess == 0:
            state.fixed.append(_fixed(state, p))
    return FixedPoints(
        servo,
        gain,
        low,
        high,
        tuple(sorted(state.points.values(), key=lambda p: p.start)),
        tuple(sorted(state.fixed, key=lambda f: f.amplitude)),
        _merged(state.jumps),
        tuple(state.unresolved),
        tuple(state.failures),
    )


def _halves(state: _Scan, left: MapPoint, right: MapPoint) -> list[tuple[MapPoint, MapPoint]]:
    """The two halves of what is between neighbours, the left one last; none where all that is there has been noted."""
    known = math.isfinite(left.position), math.isfinite(right.position)
    if not any(known):
        return []  # swinging on both sides
    crossing = all(known) and left.excess * right.excess < 0
    floor = max(SMALLEST_CROSSING if crossing else SMALLEST_JUMP, 4 * rounding(state.servo, state.gain, left.start))
    if math.log(right.start / left.start) <= floor:
        # Two neighbours at rounding distance: a steep piece, or a jump
        step = right.position - left.position
        by_slope = 0.5 * (abs(left.slope) + abs(right.slope)) * (right.start - left.start)
        noise = 16 * rounding(state.servo, state.gain, left.start) * left.start
        if math.isfinite(step) and abs(step) <= max(by_slope / STEEP, noise):
            if crossing:
                state.fixed.append(_fixed(state, _closest(left, right)))
        else:
            state.jumps.append(Jump(right.start, left.position, right.position, crossing))
        return []
    if len(state.points) >= MOST_POINTS or state.slips >= MOST_SLIPS_IN_ALL:
        state.unresolved.append((left.start, right.start))
        return []
    if crossing and cubic_is_good(left, right):
        root = _bracketed(state, left.start, right.start, floor)
        if root is not None:
            state.fixed.append(_fixed(state, root))
            return []
    middle = state.at(math.sqrt(left.start * right.start))
    if middle is None or not left.start < middle.start < right.start:
        state.unresolved.append((left.start, right.start))
        return []
    if all(known) and not crossing and nothing_between(left, middle, right):
        return []
    if middle.excess == 0:
        state.fixed.append(_fixed(state, middle))
    return [(middle, right), (left, middle)]


def _merged(jumps: list[Jump]) -> tuple[Jump, ...]:
    """Jumps by increasing a, those too close to be told apart taken for one."""
    result: list[Jump] = []
    for jump in sorted(jumps, key=lambda j: j.start):
        if result and jump.start <= result[-1].start * (1 + MERGED) and not (jump.crosses or result[-1].crosses):
            result[-1] = Jump(result[-1].start, result[-1].below, jump.above, False)
        else:
            result.append(jump)
    return tuple(result)


def _bracketed(state: _Scan, low: float, high: float, floor: float) -> MapPoint | None:
    """The fixed point between two starts, by Newton in log a inside the bracket; None at a jump.

    Where a Newton step does not gain a factor of two, the next one halves.
    """
    left, right = state.at(low, tight=True), state.at(high, tight=True)
    if left is None or right is None:
        return None
    best, halve = _closest(left, right), False
    if best.excess == 0:
        return best
    if not left.excess * right.excess < 0:  # computed more closely, P - a does not change its sign
        return None
    bracket = Bracket(low, left.excess, high, right.excess)
    for _ in range(MOST_BRACKET_STEPS):
        a = math.sqrt(bracket.a * bracket.b)
        if not halve:
            if math.log(bracket.b / bracket.a) <= floor:
                break
            step = _newton_step(best)
            if abs(step) < 0.5 * floor:
                return best
            newton = best.start * math.exp(step) if abs(step) < 1 else math.inf
            a = newton if bracket.holds(newton) else a
        point = state.at(a, tight=True) if bracket.holds(a) else None
        if point is None or not math.isfinite(point.position):
            break
        if point.excess == 0:
            return point
        bracket = bracket.told(a, point.excess)
        if halve:
            best, halve = _closest(state.points[bracket.a], state.points[bracket.b]), False
        elif abs(point.excess) < 0.5 * abs(best.excess):
            best = point
        else:
            halve = True
    best = _closest(best, state.points[bracket.a], state.points[bracket.b])
    return best if _steep_not_jump(state, best, math.log(bracket.b / bracket.a)) else None


def _newton_step(p: MapPoint) -> float:
    """In log a, towards P/a = 1; inf where the slope vanishes."""
    slope = p.slope - 1 - p.excess  # d(P/a)/d log a = P' - P/a
    return -p.excess / slope if slope else math.inf


def _closest(*points: MapPoint) -> MapPoint:
    return min(points, key=lambda p: abs(p.excess))


def _steep_not_jump(state: _Scan, best: MapPoint, width: float) -> bool:
    """What is left of P - a is explained by its slope times the rounding of a, or the width of its bracket in log a."""
    noise = rounding(state.servo, state.gain, best.start)
    by_slope = abs(best.slope - 1) * max(8 * noise, width)
    return abs(best.excess) <= max(by_slope, 16 * noise)


def _fixed(state: _Scan, p: MapPoint) -> FixedPoint:
    noise = rounding(state.servo, state.gain, p.start)
    error = max(abs(p.excess) / max(abs(p.slope - 1), EPS), noise * max(1.0, 1 / max(abs(p.slope - 1), EPS)))
    # What is left of P - a is taken out to first order; a itself moves by less than its rounding.
    missing = -p.excess * p.start / (p.slope - 1) if p.slope != 1 else 0.0
    period = 2 * (p.duration + p.duration_slope * missing)
    return FixedPoint(p.start, p.slope, period, error, max(EPS, abs(p.duration_slope) * p.start * error * 2 / period))


__all__ = ["MAP_POINTS", "FixedPoint", "FixedPoints", "Jump", "MapPoint", "default_range", "fixed_points", "map_at"]
