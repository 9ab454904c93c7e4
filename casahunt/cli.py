"""The command line: casahunt orbit | diagram | fold.

Results go to standard output (with --json one JSON object and nothing else), progress to standard error.
Exit codes: 0 done; 1 no such orbit or no convergence, with what was tried and what to do; 2 the input is
wrong, and nothing has been written; 130 interrupted, what was computed is on disk.

Numbers that are not to be trusted are left out: null in JSON, nan or an empty field in CSV.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import os
import sys
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import IO, Any

from . import __version__
from .adapt import TOLERANCE_RANGE, Options
from .archive import save_branch, save_orbit
from .branch import Branch, SpecialPoint
from .checks import known, require
from .diagram import DEFAULT_START, DiagramPoint, diagram
from .errors import InputError, NoOrbit
from .find import BRANCHES, find_orbit
from .fold import find_fold
from .hunting import MODELS
from .monitor import FOLD
from .orbit import Orbit
from .servo import Servo, load, with_overrides

COMMANDS = ("orbit", "diagram", "fold")
PICTURES = ("diagram.png", "multipliers.png", "time_traces.png", "phase_portrait.png")
"""What `casahunt diagram` draws."""
CSV_COLUMNS = (
    "gain",
    "amplitude_rad",
    "period_s",
    "half_multiplier",
    "log10_abs_half_multiplier",
    "stable",
    "trivial_multiplier_error",
    "error_estimate",
    "status",
    "unknowns",
    "iterations",
    "special",
)


_ARGPARSE_WORDS = {
    "expected one argument": "must be followed by a value",
    "ignored explicit argument": "takes no value, but was given",
}


class _Parser(argparse.ArgumentParser):
    """Argument errors in the form of all other input errors."""

    def error(self, message: str) -> Any:
        text = message.removeprefix("argument ")
        for theirs, ours in _ARGPARSE_WORDS.items():
            text = text.replace(theirs, ours)
        raise InputError(f"{text} (see {self.prog} --help)")


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    parser = _Parser(
        prog="casahunt",
        description="Will this servo hunt, and at which gain does it stop? Limit cycles of a servo with dry friction.",
        allow_abbrev=False,
    )
    parser.add_argument("--version", action="version", version=f"casahunt {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, parser_class=_Parser, metavar="COMMAND")

    orbit = commands.add_parser("orbit", allow_abbrev=False, help="the hunting cycle at one gain")
    _common(orbit)
    orbit.add_argument("--model", default="switch", help="switch (default) or lugre")
    orbit.add_argument("--gain", help="controller gain K, to be given")
    orbit.add_argument("--branch", default="stable", help="stable (default) or unstable")
    orbit.add_argument("--full", action="store_true", help="solve the full cycle, without using its symmetry")
    orbit.add_argument("--solver", default="ipopt", help="ipopt (default) or newton, for the first solve")
    orbit.add_argument("--plot", metavar="F.png", help="write a picture of one period")
    orbit.add_argument("--save", metavar="F.npz", help="write the orbit")

    picture = commands.add_parser(
        "diagram", allow_abbrev=False, help="amplitude and period against the gain, round the fold"
    )
    _common(picture)
    picture.add_argument("--model", action="append", help="switch or lugre; repeat for both (default both)")
    picture.add_argument(
        "--from", dest="start", default=DEFAULT_START, metavar="K", help=f"gain to start from (default {DEFAULT_START})"
    )
    picture.add_argument("--out", default="casahunt-diagram", metavar="DIR", help="folder to write into")

    fold = commands.add_parser("fold", allow_abbrev=False, help="the largest gain at which the servo can hunt")
    _common(fold)
    fold.add_argument("--model", default="switch", help="switch (default) or lugre")
    return parser


def _common(command: argparse.ArgumentParser) -> None:
    low, high = TOLERANCE_RANGE
    command.add_argument("servo", nargs="?", metavar="SERVO.toml", help="servo file; default: Table 1 of the report")
    command.add_argument("--tol", default=1e-6, help=f"relative tolerance, {low:g} to {high:g} (default 1e-6)")
    command.add_argument(
        "--set", action="append", default=[], metavar="KEY=VALUE", help="override a value, e.g. friction.static=0.5"
    )
    command.add_argument("--json", action="store_true", help="print one JSON object and nothing else")
    command.add_argument("--quiet", action="store_true", help="no progress on standard error")


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    words = list(sys.argv[1:] if arguments is None else arguments)
    command = f"casahunt {words[0]}" if words and words[0] in COMMANDS else "casahunt"
    try:
        options = _parsed(words)
        code = {"orbit": _orbit, "diagram": _diagram, "fold": _fold}[options.command](options)
        sys.stdout.flush()
        return code
    except InputError as error:
        _complain(command, error)
        return 2
    except NoOrbit as error:
        _complain(command, error)
        return 1
    except KeyboardInterrupt as error:
        _complain(command, str(error) or "interrupted")
        return 130
    except OSError as error:  # a full disk, or nobody who reads the output any more
        # What is still in the buffer would be complained about once more while the interpreter shuts down.
        with suppress(OSError):
            os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        _complain(command, f"the output could not be written: {error.strerror or error}")
        return 1


def _complain(command: str, what: object) -> None:
    print(f"{command}: {what}", file=sys.stderr)


def _parsed(words: list[str]) -> argparse.Namespace:
    """The options of a command line, with a suggestion for every misspelt word."""
    if not words:
        raise InputError(f"a command must be given: {', '.join(COMMANDS)} (see casahunt --help)")
    if not words[0].startswith("-"):
        known("command", words[0], COMMANDS)
    options, unknown = build_parser().parse_known_args(_joined(words))
    if unknown:
        if unknown[0].startswith("-"):
            dests = [name for name in vars(options) if name not in ("command", "servo")]
            names = [f"--{'from' if name == 'start' else name}" for name in dests]
            known("option", unknown[0].partition("=")[0], names)
        raise InputError(f"{unknown[0]!r}: must be left out, one servo file is enough")
    return options


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


def _servo(options: argparse.Namespace) -> Servo:
    servo = load(options.servo) if options.servo is not None else Servo()
    return with_overrides(servo, options.set)


def _float(key: str, text: Any) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{key} = {text!r}: must be a finite number") from None
    if not math.isfinite(value):
        raise InputError(f"{key} = {text}: must be a finite number, not NaN or infinity")
    return value


def _positive(key: str, text: Any) -> float:
    return require(key, _float(key, text), above=0)


def _writable(key: str, path: str | None, suffixes: tuple[str, ...]) -> Path | None:
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
    if not os.access(target if target.exists() else target.parent, os.W_OK):
        raise InputError(f"{key} = {path!r}: cannot be written (no permission)")
    return target


def _progress(quiet: bool) -> IO[str] | None:
    return None if quiet else sys.stderr


def _say(stream: IO[str] | None, text: str) -> None:
    if stream is not None:
        print(text, file=stream, flush=True)


# orbit ------------------------------------------------------------------------------------------------------


def _orbit(options: argparse.Namespace) -> int:
    model = known("model", options.model, MODELS)
    branch = known("branch", options.branch, BRANCHES)
    solver = known("solver", options.solver, ("ipopt", "newton"))
    if options.gain is None:
        raise InputError("gain: must be given, for example --gain 0.1")
    gain = _positive("gain", options.gain)
    how = Options(tol=_float("tol", options.tol), solver=solver, half=not options.full)  # type: ignore[arg-type]
    servo = _servo(options)
    plot = _writable("plot", options.plot, (".png", ".pdf", ".svg"))
    save = _writable("save", options.save, (".npz",))
    began = time.perf_counter()
    orbit = find_orbit(servo, model, gain, branch=branch, options=how)  # type: ignore[arg-type]
    record = orbit_record(orbit, branch)
    record["wall_s"] = time.perf_counter() - began
    _say(_progress(options.quiet), progress_line(orbit))
    if save:
        save_orbit(orbit, save)
    if plot:
        from . import plotting

        plotting.save(plotting.time_traces([orbit]), plot)
    if options.json:
        print(json.dumps(record))
        return 0
    m = orbit.multipliers
    kind = {True: "stable hunting cycle", False: "unstable hunting cycle", None: "hunting cycle of unknown stability"}
    print(f"{model} servo at gain {gain:.10g}: {kind[record['stable']]}")
    if orbit.half and orbit.multipliers.leading.real < -1:
        print("  past a symmetry breaking (mu < -1): lopsided cycles, which are not computed, may hunt in its place")
    print(f"  amplitude        {orbit.amplitude:.10g} rad")
    print(f"  period           {orbit.period:.10g} s")
    if m.trusted:
        name = "half multiplier" if orbit.half else "multiplier"
        print(f"  {name:15}  {_number(m.leading)}  (log10 of its size: {m.log10_leading:.4f})")
        print(f"  multipliers      {', '.join(_number(value) for value in m.full)}")
        print(f"  trivial one off  {m.trivial_error:.1e}")
    else:
        print(f"  multipliers      not to be trusted: the trivial one is off by {m.trivial_error:.1e}")
    print(f"  error estimate   {orbit.error_estimate:.1e} (relative, period and amplitude)")
    print(f"  status           {orbit.status.name.lower()}, {orbit.unknowns} unknowns, {orbit.iterations} iterations, "
          f"{record['wall_s']:.2f} s")  # fmt: skip
    return 0


def orbit_record(orbit: Orbit, branch: str) -> dict[str, Any]:
    """The JSON object of `casahunt orbit`; None for what is not to be trusted, or not known for a full cycle."""
    m = orbit.multipliers
    return {
        "model": orbit.model,
        "gain": orbit.gain,
        "branch": branch,
        "amplitude": orbit.amplitude,
        "period": orbit.period,
        "half_multiplier": orbit.half_multiplier if m.trusted and orbit.half else None,
        "log10_abs_half_multiplier": (m.log10_leading if orbit.half else m.log10_leading / 2) if m.trusted else None,
        "multipliers": [[value.real, value.imag] for value in m.full] if m.trusted else None,
        "trivial_multiplier_error": m.trivial_error if math.isfinite(m.trivial_error) else None,
        "multipliers_trusted": m.trusted,
        "stable": orbit.stable if m.trusted else None,
        "error_estimate": orbit.error_estimate,
        "status": orbit.status.name.lower(),
        "unknowns": orbit.unknowns,
        "iterations": orbit.iterations,
        "wall_s": orbit.wall_s,
    }


def _number(value: complex) -> str:
    if abs(value.imag) <= 1e-12 * abs(value):
        return f"{value.real:.8g}" if abs(value) > 1e-12 else "0"
    return f"{value.real:.8g}{value.imag:+.8g}j"


# diagram ------------------------------------------------------------------------------------------------------


def _diagram(options: argparse.Namespace) -> int:
    models = [known("model", model, MODELS) for model in options.model or MODELS]
    if len(set(models)) != len(models):
        raise InputError(f"model = {', '.join(models)}: each model can be asked for once")
    start = _positive("from", options.start)
    how = Options(tol=_float("tol", options.tol))
    servo = _servo(options)
    stream = _progress(options.quiet)
    branches: list[Branch] = []
    failures: list[str] = []
    began = time.perf_counter()
    with _folder(options.out, [*PICTURES, *(f"{model}{end}" for model in models for end in (".csv", ".npz"))]) as out:
        try:
            for model in models:
                try:
                    branches.append(_one_branch(servo, model, start, how, out, stream))
                    failure = _shortfall(branches[-1], start)
                except NoOrbit as error:
                    failure = str(error)
                if failure:
                    failures.append(failure)
                    _complain("casahunt diagram", failure)
            if branches:
                _pictures(branches, out)
        except KeyboardInterrupt:
            computed = any(out.iterdir())
            where = f"the points computed so far are in {out}" if computed else "no point was computed"
            raise KeyboardInterrupt(f"interrupted; {where}") from None
    if options.json:
        summary = {
            "out": str(out) if branches else None,
            "branches": [_branch_record(branch) for branch in branches],
            "failures": failures,
            "wall_s": time.perf_counter() - began,
        }
        print(json.dumps(summary))
    elif branches:
        for branch in branches:
            print(f"{branch.model}: {len(branch.orbits)} points; {branch.ended}")
            for special in branch.special:
                print(f"  {special.meaning}")
        print(f"written to {out}")
    return 1 if failures else 0


@contextmanager
def _folder(path: str, files: list[str]) -> Iterator[Path]:
    """The output folder, made where it does not exist and unmade where nothing is written into it.

    `files` of an earlier run are removed, so that all of them belong to one servo.
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
        for name in files:
            (out / name).unlink(missing_ok=True)
        yield out
    finally:
        for folder in made:
            with suppress(OSError):  # it holds something, or was not made
                folder.rmdir()


