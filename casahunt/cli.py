"""The command line: casahunt COMMAND, one module of views/commands for each.

Results go to standard output (with --json one JSON object and nothing else), progress to standard error.
Exit codes: 0 done; 1 no such orbit or no convergence, with what was tried and what to do; 2 the input is
wrong, and nothing has been written; 130 interrupted (143: terminated), what was computed is on disk; 141 nobody
reads the output any more.

Numbers that are not to be trusted are left out: null in JSON, nan or an empty field in CSV.
"""

from __future__ import annotations

import argparse
import gc
import math
import os
import sys
from collections.abc import Sequence
from contextlib import suppress
from importlib import import_module
from itertools import pairwise
from typing import Any

from . import effort, interrupts
from .axis_units import Units, shown_in
from .checks import choice_of
from .errors import InputError, NoOrbit
from .views.commands.arguments import Asked, Parser
from .views.commands.console import Outputs, complain, explain_complaints, own_process
from .views.commands.output import tell_refusal
from .views.commands.output_paths import keep_inputs
from .views.commands.progress import begin, over, tell

COMMANDS = (
    "orbit",
    "diagram",
    "fold",
    "fold-curve",
    "fold-map",
    "loop",
    "remedies",
    "equilibria",
    "map",
    "basin",
    "simulate",
    "record",
    "identify",
    "cure",
    "uncertainty",
    "tune",
    "explore",
    "glossary",
)
"""Each is a module of views/commands, loaded when it is called or when all of them are listed."""
SAY_THEMSELVES = ("map", "tune", "uncertainty", "fold-curve", "fold-map", "remedies", "identify", "cure")
"""Commands with lines of their own about where they are."""
ONE_ANSWER = ("orbit", "fold", "basin", "simulate", "equilibria", "loop", "map", "record", "identify")
"""Commands that compute one thing; the others go on as long as there is more, and keep what they have."""
PIPE_CLOSED = 141
"""Exit code where nobody reads the output any more, as of a process that SIGPIPE ends: 128 + 13."""
MOST_WORK = 1e7
"""Work (effort.py) after which one thing is given up: four to five minutes of a processor."""


class _Version(argparse.Action):
    """Look the version up when it is asked for, not at every start."""

    def __call__(self, parser: Any, namespace: Any, values: Any, option_string: str | None = None) -> None:
        from . import __version__

        print(f"casahunt {__version__}")
        parser.exit()


def build_parser(names: Sequence[str] = COMMANDS) -> Parser:
    """The parser of some commands; default all."""
    parser = Parser(
        prog="casahunt",
        description="Will this servo hunt, and at which gain does it stop? Limit cycles of a servo with dry friction.",
        allow_abbrev=False,
    )
    nowhere = argparse.SUPPRESS
    parser.add_argument("--version", action=_Version, nargs=0, dest=nowhere, default=nowhere, help="print the version")
    commands = parser.add_subparsers(dest="command", required=True, parser_class=Parser, metavar="COMMAND")
    for name in names:
        _module(name).add(commands)
    return parser


def _module(name: str) -> Any:
    return import_module(f".views.commands.{name.replace('-', '_')}", __package__)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    command = f"casahunt {words[0]}" if words and words[0] in COMMANDS else "casahunt"
    try:
        interrupts.begin()
        explain_complaints(aloud=False)  # of a command that was interrupted
        over()  # of a command that was interrupted
        with shown_in(Units()):
            code = _run(command, words, program=arguments is None)
        over()
        with suppress(OSError):
            explain_complaints(aloud=code == 1 and not {"--quiet", "--json"}.intersection(words))
        interrupts.check()
        interrupts.end()
        if arguments is None:
            gc.freeze()  # the system takes all back at once: to look for rings among all objects first takes 0.2 s
    except KeyboardInterrupt as error:
        interrupts.end()
        complain(command, str(error) or interrupts.word())
        return interrupts.leave()
    return code


