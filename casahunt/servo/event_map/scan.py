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
from collections.abc import Iterable
from dataclasses import dataclass, replace

import numpy as np

from ...hybrid.roots import Bracket
from ...motion.march import MarchFailure
from ..hunting import Model
from ..servo import Servo
from .half_cycle import SECTION, HalfCycle, half_cycle, patience, state_scale
from .peaks import Try, highest

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
FAR_OFF, SECANT_ROUNDS, LARGEST_SECANT = 10.0, 7, 1.0
"""Short cut to the stable fixed point: largest ratio P(a)/a or a/P(a) met, steps, and their length in log a."""
CONVERGING = {"switch": 0.03, "lugre": 0.005}
"""|log P(a)/a| from which the boundary value problem mostly converges."""
CLOSER = 1e-4
"""The same where it has not."""
WEAK_SLOPE, BESIDE_A_WEAK_ONE, WEAK_MARCH = -0.1, 0.01, 1e-8
"""Slope of log P/a against log a from which up a cycle attracts so weakly that P/a is next to one far from it, too;
part of its stick position within which a motion is beside such a cycle; tolerance to which P/a is computed there."""
NOT_A_JUMP = 0.1
"""|log P(a)/a| of the motion at the end of a bracket, above which P jumps across a there: no fixed point."""
FEW_STEPS, MOST_STEPS = 8, 60
"""Regula falsi steps before every second one halves the bracket, and all of them."""
TYPICAL, FARTHER_OUT = 0.1, 3.0
"""Stick position of most stable cycles, in units of Fs/kp; the same of others, in units of that."""
MUCH_LONGER = 10.0
"""Times that a servo moves, of which it comes to rest."""
TIGHT, ROUGH = 1e-14, 1e-3
"""|P/a - 1| at which a fixed point is located: the unstable one, and the stable one."""
EDGE, SMALLEST_RATIO = 0.02, 1e-3
"""Part of a bracket that false position keeps off its ends; P/a below which smaller does not count."""


@dataclass(frozen=True, eq=False)
class Scan:
    """What a search for fixed points saw.

    Attributes
    ----------
    low, high : scanned range of stick positions [rad].
    best : largest ratio P(a)/a found, and `best_at` where.
    upper, lower : half cycles next to the outer (stable) and the inner (unstable) fixed point, or None.
    failures : stick positions at which the motion could not be computed.
    motions : motions computed.
    """

    low: float
    high: float
    best: float
    best_at: float
    upper: HalfCycle | None
    lower: HalfCycle | None
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
            return f"none of {failed} motions from stick positions below {self.high:.3g} rad could be computed"
        text = f"scanned stick positions from {self.low:.3g} to {self.high:.3g} rad: "
        if self.best > GROWING:
            text += (
                f"motions grow (from {self.best_at:.4g} rad to {self.best:.4g} times that distance) and no stable "
                "cycle bounds them, as with an unstable linear loop"
            )
        elif self.best > 0:
            text += (
                f"the servo comes to rest at most at {self.best:.6g} times the distance it started from "
                f"(at {self.best_at:.4g} rad)"
            )
        else:
            text += "the servo never gets across the set point"
        if self.failures:
            text += f"; {len(self.failures)} of the motions could not be computed"
        return text


def scan(model: Model, servo: Servo, gain: float, *, want_lower: bool = False) -> Scan:
    """Find the fixed points of the map, the outer one first, without a guess.

    model, servo, gain: the problem; gain K > 0 [V/rad]; want_lower: look for the unstable fixed point too: the one next
    inside the stable one, or where there is no stable one the outermost.
    Returns scan: the fixed points that were met, None for those that were not, and the largest |P(a)|/a.
    """
    kp, _, _ = servo.torque_gains(gain)
    unit = servo.friction.static / kp
    grid = [float(a) for a in unit * np.geomspace(SCAN_HIGH, SCAN_LOW, SCAN_POINTS)]
    failures: list[float] = []

    def at(a: float) -> HalfCycle | None:
        try:
            return half_cycle(model, servo, gain, a)
        except MarchFailure:
            failures.append(a)
            return None

    seen, upper, lower = _inwards(at, grid, want_lower)
    if upper is None:
        found = _highest_peak(at, seen)
        if found is not None:
            inside, peak, beyond = found
            seen.append(peak)
            upper = _fixed_point(at, peak, beyond) if peak.ratio >= 1 else None
            lower = _fixed_point(at, peak, inside, tight=True) if want_lower and upper is not None else lower
    best = max(seen, key=lambda r: r.ratio, default=None)
    return Scan(
        grid[-1], grid[0],
        best.ratio if best else float("nan"), best.start if best else float("nan"),
        upper, lower, tuple(failures), len(seen),
    )  # fmt: skip


