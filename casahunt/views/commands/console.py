"""What the commands share: the folder and the files that they write, and how numbers are shown."""

from __future__ import annotations

import errno
import gc
import os
import sys
import time
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

from ...axis_units import quantity, shown
from ...checks import to_error
from ...errors import InputError, NoOrbit
from ...files import alone_in, unmake
from ...orbits import Orbit
from ...servo.problem import HuntingOrbit
from ..answers.answer import short
from .output import meanings, wrapped
from .output_paths import Signs, keep_others
from .progress import clear, each_stays

COLLECT_EVERY = 10_000
"""New objects after which rings among them are looked for: with Python's own 700 it takes a twentieth of a diagram."""

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


class Outputs:
    """What a command leaves beside its printed result: data files, then the result, then pictures, which take longest.

    None of them takes anything from the others: where one cannot be written, because the disk is full or nobody reads
    the output any more, the others are, and the block ends with an exception that says what is missing.
    """

    def __init__(self) -> None:
        self.troubles: list[OSError | InputError] = []
        self._pictures: list[Callable[[], object]] = []
        self._began = time.perf_counter()

    @property
    def seconds(self) -> float:
        """How long the command has taken so far."""
        return time.perf_counter() - self._began

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


def complain(command: str, what: object, *, details: bool = False) -> None:
    """Print an error message, in one line.

    command, what: who complains, such as "casahunt orbit", and of what; details: with its evidence, where it has some.
    """
    clear()
    said = shown().relabelled(what.plain if isinstance(what, NoOrbit) and not details else str(what))
    print(f"{command}: {said}", file=sys.stderr)
    _COMPLAINTS.append(said)


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
def folder(path: str | None, results: Signs) -> Iterator[Path | None]:
    """The output folder for one run alone, made where it does not exist and unmade where nothing is written into it;
    None where none is asked for.

    What is in it already stays until something new of the same name takes its place.

    Raises InputError: it cannot be made or written into, holds what casahunt has not written, or another run is writing
    into it.
    """
    if path is None:
        yield None
        return
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


def orbit_line(orbit: Orbit, mu: str = "", vary: str = "gain") -> str:
    """A computed point, for progress: in short, or where each is a line that stays with its multiplier and iterations.

    mu: text for the multiplier; default: mu, or lambda of a full cycle; vary: the parameter that is told, for the gain.
    """
    whose = orbit.model if isinstance(orbit, HuntingOrbit) else "loop"
    if each_stays():
        if not mu:
            mu = f"{orbit.multipliers.leading.real:+.4g}" if orbit.multipliers.trusted else "not trusted"
        at = to_error(orbit.problem.value(vary), max(orbit.parameter_error, 1e-8))
        size = quantity(orbit.amplitude, "rad", lambda x: to_error(x, orbit.amplitude_error, most=6))
        return (
            f"{whose:7s} {'K' if vary == 'gain' else vary} = {at}  amplitude = {size}  "
            f"period = {to_error(orbit.period, orbit.period_error, most=6)} s  "
            f"{'mu' if orbit.half else 'lambda'} = {mu}  iterations = {orbit.iterations}"
        )
    value, amplitude, period = orbit.problem.value(vary), orbit.amplitude, orbit.period
    size = quantity(amplitude, "rad", short)
    return f"{whose}: {vary} {short(value)}, amplitude {size}, period {short(period)} s"
