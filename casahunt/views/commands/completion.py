"""What the shell offers at the TAB key, by argcomplete (`pip install "casahunt[completion]"`).

    eval "$(register-python-argcomplete casahunt)"     # in ~/.bashrc

argcomplete asks the program itself, with _ARGCOMPLETE in its environment: without that nothing here is imported.
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Iterable
from typing import Any

from ...design.sensitivity import NAMES
from ...design.tune.demands import COSTS, NUMBERS
from ...orbits import Options
from ...servo.find_orbit import BRANCHES
from ...servo.hunting import MODELS
from ...servo.parts.table import REMEDY_NAMES
from ...servo.servo import KEYS
from ..glossary import GLOSSARY
from ..notebooks.guides import guides
from .orbit import ROUTES
from .output_paths import WRITTEN

FILES = {
    "servo": (".toml",),
    "uncertainty": (".toml",),
    "file": (".csv",),
    "records": (".csv",),
    **WRITTEN,
}
"""By the name of an argument: the endings of the files that it takes."""
WORDS = {
    "model": MODELS,
    "branch": BRANCHES,
    "solver": Options.SOLVERS,
    "multipliers": ROUTES,
    "cost": tuple(COSTS),
    "free": tuple(NUMBERS),
    "vary": NAMES,
    "only": REMEDY_NAMES,
    "and": NAMES,
    "sought": NAMES,
    "word": tuple(GLOSSARY),
    "notebook": tuple(guides()),
}
"""By the name of an argument: the words that it takes."""
ASSIGNED = {"set": KEYS, "bounds": ("gain", *NUMBERS)}
"""By the name of an argument: the words in front of its "="."""


def offered(words: Iterable[str], end: str = "") -> Callable[..., list[str]]:
    """A completer for words.

    Returns function for argcomplete.
    """

    def complete(prefix: str, **_: Any) -> list[str]:
        return [f"{word}{end}" for word in words if word.startswith(prefix)]

    return complete


def completers(parser: argparse.ArgumentParser) -> None:
    """Give every argument of a parser, and of the commands in it, what it is completed by."""
    import argcomplete

    for action in parser._actions:
        if isinstance(action, argparse._SubParsersAction):
            for command in action.choices.values():
                completers(command)
        elif action.dest in FILES:
            _set(action, argcomplete.completers.FilesCompleter(FILES[action.dest]))
        elif action.dest in ASSIGNED:
            _set(action, offered(ASSIGNED[action.dest], "="))
        elif action.dest in WORDS:
            _set(action, offered(WORDS[action.dest]))
        elif action.dest == "out":
            _set(action, argcomplete.completers.DirectoriesCompleter())
        elif action.option_strings:  # a number: no names of files
            _set(action, argcomplete.completers.SuppressCompleter())


def _set(action: argparse.Action, completer: Any) -> None:
    action.completer = completer  # type: ignore[attr-defined]


def answer(parser: argparse.ArgumentParser) -> None:
    """Answer the shell's question and end the process; nothing where argcomplete is not installed."""
    try:
        import argcomplete
    except ImportError:
        return
    completers(parser)
    argcomplete.autocomplete(parser, always_complete_options="long")
