"""Where a motion has come to rest, so that what it still does is rounding.

noise      no state moves by more than `STANDS` of its size, in `STANDS_FOR` phases in a row
balanced   a motion that cannot be followed any more moves `BALANCED` times as slowly as it did before: forces that
           balance to what an event is known to; which one is met next, and whether one is, is rounding
calm       events of such a motion follow one another within its own error, as of a load that rings on while its motor
           is at its breakaway, and it moves `CALM` times as slowly as before
"""

from __future__ import annotations

import numpy as np

from .segment import Segment

Array = np.ndarray

STANDS, STANDS_FOR = 1e-13, 50
"""Of a motion at rest no state moves by more than this part of its size, in so many phases in a row: by rounding."""
BALANCED = 1e-9
"""Part of its largest rate before at which each state rests, in the mean of a phase: as `NEAR_EVENT`, of forces."""
CALM, CALM_FOR, CALM_WITHIN = 1e-5, 4, 1e-7
"""Part of its largest rate before at which each state moves through so many phases in a row, and what the error counts
for at most."""


def at_rest_since(segments: list[Segment], scale: Array) -> int:
    """Number of the first of the phases since which nothing moves but by rounding; how many there are where it does.

    What gets larger is a motion that has begun next to an equilibrium and leaves it.
    """
    last, many = segments[-1], len(segments) - STANDS_FOR
    if many < 0 or np.any(np.abs(last.end - last.start) > STANDS * scale):
        return len(segments)
    since = len(before_rest(segments, scale, STANDS))
    earlier, later = (
        np.max(np.ptp(np.vstack([s.nodes for s in half]), axis=0) / scale)
        for half in (segments[many : -STANDS_FOR // 2], segments[-STANDS_FOR // 2 :])
    )
    return since if since <= many and later <= earlier else len(segments)


def dies_out_at(segments: list[Segment], scale: Array, tol: float) -> int:
    """Number of the phase since which a motion that cannot be followed any more rests; how many there are: it does not.

    tol: error with which it was followed, in sizes of the states. The forces balance there to what an event is known
    to, so that which is met next is rounding: the last phase is none, or the one before has ended on an event that it
    was only near to.
    """
    rounding, brief = np.finfo(float).eps, np.finfo(float).tiny
    moved = np.array([np.ptp(segment.nodes, axis=0) / scale for segment in segments])
    lasted = np.array([[max(segment.duration, brief)] for segment in segments])
    surely, at_most = np.maximum(moved - rounding, 0) / lasted, (moved + rounding) / lasted
    for k in (len(segments) - 1, len(segments) - 2):
        if k > 0 and np.all(at_most[k] <= BALANCED * surely[:k].max(axis=0)):
            return k
    since = len(before_rest(segments, scale, min(tol, CALM_WITHIN)))
    if 0 < since <= len(segments) - CALM_FOR:
        calm = np.ptp(np.vstack([segment.nodes for segment in segments[since:]]), axis=0) / scale
        if np.all(calm + rounding <= CALM * lasted[since:].sum() * surely[:since].max(axis=0)):
            return since
    return len(segments)


def is_noise(segment: Segment, x: Array, scale: Array) -> bool:
    """Whether a phase stays at x, but for rounding."""
    return far_from([segment], x, scale) <= STANDS


def far_from(segments: list[Segment], x: Array, scale: Array) -> float:
    """How far phases lead from x; scale: (n,) sizes of the states that this is relative to."""
    return max((float(np.max(np.abs(segment.nodes - x) / scale)) for segment in segments), default=0.0)


def far_after(segment: Segment, time: float, x: Array, scale: Array) -> float:
    """How far a phase leads from x, from the start on of that of its intervals which is under way at a time in it."""
    since = int(np.searchsorted(segment.breaks * segment.duration, time, "right")) - 1
    return float(np.max(np.abs(segment.nodes[max(since, 0) :] - x) / scale))


def before_rest(segments: list[Segment], scale: Array, within: float) -> list[Segment]:
    """The phases before the motion stays where it ends, but for so much: all of them where it never does.

    scale: (n,) sizes of the states that `within` is relative to.
    """
    since = len(segments)
    while since and far_from(segments[since - 1 : since], segments[-1].end, scale) <= within:
        since -= 1
    return segments[:since]


def at_rest(noise: list[Segment], left: float) -> Segment:
    """The motion at rest, for ever or as long as is asked for, in the place of phases that are rounding.

    `left` [s] is what was left of the time when the last of them began.
    """
    first = noise[0]
    duration = left + sum(segment.duration for segment in noise[:-1])
    return Segment(first.mode, "", duration, np.array([0.0, 1.0]), np.tile(first.start, (1, 2)), first.start.copy())
