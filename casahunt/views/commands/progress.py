"""Where a command is, on standard error: one line that moves on a terminal; elsewhere, as in a log, milestones.

    say    a milestone: a line that stays, wherever it is read
    tell   where the command is: on a terminal the moving line takes it; in a log it stands after `LOG_FROM` seconds,
           and again each time as long as that has gone by once more: an hour has nine of them; with --details each

What is printed besides clears the moving line first (`clear`).
"""

from __future__ import annotations

import os
import shutil
import sys
import time
from collections.abc import Callable
from typing import IO

from ...axis_units import shown

TELL_EVERY = 2.0
"""Seconds between two reports of a computation that reports far too often."""
LOG_FROM = 10.0
"""Seconds after which a log hears where a command is for the first time."""
MOVE_EVERY = 0.1
"""Seconds between two states of the moving line: nobody reads faster."""


class Progress:
    """Where progress goes.

    Attributes
    ----------
    every : whether each state is a line that stays.
    moves : whether there is a terminal, with a line that moves.
    """

    def __init__(self, stream: IO[str], *, every: bool = False) -> None:
        self.every = every
        self._stream = stream
        self.moves = not every and stream.isatty() and os.environ.get("TERM", "") not in ("", "dumb")
        self._began = self._moved = time.monotonic()
        self._next = LOG_FROM
        self._width = 0

    def say(self, text: str) -> None:
        """A milestone."""
        self.clear()
        print(text, file=self._stream, flush=True)

    def tell(self, text: str) -> None:
        """Where the command is."""
        if self.moves:
            now = time.monotonic()
            if self._width and now - self._moved < MOVE_EVERY:
                return
            self._moved = now
            line = text[: shutil.get_terminal_size().columns - 1]
            self._stream.write("\r" + line.ljust(self._width))
            self._stream.flush()
            self._width = len(line)
            return
        gone = time.monotonic() - self._began
        if self.every or gone >= self._next:
            self._next = max(2 * self._next, gone)
            self.say(text)

    def clear(self) -> None:
        """Take the moving line away."""
        if self._width:
            self._stream.write("\r" + " " * self._width + "\r")
            self._stream.flush()
            self._width = 0


_AT: list[Progress] = []
"""The progress of the command under way; none where it goes nowhere."""


def begin(*, every: bool) -> None:
    """A command that says where it is begins; every: each state is a line that stays."""
    _AT[:] = [Progress(sys.stderr, every=every)]


def each_stays() -> bool:
    """Whether each state of the command under way is a line that stays."""
    return any(each.every for each in _AT)


def clear() -> None:
    """Take the moving line away, for what is printed now."""
    for each in _AT:
        try:
            each.clear()
        except (OSError, ValueError):  # nobody reads it any more
            return


def over() -> None:
    """A command has come to its end."""
    clear()
    _AT.clear()


def say(text: str) -> None:
    """A milestone of the command under way."""
    for each in _AT:
        each.say(shown().relabelled(text))


def tell(text: str) -> None:
    """Where the command under way is."""
    for each in _AT:
        each.tell(shown().relabelled(text))


def teller() -> Callable[[str], None]:
    """Reports of a computation that makes far too many: one every `TELL_EVERY` seconds is told, more on a terminal."""
    last = time.monotonic()

    def told(text: str) -> None:
        nonlocal last
        if time.monotonic() - last >= (MOVE_EVERY if any(each.moves for each in _AT) else TELL_EVERY):
            last = time.monotonic()
            tell(text)

    return told
