"""A record that begins on its way to the cycle: what it is fitted by is its later part.

Its first amplitudes or periods differ from the later ones, or of a fit that does not explain it more is left of the
first half.  Then the later half is fitted, and that of it again, until it is explained, or no longer holds periods
enough.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import InputError, NoOrbit
from ..record.file import Record
from ..record.measure import measured

Array = np.ndarray

MORE_AT_FIRST = 1.5
"""What is left of the first half of a record, in units of that of the later one, from which on it is a transient."""
TRANSIENT_PART = 0.5
"""Part of a record that begins with a transient."""
SURELY, LEAST_DIFFERENCE = 5.0, 1e-4
"""Standard errors of the later amplitudes or periods, and part of them, by which those of a transient differ."""


def behind_a_transient(records: Sequence[Record], fit: Callable[[Sequence[Record]], Any]) -> Any:
    """A fit; where a transient is in its way, of the later part of the records.

    fit: from records to an Identification. Raises InputError, NoOrbit.
    """
    found, refused = None, None
    try:
        found = fit(records)
        if found.judgement.explained or more_at_first(found.residuals) <= MORE_AT_FIRST:
            return found
    except InputError as refusal:
        if not any(map(on_its_way, records)):
            raise
        refused = refusal
    later = [record.after(record.times[0] + TRANSIENT_PART * record.duration) for record in records]
    with suppress(InputError, NoOrbit):
        again = behind_a_transient(later, fit)
        if again.judgement.explained:
            return replace(again, left_out=TRANSIENT_PART + (1 - TRANSIENT_PART) * again.left_out)
    if refused is not None and "--from" in str(refused):
        raise refused
    if found is None:
        end = "" if str(refused).endswith("?") else "."
        raise InputError(f"{refused}{end} Or is it still on the way to its cycle at first? Leave that out: --from.")
    return found


def more_at_first(residuals: Sequence[Array]) -> float:
    """What is left of the first half of a record, in units of that of the later one; the most of all records."""
    halves = [[float(np.sqrt(np.mean(half**2))) for half in np.array_split(each, 2)] for each in residuals]
    return max(early / late if late > 0 else 1.0 for early, late in halves)


def on_its_way(record: Record) -> bool:
    """Whether a record begins with a transient: its first amplitudes or periods differ from the later ones."""
    try:
        found = measured(record)
    except InputError:
        return False
    for values in (found.amplitudes, found.periods):
        first, last = np.array_split(values, 2)
        if last.size > 1:
            sure = SURELY * float(np.std(last, ddof=1)) / np.sqrt(last.size)
            if abs(first.mean() - last.mean()) > max(sure, LEAST_DIFFERENCE * last.mean()):
                return True
    return False
