"""The event map of the Switch servo to rounding: its slope, all its fixed points in a range, its fold.

Breakaway at x1 = -a with m = Fs, state x0(a, K) = (-a, 0, (kp a - Fs)/ki); the servo slips, reverses where it
must, and is stuck again at x1 = P(a).  P(a) > 0 is the far side of the set point.  Symmetric hunting cycles are
P(a) = a, their half multiplier is mu = -P'(a) times the sign of the closure -I, that is mu = P'(a).

Slope.  The condensed interval maps of the march (collocation/interval.py) carry d x along each slip at a fixed
duration; at the stop, x2 = 0, the duration yields by dT = -dx2/x2':

    d x0/d a = (-1, 0, kp/ki),   d x0/d K = (0, 0, Fs/(ki K)),   dx1 = dx1,  dx2 = 0,  dx3 = dx3 + x1 dT.

(kp a/ki does not depend on K.)  No eigenvalue problem, no transcription: a second engine beside orbits/orbit.py.

Precision.  The state holds a inside x3 = (kp a - Fs)/ki, so that P is known to about

    |dP| = eps (|P'| a + ...) max(1, Fs/(kp a)),       eps = 1.1e-16,

and a fixed point to eps Fs/(kp a) whatever its slope, up to |P'| of about 1e-3/eps: beyond, one rounding error of a
moves P(a) by a thousandth, and a steep crossing cannot be told from a jump.

P jumps where a motion grazes: where a slip that would have gone on stops half-way, or a stop holds with |m| = Fs.
Jumps across P = a are reported as jumps, not as fixed points.

Fold: max over a of P(a)/a = 1, solved for K: at the maximum a P' = P, and by the envelope theorem
d max/d K = (dP/dK)/a.

Source: DCT 2001.021, section 3.2 for the modes; the event map is the classical one of stick-slip oscillators.
Symbols: n states, d stages, R = n (d + 1).
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from ...checks import COMPUTED, require, sensible
from ...collocation.interval import field_at, interval_map
from ...errors import InputError, NoOrbit, Status
from ...motion.march import MarchFailure, Segment, march
from ..hunting import SCHEMES, SWITCH, slips_back
from ..linear_loop import routh_hurwitz_gain
from ..servo import PARAMETERS, Servo
from .scan import SCAN_HIGH, SCAN_LOW, patience, scan, state_scale

Array = np.ndarray

TOLERANCES = (1e-10, 1e-9, 1e-8, 1e-6)
"""Of the march, tried in turn: below 1e-11 rounding makes steps vanish; a grazing may need a looser one."""
CHECK_TOLERANCE, CHECK_DEGREE = 1e-9, 7
"""March with which `map_error` compares: other intervals and another scheme."""
MOST_SLIPS = 40
"""Slips in a row without a stick after which the motion counts as swinging."""
THROWN_OUT = 100.0
"""A motion that stops this many times farther out than it started, with more torque than static friction holds, counts
as swinging on."""
MOST_INTERVALS = 3000
GROWS = 3.0
"""A motion that goes this many times farther out than it started is marched again in its own scale."""
POINTS = 121
MOST_POINTS, MOST_SLIPS_IN_ALL = 4000, 3000
"""Motions, and slips of all of them together, after which no interval is divided further.  A tenth does for most maps;
where far-out motions come back after dozens of slips or never, the jumps between the two have no end."""
SMOOTH, DISTANCE = 0.01, 0.25
"""A motion half-way may miss the cubic through its neighbours by SMOOTH + DISTANCE times the distance from P = a."""
SMALLEST = 1e-14
"""Relative width of an interval of a in which P - a changes sign that is not divided further."""
EDGE = 1e-8
"""The same where it does not: places of jumps far from P = a are known no better, many slips on."""
MERGED = 1e-6
"""Relative distance below which two jumps count as one."""
ROUGH, CLOSE = 1e-7, 1e-2
"""March of a scan, where P/a is not within CLOSE of one."""
REST = 1e-9
"""A servo that creeps to this part of a, or ever closer, is at the set point: P = 0."""
NEAR = 1e-3
"""A cubic that comes this close to P = a is looked at more closely."""
STEEP = 0.5
"""Part of a step of P between two motions at rounding distance that their slopes must explain; else it is a jump."""
FOLD_ROUNDS, FOLD_STEP = 40, 1e-12
"""Newton steps on the gain of a fold, and the relative step at which they end."""
PEAK, PEAK_TILT = 1e-4, 1e-6
"""Half width of the first bracket of a maximum of P(a)/a; |P' - P/a| that counts as zero there."""
SEARCH, CLIMB = 12, (2.0, 1.4, 1.1)
"""Factors of two from the Routh-Hurwitz gain searched for a first cycle; factors of the climb from there."""
ABOVE = (1.01, 1.4, 3.0, 10.0, 100.0)
"""Multiples of a fold gain at which no stable fixed point may be left."""
EPS = float(np.finfo(float).eps)


