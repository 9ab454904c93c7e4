"""Positions that are cut off at an end, told from those that rest there.

Beside an end z = |y - y_end| rises with the time s to it: behind a slip that comes to rest as s^2, before one that sets
off as s^2 or s^3, and where positions are cut off as s.  With h of the motion hidden beyond the end

    s(z) = sqrt(z + h) - sqrt(h),      R(h) = s(4 d)/s(d):    2 where h = 0, 4 where h >> d

so positions are clipped where R is above that of the largest depth h that may hide where a servo rests, some counts,
both before the end and behind it.  The distance d from the end is any at which counts and samples resolve s.  With few
samples in a slip there is none, and nobody can tell.  Positions that are no counts are simpler: none equals another,
but those that are cut off.

Symbols: m samples.
"""

from __future__ import annotations

import math

import numpy as np

from ..record.file import Record

Array = np.ndarray

CLIPPED_SHARE = 0.02
"""Share of the samples that may lie exactly at the largest or smallest position, where others scatter."""
SAME_END = 1e-9
"""Distance of two positions that are one, in units of the range: a simulated motion rests up to rounding."""
TURNING = 0.25
"""Share of the steps that go against the one before, from which on positions carry noise: of noise alone it is 2/3."""
SINGLE = 0.9
"""Share of positions that no other equals, from which on they are none that rest at the same place again."""
SLIPS_ON = 0.1
"""Step from or to an end, in units of the largest one, below which a position without noise rests there."""
NEAREST_SHARE, NEAREST_COUNTS, NEXT_DISTANCE = 0.04, 3.0, 1.5
"""Least distance d in units of half the range and of a count; and from one to the next."""
HIDDEN_SHARE, HIDDEN_COUNTS = 1 / 3, 5.0
"""Depth h that may hide, in units of d and of a count.  It is one count where s^2 holds up to 4 d; of 64 records of
random servos (scripts/identify.py) that were not cut off, with few counts and samples in a slip, none comes nearer than
to 0.95 of R."""
LARGER_RANGE = "record with a larger range"
"""What helps."""
ENDS_THERE = 0.9
"""Share of the turns that must lie at the end."""


def of_clipped(record: Record, quantum: float) -> str:
    """What is said of positions that are cut off; "" where they are not, or where nobody can tell.

    quantum: of a rounded position [rad], 0 where it is not.
    """
    y = record.position
    for end in (float(y.max()), float(y.min())):
        if _stand_out(y, end, quantum) or _corners(record.times, np.abs(y - end), quantum):
            lie = f"{np.mean(y == end):.0%} of the samples lie exactly"
            return f"positions are clipped at {end:.6g} rad, where {lie}; {LARGER_RANGE}"
    return ""


def flat_share(y: Array) -> float:
    """Share of the samples that lie exactly at an end, the larger one."""
    return float(max(np.mean(y == y.max()), np.mean(y == y.min())))


def _stand_out(y: Array, end: float, quantum: float) -> bool:
    """Whether positions that are not rounded differ, but for those at this end: by noise, or from rest to rest."""
    if quantum or np.mean(y == end) < CLIPPED_SHARE:
        return False
    least, steps = SAME_END * float(np.ptp(y)), np.diff(y)
    moved = (np.abs(steps[1:]) > least) & (np.abs(steps[:-1]) > least)
    if moved.any() and np.mean(steps[1:][moved] * steps[:-1][moved] < 0) > TURNING:
        return True
    inside = y[(y != y.max()) & (y != y.min())]
    off = np.abs(steps[(y[:-1] == end) != (y[1:] == end)])
    rests = off.size and np.median(off) < SLIPS_ON * np.abs(steps).max()
    return bool(not rests and np.unique(inside).size > SINGLE * inside.size)


def _corners(t: Array, z: Array, quantum: float) -> bool:
    """Whether a motion reaches and leaves an end at full speed, at distances z (m,) from it."""
    at_end = z <= (quantum / 4 if quantum else SAME_END * float(z.max()))
    if np.mean(at_end) < CLIPPED_SHARE:
        return False
    half, step = float(z.max()) / 2, float(np.median(np.diff(t)))
    z = np.where(at_end, 0.0, np.maximum(z - quantum / 2, SAME_END * half))  # behind the edge of the last count
    d = max(NEAREST_SHARE * half, NEAREST_COUNTS * quantum)
    while 4 * d <= half:
        h = max(HIDDEN_SHARE * d, HIDDEN_COUNTS * quantum)
        rest = (math.sqrt(4 * d + h) - math.sqrt(h)) / (math.sqrt(d + h) - math.sqrt(h))
        times = _times_to(t, z, d)
        # The edge may be half a sample farther away, which matters where a slip has few.
        if times is not None and times.min() >= step:
            later, near = times[:, 1] + step / 2, times[:, 0] + step / 2
            if np.all(later > rest * near):
                return True
        d *= NEXT_DISTANCE
    return False


def _times_to(t: Array, z: Array, d: float) -> Array | None:
    """(2, 2) mean times from the distances d and 4 d to the end, and from the end to them; None: it is no end."""
    far = np.flatnonzero(z >= 4 * d)
    found: list[list[list[float]]] = []
    turns = 0
    for i, j in zip(far[:-1], far[1:], strict=True):
        inside = z[i : j + 1]
        if j - i < 2 or inside.min() >= d:
            continue
        turns += 1
        at = i + np.flatnonzero(inside == 0)
        if at.size:
            arrival, departure = slice(i, at[0] + 1), slice(at[-1], j + 1)
            found.append([_crossed(t[arrival], z[arrival], d), _crossed(-t[departure][::-1], z[departure][::-1], d)])
    if not found or len(found) < ENDS_THERE * turns:
        return None
    return np.asarray(np.mean(found, axis=0))


def _crossed(t: Array, z: Array, d: float) -> list[float]:
    """How long before the end, where z (m,) is zero for the first time, it is last d and 4 d away from it."""
    end, times = (t[-1] + t[-2]) / 2, []
    for level in (d, 4 * d):
        i = np.flatnonzero(z >= level)[-1]
        part = (z[i] - level) / (z[i] - z[i + 1])
        times.append(float(end - t[i] - part * (t[i + 1] - t[i])))
    return times
