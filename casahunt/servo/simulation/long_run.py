"""What lies ahead of a servo that is stuck beside its set point: nothing but rest, a cycle, or no end of growth.

Stuck at distance a, the servo breaks away sooner or later (m = m(0) - ki x1 t) and is stuck next at |P(a)|, whatever
its integral was before: one number decides the whole future of a Switch servo (servo/event_map/half_cycle.py).  Hence

    rest      |P(b)| < b for all b in (0, a]: every stick position is followed by a smaller one, and the only limit
              is zero.  For b -> 0 the slip is linear, J v' = -kp x1 - (kd + sigma2) v - ki x3 with a constant
              friction, and P(b) = rho b.  |rho| < 1 where the loop without dry friction is stable (Bisoffi et al. for
              Coulomb friction, which g(v) = Fs + O(v^2) is at small v), and down to a lower gain than that, because
              an unstable loop that sticks after every swing has no time to grow.  So rho is computed, at the smallest
              b looked at; the drop of the friction makes P(b)/b larger than rho, not smaller.
    a cycle   P(a*) = a*, |P(b) - a*| < |b - a*| for |b - a*| <= R: every stick position from there is followed by
              one that is closer to a*.
    growth    w A = lambda w with Re lambda > 0, A the loop without dry friction: y = w . x obeys
              |y|' >= Re lambda |y| - |w_2| Fs/J, as |F - sigma2 x2| <= Fs.  So |y| > |w_2| Fs/(J Re lambda) grows
              for ever, and a stable loop never grows without bound.

The inequalities are checked at computed points: between two of them a cubic through values and slopes foretells the
third, and what it misses is allowed for.  That is evidence, not a theorem about every b.

LuGre and the Switch servo with a stick band have the same map but for their transients; they are judged by it with
`MARGIN` to spare, and only whether they come to rest.
Symbols: a, b [rad] stick positions, P the event map.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ...motion import MarchFailure, march
from ..cycles import SCHEMES, system_of
from ..event_map.half_cycle import StickMap, half_cycle
from ..event_map.slopes import map_at
from ..gains import matrix
from ..hunting import Model
from ..servo import Servo
from .small_swings import creeps, linear_stick_range

Array = np.ndarray

STRIDE = 2.0
"""Ratio of neighbouring stick positions at which the map is computed first."""
MOST_MOTIONS = 160
"""Motions after which the search for a proof is given up."""
MARGIN = 0.02
"""What P(b)/b must stay below one where the map is only that of the model up to its transients."""
CUBIC_SAFETY = 3.0
"""What a cubic missed half-way is allowed for so many times."""
JUMP_WIDTH = 1e-6
"""Width in log b of a piece that holds a jump of P, where a slip that would have gone on stops half-way."""
NARROWEST = 1e-11
"""Width in log b that is not divided further."""
NEWTON_STEPS, LARGEST_NEWTON_STEP, LAST_NEWTON_STEP = 12, 0.5, 1e-11
"""Newton for P(a) = a: steps, their largest relative size, and the size at which they end."""
NEIGHBOURHOOD, RADII, RESOLVED = 1.2, (1.0, 0.6, 0.3), 1e-6
"""Radius of the checked neighbourhood in units of the distance, where in it, and its least relative size."""
NUDGE, NUDGED, KNOWN = 1e-4, 4.5, 1e-9
"""Relative push off a cycle that a motion has been on from its start; periods for which it is then followed; relative
error of the swings that are read off."""
ESCAPE = {"switch": 1.05, "lugre": 2.0}
"""What |w . x| must exceed in units of the certain bound; a LuGre bristle that is being bent adds sigma1 z'."""


@dataclass(frozen=True)
class Ahead:
    """Something known of the future of a stuck servo.

    Attributes
    ----------
    holds : the statement that was asked for holds at all the points computed.
    sentence : what was computed.
    motions : motions of the event map.
    refuted_at : a stick position [rad] from which it does not hold; nan where none was found.
    """

    holds: bool
    sentence: str
    motions: int
    refuted_at: float = math.nan


@dataclass(frozen=True)
class AttractingCycle:
    """A cycle that attracts a stick position.

    Attributes
    ----------
    amplitude : a* [rad]; of a lopsided cycle the stick position next to the one asked about.
    multiplier : of half a period; of the whole period for a lopsided cycle.
    swings : 1 symmetric, 2 lopsided.
    radius : around a* in which every stick position is followed by a closer one [rad].
    """

    amplitude: float
    multiplier: float
    swings: int
    radius: float


