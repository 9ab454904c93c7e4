"""A hunting record: amplitude and frequency of a measured position, averaged over consecutive periods.

Report, section 2 and Figure 4: the servo is left alone at K = 0.04, its position is recorded, and amplitude
(0.061 rad) and frequency (0.122 Hz) are averages over consecutive periods.  A record is no computed orbit:
its mean drifts, it is lopsided and noisy, its samples are not evenly spaced, some are missing.  So

    period     of the whole waveform (period.py), between marks (period_marks.py); no period holds a gap
    coherent   every period resembles the mean of all others, or the record is irregular: noise resembles nothing
    transient  periods at the start that differ from those of the second half are left out, and `left_out` says so
    amplitude  half of top minus bottom of all periods laid over each other (waveform.py)
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
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...checks import number, of_kind
from ...errors import InputError
from ...export import Columns
from ...results import Result
from ...servo.trajectory import Trajectory
from .file import Record, read_record
from .period import FEWEST_PERIODS, Grid, find_period, gridded, in_blocks, off_line, usual_distance
from .period_marks import Marks, level_of, mark, means_between
from .verdict import Kind, Periods, deviation, judge_record, lasting, settled, steps_alone
from .waveform import factors, fold, number_of_equal_parts, peak_to_peak, quantum, shape_of, waves

Array = np.ndarray


MOTION_SAMPLES = 20_001
"""Samples that are taken of a simulated motion."""
MOST, DETAIL = 1_000_000, 1000
"""Samples beyond which neighbours are averaged, if so many remain in a period."""
NO_OSCILLATION = 1e-9
"""Size of an oscillation, relative to the largest |position|, that is rounding."""


@dataclass(frozen=True, eq=False, repr=False)
class Measurement(Result):
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
    record : the samples.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt import Record, measure
    >>> t = np.linspace(0.0, 10.0, 2001)
    >>> found = measure(Record(t, 0.2 + 0.3 * np.sin(2 * np.pi * t)))
    >>> found.kind, round(found.mean_level, 3), round(found.frequency, 3)  # rad, Hz
    ('hunting', 0.2, 1.0)
    """

    _quantities = (
        "kind", "amplitude [rad] +- amplitude_error", "frequency [Hz] +- frequency_error", "period [s] +- period_error",
        "whole_periods = periods.size",
    )  # fmt: skip
    _details = (
        "amplitude_scatter [rad]", "frequency_scatter [Hz]", "period_scatter [s]", "mean_level [rad]", "drift [rad/s]",
        "noise [rad]", "quantum [rad]", "above", "rising", "missing [s]", "amplitudes [rad]",
        "period_lengths = periods [s]",
    )  # fmt: skip

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
    record: Record = field(repr=False)

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

    def _more(self) -> dict[str, Any]:
        before, behind = self.left_out
        return {"reason": self.reason or None, "left_out_before": before, "left_out_behind": behind}

    def _columns(self) -> Columns:
        return {"start_s": self.starts, "period_s": self.periods, "amplitude_rad": self.amplitudes}


def measure(
    what: Record | Trajectory | str | Path, *, start: float | None = None, time_unit: str | None = None,
    position_unit: str | None = None, time_column: str | None = None, position_column: str | None = None,
    skip: int | None = None, torque_column: str | None = None, current_column: str | None = None,
    torque_constant: float | None = None,
) -> Measurement:  # fmt: skip
    """Amplitude and frequency of a record.

    Parameters
    ----------
    what
        a CSV file with times and positions, samples of them, or a simulated motion.
    start
        leave out what comes before this time [s], such as a transient.
    time_unit, position_unit
        of a file: units of the columns, a name or a number of s or rad; None: as the header states, or s and rad.
    time_column, position_column
        of a file: the columns, by their headers or their numbers from 1; None: as their names say.
    skip
        of a file: lines to leave out; None: none but a preamble.
    torque_column, current_column
        of a file: the torque of the motor, or its current instead, in the same way; None: they are not read.
    torque_constant
        of a file: N m in an ampere of the current, or in one of whatever unit the torque has.

    Returns
    -------
    Measurement, whose `record` holds the samples; without an oscillation its numbers are nan, its `reason` says why.

    Raises
    ------
    InputError : too few samples, or fewer than `FEWEST_PERIODS` whole periods of an oscillation; of a file: there is
        none, it is too large, no text, without samples or a column, in an unknown unit, a cell is no finite number, or
        a time does not increase.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt import Record, Servo, measure, simulate
    >>> t = np.linspace(0.0, 10.0, 2001)
    >>> found = measure(Record(t, 0.3 * np.sin(2 * np.pi * t)))
    >>> found.kind, round(found.amplitude, 3), round(found.period, 4)
    ('hunting', 0.3, 1.0)
    >>> found = measure(simulate(Servo(), "switch", 0.04, time=80.0), start=20.0)
    >>> round(found.period, 2), float(found.record.times[0])
    (10.28, 20.0)
    """
    reading = {"time_unit": time_unit, "position_unit": position_unit, "time_column": time_column,
               "position_column": position_column, "skip": skip, "torque_column": torque_column,
               "current_column": current_column, "torque_constant": torque_constant}  # fmt: skip
    record = as_record(what, **{option: asked for option, asked in reading.items() if asked is not None})
    return measured(record if start is None else record.after(number("start", start)))


