"""Records from which friction can be identified: those that show a limit cycle, whole, about a fixed position.

Refused, each in a sentence: a servo at rest, no whole periods, a decaying or irregular motion (measure.py), a drifting
set point, clipped positions.
"""

from __future__ import annotations

import numpy as np

from ...errors import InputError
from ...servo.sampled.border import ENCODER_BORDER
from ..record.file import Record
from ..record.measure import Measurement, measured

MOST_DRIFT = 0.1
"""Change of the mean position over the record, in units of the amplitude, above which the set point drifts."""
CLIPPED_SHARE = 0.02
"""Share of the samples that may lie exactly at the largest or smallest position, where others scatter."""


def suitable(record: Record) -> Measurement:
    """What the record shows.  Raises InputError: friction cannot be identified from it."""
    found = measured(record)
    if found.kind == "still":
        raise InputError(f"{record.name}: shows a servo at rest, and no hunting: {found.reason}")
    if not found.hunting:
        raise InputError(f"{record.name}: shows no limit cycle: {found.reason}")
    length = float(found.crossings[-1] - found.crossings[0])
    if abs(found.drift) * length > MOST_DRIFT * found.amplitude:
        raise InputError(
            f"{record.name}: its mean position drifts by {found.drift * length:.3g} rad, at an amplitude of "
            f"{found.amplitude:.3g} rad; the set point must stand still, so cut the record or subtract the set point"
        )
    for end in (record.position.max(), record.position.min()):
        if _clipped(record, found, float(end)):
            share = float(np.mean(record.position == end))
            raise InputError(
                f"{record.name}: its positions are clipped at {end:.6g} rad, where {share:.0%} of the samples lie "
                "exactly; record with a larger range"
            )
    return found


def _clipped(record: Record, found: Measurement, end: float) -> bool:
    """Whether positions are cut off at an end.

    Of noisy positions none equals another, and those of an encoder that rest go from count to count on their way there:
    who comes to a limit at full speed is cut off.
    """
    y = record.position
    there = y == end
    if np.mean(there) < CLIPPED_SHARE:
        return False
    if found.quantum == 0:
        return bool(np.unique(y[~there]).size > 0.9 * np.count_nonzero(~there))
    return False


def of_few_steps(amplitude: float, quantum: float) -> str:
    """The encoder as what is to be suspected; "" where its steps are not seen, or are small."""
    if not quantum or amplitude >= ENCODER_BORDER * quantum:
        return ""
    return (
        f"the encoder, of whose steps of {quantum:.4g} rad the amplitude is {amplitude / quantum:.3g}: with fewer than "
        f"{ENCODER_BORDER:g} quantisation may decide how it hunts (casahunt simulate --encoder)"
    )
