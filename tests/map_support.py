"""Doubles of the event map, and its fold for the Switch servo: the largest gain at which it has a fixed point.

    max over a of P(a)/a = 1, solved for K by Newton's method

At the maximum a P' = P, and by the envelope theorem d max/d K = (dP/dK)/a.  No eigenvalue problem, no transcription: a
second engine beside orbits/orbit.py.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

from casahunt.errors import NoOrbit, Status
from casahunt.roots import Bracket
from casahunt.servo.event_map.fixed_points import FixedPoint, fixed_points
from casahunt.servo.event_map.half_cycle import HalfCycle, StickMap
from casahunt.servo.event_map.scan import scan
from casahunt.servo.event_map.slopes import EPS, MapPoint, map_at
from casahunt.servo.gains import typical_gain
from casahunt.servo.servo import Servo

FOLD_ROUNDS, FOLD_STEP = 40, 1e-12
"""Newton steps on the gain of a fold, and the relative step at which they end."""
PEAK, PEAK_TILT = 1e-4, 1e-6
"""Half width of the first bracket of a maximum of P(a)/a; |P' - P/a| that counts as zero there."""
SEARCH, CLIMB = 12, (2.0, 1.4, 1.1)
"""Factors of two from the Routh-Hurwitz gain searched for a first cycle; factors of the climb from there."""
ABOVE_A_FOLD = (1.01, 1.4, 3.0, 10.0, 100.0)
"""Multiples of a fold gain at which no stable fixed point may be left."""
WIDENED, NARROWED, PEAK_EDGE = 40, 200, 1e-3
"""Steps to widen and to narrow the bracket of a peak; part of it that false position keeps off its ends."""
SMOOTH_TILT = 1e-3
"""|P' - P/a| of the best motion found above which there is no smooth maximum."""


@dataclass(frozen=True, eq=False)
class MapFold:
    """The fold gain by the event map.

    Attributes
    ----------
    gain : K at which max P(a)/a = 1.
    amplitude : a there [rad], known to the square root of the precision of the gain.
    gain_error : last step of the iteration, relative.
    excess : max P(a)/a - 1 that is left.
    multiplier : P'(a) there, 1 up to rounding.
    """

    gain: float
    amplitude: float
    gain_error: float
    excess: float
    multiplier: float


Motion = Callable[..., HalfCycle]


def double(P: StickMap, motion: Callable[..., HalfCycle]) -> StickMap:
    """The same map, at every gain, whose motions are `motion(P, honest, a, **how)`; honest(a, **how) is its own."""

    class Double(StickMap):
        def __call__(self, a: float, **how: Any) -> HalfCycle:
            return motion(self, partial(StickMap.__call__, self), a, **how)

    return Double(P.model, P.servo, P.gain)


def watched(P: StickMap) -> tuple[StickMap, list[Any]]:
    """The same map, and the motions that are followed with it: (gain, a, what came of it, longest)."""
    seen: list[Any] = []

    def motion(P: StickMap, honest: Motion, a: float, longest: float = math.inf, **how: Any) -> HalfCycle:
        run = honest(a, longest=longest, **how)
        seen.append((P.gain, a, run, longest))
        return run

    return double(P, motion), seen