def _inwards(
    at: Try, grid: Iterable[float], want_lower: bool
) -> tuple[list[HalfCycle], HalfCycle | None, HalfCycle | None]:
    """(motions, outer and inner fixed point) seen from the outside inwards, until those wanted are found."""
    seen: list[HalfCycle] = []
    upper: HalfCycle | None = None
    lower: HalfCycle | None = None
    for k, a in enumerate(grid, 1):
        run = at(a)
        if run is None:
            if k >= MOST_FAILURES and not seen:
                break
            continue
        outside = seen[-1] if seen else None
        seen.append(run)
        if outside is None or (outside.ratio < 1) == (run.ratio < 1):
            continue
        if outside.ratio < 1 and upper is None:
            upper = _fixed_point(at, run, outside)
            lower = None if upper is not None else lower
        elif outside.ratio >= 1 and lower is None and want_lower:
            lower = _fixed_point(at, outside, run, tight=True)
        if upper is not None and (lower is not None or not want_lower):
            break
    return seen, upper, lower


def near_stable(
    model: Model, servo: Servo, gain: float, a: float, *, close: float | None = None, slope: float = math.nan,
    longest: float = math.inf,
) -> HalfCycle | None:  # fmt: skip
    """A half cycle close to a stable fixed point; a short cut that replaces no scan.

    Secant steps in (log a, log P/a), without a bracket (hybrid/roots.py): given up as soon as it is no quick case.
    Only a step of the Switch servo too far inwards, where it creeps to rest, is taken back by half.  The fixed point is
    taken for the stable one only where the ratio falls with a, as it does at P'(a) < 1, and falls so steeply that the
    next step would reach the fixed point: at tiny gains P(a)/a is next to one over decades of a and crosses it nowhere.

    model, servo, gain: the problem; gain K > 0 [V/rad]; a: stick position next to it [rad], > 0; close: |log P/a| at
    which it is close enough, default per model; where P < a, no larger than that: P > a alone shows that there is a
    fixed point, farther out; slope: of log P/a where it is known from another gain; one motion may then be enough;
    longest: of a motion [s]: `half_cycle`. Returns HalfCycle with the slope of log P/a; None where it is no quick case.
    """
    close = close or CONVERGING[model]
    x, previous, known = float(np.log(a)), None, math.isfinite(slope)
    slope = slope if known else -1.5
    for _ in range(SECANT_ROUNDS):
        try:
            run = half_cycle(model, servo, gain, float(np.exp(x)), longest=longest)
        except MarchFailure:
            return None
        if not 1 / FAR_OFF < run.ratio < FAR_OFF:
            if model != "switch" or previous is None or not x < previous[0] or run.ratio > 1:
                return None
            x = (x + previous[0]) / 2  # too far inwards, where it comes to rest
            continue
        if model == "switch":
            longest = min(longest, MUCH_LONGER * run.moving)
        y = float(np.log(run.ratio))
        if previous is not None and previous[0] != x:
            slope, known = (y - previous[1]) / (x - previous[0]), True
        if known and slope >= WEAK_SLOPE:
            return _near_weak(model, servo, gain, (x, y), slope, close, longest)
        enough = abs(y) < (close if y > 0 else min(close, CONVERGING[model]))
        if enough and known:
            if abs(y) < -slope * LARGEST_SECANT:
                return replace(run, slope=slope)
            if abs(y) < CONVERGING[model]:
                return None
        previous = (x, y)
        x = x - max(-LARGEST_SECANT, min(LARGEST_SECANT, y / slope)) if known or not enough else x + 0.02
    return None


def near_typical(servo: Servo, gain: float, *, close: float | None = None) -> HalfCycle | None:
    """`near_stable` of the Switch servo from where most stable cycles stick, and else from farther out.

    Next to their folds cycles stick there: a motion from nearer may start inside the unstable one.

    Returns HalfCycle with the slope of log P/a; None where neither is a quick case.
    """
    kp, _, _ = servo.torque_gains(gain)
    a = TYPICAL * (servo.friction.static / kp)
    found = near_stable("switch", servo, gain, a, close=close)
    return found if found is not None else near_stable("switch", servo, gain, FARTHER_OUT * a, close=close)