def _one_branch(servo: Servo, model: Any, start: float, how: Options, out: Path, stream: IO[str] | None) -> Branch:
    """Compute a branch; every point is on disk before the next one is begun."""
    orbits: list[Orbit] = []
    special: list[SpecialPoint] = []
    ended = "interrupted"
    points = diagram(servo, model, start=start, options=how)
    point: DiagramPoint | None = next(points)  # nothing is written for a servo that does not hunt
    try:
        with _opened(out / f"{model}.csv") as file:
            writer = csv.writer(file)
            writer.writerow(CSV_COLUMNS)
            while point is not None:
                rows = [csv_row(found.orbit, found.kind) for found in point.special]
                writer.writerows([*rows, csv_row(point.orbit, "")])
                file.flush()
                orbits.append(point.orbit)
                special += point.special
                for found in point.special:
                    _say(stream, f"{model:7s} {found.meaning}")
                _say(stream, progress_line(point.orbit))
                try:
                    point = next(points)
                except StopIteration as end:
                    point, ended = None, str(end.value)
                except NoOrbit as error:
                    point, ended = None, str(error)
    finally:
        if orbits:
            save_branch(Branch(model, servo, tuple(orbits), ended, tuple(special)), out / f"{model}.npz")
    return Branch(model, servo, tuple(orbits), ended, tuple(special))


