"""What the commands share: progress, the folder and the files that they write, and how numbers are shown."""

from __future__ import annotations

import errno
import gc
import math
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any

from ...checks import known_decimals, to_absolute_error, to_error
from ...errors import InputError
from ...files import alone_in, unmake
from ...orbits import Orbit
from ...servo.problem import HuntingOrbit
from .output import meanings, wrapped
from .output_paths import Signs, keep_others

TELL_EVERY, REMIND_EVERY = 2.0, 10.0
"""Seconds between two lines of progress, and after which a long step is named again."""

COLLECT_EVERY = 10_000
"""New objects after which rings among them are looked for: with Python's own 700 it takes a twentieth of a diagram."""

MOST_DECIMALS = 4
"""Of a sensitivity in per cent of the gain."""
EVENT_WORDS = {
    "stop": "stops", "breakaway+": "breakaways forwards", "breakaway-": "breakaways backwards",
    "reversal": "reversals", "centre": "times the bristle slack",
}  # fmt: skip
"""How many of an event are told."""
_COMPLAINTS: list[str] = []
"""The error messages of the command under way."""


def own_process() -> None:
    """Set up the process that the command line has for itself.

    Numbers that overflow on the way are dealt with where they do: numpy's warnings are not for the user.  Pictures are
    drawn into files, whatever backend is set for windows.  Any name of a file can be printed.

    Rings of objects are looked for seldom: most of what is made stays.

    Raises OSError: standard output is closed.
    """
    gc.set_threshold(COLLECT_EVERY)
    if not sys.warnoptions:
        sys.warnoptions.append("ignore::RuntimeWarning")  # processes that are started from here take it over
        warnings.simplefilter("ignore", RuntimeWarning)
    os.environ.pop("MPLBACKEND", None)
    for number in range(3):  # a file that is opened later must not take the place of a closed stream
        try:
            os.fstat(number)
        except OSError:
            os.open(os.devnull, os.O_RDWR)
    closed = sys.stdout is None
    for name in ("stdout", "stderr"):
        stream = getattr(sys, name)
        if stream is None:
            setattr(sys, name, os.fdopen(os.open(os.devnull, os.O_WRONLY), "w", encoding="utf-8"))
        else:
            stream.reconfigure(errors="backslashreplace")
    if closed:
        raise OSError(errno.EBADF, "standard output is closed")


def progress(quiet: bool) -> IO[str] | None:
    """Where progress goes."""
    return None if quiet else sys.stderr


def say(stream: IO[str] | None, text: str) -> None:
    """Print a line of progress.

    stream, text: where to, None: nowhere; and the line.
    """
    if stream is not None:
        print(text, file=stream, flush=True)


def teller(stream: IO[str] | None) -> Callable[[str], None]:
    """Lines of progress of a computation that reports far too often: one every `TELL_EVERY` seconds is said."""
    last = time.monotonic()

    def tell(text: str) -> None:
        nonlocal last
        if time.monotonic() - last >= TELL_EVERY:
            last = time.monotonic()
            say(stream, text)

    return tell


@contextmanager
def telling(stream: IO[str] | None) -> Iterator[Callable[[str], None]]:
    """As `teller`; a step that takes longer than `REMIND_EVERY` seconds is named again and again, with its time."""
    tell = teller(stream)
    at, since = "", time.monotonic()
    done = threading.Event()

    def note(text: str) -> None:
        nonlocal at, since
        at, since = text, time.monotonic()
        tell(text)

    def remind() -> None:
        while not done.wait(REMIND_EVERY):
            text, long = at, time.monotonic() - since
            if not text or long < REMIND_EVERY:
                continue
            try:
                say(stream, f"{text} (for {long:.0f} s now)")
            except (OSError, ValueError):  # nobody reads it any more; the computation is not to end for that
                return

    if stream is not None:
        threading.Thread(target=remind, daemon=True).start()
    try:
        yield note
    finally:
        done.set()


def of_this(left: str, what: str, others: bool) -> str:
    """How long something will still take (effort.left), named where others follow.

    left, what: what `effort.left` says, and of what: "branch"; others: whether others follow.
    Returns ", about 12 s left" or ", about 12 s left of this branch".
    """
    return f"{left} of this {what}" if left and others else left


def complex_text(value: complex, error: float, floor: float = 0.0) -> str:
    """A multiplier as the user reads it, to the digits that its error vouches for, 8 at most.

    error: relative for those above 1 in size, absolute for smaller ones; floor: a bound where no more is known, else 0.
    Returns text such as "0.5+0.1j".
    """
    if floor > 0:
        return f"below 1e{math.ceil(math.log10(floor))}"
    error = max(error, 1e-12) * max(1.0, abs(value))

    def part(x: float) -> str:
        return to_absolute_error(x, error, most=8)

    if abs(value.imag) <= error:
        return part(value.real)
    return f"{part(value.real)}{'' if value.imag < 0 else '+'}{part(value.imag)}j"