def _near_weak(
    model: Model, servo: Servo, gain: float, at: tuple[float, float], slope: float, close: float, longest: float
) -> HalfCycle | None:
    """`near_stable` where log P/a hardly falls with log a, from (log a, log P/a): the distance decides."""
    x, y = at
    previous = None
    for _ in range(SECANT_ROUNDS):
        if not abs(y) < -slope * LARGEST_SECANT:
            return None
        x -= y / slope
        try:
            run = half_cycle(model, servo, gain, float(np.exp(x)), tol=WEAK_MARCH, longest=longest)
        except MarchFailure:
            return None
        if not run.ratio > 0:
            return None
        y = float(np.log(run.ratio))
        if previous is not None and previous[0] != x:
            slope = (y - previous[1]) / (x - previous[0])
            if abs(y) < min(close, -slope * BESIDE_A_WEAK_ONE):
                return replace(run, slope=slope)
        previous = (x, y)
    return None


def _highest_peak(at: Try, seen: list[HalfCycle]) -> tuple[HalfCycle, HalfCycle, HalfCycle] | None:
    """(inner neighbour, peak, outer neighbour) where P(a)/a, below one on the grid, exceeds one or is largest."""
    ordered = sorted(seen, key=lambda r: r.start)
    peaks = [
        (inner, middle, outer)
        for inner, middle, outer in zip(ordered, ordered[1:], ordered[2:], strict=False)
        if inner.ratio <= middle.ratio >= outer.ratio and NEAR_FOLD < middle.ratio < 1
    ]
    best: tuple[HalfCycle, HalfCycle, HalfCycle] | None = None
    for inner, middle, outer in sorted(peaks, key=lambda peak: -peak[1].ratio):
        top = highest(at, inner, middle, outer)
        if best is None or top.ratio > best[1].ratio:
            best = (inner, top, outer)
        if top.ratio >= 1:
            break
    return best


def _fixed_point(at: Try, above: HalfCycle, below: HalfCycle, *, tight: bool = False) -> HalfCycle | None:
    """A half cycle close to the fixed point between `above` (P >= a) and `below` (P < a).

    Close for the stable one, where the boundary value problem needs no more; to rounding for the unstable one
    (`tight`), whose slope P' may be 1e5.  None where P jumps across a.
    """
    best = _narrowed(at, above, below, tight=tight)
    if abs(np.log(max(best.ratio, 1e-300))) > NOT_A_JUMP:
        return None
    beside = at(best.start * (1 + LOCAL))
    if beside is None or min(beside.ratio, best.ratio) <= 0:
        return best
    return replace(best, slope=float(np.log(beside.ratio / best.ratio) / np.log1p(LOCAL)))


def _narrowed(at: Try, above: HalfCycle, below: HalfCycle, *, tight: bool) -> HalfCycle:
    """The motion whose P/a is closest to one, by false position in (log a, log P/a) and by halving in turn."""
    goal = TIGHT if tight else ROUGH
    best = min(above, below, key=lambda r: abs(r.ratio - 1))
    if abs(best.ratio - 1) < goal:
        return best
    bracket = Bracket(*_place(above), *_place(below))
    for k in range(MOST_STEPS):
        if not bracket.holds(bracket.middle):
            break
        share = 0.5 if k % 2 and (tight or k > FEW_STEPS) else bracket.share(EDGE)
        run = at(float(np.exp(bracket.at(share))))
        if run is None:
            break
        if abs(run.ratio - 1) < abs(best.ratio - 1):
            best = run
        if abs(best.ratio - 1) < goal:
            break
        bracket = bracket.told(*_place(run))
    return best


def _place(run: HalfCycle) -> tuple[float, float]:
    """(log a, log P/a); the latter not below what a servo that comes to rest would make of it."""
    return float(np.log(run.start)), float(np.log(max(run.ratio, SMALLEST_RATIO)))


__all__ = [
    "SECTION",
    "HalfCycle",
    "Scan",
    "half_cycle",
    "near_stable",
    "patience",
    "scan",
    "state_scale",
]
