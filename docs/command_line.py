"""The reference of the command line, read off the parser itself: one page, one section a command."""

from __future__ import annotations

import os
from pathlib import Path


def write(folder: Path) -> None:
    """Write index.md into a folder.

    Parameters
    ----------
    folder
        is made where it is missing.
    """
    os.environ["COLUMNS"] = "80"  # what argparse wraps at
    from casahunt.cli import build_parser

    top = build_parser()
    commands = next(action for action in top._actions if hasattr(action, "choices") and action.choices)
    lines = ["# Command line", "", "What `casahunt COMMAND --help` says."]
    lines += ["", "```text", top.format_help().rstrip(), "```"]
    for name, command in commands.choices.items():
        lines += ["", f"## casahunt {name}", "", "```text", command.format_help().rstrip(), "```"]
    folder.mkdir(parents=True, exist_ok=True)
    page = folder / "index.md"
    text = "\n".join(lines) + "\n"
    if not page.exists() or page.read_text(encoding="utf-8") != text:
        page.write_text(text, encoding="utf-8")