def _run(command: str, words: list[str], *, program: bool) -> int:
    """The exit code of everything but an interrupt; `program`: this is the process's own command line."""
    try:
        if program:
            own_process()
        options = _parsed(words)
        name = options.command
        if not options.quiet:
            begin(every=getattr(options, "details", False))
        note = None if name in SAY_THEMSELVES else tell
        limit = MOST_WORK if name in ONE_ANSWER else math.inf
        keep_inputs(options)
        try:
            with Outputs() as options.outputs, effort.counting_work(note, limit=limit):
                options.show()
                return _module(name).run(options)
        except (NoOrbit, effort.GivenUp) as error:
            interrupts.check()
            complain(command, error, details="--details" in words)
            if "--json" in words:
                tell_refusal(error)
            return 1
    except InputError as error:
        interrupts.check()
        complain(command, error)
        return 2
    except OSError as error:  # a full disk, or nobody who reads the output any more (head), which needs no words
        interrupts.check()
        # What is still in the buffer would be complained about once more while the interpreter shuts down.
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if isinstance(error, BrokenPipeError):
            return PIPE_CLOSED
        complain(command, f"the output could not be written: {error.strerror or error}")
        return 1
    except Exception:  # what a library has made of an interrupt is one
        interrupts.check()
        raise


def _parsed(words: list[str]) -> Asked:
    """The options of a command line, with a suggestion for every misspelt word."""
    if not words:
        raise InputError(f"a command must be given: {', '.join(COMMANDS)} (see casahunt --help)")
    if words[0] == "help":
        words = [*words[1:2], "--help"]
    named = not words[0].startswith("-")
    if named:
        choice_of("command", words[0], COMMANDS)
    parser = build_parser(words[:1] if named else COMMANDS)
    words = _joined(words)
    if named:  # a misspelt option is named before one that must be given is missed
        names = [name for name in parser.options_of(words[0]) if name.startswith("--") and name != "--help"]
        for word in words[1 : words.index("--") if "--" in words else None]:
            if word.startswith("--") and word != "--help":
                _known(word.partition("=")[0], names)
    try:
        options, unknown = parser.parse_known_args(words, Asked())
    except InputError:
        _keys_known(words)  # a misspelt key too, but of a file, whose loop has names of its own
        raise
    if unknown:
        if unknown[0].startswith("-"):
            raise InputError(f"unknown option {unknown[0]!r} (see casahunt {words[0]} --help)")
        if len(unknown) > 1 or getattr(options, "servo_file", "") is not None:
            raise InputError(f"{unknown[-1]!r}: must be left out, one servo file is enough")
        options.servo_file = unknown[0]  # behind a file and options, where argparse no longer looks for it
    return options


def _known(option: str, names: list[str]) -> None:
    """Raises InputError: a command has no such option; with how a number of the servo file is given."""
    if "--set" in names and option not in names:
        from .servo.servo import KEYS

        name = option[2:].replace("-", "_")
        if key := next((key for key in KEYS if key.split(".")[1] == name), ""):
            raise InputError(f"unknown option {option!r}: a number of the servo file is given by --set {key}=VALUE")
    choice_of("option", option, names)


def _keys_known(words: list[str]) -> None:
    """Raises InputError: a key of --set is none of a servo's, and no file is named that might have others."""
    from .servo.drive import DRIVE_KEYS, DRIVE_TABLE
    from .servo.servo import KEYS

    if any(word.endswith(".toml") for word in words):
        return
    keys = [word for before, word in pairwise(words) if before == "--set"]
    keys += [word.removeprefix("--set=") for word in words if word.startswith("--set=")]
    for key in keys:
        choice_of("key", key.partition("=")[0].strip(), [*KEYS, *(f"{DRIVE_TABLE}.{name}" for name in DRIVE_KEYS)])


def _joined(words: list[str]) -> list[str]:
    """`--gain -inf` as `--gain=-inf`: argparse takes what begins with a minus for an option."""
    joined: list[str] = []
    for word in words:
        if joined and word.startswith("-") and joined[-1].startswith("--") and "=" not in joined[-1]:
            with suppress(ValueError):
                float(word)
                joined[-1] += f"={word}"
                continue
        joined.append(word)
    return joined
