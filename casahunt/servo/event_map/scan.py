"""The hunting servo as a map of an interval: stuck at -a, breakaway, slip, stuck at P(a).

Switch: at breakaway with x1 = -a the torque is m = +Fs, so the state is (-a, 0, (kp a - Fs)/ki) and has
one free number.  The slip ends at the next stick position P(a).  Symmetric hunting cycles are the fixed
points P(a) = a, and P'(a) is minus the half multiplier with the sign convention of orbits/floquet.py taken in.
LuGre has the same map up to the fast transients of the bristle; it starts stuck at -a with m = 0.9 Fs on
the elastic bristle and is read off when m has come down to -0.9 Fs on the other side.

Between them the two facts that the rest of the program needs: where to start a boundary value problem without any help
from the user, and whether P(a) < a all over the scanned range.  The latter supports the claim that there is no cycle,
and does not prove it: two fixed points just below a fold fit between any two motions.

On log a, y(a) = log P(a)/a crosses zero downwards at a stable cycle (or at one past its symmetry breaking) and upwards
at an unstable one.  A scan walks inwards and takes every change of sign to its end, a fixed point or a jump; where none
is left it climbs every peak of y between motions that stick nearer, not the highest one alone: far out an unstable
linear loop throws the servo out further, and the peak that counts lies below that.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ...collocation.scheme import Kind
from ...motion.march import MarchFailure, Segment, march
from ..hunting import LUGRE, SCHEMES, SWITCH, Model, motor_torque
from ..servo import Servo

Array = np.ndarray

SECTION = 0.9
"""LuGre: part of Fs that the motor torque has where the map starts and ends."""
SCAN_POINTS = 44
SCAN_LOW, SCAN_HIGH = 1e-4, 20.0
"""Scanned stick positions, in units of Fs/kp, where the proportional torque equals static friction."""
MOST_FAILURES = 8
"""Motions in a row that may fail from the start before the scan is given up."""
ALLOWED_FAILURES = 0.2
"""Part of the scanned motions that may fail before the scan proves nothing."""
MOST_INTERVALS = {"switch": 1000, "lugre": 4000}
"""Intervals after which one application of the map is given up."""
MOST_SLIPS = 12
"""Slips in a row without a stick after which the swing is taken for what it has become."""
THROWN_OUT = 3.0
"""A servo that turns this many times farther out than it started is not followed further."""
LOCAL = 0.005
"""Width in log a of the difference quotient for the slope of the map."""
NEAR_FOLD = 0.4
"""Ratios P(a)/a above this at the best grid point are worth a search for the maximum between points."""
GROWING = 1.001
"""P(a)/a above which a motion grows beyond doubt."""
FAR_OFF, SECANT_ROUNDS, LARGEST_SECANT = 10.0, 7, 1.0
"""Short cut to the stable fixed point: largest ratio P(a)/a or a/P(a) met, steps, and their length in log a."""
CLOSE = {"switch": 0.03, "lugre": 0.005}
"""|log P(a)/a| from which the boundary value problem mostly converges."""
NOT_A_JUMP = 0.1
"""|log P(a)/a| of the motion at the end of a bracket, above which P jumps across a there: no fixed point."""
FEW_STEPS, MOST_STEPS = 8, 60
"""Regula falsi steps before every second one halves the bracket, and all of them."""
CLOSER = 1e-4
"""The same where it has not."""
TYPICAL = 0.1
"""Stick position of most stable cycles, in units of Fs/kp."""
PATIENCE = 1e6
"""Longest half period looked for, in units of the controller's times."""
MARCH_TOLERANCE = {"switch": 1e-3, "lugre": 1e-4}


@dataclass(frozen=True, eq=False)
class HalfCycle:
    """One application of the map.

    Attributes
    ----------
    start : a [rad].
    position : P(a) [rad], positive on the far side; 0 where the servo comes to rest for good; the last
        turning point |x1| of a servo that swings on without sticking.
    segments : the motion between two corresponding points, as phases of a half cycle.
    slope : d log(P/a) / d log a there, where a search has found it out; nan elsewhere.  0 at a fold,
        negative at a stable fixed point.
    """

    start: float
    position: float
    segments: list[Segment]
    slope: float = float("nan")

    @property
    def ratio(self) -> float:
        """P(a)/a."""
        return self.position / self.start


def half_cycle(
    model: Model,
    servo: Servo,
    gain: float,
    a: float,
    *,
    tol: float | None = None,
    degree: int = 0,
    kind: Kind = "gauss",
) -> HalfCycle:
    """Let the servo go from the stick position -a < 0 until it is stuck again.

    Parameters
    ----------
    model, servo, gain
        the problem.
    a
        stick position [rad], > 0.
    tol, degree, kind
        of the march; defaults per model.

    Raises
    ------
    MarchFailure : the motion could not be computed.
    """
    if degree == 0:
        degree, kind = SCHEMES[model]
    run = _switch if model == "switch" else _lugre
    return run(servo, gain, a, tol or MARCH_TOLERANCE[model], degree, kind)


