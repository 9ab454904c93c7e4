"""Samples as other packages hand them out: columns of tables, channels of files, sequences, dates.

    floats = what numpy makes of it;      t [s] = date - first date,      t [s] = duration

What is missing there (masked, NaN, NaT, NA) is missing here: nothing is put in its place.
"""

from __future__ import annotations

import datetime
from typing import Any

import numpy as np

from ...checks import shortened
from ...errors import InputError

Array = np.ndarray

_SECOND = np.timedelta64(1, "s")


def samples_of(name: str, what: str, values: Any, *, of_time: bool = False) -> Array:
    """Floats of any shape; missing ones are NaN.

    name, what: of the record, and which of its columns, for messages; values: an array, a sequence, or what has
    `__array__`; of_time: dates and durations are seconds, dates from the first on.  Raises InputError: no numbers.
    """
    try:
        array = np.full(np.shape(values), np.nan) if np.ma.is_masked(values) else np.asarray(values)
        if array.dtype.kind == "O":
            array = _of_objects(array, of_time)
        if of_time and array.dtype.kind == "M" and array.size:
            array = array - array.flat[0]
        if of_time and array.dtype.kind == "m":
            array = array / _SECOND
        if array.dtype.kind in "iuf":
            return np.asarray(array, float)
        found = str(array.dtype)
    except (TypeError, ValueError, ArithmeticError, AttributeError, RuntimeError) as error:
        found = shortened(str(error))
    numbers = "numbers, dates or durations" if of_time else "numbers"
    raise InputError(f"{name}: {what} must be {numbers}, one of each sample ({found})")


def _of_objects(array: Array, of_time: bool) -> Array:
    """Of Python's own numbers, dates and durations."""
    values = array.ravel().tolist()
    if of_time and values and isinstance(values[0], datetime.datetime):
        values = [each - values[0] for each in values]
    if of_time and values and isinstance(values[0], datetime.timedelta):
        values = [each.total_seconds() for each in values]
    if any(isinstance(each, str | bytes | bool) for each in values):
        raise TypeError("text")
    return np.array(values, float).reshape(array.shape)
