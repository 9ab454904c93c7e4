"""What a sampled motion shows: hunting, rest, swings that die out or grow; and the pattern that hunting repeats.

Turning points T_i [rad] are the extremes of the position between which it moves by more than `TURNED_BACK` of its range
in the second half of the motion; swings S_i = |T_{i+1} - T_i|.

    at rest     it is stuck with nothing to integrate and a torque within static friction: proven (loop.py); LuGre,
                which never is: in the second half of the motion it moves by less than bristles bend, Fs/sigma0, and the
                integral does not wind up to a breakaway
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
from dataclasses import dataclass

import numpy as np

from ...axis_units import quantity, several
from ..outcome import Outcome

Array = np.ndarray

TURNED_BACK = 0.25
"""Part of the range of the position that it moves back by at a turning point, or more."""
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
    torque by one of its steps [rad], or 0.
    """

    rests_since: float
    far: bool
    waits: str
    count: float
    unit: float
    bends: float = 0.0
    step: float = 0.0

    @property
    def grain(self) -> float:
        """Swings that are smaller show no decay [rad]: nothing is read of them, or acts on them."""
        return max(self.count, self.step)


def judge(times: Array, x: Array, end: Ending) -> Outcome:
    """The verdict on a motion.

    times, x: (n,) of the samples [s], [rad]; end: what else is known.
    """
    if not math.isnan(end.rests_since):
        text = "it is stuck, and its torque stays within static friction"
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
        count = "each swing repeats" if pattern == 2 else f"a pattern of {pattern} swings repeats"
        text = f"{count}, {_how_closely(in_size, in_time)}"
        return Outcome("hunting", text, amplitude, period, pattern, last, lasts)
    largest = float(np.abs(half).max())
    if not end.grain and largest <= DIED_OUT * end.unit and largest < np.abs(x[: -half.size]).max(initial=0.0):
        text = f"within {quantity(largest, 'rad', '.2g')} of the set point since {times[-half.size]:.4g} s"
        return Outcome("decaying", f"{text}{end.waits}", swings=last)
    late = S[t[:-1] >= times[-1] / 2]
    falling = max(FALLING, min(late.size - 1, ENDLESS))  # of a chatter some few are smaller by chance
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
