"""The reference of the public names, from `__all__` of the public modules: a table and a page a name."""

from __future__ import annotations

from importlib import import_module
from pathlib import Path
from typing import Any

from casahunt.servo.parts import Part

MODULES = {
    "casahunt": "The servo",
    "casahunt.pictures": "Pictures",
    "casahunt.hybrid": "Any system",
    "casahunt.collocation": "Collocation",
    "casahunt.motion": "Its motion",
    "casahunt.orbits": "Its cycles",
    "casahunt.continuation": "Followed in parameters",
    "casahunt.servo.parts": "Loops from parts",
}
"""Public modules, with a heading."""


def write(folder: Path) -> None:
    """Write index.rst into a folder.

    Parameters
    ----------
    folder
        is made where it is missing.
    """
    lines = ["Python", "======", ""]
    told: list[Any] = []
    for module, heading in MODULES.items():
        room = import_module(module)
        names = [name for name in sorted(room.__all__, key=str.lower) if getattr(room, name) not in told]
        names = [name for name in names if not isinstance(getattr(room, name), Part | tuple)]  # parts_pages.py
        told += [getattr(room, name) for name in names]
        lines += [heading, "-" * len(heading), "", f".. currentmodule:: {module}", "", f"``{module}``", ""]
        lines += [".. autosummary::", "   :toctree: names", ""]
        lines += [f"   {name}" for name in names] + [""]
    folder.mkdir(parents=True, exist_ok=True)
    page, text = folder / "index.rst", "\n".join(lines)
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")
