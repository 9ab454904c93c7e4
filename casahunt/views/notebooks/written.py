"""A notebook as a file, and whether it is still as it was written.

    digest    SHA-256 of kinds and sources of all cells: what one has run keeps it, what one has changed does not
"""

from __future__ import annotations

import hashlib
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from .cells import Cell

NOTEBOOK_FORMAT, NOTEBOOK_MINOR = 4, 5
"""Version of the file format."""


def digest(cells: Sequence[Cell]) -> str:
    """What tells two contents apart, whatever was run; editors store a source as text or as its lines."""
    told = [[cell.get("cell_type"), "".join(cell.get("source", ""))] for cell in cells]
    return hashlib.sha256(json.dumps(told).encode()).hexdigest()


def notebook(cells: Sequence[Cell]) -> str:
    """The file with some cells."""
    numbered = [{"id": f"cell-{i:02}"} | cell for i, cell in enumerate(cells)]
    about = {"casahunt": {"digest": digest(cells)},
             "kernelspec": {"display_name": "Python 3", "language": "python", "name": "python3"},
             "language_info": {"name": "python"}}  # fmt: skip
    content: dict[str, Any] = {"cells": numbered, "metadata": about, "nbformat": NOTEBOOK_FORMAT,
                               "nbformat_minor": NOTEBOOK_MINOR}  # fmt: skip
    return json.dumps(content, indent=1, ensure_ascii=False) + "\n"


def others(path: Path) -> str:
    """Why a file is not to be written over: "" where it is a notebook as casahunt has written it, run or not."""
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        wrote, cells = content["metadata"]["casahunt"]["digest"], content["cells"]
        changed = wrote != digest(cells)
    except (OSError, ValueError, KeyError, TypeError, AttributeError):
        return "that casahunt did not write"
    return "that was changed since casahunt wrote it" if changed else ""
