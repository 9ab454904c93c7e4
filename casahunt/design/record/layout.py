"""How the text of a record is laid out: preamble, header, delimiter, decimal sign.

Samples are the lines with as many cells as most have, two of them numbers at least; the delimiter and the decimal sign
are those with which the fewest cells are none.  What stands above them, and is no header, is a preamble, as drives and
oscilloscopes write it: it is left out, and counted.
"""

from __future__ import annotations

import csv
import io
import re
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from ...errors import InputError

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
