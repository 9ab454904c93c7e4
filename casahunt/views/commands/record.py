"""casahunt record: amplitude and frequency of a measured hunting record, beside the predicted cycle.

Keys of the JSON object beside those of the measurement (`Measurement.to_dict`): file; columns, for time and position
the column read, its unit, the factor to s or rad, and who stated the unit ("header", "option", "nobody": taken as s or
rad); offset [rad] from the set point; predicted, null or the `to_dict` of the cycle with its frequency and the ratios
amplitude_ratio and frequency_ratio, measured over predicted, of amplitudes that are half of a swing;
prediction_failed, null or why there is none; suspect,
null or what to suspect where the frequency is far from the predicted one; clipped, null or that positions are cut off
at an end; wall_s.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import numpy as np

from ...axis_units import quantity, shown
from ...checks import known_decimals, moderate, to_absolute_error
from ...design.identify.clipped import of_clipped
from ...design.identify.identify import Identification, identify
from ...design.identify.suspect import suspicion
from ...design.record.file import Record, read_record
from ...design.record.measure import Measurement, measured
from ...design.record.waveform import swings_of
from ...errors import InputError, NoOrbit
from ...orbits import Orbit
from ...servo.find_orbit import find_orbit
from ...servo.problem import HuntingOrbit
from ...servo.units import GAIN_UNIT
from ..answers.answer import HARD_SPACE, PLAIN_DIGITS, Answer, angle, exactly, rhythm
from .arguments import Asked, add_command, finite, positive
from .console import complain
from .output import give
from .progress import tell
from .record_options import add_reading, later_part, reading_of

CSV_COLUMNS = ("quantity", "unit", "measured", "error", "scatter", "predicted", "predicted_error", "ratio")

RECORD_DIGITS = 6
"""Of a measured number in the details."""
LARGE, MANY = 2e7, 1_000_000
"""Bytes that take more than two seconds to read, and samples that take as long to measure."""


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = add_command(
        commands, "record", "a measured hunting record beside the prediction",
        file="times and positions; units as its header states them", model=", for the prediction",
        csv="amplitude, frequency and period, measured and predicted",
        plot="the record, folded, with the prediction",
    )  # fmt: skip
    add_reading(command)
    alone = "without it nothing is predicted of a servo, and a loop of parts at its own"
    command.add_argument("--gain", help=f"controller gain K of the record; {alone}")
    command.add_argument("--set-point", help="theta_d in rad, to give the offset of the mean position from it")


def run(options: Asked) -> int:
    """Measure, compute and print; returns the exit code."""
    if options.file.endswith(".toml"):
        raise InputError(f"record {options.file!r}: is a servo file by its name; the record stands before it")
    servo, model = options.subject()
    gain = None if options.gain is None else positive("gain", options.gain, GAIN_UNIT)
    given = options.set_point
    set_point = None if given is None else moderate("set-point", finite("set-point", given, "rad"))
    how, reading = options.how(), reading_of(options)
    with suppress(OSError):
        size = Path(options.file).stat().st_size
        if size >= LARGE:
            tell(f"reading {size / 1e6:.0f} MB")
    record = later_part(read_record(options.file, **reading), options)
    if record.times.size >= MANY:
        tell(f"{record.times.size} samples read, looking for the period")
    found = measured(record)
    orbit: Orbit | None = None
    failure = None
    try:
        if gain is not None or model is None:  # a loop has its own
            orbit = find_orbit(servo, model, gain, options=how)
    except NoOrbit as error:
        failure = str(error)
    suspect = ""
    if isinstance(orbit, HuntingOrbit) and found.hunting:

        def fit() -> Identification:
            tell("far from the predicted frequency: looking for a friction that explains the record")
            return identify([record], servo, gain, model, advise=False)

        step, swings = float(np.median(np.diff(record.times))), swings_of(found.shape, found.amplitude)
        suspect = suspicion(orbit, found.period, found.amplitude, found.quantum, step, swings, fit)
    rows = _rows(found, orbit)
    seen = _record(options.file, record, found, orbit, failure, set_point)
    lines = [*_lines(options.file, record, found, orbit, set_point), *([f"  {suspect}"] if suspect else [])]
    give(
        options,
        seen | {"wall_s": options.outputs.seconds, "suspect": suspect or None},
        Answer(lines, _details(found, orbit)),
        table={name: [row[name] for row in rows] for name in CSV_COLUMNS} if found.periods.size else None,
        picture=("simulation.folded_record", found, orbit) if found.periods.size else (),
    )
    if not found.hunting:
        complain("casahunt record", f"{record.name} shows no limit cycle: {found.reason}")
    if failure:
        complain("casahunt record", f"nothing predicted: {failure}")
    return 0 if found.hunting and failure is None else 1


def half_swing(orbit: Orbit) -> float:
    """Half of top minus bottom of a cycle's position [rad], as a record's amplitude; no lopsided orbit's is."""
    return orbit.amplitude if orbit.half else float(np.ptp(orbit.sample()[1][orbit.cycle.states.index("x1")])) / 2


