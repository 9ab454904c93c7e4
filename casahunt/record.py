"""A hunting record: amplitude and frequency of a measured position, averaged over consecutive periods.

Report, section 2 and Figure 4: the servo is left alone at K = 0.04, its position is recorded, and amplitude
(0.061 rad) and frequency (0.122 Hz) are averages over consecutive periods.  A record is no computed orbit:
its mean drifts, it is lopsided and noisy, its samples are not evenly spaced.  So

    level      the mean of the position over each period, between the periods a straight line
    crossing   where position - level leaves the band +-HYSTERESIS of its size on the other side; the time is
               that of the zero of a line fitted through the samples in the band
    period     from one upward crossing to the next (downward, if these are more); frequency is the number of
               periods over their total time
    shape      all periods folded onto the phase 0..1 and smoothed
    peaks      parabolas fitted to all folded samples near the top and near the bottom of the shape: a plateau where
               the servo sticks, a cap elsewhere; amplitude = half of their difference
    in one     the factor that fits the shape to the samples of a period gives its own amplitude
    period

So noise is averaged away before peaks are taken, which the largest sample of each period would not do.

Symbols: m samples, k periods.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

import numpy as np

from .checks import number
from .errors import InputError
from .trajectory import Trajectory

Array = np.ndarray
Kind = Literal["hunting", "decaying", "growing", "irregular", "still"]

HYSTERESIS = 0.3
"""Half width of the band round the level that a crossing must leave, in units of the size of the oscillation."""
FEWEST = 3
"""Periods that averages need."""
BLOCKS, EVEN = 100, 20
"""Blocks of equal time that the first guess of the trend is drawn through, and values in each."""
RANGE = (3, 97)
"""Percentiles that bound the oscillation."""
SAMPLES = 20_001
"""Samples that are taken of a simulated motion."""
PASSES = 6
"""Passes over level and crossings, each with the level of the one before."""
GRID = 400
"""Phases at which the shape is known."""
NEIGHBOURS, SHARE, MOST_SHARE = 9, 0.02, 0.12
"""Samples that a point of the shape is fitted to: at least so many, as a rule this part of all, and at most that."""
NOISE_SHARE = 0.01
"""Error of a point of the shape, in units of the amplitude, above which more samples are used."""
CAP = 0.05
"""Depth of the caps that peaks are fitted to, in units of the amplitude."""
TRIM, TRIMS = 3.0, 4
"""Samples so many noises off a cap are left out of it, in so many rounds: the flanks beside a plateau."""
COHERENCE = 0.5
"""Part of the variance that the shape must explain in a record that oscillates."""
IRREGULAR = 0.3
"""Scatter of the periods, relative to their mean, from which on nothing repeats."""
STEADY = 0.05
"""Change of the fitted amplitude over the record up to which it counts as steady."""
SURE = 5.0
"""Standard errors that a trend of the amplitudes must have to count."""
NOTHING = 1e-9
"""Size of an oscillation, relative to the largest |position|, that is rounding."""

_TIME, _POSITION = ("time", "t"), ("position", "theta", "angle")


@dataclass(frozen=True, eq=False)
class Record:
    """A position measured at increasing times.

    Attributes
    ----------
    times : (m,) [s].
    position : (m,) [rad].
    name : where it comes from.
    """

    times: Array
    position: Array
    name: str = "record"

    def __post_init__(self) -> None:
        t, y = self.times, self.position
        if t.ndim != 1 or t.shape != y.shape:
            raise InputError(f"{self.name}: times and positions must be equally many, not {t.shape} and {y.shape}")
        if not (np.isfinite(t).all() and np.isfinite(y).all()):
            raise InputError(f"{self.name}: times and positions must be finite numbers, not NaN or infinity")
        back = np.flatnonzero(np.diff(t) <= 0)
        if back.size:
            i = int(back[0])
            raise InputError(
                f"{self.name}: time must increase from sample to sample, but {t[i + 1]:.10g} s follows {t[i]:.10g} s"
            )

    def after(self, start: float) -> Record:
        """The part from the time `start` [s] on."""
        kept = self.times >= start
        return Record(self.times[kept], self.position[kept], self.name)


@dataclass(frozen=True, eq=False)
class Measurement:
    """What a record shows; nan where there is nothing to average.

    Attributes
    ----------
    kind : "hunting", "decaying", "growing", "irregular" or "still" (no oscillation).
    reason : why it is no limit cycle; "" for "hunting".
    amplitude, amplitude_scatter : mean and standard deviation over the periods of half the peak-to-peak position [rad].
    period, period_scatter : mean and standard deviation of the periods [s].
    frequency, frequency_scatter : 1/period and its scatter [Hz].
    mean_level : mean position over whole periods [rad].
    drift : slope of the level over the record [rad/s].
    noise : standard deviation of the samples about the shape [rad].
    above : part of a period that the position is above its level; 1/2 in a symmetric cycle.
    rising : the crossings are upward ones.
    crossings : (k + 1,) times of the crossings that divide the periods [s].
    amplitudes, periods : (k,) one by one.
    level : (m,) level at the samples [rad].
    phase, shape : (GRID + 1,) phase 0..1 from a crossing, and position - level there [rad].
    """

    kind: Kind
    reason: str
    amplitude: float
    amplitude_scatter: float
    period: float
    period_scatter: float
    mean_level: float
    drift: float
    noise: float
    above: float
    rising: bool
    crossings: Array = field(repr=False)
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
    def hunting(self) -> bool:
        """The record shows a limit cycle."""
        return self.kind == "hunting"


def read_record(path: str | Path) -> Record:
    """Read a CSV file with times [s] and positions [rad].

    Commas, semicolons, tabs or blanks separate the columns; lines that begin with # are comments.  With a header,
    the columns named time (or t) and position (or theta, or angle) are taken, a unit after the name is ignored;
    otherwise the first two.

    Raises
    ------
    InputError : no such file, not text, no samples, a missing column, a cell that is no finite number, a time that
        does not increase.
    """
    path = Path(path)
    name = f"record {str(path)!r}"
    try:
        lines = path.read_text(encoding="utf-8-sig").splitlines()
    except FileNotFoundError:
        raise InputError(f"{name}: no such file") from None
    except UnicodeDecodeError:
        raise InputError(f"{name}: must be text (UTF-8)") from None
    except OSError as error:
        raise InputError(f"{name}: cannot be read: {error.strerror}") from None
    numbered = [(i, line) for i, line in enumerate(lines, 1) if line.strip() and not line.lstrip().startswith("#")]
    if not numbered:
        raise InputError(f"{name}: must hold samples, but is empty")
    delimiter = next((d for d in ",;\t" if d in numbered[0][1]), None)
    rows = [
        (i, line.split() if delimiter is None else next(csv.reader([line], delimiter=delimiter, skipinitialspace=True)))
        for i, line in numbered
    ]
    header = rows[0][1] if all(_float(cell) is None for cell in rows[0][1]) else None
    columns = _columns(name, rows[0][1], header)
    rows = rows[1:] if header else rows
    if not rows:
        raise InputError(f"{name}: must hold samples, but has a header only")
    values = np.array([[_cell(name, i, row, column) for column in columns] for i, row in rows])
    return Record(values[:, 0], values[:, 1], name)


def _float(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _columns(name: str, first: Sequence[str], header: Sequence[str] | None) -> tuple[int, int]:
    """Indices of time and position."""
    if len(first) < 2:
        raise InputError(f"{name}: must have two columns, time [s] and position [rad], but has one: {first[0][:40]!r}")
    if header is None:
        return 0, 1
    words = [cell.lower().split("[")[0].split("(")[0].strip().split("_")[0] for cell in header]
    found = [[i for i, word in enumerate(words) if word in names] for names in (_TIME, _POSITION)]
    if not any(found):
        return 0, 1
    for what, here in zip(("time", "position"), found, strict=True):
        if not here:
            raise InputError(f"{name}: has no column {what!r} (columns: {', '.join(header)})")
    return found[0][0], found[1][0]


def _cell(name: str, line: int, row: Sequence[str], column: int) -> float:
    what = f"{name}, line {line}"
    if column >= len(row):
        raise InputError(f"{what}: has {len(row)} columns only")
    value = _float(row[column])
    if value is None:
        raise InputError(f"{what}: {row[column][:40]!r} is no number")
    if not math.isfinite(value):
        raise InputError(f"{what}: must be a finite number, not NaN or infinity")
    return value


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
    level, ups, downs = _level_and_crossings(t, y)
    r = y - level
    rising = ups.size >= downs.size
    edges = ups if rising else downs
    if edges.size < 2 or np.ptp(r) <= NOTHING * float(np.max(np.abs(y))):
        return _nothing(level, t)
    k = edges.size - 1
    phase, template, noise, explained = _shape(t, r, edges)
    amplitude = _peak_to_peak(t, r, edges, phase, template) / 2
    factors = _factors(t, r, edges, phase, template)
    amplitudes, periods = amplitude * factors, np.diff(edges)
    kind, reason = _judge(amplitudes, periods, explained)
    if k < FEWEST and kind != "irregular":
        raise InputError(
            f"{record.name}: must hold at least {FEWEST} whole periods, but holds {k} of about "
            f"{np.mean(periods):.3g} s in {t[-1] - t[0]:.4g} s"
        )
    inside = (t >= edges[0]) & (t <= edges[-1])
    return Measurement(
        kind=kind,
        reason=reason,
        amplitude=float(np.mean(amplitudes)),
        amplitude_scatter=_scatter(amplitudes),
        period=float(np.mean(periods)),
        period_scatter=_scatter(periods),
        mean_level=float(np.mean(_means(t, y, edges))),
        drift=float(np.polyfit(t[inside] - t[inside][0], level[inside], 1)[0]),
        noise=noise,
        above=float(np.mean(template[:-1] > 0)),
        rising=rising,
        crossings=edges,
        amplitudes=amplitudes,
        periods=periods,
        level=level,
        phase=phase,
        shape=template,
    )


def _scatter(values: Array) -> float:
    return float(np.std(values, ddof=1)) if values.size > 1 else 0.0


def _nothing(level: Array, t: Array) -> Measurement:
    nan, none = float("nan"), np.zeros(0)
    drift = float((level[-1] - level[0]) / (t[-1] - t[0]))
    return Measurement(
        "still",
        "the position does not oscillate about a slowly drifting mean (if a transient hides it, leave it out: --from)",
        nan, nan, nan, nan, float(np.mean(level)), drift, nan, nan, True, none, none, none, level, none, none,
    )  # fmt: skip


def _means(t: Array, y: Array, edges: Array) -> Array:
    """Mean of y over time between consecutive edges."""
    integral = np.concatenate([[0.0], np.cumsum(np.diff(t) * (y[:-1] + y[1:]) / 2)])
    return np.diff(np.interp(edges, t, integral)) / np.diff(edges)


def _level_and_crossings(t: Array, y: Array) -> tuple[Array, Array, Array]:
    """Level (m,) and the times of the upward and downward crossings."""
    level = _line(t, y)
    ups = downs = np.zeros(0)
    for _ in range(PASSES):
        ups, downs = _crossings(t, y - level)
        knots = [((e[1:] + e[:-1]) / 2, _means(t, y, e)) for e in (ups, downs) if e.size > 1]
        if not knots:
            break
        where = np.concatenate([knot[0] for knot in knots])
        order = np.argsort(where)
        where, means = where[order], np.concatenate([knot[1] for knot in knots])[order]
        # Beyond the first and the last whole period the level goes on with the slope that it has had on the whole.
        slope = float(np.polyfit(where - where[0], means, 1)[0]) if where.size > 2 else 0.0
        level = np.interp(t, where, means)
        level += slope * (np.minimum(t - where[0], 0) + np.maximum(t - where[-1], 0))
    return level, ups, downs


def _line(t: Array, y: Array) -> Array:
    """Line of the median slope between the means of blocks (Theil and Sen): a transient does not tilt it."""
    even, values = _evenly(t, y)
    at, mean = (v.reshape(BLOCKS, -1).mean(axis=1) for v in (even, values))
    i, j = np.triu_indices(at.size, 1)
    slope = float(np.median((mean[j] - mean[i]) / (at[j] - at[i])))
    # The middle of the range, without what a transient takes of it: the median of a servo that sticks on either side is
    # a stick position.
    rest = values - slope * (even - t[0])
    return float(np.mean(np.percentile(rest, RANGE))) + slope * (t - t[0])


def _evenly(t: Array, y: Array) -> tuple[Array, Array]:
    """Times of even distance and the values there, for what counts time and not samples."""
    even = np.linspace(t[0], t[-1], EVEN * BLOCKS)
    return even, np.interp(even, t, y)


def _crossings(t: Array, r: Array) -> tuple[Array, Array]:
    """Times at which r, coming from beyond one edge of the band, leaves it beyond the other: up and down."""
    band = HYSTERESIS * float(np.ptp(np.percentile(_evenly(t, r)[1], RANGE))) / 2
    side = np.where(r > band, 1, np.where(r < -band, -1, 0))
    outside = np.flatnonzero(side)
    ups: list[float] = []
    downs: list[float] = []
    for a, b in zip(outside[:-1], outside[1:], strict=True):
        if side[a] != side[b]:
            (ups if side[b] > 0 else downs).append(_zero(t[a : b + 1], r[a : b + 1]))
    return np.array(ups), np.array(downs)


def _zero(t: Array, r: Array) -> float:
    """Zero of the line fitted to a crossing."""
    middle = float(np.mean(t))
    slope, value = np.polyfit(t - middle, r, 1) if t.size > 2 else ((r[1] - r[0]) / (t[1] - t[0]), float(np.mean(r)))
    if slope * (r[-1] - r[0]) <= 0:
        return middle
    return float(np.clip(middle - value / slope, t[0], t[-1]))


def _folded(t: Array, ups: Array) -> tuple[Array, Array]:
    """(number of the period, phase 0..1) of samples between the first and the last crossing."""
    i = np.clip(np.searchsorted(ups, t, side="right") - 1, 0, ups.size - 2)
    return i, (t - ups[i]) / (ups[i + 1] - ups[i])


def _shape(t: Array, r: Array, ups: Array) -> tuple[Array, Array, float, float]:
    """Phases, the smoothed shape there, the noise about it and the part of the variance that it explains.

    At each phase it is the mean of the nearest samples, of more of them where there is noise.
    """
    inside = (t >= ups[0]) & (t <= ups[-1])
    _, phi = _folded(t[inside], ups)
    order = np.argsort(phi, kind="stable")
    phi, values = phi[order], r[inside][order]
    m = phi.size
    grid = np.linspace(0, 1, GRID + 1)
    count, noise, residual = max(min(NEIGHBOURS, m), round(SHARE * m)), 0.0, values
    shape = np.zeros(grid.size)
    for _ in range(2):
        shape = _smoothed(phi, values, grid, count)
        residual = values - np.interp(phi, grid, shape)
        noise = 1.4826 * float(np.median(np.abs(residual - np.median(residual))))
        wanted = (noise / max(NOISE_SHARE * float(np.ptp(shape)) / 2, 1e-300)) ** 2
        more = round(min(wanted, MOST_SHARE * m))
        if more <= count:
            break
        count = more
    explained = 1 - float(np.var(residual) / max(float(np.var(values)), 1e-300))
    return grid, shape, noise, explained


def _smoothed(phi: Array, values: Array, grid: Array, count: int) -> Array:
    """Local lines through the `count` nearest of the sorted, periodic samples, at each phase of the grid.

    Lines, because parabolas overshoot at the corner where a slip ends and the stick begins.
    """
    reach = min(count, phi.size)
    wide = np.concatenate([phi[-reach:] - 1, phi, phi[:reach] + 1])
    ys = np.concatenate([values[-reach:], values, values[:reach]])
    first = np.clip(np.searchsorted(wide, grid) - count // 2, 0, wide.size - count)
    at = first[:, None] + np.arange(count)
    d, y = wide[at] - grid[:, None], ys[at]
    mean, centre = y.mean(axis=1), d.mean(axis=1)
    d = d - centre[:, None]
    slope = np.sum(d * y, axis=1) / np.maximum(np.sum(d * d, axis=1), 1e-300)
    return mean - slope * centre


def _peak_to_peak(t: Array, r: Array, edges: Array, phase: Array, shape: Array) -> float:
    """Top minus bottom of the folded samples."""
    inside = (t >= edges[0]) & (t <= edges[-1])
    _, phi = _folded(t[inside], edges)
    share = np.gradient(t)[inside]  # the time that a sample stands for: where a motion is fast they may stand closer
    return _top(phi, r[inside], share, phase, shape) + _top(phi, -r[inside], share, phase, -shape)


def _median(values: Array, weights: Array) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2)])


def _top(phi: Array, values: Array, weights: Array, phase: Array, shape: Array) -> float:
    """Highest point of a parabola fitted to the cap of a shape."""
    half = float(np.ptp(shape)) / 2
    peak = int(np.argmax(shape))
    low = shape < shape[peak] - CAP * half
    # The cap round the peak, from the nearest low phase on either side; the phase runs round.
    away = np.roll(low, -peak)
    after, before = int(np.argmax(away)), int(np.argmax(away[::-1])) + 1
    step = 1 / GRID
    u = (phi - phase[peak] + 0.5) % 1 - 0.5
    cap = (u > -before * step) & (u < after * step)
    u, y, weights = u[cap], values[cap], weights[cap]
    if u.size < 6:
        return float(np.max(shape))
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
    return float(np.polynomial.polynomial.polyval(vertex, c))


def _factors(t: Array, r: Array, ups: Array, phase: Array, shape: Array) -> Array:
    """(k,) factor that fits the shape to each period, its own mean left free."""
    i, phi = _folded(t, ups)
    inside = (t >= ups[0]) & (t <= ups[-1])
    result = np.ones(ups.size - 1)
    for j in range(result.size):
        here = inside & (i == j)
        model = np.interp(phi[here], phase, shape)
        if here.sum() > 2 and np.ptp(model) > 0:
            model = model - model.mean()
            result[j] = float(model @ (r[here] - r[here].mean()) / (model @ model))
    return result / float(np.mean(result))  # the shape is a little blunt


def _judge(amplitudes: Array, periods: Array, explained: float) -> tuple[Kind, str]:
    """Is it a limit cycle?"""
    if explained < COHERENCE:
        return "irregular", f"no shape repeats: the mean period explains {max(explained, 0):.0%} of the variance"
    scatter = _scatter(periods) / float(np.mean(periods))
    if scatter > IRREGULAR:
        return "irregular", f"the periods scatter by {scatter:.0%} of their mean"
    if amplitudes.size < FEWEST or (amplitudes <= 0).any():
        return ("hunting", "") if (amplitudes > 0).all() else ("irregular", "not every period has the same shape")
    k = np.arange(amplitudes.size)
    # A trend must hold in the second half too: a transient at the start is over by then.
    for part in (k, k[k.size // 2 :]) if k.size >= 2 * FEWEST else (k,):
        y = np.log(amplitudes[part])
        slope, intercept = np.polyfit(part, y, 1)
        rest = float(np.sum((y - intercept - slope * part) ** 2)) / max(part.size - 2, 1)
        error = math.sqrt(rest / float(np.sum((part - part.mean()) ** 2)))
        change = math.expm1(abs(slope) * (part.size - 1))
        if change < STEADY * (part.size - 1) / (k.size - 1) or abs(slope) < SURE * error:
            return "hunting", ""
    kind: Kind = "decaying" if slope < 0 else "growing"
    return kind, (
        f"the amplitude changes steadily, by the factor {math.exp(slope):.4g} each period, from {amplitudes[0]:.4g} to "
        f"{amplitudes[-1]:.4g} rad"
    )
