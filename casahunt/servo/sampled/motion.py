"""The motion of the loop as built, as data.

The equations are those of controller.py and loop.py.  Between two samples the plant moves exactly but for rounding:
there is no step to refine and no error to estimate.  What two programs can still differ in is which count is read where
the position lies within rounding of the edge between two.

What a sampled motion shows: hunting, rest, swings that die out or grow; and the pattern that hunting repeats.

Turning points T_i [rad] are the extremes of the position between which it moves by more than `TURNED_BACK` of its range
in the second half of the motion; swings S_i = |T_{i+1} - T_i|.

    at rest     it is stuck with nothing to integrate and a torque within static friction: proven (loop.py); LuGre,
                which never is: in the second half of the motion it moves by less than bristles bend, Fs/sigma0, and the
                integral does not wind up to a breakaway; with noise, which proves nothing for ever: stuck all through
                the second half, by torques that go on as they have would not move it for as long again; or a pattern
                repeats that is smaller than `UNSEEN` of a count
    hunting     swings and the times that they take repeat within `PATTERN_WITHIN` (and half a count of the encoder)
                after a pattern of p swings, p even, over two patterns, and do not drift: the period is the pattern's.
                Counts that do not lie the same way on both sides make patterns longer than two swings.
                Or, without a pattern, at least `ENDLESS` swings in the second half of the motion get no smaller
    decaying    each of the last `FALLING` swings is smaller than the one before (of `ENDLESS`, where so many are in
                the second half of the motion), none less than what is read of it or acts on it; or, where nothing is
                quantised, it was farther away before, and has stayed in the second half within `DIED_OUT` of
                (Fs - Fc)/kp, the size of hunting by stiction
    growing     the motion was given up far away from the set point
    undecided   none of these: a servo that is stuck beside its set point winds up and breaks away again, and by torques
                in steps it may go on for ever where the loop without steps dies out
"""

from __future__ import annotations

import math
import time as clock
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ...axis_units import in_its_units, quantity, several
from ...checks import COMPUTED, moderate, of_kind, sensible
from ...errors import InputError
from ...export import Columns
from ..drive import Drive
from ..friction import Model
from ..outcome import Outcome
from ..parts.loop import Loop, static_of, torque_gain
from ..parts.lugre import LUGRE
from ..parts.plain_loop import LoopResult, loop_asked
from ..servo import Servo
from ..simulate import start_of
from ..trajectory import STATE_NAMES, named_columns, told_first
from .loop import Sampled, SampledLoop
from .plant import as_run

TURNED_BACK = 0.25
"""Part of the range of the position that it moves back by at a turning point, or more."""
UNSEEN = 1e-2
"""Of a count of the encoder: swings that repeat and are smaller are no hunting: a torque next to static friction."""
PATTERN_WITHIN, DRIFT = 2e-2, 1e-4
"""Parts of the largest swing, and of the longest one: by which those of two patterns may differ, and if all differ one
way."""
DIFFERENCE_TOLD = 1e-3
"""By how much patterns that repeat may differ before it is said."""
DIED_OUT = 1e-2
"""Part of (Fs - Fc)/kp."""
LONGEST_PATTERN = 16
"""Swings."""
ENDLESS, FALLING = 12, 4
"""Swings that show hunting without a pattern, or decay."""
SMALLER, LARGER_LATER = 0.75, 1.5
"""Of two parts of an endless motion: the largest swing of the later one is between so much of the earlier one's."""


def turning_points(x: Array, clear: float) -> Array:
    """Indices at which a motion turns, having moved by more than `clear` since the last one, and moving back by it.

    x: (n,) positions. Returns (m,) indices; the last one, from which it has not moved back, is not among them.
    """
    candidates = np.flatnonzero(np.diff(x))
    if not candidates.size or not clear > 0:
        return np.zeros(0, int)
    moving = np.sign(np.diff(x)[candidates])
    turns = np.concatenate([candidates[:1], candidates[1:][moving[1:] != moving[:-1]], candidates[-1:] + 1])
    found: list[int] = []
    low = high = int(turns[0])
    sense = 0
    for i in turns[1:].tolist():
        low, high = (i if x[i] < x[low] else low), (i if x[i] > x[high] else high)
        if sense >= 0 and x[high] - x[i] > clear:
            found.append(high)
            sense, low = -1, i
        elif sense <= 0 and x[i] - x[low] > clear:
            found.append(low)
            sense, high = 1, i
    return np.array(found, int)


