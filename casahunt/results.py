"""Results as a person meets them: one line, a table in a notebook, a mapping, a file.

A result says what it holds in a few words, and everything else follows from them:

    "period [s] ~ period_error"             an attribute, its unit, its estimated relative error
    "time_error [s]"                        without an error of its own
    "amplitude [rad] +- amplitude_error"    an absolute error, in the same unit
    "amplitude = orbit.amplitude [rad]"     a name for what is reached on a longer way; None where that breaks off
    "number_of_points = orbits.size"        how many there are; a method is called

The same attributes under the same names are in its line and in its mapping.  A number is shown to the digits that its
error vouches for (checks.to_error); where the error is 0 the number was given, where there is none to six digits.
"""

from __future__ import annotations

import html
import json
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import fields
from enum import Enum
from pathlib import Path
from typing import Any, ClassVar, NamedTuple

import numpy as np

from .axis_units import Units, units_of
from .checks import choice_of, error_text, shortened, to_absolute_error
from .errors import InputError
from .export import Columns, extra, new_axes, plain, write_csv
from .files import whole_text

_SAID = re.compile(
    r"(?P<name>\w+)(?: = (?P<path>[\w.]+))?(?: \[(?P<unit>[^\]]+)\])?(?: (?P<sign>~|\+-) (?P<error>[\w.]+))?"
)
UNESTIMATED_DIGITS, UNKNOWN_DIGITS = 6, 3
"""Digits of a number without an estimate of its error, and of one whose estimate is not finite."""
MOST_SHOWN = 7
"""Entries of a list that are shown; of a longer one, their number."""


class Quantity(NamedTuple):
    """One number or word of a result: name, value, unit, and absolute error (None: there is no estimate of one)."""

    name: str
    value: Any
    unit: str = ""
    error: float | None = None

    @property
    def text(self) -> str:
        """The value for a person."""
        value = self.value
        if isinstance(value, complex) and self.error is not None:
            parts = [Quantity(self.name, part, error=self.error).text for part in (value.real, value.imag)]
            return parts[0] if parts[1] == "0" else f"{parts[0]}{'' if parts[1][0] == '-' else '+'}{parts[1]}j"
        if isinstance(value, float | np.floating):
            x = float(value)
            if self.error is None or not math.isfinite(x):
                return f"{x:.{UNESTIMATED_DIGITS}g}"
            return to_absolute_error(x, self.error) if math.isfinite(self.error) else f"{x:.{UNKNOWN_DIGITS}g}"
        return _text(value)

def _text(value: Any) -> str:
    if isinstance(value, Enum):
        return value.name.lower().replace("_", " ")
    if isinstance(value, Mapping):
        words = [f"{key} {_text(item)}" for key, item in value.items()]
        return f"({', '.join(words)})" if len(words) <= MOST_SHOWN else f"{len(words)} values"
    if isinstance(value, np.ndarray | tuple | list):
        short = len(value) <= MOST_SHOWN
        return f"({', '.join(_text(item) for item in value)})" if short else f"{len(value)} values"
    if isinstance(value, float | complex | np.inexact):
        return f"{value:.{UNESTIMATED_DIGITS}g}"
    return str(value)


