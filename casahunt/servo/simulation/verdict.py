"""What the end of a motion shows: hunting, decaying, growing, at rest or undecided, and from which swings.

A_0, A_1, ... [rad] are the swings: for Switch the distances at which the servo stuck, for LuGre and a stick band the
largest |x1| between crossings of the set point.  Each is a function of the one before, A_{k+1} = g(A_k).

    hunting    the swings are within `SETTLED` of a cycle, and every swing from there comes closer to it
    decaying   every later swing is smaller than the one before, down to rest
    at rest    the same, and the position differs from the set point by no more than it is known to
    growing    the motion leaves for ever (a cycle that it grows to is "hunting" once it is reached)
    undecided  none of these is certain; the sentence says what is missing

Swings that come close to each other prove no cycle: just above the fold they creep past the place where the two cycles
were, d_{k+1}/d_k -> 1 with d_k = A_{k+1} - A_k, and decay later.  For Switch long_run.py therefore solves P(a*) = a*
and checks that the last stick position is drawn to it.  For LuGre and the stick band the swings themselves must show
it (swings.py).

Nothing is judged below the floor: what the position is known to, and `REST` of Fs/kp.  Whether small swings decay is
then no question of the motion but of the linear loop and of the event map.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Any, Literal, Protocol

import numpy as np

from ...motion import MarchFailure, march
from ...results import Result
from ..cycles import SCHEMES, system_of
from ..event_map.half_cycle import StickMap
from ..hunting import Model
from ..servo import Servo
from .long_run import KNOWN, NUDGE, Ahead, AttractingCycle, attracting_cycle_near, escapes, next_stick, nudged, settles
from .small_swings import crept
from .swings import ABOVE, limit_of, limit_of_sides
from .waiting import STILL, breaks_away_after

Array = np.ndarray

SWINGS = 4
"""Fewest swings from which hunting is concluded; most full periods that make amplitude and period."""
SETTLED = 1e-2
"""Relative distance from the cycle at which swings have settled."""
REST = 1e-6
"""Positions within this part of Fs/kp of the set point are at rest, if the servo stays there."""
INSIDE = 0.95
"""Part of static friction up to which LuGre may count as stuck."""
BENT = 3.0
"""Creep of a stuck LuGre servo in units of Fs/sigma0."""
SPAN = 20.0
"""States may start at so many times the scale that their errors are measured in."""
CARRIED = 8
"""Swings that the event map carries a stuck servo on, beyond the motion."""

Kind = Literal["hunting", "decaying", "growing", "at rest", "undecided"]
SETTLES = ("at rest", "decaying")
"""Kinds of a motion that rests or is on its way to."""


@dataclass(frozen=True, repr=False)
class Verdict(Result):
    """What the end of a motion shows.

    Attributes
    ----------
    kind : "hunting", "decaying", "growing", "at rest" or "undecided".
    sentence : what supports it, or what is missing.
    amplitude : mean of half the peak-to-peak position over the last periods that agree with each other [rad]; of a
        hunting motion none of whose periods agrees with the cycle yet, the swing of the cycle; nan without either.
    period : mean of these periods [s]; nan without any.
    swings : number of these (overlapping) periods.
    judged : the swings that it was judged from [rad], the last ones of the motion.
    since : when the first of them was seen [s]; nan without any.
    limit : where they tend: the cycle's swing [rad], 0 for rest, inf for growth; nan where that is not known.  An
        undecided motion may be on its way to a cycle that is.
    multiplier : the factor by which the distance from the limit changes each swing; nan where it was not computed.
    floor : what a position must differ by to be judged [rad].
    motions : motions of the event map computed beyond the motion judged.
    rests_since : time from which on the position has not left the floor [s]; nan where it does.
    waits : time after the end at which a servo that is stuck beside its set point breaks away [s]; nan elsewhere.

    Examples
    --------
    >>> from casahunt import Servo, simulate
    >>> verdict = simulate(Servo(), "switch", 1.0, position=0.99, time=40.0).verdict
    >>> verdict.kind
    'at rest'
    """

    _quantities = ("kind", "amplitude [rad]", "period [s]", "swings")
    _details = ("sentence", "judged", "since [s]", "limit [rad]", "ratios", "multiplier", "floor [rad]", "motions")

    kind: Kind
    sentence: str
    amplitude: float = math.nan
    period: float = math.nan
    swings: int = 0
    judged: tuple[float, ...] = ()
    since: float = math.nan
    limit: float = math.nan
    multiplier: float = math.nan
    floor: float = math.nan
    motions: int = 0
    rests_since: float = math.nan
    waits: float = math.nan

    @property
    def ratios(self) -> tuple[float, ...]:
        """Each swing by the one before."""
        return tuple(b / a if a else math.nan for a, b in zip(self.judged, self.judged[1:], strict=False))


class ObservedMotion(Protocol):
    """What a verdict needs of a trajectory (trajectory.py)."""

    # fmt: off
    @property
    def model(self) -> Model: """See Trajectory."""
    @property
    def servo(self) -> Servo: """See Trajectory."""
    @property
    def gain(self) -> float: """See Trajectory."""
    @property
    def times(self) -> Array: """See Trajectory."""
    @property
    def states(self) -> Array: """See Trajectory."""
    @property
    def modes(self) -> tuple[str, ...]: """See Trajectory."""
    @property
    def state_errors(self) -> Array: """See Trajectory."""
    @property
    def ended(self) -> str: """See Trajectory."""
    def shape(self) -> tuple[Array, Array]: """See Trajectory."""
    def dense(self, per_interval: int = 4) -> tuple[Array, Array]: """See Trajectory."""
    def torque(self, states: Array) -> Array: """See Trajectory."""
    # fmt: on


def static_friction_error(motion: ObservedMotion) -> float:
    """Fs/kp [rad], the error at which the proportional torque is static friction."""
    return motion.servo.friction.static / motion.servo.torque_gains(motion.gain)[0]


def judge_motion(motion: ObservedMotion) -> Verdict:
    """What the end of a motion shows."""
    crossings, peaks = motion.shape()
    error = float(motion.state_errors[0])
    stuck = _stuck(motion)
    swings, at = stuck if motion.model == "switch" else (peaks[1:-1], crossings[:-1])
    floor = max(REST * static_friction_error(motion), error)
    clear = np.flatnonzero(swings > floor)[-SWINGS - 1 :]
    seen = Verdict(
        "undecided", "", *_measured(crossings, peaks),
        judged=tuple(map(float, swings[clear])), since=float(at[clear[0]]) if clear.size else math.nan, floor=floor,
    )  # fmt: skip
    if not math.isfinite(error):
        return replace(seen, sentence="two computations of the motion do not agree; ask for a larger tolerance")
    if not motion.states[:2, -1].any() and abs(motion.torque(motion.states[:, -1:])[0]) <= motion.servo.friction.static:
        return replace(seen, kind="at rest", sentence="it stands at the set point, held by static friction", limit=0.0)
    if escapes(motion.servo, motion.model, motion.gain, motion.states[:, -1]):
        text = "the loop without dry friction is unstable, and the motion is beyond what friction can hold back"
        return replace(seen, kind="growing", sentence=f"{text}", limit=math.inf)
    if motion.model == "switch":
        return _switch(motion, seen, stuck[0], error)
    return _other(motion, seen, stuck[0], swings, error)


def _measured(crossings: Array, peaks: Array) -> tuple[float, float, int]:
    """(amplitude, period, number) of the last full periods that agree to `SETTLED`, `SWINGS` of them at most.

    An amplitude is the mean of two peaks, so that a lopsided cycle has one.
    """
    halves = np.diff(crossings)
    A, T = (peaks[1:-2] + peaks[2:-1]) / 2, halves[:-1] + halves[1:]  # complete swings only
    if not A.size:
        return math.nan, math.nan, 0
    differ = np.flatnonzero(np.abs(A[-SWINGS:] - A[-1]) > SETTLED * A[-1])
    count = min(SWINGS, A.size) - (int(differ[-1]) + 1 if differ.size else 0)
    return float(np.mean(A[-count:])), float(np.mean(T[-count:])), count


# Switch: the stick position is all there is to know -------------------------------------------------------------


def _switch(motion: ObservedMotion, seen: Verdict, sticks: Array, error: float) -> Verdict:
    servo, gain = motion.servo, motion.gain
    crossings, peaks = motion.shape()
    times = motion.times[np.flatnonzero(np.array(motion.modes) == "stick")]
    if crossings.size > SWINGS and not (times > crossings[-SWINGS]).any():  # reversals without stick
        found = _converging(seen, peaks[1:-1], error)
        if found is not None:
            return found
    known = sticks.size and sticks[-1] > seen.floor
    cycle = attracting_cycle_near(servo, gain, float(sticks[-1]), error) if known else None
    if cycle is not None:
        return _at_cycle(motion, seen, cycle, sticks)
    stuck, x = motion.modes[-1] == "stick", motion.states[:, -1]
    carried = (float(sticks[-1]), "") if stuck else crept(servo, gain, x) or _carried_on(motion)
    if carried is None:
        missing = f"the servo has not come to stick in {motion.times[-1]:.4g} s, nor did it when followed on"
        return replace(seen, sentence=f"{missing}; simulate a longer time")
    a, text = carried
    first = ahead = settles(servo, "switch", gain, a + error)
    motions, swings = ahead.motions, 0
    while not ahead.holds and ahead.refuted_at > 0 and swings < CARRIED:
        following = next_stick(servo, gain, a, error)
        if following is None:
            break
        (a, error), swings, motions = following, swings + 1, motions + 1
        # From b >= P(b) up nothing can be shown: the servo has to get below that first.
        if a + error < ahead.refuted_at:
            ahead = settles(servo, "switch", gain, a + error)
            motions += ahead.motions
    seen = replace(seen, motions=motions)
    if ahead.holds:
        if swings:
            text = f"carried on by the event map it sticks {a:.4g} rad beside the set point {swings} swings later; "
        return _resting(motion, seen, text, ahead)
    later = attracting_cycle_near(servo, gain, a, error) if a > seen.floor else None
    if later is not None:
        text = f"carried on by the event map it comes to a cycle of {later.amplitude:.6g} rad"
        coming = replace(seen, limit=later.amplitude, multiplier=later.multiplier)
        return _open(motion, coming, replace(first, sentence=text))
    return _open(motion, seen, first)


def _at_cycle(motion: ObservedMotion, seen: Verdict, cycle: AttractingCycle, sticks: Array) -> Verdict:
    a, count, end = float(sticks[-1]), sticks.size, motion.times[-1]
    what = "cycle" if cycle.swings == 1 else "lopsided cycle"
    distance = abs(a - cycle.amplitude) / cycle.amplitude
    known = replace(seen, limit=cycle.amplitude, multiplier=cycle.multiplier)
    if count >= SWINGS and distance <= SETTLED:
        if cycle.swings == 1 and not abs(seen.amplitude / cycle.amplitude - 1) <= SETTLED:
            # The last stick is there, the periods before it are not: the cycle's own swing says where it hunts.
            known = replace(known, amplitude=cycle.amplitude, period=math.nan, swings=0)
        return replace(
            known, kind="hunting",
            sentence=f"the last stick position is {distance:.1e} from that of a {what} of {cycle.amplitude:.8g} rad, "
            f"which each {'swing' if cycle.swings == 1 else 'period'} multiplies by {cycle.multiplier:+.4g}",
        )  # fmt: skip
    text = (
        f"{count} stick positions in {end:.4g} s, the last one {distance:.1e} from that of a {what} of "
        f"{cycle.amplitude:.6g} rad that draws it; simulate a longer time"
    )
    return _waiting(motion, replace(known, sentence=text))


# LuGre and the stick band: the swings of the motion, and the map for rest ---------------------------------------


def _other(motion: ObservedMotion, seen: Verdict, sticks: Array, swings: Array, error: float) -> Verdict:
    found = _converging(seen, swings, error)
    if found is None and motion.model == "lugre" and swings.size >= SWINGS and _agree(swings[-SWINGS:], error):
        found = _drawn_back(motion, seen, float(swings[-1]), error)
    if found is not None:
        return found
    friction, (kp, kd, _) = motion.servo.friction, motion.servo.torque_gains(motion.gain)
    x = motion.states[:, -1]
    # A motion this weak is as good as stuck where its velocity would carry it.
    a = abs(float(x[0])) + abs(float(x[1])) * (kd + friction.viscous) / kp
    if a > seen.floor:
        carried = _carried_on(motion)
        if carried is not None:
            return _resting(motion, seen, carried[1], Ahead(True, "", 1))
        if not sticks.size:
            return _open(motion, seen, Ahead(False, "the servo has not come to stick", 0))
        a = float(sticks[-1])
    slack = BENT * friction.static / friction.stiffness if motion.model == "lugre" else 0.0
    ahead = settles(motion.servo, motion.model, motion.gain, a + slack + error)
    seen = replace(seen, motions=ahead.motions)
    return _resting(motion, seen, "", ahead) if ahead.holds else _open(motion, seen, ahead)


def _drawn_back(motion: ObservedMotion, seen: Verdict, swing: float, error: float) -> Verdict | None:
    """Hunting of a LuGre servo whose swings agree from the start, where a push off them dies out."""
    pushed = nudged(motion.servo, motion.gain, motion.states[:, -1], motion.modes[-1], seen.period)
    blur = max(error, KNOWN * swing)
    found = limit_of(pushed, blur)
    if found is None or abs(found[0] - swing) > ABOVE * blur + found[1] or swing <= seen.floor:
        return None
    text = (
        f"the swings agree to {ABOVE * error:.1e} rad, and pushed off by {NUDGE:g} of themselves they come back: they "
        f"differ by {found[2]:+.4g} times the difference before"
    )
    return replace(seen, kind="hunting", sentence=text, limit=swing, multiplier=found[2])


def _agree(swings: Array, error: float) -> bool:
    """The swings differ by no more than can be read."""
    return bool(np.ptp(swings) <= ABOVE * error)


def _converging(seen: Verdict, swings: Array, error: float) -> Verdict | None:
    """Hunting, where the swings themselves prove that they converge to a cycle, and have settled."""
    found = limit_of(swings, error) or limit_of_sides(swings, error)
    if found is None or found[0] <= max(seen.floor, 10 * found[1]):
        return None
    limit, uncertain, ratio = found
    distance = abs(float(swings[-1]) - limit) / limit
    if distance > SETTLED:
        return None
    text = (
        f"the swings converge: they differ by {ratio:+.4g} times the difference before, which leads to {limit:.8g} rad "
        f"(within {uncertain:.1e}), {distance:.1e} from the last one"
    )
    return replace(seen, kind="hunting", sentence=text, limit=limit, multiplier=ratio)


# What is shared -------------------------------------------------------------------------------------------------


def _stuck(motion: ObservedMotion) -> tuple[Array, Array]:
    """(|x1| [rad], time [s]) at the end of each stick."""
    if motion.model == "switch":
        last = [
            i for i, mode in enumerate(motion.modes)
            if mode == "stick" and (i + 1 == len(motion.modes) or motion.modes[i + 1] != "stick")
        ]  # fmt: skip
        return np.abs(motion.states[0, np.array(last, int) + 1]), motion.times[np.array(last, int) + 1]
    friction = motion.servo.friction
    still = np.abs(motion.states[1]) <= STILL * friction.stribeck_velocity
    still &= np.abs(motion.torque(motion.states)) <= INSIDE * friction.static
    still[0] = False  # how the motion starts is not how it goes on
    runs = np.flatnonzero(still & ~np.append(still[1:], False))
    return np.abs(motion.states[0, runs]), motion.times[runs]


def _carried_on(motion: ObservedMotion) -> tuple[float, str] | None:
    """(|x1| [rad], sentence) where the motion, followed from its end, creeps to the set point or, for Switch, sticks.

    None where it crosses the set point again first (LuGre), or could not be followed.
    """
    servo, model, x = motion.servo, motion.model, motion.states[:, -1]
    exact, p = model == "switch", servo.parameters(motion.gain)
    system = system_of(model, p.size).vector_form
    side, slips = np.sign(x[0]), 0

    def over(segment: Any) -> bool:
        nonlocal slips
        slips += 1
        if exact:
            return bool(segment.mode == "stick") or slips > 40
        return bool(segment.event == "centre" or segment.end[0] * side <= 0 or slips > 200)

    size = max(abs(float(x[0])), REST * static_friction_error(motion))
    stick_map = StickMap(model, servo, motion.gain)
    scale = np.maximum(stick_map.scale(size), np.abs(x) / SPAN)
    degree, kind = SCHEMES[model]
    try:
        segments = march(
            system, motion.modes[-1], x, p, scale=scale, until=over, tol=1e-6, degree=degree, kind=kind,
            max_time=stick_map.patience, max_intervals=4000,
        )  # fmt: skip
    except MarchFailure:
        return None
    last = segments[-1]
    a = abs(float(last.end[0]))
    if exact and last.mode == "stick":
        where = f"sticks {a:.4g} rad beside" if a > REST * static_friction_error(motion) else "comes to"
        return a, f"followed on it {where} the set point; "
    if last.event == "" and a <= max(1e-3 * abs(float(x[0])), REST * static_friction_error(motion)):
        return 0.0, "followed on it creeps to the set point without crossing it; "
    return None


def _resting(motion: ObservedMotion, seen: Verdict, text: str, ahead: Ahead) -> Verdict:
    """At rest where the position does not leave the floor any more; decaying elsewhere."""
    t, x = motion.dense(8)
    away = np.flatnonzero(np.abs(x[0]) > seen.floor)
    since = float(t[away[-1]]) if away.size else 0.0
    sentence = f"{text}{ahead.sentence}".rstrip("; ")
    if away.size and away[-1] == t.size - 1:
        return _waiting(motion, replace(seen, kind="decaying", sentence=sentence, limit=0.0))
    within = f"within {seen.floor:.2g} rad of the set point, too little to be judged, since {since:.4g} s"
    return replace(
        seen, kind="at rest", sentence=f"{within}; {sentence}", limit=0.0, rests_since=since,
        amplitude=math.nan, period=math.nan, swings=0,
    )  # fmt: skip


def _open(motion: ObservedMotion, seen: Verdict, ahead: Ahead) -> Verdict:
    text = f"neither a cycle nor rest is certain after {motion.times[-1]:.4g} s"
    if motion.ended:
        text = f"it was followed only until {motion.ended}"
    return _waiting(motion, replace(seen, sentence=f"{text} ({ahead.sentence}); simulate a longer time"))


def _waiting(motion: ObservedMotion, seen: Verdict) -> Verdict:
    """A verdict that says besides how long the servo stays where it ends stuck."""
    x = motion.states[:, -1]
    wait = breaks_away_after(motion.servo, motion.gain, x)
    if math.isnan(wait):
        return seen
    text = f"; it ends stuck at {x[0]:+.4g} rad, and the integral action breaks it away about {wait:.4g} s later"
    return replace(seen, sentence=f"{seen.sentence}{text}", waits=wait)
