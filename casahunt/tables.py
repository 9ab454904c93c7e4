"""The one writer of CSV files.

    number        repr of the plain number: all its digits, so that float() gives the same number back
    not a number  nan, which float() and numpy read
    words         quoted where they hold a comma, a quote or a line break
    nothing       an empty field, for a word or a truth value that is not known (None)

A value of another kind is a mistake of the program and raises TypeError: what str() makes of it nobody can read back.
"""

from __future__ import annotations

import csv
from collections.abc import Callable, Iterable, Sequence
from typing import IO, Any

import numpy as np

Rows = Iterable[Sequence[Any]]


def cell(value: Any) -> str:
    """One value as the text of its field.

    Raises TypeError: the value is neither a number, a truth value nor text.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None:
        return ""
    if isinstance(value, str):
        return value
    if isinstance(value, bool | int | float):
        return repr(value)
    raise TypeError(f"a CSV field must be a number, a truth value or text, not {type(value).__name__}")


def table(stream: IO[str], columns: Sequence[str]) -> Callable[[Rows], None]:
    """Write the header of a table.

    stream: a text file opened with newline="". Returns function that writes rows of as many values. Raises ValueError,
    TypeError: a row of another length, a value that is neither number nor text.
    """
    writer = csv.writer(stream, lineterminator="\n")
    writer.writerow(columns)

    def write(rows: Rows) -> None:
        for row in rows:
            if len(row) != len(columns):
                raise ValueError(f"a row of {len(row)} values in a table of {len(columns)} columns")
            writer.writerow([cell(value) for value in row])

    return write