def escapes(servo: Servo, model: Model, gain: float, x: Array) -> bool:
    """Whether the motion from x grows without bound, whatever the friction does.

    servo, model, gain: the problem; gain K > 0 [V/rad]; x: (n,) state. Returns False where that is not certain.
    """
    values, vectors = np.linalg.eig(matrix(servo, gain).T)
    static = servo.friction.static / servo.inertia
    return any(
        value.real > 0 and abs(w @ x[:3]) > ESCAPE[model] * abs(w[1]) * static / value.real
        for value, w in zip(values, vectors.T, strict=True)
    )


Swing = Callable[[float], tuple[float, float]]
"""b -> (|P(b)|/b, its derivative with respect to log b or nan)."""


def _swing(servo: Servo, model: Model, gain: float) -> Swing:
    small = linear_stick_range(servo, model, gain) * (1 + 1e-9) if model == "switch" and creeps(servo, gain) else 0.0

    def switch(b: float) -> tuple[float, float]:
        if b <= small:
            return 0.0, 0.0
        found = map_at(servo, gain, b)
        ratio = found.position / b
        return abs(ratio), math.copysign(1.0, ratio) * (found.slope - ratio)

    def other(b: float) -> tuple[float, float]:
        return abs(half_cycle(model, servo, gain, b).ratio), math.nan

    return switch if model == "switch" else other


def settles(servo: Servo, model: Model, gain: float, a: float) -> Ahead:
    """Whether every stick position up to one is followed by a smaller one.

    servo, model, gain: the problem; gain K > 0 [V/rad]; a: that stick position [rad], > 0.
    Returns ahead; where it does not hold, or is not resolved, the words say so.
    """
    swing, exact = _swing(servo, model, gain), model == "switch"
    limit = 1.0 if exact else 1 - MARGIN
    seen: dict[float, tuple[float, float]] = {}

    def at(s: float) -> tuple[float, float]:
        if s not in seen:
            seen[s] = swing(math.exp(s))
        return seen[s]

    def said(holds: bool, words: str, refuted_at: float = math.nan) -> Ahead:
        return Ahead(holds, words, len(seen), refuted_at)

    bottom = linear_stick_range(servo, model, gain)
    top = max(a, bottom)
    s = np.linspace(math.log(bottom), math.log(top), 2 + int(math.log(top / bottom) / math.log(STRIDE)))
    waiting = [(float(u), float(v)) for u, v in zip(s[:-1], s[1:], strict=True)] if top > bottom else []
    try:
        for u in sorted({float(u) for u in s}, reverse=True):
            q = at(u)[0]
            if not q < limit:
                return said(False, _grows(math.exp(u), q), math.exp(u))
        while waiting:
            left, right = waiting.pop()
            if len(seen) > MOST_MOTIONS or right - left < NARROWEST:
                return said(False, f"the event map near {math.exp(left):.4g} rad is not resolved")
            middle = (left + right) / 2
            ends, q = (at(left), at(right)), at(middle)[0]
            if not q < limit:
                return said(False, _grows(math.exp(middle), q), math.exp(middle))
            highest, missed = _between(ends, right - left, q)
            jump = right - left < JUMP_WIDTH and max(ends[0][0], q, ends[1][0]) < 1 - MARGIN
            if not (jump or highest + CUBIC_SAFETY * missed < limit):
                waiting += [(left, middle), (middle, right)]
    except MarchFailure as failure:
        return said(False, f"the event map was not computed: {failure}")
    return said(True, _falls(top, *max((q, math.exp(u)) for u, (q, _) in seen.items()), len(seen)))


def _falls(top: float, q: float, b: float, motions: int) -> str:
    """What was shown of all stick positions up to `top`, the motions looked at among them: q is P(b)/b at most."""
    looked = f"{motions} motion{'s' if motions > 1 else ''} of the event map"
    every = f"from every stick position up to {top:.4g} rad"
    if q < KNOWN:
        return f"{every} it goes to the set point and sticks nowhere else ({looked})"
    return f"{every} the next one is nearer, at most {q:.6g} times as far (from {b:.4g} rad; {looked})"


def _grows(b: float, q: float) -> str:
    if math.isnan(q):
        return f"from a stick position of {b:.4g} rad the servo swings on without sticking"
    return f"from a stick position of {b:.4g} rad the next one is {q:.6g} times as far"


def _between(ends: tuple[tuple[float, float], tuple[float, float]], width: float, middle: float) -> tuple[float, float]:
    """(largest value between, miss half-way) of the cubic through the ends; of the parabola without slopes."""
    (q0, d0), (q1, d1) = ends
    t = np.linspace(0, 1, 33)
    if math.isnan(d0 + d1):
        curve = q0 * (1 - t) * (1 - 2 * t) + middle * 4 * t * (1 - t) + q1 * t * (2 * t - 1)
        return float(np.max(curve)), 0.25 * abs(middle - (q0 + q1) / 2)
    curve = (
        q0 * (1 + 2 * t) * (1 - t) ** 2 + q1 * t * t * (3 - 2 * t)
        + width * (d0 * t * (1 - t) ** 2 - d1 * t * t * (1 - t))
    )  # fmt: skip
    return max(float(np.max(curve)), middle), abs(middle - float(curve[16]))