def state_scale(model: Model, servo: Servo, gain: float, a: float) -> Array:
    """Expected size of the states (n,) in a motion of amplitude a."""
    kp, kd, ki = servo.torque_gains(gain)
    f = servo.friction
    rate = min(np.sqrt(kp / servo.inertia), kp / max(kd + f.viscous, 1e-300))
    scale = [a, max(a * rate, 1e-300), max(abs(kp * a - f.static), f.static) / ki]
    return np.array(scale + ([f.static / f.stiffness] if model == "lugre" else []))


def patience(servo: Servo) -> float:
    """Time [s] after which a servo that has not moved across counts as being at rest."""
    c = servo.controller
    return PATIENCE * (c.integral_time + c.lead_time)


def _switch(servo: Servo, gain: float, a: float, tol: float, degree: int, kind: Kind) -> HalfCycle:
    kp, _, ki = servo.torque_gains(gain)
    slips = 0

    def stuck_or_tired(segment: Segment) -> bool:
        nonlocal slips
        slips += segment.event == "stop"
        thrown_out = abs(float(segment.end[0])) > THROWN_OUT * a
        return segment.mode == "stick" or slips == MOST_SLIPS or thrown_out

    segments = march(
        SWITCH,
        "slip+",
        np.array([-a, 0.0, (kp * a - servo.friction.static) / ki]),
        servo.parameters(gain),
        scale=state_scale("switch", servo, gain, a),
        until=stuck_or_tired,
        tol=tol,
        degree=degree,
        kind=kind,
        max_time=patience(servo),
        max_intervals=MOST_INTERVALS["switch"],
    )
    if segments[-1].event == "":
        return HalfCycle(a, 0.0, segments)
    position = float(segments[-1].end[0])
    return HalfCycle(a, position if segments[-1].mode == "stick" else abs(position), segments)


