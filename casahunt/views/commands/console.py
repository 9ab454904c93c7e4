"""What the commands share: arguments, checks of files and folders, and how numbers are shown.

Everything is checked before anything is computed, and refused in one sentence (errors.InputError).
"""

from __future__ import annotations

import argparse
import errno
import math
import os
import sys
import threading
import time
import warnings
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import IO, Any, Literal

from ...checks import known, quoted, sensible, shortened, to_error
from ...errors import InputError
from ...files import alone_in, unmake
from ...orbits.adapt import SOLVERS, TOLERANCE_RANGE
from ...servo.hunting import MODELS, Model
from ...servo.problem import HuntingOrbit
from ...servo.servo import Servo, load, with_overrides

TELL_EVERY, REMIND_EVERY = 2.0, 10.0
"""Seconds between two lines of progress, and after which a long step is named again."""
PICTURE_SUFFIXES = (".png", ".pdf", ".svg")
"""Formats that --plot writes."""
_ARGPARSE_WORDS = {
    "expected one argument": "must be followed by a value",
    "ignored explicit argument": "takes no value, but was given",
}


def own_process() -> None:
    """Set up the process that the command line has for itself.

    Numbers that overflow on the way are dealt with where they do: numpy's warnings are not for the user.  Pictures are
    drawn into files, whatever backend is set for windows.  Any name of a file can be printed.

    Raises
    ------
    OSError : standard output is closed.
    """
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


class Parser(argparse.ArgumentParser):
    """Argument errors in the form of all other input errors."""

    def error(self, message: str) -> Any:
        """Raise InputError with argparse's message in our words."""
        text = message.removeprefix("argument ")
        for theirs, ours in _ARGPARSE_WORDS.items():
            text = text.replace(theirs, ours)
        raise InputError(f"{text} (see {self.prog} --help)")


def add_common(command: argparse.ArgumentParser, *, tol: bool = True) -> None:
    """The arguments that every command has; `tol`: those that compute to a tolerance have --tol."""
    low, high = TOLERANCE_RANGE
    command.add_argument("servo", nargs="?", metavar="SERVO.toml", help="servo file; default: Table 1 of the report")
    if tol:
        command.add_argument("--tol", default=1e-6, help=f"relative tolerance, {low:g} to {high:g} (default 1e-6)")
    command.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="override a value, e.g. friction.static=0.5"
    )
    command.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    command.add_argument("--quiet", action="store_true", help="no progress on standard error")


def add_solver(command: argparse.ArgumentParser) -> None:
    """The choice of the solver."""
    command.add_argument(
        "--solver", default="auto",
        help="auto (default: Newton, and IPOPT where a start is far off), or ipopt or newton: that one alone makes "
        "every solve; ipopt takes 2 to 4 times as long, down the unstable LuGre branch 10 times",
    )  # fmt: skip


def solver_of(options: argparse.Namespace) -> Literal["auto", "ipopt", "newton"]:
    """The solver of the command line."""
    return known("solver", options.solver, SOLVERS)  # type: ignore[return-value]


def models_of(options: argparse.Namespace) -> list[Model]:
    """The friction models of a command that may have several: each once, all where none is named."""
    models: list[Any] = [known("model", model, MODELS) for model in options.model or MODELS]
    if len(set(models)) != len(models):
        raise InputError(f"model = {', '.join(models)}: each model can be asked for once")
    return models


def servo_of(options: argparse.Namespace) -> Servo:
    """The servo of the command line: file or Table 1, with the overrides."""
    servo = load(options.servo) if options.servo is not None else Servo()
    return with_overrides(servo, options.set)


def finite(key: str, text: Any) -> float:
    """A finite number, or InputError."""
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{key} = {quoted(text)}: must be a finite number") from None
    if not math.isfinite(value):
        raise InputError(f"{key} = {shortened(str(text))}: must be a finite number, not NaN or infinity")
    return value


def positive(key: str, text: Any) -> float:
    """A gain, a time or a position in the range of `checks`, or InputError."""
    return sensible(key, finite(key, text))


def given(key: str, value: Any, example: str) -> Any:
    """A value that must be on the command line, or InputError with an example of it."""
    if value is None or value == []:
        raise InputError(f"{key}: must be given, for example {example}")
    return value


