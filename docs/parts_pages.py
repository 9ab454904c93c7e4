"""The reference of the parts that a loop is made of, read off the parts themselves: a section a file of the room."""

from __future__ import annotations

import inspect
from importlib import import_module
from pathlib import Path

from casahunt.servo import parts
from casahunt.servo.parts import REMEDIES, Part

ABOUT = """Parts of a loop
===============

What ``casahunt.servo.parts`` has. How a loop is made of them says :doc:`a guide </howto/parts>`, which of the remedies
to take :doc:`another one </howto/remedies>`.
"""


def write(folder: Path) -> None:
    """Write index.rst into a folder.

    Parameters
    ----------
    folder
        is made where it is missing.
    """
    lines = [ABOUT]
    for entry in inspect.cleandoc(parts.__doc__ or "").split("\n"):
        name, listed, about = entry.partition(".py ")
        if not listed:
            continue
        module = import_module(f"casahunt.servo.parts.{name}")
        source = inspect.getsource(module)
        own = {
            key: value
            for key, value in vars(module).items()
            if key in parts.__all__ and isinstance(value, Part) and f"\n{key} = " in source
        }
        if own:
            title = about.strip().capitalize()
            lines += [title, "-" * len(title), "", "::", ""]
            lines += [f"   {line}".rstrip() for line in inspect.cleandoc(module.__doc__ or "").split("\n")]
            lines += ["", ".. list-table::", "   :header-rows: 1", "", *_row("part", "states", "parameters")]
            for key, part in own.items():
                numbers = [f"``{name}`` = {value:.6g}" for name, value in part.parameters.items()]
                lines += _row(f"``{key}``", *map(_listed, ([f"``{name}``" for name in part.states], numbers)))
            lines += ["", *_measured(own)]
    folder.mkdir(parents=True, exist_ok=True)
    page, text = folder / "index.rst", "\n".join(lines) + "\n"
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")


def _row(*cells: str) -> list[str]:
    first, *others = cells
    return [f"   * - {first}", *(f"     - {cell}" for cell in others)]


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "none"


def _measured(own: dict[str, Part]) -> list[str]:
    """The remedies that these parts are, as `casahunt remedies` calls them."""
    said = {
        remedy.name: f"{remedy.name}: ``{remedy.size}``{remedy.unit and f' [{remedy.unit}]'}"
        for remedy in REMEDIES
        if remedy.part in own.values()
    }
    return [f"As a remedy, with what measures it: {'; '.join(said.values())}.", ""] if said else []
