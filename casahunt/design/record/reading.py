"""Which columns of a file were read, and in which units: factor * column in s, rad and N m.

Samples as other packages hand them out, columns of tables, channels of files, sequences, dates, become floats; what is
missing there (masked, NaN, NaT, NA) is missing here: nothing is put in its place.

How the text of a record is laid out: preamble, header, delimiter, decimal sign.

Samples are the lines with as many cells as most have, two of them numbers at least; the delimiter and the decimal sign
are those with which the fewest cells are none.  What stands above them, and is no header, is a preamble, as drives and
oscilloscopes write it: it is left out, and counted.
"""

from __future__ import annotations

import csv
import datetime
import io
import math
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from ...axis_units import shown
from ...checks import shortened
from ...errors import InputError
from .units import Quantity, Unit, base_of, stated_unit

Array = np.ndarray

_SECOND = np.timedelta64(1, "s")


def samples_of(name: str, what: str, values: Any, *, of_time: bool = False) -> Array:
    """Floats of any shape; missing ones are NaN.

    name, what: of the record, and which of its columns, for messages; values: an array, a sequence, or what has
    `__array__`; of_time: dates and durations are seconds, dates from the first on.  Raises InputError: no numbers.
    """
    try:
        array = np.full(np.shape(values), np.nan) if np.ma.is_masked(values) else np.asarray(values)
        if array.dtype.kind == "O":  # Python's own numbers, dates and durations
            each = array.ravel().tolist()
            if of_time and each and isinstance(each[0], datetime.datetime):
                each = [date - each[0] for date in each]
            if of_time and each and isinstance(each[0], datetime.timedelta):
                each = [duration.total_seconds() for duration in each]
            if any(isinstance(value, str | bytes | bool) for value in each):
                raise TypeError("text")
            array = np.array(each, float).reshape(array.shape)
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


@dataclass(frozen=True)
class Column:
    """Where the values of a quantity were read.

    Attributes
    ----------
    name : header of the column, or its number.
    unit : of the values in the file.
    origin : who states the unit: "header", "option", or "nobody".
    """

    name: str
    unit: Unit
    origin: str


@dataclass(frozen=True)
class Reading:
    """How a file was read.

    Attributes
    ----------
    time, position : the two columns.
    preamble : number of lines above header and samples that were left out.
    decimal : the decimal sign.
    torque : the column of the motor's torque, or of its current; None where none was asked for.
    """

    time: Column
    position: Column
    preamble: int = 0
    decimal: str = "."
    torque: Column | None = None

    @property
    def sentence(self) -> str:
        """Columns and units in words."""
        parts = []
        read = [("times", self.time, "s"), ("positions", self.position, base_of("angle"))]
        read += [] if self.torque is None else [(shown().word("torques"), self.torque, base_of("torque"))]
        for noun, column, base in read:
            unit = column.unit
            how = {
                "header": f"in {unit.name}",
                "option": f"in {unit.name} (as stated on the command line)",
                "nobody": f"taken as {unit.name} (the file states no unit)",
            }[column.origin]
            converted = f", converted to {base}" if unit.factor != 1 else ""
            parts.append(f"{noun} from column {column.name}, {how}{converted}")
        if self.preamble:
            parts.append(f"left out: {self.preamble} line{'s' * (self.preamble > 1)} of preamble")
        if self.decimal == ",":
            parts.append("commas taken as decimal signs")
        return "; ".join(parts)


def column_read(quantity: Quantity, i: int, header: Sequence[str] | None, stated: Unit | None, name: str) -> Column:
    """A column with its unit: the stated one, that of its header, or the base unit of its quantity.

    name: of the file.  Raises InputError: the header states a unit of something else.
    """
    label = repr(header[i].strip()) if header else str(i + 1)
    if stated is not None:
        return Column(label, stated, "option")
    found = stated_unit(quantity, header[i], what=name) if header else None
    if found is not None:
        return Column(label, found, "header")
    return Column(label, Unit(base_of(quantity), 1.0), "nobody")


def torque_wanted(torque: str | None, current: str | None, constant: float | None) -> tuple[Quantity, str] | None:
    """"torque" or "current", and the column that is asked for; None for neither.  Raises InputError: not so."""
    if constant is not None and not (math.isfinite(constant) and constant > 0):
        raise InputError(f"torque-constant = {constant}: must be a finite number above 0")
    if torque is not None and current is not None:
        raise InputError("torque-column, current-column: must be one of them, not both")
    if current is not None:
        if constant is None:
            raise InputError("current-column: goes with --torque-constant, the N m of an ampere")
        return "current", current
    if torque is None and constant is not None:
        raise InputError("torque-constant: goes with --current-column or --torque-column")
    return None if torque is None else ("torque", torque)


