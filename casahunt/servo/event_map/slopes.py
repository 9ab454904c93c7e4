"""The event map of the Switch servo to rounding, with its slopes.

Breakaway at x1 = -a with m = Fs, state x0(a, K) = (-a, 0, (kp a - Fs)/ki); the servo slips, reverses where it
must, and is stuck again at x1 = P(a).  P(a) > 0 is the far side of the set point.  Symmetric hunting cycles are
P(a) = a, their half multiplier is mu = -P'(a) times the sign of the closure -I, that is mu = P'(a).

Slope.  The condensed interval maps of the march (motion/sensitivity.py) carry d x along each slip at a fixed
duration; at the stop, x2 = 0, the duration yields by dT = -dx2/x2':

    d x0/d a = (-1, 0, kp/ki),   d x0/d K = (0, 0, Fs/(ki K)),   dx1 = dx1,  dx2 = 0,  dx3 = dx3 + x1 dT.

(kp a/ki does not depend on K.)  No eigenvalue problem, no transcription: a second engine beside orbits/orbit.py.

Precision.  The state holds a inside x3 = (kp a - Fs)/ki, so that P is known to about

    |dP| = eps (|P'| a + ...) max(1, Fs/(kp a)),       eps = 1.1e-16,

and a fixed point to eps Fs/(kp a) whatever its slope, up to |P'| of about 1e-3/eps: beyond, one rounding error of a
moves P(a) by a thousandth, and a steep crossing cannot be told from a jump.

Between two motions the cubic through y(t) = P/a - 1 along log a, with dy/d log a = P' - P/a, foretells the others.
Three motions whose cubics agree, and keep off y = 0, have no fixed point between them; a pair that fits between two
motions without disturbing them is what every scan can miss.

It is not the map of half_cycle.py with a tighter tolerance: that one serves both models and wants a guess (0.5 ms),
this one digits and slopes (2 ms), and a scan with slopes takes ten times as long as one without.

Source: DCT 2001.021, section 3.2 for the modes; the event map is the classical one of stick-slip oscillators.
Symbols: n states, d stages, R = n (d + 1).
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...checks import require
from ...motion import MarchFailure, Segment, forward_sensitivity, march
from ..problem import SCHEMES, slips_back, system_of
from ..servo import Servo
from .half_cycle import StickMap

Array = np.ndarray

TOLERANCES = (1e-10, 1e-9, 1e-8, 1e-6)
"""Of the march, tried in turn: below 1e-11 rounding makes steps vanish; a grazing may need a looser one."""
SWINGING_SLIPS = 40
"""Slips in a row without a stick after which the motion counts as swinging."""
SWINGING_ON = 100.0
"""A motion that stops this many times farther out than it started, with more torque than static friction holds, counts
as swinging on."""
MOST_SLIP_INTERVALS = 3000
GROWS = 3.0
"""A motion that goes this many times farther out than it started is marched again in its own scale."""
AT_SET_POINT = 1e-9
"""A servo that creeps to this part of a, or ever closer, is at the set point: P = 0."""
EPS = float(np.finfo(float).eps)
SMOOTH, DISTANCE = 0.01, 0.25
"""A motion half-way may miss the cubic through its neighbours by SMOOTH + DISTANCE times the distance from P = a."""
NEAR = 1e-3
"""A cubic that comes this close to P = a is looked at more closely."""
STEEP = 0.5
"""Part of a step of P between two motions at rounding distance that their slopes must explain; else it is a jump."""
CUBIC_PLACES = 33
"""Places at which a cubic is looked at."""


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


def map_at(servo: Servo, gain: float, a: float, *, tol: float | None = None, degree: int = 0) -> MapPoint:
    """The event map of the Switch servo with its slopes.

    servo, gain: the problem; gain K > 0 [V/rad]; a: stick position [rad], > 0; tol, degree: of the march; by default as
    tight as rounding allows. Returns MapPoint; nan and a note where the motion does not come to stick. Raises
    InputError: gain or a not a finite number > 0; MarchFailure: the motion could not be computed.
    """
    require("a", a, above=0)
    stick_map, scheme_degree = StickMap("switch", servo, gain), degree or SCHEMES["switch"][0]
    p, (kp, _, ki), scale = stick_map.p, stick_map.gains, stick_map.scale(a)
    segments = _motion(stick_map, a, scale, tol, scheme_degree)
    reached = max(float(np.max(np.abs(s.w.reshape(-1, 3)[:, 0]))) for s in segments)
    if GROWS * a < reached and not reached > SWINGING_ON * a:
        scale = np.maximum(scale, stick_map.scale(reached))
        segments = _motion(stick_map, a, scale, tol, scheme_degree)
    last = segments[-1]
    duration = float(sum(s.duration for s in segments))
    slips = sum(s.mode != "stick" for s in segments)
    turning = max(float(np.max(np.abs(np.append(s.w.reshape(-1, 3)[:, 0], s.end[0])))) for s in segments)
    creeping = last.event == "" and abs(last.end[0]) <= AT_SET_POINT * a
    if creeping or (last.mode == "stick" and abs(last.end[0]) <= AT_SET_POINT * a):
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


def _motion(stick_map: StickMap, a: float, scale: Array, tol: float | None, degree: int) -> list[Segment]:
    slips, p = 0, stick_map.p

    def stuck_or_tired(segment: Segment) -> bool:
        nonlocal slips
        slips += segment.event == "stop"
        thrown_out = abs(float(segment.end[0])) > SWINGING_ON * a and slips_back(segment.end, p)
        return segment.mode == "stick" or slips == SWINGING_SLIPS or thrown_out

    tolerances = (tol,) if tol else TOLERANCES
    for k, tolerance in enumerate(tolerances):
        slips = 0
        try:
            return march(
                system_of("switch", p.size).vector_form, "slip+", stick_map.breakaway(a), p,
                scale=scale, until=stuck_or_tired, tol=tolerance, degree=degree, kind="gauss",
                max_time=stick_map.patience, max_intervals=MOST_SLIP_INTERVALS,
            )  # fmt: skip
        except MarchFailure:
            if k == len(tolerances) - 1:
                raise
    raise AssertionError("no tolerance")


def _sensitivities(
    segments: list[Segment], dx: Array, p: Array, scale: Array, degree: int
) -> tuple[tuple[float, float], float, float]:
    """((dP/da, dP/dK), d/da of the slips' duration, dx3/da at the stop) from d x0/d(a, K) = `dx` (3, 2)."""
    dp = np.zeros(p.size)
    dp[-1] = 1.0  # the gain
    column = dx / scale[:, None]
    duration = 0.0
    for segment in segments:
        form = system_of("switch", p.size).vector_form
        column, f = forward_sensitivity(form, segment, column, p, dp, scale=scale, degree=degree)  # f at the stop
        if f[1] == 0:  # the stop grazes: P has no derivative there
            nan = float("nan")
            return (nan, nan), nan, nan
        duration -= float(column[1, 0] / f[1])
        column = column - np.outer(f, column[1] / f[1])
    slope = column[0] * scale[0]
    return (float(slope[0]), float(slope[1])), duration, float(column[2, 0] * scale[2])


def rounding(servo: Servo, gain: float, a: float) -> float:
    """Relative precision to which the state at breakaway holds a.

    servo, gain: the problem; gain K > 0 [V/rad]; a: stick position [rad], > 0. Returns eps max(1, Fs/(kp a)).
    """
    kp, _, _ = servo.torque_gains(gain)
    return EPS * max(1.0, servo.friction.static / (kp * a))


def nothing_between(left: MapPoint, middle: MapPoint, right: MapPoint) -> bool:
    """Whether the motion half-way is where the cubic has it, and the cubics keep off P = a.

    Returns False also where the motion half-way was not computed, or P - a changes sign.
    """
    if not math.isfinite(middle.position) or not middle.excess * left.excess > 0:
        return False
    c = cubic_of_two(left, right)
    values = np.polyval(c, np.linspace(0, 1, CUBIC_PLACES))
    nearest = 0.0 if np.any(values * values[0] <= 0) else float(np.min(np.abs(values)))
    expected = float(np.polyval(c, 0.5))
    if abs(middle.excess - expected) > SMOOTH + DISTANCE * nearest:
        return False
    return nearest > NEAR or one_sided(left, middle, right)


def cubic_of_two(left: MapPoint, right: MapPoint) -> np.ndarray:
    """The cubic through P/a - 1 and its slopes at two stick positions.

    Returns (4,) coefficients, highest power first, in t from 0 to 1 along log a.
    """
    width = math.log(right.start / left.start)
    y0, y1 = left.excess, right.excess
    s0 = width * (left.slope - 1 - y0)  # d(P/a)/d log a = P' - P/a
    s1 = width * (right.slope - 1 - y1)
    return np.array([2 * y0 - 2 * y1 + s0 + s1, -3 * y0 + 3 * y1 - 2 * s0 - s1, s0, y0])


def one_sided(left: MapPoint, middle: MapPoint, right: MapPoint) -> bool:
    """Whether P keeps to one side of a narrow interval close to P = a, with room to spare.

    left, middle, right: the event map at the ends and half-way.
    Returns True where the cubics of both halves stay off P = a by a tenth of what they vary.
    """
    for a, b in ((left, middle), (middle, right)):
        c = cubic_of_two(a, b)
        values = np.polyval(c, np.linspace(0, 1, CUBIC_PLACES))
        spread = float(np.ptp(values))
        if np.any(values * values[0] <= 0) or float(np.min(np.abs(values))) < 0.1 * spread:
            return False
    return True


def cubic_is_good(left: MapPoint, right: MapPoint) -> bool:
    """Both slopes are of the size of the step, so that P is no jump here.

    Returns False where the step of P is much larger than the slopes explain.
    """
    step = abs(right.position - left.position)
    by_slope = max(abs(left.slope), abs(right.slope)) * (right.start - left.start)
    return by_slope > STEEP * step
