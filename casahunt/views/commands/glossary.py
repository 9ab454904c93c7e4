"""casahunt glossary: the words of the trade, each in a sentence."""

from __future__ import annotations

import argparse
import json
from typing import Any

from ...checks import choice_of
from ..glossary import CHAPTERS, GLOSSARY, sentence
from .output import show


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = commands.add_parser("glossary", help="what the words of the trade mean")
    command.add_argument("word", nargs="*", metavar="WORD", help="a word of it; default: all")
    command.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    command.add_argument("--quiet", action="store_true", help="as in all commands; this one has no progress")


def run(options: argparse.Namespace) -> int:
    """Print; returns the exit code."""
    asked = " ".join(options.word)
    names = {word.lower(): word for word in GLOSSARY}
    words = [names[choice_of("word", asked.lower(), names)]] if asked else list(GLOSSARY)
    if options.json:
        print(json.dumps({word: GLOSSARY[word] for word in words}))
        return 0
    if asked:
        lines = [sentence(word) for word in words]
    else:
        chapters = CHAPTERS.items()
        lines = [line for heading, part in chapters for line in (heading, *(f"  {sentence(word)}" for word in part))]
    show(lines, said=GLOSSARY)
    return 0