@dataclass(frozen=True, eq=False)
class MapPoint:
    """The event map at one stick position.

    Attributes
    ----------
    start : a [rad].
    position : P(a) [rad]; nan where the servo did not come to stick.
    slope : P'(a).
    gain_slope : dP/dK [rad per unit of gain].
    duration : from breakaway to breakaway [s], inf where it stays stuck.
    duration_slope : its derivative with respect to a [s/rad].
    turning : max |x1| on the way [rad].
    slips : slips before the stick.
    note : why there is no position, or "".
    """

    start: float
    position: float
    slope: float
    gain_slope: float
    duration: float
    duration_slope: float
    turning: float
    slips: int
    note: str = ""

    @property
    def excess(self) -> float:
        """P(a)/a - 1: positive where the servo swings farther out."""
        return (self.position - self.start) / self.start


@dataclass(frozen=True, eq=False)
class FixedPoint:
    """P(a) = a: a symmetric hunting cycle.

    Attributes
    ----------
    amplitude : a [rad].
    multiplier : mu = P'(a).
    period : [s].
    error : estimated relative error of the amplitude.
    period_error : of the period: |dT/da| times the rounding of a, many times that of a on steep pieces.
    """

    amplitude: float
    multiplier: float
    period: float
    error: float
    period_error: float

    @property
    def stable(self) -> bool:
        """|mu| < 1."""
        return abs(self.multiplier) < 1


@dataclass(frozen=True)
class Jump:
    """A discontinuity of P between two neighbouring stick positions.

    Attributes
    ----------
    start : a [rad].
    below, above : P just below and just above a [rad]; nan where the servo swings on without stick.
    crosses : P - a has different signs on the two sides: no fixed point, although a scan sees a change of sign.
    """

    start: float
    below: float
    above: float
    crosses: bool


