"""The command line: casahunt orbit | diagram | fold.

Results go to standard output (with --json one JSON object and nothing else), progress to standard error.
Exit codes: 0 done; 1 no such orbit or no convergence, with what was tried and what to do; 2 the input is
wrong, and nothing has been written; 130 interrupted, what was computed is on disk.
"""

from __future__ import annotations

import argparse
import csv
import json
import math
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import IO, Any

from . import __version__
from .adapt import TOLERANCE_RANGE, Options
from .archive import save_branch, save_orbit
from .branch import Branch, SpecialPoint
from .checks import known, require
from .diagram import DEFAULT_START, diagram
from .errors import InputError, NoOrbit
from .find import BRANCHES, find_orbit
from .fold import find_fold
from .hunting import MODELS
from .orbit import Orbit
from .servo import Servo, load, with_overrides

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


class _Parser(argparse.ArgumentParser):
    """Argument errors in the form of all other input errors."""

    def error(self, message: str) -> Any:
        raise InputError(f"{message} (see {self.prog} --help)")


def build_parser() -> argparse.ArgumentParser:
    """The parser of all commands."""
    parser = _Parser(
        prog="casahunt",
        description="Will this servo hunt, and at which gain does it stop? Limit cycles of a servo with dry friction.",
    )
    parser.add_argument("--version", action="version", version=f"casahunt {__version__}")
    commands = parser.add_subparsers(dest="command", required=True, parser_class=_Parser, metavar="COMMAND")

    orbit = commands.add_parser("orbit", help="the hunting cycle at one gain")
    _common(orbit)
    orbit.add_argument("--model", default="switch", help="switch (default) or lugre")
    orbit.add_argument("--gain", required=True, help="controller gain K")
    orbit.add_argument("--branch", default="stable", help="stable (default) or unstable")
    orbit.add_argument("--full", action="store_true", help="solve the full cycle, without using its symmetry")
    orbit.add_argument("--solver", default="ipopt", help="ipopt (default) or newton, for the first solve")
    orbit.add_argument("--plot", metavar="F.png", help="write a picture of one period")
    orbit.add_argument("--save", metavar="F.npz", help="write the orbit")

    picture = commands.add_parser("diagram", help="amplitude and period against the gain, round the fold")
    _common(picture)
    picture.add_argument("--model", action="append", help="switch or lugre; repeat for both (default both)")
    picture.add_argument(
        "--from", dest="start", default=DEFAULT_START, metavar="K", help=f"gain to start from (default {DEFAULT_START})"
    )
    picture.add_argument("--out", default="casahunt-diagram", metavar="DIR", help="folder to write into")

    fold = commands.add_parser("fold", help="the largest gain at which the servo can hunt")
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
    command = "casahunt"
    try:
        options = build_parser().parse_args(arguments)
        command = f"casahunt {options.command}"
        run = {"orbit": _orbit, "diagram": _diagram, "fold": _fold}[options.command]
        return run(options)
    except InputError as error:
        print(f"{command}: {error}", file=sys.stderr)
        return 2
    except NoOrbit as error:
        print(f"{command}: {error}", file=sys.stderr)
        return 1
    except KeyboardInterrupt:
        print(f"{command}: interrupted", file=sys.stderr)
        return 130


def _servo(options: argparse.Namespace) -> Servo:
    servo = load(options.servo) if options.servo else Servo()
    return with_overrides(servo, options.set)


def _float(key: str, text: Any) -> float:
    try:
        value = float(text)
    except ValueError:
        raise InputError(f"{key} = {text!r}: must be a finite number") from None
    return require(key, value)


def _positive(key: str, text: Any) -> float:
    return require(key, _float(key, text), above=0)


def _writable(key: str, path: str, suffixes: tuple[str, ...]) -> Path:
    """A path that can be written; checked before anything is computed."""
    target = Path(path)
    if target.suffix.lower() not in suffixes:
        raise InputError(f"{key} = {path!r}: the name must end in {' or '.join(suffixes)}")
    if not target.parent.is_dir():
        raise InputError(f"{key} = {path!r}: the folder {str(target.parent)!r} does not exist")
    if target.is_dir():
        raise InputError(f"{key} = {path!r}: is a folder")
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
    gain = _positive("gain", options.gain)
    how = Options(tol=_float("tol", options.tol), solver=solver, half=not options.full)  # type: ignore[arg-type]
    servo = _servo(options)
    plot = _writable("plot", options.plot, (".png", ".pdf", ".svg")) if options.plot else None
    save = _writable("save", options.save, (".npz",)) if options.save else None
    began = time.perf_counter()
    orbit = find_orbit(servo, model, gain, branch=branch, options=how)  # type: ignore[arg-type]
    record = orbit_record(orbit, branch)
    record["wall_s"] = time.perf_counter() - began
    if save:
        save_orbit(orbit, save)
    if plot:
        from . import plotting

        plotting.save(plotting.time_traces([orbit]), plot)
    if options.json:
        print(json.dumps(record))
        return 0
    multipliers = orbit.multipliers
    print(f"{model} servo at gain {gain:g}: {'stable' if orbit.stable else 'unstable'} hunting cycle")
    print(f"  amplitude        {orbit.amplitude:.10g} rad")
    print(f"  period           {orbit.period:.10g} s")
    print(f"  half multiplier  {_number(multipliers.leading)}  (log10 |mu| = {multipliers.log10_leading:.4f})")
    print(f"  multipliers      {', '.join(_number(m) for m in multipliers.full)}")
    trust = "" if multipliers.trusted else "  NOT TO BE TRUSTED"
    print(f"  trivial one off  {multipliers.trivial_error:.1e}{trust}")
    print(f"  error estimate   {orbit.error_estimate:.1e} (relative, period and amplitude)")
    print(f"  status           {orbit.status.name.lower()}, {orbit.unknowns} unknowns, {orbit.iterations} iterations, "
          f"{record['wall_s']:.2f} s")  # fmt: skip
    return 0