def nudged(servo: Servo, gain: float, x: Array, mode: str, period: float) -> Array:
    """Swings of the LuGre servo from a state on a cycle, pushed off it by `NUDGE`.

    Whether a cycle draws motions cannot be seen from a motion that has been on it from the start.

    servo, gain: the problem; gain K > 0 [V/rad]; x, mode: (4,) state on the cycle, and the mode there; period: of the
    cycle [s]. Returns largest |x1| [rad] of each swing, the first two left out; none where the march fails.
    """
    size = float(np.abs(x[0]))
    scale = np.maximum(StickMap("lugre", servo, gain).scale(max(size, 1e-3 * servo.friction.static)), np.abs(x))
    degree, kind = SCHEMES["lugre"]
    p = servo.parameters(gain)
    pushed = x * np.array([1 + NUDGE, 1 + NUDGE, 1 + NUDGE, 1.0])
    try:
        segments = march(
            system_of("lugre", p.size).vector_form, mode, pushed, p, scale=scale, until=lambda _: False, tol=1e-7,
            degree=degree, kind=kind, max_time=NUDGED * period,
        )  # fmt: skip
    except MarchFailure:
        return np.zeros(0)
    peaks, largest = [], 0.0
    for segment in segments:
        largest = max(largest, float(np.max(np.abs(segment.w[:, 0]))), abs(float(segment.end[0])))
        if segment.event == "centre":
            peaks.append(largest)
            largest = 0.0
    return np.array(peaks[2:])


def attracting_cycle_near(servo: Servo, gain: float, a: float, error: float) -> AttractingCycle | None:
    """The cycle of the Switch servo that attracts every stick position near one.

    servo, gain: the problem; gain K > 0 [V/rad]; a, error: the stick position and what near means [rad].
    Returns cycle; None where there is none, or its motions were not computed.
    """
    try:
        found = _cycle(servo, gain, a, error, 1)
        return found if found is not None else _cycle(servo, gain, a, error, 2)
    except MarchFailure:
        return None


def _cycle(servo: Servo, gain: float, a: float, error: float, swings: int) -> AttractingCycle | None:
    def image(b: float) -> tuple[float, float]:
        slope = 1.0
        for _ in range(swings):
            found = map_at(servo, gain, b)
            b, slope = found.position, slope * found.slope
            if not b > 0:
                return math.nan, math.nan
        return b, slope

    fixed = _fixed_point(image, a)
    if fixed is None:
        return None
    centre, slope = fixed
    radius = max(NEIGHBOURHOOD * (abs(a - centre) + error), RESOLVED * centre)
    if abs(slope) < 1 and radius < centre and _draws(image, centre, radius):
        return AttractingCycle(centre, slope, swings, radius)
    return None


Image = Callable[[float], tuple[float, float]]
"""b -> (the stick position after some swings, its derivative with respect to b); nan where there is none."""


def _fixed_point(image: Image, a: float) -> tuple[float, float] | None:
    """(P(a*) = a*, P'(a*)) by Newton's method from a."""
    centre = a
    for _ in range(NEWTON_STEPS):
        P, slope = image(centre)
        if not math.isfinite(P) or slope == 1:
            return None
        step = (P - centre) / (1 - slope)
        if not abs(step) <= LARGEST_NEWTON_STEP * centre:
            return None
        centre += step
        if abs(step) <= LAST_NEWTON_STEP * centre:
            return centre, slope
    return None


def _draws(image: Image, centre: float, radius: float) -> bool:
    """Whether stick positions up to `radius` from the fixed point are followed by closer ones."""
    for part in RADII:
        for b in (centre - part * radius, centre + part * radius):
            P, local = image(b)
            # At both ends of every step a smaller distance, and no steeper than one: nor is it between them.
            if not (abs(P - centre) < part * radius and (abs(local) < 1 or part == 1)):
                return False
    return True


def next_stick(servo: Servo, gain: float, a: float, error: float) -> tuple[float, float] | None:
    """(stick position, its error) a swing later; None where it is not known."""
    try:
        found = map_at(servo, gain, a)
    except MarchFailure:
        return None
    position = abs(found.position)
    spread = abs(found.slope) * error
    return (position, spread) if position > 0 and spread < 0.1 * position else None