def gain_of(options: argparse.Namespace, example: str = "--gain 0.1") -> float:
    """The one gain of a command that must have one."""
    return positive("gain", given("gain", options.gain, example))


def picture_of(options: argparse.Namespace) -> Path | None:
    """The file of --plot."""
    return writable("plot", options.plot, PICTURE_SUFFIXES)


def writable(key: str, path: str | None, suffixes: tuple[str, ...]) -> Path | None:
    """A file that can be written; checked before anything is computed."""
    if path is None:
        return None
    target = Path(path)
    if target.suffix.lower() not in suffixes:
        raise InputError(f"{key} = {path!r}: the name must end in {' or '.join(suffixes)}")
    try:
        if not target.parent.is_dir():
            raise InputError(f"{key} = {path!r}: there is no folder {str(target.parent)!r}")
        if target.is_dir():
            raise InputError(f"{key} = {path!r}: must be a file, but is a folder")
    except OSError as error:
        raise InputError(f"{key} = {path!r}: cannot be written ({error.strerror})") from None
    present = target.exists()
    renamed = target.is_file() or not present  # a device or a pipe is written straight
    if not all(os.access(p, os.W_OK) for p in (*([target] if present else []), *([target.parent] if renamed else []))):
        raise InputError(f"{key} = {path!r}: cannot be written (no permission)")
    return target


def progress(quiet: bool) -> IO[str] | None:
    """Where progress goes."""
    return None if quiet else sys.stderr


def say(stream: IO[str] | None, text: str) -> None:
    """A line of progress."""
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


def complex_text(value: complex, error: float, floor: float = 0.0) -> str:
    """A multiplier as the user reads it, to the digits that its error vouches for, 8 at most.

    `error` is relative for those above 1 in size, absolute for smaller ones; `floor` a bound where no more is known.
    """
    if floor > 0:
        return f"below 1e{math.ceil(math.log10(floor))}"
    error = max(error, 1e-12) * max(1.0, abs(value))

    def part(x: float) -> str:
        return to_error(x, error / abs(x), most=8) if abs(x) > error else "0"

    if abs(value.imag) <= error:
        return part(value.real)
    return f"{part(value.real)}{'' if value.imag < 0 else '+'}{part(value.imag)}j"


class Outputs:
    """What a command leaves beside its printed result: data files, then the result, then pictures, which take longest.

    None of them takes anything from the others: where one cannot be written, because the disk is full or nobody reads
    the output any more, the others are, and the block ends with an exception that says what is missing.
    """

    def __init__(self) -> None:
        self.troubles: list[OSError | InputError] = []
        self._pictures: list[Callable[[], object]] = []

    def write(self, function: Callable[..., object], *arguments: Any) -> None:
        """Write a file now."""
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
            said = "; ".join(str(getattr(e, "strerror", None) or e) for e in self.troubles)
            first = self.troubles[0]
            raise OSError(first.errno, said) if isinstance(first, OSError) else InputError(said)


def complain(command: str, what: object) -> None:
    """An error message."""
    print(f"{command}: {what}", file=sys.stderr)


@contextmanager
def folder(path: str, files: Iterable[str]) -> Iterator[Path]:
    """The output folder for one run alone, made where it does not exist and unmade where nothing is written into it.

    What is in it already stays until something new of the same name (`files`) takes its place.
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
        for name in files:
            if (out / name).is_dir():
                raise InputError(f"{complaint}written into ({name} is a folder)")
    except BaseException:
        unmake(made)
        raise
    with alone_in(out, made):
        yield out


def progress_line(orbit: HuntingOrbit, mu: str = "") -> str:
    """Gain, amplitude, period, multiplier (mu, or lambda of a full cycle) and iterations of a point."""
    if not mu:
        mu = f"{orbit.multipliers.leading.real:+.4g}" if orbit.multipliers.trusted else "not trusted"
    gain = to_error(orbit.gain, max(orbit.parameter_error, 1e-8))
    amplitude = to_error(orbit.amplitude, orbit.amplitude_error, most=6)
    period = to_error(orbit.period, orbit.period_error, most=6)
    return (
        f"{orbit.model:7s} K = {gain}  amplitude = {amplitude} rad  period = {period} s  "
        f"{'mu' if orbit.half else 'lambda'} = {mu}  iterations = {orbit.iterations}"
    )
