"""The reference of the parts that a loop is made of, read off the parts themselves: a page a file of the room."""

from __future__ import annotations

import inspect
from dataclasses import replace
from importlib import import_module
from pathlib import Path

from casahunt import Servo, pictures, remedies
from casahunt.servo import parts
from casahunt.servo.parts import REMEDIES, Part, Remedy
from casahunt.servo.units import kinds_of

ABOUT = """Parts of a loop
===============

What ``casahunt.servo.parts`` has. How a loop is made of them says :doc:`a guide </howto/parts>`, which of the remedies
to take :doc:`another one </howto/remedies>`.

.. toctree::
   :maxdepth: 1

"""
SERVO, GAIN = Servo(), 0.04
"""Table 1's servo, and the gain at which sets of rest positions are drawn [V/rad]."""


def write(folder: Path) -> None:
    """Write index.rst, a page for each file with parts or remedies, and pictures of where they let the servo rest.

    Parameters
    ----------
    folder
        is made where it is missing.
    """
    folder.mkdir(parents=True, exist_ok=True)
    pages = {}
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
        cures = [remedy for remedy in getattr(module, "REMEDIES", ()) if name != "table"]
        if own or cures:
            pages[name] = _page(about.strip().capitalize(), module.__doc__ or "", own, cures)
    _draw(folder)
    _keep(folder / "index.rst", ABOUT + "".join(f"   {name}\n" for name in pages))
    for name, text in pages.items():
        _keep(folder / f"{name}.rst", text)


def _page(title: str, about: str, own: dict[str, Part], cures: list[Remedy]) -> str:
    """What it does with its equations, parameters with units and defaults, rest positions where it is a remedy."""
    lines = [title, "=" * len(title), "", "::", ""]
    lines += [f"   {line}".rstrip() for line in inspect.cleandoc(about).split("\n")]
    if own:
        lines += ["", ".. list-table::", "   :header-rows: 1", ""]
        lines += _row("part", "in a file", "states", "parameters, by default")
    for key, part in own.items():
        numbers = [f"``{name}`` = {value:.6g} {kinds_of(name)[0]}".rstrip() for name, value in part.parameters.items()]
        states = [f"``{name}``" for name in part.states]
        lines += _row(f"``{key}``", f'``"{part.name}"``', *map(_listed, (states, numbers)))
    for name in dict.fromkeys(remedy.name for remedy in cures):
        remedy = next(remedy for remedy in cures if remedy.name == name)
        unit = f" [{remedy.unit}]" if remedy.unit else ""
        lines += [
            "", f"As the remedy ``{name}`` its size is ``{remedy.size}``{unit}. Where the servo of Table 1 may then "
            f"rest at K = {GAIN:g} V/rad, with the size to choose (or, where none ends it, the last one looked at):",
            "", f".. image:: {_file(name)}", f"   :alt: error and torque at which the servo rests with {name}",
            "   :width: 340px",
        ]  # fmt: skip
    return "\n".join(lines) + "\n"


def _file(name: str) -> str:
    return f"rests_{name.replace(' ', '_')}.png"


def _draw(folder: Path) -> None:
    """The pictures that are missing."""
    names = dict.fromkeys(remedy.name for remedy in REMEDIES if "switch" in remedy.needs)
    if missing := [name for name in names if not (folder / _file(name)).exists()]:
        found = remedies(SERVO, "switch", GAIN, only=missing)
        for row in found.remedies:
            pictures.save(pictures.rest_positions(replace(found, remedies=(row,))), folder / _file(row.name))


def _keep(page: Path, text: str) -> None:
    """Write a page, unless it is there already as it should be."""
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")


def _row(*cells: str) -> list[str]:
    first, *others = cells
    return [f"   * - {first}", *(f"     - {cell}" for cell in others)]


def _listed(names: list[str]) -> str:
    return ", ".join(names) or "none"
