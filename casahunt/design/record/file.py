"""Measured records: times, positions and perhaps torques, and how they are read from a file.

    times [s] = factor_t * column,   position [rad] = factor_p * column,   torque [N m] = factor_m * column

Columns and units are those of the header (units.py), or stated by whoever reads the file.  Units that nobody states
are taken as s and rad, and `Reading.sentence` says so.  The samples are parsed by numpy; only where it stumbles are the
lines read once more one by one, to name the line and the cell.
"""

from __future__ import annotations

import csv
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from ...errors import InputError
from ...export import Columns
from ...files import bounded
from ...results import Result
from .reading import (
    Reading,
    column_of,
    column_read,
    layout_of,
    samples_of,
    text_of,
    torque_read,
    torque_wanted,
)
from .units import Quantity, parsed_unit, quantity_of, split_header

Array = np.ndarray

SMALLEST_SIZE, LARGEST_SIZE = 1e-100, 1e100
"""Sizes between which squares neither vanish nor overflow."""
LARGEST_RECORD = 2e8
"""Bytes of a file: eight million samples, a quarter of an hour at 10 kHz, are measured in five seconds with 0.6 GB; the
shortest lines that can be samples are fifty million and take 2.3 GB."""
QUANTITIES: tuple[Quantity, ...] = ("time", "angle")
"""Of the first two columns that are read."""
_TIME = frozenset(("time", "t", "timestamp", "timestamps", "zeit"))
_POSITION = frozenset(
    ("position", "pos", "theta", "θ", "angle", "phi", "φ", "istposition", "lage", "istlage", "winkel", "istwinkel")
)
_NOT_MEASURED = frozenset(
    "d ref reference set setpoint target des desired cmd command demand error err dot velocity vel speed rate".split()
)
"""theta_d, theta_ref, theta_dot: not the position."""
_COUNTS: dict[Quantity, frozenset[str]] = {
    "time": frozenset(("sample", "samples", "index", "tick", "ticks")),
    "angle": frozenset(("encoder", "count", "counts", "cts", "inc", "increments", "pulses", "lsb")),
}
"""Columns named by what they count."""


@dataclass(frozen=True, eq=False, repr=False)
class Record(Result):
    """A position measured at increasing times.

    Columns may be what other packages hand out, such as a column of pandas or a channel of a file: reading.py.

    Attributes
    ----------
    times : (m,) [s]; dates and durations are converted, dates count from the first.
    position : (m,) [rad].
    name : where it comes from.
    reading : columns and units of the file; None for what was not read from one.
    torque : (m,) of the motor, measured with the positions [N m]; None where it was not.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt import Record
    >>> t = np.linspace(0.0, 1.0, 11)
    >>> Record(t, np.sin(t))
    <Record: name record, samples 11, duration 1 s>
    """

    _quantities = ("name", "samples = times.size", "duration [s]")
    _details = ("reading",)

    times: Array
    position: Array
    name: str = "record"
    reading: Reading | None = field(default=None, repr=False)
    torque: Array | None = field(default=None, repr=False)

    def __post_init__(self) -> None:
        t = samples_of(self.name, "times", self.times, of_time=True)
        y = samples_of(self.name, "positions", self.position)
        object.__setattr__(self, "times", t)
        object.__setattr__(self, "position", y)
        if self.torque is not None:
            object.__setattr__(self, "torque", samples_of(self.name, "torques", self.torque))
        if t.ndim != 1 or t.shape != y.shape:
            rows = f"rows, equally many, not {t.shape} and {y.shape}; a table gives one of its columns, as table[:, 0]"
            raise InputError(f"{self.name}: times and positions must be {rows}")
        if not (np.isfinite(t).all() and np.isfinite(y).all()):
            finite = "finite numbers, not NaN, infinity or masked; leave out the samples that lack one"
            raise InputError(f"{self.name}: times and positions must be {finite}")
        for what, values in (("times", t), ("positions", y)):
            size = float(np.max(np.abs(values), initial=0.0))
            if size > LARGEST_SIZE or 0 < size < SMALLEST_SIZE:
                sizes = f"{SMALLEST_SIZE:g} to {LARGEST_SIZE:g}"
                raise InputError(f"{self.name}: {what} must lie in {sizes}, not near {size:g}")
        if self.torque is not None and (self.torque.shape != t.shape or not np.isfinite(self.torque).all()):
            raise InputError(f"{self.name}: torques must be finite numbers, as many as times")
        back = np.flatnonzero(t[1:] <= t[:-1])
        if back.size:
            i = int(back[0])
            raise InputError(
                f"{self.name}: time must increase from sample to sample, but {t[i + 1]:.10g} s follows {t[i]:.10g} s; "
                "order the samples by time, and leave out those that have one twice"
            )

    def after(self, start: float) -> Record:
        """The part from the time `start` [s] on."""
        kept = self.times >= start
        torque = None if self.torque is None else self.torque[kept]
        return Record(self.times[kept], self.position[kept], self.name, self.reading, torque)

    @property
    def duration(self) -> float:
        """From the first sample to the last [s]."""
        return float(self.times[-1] - self.times[0]) if self.times.size else 0.0

    def _columns(self) -> Columns:
        torque = {} if self.torque is None else {"torque_Nm": self.torque}
        return {"time_s": self.times, "position_rad": self.position, **torque}