@dataclass(frozen=True, eq=False)
class FixedPoints:
    """Everything that a scan of the event map saw.

    Attributes
    ----------
    servo, gain, low, high : the problem, and the range of stick positions [rad].
    points : the motions computed, by increasing a.
    fixed : the fixed points, by increasing amplitude.
    jumps : the discontinuities met, by increasing a.
    unresolved : (a, b) intervals [rad] in which the subdivision ended without telling.
    failures : stick positions [rad] at which the motion could not be computed.
    """

    servo: Servo
    gain: float
    low: float
    high: float
    points: tuple[MapPoint, ...]
    fixed: tuple[FixedPoint, ...]
    jumps: tuple[Jump, ...]
    unresolved: tuple[tuple[float, float], ...]
    failures: tuple[float, ...]

    @property
    def conclusive(self) -> bool:
        """The scan met nothing that it could not resolve."""
        return not self.unresolved and not self.failures

    def sentence(self) -> str:
        """What was found, and what supports it."""
        count = len(self.fixed)
        known = [p for p in self.points if math.isfinite(p.position)]
        found = {0: "no fixed point", 1: "1 fixed point"}.get(count, f"{count} fixed points")
        text = f"{found} of the event map between {self.low:.4g} and {self.high:.4g} rad: {len(self.points)} motions"
        if count == 0 and known:
            best = max(known, key=lambda p: p.excess)
            text += f", the largest P(a)/a is {1 + best.excess:.8g} at a = {best.start:.8g} rad"
        text += ", computed more closely until interpolation between neighbours agreed with the motion half-way"
        crossing = sum(jump.crosses for jump in self.jumps)
        if self.jumps:
            jumps = "1 jump" if len(self.jumps) == 1 else f"{len(self.jumps)} jumps"
            text += f"; {jumps} of P (or pieces too steep to resolve), {crossing} of them across P = a"
        swinging = len(self.points) - len(known)
        if swinging:
            text += f"; {swinging} motions that do not come to stick"
        if not self.conclusive:
            text += (
                f"; not conclusive: {len(self.unresolved)} intervals unresolved, {len(self.failures)} motions failed"
            )
        return text


def map_at(servo: Servo, gain: float, a: float, *, tol: float | None = None, degree: int = 0) -> MapPoint:
    """The event map of the Switch servo with its slopes.

    Parameters
    ----------
    servo
        the servo.
    gain
        controller gain K > 0.
    a
        stick position [rad], > 0.
    tol, degree
        of the march; by default as tight as rounding allows.

    Raises
    ------
    InputError : gain or a not a finite number > 0.
    MarchFailure : the motion could not be computed.
    """
    require("a", a, above=0)
    p = servo.parameters(gain)
    kp, _, ki = servo.torque_gains(gain)
    x = np.array([-a, 0.0, (kp * a - servo.friction.static) / ki])
    scheme_degree = degree or SCHEMES["switch"][0]
    scale = state_scale("switch", servo, gain, a)
    segments = _motion(servo, p, x, scale, tol, scheme_degree)
    reached = max(float(np.max(np.abs(s.w.reshape(-1, 3)[:, 0]))) for s in segments)
    if GROWS * a < reached and not reached > THROWN_OUT * a:
        scale = np.maximum(scale, state_scale("switch", servo, gain, reached))
        segments = _motion(servo, p, x, scale, tol, scheme_degree)
    last = segments[-1]
    duration = float(sum(s.duration for s in segments))
    slips = sum(s.mode != "stick" for s in segments)
    turning = max(float(np.max(np.abs(np.append(s.w.reshape(-1, 3)[:, 0], s.end[0])))) for s in segments)
    creeping = last.event == "" and abs(last.end[0]) <= REST * a
    if creeping or (last.mode == "stick" and abs(last.end[0]) <= REST * a):
        return MapPoint(a, 0.0, 0.0, 0.0, math.inf, 0.0, turning, slips, "it creeps to the set point")
    if last.mode != "stick":
        nan = float("nan")
        note = "it is still swinging" if last.event == "stop" else "it has not come to a stop"
        note = f"after {slips} slips and {duration:.3g} s {note}"
        return MapPoint(a, nan, nan, nan, duration, nan, turning, slips, note)
    directions = np.array([[-1.0, 0.0], [0.0, 0.0], [kp / ki, servo.friction.static / (ki * gain)]])
    (slope, gain_slope), slip_slope, x3_slope = _sensitivities(segments[:-1], directions, p, scale, scheme_degree)
    P = float(last.end[0])
    # The stick lasts (x3(breakaway) - x3(stop))/P, with x3(breakaway) = (sign(P) Fs - kp P)/ki.
    stick_slope = (-kp / ki * slope - x3_slope - last.duration * slope) / P
    return MapPoint(a, P, slope, gain_slope, duration, slip_slope + stick_slope, turning, slips)