def orbit_record(orbit: Orbit, branch: str) -> dict[str, Any]:
    """The JSON object of `casahunt orbit`."""
    multipliers = orbit.multipliers
    return {
        "model": orbit.model,
        "gain": orbit.gain,
        "branch": branch,
        "amplitude": orbit.amplitude,
        "period": orbit.period,
        "half_multiplier": orbit.half_multiplier if orbit.half else None,
        "log10_abs_half_multiplier": multipliers.log10_leading if orbit.half else multipliers.log10_leading / 2,
        "multipliers": [[m.real, m.imag] for m in multipliers.full],
        "trivial_multiplier_error": multipliers.trivial_error,
        "multipliers_trusted": multipliers.trusted,
        "stable": orbit.stable,
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
    out = Path(options.out)
    try:
        out.mkdir(parents=True, exist_ok=True)
        for stale in ("diagram.png", "multipliers.png"):
            (out / stale).unlink(missing_ok=True)
    except OSError as error:
        raise InputError(f"out = {options.out!r}: the folder cannot be made ({error.strerror})") from None
    stream = _progress(options.quiet)
    branches: list[Branch] = []
    failures: list[str] = []
    began = time.perf_counter()
    for model in models:
        try:
            branches.append(_one_branch(servo, model, start, how, out, stream))
        except NoOrbit as error:
            failures.append(str(error))
            _say(stream, f"{model}: {error}")
    if branches:
        _pictures(branches, out, start)
    summary = {
        "out": str(out),
        "branches": [_branch_record(branch) for branch in branches],
        "failures": failures,
        "wall_s": time.perf_counter() - began,
    }
    if options.json:
        print(json.dumps(summary))
    else:
        for branch in branches:
            print(f"{branch.model}: {len(branch.orbits)} points; {branch.ended}")
            for special in branch.special:
                print(f"  {special.meaning}")
        print(f"written to {out}")
    if failures:
        raise NoOrbit("; ".join(failures))
    return 0


def _one_branch(servo: Servo, model: Any, start: float, how: Options, out: Path, stream: IO[str] | None) -> Branch:
    """Compute a branch; every point is on disk before the next one is begun."""
    orbits: list[Orbit] = []
    special: list[SpecialPoint] = []
    ended = "interrupted"
    points = diagram(servo, model, start=start, options=how)
    first = next(points)  # nothing is written for a servo that does not hunt
    path = out / f"{model}.csv"
    try:
        with _opened(path) as file:
            writer = csv.writer(file)
            writer.writerow(CSV_COLUMNS)
            point = first
            while True:
                orbits.append(point.orbit)
                special += point.special
                for found in point.special:
                    writer.writerow(csv_row(found.orbit, found.kind))
                    _say(stream, f"{model:7s} {found.meaning}")
                writer.writerow(csv_row(point.orbit, ""))
                file.flush()
                _say(stream, progress_line(point.orbit))
                try:
                    point = next(points)
                except StopIteration as end:
                    ended = str(end.value)
                    break
    finally:
        branch = Branch(model, servo, tuple(orbits), ended, tuple(special))
        save_branch(branch, out / f"{model}.npz")
    return branch


def _opened(path: Path) -> IO[str]:
    try:
        return path.open("w", newline="")
    except OSError as error:
        raise InputError(f"cannot write {str(path)!r}: {error.strerror}") from None


def csv_row(orbit: Orbit, special: str) -> list[Any]:
    """One row of the CSV file, in the order of `CSV_COLUMNS`."""
    multipliers = orbit.multipliers
    mu = orbit.half_multiplier if multipliers.trusted else math.nan
    return [
        repr(orbit.gain),
        repr(orbit.amplitude),
        repr(orbit.period),
        repr(mu),
        repr(multipliers.log10_leading if multipliers.trusted else math.nan),
        orbit.stable,
        f"{multipliers.trivial_error:.3g}",
        f"{orbit.error_estimate:.3g}",
        orbit.status.name.lower(),
        orbit.unknowns,
        orbit.iterations,
        special,
    ]


def progress_line(orbit: Orbit) -> str:
    """Gain, amplitude, period, multiplier and iterations of a point."""
    mu = f"{orbit.half_multiplier:+.4g}" if orbit.multipliers.trusted else "not trusted"
    return (
        f"{orbit.model:7s} K = {orbit.gain:.8f}  amplitude = {orbit.amplitude:.6g} rad  "
        f"period = {orbit.period:.6g} s  mu = {mu}  iterations = {orbit.iterations}"
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


def _pictures(branches: list[Branch], out: Path, start: float) -> None:
    from . import plotting

    plotting.save(plotting.diagram(branches), out / "diagram.png")
    plotting.save(plotting.multipliers(branches), out / "multipliers.png")
    firsts = [branch.orbits[0] for branch in branches]
    plotting.save(plotting.time_traces(firsts), out / "time_traces.png")
    plotting.save(plotting.phase_portrait(firsts), out / "phase_portrait.png")


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
