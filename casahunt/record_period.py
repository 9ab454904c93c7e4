"""The period of a record: that of its whole waveform.

For pairs of samples a lag tau apart, with the variances taken over the pairs,

    U(tau) = Var[y(t + tau) - y(t)] / (Var[y(t + tau)] + Var[y(t)])            0: repeats exactly, 1: unrelated

is blind to a level and a linear drift, and small at every multiple of the period T whatever the waveform is.  The period
is the smallest lag whose U no larger lag beats by far.  A moving average over a window is linear and time-invariant, so
the difference of two of them has the same period as the position: U is taken of several such differences, wide and
narrow, since one of them is free of the drift and of the noise.

Then the record is divided at marks, one in each period:

    level   the mean of the position over one period round every time, later over the periods between the marks
    mark    a passage of y - level through a threshold, from beyond one edge of a band round it to beyond the other;
            of several passages in a period always the one that follows the last mark by about T
            the time is that of the zero of a line fitted to the samples in the band

Gaps of the record belong to no pair, no mark is placed in one, and no period that holds one is counted.

Symbols: m samples, n points of an even grid, k marks.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

Array = np.ndarray

FEWEST = 3
"""Periods that averages need."""
GRID_POINTS = (2**11, 2**18)
"""Points of the even grid: four for every sample, between these."""
GAP, GAP_SHARE = 8.0, 0.02
"""A gap is a distance of samples above so many usual ones, and above this share of the period."""
STRAY = 0.02
"""Share of the longest distances of samples that do not count for the usual one: the gaps."""
UNRELATED = 0.5
"""U from which on a lag is no repetition: less than half of the variance is alike."""
BEATEN, FLOOR = 0.6, 0.005
"""A larger lag is the period if its U (plus the floor, and what sampling makes of jumps) is below this part of that of
the smaller lag."""
CLEAR = 0.1
"""U that a lag must reach of which the record does not hold enough periods."""
LONGEST = 0.65
"""Largest lag, in units of the length of the record."""
SCALES, NARROW = (4, 16, 64, 256, 1024), 50
"""Widths of moving averages: the length of the record over these; the narrow one is so many times narrower."""
PLAIN, FINE = 2**14, 8
"""Points that the search looks at where nothing is averaged, and in a narrow average."""
PARTS = (0.25, 0.5, 0.75)
"""Beginnings that are left out of the search where a transient at the start hides the period."""
CLEARER = 0.5
"""Part of U that such a search must reach to be preferred to that of the whole record."""
THRESHOLDS = (0.5, 0.4, 0.6, 0.3, 0.7)
"""Thresholds tried, in units of the range."""
BAND = 0.15
"""Half width of the band round the threshold, in units of the range."""
QUIET, FINEST = 6.0, 20
"""Half widths of the band in units of the noise, and the part of a period that is averaged at most to reach them."""
REACH = 0.25
"""A mark may be so many periods away from where the last one foretells it."""
ALIKE = 1.25
"""Passages at most so many times as slow as the fastest are equally sharp."""


@dataclass(frozen=True, eq=False)
class Grid:
    """The record on an even grid.

    Attributes
    ----------
    times : (n,) [s].
    values : (n,) mean of the samples near each, between samples a straight line [rad].
    covered : (n,) False in gaps.
    spacing : usual distance of the samples, or of the points if that is larger [s].
    """

    times: Array
    values: Array
    covered: Array
    spacing: float

    @property
    def step(self) -> float:
        """Distance of the points [s]."""
        return float(self.times[1] - self.times[0])


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


def usual_distance(times: Array) -> float:
    """The distance of samples [s] below which half of the time lies, the longest `STRAY` of them left out."""
    d = np.sort(np.diff(times))
    d = d[: max(1, d.size - int(STRAY * d.size))] if d.size > 1 / STRAY else d
    passed = np.cumsum(d)
    return float(d[np.searchsorted(passed, passed[-1] / 2)])


def gridded(times: Array, values: Array) -> Grid:
    """The samples (m,) on an even grid."""
    n = int(np.clip(4 * times.size, *GRID_POINTS))
    span = float(times[-1] - times[0])
    even = times[0] + span * (np.arange(n) + 0.5) / n
    bins = np.minimum(((times - times[0]) * (n / span)).astype(np.int64), n - 1)
    count = np.bincount(bins, minlength=n)
    held = count > 0
    at = times[0] + np.bincount(bins, times - times[0], n)[held] / count[held]
    mean = np.bincount(bins, values, n)[held] / count[held]
    d = np.diff(times)
    i = np.clip(np.searchsorted(times, even) - 1, 0, d.size - 1)
    covered = held | (d[i] <= GAP * usual_distance(times))
    return Grid(even, np.interp(even, at, mean), covered, max(usual_distance(times), span / n))


# The period -------------------------------------------------------------------------------------------------


def find_period(grid: Grid) -> tuple[float, float]:
    """The period [s] and U there; (nan, inf) where nothing repeats."""
    best = _best(grid)
    for part in PARTS:
        i = int(part * grid.times.size)
        found = _best(Grid(grid.times[i:], grid.values[i:], grid.covered[i:], grid.spacing))
        times = best[0] / found[0]
        # Pairs at a larger lag may leave out the transient, because of a gap, and so repeat better.
        fraction = times > 1.5 and abs(times - round(times)) < 0.02 * times and found[1] < best[1] + CLEAR / 2
        if fraction or found[1] + FLOOR < CLEARER * (best[1] + FLOOR):
            best = found
    return best


def _best(grid: Grid) -> tuple[float, float]:
    best = (float("nan"), float("inf"))
    # Samples see a jump half their distance early or late: that much of U is no difference of two lags.
    both = grid.covered[1:] & grid.covered[:-1]
    steps = np.diff(grid.values)[both]
    jumps = float(np.mean(steps**2)) * grid.spacing / grid.step if steps.size else 0.0
    for values, covered, step in _differences(grid):
        if best[1] <= FLOOR:
            break
        power = float(np.mean(values[covered] ** 2)) if covered.any() else 0.0
        floor = FLOOR + (jumps / 1.5 / power if power > 0 else 0.0)
        found = _smallest_lag(unlikeness(values, covered), step, floor)
        if found[1] + FLOOR < CLEARER * (best[1] + FLOOR):
            best = found
    return best


def off_line(grid: Grid) -> Array:
    """The values less the line through them (n,); 0 in gaps."""
    t, y, w = grid.times - grid.times[0], grid.values, grid.covered
    c = np.polynomial.polynomial.polyfit(t[w], y[w], 1)
    return np.where(w, y - np.polynomial.polynomial.polyval(t, c), 0.0)


def _differences(grid: Grid) -> Iterator[tuple[Array, Array, float]]:
    """The position less a line, and differences of a narrow and a wide moving average: values, covered, step."""
    w, line = grid.covered, off_line(grid)
    n = line.size
    yield _thinned(line, w, grid.step, n // PLAIN)
    for scale in SCALES:
        wide = n // scale
        if wide < NARROW // 2:
            return
        narrow = max(1, wide // NARROW)
        smooth = moving_mean(line, w, narrow) - moving_mean(line, w, wide)
        yield _thinned(np.where(w, smooth, 0.0), w, grid.step, narrow // FINE)


def _thinned(values: Array, covered: Array, step: float, block: int) -> tuple[Array, Array, float]:
    """Means of blocks of neighbouring points."""
    block = max(1, block)
    n = values.size // block
    blocks = covered[: n * block].reshape(n, block).all(axis=1)
    return np.where(blocks, values[: n * block].reshape(n, block).mean(axis=1), 0.0), blocks, step * block


def moving_mean(values: Array, covered: Array, width: int) -> Array:
    """Mean (n,) of the covered values within `width` points round each, at the ends of those that there are."""
    n = values.size
    total = np.concatenate([[0.0], np.cumsum(np.where(covered, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(covered)])
    low = np.clip(np.arange(n) - width // 2, 0, n)
    high = np.clip(np.arange(n) + (width + 1) // 2, 0, n)
    return np.asarray((total[high] - total[low]) / np.maximum(count[high] - count[low], 1))


def unlikeness(values: Array, covered: Array) -> Array:
    """U at the lags 0, 1, 2 ... of the grid; nan where there are too few pairs."""
    n = values.size
    lags = int(LONGEST * n)
    size = 1 << (n + lags - 1).bit_length()
    w = covered.astype(float)
    y = values * w
    y /= max(float(np.max(np.abs(y))), 1e-300)
    fw, fy, fs = (np.fft.rfft(v, size) for v in (w, y, y * y))

    def pairs(a: Array, b: Array) -> Array:
        """Sum over t of a(t) b(t + lag)."""
        return np.asarray(np.fft.irfft(np.conj(a) * b, size)[:lags])

    count = np.round(pairs(fw, fw))
    enough = count > 0.1 * n
    count = np.where(enough, count, 1.0)
    a, b = pairs(fy, fw) / count, pairs(fw, fy) / count
    aa, bb, ab = pairs(fs, fw) / count, pairs(fw, fs) / count, pairs(fy, fy) / count
    both = aa - a**2 + bb - b**2
    change = aa + bb - 2 * ab - (b - a) ** 2
    sure = enough & (both > 1e-9 * float(np.mean(y * y)))
    return np.where(sure, np.maximum(change, 0) / np.where(sure, both, 1.0), np.nan)


def _smallest_lag(u: Array, step: float, floor: float) -> tuple[float, float]:
    """The smallest lag [s] whose U no larger one beats by far, and that U."""
    none = (float("nan"), float("inf"))
    off = np.flatnonzero(u > UNRELATED)
    if not off.size:
        return none
    inner = u[1:-1]
    low = np.flatnonzero((inner <= u[:-2]) & (inner < u[2:]) & (inner < UNRELATED)) + 1
    low = low[low > off[0]]
    # A dip of several small minima, of noise: its lowest one.
    lags, depths = [], []
    for group in np.split(low, np.flatnonzero(_parted(u, low)) + 1) if low.size else []:
        i = int(group[np.argmin(u[group])])
        bend = u[i - 1] - 2 * u[i] + u[i + 1]
        shift = 0.5 * (u[i - 1] - u[i + 1]) / bend if bend > 0 else 0.0
        lags.append((i + shift) * step)
        depths.append(max(float(u[i] - 0.25 * (u[i - 1] - u[i + 1]) * shift), 0.0) if bend > 0 else float(u[i]))
    held = np.array(lags) <= u.size * step / LONGEST / FEWEST  # of the others the record does not hold enough periods
    for i, depth in enumerate(depths):
        if not held[i] and depth > CLEAR:
            continue
        later = [d for d, fits in zip(depths[i + 1 :], held[i + 1 :], strict=True) if fits or not held[i]]
        if all(d + floor >= BEATEN * (depth + floor) for d in later):
            return lags[i], depth
    return none


def _parted(u: Array, low: Array) -> Array:
    """Between this minimum and the next U rises out of the dip: half-way to where nothing is alike."""
    rises = np.array([float(np.nanmax(u[a : b + 1])) for a, b in zip(low[:-1], low[1:], strict=True)])
    return rises > 0.5 * (np.maximum(u[low[:-1]], u[low[1:]]) + UNRELATED)


# Marks ------------------------------------------------------------------------------------------------------


def level_of(grid: Grid, period: float) -> Array:
    """Mean over one period round each point of the grid (n,), between and beyond those a straight line."""
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
    """Straight lines between the points; beyond them it goes on with the slope that it has had on the whole."""
    slope = 0.0
    if where.size > 2:
        slope = float(np.polynomial.polynomial.polyfit(where - where[0], values, 1)[1])
    beyond = np.minimum(t - where[0], 0) + np.maximum(t - where[-1], 0)
    return np.asarray(np.interp(t, where, values) + slope * beyond)


def noise_of(values: Array) -> float:
    """Standard deviation of noise that is independent from sample to sample, from second differences."""
    return 1.4826 * float(np.median(np.abs(np.diff(values, 2)))) / math.sqrt(6)


def mark(times: Array, values: Array, grid: Grid, period: float) -> Marks | None:
    """Divide the record (times, values) of this period; None where there are no two marks."""
    level = level_of(grid, period)
    r = grid.values - level
    width = max(1, round(period / grid.step))
    low, high = _range(r, grid.covered, width)
    if not high > low:
        return None
    # Noise must not carry the position through the band: averages of as many samples as that takes.
    samples = (QUIET * noise_of(values) / (BAND * (high - low))) ** 2
    smooth = min(samples * usual_distance(times), period / FINEST)
    if smooth > 2 * grid.step:
        r = moving_mean(r, grid.covered, round(smooth / grid.step))
        low, high = _range(r, grid.covered, width)
    gaps = _gaps(times, period)
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
        middle, mean = means_between(times, values, marks, whole)
        at = extended(times, middle, mean)
        # The threshold is fixed to the waveform, its distance from the level to the level of the first pass.
    slowness = float(np.median(passages[1] - passages[0])) / (2 * BAND * (high - low))
    return Marks(marks, whole, gapped, rising, resolution, slowness, at)


def means_between(times: Array, values: Array, marks: Array, whole: Array) -> tuple[Array, Array]:
    """Middle times of the whole periods and the means over time of the values there."""
    integral = np.concatenate([[0.0], np.cumsum(np.diff(times) * (values[:-1] + values[1:]) / 2)])
    mean = np.diff(np.interp(marks, times, integral))[whole] / np.diff(marks)[whole]
    return ((marks[1:] + marks[:-1]) / 2)[whole], mean


def _gaps(times: Array, period: float) -> Array:
    """(2, gaps) where each begins and ends."""
    d = np.diff(times)
    i = np.flatnonzero(d > max(GAP * usual_distance(times), GAP_SHARE * period))
    return np.array([times[i], times[i + 1]])


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
    for share in THRESHOLDS:
        for rising, passages in zip((True, False), _passages(grid, r, *ends, share), strict=True):
            passages = passages[:, ~_between(passages, gaps)]
            for chain in _chains(passages.mean(axis=0), period):
                whole, _ = _whole(passages.mean(axis=0)[chain], period, gaps)
                width = float(np.median(passages[1, chain] - passages[0, chain]))
                tried.append((int(whole.sum()), width, rising, share, passages[:, chain]))
    if not tried or max(entry[0] for entry in tried) < 1:
        return None
    most = max(entry[0] for entry in tried)
    tried = [entry for entry in tried if entry[0] >= min(most, max(1, most - 1))]
    sharpest = min(entry[1] for entry in tried)
    sharp = [entry for entry in tried if entry[1] <= ALIKE * sharpest + grid.step]
    # Of equally sharp ones the nearest to the middle, then the one with more periods, then the rising one.
    best = min(sharp, key=lambda entry: (abs(entry[3] - 0.5), -entry[0], not entry[2]))
    return best[2], best[3], best[4]


def _passages(grid: Grid, r: Array, low: float, high: float, share: float) -> tuple[Array, Array]:
    """(2, k) last time before and first time behind the band, of upward and of downward passages."""
    t = grid.times[grid.covered]
    r = r[grid.covered]
    above, below = (low + (share + sign * BAND) * (high - low) for sign in (1, -1))
    side = np.where(r > above, 1, np.where(r < below, -1, 0))
    outside = np.flatnonzero(side)
    turn = np.flatnonzero(side[outside[1:]] != side[outside[:-1]])
    a, b = outside[turn], outside[turn + 1]
    up = side[b] > 0
    both = np.array([t[a], t[b]])
    return both[:, up], both[:, ~up]


def _chains(at: Array, period: float) -> list[list[int]]:
    """Passages that follow each other by about a period; one chain from each of those in the middle period."""
    if at.size < 2:
        return []
    middle = at.size // 2
    starts = [i for i in range(middle, at.size) if at[i] < at[middle] + (1 - REACH) * period]
    last = at.size - 1
    back = -at[::-1]
    return [[*(last - j for j in _follow(back, last - i, period)[::-1]), i, *_follow(at, i, period)] for i in starts]


def _follow(at: Array, i: int, period: float) -> list[int]:
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
    """Times at which lines through the samples of each passage reach the threshold, and how sure the samples make them."""
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