def _motion(servo: Servo, p: Array, x: Array, scale: Array, tol: float | None, degree: int) -> list[Segment]:
    slips = 0

    def stuck_or_tired(segment: Segment) -> bool:
        nonlocal slips
        slips += segment.event == "stop"
        thrown_out = abs(float(segment.end[0])) > THROWN_OUT * abs(float(x[0])) and slips_back(segment.end, p)
        return segment.mode == "stick" or slips == MOST_SLIPS or thrown_out

    tolerances = (tol,) if tol else TOLERANCES
    for k, tolerance in enumerate(tolerances):
        slips = 0
        try:
            return march(
                SWITCH, "slip+", x, p, scale=scale, until=stuck_or_tired, tol=tolerance, degree=degree, kind="gauss",
                max_time=patience(servo), max_intervals=MOST_INTERVALS,
            )  # fmt: skip
        except MarchFailure:
            if k == len(tolerances) - 1:
                raise
    raise AssertionError("no tolerance")


def _sensitivities(
    segments: list[Segment], dx: Array, p: Array, scale: Array, degree: int
) -> tuple[tuple[float, float], float, float]:
    """((dP/da, dP/dK), d/da of the slips' duration, dx3/da at the stop) from d x0/d(a, K) = `dx` (3, 2)."""
    n = 3
    rows = n * (degree + 1)
    d_rows = rows - n
    dp = np.zeros(len(PARAMETERS))
    dp[PARAMETERS.index("gain")] = 1.0
    column = dx / scale[:, None]
    duration = 0.0
    for segment in segments:
        mode = SWITCH.modes[segment.mode]
        function = interval_map(mode.field, n, p.size, degree, "gauss", 1)
        scaled = segment.w / np.tile(scale, degree + 1)
        for w, fraction in zip(scaled, np.diff(segment.breaks), strict=True):
            block = function(w, np.zeros(n), segment.duration, fraction, mode.sign, p, dp, scale)[0]
            # Residual columns of the block are its rows here: d/dw at 1..R, d/d lambda last.
            forcing = block[1 : n + 1].T @ column
            forcing[:, 1] += block[rows + 2]
            stages = np.linalg.solve(block[n + 1 : rows + 1, :d_rows].T, forcing[:d_rows])
            column = block[n + 1 : rows + 1, d_rows:].T @ stages - forcing[d_rows:]
        f = field_at(mode.field, segment.end / scale, mode.sign, p, scale)  # at the stop
        if f[1] == 0:  # the stop grazes: P has no derivative there
            nan = float("nan")
            return (nan, nan), nan, nan
        duration -= float(column[1, 0] / f[1])
        column = column - np.outer(f, column[1] / f[1])
    slope = column[0] * scale[0]
    return (float(slope[0]), float(slope[1])), duration, float(column[2, 0] * scale[2])


def map_error(servo: Servo, gain: float, a: float) -> tuple[float, float]:
    """Measured relative errors of P(a) and P'(a): against another scheme on other intervals.

    Parameters
    ----------
    servo, gain, a
        as in `map_at`.
    """
    best = map_at(servo, gain, a)
    other = map_at(servo, gain, a, tol=CHECK_TOLERANCE, degree=CHECK_DEGREE)
    return abs(other.position / best.position - 1), abs(other.slope / best.slope - 1)


def rounding(servo: Servo, gain: float, a: float) -> float:
    """Relative precision to which the state at breakaway holds a: eps max(1, Fs/(kp a))."""
    kp, _, _ = servo.torque_gains(gain)
    return EPS * max(1.0, servo.friction.static / (kp * a))


def default_range(servo: Servo, gain: float) -> tuple[float, float]:
    """The stick positions [rad] that a scan looks at by default: 1e-4 to 20 times Fs/kp."""
    kp, _, _ = servo.torque_gains(gain)
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
                self.points[a] = map_at(self.servo, self.gain, a, tol=ROUGH)
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


