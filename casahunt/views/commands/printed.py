"""What a command prints for a person: lines of 80 columns, words of the trade explained once below, and CSV tables."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Collection, Iterable, Sequence
from pathlib import Path
from typing import Any

from ...files import whole_text
from ...tables import Rows
from ...tables import table as csv_table
from ..glossary import sentence, words_in

LINE_WIDTH = 80
"""Columns of everything that is printed for a person."""
_DEEPEST = 30
"""Columns that the second line of a long one is indented by at most."""
_LABEL = re.compile(r" *\S.*?\S {2,}(?=\S)")
HARD_SPACE = "\N{NO-BREAK SPACE}"
"""Where a long line must not be broken; printed as a space."""
_TOGETHER = re.compile(
    r"(?<=\d) (?=(?:rad|N|V|1/s|s|%|Hz|degrees)(?:[ ,;)/]|$))|(?<=\S) (?=[=<>]=? \S)|(?<= [=<>]) |(?<=[<>]=) "
)
"""Spaces between a number and its unit, and around a sign of comparison: no line ends there."""
MEANINGS = "what the words mean (more: casahunt glossary)"


def folded(line: str, width: int = LINE_WIDTH) -> list[str]:
    """A line as several of at most `width` columns, the further ones below the text behind its label.

    A single word that is longer, such as a path that somebody will copy, stays whole on a line of its own.

    line: the line; a label ends in two spaces.
    """
    if len(line) <= width:
        return [line.replace(HARD_SPACE, " ")]
    line = _TOGETHER.sub(HARD_SPACE, line)
    label = _LABEL.match(line)
    hang = label.end() if label else len(line) - len(line.lstrip(" ")) + 2
    indent = " " * min(hang, _DEEPEST)
    parts = textwrap.wrap(
        line, width, subsequent_indent=indent, break_on_hyphens=False, break_long_words=False, replace_whitespace=False
    )
    return [part.replace(HARD_SPACE, " ") for part in parts]


def meanings(lines: Sequence[str], said: Collection[str] = ()) -> list[str]:
    """The lines that explain the words of the trade in `lines`; none where there is nothing to explain.

    Returns lines, a heading first.
    """
    words = [word for word in words_in("\n".join(lines)) if word not in said]
    return [MEANINGS, *(f"  {sentence(word)}" for word in words)] if words else []


def show(lines: Iterable[str], said: Collection[str] = ()) -> None:
    """Print the result of a command.

    said: words of the trade that they explain themselves.
    """
    lines = list(lines)
    for line in (*lines, *meanings(lines, said)):
        for part in folded(line):
            print(part)


def write_table(path: Path, columns: Sequence[str], rows: Rows) -> None:
    """Write a table, whole or not at all.

    path, columns, rows: the file, the names of the columns with their units, and rows of numbers, texts or None.
    Raises InputError, OSError: as `whole_text`.
    """
    with whole_text(path) as stream:
        csv_table(stream, columns)(rows)


def write_records(path: Path, records: Sequence[dict[str, Any]]) -> None:
    """`write_table` for rows that carry the names of their columns.

    path, records: the file, and one row or more; all have the same columns.
    """
    write_table(path, list(records[0]), [list(record.values()) for record in records])
