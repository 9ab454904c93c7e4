"""What a result becomes outside: plain Python for JSON, CSV and pandas.

    number, truth value, text    themselves; of numpy, the plain one
    nan, inf                     None in JSON, which has neither; themselves in CSV and pandas
    complex                      [real part, imaginary part]
    Status                       its name in small letters
    array, tuple, list           a list; of a table, a column
    mapping                      a mapping with texts as keys; where the keys are no texts, a list of [key, value]
    another result               its mapping, without its table

A field of a CSV file, of which there is one writer:

    number        repr of the plain number: all its digits, so that float() gives the same number back
    not a number  nan, which float() and numpy read
    words         quoted where they hold a comma, a quote or a line break
    nothing       an empty field, for a word or a truth value that is not known (None)

A value of another kind is a mistake of the program and raises TypeError: what str() makes of it nobody can read back.
pandas is an extra: it is imported when it is first asked for.  A file is written whole or not at all.
"""

from __future__ import annotations

import csv
import dataclasses
from collections.abc import Callable, Iterable, Mapping, Sequence
from enum import Enum
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import IO, Any

import numpy as np

from .axis_units import NOT_EXPORTED
from .checks import finite_or_none
from .errors import InputError
from .files import whole_text

Columns = Mapping[str, Sequence[Any] | np.ndarray]
"""A table: its columns by name, all of one length."""
MAKER = "casahunt"
"""What files that name their program name."""
Rows = Iterable[Sequence[Any]]


def plain(value: Any, *, strict: bool = True) -> Any:
    """A value in plain Python.

    strict: as JSON has it: None for numbers that are not finite. Returns numbers, truth values, texts, None, and lists
    and mappings of them. Raises TypeError: a value of another kind, a mistake of the program.
    """
    if isinstance(value, np.ndarray | np.generic):
        value = value.tolist()
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, float):
        return finite_or_none(value) if strict else value
    if isinstance(value, complex):
        return [plain(value.real, strict=strict), plain(value.imag, strict=strict)]
    if isinstance(value, Enum):
        return value.name.lower()
    if hasattr(value, "to_dict"):
        return plain(value.to_dict(table=False, strict=False), strict=strict)
    if dataclasses.is_dataclass(value) and not isinstance(value, type):
        shown = [f.name for f in dataclasses.fields(value) if f.metadata != NOT_EXPORTED]
        value = {name: getattr(value, name) for name in shown}
    if isinstance(value, Mapping):
        if all(isinstance(key, str) for key in value):
            return {key: plain(item, strict=strict) for key, item in value.items()}
        return [[plain(key, strict=strict), plain(item, strict=strict)] for key, item in value.items()]
    if isinstance(value, Sequence):
        return [plain(item, strict=strict) for item in value]
    raise TypeError(f"{type(value).__name__}: cannot be exported")


def columns_from(names: Sequence[str], rows: Sequence[Sequence[Any]]) -> Columns:
    """A table from its rows; with its columns also where there is none."""
    return dict(zip(names, zip(*rows, strict=True), strict=True)) if rows else {name: () for name in names}


def write_csv(columns: Columns, path: str | Path) -> None:
    """A table as a CSV file.

    Raises InputError, OSError: as `files.whole_file`.
    """
    lists = [plain(column, strict=False) for column in columns.values()]
    with whole_text(path) as stream:
        table(stream, list(columns))(zip(*lists, strict=True))


def new_axes() -> Any:
    """Axes of a new matplotlib figure without a display; matplotlib is imported now."""
    return import_module("matplotlib.figure").Figure(layout="constrained").subplots()


def extra(module: str, name: str, method: str) -> ModuleType:
    """A module that comes with an extra.

    module, name: the module, and the extra that brings it.
    Raises InputError: it is not installed; says how to install it.
    """
    try:
        return import_module(module)
    except ImportError:
        package = module.split(".")[0]
        install = f'python -m pip install "casahunt[{name}]"'
        raise InputError(f"{method}: needs {package}, which is not installed; install it with {install}") from None


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