def read_record(
    path: str | Path,
    *,
    time_unit: str | None = None,
    position_unit: str | None = None,
    time_column: str | None = None,
    position_column: str | None = None,
    skip: int | None = None,
    torque_column: str | None = None,
    current_column: str | None = None,
    torque_constant: float | None = None,
) -> Record:
    """A CSV file with times and positions, in s and rad; what it takes is what `measure` takes of a file.

    Commas, semicolons, tabs or blanks separate the columns; lines that begin with # are comments.  With a header, the
    columns named time (or t) and position (or pos, theta, angle) are taken, in the units stated there; otherwise the
    first two.  A preamble above the header is left out, and commas are decimal signs where they do not separate.
    Raises InputError.
    """
    path = Path(path)
    name = f"record {str(path)!r}"
    units = (
        None if time_unit is None else parsed_unit("time", time_unit, what="time-unit"),
        None if position_unit is None else parsed_unit("angle", position_unit, what="position-unit"),
    )
    wanted = torque_wanted(torque_column, current_column, torque_constant)
    read = _as_utf8(bounded(path, name, LARGEST_RECORD), name)
    head = _head(read, name, skip or 0)
    columns = _columns(name, head, time_column, position_column)
    if wanted is not None:
        columns += (column_of(name, *wanted, head.header, len(head.header or head.first)),)
    torque = None if wanted is None else torque_read(wanted[0], columns[2], head.header, torque_constant, name)
    taken = zip(QUANTITIES, columns, units, strict=False)
    time, position = (column_read(quantity, i, head.header, unit, name) for quantity, i, unit in taken)
    reading = Reading(time, position, head.preamble, head.decimal, torque)
    values = _samples(read, name, head, columns)
    with np.errstate(over="ignore", under="ignore"):  # Record refuses what comes of it
        t, y = values[:, 0] * time.unit.factor, values[:, 1] * position.unit.factor
        return Record(t, y, name, reading, None if torque is None else values[:, 2] * torque.unit.factor)


def _as_utf8(read: bytes, name: str) -> bytes:
    """Text in UTF-8, also that of instruments which write by the Western code page of Windows, such as an umlaut.

    Raises InputError: no text.
    """
    if read.isascii():
        return read
    try:
        read.decode()
        return read
    except UnicodeDecodeError:
        pass
    try:
        if b"\0" not in read:
            return read.decode("cp1252").encode()
    except UnicodeDecodeError:
        pass
    raise InputError(f"{name}: must be text (UTF-8 or Windows-1252); save it as CSV")


@dataclass(frozen=True)
class _Head:
    """What stands above the samples: the delimiter, the header or None, the first row, lines to skip; and how many
    of these are a preamble, and the decimal sign."""

    delimiter: str | None
    header: list[str] | None
    first: list[str]
    skip: int
    preamble: int = 0
    decimal: str = "."


def _head(read: bytes, name: str, skip: int) -> _Head:
    """What stands above the samples, with or without a preamble (layout.py)."""
    found = layout_of(read, skip)
    if found is None or not (found.preamble or found.decimal == "," or skip):
        return _plain_head(read, name)
    header: list[str] | None = None
    if found.header:
        header, below = found.header[0], found.header[-1]
        if len(found.header) == 2:
            header = _with_units(header, below) if _units(header, below) else below
    preamble = found.preamble + (len(found.header) == 2 and header == found.header[-1])
    width = len(found.header[0]) if found.header else 0
    first = [""] * width
    with text_of(read) as stream:
        for i, line in enumerate(stream, 1):
            if i > found.first and line.strip() and not line.lstrip().startswith("#"):
                first = _cells(name, i, line.rstrip("\r\n"), found.delimiter)
                break
    return _Head(found.delimiter, header, first, found.first, preamble + skip, found.decimal)


def _with_units(names: Sequence[str], units: Sequence[str]) -> list[str]:
    return [f"{a} [{b.strip('[]() ')}]" for a, b in zip(names, units, strict=True)]


def _plain_head(read: bytes, name: str) -> _Head:
    """The header is the first line without a number, with a line of units below it if there is one; or the last
    comment above the samples, as numpy.savetxt writes it."""
    comment = ""
    names: list[str] | None = None
    delimiter: str | None = None
    with text_of(read) as stream:
        for i, line in enumerate(stream, 1):
            text = line.strip()
            if not text or text.startswith("#"):
                comment = text.lstrip("# ") or comment
                continue
            if names is None:
                delimiter = next((d for d in ",;\t" if d in line), None)
            cells = _cells(name, i, line.rstrip("\r\n"), delimiter)
            if any(_float(cell) is not None for cell in cells) or (names is not None and not _units(names, cells)):
                # The comment above, where it has as many columns and names one of the two
                said = [cell.strip() for cell in (comment.split(delimiter) if comment else [])]
                known = _matching(said, _TIME, "time") is not None or _matching(said, _POSITION, "angle") is not None
                return _Head(delimiter, names or (said if known and len(said) == len(cells) else None), cells, i - 1)
            names = cells if names is None else _with_units(names, cells)
    if names is not None and len(names) < 2:
        raise _one_column(name, names)
    raise InputError(f"{name}: must hold samples, but {'is empty' if names is None else 'has a header only'}")


