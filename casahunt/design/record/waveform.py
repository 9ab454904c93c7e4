"""The waveform of a record that is divided into periods, and how high it is.

    folded     all samples of whole periods against the phase 0..1 from the mark that begins their period
    waves      each period alone: means over `BINS` parts of it
    shape      the folded samples, smoothed
    peaks      parabolas fitted to the folded samples near the top and near the bottom of the shape: a plateau where the
               servo sticks, a cap elsewhere
    quantum    distance of the values, where all of them lie on a ladder: a rounded position or an encoder's

So noise is averaged away before peaks are taken, which the largest sample of each period would not do.

Symbols: m samples, k periods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from .period import in_blocks
from .period_marks import means_between

Array = np.ndarray

BINS = 100
"""Parts of a period over which its own wave is averaged."""
GRID = 400
"""Phases at which the shape is known."""
FOLDED = 100_000
"""Folded samples that the shape is drawn through; of more, neighbours in phase are averaged."""
NEIGHBOURS, SHARE, MOST_SHARE = 9, 0.02, 0.12
"""Samples that a point of the shape is fitted to: at least so many, as a rule this part of all, and at most that."""
NOISE_SHARE = 0.01
"""Error of a point of the shape, in units of the amplitude, above which more samples are used."""
CAP = 0.05
"""Depth of the caps that peaks are fitted to, in units of the amplitude."""
SIDE = 0.25
"""Distance from the level, in units of the amplitude, from which the position is on one side of it."""
FEWEST_PLACES = 4
"""Phases that a parabola needs."""
TRIM, TRIMS = 3.0, 4
"""Samples so many noises off a cap are left out of it, in so many rounds: the flanks beside a plateau."""
LADDER, STRAY = 0.05, 0.1
"""Values are on a ladder if all but this share (the second) of their distances are whole steps to within the first."""
MOST_PARTS, ALIKE, MOST_ALIKE = 5, 0.005, 0.2
"""Parts that a wave may divide into; share of its power by which equal ones may always differ, and at most."""
SAME = 1e-7
"""Values that differ by less than this part of their range are the same."""


@dataclass(frozen=True, eq=False)
class Folded:
    """Samples of whole periods.

    Attributes
    ----------
    phase : (m,) 0..1, sorted.
    values : (m,) position - level [rad].
    share : (m,) the time that a sample stands for [s].
    """

    phase: Array
    values: Array
    share: Array


def fold(times: Array, values: Array, marks: Array, whole: Array) -> Folded:
    """Lay the whole periods over each other.

    times, values: (m,) samples [s], [rad]; marks, whole: (k + 1,) times that divide the record [s]; (k,) bool.
    Returns folded: phases 0..1, rising, of the samples in whole periods.
    """
    i = np.searchsorted(marks, times, side="right") - 1
    inside = (i >= 0) & (i < marks.size - 1)
    inside[inside] = whole[i[inside]]
    i = i[inside]
    phase = (times[inside] - marks[i]) / (marks[i + 1] - marks[i])
    order = np.argsort(phase, kind="stable")
    # where a motion is fast its samples may stand closer
    return Folded(phase[order], values[inside][order], np.gradient(times)[inside][order])


def waves(times: Array, values: Array, marks: Array, whole: Array) -> Array:
    """Means over time of each whole period's parts, less the mean of the period.

    times, values: (m,) samples [s], [rad]; marks, whole: times that divide the record [s]; for each gap between them,
    whether it is a whole period. Returns (k, BINS) [rad].
    """
    edges = marks[:-1][whole][:, None] + np.diff(marks)[whole][:, None] * (np.arange(BINS + 1) / BINS)
    mean = means_between(times, values, edges)
    return np.asarray(mean - mean.mean(axis=1, keepdims=True))


def factors(wave: Array, mean: Array) -> Array:
    """How large each period is, beside the mean.

    wave, mean: (k, BINS) the periods' waves; (BINS,) the mean one.
    Returns (k,) factor that fits the mean wave to each period's.
    """
    return np.asarray(wave @ mean / max(float(mean @ mean), 1e-300))


def number_of_equal_parts(wave: Array, blur: float) -> int:
    """Into how many equal parts the mean wave divides.

    Two parts are equal if their difference is no larger than that of the waves from their mean, averaged, than `ALIKE`
    of the wave, or than what sampling and rounding can make of equal periods.

    wave: (k, BINS) the periods' waves [rad]; blur: variance that sampling and rounding make [rad2].
    Returns 1 for a period, n where n periods were taken for one.
    """
    k = wave.shape[0]
    if k < 2:
        return 1
    mean = wave.mean(axis=0)
    power = float(mean @ mean)
    scatter = float(np.mean(np.sum((wave - mean) ** 2, axis=1))) / (k - 1)
    bins = np.arange(BINS) + 0.5
    for parts in range(MOST_PARTS, 1, -1):
        shifted = np.interp((bins + BINS / parts) % BINS, bins, mean, period=BINS)
        allowed = max(2 * ALIKE * power, 3 * scatter, BINS * blur)
        if float(np.sum((mean - shifted) ** 2)) < min(allowed, MOST_ALIKE * power):
            return parts
    return 1


def quantum(values: Array) -> float:
    """Distance of the values [rad] where they lie on a ladder, else 0."""
    levels = np.unique(values)
    span = float(levels[-1] - levels[0])
    levels = levels[np.concatenate([[True], np.diff(levels) > SAME * span])]
    d = np.diff(levels)
    if not d.size or levels.size > values.size / 3:
        return 0.0
    step = float(np.min(d))
    on = _on_ladder(d, step)
    if on.mean() < 1 - STRAY:
        return 0.0
    return float(np.mean(d[on] / np.round(d[on] / step)))


def counts_by(values: Array, count: float) -> bool:
    """Whether all values differ by whole counts of an encoder, however few of them there are [rad]."""
    return bool(count > 0 and _on_ladder(np.diff(np.unique(values)), count).all())


def _on_ladder(d: Array, step: float) -> Array:
    return np.abs(d / step - np.round(d / step)) <= LADDER


def shape_of(folded: Folded) -> tuple[Array, Array, float]:
    """Phases (GRID + 1,), the smoothed shape there, and the noise about it.

    At each phase it is the mean of the nearest samples, of more of them where there is noise.
    """
    phi, values = folded.phase, folded.values
    block = max(1, phi.size // FOLDED)
    phi, values = (in_blocks(v, block).mean(axis=1) for v in (phi, values))
    m = phi.size
    grid = np.linspace(0, 1, GRID + 1)
    count, noise = max(min(NEIGHBOURS, m), round(SHARE * m)), 0.0
    shape = np.zeros(grid.size)
    for _ in range(2):
        # Local lines through the `count` nearest of the sorted, periodic samples, at each phase of the grid. Lines,
        # because parabolas overshoot at the corner where a slip ends and the stick begins
        reach = min(count, phi.size)
        wide = np.concatenate([phi[-reach:] - 1, phi, phi[:reach] + 1])
        ys = np.concatenate([values[-reach:], values, values[:reach]])
        first = np.clip(np.searchsorted(wide, grid) - count // 2, 0, wide.size - count)
        result = np.zeros(grid.size)
        for i, (low, at) in enumerate(zip(first, grid, strict=True)):
            d, y = wide[low : low + count] - at, ys[low : low + count]
            centre = float(d.mean())
            d = d - centre
            slope = float(d @ y) / max(float(d @ d), 1e-300)
            result[i] = float(y.mean()) - slope * centre
        shape = result
        residual = folded.values - np.interp(folded.phase, grid, shape)
        noise = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
        size = NOISE_SHARE * float(np.ptp(shape)) / 2 * math.sqrt(block)
        more = round(min((noise / max(size, 1e-300)) ** 2, MOST_SHARE * m))
        if more <= count:
            break
        count = more
    return grid, shape, noise


def swings_of(shape: Array, amplitude: float) -> int:
    """Swings in a period, 2 in a plain cycle: how often the position goes over from one side of its level to the other.

    shape, amplitude: of the waveform [rad].
    """
    sides = np.sign(shape[np.abs(shape) > SIDE * amplitude])
    return int(np.count_nonzero(sides != np.roll(sides, 1)))


def peak_to_peak(folded: Folded, phase: Array, shape: Array, noise: float) -> tuple[float, float]:
    """Top minus bottom of the folded samples.

    phase, shape: (n,) phases 0..1 and the smoothed samples there [rad]; noise: standard deviation of a sample [rad].
    Returns its size [rad], and its error: of noise, and what caps of other depths change.
    """
    size, error = 0.0, 0.0
    for sign in (1, -1):
        top, count = _top(folded, sign, phase, CAP, shape)
        # A parabola fits a cap, not the edge of a saw tooth: then the answer moves with the depth.
        moved = max(abs(top - _top(folded, sign, phase, factor * CAP, shape)[0]) for factor in (0.5, 2))
        size += top
        error += moved**2 + _hidden(folded, sign, top) ** 2
        error += (1.5 * noise) ** 2 / count  # the vertex of a parabola is 1.5 times as uncertain as a mean
    return size, math.sqrt(error)


def _hidden(folded: Folded, sign: int, top: float) -> float:
    """What a peak may rise between samples: half of the step to the next phase that is sampled.

    Samples whose distance divides the period meet the same few phases in all periods.
    """
    bins = np.minimum((folded.phase * GRID).astype(int), GRID - 1)
    count = np.bincount(bins, minlength=GRID)
    held = np.flatnonzero(count)
    mean = sign * np.bincount(bins, folded.values, GRID)[held] / count[held]
    rise = 0.0
    for side in (1, -1):
        away = side * (held - held[np.argmax(mean)]) % GRID
        order = np.argsort(away)
        near, far = away[order][:-1], away[order][1:]
        # A hole counts that is no farther than it is long: the peak may lie in it.
        hole = (far - near > 1) & (near <= far - near)
        rise = max(rise, float(np.max((top - mean[order][1:][hole]) / 2, initial=0.0)))
    return rise


def _median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def _top(folded: Folded, sign: int, phase: Array, depth: float, shape: Array) -> tuple[float, int]:
    """Highest point of a parabola fitted to the cap of a shape (the lowest for sign -1), and its samples."""
    phi, values, weights, shape = folded.phase, sign * folded.values, folded.share, sign * shape
    half = float(np.ptp(shape)) / 2
    peak = int(np.argmax(shape))
    low = shape < shape[peak] - depth * half
    # The cap round the peak, from the nearest low phase on either side; the phase runs round.
    away = np.roll(low[:-1], -peak)
    after, before = int(np.argmax(away)), int(np.argmax(away[::-1])) + 1
    step = 1 / GRID
    u = (phi - phase[peak] + 0.5) % 1 - 0.5
    cap = (u > -before * step) & (u < after * step)
    u, y, weights = u[cap], values[cap], weights[cap]
    if u.size < 6:
        return float(np.max(shape)), max(int(u.size), 1)
    place = np.round(u * GRID).astype(int)
    if np.unique(place).size < FEWEST_PLACES:
        place -= place.min()
        count = np.bincount(place)
        highest = int(np.argmax(np.where(count > 0, np.bincount(place, y) / np.maximum(count, 1), -np.inf)))
        return float(np.mean(y[place == highest])), int(count[highest])
    kept = np.ones(u.size, bool)
    width = max(float(np.max(np.abs(u))), 1e-12)
    c = np.array([_median(y, weights), 0.0, 0.0])  # a plateau, to begin with: that leaves its flanks out at once
    for trim in range(TRIMS):
        if trim:
            c = np.polynomial.polynomial.polyfit(u[kept] / width, y[kept], 2, w=np.sqrt(weights[kept]))
        off = y - np.polynomial.polynomial.polyval(u / width, c)
        size = 1.4826 * _median(np.abs(off - _median(off, weights)), weights)
        now = np.abs(off) <= TRIM * max(size, 1e-12 * half)
        if now.sum() < 6 or trim and (now == kept).all():
            break
        kept = now
    low_end, high_end = (float(e) / width for e in (u[kept].min(), u[kept].max()))
    vertex = float(np.clip(-c[1] / (2 * c[2]), low_end, high_end)) if c[2] < 0 else (low_end + high_end) / 2
    return float(np.polynomial.polynomial.polyval(vertex, c)), int(kept.sum())