def _lugre(servo: Servo, gain: float, a: float, tol: float, degree: int, kind: Kind) -> HalfCycle:
    """Two centre crossings: the second half cycle is the one that is kept, free of the artificial start."""
    kp, _, ki = servo.torque_gains(gain)
    f = servo.friction
    torque = SECTION * f.static
    x = np.array([-a, ki * a / f.stiffness, (kp * a - torque) / ki, torque / f.stiffness])
    crossings = 0

    def second_centre(segment: Segment) -> bool:
        nonlocal crossings
        crossings += segment.event == "centre"
        return crossings == 2

    p = servo.parameters(gain)
    segments = march(
        LUGRE, "slide+", x, p,
        scale=state_scale("lugre", servo, gain, a), until=second_centre, tol=tol, degree=degree, kind=kind,
        max_time=patience(servo), max_intervals=MOST_INTERVALS["lugre"],
    )  # fmt: skip
    if crossings < 2:
        return HalfCycle(a, 0.0, segments)
    first = next(i for i, s in enumerate(segments) if s.event == "centre")
    kept = segments[first + 1 :]
    side = np.sign(kept[0].end[0])
    last = kept[-1]
    n = x.size
    nodes = np.vstack([last.w[:, :n], last.end])
    torques = motor_torque(nodes.T, p) * side
    below = np.flatnonzero(torques <= -torque)
    i = int(below[0]) if below.size else 0
    if i == 0:
        position = float(nodes[0, 0])
    else:
        weight = (torques[i - 1] + torque) / (torques[i - 1] - torques[i])
        position = float(nodes[i - 1, 0] + weight * (nodes[i, 0] - nodes[i - 1, 0]))
    return HalfCycle(a, position * float(side), kept)


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

    Parameters
    ----------
    model, servo, gain
        the problem.
    want_lower
        look for the unstable fixed point too: the one next inside the stable one, or where there is no stable one the
        outermost.
    """
    kp, _, _ = servo.torque_gains(gain)
    unit = servo.friction.static / kp
    grid = unit * np.geomspace(SCAN_HIGH, SCAN_LOW, SCAN_POINTS)
    seen: list[HalfCycle] = []
    failures: list[float] = []

    def at(a: float) -> HalfCycle | None:
        try:
            return half_cycle(model, servo, gain, a)
        except MarchFailure:
            failures.append(a)
            return None

    upper: HalfCycle | None = None
    lower: HalfCycle | None = None
    for a in grid:
        run = at(float(a))
        if run is None:
            if len(failures) >= MOST_FAILURES and not seen:
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
    if upper is None:
        found = _highest_peak(at, seen)
        if found is not None:
            inside, peak, beyond = found
            seen.append(peak)
            upper = _fixed_point(at, peak, beyond) if peak.ratio >= 1 else None
            lower = _fixed_point(at, peak, inside, tight=True) if want_lower and upper is not None else lower
    best = max(seen, key=lambda r: r.ratio, default=None)
    return Scan(
        float(grid[-1]), float(grid[0]),
        best.ratio if best else float("nan"), best.start if best else float("nan"),
        upper, lower, tuple(failures), len(seen),
    )  # fmt: skip


def near_stable(
    model: Model, servo: Servo, gain: float, a: float, *, close: float | None = None
) -> HalfCycle | None:
    """A half cycle close to a stable fixed point next to a, or None; a short cut that replaces no scan.

    Secant steps in (log a, log P/a); the fixed point is taken for the stable one only where the ratio
    falls with a, as it does at P'(a) < 1, and falls so steeply that the next step would reach the fixed point: at tiny
    gains P(a)/a is next to one over decades of a, and crosses it nowhere.
    """
    close = close or CLOSE[model]
    x, previous = float(np.log(a)), None
    for _ in range(SECANT_ROUNDS):
        try:
            run = half_cycle(model, servo, gain, float(np.exp(x)))
        except MarchFailure:
            return None
        if not 1 / FAR_OFF < run.ratio < FAR_OFF:
            return None
        y = float(np.log(run.ratio))
        slope = -1.5 if previous is None or previous[0] == x else (y - previous[1]) / (x - previous[0])
        if abs(y) < close and previous is not None:
            return replace(run, slope=slope) if abs(y) < -slope * LARGEST_SECANT else None
        if slope >= -0.1:
            return None
        previous = (x, y)
        x = x - max(-LARGEST_SECANT, min(LARGEST_SECANT, y / slope)) if abs(y) >= close else x + 0.02
    return None


Try = Callable[[float], HalfCycle | None]


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
        top = _maximise(at, inner, middle, outer)
        if best is None or top.ratio > best[1].ratio:
            best = (inner, top, outer)
        if top.ratio >= 1:
            break
    return best


def _maximise(at: Try, inner: HalfCycle, best: HalfCycle, outer: HalfCycle) -> HalfCycle:
    """Golden section for the largest ratio between two motions, left as soon as it exceeds one."""
    low, high = np.log(inner.start), np.log(outer.start)
    golden = (np.sqrt(5) - 1) / 2
    left, right = high - golden * (high - low), low + golden * (high - low)
    run_left, run_right = at(float(np.exp(left))), at(float(np.exp(right)))
    for _ in range(30):
        for run in (run_left, run_right):
            if run is not None and run.ratio > best.ratio:
                best = run
        if best.ratio >= 1 or high - low < 1e-5:
            break
        if (run_left.ratio if run_left else -np.inf) > (run_right.ratio if run_right else -np.inf):
            high, right, run_right = right, left, run_left
            left = high - golden * (high - low)
            run_left = at(float(np.exp(left)))
        else:
            low, left, run_left = left, right, run_right
            right = low + golden * (high - low)
            run_right = at(float(np.exp(right)))
    return best


def _fixed_point(at: Try, above: HalfCycle, below: HalfCycle, *, tight: bool = False) -> HalfCycle | None:
    """A half cycle close to the fixed point between `above` (P >= a) and `below` (P < a).

    A few regula falsi steps in (log a, log P/a) for the stable one, where the boundary value problem needs
    no more; to rounding for the unstable one (`tight`), whose slope P' may be 1e5.  None where P jumps across a.
    """
    goal = 1e-14 if tight else 1e-3
    best = min(above, below, key=lambda r: abs(r.ratio - 1))
    for k in range(MOST_STEPS):
        width = abs(np.log(above.start / below.start))
        if abs(best.ratio - 1) < goal or width < 1e-15:
            break
        x, y = np.log(above.start), np.log(max(above.ratio, 1e-3))
        x2, y2 = np.log(below.start), np.log(max(below.ratio, 1e-3))
        theta = 0.5 if k % 2 and (tight or k > FEW_STEPS) else np.clip(y / (y - y2), 0.02, 0.98) if y != y2 else 0.5
        run = at(float(np.exp(x + theta * (x2 - x))))
        if run is None:
            break
        if run.ratio >= 1:
            above = run
        else:
            below = run
        if abs(run.ratio - 1) < abs(best.ratio - 1):
            best = run
    if abs(np.log(max(best.ratio, 1e-300))) > NOT_A_JUMP:
        return None
    beside = at(best.start * (1 + LOCAL))
    if beside is None or min(beside.ratio, best.ratio) <= 0:
        return best
    return replace(best, slope=float(np.log(beside.ratio / best.ratio) / np.log1p(LOCAL)))