@dataclass(frozen=True)
class Ending:
    """What is known of the end of a motion besides its samples.

    rests_since: when it came to rest for ever [s], nan where it did not; far: whether it was given up far away; waits:
    what is said of a servo that is stuck; count: of the encoder [rad], or 0; unit: (Fs - Fc)/kp [rad], the size of
    hunting by stiction; bends: Fs/sigma0 of LuGre friction that holds [rad], or 0; step: the error that changes the
    torque by one of its steps [rad], or 0; noise: of a reading [rad], or 0.
    """

    rests_since: float
    far: bool
    waits: str
    count: float
    unit: float
    bends: float = 0.0
    step: float = 0.0
    noise: float = 0.0

    @property
    def grain(self) -> float:
        """Swings that are smaller show no decay [rad]: nothing is read of them, or acts on them."""
        return max(self.count, self.step, self.noise)


def judge(times: Array, x: Array, end: Ending) -> Outcome:
    """The verdict on a motion.

    times, x: (n,) of the samples [s], [rad]; end: what else is known.
    """
    if not math.isnan(end.rests_since):
        text = "it is stuck, and its torque stays within static friction"
        text += ", if it goes on as it has, for as long again: noise proves no rest for ever" if end.noise else ""
        where = quantity(x[-1], "rad", "+.4g")
        return Outcome("at rest", f"since {end.rests_since:.6g} s {text}: {where} beside the set point")
    if end.far:
        return Outcome("growing", f"it was followed only until {quantity(x[-1], 'rad', '+.3g')} beside the set point")
    half = x[x.size // 2 :]
    if np.ptp(half) < end.bends:
        bend = quantity(end.bends, "rad", ".2g")
        return Outcome("at rest", f"since {times[-half.size]:.4g} s it moves by less than its bristles bend, {bend}")
    turns = turning_points(x, TURNED_BACK * float(np.ptp(half)))
    t, S = times[turns], np.abs(np.diff(x[turns]))
    last, lasts = (tuple(map(float, values[-LONGEST_PATTERN:])) for values in (S, np.diff(t)))
    pattern, in_size, in_time = _pattern(S, np.diff(t), end.count / 2)
    if pattern:
        amplitude, period = float(S[-pattern:].max()) / 2, float(t[-1] - t[-1 - pattern])
        if amplitude < UNSEEN * end.count:
            trembles = f"it trembles by {quantity(amplitude, 'rad', '.2g')}, less than a hundredth of a count"
            return Outcome("at rest", f"{trembles}, in swings that repeat", swings=last)
        count = "each swing repeats" if pattern == 2 else f"a pattern of {pattern} swings repeats"
        text = f"{count}, {_how_closely(in_size, in_time)}"
        return Outcome("hunting", text, amplitude, period, pattern, last, lasts)
    largest = float(np.abs(half).max())
    if not end.grain and largest <= DIED_OUT * end.unit and largest < np.abs(x[: -half.size]).max(initial=0.0):
        text = f"within {quantity(largest, 'rad', '.2g')} of the set point since {times[-half.size]:.4g} s"
        return Outcome("decaying", f"{text}{end.waits}", swings=last)
    late = S[t[:-1] >= times[-1] / 2]
    # of a chatter, or with noise, some few are smaller by chance
    falling = ENDLESS if end.noise else max(FALLING, min(late.size - 1, ENDLESS))
    falls = S.size > falling and bool((np.diff(S[-falling - 1 :]) < 0).all())
    if falls and S[-1] >= end.grain:  # of less nothing is read, or acts, and the integral goes on
        at_last = quantity(S[-1], "rad", ".3g")
        text = f"the last {falling} swings are each smaller than the one before, {at_last} at the end"
        return Outcome("decaying", f"{text}{end.waits}", swings=last)
    early, later = (float(part.max(initial=0.0)) for part in np.array_split(late, 2))
    if late.size >= ENDLESS and later > LARGER_LATER * early:
        text = f"its swings grow, from {several((early, later), 'rad', '.3g', ' to ')} in the second half of the motion"
        return Outcome("undecided", f"{text}; simulate a longer time", swings=last)
    if late.size >= ENDLESS and later >= SMALLER * early:
        text = f"{late.size} swings in the second half of the motion, which get no smaller and do not repeat"
        mean = float(2 * (t[-1] - t[-1 - late.size]) / late.size)
        return Outcome("hunting", text, float(late.max()) / 2, mean, 0, last, lasts)
    seen = ""
    if late.size:
        seen = f"; its last swing is {quantity(S[-1], 'rad', '.3g')}, {t[-1] - t[-2]:.4g} s after the one before"
    text = f"neither a pattern nor rest is seen in {times[-1]:.4g} s{seen}; simulate a longer time{end.waits}"
    return Outcome("undecided", text, swings=last)


def _how_closely(in_size: float, in_time: float) -> str:
    """By how much a pattern that repeats differs from the one before, relatively: in size, in time."""
    if in_size > PATTERN_WITHIN:
        return f"in time to {100 * in_time:.1g} %, in size to less than half a count"
    off = max(in_size, in_time)
    return "in size and time" + (f", to {100 * off:.1g} %" if off > DIFFERENCE_TOLD else "")


def _pattern(S: Array, lasts: Array, grain: float) -> tuple[int, float, float]:
    """The shortest pattern in which the last swings repeat, 0: none; by how much two differ in size and in time.

    S, lasts: (m,) swings [rad] and their times [s]; grain: what swings may differ by besides [rad].
    """
    for p in range(2, LONGEST_PATTERN + 1, 2):
        if S.size < 2 * p + 2:  # two patterns, and what tells their drift
            break
        now, before = slice(-p - 2, None), slice(-2 * p - 2, -p)
        change, later = S[now] - S[before], np.abs(lasts[now] - lasts[before])
        size, longest = float(S[-p:].max()), float(lasts[-p:].max())
        drifts = bool((change > 0).all() or (change < 0).all()) and float(np.abs(change).max()) > DRIFT * size
        alike = np.abs(change).max() <= PATTERN_WITHIN * size + grain and later.max() <= PATTERN_WITHIN * longest
        if alike and not drifts:
            return p, float(np.abs(change).max()) / size, float(later.max()) / longest
    return 0, math.nan, math.nan


Array = np.ndarray

LONGEST_MOTION = 5_000_000
"""Of a motion: 200 megabytes."""
AT_A_STOP = ("dwell", "reset_at_stop")
"""Remedies that wait for a reading to stay."""
STOOD_AGAIN = 2.5
"""From the middle of the second half of a time to its end, once more as long later, in halves of it."""
FAR_AWAY = 1e3
"""A servo that never comes back is not followed beyond so many times its first distance, or Fs/kp."""


@dataclass(frozen=True, eq=False, repr=False)
class SampledMotion(LoopResult):
    """The motion of the loop as built.

    Attributes
    ----------
    loop, drive, set_point : the loop, without what its drive adds; set point theta_d [rad].
    names : of the n states: x1 = theta - theta_d [rad], x2 = theta' [rad/s], x3, the controller's sum [rad s], where
        they are, then all others.
    times : (m,) of the samples [s].
    states : (n, m), those of the controller as they are before the sample.
    torque : (m - 1,) what each sample asks for [N m].
    stops : times at which it stops [s].
    rests_since : from when on it is known to rest for ever [s], with noise: for as long again; nan where it is not.
    far : whether it was given up far away from the set point.
    wall_s : time to compute it [s].

    Examples
    --------
    >>> from casahunt import Drive, Servo, simulate_sampled
    >>> motion = simulate_sampled(Servo(), 2.0, Drive(sample_time=1e-3, encoder=20000), time=20.0, set_point=0.0,
    ...                           position=0.1)
    >>> motion.verdict.kind
    'at rest'
    """

    _quantities = ("model", "gain [V/rad]", "set_point [rad]", "duration [s]", "verdict = verdict.kind", "wall_s [s]")
    _details = (
        "parts", "reason = verdict.sentence", "amplitude = verdict.amplitude [rad]", "period = verdict.period [s]",
        "pattern = verdict.pattern", "swings = verdict.swings", "rests_since [s]", "peak_torque [N m]",
        "number_of_stops = stops.size", "readings",
    )  # fmt: skip

    loop: Loop
    drive: Drive
    set_point: float
    names: tuple[str, ...]
    times: Array
    states: Array
    torque: Array
    stops: Array
    rests_since: float
    far: bool
    wall_s: float

    @property
    def duration(self) -> float:
        """Length of the motion [s]."""
        return float(self.times[-1])

    @property
    def peak_torque(self) -> float:
        """The largest |torque| [N m]."""
        return float(np.abs(self.torque).max(initial=0.0))

    @property
    def readings(self) -> tuple[int, int]:
        """The lowest and the highest count that is read in the second half of the motion; (0, 0) without an encoder."""
        q, theta = self.drive.count, self.set_point + self.states[0, self.times.size // 2 :]
        return (int(np.floor(theta.min() / q + 0.5)), int(np.floor(theta.max() / q + 0.5))) if q else (0, 0)

    def state(self, at: int) -> dict[str, float]:
        """The states at a sample, by name."""
        return dict(zip(self.names, self.states[:, at].tolist(), strict=True))

    @cached_property
    def static(self) -> float:
        """Static friction [N m]: of the load, where the motor has none."""
        return static_of(self.loop)[0]

    @cached_property
    @in_its_units
    def verdict(self) -> Outcome:
        """What the end of the motion shows."""
        static, coulomb = static_of(self.loop)
        kp = torque_gain(self.loop, "kp")
        unit, step = (static - coulomb) / kp, self.drive.quantise_torque / kp
        bends = static / self.loop.value("stiffness") if self._bristles_hold(kp) else 0.0
        end = Ending(self.rests_since, self.far, self._waits(), self.drive.count, unit, bends, step, self.drive.noise)
        return judge(self.times, self.states[0], end)

    def _bristles_hold(self, kp: float) -> bool:
        """Whether a LuGre servo that does not slip stays: its sum comes to a stand, or its bristles bend to the set
        point, by an exact torque, before that torque is static friction."""
        if self.model != "lugre":
            return False
        w = self.states[self.names.index("x3"), -(self.times.size // 2) - 1 :] if "x3" in self.names else np.zeros(1)
        middle = w[w.size // 2]
        if abs(w[-1] - middle) <= abs(middle - w[0]) / 2:
            return True
        x = np.array([[self.state(-1).get(name, 0.0)] for name in self.loop.system.states])
        load = float(self.loop.signal("external", self.loop.system.modes[0].name, x)[0])
        bent = abs(float(self.torque[-1]) + load) + (self.loop.value("stiffness") + kp) * abs(float(self.states[0, -1]))
        return not (self.drive.quantises or self.drive.noise) and bent < self.static

    def _waits(self) -> str:
        """What is said of a servo that ends stuck."""
        x, v = self.states[:2, -1]
        return f"; it ends stuck {quantity(x, 'rad', '+.4g')} beside the set point" if v == 0 else ""

    def _columns(self) -> Columns:
        states = dict(zip(self.names, self.states[:, :-1], strict=True))
        first = {"time_s": self.times[:-1], "position_rad": self.set_point + states.pop("x1")}
        others = named_columns(self.loop, states, STATE_NAMES | {"x3": "sum"})
        return {**first, **others, "torque_Nm": self.torque}

    def _more(self) -> dict[str, Any]:
        end = self.state(-1)
        return {"parameters": self.loop.parameters, "drive": vars(self.drive), "position": self.set_point + end["x1"],
                "velocity": end["x2"], "integral": end.get("x3"), "bristle": end.get("x4")}  # fmt: skip


def _check_stops(model: str, drive: Drive) -> None:
    """Refuse a remedy that waits for what never is."""
    for key in AT_A_STOP if model == "lugre" and not drive.encoder else ():
        if getattr(drive, key) != getattr(Drive, key):
            raise InputError(f"drive.{key}: needs an encoder or the model 'switch'; LuGre's bristles never stand still")


@in_its_units
def simulate_sampled(
    servo: Servo | Loop, gain: float | None = None, drive: Drive | None = None, *, model: Model | None = None,
    set_point: float | None = None, time: float = 100.0, position: float = 0.0, velocity: float = 0.0,
    integral: float = 0.0, bristle: float = 0.0, start: Mapping[str, float] | None = None,
) -> SampledMotion:  # fmt: skip
    """The motion of the loop as built from an initial state.

    Parameters
    ----------
    servo, gain, drive
        the servo, its gain > 0, and its drive; or a loop of parts, which says its gain itself.
    model
        of a servo: "switch", the default, or "lugre", whose sticks are followed sample by sample.
    set_point
        theta_d [rad], default 1 rad or one unit of length; where it lies between two counts of the encoder the error
        that is read is never 0.
    time
        length of the motion [s], > 0; whole samples.
    position, velocity
        theta [rad], which all angles of the loop are, and theta' [rad/s] at the start.
    integral
        the controller's sum at the start [rad s].
    bristle
        z at the start [rad] (LuGre only).
    start
        of a loop: any other of its states at the start, by name, angles from the set point.

    Returns
    -------
    SampledMotion.

    Raises
    ------
    InputError : a value out of range, more than `LONGEST_MOTION` samples, or parts that no drive runs.
    NotFollowed : the motion cannot be followed further.

    Examples
    --------
    >>> from casahunt import Drive, Servo, simulate_sampled
    >>> simulate_sampled(Servo(), 0.04, Drive(sample_time=1e-3, encoder=2000), time=150.0).verdict.kind
    'hunting'
    """
    drive = of_kind("drive", drive, Drive, "such as Drive(sample_time=1e-3, encoder=2000)")
    sensible("time", time, power=COMPUTED)
    loop = loop_asked(servo, model, gain, usual="switch")
    _check_stops("lugre" if LUGRE in loop.present else "switch", drive)
    theta_d = moderate("set_point", loop.units.step if set_point is None else set_point)
    given = {"velocity": velocity, "integral": integral, "bristle": bristle}
    return followed(loop, drive, theta_d, time, start_of(loop, theta_d, position, given, start))


def followed(loop: Loop, drive: Drive, set_point: float, time: float, start: Mapping[str, float]) -> SampledMotion:
    """The motion of a loop with its drive; start: states by name, of which those that there are count."""
    began = clock.perf_counter()
    T = drive.sample_time
    samples = round(time / T)
    if not 1 <= samples <= LONGEST_MOTION:
        raise InputError(f"time = {time:g}: must be between 1 and {LONGEST_MOTION} samples of {T:g} s")
    motion = SampledLoop(as_run(loop, drive), drive, set_point, start)
    farthest = FAR_AWAY * max(abs(start.get("x1", 0.0)), static_of(loop)[0] / torque_gain(loop, "kp"))
    found = motion.run(samples, farthest)
    rests_from = _stands_from(found) if drive.noise else found.rests_from
    names = told_first(found.names)
    states, n = found.states[[found.names.index(name) for name in names]], found.states.shape[1]
    return SampledMotion(
        loop=loop, drive=drive, set_point=set_point, names=names, times=T * np.arange(n), states=states,
        torque=found.torque, stops=found.stops,
        rests_since=T * rests_from if rests_from >= 0 else float("nan"),
        far=bool(abs(motion.x) > farthest), wall_s=clock.perf_counter() - began,
    )  # fmt: skip


def _stands_from(found: Sampled) -> int:
    """From which sample on a motion with noise stands still, and by its torques, if they go on as they have, will for
    as long again; -1 where they do not show it."""
    x, u = found.states[0], found.torque
    since = int(np.flatnonzero(np.diff(x))[-1]) + 1 if np.ptp(x) else 0
    if since > x.size // 2 or u.size - since < 2:
        return -1
    early, late = np.array_split(u[since:], 2)
    mean = late.mean()
    ahead = mean + STOOD_AGAIN * (mean - early.mean())
    least, most = min(mean, ahead) + late.min() - mean, max(mean, ahead) + late.max() - mean
    return since if found.held[0] < least and most < found.held[1] else -1


def again(
    motion: SampledMotion, drive: Drive, *, from_end: bool = False, time: float | None = None
) -> SampledMotion:
    """The motion with another drive, from its own start or from its end; time: how long, as it was [s]."""
    start = motion.state(-1 if from_end else 0)
    return followed(motion.loop, drive, motion.set_point, motion.duration if time is None else time, start)