def torque_read(
    quantity: Quantity, i: int, header: Sequence[str] | None, constant: float | None, name: str
) -> Column:
    """The column of the torque in N m: by its unit or the constant, of a current by both."""
    if quantity == "torque":
        return column_read("torque", i, header, None if constant is None else Unit(f"{constant:g} N m", constant), name)
    found = column_read("current", i, header, None, name)
    factor = found.unit.factor * (constant or 1.0)
    return Column(found.name, Unit(f"{found.unit.name} at {constant:g} N m/A", factor), found.origin)


MOST_PREAMBLE = 600
"""Lines in which the samples must have begun, and be in the majority."""
WAYS = ((",", "."), (";", "."), ("\t", "."), (None, "."), (";", ","), ("\t", ","), (None, ","))
"""Delimiters (None: blanks) and decimal signs, in the order in which they are believed."""
NUMBER = re.compile(r"\s*[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?\s*")
FEWEST_LINES = 3
"""Lines of samples that tell a layout."""


@dataclass(frozen=True)
class Layout:
    """Where the samples begin.

    Attributes
    ----------
    delimiter, decimal : None for blanks; "." or ",".
    first : number of lines above the samples.
    header : the lines above them that may be one, at most two, the nearest last.
    preamble : number of lines above these that are not empty.
    """

    delimiter: str | None
    decimal: str
    first: int
    header: tuple[list[str], ...]
    preamble: int


def layout_of(read: bytes, skip: int) -> Layout | None:
    """The layout of a file, its first lines skipped; None where none is plain."""
    lines = list(_lines(read, skip))
    best: tuple[float, Layout] | None = None
    for delimiter, decimal in WAYS:
        rows = [(i, cells(text, delimiter)) for i, text in lines]
        numbers = [(i, row, sum(_is_number(cell, decimal) for cell in row)) for i, row in rows]
        counts = Counter(len(row) for _, row, n in numbers if n >= 2)
        if not counts:
            continue
        width, often = counts.most_common(1)[0]
        samples = [(i, len(row) - n) for i, row, n in numbers if len(row) == width and n >= 2]
        if often < min(FEWEST_LINES, len(lines)):
            continue
        strange = sum(other for _, other in samples) / len(samples) + 1 - len(samples) / len(lines)
        if best is None or strange < best[0] - 1e-9:
            first = samples[0][0]
            above = [row for i, row in rows if i < first]
            # The last line above the samples that has their width and no number; two, where the line above it is such
            # too
            named: list[list[str]] = []
            for row in reversed(above):
                if len(named) == 2 or len(row) != width or any(_is_number(cell, decimal) for cell in row):
                    break
                named.insert(0, row)
            best = strange, Layout(delimiter, decimal, first - 1, tuple(named), len(above) - len(named))
    return None if best is None else best[1]


def _lines(read: bytes, skip: int) -> Iterator[tuple[int, str]]:
    """(number from 1, text) of lines that are neither empty nor comments."""
    with text_of(read) as stream:
        for i, line in enumerate(stream, 1):
            if i > skip + MOST_PREAMBLE:
                return
            text = line.strip("\r\n")
            if i > skip and text.strip() and not text.lstrip().startswith("#"):
                yield i, text


def text_of(read: bytes) -> io.TextIOWrapper:
    """The lines of a file: read again and again, which a pipe is not."""
    return io.TextIOWrapper(io.BytesIO(read), encoding="utf-8-sig")


def cells(line: str, delimiter: str | None) -> list[str]:
    """The cells of a line; none where quotes do not match."""
    if delimiter is None:
        return line.split()
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True), [])
    except csv.Error:
        return []


def _is_number(cell: str, decimal: str) -> bool:
    if decimal == ",":
        cell = cell.replace(",", ".") if "." not in cell else "no"
    return NUMBER.fullmatch(cell) is not None


def column_of(name: str, what: str, asked: str, header: Sequence[str] | None, width: int) -> int:
    """The index of a column by its header, with or without its unit, or by its number from 1.

    Raises InputError: there is no such column.
    """
    wanted = asked.strip().casefold()
    plain = [cell.strip().casefold() for cell in header or ()]
    for i, cell in enumerate(plain):
        if wanted in (cell, re.split(r"\s*[\[({<]", cell)[0]):
            return i
    if wanted.isdecimal() and 1 <= int(wanted) <= width:
        return int(wanted) - 1
    there = ", ".join(repr(cell.strip()) for cell in header) if header else f"{width}, without names"
    raise InputError(f"{what}-column = {asked!r}: {name} has no such column (columns: {there})")