def html_table(caption: str, head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """A table for notebooks."""
    words = "".join(f"<th>{html.escape(word)}</th>" for word in head)
    cells = ["".join(f"<td>{html.escape(shortened(cell))}</td>" for cell in row) for row in rows]
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    caption = html.escape(caption)
    return f"<table><caption>{caption}</caption><thead><tr>{words}</tr></thead><tbody>{body}</tbody></table>"


class Result:
    """What every result can do; which attributes it shows and exports, its class says."""

    _quantities: ClassVar[tuple[str, ...]] = ()
    """What stands in the one line, too."""
    _details: ClassVar[tuple[str, ...]] = ()
    """What stands only in the mapping, and where it is a number or a word in the notebook's table."""

    def _columns(self) -> Columns:
        """The table of a result that is one, in SI of a rotary axis; without columns where it is none."""
        return {}

    def _more(self) -> dict[str, Any]:
        """What else the mapping holds."""
        return {}

    def quantities(self, details: bool = True) -> tuple[Quantity, ...]:
        """The numbers and words of the result.

        Parameters
        ----------
        details
            also those that its line leaves out.

        Returns
        -------
        Name, value, unit and estimated absolute error of each.
        """
        units = units_of(self).si
        return tuple(_quantity(self, said, units) for said in self._quantities + (self._details if details else ()))

    def __repr__(self) -> str:
        said = [f"{q.name.replace('_', ' ')} {q.text}{q.unit and ' '}{q.unit}" for q in self.quantities(details=False)]
        return f"<{type(self).__name__}: {', '.join(said)}>".replace("\n", " ")

    def _repr_html_(self) -> str:
        """The result as a table, for notebooks."""
        rows = [(q.name.replace("_", " "), q.text, _error_text(q.error), q.unit) for q in _words(self.quantities())]
        return html_table(type(self).__name__, ("", "value", "error", "unit"), rows)

    def to_dict(self, *, table: bool = True, strict: bool = True) -> dict[str, Any]:
        """The result in plain Python, as json.dumps takes it.

        Parameters
        ----------
        table
            with its table under "table", column by column, where it has one.
        strict
            None for nan and infinity, which JSON does not have; False leaves them.

        Returns
        -------
        Mapping from the names of attributes, "type" first; a Status is its name in small letters, a complex number a
        pair.  Numbers are in SI; in which units stands under "units", where the axis has others than a rotary one.
        """
        found: dict[str, Any] = {"type": type(self).__name__}
        for said in self._quantities + self._details:
            name, path, _, _, error = _parts(said)
            found[name] = _reached(self, path)
            if error:
                found[error.split(".")[-1] if path == name else f"{name}_error"] = _reached(self, error)
        found |= self._more()
        units = units_of(self)
        columns = units.si.columns(self._columns()) if table else {}
        if columns:
            found["table"] = columns
        if not units.plain:
            found["units"] = units.record()
        return {key: plain(value, strict=strict) for key, value in found.items()}

    def plot(self, across: str = "", up: str = "", *, ax: Any = None, **style: Any) -> Any:
        """Draw one column of its table over another: of an orbit, its first state over the time.

        Parameters
        ----------
        across, up
            names of columns of numbers; default: the first two.
        ax
            matplotlib axes; default: those of a new figure, which `casahunt.pictures.save` writes to a file.
        **style
            for `ax.plot`.

        Returns
        -------
        The axes.

        Raises
        ------
        InputError : there is no such column.
        """
        columns = {
            name: column for name, column in self._named_columns().items()
            if not any(isinstance(value, str | Enum) for value in column)
        }  # fmt: skip
        first, second, *_ = [*columns, "", ""]
        across, up = choice_of("column", across or first, columns), choice_of("column", up or second, columns)
        ax = new_axes() if ax is None else ax
        ax.plot(*(np.array(columns[name], dtype=float) for name in (across, up)), **style)
        ax.set(xlabel=across, ylabel=up)
        return ax

    def _named_columns(self) -> Columns:
        """Its table, in the units of its axis."""
        return units_of(self).columns(self._columns())

    def _table(self) -> Columns:
        """What `to_csv` writes: its table; where it has none, its numbers and words in rows."""
        columns = self._named_columns()
        if columns:
            return columns
        listed = list(_words(self.quantities()))
        return {
            "quantity": [q.name for q in listed],
            "value": [_text(q.value) if isinstance(q.value, Enum) else q.value for q in listed],
            "error": [math.nan if q.error is None else q.error for q in listed],
            "unit": [q.unit for q in listed],
        }

    def to_dataframe(self) -> Any:
        """The table of the result as a pandas.DataFrame; where it has none, name, value, error and unit in rows.

        Raises
        ------
        InputError : pandas is not installed.
        """
        # A table as a pandas.DataFrame
        columns = self._table()
        lists = {name: plain(column, strict=False) for name, column in columns.items()}
        return extra("pandas", "pandas", "to_dataframe").DataFrame(lists)

    def to_csv(self, path: str | Path) -> None:
        """Write the table of `to_dataframe` to a CSV file, all digits of every number; nothing of pandas is needed.

        Raises
        ------
        InputError, OSError : it cannot be written there, or the disk is full.
        """
        write_csv(self._table(), path)

    def to_json(self, path: str | Path) -> None:
        """Write `to_dict` to a JSON file.

        Raises
        ------
        InputError, OSError : it cannot be written there, or the disk is full.
        """
        text = json.dumps(self.to_dict(), indent=1, allow_nan=False, ensure_ascii=False)
        with whole_text(path) as stream:
            stream.write(text + "\n")


def tables_of(results: Sequence[Result]) -> Columns:
    """The tables of results of one kind, one below the other."""
    tables = [result._table() for result in results]
    return {name: [value for table in tables for value in table[name]] for name in tables[0]} if tables else {}


def _parts(said: str) -> tuple[str, str, str, str, str]:
    """(name, path, unit, sign of the error, path of the error) of an attribute as a class says it."""
    match = _SAID.fullmatch(said)
    assert match is not None, said
    name, path, unit, sign, error = (part or "" for part in match.group("name", "path", "unit", "sign", "error"))
    return name, path or name, unit, sign, error


def _reached(result: Any, path: str) -> Any:
    for name in path.split("."):
        if name == "size" and isinstance(result, tuple):
            result = len(result)
        elif result is not None:
            result = getattr(result, name)
    return result() if callable(result) else result


def _quantity(result: Any, said: str, units: Units) -> Quantity:
    name, path, unit, sign, error = _parts(said)
    unit = units.label(unit)
    value, size = _reached(result, path), _reached(result, error) if error else None
    if size is not None and sign == "~" and value is not None:
        size = size * abs(value)
    return Quantity(name, value, "" if value is None else unit, None if size is None else float(size))


def _words(quantities: tuple[Quantity, ...]) -> Iterator[Quantity]:
    """Those that are a number, a word or a truth value."""
    for q in quantities:
        if isinstance(q.value, str | int | float | Enum | np.generic) or q.value is None:
            yield q


def _error_text(error: float | None) -> str:
    return "" if error is None else "0" if error == 0 else error_text(error)


class Rows(Result):
    """A frozen record of n members: `names` (k) and `parameters` (n, k), arrays of results, `statuses`, `how`.

    Its table has a row for every member: the parameters, every array of n values by the singular of its name, a complex
    one as two columns, its real and its imaginary parts, and status and how.
    """

    _quantities = ("members = how.size", "names")
    _details = ("failures",)

    names: tuple[str, ...]
    parameters: np.ndarray
    statuses: tuple[Any, ...]
    how: tuple[str, ...]

    def _columns(self) -> Columns:
        n, columns = len(self.how), dict(zip(self.names, self.parameters.T, strict=True))
        for field in fields(self):  # type: ignore[arg-type]
            values, word = getattr(self, field.name), _singular(field.name)
            if field.name == "parameters" or not isinstance(values, np.ndarray) or values.shape[:1] != (n,):
                continue
            if np.iscomplexobj(values):
                columns |= {f"{word}_real": values.real, f"{word}_imag": values.imag}
                continue
            columns |= {word: values} if values.ndim == 1 else {
                f"{word} of {name}": column for name, column in zip(self.names, values.T, strict=False)
            }  # fmt: skip
        return {**columns, "status": self.statuses, "how": self.how}


def _singular(word: str) -> str:
    return f"{word[:-3]}y" if word.endswith("ies") else word.removesuffix("s")


def table_of(names: Sequence[str], rows: Any, known: Sequence[str], at: Callable[[Any], Any]) -> np.ndarray:
    """Rows (n, k) of parameters as numbers, each of which whoever has the parameters can have.

    names, rows: k names, and (n, k) values of them; known: the names that there are; at: takes (k,) values, and refuses
    those that cannot be. Raises InputError: an unknown name, a table of another shape, or values that are refused.
    """
    for name in names:
        choice_of("parameter", name, known)
    if not names or len(set(names)) < len(names):
        raise InputError(f"names = {list(names)!r}: must be at least one parameter, each once")
    try:
        table = np.array(rows, dtype=float)
    except (TypeError, ValueError):
        raise InputError(f"rows: must be a table of numbers with {len(names)} columns") from None
    if table.ndim != 2 or table.shape[1] != len(names):
        raise InputError(f"rows: must be a table with {len(names)} columns, not of shape {table.shape}")
    for i, row in enumerate(table):
        try:
            at(row)
        except InputError as error:
            raise InputError(f"row {i + 1} of {len(table)}: {error}") from None
    return table