def _shortfall(branch: Branch, start: float) -> str:
    """What is missing of a branch that does not come back to the gain where it began; "" where nothing is."""
    if len(branch.orbits) > 1 and branch.orbits[-1].gain == start:
        return ""
    return (
        f"the branch of the {branch.model} servo was followed from gain {start:g} to gain "
        f"{branch.orbits[-1].gain:.6g}, but not back to where it began: {branch.ended}; "
        "another --tol or --from may lead further"
    )


def _opened(path: Path) -> IO[str]:
    try:
        return path.open("w", newline="")
    except OSError as error:
        raise InputError(f"cannot write {str(path)!r}: {error.strerror}") from None


def csv_row(orbit: Orbit, special: str) -> list[Any]:
    """One row of the CSV file, in the order of `CSV_COLUMNS`."""
    multipliers = orbit.multipliers
    trusted = multipliers.trusted
    return [
        repr(orbit.gain),
        repr(orbit.amplitude),
        repr(orbit.period),
        repr(orbit.half_multiplier if trusted else math.nan),
        repr(multipliers.log10_leading if trusted else math.nan),
        orbit.stable if trusted and special != FOLD.kind else "",  # at a fold it is neither
        f"{multipliers.trivial_error:.3g}",
        f"{orbit.error_estimate:.3g}",
        orbit.status.name.lower(),
        orbit.unknowns,
        orbit.iterations,
        special,
    ]