def counted(names: Sequence[str]) -> str:
    """How many events there were, and of which."""
    listed = ", ".join(f"{names.count(name)} {EVENT_WORDS.get(name, name)}" for name in dict.fromkeys(names))
    return f"{len(names)}{f' ({listed})' if names else ''}"


def sensitivity_text(value: float, tol: float) -> str:
    """Per cent of the fold gain per per cent, to the tolerance, four decimals at most.

    value, tol: the elasticity, and the tolerance: it is known to that much and better.
    """
    return f"{value:+.{known_decimals(tol, MOST_DECIMALS)}f}"


class Outputs:
    """What a command leaves beside its printed result: data files, then the result, then pictures, which take longest.

    None of them takes anything from the others: where one cannot be written, because the disk is full or nobody reads
    the output any more, the others are, and the block ends with an exception that says what is missing.
    """

    def __init__(self) -> None:
        self.troubles: list[OSError | InputError] = []
        self._pictures: list[Callable[[], object]] = []

    def write(self, function: Callable[..., object], *arguments: Any) -> None:
        """Write a file now; what hinders that is kept for the end."""
        try:
            function(*arguments)
        except (OSError, InputError) as error:
            self.troubles.append(error)

    def draw(self, function: Callable[[], object]) -> None:
        """Draw a picture when the result has been printed."""
        self._pictures.append(function)

    def __enter__(self) -> Outputs:
        """The block runs the command, which prints its result."""
        return self

    def __exit__(self, kind: type[BaseException] | None, *_: object) -> None:
        if kind is not None and not issubclass(kind, OSError):
            return
        if kind is None:
            self.write(sys.stdout.flush)
        for draw in self._pictures:
            self.write(draw)
        if kind is None and self.troubles:
            # A reader that has gone is the least of several troubles.
            troubles = [e for e in self.troubles if not isinstance(e, BrokenPipeError)] or self.troubles[:1]
            said, first = "; ".join(str(getattr(e, "strerror", None) or e) for e in troubles), troubles[0]
            raise OSError(first.errno, said) if isinstance(first, OSError) else InputError(said)


def complain(command: str, what: object) -> None:
    """Print an error message, in one line.

    command, what: who complains, such as "casahunt orbit", and of what.
    """
    print(f"{command}: {what}", file=sys.stderr)
    _COMPLAINTS.append(str(what))


def explain_complaints(*, aloud: bool) -> None:
    """Explain the words of the trade in the error messages since the last call, once and below them.

    aloud: print it; what is wrong with a command line, and what a program reads, needs no explanation.
    """
    if aloud:
        for line in meanings(_COMPLAINTS):
            for part in wrapped(line):
                print(part, file=sys.stderr)
    _COMPLAINTS.clear()


@contextmanager
def folder(path: str, results: Signs) -> Iterator[Path]:
    """The output folder for one run alone, made where it does not exist and unmade where nothing is written into it.

    What is in it already stays until something new of the same name takes its place.

    Raises InputError: it cannot be made or written into, holds what casahunt has not written, or another run is writing
    into it.
    """
    complaint = f"out = {path!r}: the folder cannot be "
    if not path:
        raise InputError(f"{complaint}made (its name is empty)")
    out = Path(path)
    made: list[Path] = []
    try:
        try:
            made = [folder for folder in (out, *out.parents) if not folder.exists()]
            out.mkdir(parents=True, exist_ok=True)
        except FileExistsError:
            raise InputError(f"{complaint}made (a file of that name exists)") from None
        except OSError as error:
            raise InputError(f"{complaint}made ({error.strerror})") from None
        if not os.access(out, os.W_OK | os.X_OK):
            raise InputError(f"{complaint}written into (no permission)")
    except BaseException:
        unmake(made)
        raise
    with alone_in(out, made):
        keep_others(path, results)
        yield out


def progress_line(orbit: Orbit, mu: str = "", vary: str = "gain") -> str:
    """A computed point as a line of progress: gain, amplitude, period, multiplier and iterations.

    mu: text for the multiplier; default: mu, or lambda of a full cycle; vary: the parameter that is told, for the gain.
    """
    if not mu:
        mu = f"{orbit.multipliers.leading.real:+.4g}" if orbit.multipliers.trusted else "not trusted"
    value = to_error(orbit.problem.value(vary), max(orbit.parameter_error, 1e-8))
    amplitude = to_error(orbit.amplitude, orbit.amplitude_error, most=6)
    period = to_error(orbit.period, orbit.period_error, most=6)
    whose = orbit.model if isinstance(orbit, HuntingOrbit) else "loop"
    return (
        f"{whose:7s} {'K' if vary == 'gain' else vary} = {value}  amplitude = {amplitude} rad  period = {period} s  "
        f"{'mu' if orbit.half else 'lambda'} = {mu}  iterations = {orbit.iterations}"
    )