def as_record(what: Any, **reading: Any) -> Record:
    """Samples: those given, of a file (`read_record` takes `reading`), or of a simulated motion.  Raises InputError."""
    if isinstance(what, str | Path):
        return read_record(what, **reading)
    if reading:
        raise InputError(f"{next(iter(reading))}: must be left out where no file is read")
    if isinstance(what, Trajectory):
        t = np.linspace(0, float(what.times[-1]), MOTION_SAMPLES)
        return Record(t, what.set_point + what.sample(t)[0], "simulation")
    record: Record = of_kind("record", what, Record, "such as Record(times, position), a file or a motion")
    return record


def measured(record: Record) -> Measurement:
    """What `measure` says of samples."""
    t, y = record.times, record.position
    if t.size < 4 * FEWEST_PERIODS:
        raise InputError(f"{record.name}: must hold at least {4 * FEWEST_PERIODS} samples, not {t.size}")
    origin = float(np.mean(y))
    grid = gridded(t, y - origin)
    rounding = NO_OSCILLATION * float(np.max(np.abs(y)))
    if np.ptp(off_line(grid)) <= rounding:
        return _nothing(record, still=True)
    period, _ = find_period(grid, rounding)
    if not math.isfinite(period):
        return _nothing(record, still=not _moves(grid))
    times, values = t, y - origin
    # Means of neighbouring samples, where there are many more than a period needs
    if (block := int(min(t.size / MOST, period / ((t[-1] - t[0]) / t.size) / DETAIL))) > 1:
        times, values = in_blocks(times, block), in_blocks(values, block)
        near = times[:, -1] - times[:, 0] < 4 * block * usual_distance(t)  # not on both sides of a gap
        times, values = times.mean(axis=1)[near], values.mean(axis=1)[near]
    # A jump comes half a distance of samples early or late; two rounded values differ by the squares of two roundings.
    blur = float(np.mean(np.diff(values) ** 2)) / 3 + quantum(y) ** 2 / 6
    found = _into_periods(times, values, grid, period, blur)
    if found is None:
        return _nothing(record, still=not _moves(grid))
    k = found.lengths.size
    period = float(np.mean(found.lengths)) if k else period
    held = t[-1] - t[0] - np.sum(np.diff(found.marks.times)[found.marks.gapped])
    if k < FEWEST_PERIODS and held > (FEWEST_PERIODS + 2) * period:
        return _nothing(record, still=False)
    if k < FEWEST_PERIODS:
        lasts = f"in {t[-1] - t[0]:.4g} s"  # what was not seen twice is no period
        seen = f"holds {k} of about {period:.3g} s {lasts}" if k > 1 else f"{lasts} none was seen twice"
        raise InputError(f"{record.name}: must hold at least {FEWEST_PERIODS} whole periods, but {seen}; record longer")
    kind, reason = judge_record(found)
    if kind in ("hunting", "irregular"):
        found = _divided(times, values, settled(found, blur))
        kind, reason = judge_record(found)
    if kind == "hunting":
        kind, reason = lasting(t, found)
    if kind == "hunting":
        kind, reason = steps_alone(times, found, quantum(y))
    return _averages(record, times, values, found, kind, reason, origin)


def _into_periods(times: Array, values: Array, grid: Grid, period: float, blur: float) -> Periods | None:
    """The record divided by its period, or by a part of that if several were taken for one."""
    while True:
        marks = mark(times, values, grid, period)
        if marks is None:
            return None
        found = _divided(times, values, marks)
        if found.lengths.size and np.ptp(found.waves.mean(axis=0)) <= NO_OSCILLATION * np.ptp(values):
            return None  # two samples in a period: nothing is left of them in a mean wave
        parts = number_of_equal_parts(found.waves, blur)
        if parts == 1:
            return found
        period /= parts


def _divided(times: Array, values: Array, marks: Marks) -> Periods:
    lengths = np.diff(marks.times)[marks.whole]
    if not lengths.size:
        return Periods(marks, np.zeros((0, 1)), lengths, lengths)
    wave = waves(times, values - marks.level, marks.times, marks.whole)
    sizes = factors(wave, wave.mean(axis=0))
    return Periods(marks, wave, lengths, sizes)


def _averages(
    record: Record, times: Array, values: Array, found: Periods, kind: Kind, reason: str, origin: float
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
    means = means_between(times, values, marks.times)[marks.whole]
    # Steps hide how slow a passage is; a drift of the level shifts them against the waveform, by half a step at most.
    shift = min(step / 2, float(np.ptp(np.interp(edges, times, marks.level))))
    resolution = float(np.median(marks.resolution)) + step / 2 * marks.slowness
    resolution += shift * float(np.mean(periods)) / (2 * size)
    dither = math.exp(-2 * (math.pi / step) ** 2 * max(noise**2 - step**2 / 6, 0.0)) if step else 0.0
    return Measurement(
        kind=kind,
        reason=reason,
        amplitude=size / 2,
        amplitude_scatter=deviation(amplitudes),
        amplitude_error=math.hypot(_error(amplitudes), peak_error / 2, step / 2 * dither),
        period=float(np.mean(periods)),
        period_scatter=deviation(periods),
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
        record=record,
    )


def _error(values: Array) -> float:
    """Of the mean: its standard deviation, and what the mean of the second half changes."""
    k = values.size
    return math.hypot(deviation(values) / math.sqrt(k), float(np.mean(values) - np.mean(values[k // 2 :])))


def _moves(grid: Grid) -> bool:
    """It moves to and fro, more often than a drift does."""
    r = grid.values - level_of(grid, float(grid.times[-1] - grid.times[0]) / FEWEST_PERIODS)
    side = np.sign(r[np.abs(r) > np.ptp(r) / 4])
    return bool(np.count_nonzero(np.diff(side)) > 2 * FEWEST_PERIODS)


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
        record,
    )  # fmt: skip