def progress_line(orbit: Orbit, mu: str = "") -> str:
    """Gain, amplitude, period, multiplier (mu, or lambda of a full cycle) and iterations of a point."""
    if not mu:
        mu = f"{orbit.multipliers.leading.real:+.4g}" if orbit.multipliers.trusted else "not trusted"
    return (
        f"{orbit.model:7s} K = {orbit.gain:.8g}  amplitude = {orbit.amplitude:.6g} rad  period = {orbit.period:.6g} s  "
        f"{'mu' if orbit.half else 'lambda'} = {mu}  iterations = {orbit.iterations}"
    )


def _branch_record(branch: Branch) -> dict[str, Any]:
    return {
        "model": branch.model,
        "points": len(branch.orbits),
        "ended": branch.ended,
        "gain_range": [float(branch.gains.min()), float(branch.gains.max())],
        "special": [
            {
                "kind": s.kind,
                "gain": s.orbit.gain,
                "amplitude": s.orbit.amplitude,
                "period": s.orbit.period,
                "meaning": s.meaning,
            }
            for s in branch.special
        ],
    }


def _pictures(branches: list[Branch], out: Path) -> None:
    from . import plotting

    firsts = [branch.orbits[0] for branch in branches]
    figures = (
        plotting.diagram(branches),
        plotting.multipliers(branches),
        plotting.time_traces(firsts),
        plotting.phase_portrait(firsts),
    )
    for figure, name in zip(figures, PICTURES, strict=True):
        plotting.save(figure, out / name)


# fold ---------------------------------------------------------------------------------------------------------


def _fold(options: argparse.Namespace) -> int:
    model = known("model", options.model, MODELS)
    how = Options(tol=_float("tol", options.tol))
    servo = _servo(options)
    fold = find_fold(servo, model, options=how)  # type: ignore[arg-type]
    record = {
        "model": model,
        "gain": fold.gain,
        "amplitude": fold.orbit.amplitude,
        "period": fold.orbit.period,
        "error_estimate": fold.error_estimate,
        "optimised_gain": fold.optimised_gain,
        "status": fold.status.name.lower(),
        "wall_s": fold.wall_s,
    }
    _say(_progress(options.quiet), progress_line(fold.orbit, mu="+1 (fold)"))
    if options.json:
        print(json.dumps(record))
        return 0
    print(f"{model} servo: hunting is possible up to gain {fold.gain:.10g}")
    print(f"  estimated error  {fold.gain_error:.1e} (relative, of the gain)")
    print(f"  amplitude there  {fold.orbit.amplitude:.10g} rad")
    print(f"  period there     {fold.orbit.period:.10g} s")
    print(f"  as the maximum of an optimisation problem (IPOPT): {fold.optimised_gain:.10g}")
    print(f"  {fold.wall_s:.2f} s")
    return 0