def _rows(m: Measurement, orbit: Orbit | None) -> list[dict[str, Any]]:
    """What was measured beside what was predicted (NaN for nothing); columns `CSV_COLUMNS`."""
    amplitude, period = (half_swing(orbit), orbit.period) if orbit else (math.nan, math.nan)
    named = shown().near(m.amplitude, "rad")
    size = [shown().number(x, "rad", named) for x in (m.amplitude, m.amplitude_error, m.amplitude_scatter, amplitude)]
    errors = (orbit.amplitude_error, orbit.period_error) if orbit else (math.nan, math.nan)
    rows = [
        ("amplitude", named, *size, errors[0]),
        ("frequency", "Hz", m.frequency, m.frequency_error, m.frequency_scatter, 1 / period, errors[1]),
        ("period", "s", m.period, m.period_error, m.period_scatter, period, errors[1]),
    ]
    return [dict(zip(CSV_COLUMNS, (*row[:6], row[5] * row[6], row[2] / row[5]), strict=True)) for row in rows]


def _lines(
    file: str, record: Record, m: Measurement, orbit: Orbit | None, set_point: float | None
) -> Iterator[str]:
    kind = f"no{HARD_SPACE}oscillation" if m.kind == "still" else m.kind
    known = m.periods.size > 0 and m.period_error < m.period
    whole = "no period that repeats" if m.periods.size and not known else f"{m.periods.size} whole periods"
    yield f"record {file}: {kind}, {whole}"
    if record.reading is not None:
        yield f"  {record.reading.sentence}"
    if known:
        yield from _beside(m, orbit, PLAIN_DIGITS)
    elif orbit:
        yield f"  predicted: amplitude {angle(half_swing(orbit))}, once in {rhythm(orbit.period)}"
    error = m.amplitude_error if known else 0.0
    level = quantity(m.mean_level, "rad", lambda x, e: to_absolute_error(x, e, most=PLAIN_DIGITS), error)
    offset = "" if set_point is None else f", {quantity(m.mean_level - set_point, 'rad', '+.3g')} off the set point"
    yield f"  mean position {level}{offset}, drift {quantity(m.drift, 'rad/s', '.2g')}"
    if known:
        noise = quantity(m.noise, "rad", ".2g")
        yield f"  noise {noise}; above its mean line for {m.above:.1%} of a period (50% if symmetric)"
        before, behind = (time > 1.25 * m.period for time in m.left_out)
        if before:
            yield f"  left out: the first {m.left_out[0]:.4g} s, which do not repeat like the rest (a transient?)"
        if behind:
            yield f"  left out: the last {m.left_out[1]:.4g} s, which hold no whole period"
        if m.missing > 0.01 * m.period:
            yield f"  left out: {m.missing:.4g} s in between, in gaps or without a whole period"
        if m.quantum > 0:
            yield f"  positions come in steps of {quantity(m.quantum, 'rad')}; the error of the amplitude covers that"
        if clipped := of_clipped(record, m.quantum):
            yield f"  {clipped}"
    if orbit:
        whose = f"{orbit.model} model" if isinstance(orbit, HuntingOrbit) else "loop"
        yield f"  predicted by the {whose} at gain {orbit.problem.value('gain'):.10g} V/rad"


def _details(m: Measurement, orbit: Orbit | None) -> Iterator[str]:
    """Measured and predicted numbers in more digits, and what is known of the prediction besides."""
    if m.periods.size:
        yield from _beside(m, orbit, RECORD_DIGITS)
    if orbit:
        yield from exactly(orbit)


def _beside(m: Measurement, orbit: Orbit | None, most: int) -> Iterator[str]:
    """The table of measured and predicted numbers, each to the digits that its error vouches for, so many at most."""
    beside = f"  {'predicted':>12}  {'ratio':>7}" if orbit else ""
    yield f"  {'':9}  {'measured':>12}  {'error':>8}  {'scatter':>8}{beside}  unit"
    for row in _rows(m, orbit):
        measured = to_absolute_error(row["measured"], row["error"], most=most)
        beside = ""
        if orbit:
            predicted = to_absolute_error(row["predicted"], row["predicted_error"], most=most)
            ratio = f"{row['ratio']:.{known_decimals(row['error'] / abs(row['measured']), PLAIN_DIGITS - 1)}f}"
            beside = f"  {predicted:>12}  {ratio:>7}"
        errors = f"{row['error']:8.2g}  {row['scatter']:8.2g}"
        yield f"  {row['quantity']:9}  {measured:>12}  {errors}{beside}  {row['unit']}"


def _record(
    file: str,
    record: Record,
    m: Measurement,
    orbit: Orbit | None,
    failure: str | None,
    set_point: float | None,
) -> dict[str, Any]:
    reading, columns = record.reading, {}
    if reading is not None:
        for what, c in (("time", reading.time), ("position", reading.position)):
            columns[what] = {"column": c.name, "unit": c.unit.name, "factor": c.unit.factor, "stated_by": c.origin}
    predicted = None
    if orbit is not None:
        predicted = {
            **orbit.to_dict(table=False),
            "frequency": 1 / orbit.period,
            "amplitude_ratio": m.amplitude / half_swing(orbit),
            "frequency_ratio": m.frequency * orbit.period,
        }
    return {
        "file": file,
        "columns": columns,
        **m.to_dict(table=False),
        "periods": m.periods.size,
        "offset": None if set_point is None else m.mean_level - set_point,
        "predicted": predicted,
        "prediction_failed": failure,
        "clipped": of_clipped(record, m.quantum) or None if m.periods.size else None,
    }
