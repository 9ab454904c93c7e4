"""Is a record that is divided into periods one of a limit cycle?

    coherent   every period resembles the mean of all others; noise resembles nothing
    settled    periods at the start, up to the last one that differs from those of the second half, are a transient
    steady     neither amplitudes nor periods change steadily, in the whole and in the second half
    lasting    it does not end before the record does
    more       than the steps of rounded positions in a slow motion, of which each period is one
    no chance  noise, of which the search has looked at many lags, has so alike periods once in `CHANCE` records at most

Chance.  Passages of narrow noise through a threshold follow each other at any distance that the marks allow, evenly
spread over T (1 +- REACH), standard deviation REACH/sqrt(3); its amplitudes have Rayleigh's distribution, standard
deviation sqrt(4/pi - 1) of their mean.  That k of them scatter by s or less has the probability
p = P(chi2_{k-1} <= (k - 1) s^2/sigma^2); that the product x = p_1 p_2 of two such is as small, x (1 - ln x) (Fisher).
Times the number of trials (Bonferroni): lags, of which a record of k periods, each of n independent values, has
LONGEST k n, differences of moving averages, and parts of the record.  n = 2 (sum P_h)^2 / sum P_h^2, with the power P_h
of the harmonics of the mean wave: 2 of a sine.

Symbols: k periods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from .period import FEWEST_PERIODS, LONGEST, PARTS, SCALES
from .period_marks import REACH, Marks
from .waveform import factors

Array = np.ndarray
Kind = Literal["hunting", "decaying", "growing", "irregular", "still"]

COHERENCE, FEW_COHERENCE, MANY_PERIODS = 0.75, 0.9, 12
"""Mean correlation of a period with the others where a record oscillates, if there are so many; of `FEWEST_PERIODS`."""
LEAST_COHERENCE = 0.4
"""The same of each single period."""
COVERED = 0.7
"""Part of the time between the first and the last mark, without gaps, that whole periods must take."""
UNEVEN, IRREGULAR = 0.12, 0.3
"""Scatter of the periods and of the amplitudes, relative to their mean, from which on nothing repeats."""
STEADY = 0.05
"""Change of the fitted amplitude over the record up to which it counts as steady."""
SURE = 5.0
"""Standard errors that a trend of the amplitudes, or a difference of the first periods, must have to count."""
DIFFERENT = 0.01
"""Difference of a period from the later ones, relative, below which it is no transient."""
CHANCE = 1e-3
"""Share of records of noise that may be called hunting."""
NARROW_SIZES, NARROW_LENGTHS = math.sqrt(4 / math.pi - 1), REACH / math.sqrt(3)
"""Standard deviations, relative to their means, of the amplitudes and of the periods of narrow noise."""
LIKE_ONE_STEP = 1.5
"""Steps of rounded positions that one of them may look like, from top to bottom."""
LASTING = 2.5
"""Periods at the end of the record without a whole one, from which on the oscillation is over."""


@dataclass(frozen=True, eq=False)
class Periods:
    """The record divided: marks, the wave of each period, its length and its size relative to the mean."""

    marks: Marks
    waves: Array
    lengths: Array
    sizes: Array


def deviation(values: Array) -> float:
    """Standard deviation; 0 of a single value."""
    return float(np.std(values, ddof=1)) if values.size > 1 else 0.0


def settled(found: Periods, blur: float) -> Marks:
    """Leave out the periods of a transient: those up to the last one that differs from those of the second half.

    blur: variance that sampling and rounding make [rad2].
    Returns the marks, in which the periods at the start are not whole.
    """
    marks, k = found.marks, found.lengths.size
    half = max(FEWEST_PERIODS, (k + 1) // 2)
    later = slice(k - half, k)
    mean = found.waves[later].mean(axis=0)
    size = factors(found.waves, mean)
    power = float(mean @ mean)
    if power == 0:  # two values, whose waves cancel: nothing repeats in the second half
        return marks
    odd = np.sqrt(np.sum((found.waves - size[:, None] * mean) ** 2, axis=1) / power)
    resolution = float(np.median(marks.resolution)) / float(np.mean(found.lengths))
    away = np.zeros(k, bool)
    for values, least in ((size, 0.0), (found.lengths / np.mean(found.lengths[later]), 3 * resolution)):
        centre, scatter = float(np.mean(values[later])), deviation(values[later])
        away |= np.abs(values - centre) > max(SURE * scatter, DIFFERENT, least)
    blurred = math.sqrt(3 * blur * mean.size / power)
    away |= odd > max(3 * float(np.max(odd[later])), 5 * DIFFERENT, blurred)
    first = int(np.max(np.flatnonzero(away[: k - half]), initial=-1)) + 1
    whole = marks.whole.copy()
    whole[np.flatnonzero(whole)[:first]] = False
    return replace(marks, whole=whole)


def judge_record(found: Periods) -> tuple[Kind, str]:
    """Is it a limit cycle?"""
    # (k,) correlation of each period's wave with the mean of all others
    wave = found.waves
    others = wave.sum(axis=0) - wave
    size = np.linalg.norm(wave, axis=1) * np.linalg.norm(others, axis=1)
    alike = np.asarray(np.sum(wave * others, axis=1) / np.maximum(size, 1e-300))
    wanted = float(np.interp(alike.size, (FEWEST_PERIODS, MANY_PERIODS), (FEW_COHERENCE, COHERENCE)))
    if float(np.mean(alike)) < wanted or float(np.min(alike)) < LEAST_COHERENCE:
        least, mean = float(np.min(alike)), float(np.mean(alike))
        return "irregular", f"no shape repeats: periods correlate by {mean:.2f} with the others, one by {least:.2f}"
    marks, periods, amplitudes = found.marks, found.lengths, found.sizes
    at = np.flatnonzero(marks.whole)
    between = np.diff(marks.times)[at[0] : at[-1] + 1]
    covered = float(np.sum(periods) / np.sum(between[~marks.gapped[at[0] : at[-1] + 1]]))
    if covered < COVERED:
        return "irregular", f"only {covered:.0%} of the time divides into periods of about {np.mean(periods):.3g} s"
    scatter = deviation(periods) / float(np.mean(periods))
    if scatter > UNEVEN:
        return "irregular", f"the periods scatter by {scatter:.0%} of their mean"
    if (amplitudes <= 0).any():
        return "irregular", "not every period has the same shape"
    slope = _trend(amplitudes)
    if slope:
        return _changing(amplitudes, slope)
    if _trend(periods):
        return "irregular", f"the periods change steadily, from {periods[0]:.4g} to {periods[-1]:.4g} s"
    scatter = deviation(amplitudes) / float(np.mean(amplitudes))
    if scatter > IRREGULAR and deviation(amplitudes[amplitudes.size // 2 :]) > IRREGULAR * float(np.mean(amplitudes)):
        return "irregular", f"the amplitudes scatter by {scatter:.0%} of their mean"
    expected = by_chance(found)
    if expected > CHANCE:
        often = f"in one of {1 / expected:.0f} such records" if expected < 0.5 else "in most such records"
        by_noise = f"periods of mere noise are as alike as these {periods.size} {often}, by chance"
        return "irregular", f"it may be noise: {by_noise}; record more periods"
    return "hunting", ""


def by_chance(found: Periods) -> float:
    """Expected number of places in a record of noise, as long as this one, where periods are as alike as these."""
    k, mean = found.lengths.size, found.waves.mean(axis=0)
    harmonics = np.abs(np.fft.rfft(mean)[1:])
    power = (harmonics / max(float(np.max(harmonics)), 1e-300)) ** 2
    values = 2 * float(np.sum(power)) ** 2 / max(float(np.sum(power**2)), 1e-300)
    x = 1.0
    for measured, sigma in ((found.sizes, NARROW_SIZES), (found.lengths, NARROW_LENGTHS)):
        scatter = deviation(measured) / float(np.mean(measured))
        x *= chi_square(k - 1, (k - 1) * (scatter / sigma) ** 2)
    lags = LONGEST * found.marks.whole.size * values
    return lags * (1 + len(SCALES)) * (1 + len(PARTS)) * (x * (1 - math.log(x)) if x > 0 else 0.0)


def chi_square(m: int, x: float) -> float:
    """Distribution function of chi-square with m degrees of freedom: the series of the incomplete gamma function.

    x: value >= 0. Returns probability of a value up to x.
    """
    a, z = m / 2, x / 2
    if z > a + 40 * math.sqrt(a):
        return 1.0
    term = total = 1.0
    n = 0
    while term > 1e-17 * total:
        n += 1
        term *= z / (a + n)
        total += term
    return min(1.0, total * math.exp(a * math.log(z) - z - math.lgamma(a + 1))) if z > 0 else 0.0


def lasting(t: Array, found: Periods) -> tuple[Kind, str]:
    """Whether the oscillation goes on to the end of the record.

    t: (m,) times of the samples [s]. Returns "hunting" and ""; or "irregular" and where it ends.
    """
    period, last = float(np.mean(found.lengths)), float(found.marks.times[-1])
    behind = np.diff(t, prepend=last)[t > last]
    rest = float(np.sum(behind[behind < period / 2]))  # without gaps
    if rest < LASTING * period:
        return "hunting", ""
    return "irregular", f"the oscillation ends at about {last:.4g} s: the last {rest:.4g} s hold no whole period"


def steps_alone(t: Array, found: Periods, step: float) -> tuple[Kind, str]:
    """Whether each period is but the next step of rounded positions, along a slow motion.

    t: (m,) times of the samples [s]; step: of the positions [rad]. Returns "hunting" and ""; or "irregular" and why.
    """
    k = found.lengths.size
    divided = (t >= found.marks.times[0]) & (t <= found.marks.times[-1])
    goes = float(np.ptp(found.marks.level[divided]))
    if float(np.ptp(found.waves.mean(axis=0))) > LIKE_ONE_STEP * step or goes < k * step / 2:
        return "hunting", ""
    return "irregular", f"what repeats are steps of {step:.3g} rad, {goes / step:.0f} of them along a slow motion"


def _trend(values: Array) -> float:
    """Slope of the logarithm per period of values that change steadily; 0 if they do not."""
    k = np.arange(values.size)
    slope = 0.0
    # A trend must hold in the second half too: a transient at the start is over by then.
    for part in (k, k[k.size // 2 :]) if k.size >= 2 * FEWEST_PERIODS else (k,):
        y = np.log(values[part])
        slope, intercept = (float(c) for c in np.polyfit(part, y, 1))
        rest = float(np.sum((y - intercept - slope * part) ** 2)) / max(part.size - 2, 1)
        error = math.sqrt(rest / float(np.sum((part - part.mean()) ** 2)))
        change = math.expm1(abs(slope) * (part.size - 1))
        if change < STEADY * (part.size - 1) / (k.size - 1) or abs(slope) < SURE * error:
            return 0.0
    return slope


def _changing(amplitudes: Array, slope: float) -> tuple[Kind, str]:
    """What a steady change of the amplitudes means."""
    k = amplitudes.size
    first, middle, last = amplitudes[[0, k // 2, -1]]
    settling = k >= 2 * FEWEST_PERIODS and abs(last - middle) < abs(middle - first) / 2 and last > STEADY * first
    hint = ", and ever less: it may be settling on a cycle (leave out more of its start: --from)" if settling else ""
    return "decaying" if slope < 0 else "growing", (
        f"the amplitude changes steadily, by the factor {math.exp(slope):.4g} each period, in all from 1 to "
        f"{last / first:.4g}{hint}"
    )