def _one_column(name: str, cells: Sequence[str]) -> InputError:
    hint = "; a servo file goes behind --servo" if cells[0].lstrip().startswith("[") else ""
    one = f"{cells[0][:40]!r}{hint}"
    return InputError(f"{name}: must have two columns, time [s] and position [rad], but has one: {one}")


def _units(names: Sequence[str], cells: Sequence[str]) -> bool:
    """A second line of the header with the unit of each column."""
    plain = all(split_header(cell)[1] is None for cell in names)
    return plain and len(names) == len(cells) and any(quantity_of(cell.strip("[]() ")) for cell in cells)


def _cells(name: str, number: int, line: str, delimiter: str | None) -> list[str]:
    if delimiter is None:
        return line.split()
    try:
        return next(csv.reader([line], delimiter=delimiter, skipinitialspace=True))
    except csv.Error as error:
        raise InputError(f"{name}, line {number}: cannot be read ({error})") from None


def _samples(read: bytes, name: str, head: _Head, columns: tuple[int, ...]) -> Array:
    """(m, columns) their values."""
    if head.decimal == ",":
        read = read.replace(b",", b".")
    try:
        with text_of(read) as stream:
            values = np.loadtxt(
                stream, delimiter=head.delimiter, usecols=columns, ndmin=2, quotechar='"', skiprows=head.skip
            )
        if np.isfinite(values).all():
            return values
    except ValueError:
        pass  # a cell that numpy cannot read: the walk below names it, or reads it
    rows = []
    with text_of(read) as stream:
        for i, line in enumerate(stream, 1):
            if i > head.skip and line.strip() and not line.lstrip().startswith("#"):
                row = _cells(name, i, line.rstrip("\r\n"), head.delimiter)
                rows.append([_cell(name, i, row, column) for column in columns])
    return np.array(rows)


def _float(cell: str) -> float | None:
    try:
        return float(cell)
    except ValueError:
        return None


def _columns(name: str, head: _Head, time: str | None, position: str | None) -> tuple[int, ...]:
    """Indices of time and position, as they are asked for or named."""
    if time is None and position is None:
        return _named_columns(name, head)
    width = len(head.header or head.first)
    asked = [None if a is None else column_of(name, w, a, head.header, width) for w, a in
             (("time", time), ("position", position))]  # fmt: skip
    taken = [i for i in asked if i is not None]
    if len(taken) == 1:
        if head.header is None:
            taken = [i if i is not None else int(taken[0] == 0) for i in asked]
        else:
            missing = "time" if asked[0] is None else "position"
            names, quantity = (_TIME, "time") if missing == "time" else (_POSITION, "angle")
            own = _matching(head.header, names, quantity)  # type: ignore[arg-type]
            if own is None:
                raise _no_column(name, missing, head.header)
            taken = [i if i is not None else own for i in asked]
    return taken[0], taken[1]


def _named_columns(name: str, head: _Head) -> tuple[int, int]:
    for cells in (head.header, head.first):
        if cells is not None and len(cells) < 2:
            raise _one_column(name, cells)
    if head.header is None:
        return 0, 1
    time, position = _matching(head.header, _TIME, "time"), _matching(head.header, _POSITION, "angle")
    if time is None and position is None:
        return 0, 1
    for what, here in (("time", time), ("position", position)):
        if here is None:
            raise _no_column(name, what, head.header)
    return time or 0, position or 0


def _no_column(name: str, what: str, header: Sequence[str]) -> InputError:
    """That no column is called so, and how it is named."""
    columns = ", ".join(header)
    return InputError(f"{name}: has no column {what!r} (columns: {columns}); say which it is, as --{what}-column NAME")


def _matching(header: Sequence[str], names: frozenset[str], quantity: Quantity) -> int | None:
    """The column that is named best: by one of the names alone, by one among other words, by a unit or a count."""
    best: tuple[int, int] | None = None
    for i, cell in enumerate(header):
        words, stated = split_header(cell)
        known = names.intersection(words)
        if known and not _NOT_MEASURED.intersection(words):
            rank = 0 if len(words) == 1 else 1
        elif not words and quantity_of(stated) == quantity:
            rank = 2
        elif not words and _COUNTS[quantity].intersection((stated or "").casefold().split()):
            rank = 3
        else:
            continue
        best = min(best, (rank, i)) if best else (rank, i)
    return best[1] if best else None


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