def fixed_points(
    servo: Servo,
    gain: float,
    low: float | None = None,
    high: float | None = None,
    *,
    points: int = POINTS,
    report: Callable[[int, float], None] | None = None,
) -> FixedPoints:
    """All fixed points P(a) = a between two stick positions, or the evidence that there is none.

    A logarithmic grid is halved wherever the motion half-way is not foretold by the cubic through its two
    neighbours and their slopes, where that cubic comes close to P = a, and where P - a changes sign, down to
    a fixed point or a jump.  A pair of fixed points, or a jump and back, that fits between two motions without
    disturbing either their values, their slopes or the motion half-way can be missed: that is the limit of
    every scan.

    Parameters
    ----------
    servo, gain
        the problem.
    low, high
        range [rad]; default `default_range`.
    points
        size of the grid, at least 2.
    report
        called after every motion with the number of motions so far and the stick position [rad] of this one.

    Raises
    ------
    InputError : a value out of range, or high not above low.
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
        _search(state, left, right)
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


def _search(state: _Scan, left: MapPoint, right: MapPoint) -> None:
    """Look between two neighbours, which are no fixed points themselves, for fixed points and jumps."""
    waiting = [(left, right)]
    while waiting:
        left, right = waiting.pop()
        width = math.log(right.start / left.start)
        both = math.isfinite(left.position) and math.isfinite(right.position)
        if not both and not (math.isfinite(left.position) or math.isfinite(right.position)):
            continue  # swinging on both sides
        crossing = both and left.excess * right.excess < 0
        floor = max(SMALLEST if crossing else EDGE, 4 * rounding(state.servo, state.gain, left.start))
        if width <= floor:
            _verdict(state, left, right, crossing)
            continue
        if len(state.points) >= MOST_POINTS or state.slips >= MOST_SLIPS_IN_ALL:
            state.unresolved.append((left.start, right.start))
            continue
        if crossing and _cubic_is_good(left, right):
            first, last = state.at(left.start, tight=True), state.at(right.start, tight=True)
            root = None if first is None or last is None else _bracketed(state, first, last, floor)
            if root is not None:
                state.fixed.append(_fixed(state, root))
                continue
        middle = state.at(math.sqrt(left.start * right.start))
        if middle is None or not left.start < middle.start < right.start:
            state.unresolved.append((left.start, right.start))
            continue
        if both and not crossing and math.isfinite(middle.position):
            expected, nearest = _foretold(left, right)
            missed = abs(middle.excess - expected) > SMOOTH + DISTANCE * nearest
            if not missed and middle.excess * left.excess > 0 and nearest > NEAR:
                continue
            if not missed and middle.excess * left.excess > 0 and _one_sided(left, middle, right):
                continue
        if middle.excess == 0:
            state.fixed.append(_fixed(state, middle))
        waiting += [(middle, right), (left, middle)]


def _merged(jumps: list[Jump]) -> tuple[Jump, ...]:
    """Jumps by increasing a, those too close to be told apart taken for one."""
    result: list[Jump] = []
    for jump in sorted(jumps, key=lambda j: j.start):
        if result and jump.start <= result[-1].start * (1 + MERGED) and not (jump.crosses or result[-1].crosses):
            result[-1] = Jump(result[-1].start, result[-1].below, jump.above, False)
        else:
            result.append(jump)
    return tuple(result)


def _hermite(left: MapPoint, right: MapPoint) -> np.ndarray:
    """(4,) coefficients, in t from 0 to 1 along log a, of the cubic through P/a - 1 and its slopes."""
    width = math.log(right.start / left.start)
    y0, y1 = left.excess, right.excess
    s0 = width * (left.slope - 1 - y0)  # d(P/a)/d log a = P' - P/a
    s1 = width * (right.slope - 1 - y1)
    return np.array([2 * y0 - 2 * y1 + s0 + s1, -3 * y0 + 3 * y1 - 2 * s0 - s1, s0, y0])


def _foretold(left: MapPoint, right: MapPoint) -> tuple[float, float]:
    """(P/a - 1 half-way, smallest |P/a - 1| between) by the cubic; 0 for the latter where its sign changes."""
    c = _hermite(left, right)
    t = np.linspace(0, 1, 33)
    values = np.polyval(c, t)
    smallest = 0.0 if np.any(values * values[0] <= 0) else float(np.min(np.abs(values)))
    return float(np.polyval(c, 0.5)), smallest


def _one_sided(left: MapPoint, middle: MapPoint, right: MapPoint) -> bool:
    """Close to P = a, but a narrow interval whose two halves both stay on one side, with room to spare."""
    for a, b in ((left, middle), (middle, right)):
        c = _hermite(a, b)
        values = np.polyval(c, np.linspace(0, 1, 33))
        spread = float(np.ptp(values))
        if np.any(values * values[0] <= 0) or float(np.min(np.abs(values))) < 0.1 * spread:
            return False
    return True


def _cubic_is_good(left: MapPoint, right: MapPoint) -> bool:
    """Both slopes are of the size of the step, so that P is no jump here."""
    step = abs(right.position - left.position)
    by_slope = max(abs(left.slope), abs(right.slope)) * (right.start - left.start)
    return by_slope > STEEP * step


def _bracketed(state: _Scan, left: MapPoint, right: MapPoint, floor: float) -> MapPoint | None:
    """The fixed point between motions with P > a and P < a, by Newton inside the bracket; None at a jump."""
    best = min(left, right, key=lambda p: abs(p.excess))
    for _ in range(200):
        if best.excess == 0 or math.log(right.start / left.start) <= floor:
            break
        slope = best.slope - 1 - best.excess
        step = -best.excess / slope if slope else math.inf
        a = best.start * math.exp(step) if abs(step) < 1 else math.inf
        if abs(step) < 0.5 * floor:
            return best
        if not left.start < a < right.start:
            a = math.sqrt(left.start * right.start)
        middle = state.at(a, tight=True)
        if middle is None or not math.isfinite(middle.position) or middle.start in (left.start, right.start):
            break
        if middle.excess * left.excess > 0:
            left = middle
        else:
            right = middle
        better = abs(middle.excess) < 0.5 * abs(best.excess)
        if better:
            best = middle
        else:  # Newton does not gain: halve
            middle = state.at(math.sqrt(left.start * right.start), tight=True)
            if middle is None or not math.isfinite(middle.position):
                break
            if middle.start in (left.start, right.start):
                best = min(left, right, key=lambda p: abs(p.excess))
                break
            left, right = (middle, right) if middle.excess * left.excess > 0 else (left, middle)
            best = min(left, right, key=lambda p: abs(p.excess))
    return best if _steep_not_jump(state, best, left, right) else None


def _steep_not_jump(state: _Scan, best: MapPoint, left: MapPoint, right: MapPoint) -> bool:
    """What is left of P - a is explained by its slope times the rounding of a."""
    noise = rounding(state.servo, state.gain, best.start)
    by_slope = abs(best.slope - 1) * max(8 * noise, math.log(right.start / left.start))
    return abs(best.excess) <= max(by_slope, 16 * noise)


def _fixed(state: _Scan, p: MapPoint) -> FixedPoint:
    noise = rounding(state.servo, state.gain, p.start)
    error = max(abs(p.excess) / max(abs(p.slope - 1), EPS), noise * max(1.0, 1 / max(abs(p.slope - 1), EPS)))
    # What is left of P - a is taken out to first order; a itself moves by less than its rounding.
    missing = -p.excess * p.start / (p.slope - 1) if p.slope != 1 else 0.0
    period = 2 * (p.duration + p.duration_slope * missing)
    return FixedPoint(p.start, p.slope, period, error, max(EPS, abs(p.duration_slope) * p.start * error * 2 / period))


def _verdict(state: _Scan, left: MapPoint, right: MapPoint, crossing: bool) -> None:
    """Two neighbours at rounding distance: a steep piece, or a jump."""
    step = right.position - left.position
    by_slope = 0.5 * (abs(left.slope) + abs(right.slope)) * (right.start - left.start)
    noise = 16 * rounding(state.servo, state.gain, left.start) * left.start
    if math.isfinite(step) and abs(step) <= max(by_slope / STEEP, noise):
        if crossing:
            state.fixed.append(_fixed(state, min(left, right, key=lambda p: abs(p.excess))))
        return
    state.jumps.append(Jump(right.start, left.position, right.position, crossing))


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


def map_fold(servo: Servo) -> MapFold:
    """The largest gain at which the Switch servo hunts, from its event map alone.

    Parameters
    ----------
    servo
        the servo.

    Raises
    ------
    NoOrbit : no gain with a pair of fixed points was found, or max P(a)/a is no smooth maximum.  The latter is what
        happens where the peak is narrower than rounding at gains below the fold, although it is smooth at the
        fold: Table 1 with static friction 0.7, say.
    """
    if servo.friction.static == servo.friction.coulomb:
        raise NoOrbit("no fold: static equals Coulomb friction, and the servo does not hunt at any gain")
    gain, upper = _hunting_gain(servo)
    seen = fixed_points(servo, gain)
    below = [f.amplitude for f in seen.fixed if f.amplitude < upper.amplitude * (1 - 1e-6)]
    low, high = (below[-1] if below else upper.amplitude * 0.2), upper.amplitude
    step = math.inf
    for _ in range(FOLD_ROUNDS):
        top = _peak(servo, gain, low, high)
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
    for factor in ABOVE:
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
    base = routh_hurwitz_gain(servo)
    if not math.isfinite(base):
        base = servo.inertia / (servo.motor_gain * servo.controller.integral_time**2)
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
    seen = scan("switch", servo, gain)
    if seen.upper is None:
        return None
    a = seen.upper.start
    near = fixed_points(servo, gain, a * 0.9, a * 1.1, points=5).fixed
    return (gain, near[-1]) if near and near[-1].multiplier < 1 else None


def _peak(servo: Servo, gain: float, low: float, high: float) -> MapPoint:
    """The maximum of P(a)/a, next to or between two stick positions, as the root of P' - P/a."""

    def tilt(p: MapPoint) -> float:
        # A servo that does not get across the set point is to the left of the peak.
        return p.slope - 1 - p.excess if not p.position <= 0 else 1.0

    left, right = map_at(servo, gain, low), map_at(servo, gain, high)
    for _ in range(40):  # widen until the peak is inside
        width = right.start - left.start
        if not tilt(left) > 0:
            left = map_at(servo, gain, max(left.start - width, 0.5 * left.start))
        elif not tilt(right) < 0:
            right = map_at(servo, gain, right.start + width)
        else:
            break
    best = max(left, right, key=lambda p: p.excess)
    for k in range(200):
        if right.start - left.start <= 4 * EPS * left.start:
            break
        share = tilt(left) / (tilt(left) - tilt(right)) if k % 3 and min(left.position, right.position) > 0 else 0.5
        middle = map_at(servo, gain, left.start + min(max(share, 1e-3), 1 - 1e-3) * (right.start - left.start))
        best = max(best, middle, key=lambda p: p.excess)
        if abs(tilt(middle)) <= PEAK_TILT:
            return middle
        if tilt(middle) > 0:
            left = middle
        else:
            right = middle
    if abs(tilt(best)) > 1e-3:
        raise NoOrbit(
            f"at gain {gain:.8g} the largest P(a)/a = {1 + best.excess:.8g} of the event map is no smooth maximum: P "
            f"jumps or is steeper than rounding can resolve at a = {best.start:.10g} rad",
            Status.NOT_CONVERGED,
        )
    return best
