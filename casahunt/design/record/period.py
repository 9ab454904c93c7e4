"""The period of a record: that of its whole waveform.

For pairs of samples a lag tau apart, with the variances taken over the pairs,

    U(tau) = Var[y(t + tau) - y(t)] / (Var[y(t + tau)] + Var[y(t)])            0: repeats exactly, 1: unrelated

is blind to a level and a linear drift, and small at every multiple of the period T whatever the waveform is.  T is the
smallest lag whose U no larger lag beats by far.  A moving average over a window is linear and time-invariant, so the
difference of two of them has the same period as the position: U is taken of several such differences, wide and narrow,
since one of them is free of the drift and of the noise.

Gaps of the record belong to no pair.

Symbols: n points of an even grid.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

Array = np.ndarray

FEWEST_PERIODS = 3
"""Periods that averages need."""
EVEN_POINTS = (2**11, 2**18)
"""Points of the even grid: four for every sample, between these."""
GAP = 8.0
"""A gap is a distance of samples above so many usual ones."""
STRAY_GAPS = 0.02
"""Share of the longest distances of samples that do not count for the usual one: the gaps."""
UNRELATED = 0.5
"""U from which on a lag is no repetition: less than half of the variance is alike."""
BEATEN, FLOOR = 0.6, 0.005
"""A larger lag is the period if its U (plus the floor) is below this part of that of the smaller lag."""
CLEAR = 0.1
"""U that a lag must reach of which the record does not hold enough periods."""
LONGEST = 0.65
"""Largest lag, in units of the length of the record."""
SCALES, NARROW_AVERAGE = (4, 16, 64, 256, 1024), 50
"""Widths of moving averages: the length of the record over these; the narrow one is so many times narrower."""
PLAIN, AVERAGED_POINTS = 2**14, 8
"""Points that the search looks at where nothing is averaged, and in a narrow average."""
PARTS = (0.25, 0.5, 0.75)
"""Beginnings that are left out of the search where a transient at the start hides the period."""
CLEARER = 0.5
"""Part of U that such a search must reach to be preferred to that of the whole record."""


@dataclass(frozen=True, eq=False)
class Grid:
    """The record on an even grid.

    Attributes
    ----------
    times : (n,) [s].
    values : (n,) mean of the samples near each, between samples a straight line [rad].
    covered : (n,) False in gaps.
    """

    times: Array
    values: Array
    covered: Array

    @property
    def step(self) -> float:
        """Distance of the points [s]."""
        return float(self.times[1] - self.times[0])


def usual_distance(times: Array) -> float:
    """The distance of samples [s] below which half of the time lies, the longest `STRAY_GAPS` of them left out."""
    d = np.sort(np.diff(times))
    d = d[: max(1, d.size - int(STRAY_GAPS * d.size))] if d.size > 1 / STRAY_GAPS else d
    passed = np.cumsum(d)
    return float(d[np.searchsorted(passed, passed[-1] / 2)])


def gridded(times: Array, values: Array) -> Grid:
    """The samples on an even grid.

    times, values: (m,) samples [s], [rad].
    """
    n = int(np.clip(4 * times.size, *EVEN_POINTS))
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
    return Grid(even, np.interp(even, at, mean), covered)


# The period -------------------------------------------------------------------------------------------------


def find_period(grid: Grid, least: float) -> tuple[float, float]:
    """The period [s] and U there; (nan, inf) where nothing repeats.

    least: range [rad] up to which values are rounding; what rests may repeat itself in its last digits.
    """
    best = _best(grid, least)
    for part in PARTS:
        i = int(part * grid.times.size)
        found = _best(Grid(grid.times[i:], grid.values[i:], grid.covered[i:]), least)
        times = best[0] / found[0]
        # Pairs at a larger lag may leave out the transient, because of a gap, and so repeat better.
        fraction = times > 1.5 and abs(times - round(times)) < 0.02 * times and found[1] < 1.1 * best[1] + FLOOR
        best = found if fraction else _clearer(best, found)
    return best


def _clearer(best: tuple[float, float], found: tuple[float, float]) -> tuple[float, float]:
    """Of two lags with their U the second one where that is by far the better."""
    return found if found[1] + FLOOR < CLEARER * (best[1] + FLOOR) else best


def _best(grid: Grid, least: float) -> tuple[float, float]:
    best = (float("nan"), float("inf"))
    for values, covered, step in _differences(grid):
        if best[1] <= FLOOR:
            break
        if np.ptp(values) <= least:
            continue
        best = _clearer(best, _smallest_lag(unlikeness(values, covered), step))
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
        if wide < NARROW_AVERAGE // 2:
            return
        narrow = max(1, wide // NARROW_AVERAGE)
        smooth = moving_mean(line, w, narrow) - moving_mean(line, w, wide)
        yield _thinned(np.where(w, smooth, 0.0), w, grid.step, narrow // AVERAGED_POINTS)


def _thinned(values: Array, covered: Array, step: float, block: int) -> tuple[Array, Array, float]:
    """Means of blocks of neighbouring points."""
    block = max(1, block)
    blocks = in_blocks(covered, block).all(axis=1)
    return np.where(blocks, in_blocks(values, block).mean(axis=1), 0.0), np.asarray(blocks), step * block


def in_blocks(values: Array, block: int) -> Array:
    """(n, block) neighbouring values as rows; what is left over at the end is left out."""
    n = values.size // block
    return values[: n * block].reshape(n, block)


def moving_mean(values: Array, covered: Array, width: int) -> Array:
    """Mean of the covered values round each point, at the ends of those that there are.

    values, covered: (n,) values on an even grid; bool, False in gaps. Returns (n,).
    """
    n = values.size
    total = np.concatenate([[0.0], np.cumsum(np.where(covered, values, 0.0))])
    count = np.concatenate([[0], np.cumsum(covered)])
    low = np.clip(np.arange(n) - width // 2, 0, n)
    high = np.clip(np.arange(n) + (width + 1) // 2, 0, n)
    return np.asarray((total[high] - total[low]) / np.maximum(count[high] - count[low], 1))


def unlikeness(values: Array, covered: Array) -> Array:
    """U of the module docstring.

    values, covered: (n,) values on an even grid; bool, False in gaps.
    Returns U at the lags 0, 1, 2 ... of the grid; nan where there are too few pairs.
    """
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


def _smallest_lag(u: Array, step: float) -> tuple[float, float]:
    """The smallest lag [s] whose U no larger one beats by far, and that U."""
    none = (float("nan"), float("inf"))
    off = np.flatnonzero(u > UNRELATED)
    if not off.size:
        return none
    inner = u[1:-1]
    low = np.flatnonzero((inner <= u[:-2]) & (inner < u[2:]) & (inner < UNRELATED)) + 1
    low = low[low > off[0]]
    lags, depths = [], []
    for i in low.tolist():
        bend = u[i - 1] - 2 * u[i] + u[i + 1]
        shift = 0.5 * (u[i - 1] - u[i + 1]) / bend if bend > 0 else 0.0
        lags.append((i + shift) * step)
        depths.append(max(float(u[i] - 0.25 * (u[i - 1] - u[i + 1]) * shift), 0.0) if bend > 0 else float(u[i]))
    # Of the others the record does not hold enough periods.
    held = np.array(lags) <= u.size * step / LONGEST / FEWEST_PERIODS
    for i, depth in enumerate(depths):
        if not held[i] and depth > CLEAR:
            continue
        later = [d for d, fits in zip(depths[i + 1 :], held[i + 1 :], strict=True) if fits or not held[i]]
        if all(d + FLOOR >= BEATEN * (depth + FLOOR) for d in later):
            return lags[i], depth
    return none
