"""casahunt examples: the guides as notebooks, in a folder."""

from __future__ import annotations

import argparse
import json
from typing import Any

from ...checks import choice_of
from ..notebooks.guides import BEGIN, SECTIONS, Guide, guides
from ..notebooks.written import notebook, others
from .console import folder
from .output import show
from .output_paths import Signs, write_results


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = commands.add_parser("examples", help="write the guides as notebooks")
    command.add_argument("out", nargs="?", metavar="DIR", help="folder to write them into; default: only list them")
    command.add_argument("notebook", nargs="*", metavar="NAME", help="a notebook of the list; default: all")
    command.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    command.add_argument("--quiet", action="store_true", help="as in all commands; this one has no progress")
    command.set_defaults(results=lambda options: _signs(options.notebook))


def run(options: argparse.Namespace) -> int:
    """Write and print; returns the exit code.

    Raises InputError: there is no such notebook, the folder cannot be written into, or holds somebody's own.
    """
    chosen = _chosen(options.notebook)
    if options.out is not None:
        signs = _signs(options.notebook)
        with folder(options.out, signs) as out:
            texts = {f"{name}.ipynb": notebook(guide.cells) for name, guide in chosen.items()}
            options.outputs.write(write_results, out, signs, texts)
    if options.json:
        print(json.dumps({f"{name}.ipynb": guide.title for name, guide in chosen.items()}))
        return 0
    show(_listed(chosen) if options.out is None else _written(options.out, list(chosen)))
    return 0


def _chosen(names: list[str]) -> dict[str, Guide]:
    """The guides with some names; all without.  Raises InputError: there is no such guide."""
    every = guides()
    names = [name.removesuffix(".ipynb") for name in names]
    return {name: every[choice_of("notebook", name, every)] for name in names} or every


def _signs(names: list[str]) -> Signs:
    """What is written, and how it is known as our own.  Raises InputError: there is no such guide."""
    return {f"{name}.ipynb": others for name in _chosen(names)}


def _written(out: str, names: list[str]) -> list[str]:
    count = f"{len(names)} notebook{'s' if len(names) > 1 else ''}"
    begin = names[0] if BEGIN not in names else BEGIN
    return [f"wrote {count} into {out}", f"  open {begin}.ipynb there, as by: jupyter lab {out}/{begin}.ipynb"]


def _listed(chosen: dict[str, Guide]) -> list[str]:
    lines = ["casahunt examples DIR [NAME ...] writes these notebooks into a folder"]
    width = max(map(len, chosen))
    for kind, heading in SECTIONS.items():
        lines += ["", heading]
        lines += [f"  {name:{width}}  {guide.title}" for name, guide in chosen.items() if guide.kind == kind]
    return lines


