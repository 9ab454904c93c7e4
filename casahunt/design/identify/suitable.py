"""Records from which friction can be identified: those that show a limit cycle, whole, about a fixed position.

Refused, each in a sentence: a servo at rest, no whole periods, a decaying or irregular motion (measure.py), a drifting
set point, clipped positions.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ...checks import choice_of, of_kind, require
from ...errors import InputError
from ...servo.drive import ENCODER_BORDER, Drive
from ...servo.friction import BRISTLE, Model
from ...servo.linear.sampled_loop import as_continuous, lag_of
from ...servo.servo import Servo
from ..record.file import Record
from ..record.measure import Measurement, measured
from ..record.waveform import counts_by
from .clipped import of_clipped
from .fit import Data
from .swings import LEAST_PERIOD_ERROR, one_by_one

MOST_FITTED = 20_000
"""Of a record that are fitted; of more, every second, third ... one."""
MOST_DRIFT = 0.1
"""Change of the mean position over the record, in units of the amplitude, above which the set point drifts."""
MOVED_STEPS = 50.0
"""Range of a position that moves, in units of its usual step from sample to sample: noise reaches ten."""
FRICTION = "friction."
"""Of which parameters begin that lags leave as they are."""
MOST_LEFT_OUT = 0.1
"""Of what lags leave out, in amplitudes."""


def suitable(record: Record) -> Measurement:
    """What the record shows.  Raises InputError: friction cannot be identified from it."""
    found = measured(record)
    if found.kind == "still":
        steps = np.abs(np.diff(record.position))  # from sample to sample: noise, or a count
        smallest = float(np.median(steps[steps > 0])) if np.any(steps > 0) else 0.0
        if float(np.ptp(record.position)) > MOVED_STEPS * smallest > 0:
            raise InputError(f"{record.name}: shows no whole period: {found.reason}; record three periods or more")
        raise InputError(f"{record.name}: shows a servo at rest, and no hunting: {found.reason}")
    if not found.hunting:
        grows = "; record until it grows no more, or at a lower gain" if found.kind == "growing" else ""
        raise InputError(f"{record.name}: shows no limit cycle: {found.reason}{grows}")
    length = float(found.crossings[-1] - found.crossings[0])
    if abs(found.drift) * length > MOST_DRIFT * found.amplitude:
        raise InputError(
            f"{record.name}: its mean position drifts by {found.drift * length:.3g} rad, at an amplitude of "
            f"{found.amplitude:.3g} rad; the set point must stand still, so cut the record or subtract the set point"
        )
    if clipped := of_clipped(record, found.quantum):
        raise InputError(f"{record.name}: its {clipped}")
    return found


def in_a_pattern(swings: int) -> str:
    """What to suspect where a record repeats only after more swings than the two of a cycle."""
    return (
        f"repeats only after {swings} swings, the cycle of the model after 2: suspect the encoder, whose counts make "
        "such patterns (casahunt simulate --encoder); record more counts of amplitude, at a lower gain"
    )


def of_few_steps(amplitude: float, quantum: float) -> str:
    """The encoder as what is to be suspected; "" where its steps are not seen, or are small."""
    if not quantum or amplitude >= ENCODER_BORDER * quantum:
        return ""
    return (
        f"the encoder, of whose steps of {quantum:.4g} rad the amplitude is {amplitude / quantum:.3g}: with fewer than "
        f"{ENCODER_BORDER:g} quantisation may decide how it hunts (casahunt simulate --encoder)"
    )


def free_of(free: Sequence[str], servo: Servo, model: Model | None) -> tuple[str, ...]:
    """The free parameters.  Raises InputError: the model does not have one of them, or none is given."""
    allowed = [n for n in servo.names if n != "gain" and (model == "lugre" or n not in BRISTLE)]
    of_kind("free", free, Sequence, "such as ['friction.static']")
    names = (free,) if isinstance(free, str) else tuple(free)
    for name in names:
        if name in BRISTLE and model != "lugre":
            raise InputError(f"free = {name}: the {model} model has no such parameter; it is one of the lugre model")
        choice_of("free", name, allowed)
    if not names or len(set(names)) < len(names):
        raise InputError("free: must be at least one parameter, each once")
    return names


def gains_of(gains: float | Sequence[float], count: int) -> list[float]:
    """The gain of each record.  Raises InputError: there are more or fewer."""
    each = [float(require("gain", g, above=0)) for g in (gains if isinstance(gains, Sequence) else [gains])]
    each = each * count if len(each) == 1 else each
    if not count or len(each) != count:
        raise InputError(f"gains: must be one, or one for each of the {count} records, not {len(each)}")
    return each


def drive_taken(
    records: Sequence[Record], servo: Servo, gains: Sequence[float], free: Sequence[str], drive: Drive | None
) -> tuple[Drive | None, float]:
    """The drive whose lags are taken into account, where friction alone is sought, from positions alone; and what they
    leave out to the first order, relative to the amplitude.

    How the motion changes with friction is known to that order; what counts do is not in it: swings.py takes each swing
    by itself, readings.py says what all of them leave unknown, built.py computes the rest where a fit ends.
    Raises InputError: they are too long for that.
    """
    of_friction = all(name.startswith(FRICTION) for name in free)
    if drive is None or not of_friction or any(record.torque is not None for record in records):
        return None, 0.0
    gain, lag = max(gains), lag_of(drive, servo)
    as_continuous(servo, gain, drive)
    left_out = servo.torque_gains(gain)[0] / servo.inertia * lag**2 / 2
    if left_out > MOST_LEFT_OUT:
        raise InputError(
            f"drive: its lag of {lag:.3g} s is too long for a fit, which leaves out {left_out:.2g} of the amplitude "
            f"then, more than {MOST_LEFT_OUT:g}: record with a shorter sample time, delay or filter, or at a lower gain"
        )
    return drive, left_out


def data_of(record: Record, m: Measurement, gain: float, drive: Drive | None = None, left_out: float = 0.0) -> Data:
    """A measured record as it is fitted: its whole periods, behind the transient."""
    beside = m.period / 4 if drive is not None else 0.0
    first, last = m.crossings[0] - beside, m.crossings[-1] + beside
    inside = np.flatnonzero((record.times >= first) & (record.times <= last))
    inside = inside[:: -(-inside.size // MOST_FITTED)]
    quantum = drive.count if drive is not None and counts_by(record.position, drive.count) else m.quantum
    t, torque = record.times[inside], None if record.torque is None else record.torque[inside]
    data = Data(
        t - (t[0] + t[-1]) / 2, record.position[inside], gain, m.period,
        max(m.period_error / m.period, LEAST_PERIOD_ERROR), m.amplitude, quantum, m.noise, m.shape, record.name,
        torque, drive, left_out,
    )  # fmt: skip
    return data if drive is None else one_by_one(data, m.mean_level)
