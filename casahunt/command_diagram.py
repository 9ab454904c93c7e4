"""casahunt diagram: both branches, the fold, pictures and files; every point is on disk before the next begins."""

from __future__ import annotations

import argparse
import json
import math
import time
from pathlib import Path
from typing import IO, Any

from .adapt import Options
from .archive import save_branch
from .branch import Branch, SpecialPoint
from .checks import known
from .console import (
    add_common,
    add_solver,
    complain,
    finite,
    folder,
    positive,
    progress,
    progress_line,
    say,
    servo_of,
    solver_of,
)
from .diagram import DEFAULT_START, DiagramPoint, diagram
from .errors import InputError, NoOrbit
from .hunting import MODELS
from .interrupts import held, word
from .monitor import FOLD
from .orbit import Orbit
from .servo import Servo
from .tables import table

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


def add(commands: Any) -> None:
    """The arguments of the command."""
    picture = commands.add_parser(
        "diagram", allow_abbrev=False, help="amplitude and period against the gain, round the fold"
    )
    add_common(picture)
    picture.add_argument("--model", action="append", help="switch or lugre; repeat for both (default both)")
    picture.add_argument(
        "--from", dest="start", default=DEFAULT_START, metavar="K", help=f"gain to start from (default {DEFAULT_START})"
    )
    add_solver(picture)
    picture.add_argument(
        "--natural", action="store_true",
        help="natural continuation in the gain instead of pseudo-arclength: it ends at the fold",
    )  # fmt: skip
    picture.add_argument("--out", default="casahunt-diagram", metavar="DIR", help="folder to write into")


def run(options: argparse.Namespace) -> int:
    """Compute, write and print; returns the exit code."""
    models = [known("model", model, MODELS) for model in options.model or MODELS]
    if len(set(models)) != len(models):
        raise InputError(f"model = {', '.join(models)}: each model can be asked for once")
    start = positive("from", options.start)
    how = Options(tol=finite("tol", options.tol), solver=solver_of(options))
    servo = servo_of(options)
    stream = progress(options.quiet)
    branches: list[Branch] = []
    failures: list[str] = []
    began = time.perf_counter()
    with folder(options.out, [*PICTURES, *(f"{model}{end}" for model in models for end in (".csv", ".npz"))]) as out:
        try:
            for model in models:
                try:
                    branches.append(_one_branch(servo, model, start, how, options.natural, out, stream))
                    failure = _shortfall(branches[-1], start, options.natural)
                except NoOrbit as error:
                    failure = str(error)
                if failure:
                    failures.append(failure)
                    complain("casahunt diagram", failure)
            if branches:
                _pictures(branches, out)
        except KeyboardInterrupt:
            computed = any(out.iterdir())
            where = f"the points computed so far are in {out}" if computed else "no point was computed"
            raise KeyboardInterrupt(f"{word()}; {where}") from None
    if options.json:
        summary = {
            "out": str(out) if branches else None,
            "continuation": "natural" if options.natural else "pseudo-arclength",
            "solver": how.solver,
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


def _one_branch(
    servo: Servo, model: Any, start: float, how: Options, natural: bool, out: Path, stream: IO[str] | None
) -> Branch:
    """Compute a branch; every point is on disk before the next one is begun."""
    orbits: list[Orbit] = []
    special: list[SpecialPoint] = []
    ended = "interrupted"
    points = diagram(servo, model, start=start, options=how, natural=natural)
    point: DiagramPoint | None = next(points)  # nothing is written for a servo that does not hunt
    try:
        with _opened(out / f"{model}.csv") as file:
            write = table(file, CSV_COLUMNS)
            file.flush()  # the first row takes a while; killed meanwhile, the table is empty, not torn
            while point is not None:
                rows = [csv_row(found.orbit, found.kind) for found in point.special]
                itself = any(found.orbit is point.orbit for found in point.special)
                with held():
                    write(rows if itself else [*rows, csv_row(point.orbit, "")])
                    file.flush()
                    orbits.append(point.orbit)
                    special += point.special
                for found in point.special:
                    say(stream, f"{model:7s} {found.meaning}")
                say(stream, progress_line(point.orbit))
                try:
                    point = next(points)
                except StopIteration as end:
                    point, ended = None, str(end.value)
                except NoOrbit as error:
                    point, ended = None, str(error)
    finally:
        if orbits:
            with held():
                save_branch(Branch(model, servo, tuple(orbits), ended, tuple(special)), out / f"{model}.npz")
    return Branch(model, servo, tuple(orbits), ended, tuple(special))


def _shortfall(branch: Branch, start: float, natural: bool) -> str:
    """What is missing of a branch that does not come back to the gain where it began; "" where nothing is.

    Natural continuation is to end at a fold.
    """
    if natural:
        if branch.special and branch.special[-1].orbit is branch.orbits[-1]:
            return ""
        return (
            f"the branch of the {branch.model} servo was followed by natural continuation from gain {start:g} to gain "
            f"{branch.orbits[-1].gain:.10g}, but not to a fold: {branch.ended}; without --natural it may lead further"
        )
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
        orbit.gain,
        orbit.amplitude,
        orbit.period,
        orbit.half_multiplier if trusted else math.nan,
        multipliers.log10_leading if trusted else math.nan,
        orbit.stable if trusted and special != FOLD.kind else "",  # at a fold it is neither
        multipliers.trivial_error,
        orbit.error_estimate,
        orbit.status.name.lower(),
        orbit.unknowns,
        orbit.iterations,
        special,
    ]


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