def map_fold(servo: Servo) -> MapFold:
    """The largest gain at which the Switch servo hunts, from its event map alone.

    Raises NoOrbit: no gain with a pair of fixed points was found, or max P(a)/a is no smooth maximum.  The latter is
    what happens where the peak is narrower than rounding at gains below the fold, although it is smooth at the fold:
    Table 1 with static friction 0.7, say.
    """
    if servo.friction.static == servo.friction.coulomb:
        raise NoOrbit("no fold: static equals Coulomb friction, and the servo does not hunt at any gain")
    gain, upper = _hunting_gain(servo)
    seen = fixed_points(servo, gain)
    below = [f.amplitude for f in seen.fixed if f.amplitude < upper.amplitude * (1 - 1e-6)]
    low, high = (below[-1] if below else upper.amplitude * 0.2), upper.amplitude
    step = math.inf
    for _ in range(FOLD_ROUNDS):
        top = peak(servo, gain, low, high)
        if not top.gain_slope < 0:
            raise NoOrbit(
                f"the fold of the event map was lost at gain {gain:.8g}: no motion near a = {top.start:.6g} rad "
                "crosses the set point there",
                Status.NOT_CONVERGED,
            )
        step = -top.excess * top.start / top.gain_slope
        gain += max(-0.3 * gain, min(0.3 * gain, step))
        if abs(step) <= FOLD_STEP * gain:
            break
        low, high = top.start * (1 - PEAK), top.start * (1 + PEAK)
    else:
        raise NoOrbit(
            f"the fold of the event map did not converge: last step {step:.2g} at gain {gain:.8g}", Status.NOT_CONVERGED
        )
    for factor in ABOVE_A_FOLD:
        higher = _outermost(servo, factor * gain)
        if higher is not None:
            raise NoOrbit(
                f"a fold of the event map was located at gain {gain:.8g}, but it is not the last one: the map has a "
                f"stable fixed point at gain {higher[0]:.6g} too",
                Status.NOT_CONVERGED,
            )
    return MapFold(gain, top.start, abs(step) / gain, top.excess, top.slope)


def _hunting_gain(servo: Servo) -> tuple[float, FixedPoint]:
    """A gain at which the map has a stable fixed point, raised as long as it has; and that fixed point."""
    base = typical_gain(servo)
    found: tuple[float, FixedPoint] | None = None
    for k in sorted(range(-SEARCH, SEARCH + 1), key=abs):
        found = _outermost(servo, base * 2.0**k)
        if found is not None:
            break
    if found is None:
        raise NoOrbit(
            f"no gain from {base * 2.0**-SEARCH:.3g} to {base * 2.0**SEARCH:.3g}, in factors of two, was found at which"
            " the event map of the servo has a stable fixed point"
        )
    for factor in CLIMB:
        while (higher := _outermost(servo, found[0] * factor)) is not None:
            found = higher
    return found


def _outermost(servo: Servo, gain: float) -> tuple[float, FixedPoint] | None:
    seen = scan(StickMap("switch", servo, gain))
    if seen.upper is None:
        return None
    a = seen.upper.start
    near = fixed_points(servo, gain, a * 0.9, a * 1.1, points=5).fixed
    return (gain, near[-1]) if near and near[-1].multiplier < 1 else None


def _tilt(p: MapPoint) -> float:
    """P' - P/a, which falls through zero at the peak of P(a)/a; of motions without it only the side they are on.

    A servo that does not get across the set point is inside of the peak; one that does not come to stick is outside.
    """
    if p.position <= 0:
        return math.inf
    tilt = p.slope - 1 - p.excess
    return -math.inf if math.isnan(tilt) else tilt


def peak(servo: Servo, gain: float, low: float, high: float, at: Callable[..., MapPoint] = map_at) -> MapPoint:
    """The maximum of P(a)/a, next to or between two stick positions, as the root of P' - P/a."""
    left, right = at(servo, gain, low), at(servo, gain, high)
    for _ in range(WIDENED):
        width = right.start - left.start
        if not _tilt(left) > 0:
            left = at(servo, gain, max(left.start - width, 0.5 * left.start))
        elif not _tilt(right) < 0:
            right = at(servo, gain, right.start + width)
        else:
            break
    best = max(left, right, key=lambda p: p.excess)
    if _tilt(left) > 0 > _tilt(right):
        bracket = Bracket(left.start, _tilt(left), right.start, _tilt(right))
        for k in range(NARROWED):
            if bracket.width <= 4 * EPS * bracket.a:
                break
            middle = at(servo, gain, bracket.at(bracket.share(PEAK_EDGE) if k % 3 else 0.5))
            best = max(best, middle, key=lambda p: p.excess)
            if abs(_tilt(middle)) <= PEAK_TILT:
                return middle
            bracket = bracket.told(middle.start, _tilt(middle))
    if not abs(_tilt(best)) <= SMOOTH_TILT:
        raise NoOrbit(
            f"at gain {gain:.8g} the largest P(a)/a = {1 + best.excess:.8g} of the event map is no smooth maximum: P "
            f"jumps or is steeper than rounding can resolve at a = {best.start:.10g} rad",
            Status.NOT_CONVERGED,
        )
    return best
