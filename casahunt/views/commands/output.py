"""What a command gives: a table, a picture, JSON, or lines of 80 columns with words of the trade explained below."""

from __future__ import annotations

import argparse
import json
import re
import textwrap
from collections.abc import Collection, Iterable, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from typing import Any

from ...axis_units import shown
from ...errors import Status
from ...export import Columns, plain, write_csv
from ...results import Result
from ..answers.answer import HARD_SPACE, Answer
from ..glossary import sentence, words_in
from .progress import clear

LINE_WIDTH = 80
"""Columns of everything that is printed for a person."""
_DEEPEST = 30
"""Columns that the second line of a long one is indented by at most."""
_LABEL = re.compile(r" *\S.*?\S {2,}(?=\S)")
_TOGETHER = re.compile(
    r"(?<=\d) (?=(?:rad|[num]?m(?:/s)?|[mk]?N|V|1/s|s|%|Hz|degrees)(?:[ ,;)/]|$))|(?<=\d N) (?=m(?:[ ,;)/]|$))"
    r"|(?<=\S) (?=[=<>]=? \S)|(?<= [=<>]) |(?<=[<>]=) "
)
"""Spaces between a number and its unit, and around a sign of comparison: no line ends there."""
DETAILS = "details"
"""The heading of what --details adds."""
MEANINGS = "what the words mean (more: casahunt glossary)"


def wrapped(line: str, width: int = LINE_WIDTH) -> list[str]:
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
    lines = [shown().relabelled(line) for line in lines]
    for line in (*lines, *meanings(lines, said)):
        for part in wrapped(line):
            print(part)


def give(
    options: argparse.Namespace,
    found: Result | Mapping[str, Any],
    answer: Answer,
    *,
    table: Columns | None = None,
    picture: tuple[Any, ...] = (),
    said: Collection[str] = (),
) -> None:
    """Hand out what a command has found: --csv, --plot, and on standard output its JSON object or its lines.

    found: the result, or results and numbers by name; answer: what is said of it; table: None: there is none;
    picture: "module.function" of
    views/pictures and its arguments; said: as of `show`.
    """
    if options.csv and table is not None:
        options.outputs.write(write_csv, shown().columns(table), options.csv)
    if options.plot and picture:
        options.outputs.draw(lambda: draw(options.plot, *picture))
    clear()
    if options.json:
        print(json.dumps(_with_units(plain(found))))
    else:
        below = tuple(answer.details) if options.details else ()
        show((*answer.plain, *((DETAILS, *below) if below else ())), said)


def _with_units(record: dict[str, Any]) -> dict[str, Any]:
    """A JSON object, whose numbers are in SI; where the axis has units of its own, with what says in which."""
    units = shown()

    def relabelled(value: Any) -> Any:
        if isinstance(value, str):
            return units.relabelled(value)
        if isinstance(value, dict):
            return {key: relabelled(item) for key, item in value.items()}
        return [relabelled(item) for item in value] if isinstance(value, list) else value

    return record if units.plain else {**relabelled(record), "units": units.record()}


def tell_refusal(error: Exception) -> None:
    """The JSON object of a command that found nothing: why (refused, evidence); status, null where there is none."""
    status: Status | None = getattr(error, "status", Status.NOT_FOUND)
    why, evidence = getattr(error, "plain", str(error)), getattr(error, "evidence", "")
    record = {"status": status, "refused": why, "evidence": evidence or None}
    print(json.dumps(_with_units(plain(record))), flush=True)


def draw(path: Path, name: str, *arguments: Any) -> None:
    """Write what a function of views/pictures draws, by its "module.function"; matplotlib is loaded with it."""
    from ..pictures.plotting import save

    module, _, function = name.partition(".")
    save(getattr(import_module(f"..pictures.{module}", __package__), function)(*arguments), path)
