"""Marks that divide a record into its periods.

    level   the mean of the position over one period round every time, later over the periods between the marks
    mark    a passage of y - level through a threshold, from beyond one edge of a band round it to beyond the other;
            of several passages in a period always the one that follows the last mark by about T
            the time is that of the zero of a line fitted to the samples in the band

No mark is placed in a gap, and no period that holds one is counted.

Symbols: m samples, n points of an even grid, k marks.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .period import GAP, Grid, moving_mean, usual_distance

Array = np.ndarray

GAP_SHARE = 0.02
"""A distance of samples below this share of the period hides nothing."""
THRESHOLDS = (0.5, 0.4, 0.6, 0.3, 0.7)
"""Thresholds tried, in units of the range."""
BAND = 0.15
"""Half width of the band round the threshold, in units of the range."""
QUIET, AVERAGED_PART = 6.0, 20
"""Half widths of the band in units of the noise, and the part of a period that is averaged at most to reach them."""
PAIRED = 200
"""Points at most that a median slope is taken of."""
REACH = 0.25
"""A mark may be so many periods away from where the last one foretells it."""
EQUALLY_SHARP = 1.25
"""Passages at most so many times as slow as the fastest are equally sharp."""


@dataclass(frozen=True, eq=False)
class Marks:
    """Times that divide the record.

    Attributes
    ----------
    times : (k,) [s].
    whole : (k - 1,) from this mark to the next it is one period without a gap.
    gapped : (k - 1,) there is a gap between.
    rising : passages are upward ones.
    resolution : (k,) how well the samples resolve each passage [s].
    slowness : time that a passage takes for one rad [s/rad].
    level : (m,) level at the samples [rad].
    """

    times: Array
    whole: Array
    gapped: Array
    rising: bool
    resolution: Array
    slowness: float
    level: Array


def level_of(grid: Grid, period: float) -> Array:
    """Mean over one period round each point of the grid, between and beyond those a straight line.

    period: [s]. Returns (n,) level [rad].
    """
    t, step = grid.times, grid.step
    total = np.concatenate([[0.0], np.cumsum(grid.values)]) * step
    gaps = np.concatenate([[0.0], np.cumsum(~grid.covered)])
    edges = np.concatenate([t - step / 2, [t[-1] + step / 2]])
    a, b = t - period / 2, t + period / 2
    inside = (a >= edges[0]) & (b <= edges[-1])
    whole = inside & (np.interp(b, edges, gaps) - np.interp(a, edges, gaps) < 0.5)
    mean = (np.interp(b, edges, total) - np.interp(a, edges, total)) / period
    if not whole.any():
        return np.full(t.size, float(np.mean(grid.values[grid.covered])))
    return extended(t, t[whole], mean[whole])


def extended(t: Array, where: Array, values: Array) -> Array:
    """Straight lines between the points; beyond them the median of the slopes between any two goes on.

    The median (Theil and Sen), because a transient at the start must not tilt the end.

    t: (n,) times at which the lines are asked for; where, values: (k,) rising times and the values there. Returns (n,).
    """
    slope = 0.0
    if where.size > 2:
        few = np.linspace(0, where.size - 1, min(where.size, PAIRED)).astype(int)
        i, j = np.triu_indices(few.size, 1)
        slope = float(np.median((values[few][j] - values[few][i]) / (where[few][j] - where[few][i])))
    beyond = np.minimum(t - where[0], 0) + np.maximum(t - where[-1], 0)
    return np.asarray(np.interp(t, where, values) + slope * beyond)


def mark(times: Array, values: Array, grid: Grid, period: float) -> Marks | None:
    """Divide a record into periods.

    times, values: (m,) samples [s], [rad]; grid: the same on an even grid; period: its period [s].
    Returns marks; None where there are no two.
    """
    level = level_of(grid, period)
    r = grid.values - level
    width = max(1, round(period / grid.step))
    low, high = _range(r, grid.covered, width)
    if not high > low:
        return None
    # Noise, by its second differences, must not carry the position through the band: averages of as many samples as
    # that takes.
    noise = 1.4826 * float(np.median(np.abs(np.diff(values, 2)))) / math.sqrt(6)
    samples = (QUIET * noise / (BAND * (high - low))) ** 2
    smooth = min(samples * usual_distance(times), period / AVERAGED_PART)
    if smooth > 2 * grid.step:
        r = moving_mean(r, grid.covered, round(smooth / grid.step))
        low, high = _range(r, grid.covered, width)
    i = np.flatnonzero(np.diff(times) > max(GAP * usual_distance(times), GAP_SHARE * period))
    gaps = np.array([times[i], times[i + 1]])  # where each begins and ends
    chosen = _chosen(grid, r, (low, high), period, gaps)
    if chosen is None:
        return None
    rising, share, passages = chosen
    threshold = low + share * (high - low)
    at = np.interp(times, grid.times, level)
    for _ in range(2):
        marks, resolution = _refined(times, values - at, passages, threshold)
        whole, gapped = _whole(marks, period, gaps)
        if not whole.any():
            break
        at = extended(times, ((marks[1:] + marks[:-1]) / 2)[whole], means_between(times, values, marks)[whole])
        # The threshold is fixed to the waveform, its distance from the level to the level of the first pass.
    slowness = float(np.median(passages[1] - passages[0])) / (2 * BAND * (high - low))
    return Marks(marks, whole, gapped, rising, resolution, slowness, at)


def means_between(times: Array, values: Array, edges: Array) -> Array:
    """Means over time of samples (m,) [rad] at times [s] between neighbouring edges (..., k + 1) [s]: (..., k)."""
    integral = np.concatenate([[0.0], np.cumsum(np.diff(times) * (values[:-1] + values[1:]) / 2)])
    return np.asarray(np.diff(np.interp(edges, times, integral)) / np.diff(edges))


def _whole(marks: Array, period: float, gaps: Array) -> tuple[Array, Array]:
    """(k - 1,) from this mark to the next it is one period without a gap; there is a gap between."""
    gapped = _between(np.array([marks[:-1], marks[1:]]), gaps)
    return (np.abs(np.diff(marks) - period) <= REACH * period) & ~gapped, gapped


def _between(ends: Array, gaps: Array) -> Array:
    """(k,) there is a gap between ends[0] and ends[1]: one that ends behind the first and begins before the second."""
    return np.asarray(np.searchsorted(gaps[1], ends[0], "right") < np.searchsorted(gaps[0], ends[1], "left"))


def _range(r: Array, covered: Array, width: int) -> tuple[float, float]:
    """Lowest and highest value of a usual period: the medians over windows of one."""
    n = max(1, r.size // width)
    size = min(width, r.size)
    windows, held = r[: n * size].reshape(n, size), covered[: n * size].reshape(n, size)
    full = held.mean(axis=1) >= min(0.9, float(np.max(held.mean(axis=1))))  # a gap may hide a peak
    if not held[full].any(axis=1).all():
        return 0.0, 0.0
    low = np.min(np.where(held, windows, np.inf), axis=1)[full]
    high = np.max(np.where(held, windows, -np.inf), axis=1)[full]
    return float(np.median(low)), float(np.median(high))


def _chosen(
    grid: Grid, r: Array, ends: tuple[float, float], period: float, gaps: Array
) -> tuple[bool, float, Array] | None:
    """Direction, threshold and passages (2, k) that divide the record into most periods by the sharpest passages."""
    tried: list[tuple[int, float, bool, float, Array]] = []
    (low, high), t, r = ends, grid.times[grid.covered], r[grid.covered]
    for share in THRESHOLDS:
        above, below = (low + (share + sign * BAND) * (high - low) for sign in (1, -1))
        side = np.where(r > above, 1, np.where(r < below, -1, 0))
        outside = np.flatnonzero(side)
        turn = np.flatnonzero(side[outside[1:]] != side[outside[:-1]])
        a, b = outside[turn], outside[turn + 1]
        both = np.array([t[a], t[b]])  # last time before and first time behind the band
        for rising, passages in ((True, both[:, side[b] > 0]), (False, both[:, ~(side[b] > 0)])):
            passages = passages[:, ~_between(passages, gaps)]
            at = passages.mean(axis=0)
            if at.size > 1:  # those that follow each other by about a period, from the middle one on to either side
                middle, last = at.size // 2, at.size - 1
                before = [last - j for j in _chain_behind(-at[::-1], last - middle, period)]
                passages = passages[:, [*before[::-1], middle, *_chain_behind(at, middle, period)]]
            if passages.shape[1] > 1:
                whole, _ = _whole(passages.mean(axis=0), period, gaps)
                tried.append((int(whole.sum()), float(np.median(passages[1] - passages[0])), rising, share, passages))
    most = max((entry[0] for entry in tried), default=0)
    if most < 1:
        return None
    tried = [entry for entry in tried if entry[0] >= max(1, most - 1)]
    sharpest = min(entry[1] for entry in tried)
    sharp = [entry for entry in tried if entry[1] <= EQUALLY_SHARP * sharpest + grid.step]
    # Of equally sharp ones the nearest to the middle, then the one with more periods, then the rising one.
    return min(sharp, key=lambda entry: (abs(entry[3] - 0.5), -entry[0], not entry[2]))[2:]


def _chain_behind(at: Array, i: int, period: float) -> list[int]:
    """The chain behind passage i; behind a gap, or where a passage is missing, with the one that fits best."""
    chain: list[int] = []
    goal = at + period
    after = np.clip(np.searchsorted(at, goal), 1, at.size - 1)
    nearest = np.where(np.abs(at[after] - goal) < np.abs(at[after - 1] - goal), after, after - 1)
    follows = np.abs(at[nearest] - goal) <= REACH * period
    early = np.searchsorted(at, at + (1 - REACH) * period, side="right")
    while True:
        j = int(nearest[i])
        if not follows[i]:
            first = int(early[i])
            if first >= at.size:
                return chain
            group = np.arange(first, np.searchsorted(at, at[first] + period))
            cycles = (at[group] - at[i]) / period
            j = int(group[np.argmin(np.abs(cycles - np.round(cycles)))])
        chain.append(j)
        i = j


def _refined(times: Array, r: Array, passages: Array, threshold: float) -> tuple[Array, Array]:
    """Times at which lines through the samples of each passage reach the threshold, and how well they resolve it."""
    # with the nearest sample on either side, so that the passage lies between samples
    first = np.maximum(np.searchsorted(times, passages[0], side="right") - 1, 0)
    last = np.minimum(np.searchsorted(times, passages[1]) + 1, times.size)
    found, resolution = [], []
    for a, b, middle in zip(first, last, passages.mean(axis=0), strict=True):
        t, y = times[a:b], r[a:b] - threshold
        centre = float(t.mean())
        d = t - centre
        slope = float(d @ y) / max(float(d @ d), 1e-300)
        at = centre - float(y.mean()) / slope if slope * (y[-1] - y[0]) > 0 else float(middle)
        found.append(float(np.clip(at, t[0], t[-1])))
        resolution.append(float(np.max(np.diff(t))) / max(t.size - 2, 1))
    return np.array(found), np.array(resolution)
