"""A hunting record: amplitude and frequency of a measured position, averaged over consecutive periods.

Report, section 2 and Figure 4: the servo is left alone at K = 0.04, its position is recorded, and amplitude
(0.061 rad) and frequency (0.122 Hz) are averages over consecutive periods.  A record is no computed orbit:
its mean drifts, it is lopsided and noisy, its samples are not evenly spaced, some are missing.  So

    period     of the whole waveform (record_period.py), between marks (record_marks.py); no period holds a gap
    coherent   every period resembles the mean of all others, or the record is irregular: noise resembles nothing
    transient  periods at the start that differ from those of the second half are left out, and `left_out` says so
    amplitude  half of top minus bottom of all periods laid over each other (record_shape.py)
    in one     the factor that fits the mean wave to a period gives its own amplitude
    period

and the errors of the averages, as standard deviations unless a bound is all that is known:

    period     scatter / sqrt(k), the resolution r of the two marks at the ends of each unbroken row of periods,
               sqrt(2 rows) r / k, and the difference between the mean of all periods and that of the second half
    amplitude  the same two of the periods' amplitudes, the error of the peaks, and half a quantum if the positions are
               rounded, less by what noise sigma dithers away: exp(-2 (pi sigma / quantum)^2)

Symbols: m samples, k periods.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from .checks import number
from .errors import InputError
from .record_file import Record
from .record_marks import Marks, level_of, mark, means_between
from .record_period import FEWEST, Grid, find_period, gridded, off_line, usual_distance
from .record_shape import coherence, equal_parts, factors, fold, peak_to_peak, quantum, shape_of, waves
from .trajectory import Trajectory

Array = np.ndarray
Kind = Literal["hunting", "decaying", "growing", "irregular", "still"]

SAMPLES = 20_001
"""Samples that are taken of a simulated motion."""
MOST, DETAIL = 1_000_000, 1000
"""Samples beyond which neighbours are averaged, if so many remain in a period."""
COHERENCE, FEW_COHERENCE, MANY = 0.75, 0.9, 12
"""Mean correlation of a period with the others in a record that oscillates, if there are so many; of `FEWEST`."""
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
LASTING = 2.5
"""Periods at the end of the record without a whole one, from which on the oscillation is over."""
NOTHING = 1e-9
"""Size of an oscillation, relative to the largest |position|, that is rounding."""


@dataclass(frozen=True, eq=False)
class Measurement:
    """What a record shows; nan where there is nothing to average.

    Attributes
    ----------
    kind : "hunting", "decaying", "growing", "irregular" or "still" (no oscillation).
    reason : why it is no limit cycle; "" for "hunting".
    amplitude, amplitude_scatter, amplitude_error : mean and standard deviation over the periods of half the
        peak-to-peak position, and error estimate of the mean [rad].
    period, period_scatter, period_error : mean and standard deviation of the periods, error estimate of the mean [s].
    frequency, frequency_scatter, frequency_error : 1/period, its scatter and error [Hz].
    mean_level : mean position over whole periods [rad].
    drift : slope of the level over the record [rad/s].
    noise : standard deviation of the samples about the shape [rad].
    quantum : distance of the values of a rounded position [rad]; 0 where it is not rounded.
    above : part of a period that the position is above its level; 1/2 in a symmetric cycle.
    rising : the crossings are upward ones.
    left_out : (before, behind) time at either end of the record that holds no period that counts [s].
    missing : time between the crossings that whole periods do not cover, such as gaps [s].
    crossings : (n,) times of the marks that divide the record [s].
    whole : (n - 1,) from a mark to the next it is a whole period without a gap.
    amplitudes, periods : (k,) one by one.
    level : (m,) level at the samples [rad].
    phase, shape : (GRID + 1,) phase 0..1 from a crossing, and position - level there [rad].
    """

    kind: Kind
    reason: str
    amplitude: float
    amplitude_scatter: float
    amplitude_error: float
    period: float
    period_scatter: float
    period_error: float
    mean_level: float
    drift: float
    noise: float
    quantum: float
    above: float
    rising: bool
    left_out: tuple[float, float]
    missing: float
    crossings: Array = field(repr=False)
    whole: Array = field(repr=False)
    amplitudes: Array = field(repr=False)
    periods: Array = field(repr=False)
    level: Array = field(repr=False)
    phase: Array = field(repr=False)
    shape: Array = field(repr=False)

    @property
    def frequency(self) -> float:
        """1/period [Hz]."""
        return 1 / self.period

    @property
    def frequency_scatter(self) -> float:
        """Standard deviation of the frequencies of the periods, to first order [Hz]."""
        return self.period_scatter / self.period**2

    @property
    def frequency_error(self) -> float:
        """Error estimate of the frequency, to first order [Hz]."""
        return self.period_error / self.period**2

    @property
    def starts(self) -> Array:
        """(k,) where each whole period begins [s]."""
        return self.crossings[:-1][self.whole]

    @property
    def hunting(self) -> bool:
        """The record shows a limit cycle."""
        return self.kind == "hunting"


@dataclass(frozen=True, eq=False)
class _Periods:
    """The record divided: marks, the wave of each period, its length and its size relative to the mean."""

    marks: Marks
    waves: Array
    lengths: Array
    sizes: Array


def record_of(trajectory: Trajectory) -> Record:
    """The position theta of a simulated motion as a record."""
    t = np.linspace(0, float(trajectory.times[-1]), SAMPLES)
    return Record(t, trajectory.set_point + trajectory.sample(t)[0], "simulation")


def measure(record: Record, *, start: float | None = None) -> Measurement:
    """Amplitude and frequency of a record.

    Parameters
    ----------
    record
        the samples.
    start
        leave out what comes before this time [s], such as a transient.

    Raises
    ------
    InputError : too few samples, or fewer than `FEWEST` whole periods of an oscillation.
    """
    if start is not None:
        record = record.after(number("start", start))
    t, y = record.times, record.position
    if t.size < 4 * FEWEST:
        raise InputError(f"{record.name}: must hold at least {4 * FEWEST} samples, not {t.size}")
    origin = float(np.mean(y))
    grid = gridded(t, y - origin)
    if np.ptp(off_line(grid)) <= NOTHING * float(np.max(np.abs(y))):
        return _nothing(record, still=True)
    period, _ = find_period(grid)
    if not math.isfinite(period):
        return _nothing(record, still=not _moves(grid))
    times, values = _thinned(t, y - origin, period)
    # A jump comes half a distance of samples early or late; two rounded values differ by the squares of two roundings.
    blur = float(np.mean(np.diff(values) ** 2)) / 3 + quantum(y) ** 2 / 6
    found = _into_periods(times, values, grid, period, blur)
    if found is None:
        return _nothing(record, still=not _moves(grid))
    k = found.lengths.size
    period = float(np.mean(found.lengths)) if k else period
    kind, reason = _judge(found) if k > 1 else ("hunting", "")
    held = t[-1] - t[0] - np.sum(np.diff(found.marks.times)[found.marks.gapped])
    if k < FEWEST and held > (FEWEST + 2) * period:
        return _nothing(record, still=False)
    if k < FEWEST:
        raise InputError(
            f"{record.name}: must hold at least {FEWEST} whole periods, but holds {k} of about "
            f"{period:.3g} s in {t[-1] - t[0]:.4g} s"
        )
    if kind in ("hunting", "irregular"):
        found = _divided(times, values, _settled(found, blur))
        kind, reason = _judge(found)
    if kind == "hunting":
        kind, reason = _lasting(t, found)
    return _averages(record, times, values, found, kind, reason, origin)


def _thinned(t: Array, y: Array, period: float) -> tuple[Array, Array]:
    """Means of neighbouring samples, where there are many more than a period needs."""
    block = int(min(t.size / MOST, period / ((t[-1] - t[0]) / t.size) / DETAIL))
    if block < 2:
        return t, y
    n = t.size // block
    times, values = (v[: n * block].reshape(n, block).mean(axis=1) for v in (t, y))
    ends = t[: n * block].reshape(n, block)[:, [0, -1]]
    near = np.diff(ends, axis=1)[:, 0] < 4 * block * usual_distance(t)  # not on both sides of a gap
    return times[near], values[near]


def _into_periods(times: Array, values: Array, grid: Grid, period: float, blur: float) -> _Periods | None:
    """The record divided by its period, or by a part of that if several were taken for one."""
    while True:
        marks = mark(times, values, grid, period)
        if marks is None:
            return None
        found = _divided(times, values, marks)
        if found.lengths.size and np.ptp(found.waves.mean(axis=0)) <= NOTHING * np.ptp(values):
            return None  # two samples in a period: nothing is left of them in a mean wave
        parts = equal_parts(found.waves, blur)
        if parts == 1:
            return found
        period /= parts


def _divided(times: Array, values: Array, marks: Marks) -> _Periods:
    lengths = np.diff(marks.times)[marks.whole]
    if not lengths.size:
        return _Periods(marks, np.zeros((0, 1)), lengths, lengths)
    wave = waves(times, values - marks.level, marks.times, marks.whole)
    sizes = factors(wave, wave.mean(axis=0))
    return _Periods(marks, wave, lengths, sizes)


def _settled(found: _Periods, blur: float) -> Marks:
    """The marks without the periods at the start, up to the last one that differs from those of the second half."""
    marks, k = found.marks, found.lengths.size
    half = max(FEWEST, (k + 1) // 2)
    later = slice(k - half, k)
    mean = found.waves[later].mean(axis=0)
    size = factors(found.waves, mean)
    power = float(mean @ mean)
    odd = np.sqrt(np.sum((found.waves - size[:, None] * mean) ** 2, axis=1) / power)
    resolution = float(np.median(marks.resolution)) / float(np.mean(found.lengths))
    away = np.zeros(k, bool)
    for values, least in ((size, 0.0), (found.lengths / np.mean(found.lengths[later]), 3 * resolution)):
        centre, scatter = float(np.mean(values[later])), _scatter(values[later])
        away |= np.abs(values - centre) > max(SURE * scatter, DIFFERENT, least)
    blurred = math.sqrt(3 * blur * mean.size / power)
    away |= odd > max(3 * float(np.max(odd[later])), 5 * DIFFERENT, blurred)
    first = int(np.max(np.flatnonzero(away[: k - half]), initial=-1)) + 1
    whole = marks.whole.copy()
    whole[np.flatnonzero(whole)[:first]] = False
    return replace(marks, whole=whole)


def _averages(
    record: Record, times: Array, values: Array, found: _Periods, kind: Kind, reason: str, origin: float
) -> Measurement:
    marks, periods = found.marks, found.lengths
    k = periods.size
    at = np.flatnonzero(marks.whole)
    edges, whole = marks.times[at[0] : at[-1] + 2], marks.whole[at[0] : at[-1] + 1]
    folded = fold(times, values - marks.level, marks.times, marks.whole)
    phase, shape, noise = shape_of(folded)
    size, peak_error = peak_to_peak(folded, phase, shape, noise)
    amplitudes = size / 2 * found.sizes / float(np.mean(found.sizes))
    step = quantum(record.position)
    rows = 1 + int(np.count_nonzero(~whole))
    level = np.interp(record.times, times, marks.level)
    inside = (times >= edges[0]) & (times <= edges[-1])
    drift = float(np.polyfit(times[inside] - edges[0], marks.level[inside], 1)[0])
    _, means = means_between(times, values, marks.times, marks.whole)
    resolution = float(np.median(marks.resolution)) + step / 2 * marks.slowness
    dither = math.exp(-2 * (math.pi / step) ** 2 * max(noise**2 - step**2 / 6, 0.0)) if step else 0.0
    return Measurement(
        kind=kind,
        reason=reason,
        amplitude=size / 2,
        amplitude_scatter=_scatter(amplitudes),
        amplitude_error=math.hypot(_error(amplitudes), peak_error / 2, step / 2 * dither),
        period=float(np.mean(periods)),
        period_scatter=_scatter(periods),
        period_error=math.hypot(_error(periods), math.sqrt(2 * rows) * resolution / k),
        mean_level=origin + float(np.mean(means)),
        drift=drift,
        noise=noise,
        quantum=step,
        above=float(np.mean(shape[:-1] > 0)),
        rising=marks.rising,
        left_out=(float(edges[0] - record.times[0]), float(record.times[-1] - edges[-1])),
        missing=float(edges[-1] - edges[0] - np.sum(periods)),
        crossings=edges,
        whole=whole,
        amplitudes=amplitudes,
        periods=periods,
        level=origin + level,
        phase=phase,
        shape=shape,
    )


def _scatter(values: Array) -> float:
    return float(np.std(values, ddof=1)) if values.size > 1 else 0.0


def _error(values: Array) -> float:
    """Of the mean: its standard deviation, and what the mean of the second half changes."""
    k = values.size
    return math.hypot(_scatter(values) / math.sqrt(k), float(np.mean(values) - np.mean(values[k // 2 :])))


def _moves(grid: Grid) -> bool:
    """It moves to and fro, more often than a drift does."""
    r = grid.values - level_of(grid, float(grid.times[-1] - grid.times[0]) / FEWEST)
    side = np.sign(r[np.abs(r) > np.ptp(r) / 4])
    return bool(np.count_nonzero(np.diff(side)) > 2 * FEWEST)


def _nothing(record: Record, *, still: bool) -> Measurement:
    """No period: it stands still or drifts, or it moves without repeating."""
    nan, none, t = float("nan"), np.zeros(0), record.times
    level = np.full(t.size, float(np.mean(record.position)))
    drift = float((record.position[-1] - record.position[0]) / (t[-1] - t[0]))
    reason = (
        "the position does not oscillate about a slowly drifting mean (if a transient hides it, leave it out: --from)"
        if still
        else "no shape repeats: the position moves to and fro, but no period of it resembles the next"
    )
    return Measurement(
        "still" if still else "irregular",
        reason,
        nan, nan, nan, nan, nan, nan, float(np.mean(level)), drift, nan, quantum(record.position), nan, True,
        (0.0, 0.0), 0.0, none, none.astype(bool), none, none, level, none, none,
    )  # fmt: skip


def _judge(found: _Periods) -> tuple[Kind, str]:
    """Is it a limit cycle?"""
    alike = coherence(found.waves)
    wanted = float(np.interp(alike.size, (FEWEST, MANY), (FEW_COHERENCE, COHERENCE)))
    if float(np.mean(alike)) < wanted or float(np.min(alike)) < LEAST_COHERENCE:
        least, mean = float(np.min(alike)), float(np.mean(alike))
        return "irregular", f"no shape repeats: periods correlate by {mean:.2f} with the others, one by {least:.2f}"
    marks, periods, amplitudes = found.marks, found.lengths, found.sizes
    at = np.flatnonzero(marks.whole)
    between = np.diff(marks.times)[at[0] : at[-1] + 1]
    covered = float(np.sum(periods) / np.sum(between[~marks.gapped[at[0] : at[-1] + 1]]))
    if covered < COVERED:
        return "irregular", f"only {covered:.0%} of the time divides into periods of about {np.mean(periods):.3g} s"
    scatter = _scatter(periods) / float(np.mean(periods))
    if scatter > UNEVEN:
        return "irregular", f"the periods scatter by {scatter:.0%} of their mean"
    if (amplitudes <= 0).any():
        return "irregular", "not every period has the same shape"
    if amplitudes.size < FEWEST:
        return "hunting", ""
    slope = _trend(amplitudes)
    if slope:
        return _changing(amplitudes, slope)
    if _trend(periods):
        return "irregular", f"the periods change steadily, from {periods[0]:.4g} to {periods[-1]:.4g} s"
    scatter = _scatter(amplitudes) / float(np.mean(amplitudes))
    if scatter > IRREGULAR and _scatter(amplitudes[amplitudes.size // 2 :]) > IRREGULAR * float(np.mean(amplitudes)):
        return "irregular", f"the amplitudes scatter by {scatter:.0%} of their mean"
    return "hunting", ""


def _lasting(t: Array, found: _Periods) -> tuple[Kind, str]:
    """Hunting, unless it ends before the record does."""
    period, last = float(np.mean(found.lengths)), float(found.marks.times[1:][found.marks.whole][-1])
    behind = np.diff(t, prepend=last)[t > last]
    rest = float(np.sum(behind[behind < period / 2]))  # without gaps
    if rest < LASTING * period:
        return "hunting", ""
    return "irregular", f"the oscillation ends at about {last:.4g} s: the last {rest:.4g} s hold no whole period"


def _trend(values: Array) -> float:
    """Slope of the logarithm per period of values that change steadily; 0 if they do not."""
    k = np.arange(values.size)
    slope = 0.0
    # A trend must hold in the second half too: a transient at the start is over by then.
    for part in (k, k[k.size // 2 :]) if k.size >= 2 * FEWEST else (k,):
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
    settling = k >= 2 * FEWEST and abs(last - middle) < abs(middle - first) / 2 and last > STEADY * first
    hint = ", and ever less: it may be settling on a cycle (leave out more of its start: --from)" if settling else ""
    return "decaying" if slope < 0 else "growing", (
        f"the amplitude changes steadily, by the factor {math.exp(slope):.4g} each period, in all from 1 to "
        f"{last / first:.4g}{hint}"
    )
