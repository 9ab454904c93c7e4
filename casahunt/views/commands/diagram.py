"""casahunt diagram: both branches, the fold, pictures and files; points are on disk before the next ones begin.

Points that were computed in batches are written together, and a point is announced when it is on disk.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ... import effort
from ...checks import to_and_back
from ...continuation import FOLD, SpecialPoint, follow
from ...continuation import Branch as AnyBranch
from ...design.diagram import (
    SIGNS,
    DiagramPoint,
    DiagramTask,
    Words,
    branch_of,
    diagram_points,
    keep,
    starting_gain,
)
from ...errors import InputError, NoOrbit
from ...export import MAKER
from ...files import drop_replaced, set_aside
from ...interrupts import held, word
from ...orbits import Options, SystemOrbit
from ...servo.branch import INTERRUPTED, Branch
from ...servo.friction import Model
from ...servo.lopsided import with_lopsided
from ...servo.parts.verbs import FAR_UP, check_present, loop_cycle
from ...servo.problem import HuntingOrbit
from ...servo.units import GAIN_UNIT, kinds_of
from ..answers.answer import parts_of, record_of, short
from ..answers.diagram import diagram_answer, loop_diagram_answer
from .arguments import (
    add_command,
    add_models,
    add_out,
    add_solver,
    add_vary,
    finite,
    how_of,
    left_out,
    loop_of,
    models_of,
    positive,
    servo_of,
    vary_of,
)
from .console import complain, folder, orbit_line
from .output import drawing, give
from .output_paths import keep_others
from .progress import Progress, progress, say, tell

if TYPE_CHECKING:
    from ...servo.parts import Loop

PICTURES = {
    "diagram.png": "branches.diagram",
    "multipliers.png": "branches.multipliers",
    "time_traces.png": "orbits.time_traces",
    "phase_portrait.png": "orbits.phase_portrait",
}
"""What `casahunt diagram` draws, and by which function of views/pictures: of the branches, or of their first orbits."""
LOOP_SIGNS = {"loop.csv": b",period,amplitude,error_estimate,stable,status,special\n", "loop.json": b'"type": "Branch"'}
"""What is written of a loop of parts, and what stands in it."""
BROKEN_OFF = ("stuck", "points", "time")
"""Kinds of an end of a branch behind which it goes on."""
PICTURE_SIGN = f"Software\0{MAKER}".encode()
"""What stands in each of them: its entry Software."""


def add(commands: Any) -> None:
    """The arguments of the command."""
    picture = add_command(commands, "diagram", "amplitude and period against the gain, round the fold")
    add_models(picture)
    picture.add_argument(
        "--from", dest="start", metavar="K",
        help="gain to start from (default: the least for a stable loop without friction, 0.0321 for Table 1; the first "
        "above with a hunting cycle where there is none)",
    )  # fmt: skip
    add_solver(picture)
    picture.add_argument(
        "--natural", action="store_true",
        help="natural continuation in the gain instead of pseudo-arclength: it ends at the fold",
    )  # fmt: skip
    add_vary(picture, "that is varied")
    picture.add_argument("--to", metavar="X", help="where the branch of a loop of parts ends (default: far up)")
    add_out(picture, _results, default="casahunt-diagram", help="folder to write into")


def _results(options: argparse.Namespace) -> dict[str, bytes]:
    """The files that are written into --out, and what stands in each."""
    if loop_of(options) is not None:
        return dict.fromkeys(PICTURES, PICTURE_SIGN) | LOOP_SIGNS
    tables = {f"{model}{end}": sign for model in models_of(options) for end, sign in SIGNS.items()}
    return dict.fromkeys(PICTURES, PICTURE_SIGN) | tables


def run(options: argparse.Namespace) -> int:
    """Compute, write and print; returns the exit code.

    Raises InputError: the command line is wrong; KeyboardInterrupt: interrupted; says where the points computed so far
    are.
    """
    models = models_of(options)
    loop, vary, how = loop_of(options), vary_of(options), how_of(options)
    if loop is not None:
        return _of_a_loop(options, loop, vary, how)
    left_out(options, "a servo's diagram goes round its fold and back", "to")
    start = None if options.start is None else positive("from", options.start, GAIN_UNIT)
    task = DiagramTask(servo_of(options), start, how, options.natural)
    began = time.perf_counter()
    results = _results(options)
    with folder(options.out, results) as out:
        # What an earlier run has left makes room when this one has its first point, and not before.
        found = _Branches(task, out, dict(results), progress(options), options.details)
        try:
            for model in models:
                found.add(model)
            if found.branches:
                options.outputs.write(_pictures, found.branches, out)
                for aside in drop_replaced(found.moved):
                    complain("casahunt diagram", f"{aside} is of an earlier run, which this one has not replaced")
        except KeyboardInterrupt:
            where = f"the points computed so far are in {out}" if found.computed else "no point was computed"
            raise KeyboardInterrupt(f"{word()}; {where}") from None
    summary = {
        "out": str(out) if found.branches else None,
        "continuation": "natural" if options.natural else "pseudo-arclength",
        "solver": how.solver,
        "branches": found.branches,
        "failures": found.failures,
        "wall_s": time.perf_counter() - began,
    }
    every = [one for branch in found.branches for one in (branch, *branch.lopsided)]
    said = {special.kind for branch in every for special in branch.special}
    give(options, summary, diagram_answer(found.branches, _written(options, out)), said=said)
    return 1 if found.failures else 0


def _of_a_loop(options: argparse.Namespace, loop: Loop, vary: str, how: Options) -> int:
    """The branch of a loop in one of its parameters, written when it is there; returns the exit code."""
    left_out(options, "they go with the diagram of a servo", "natural")
    start = None if options.start is None else finite("from", options.start, *kinds_of(vary))
    to = None if options.to is None else finite("to", options.to, *kinds_of(vary))
    began, stream = time.perf_counter(), progress(options)
    with folder(options.out, _results(options)) as out:
        branch = _branch_of(
            loop, vary, start, to, how, lambda orbit: tell(stream, orbit_line(stream, orbit, vary=vary))
        )
        options.outputs.write(branch.to_csv, out / "loop.csv")
        options.outputs.write(branch.to_json, out / "loop.json")
        options.outputs.write(_pictures, [branch], out)
    failures = [branch.ended] if branch.end.kind in BROKEN_OFF else []
    for said in (*failures, *(gap.meaning for gap in branch.missed)):
        complain("casahunt diagram", said)
    summary = {
        "out": str(out), "continuation": "pseudo-arclength", "solver": how.solver, **record_of(loop),
        "branches": [branch], "failures": failures, "wall_s": time.perf_counter() - began,
    }  # fmt: skip
    answer = loop_diagram_answer(branch, vary, parts_of(loop), _written(options, out))
    give(options, summary, answer, said={special.kind for special in branch.special})
    return 1 if failures else 0


def _branch_of(
    loop: Loop, vary: str, start: float | None, to: float | None, options: Options,
    progress: Callable[[SystemOrbit], None],
) -> AnyBranch[SystemOrbit]:  # fmt: skip
    """The branch of a loop in one of its parameters: from its own value or `start`, to `to` or far up."""
    if start is not None:
        loop = loop.replace(**{vary: start})
    check_present(loop, vary)
    here = loop.value(vary)
    if to is None and here <= 0:
        raise InputError(f"to: must be given, {vary} = {here:g} at the start cannot be multiplied")
    to, _ = to_and_back(vary, here, FAR_UP * here if to is None else to, None)
    return follow(loop_cycle(loop, vary, options=options), vary, to=to, options=options, progress=progress)


def _written(options: argparse.Namespace, out: Path) -> str:
    """The folder that is written into; "" where something is missing in it."""
    return "" if options.outputs.troubles else str(out)


@dataclass
class _Branches:
    """The branches of a run, and what is missing of them."""

    task: DiagramTask
    out: Path
    stale: dict[str, bytes]
    """Files that an earlier run may have left, and what stands in each."""
    stream: Progress | None
    details: bool
    branches: list[Branch] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    moved: dict[Path, Path] = field(default_factory=dict)

    @property
    def computed(self) -> bool:
        """Whether the folder holds a point of this diagram."""
        return not self.stale

    def make_room(self) -> None:
        """Set aside what an earlier run has left."""
        keep_others(self.out, self.stale)  # looked at long ago, perhaps
        self.moved.update(set_aside(self.out / name for name in self.stale))
        self.stale.clear()

    def add(self, model: Model) -> None:
        """Compute the branch of a model, and say what is missing of it."""
        try:
            branch = self.branch(model, self.task.start or self.own_start(model))
        except NoOrbit as error:
            start = self.instead(model)
            if start is None:
                self.lacks(error)
                return
            self.lacks(NoOrbit(f"{error.plain}; it is drawn from gain {start:g}", evidence=error.evidence))
            branch = self.branch(model, start)
        self.branches.append(branch)
        if failure := _shortfall(branch, float(branch.gains[0]), self.task.natural):
            self.lacks(failure)
        for gap in (*branch.missed, *(gap for pair in branch.lopsided for gap in pair.missed)):
            complain("casahunt diagram", f"{model}: {gap.meaning}")
            if gap.kind == FOLD.kind and gap in branch.missed:  # what the diagram is there for
                self.failures.append(gap.meaning)

    def lacks(self, failure: str | NoOrbit) -> None:
        """Say what is missing."""
        self.failures.append(str(failure))
        complain("casahunt diagram", failure, details=self.details)

    def own_start(self, model: Model) -> float:
        """The gain that the servo has for itself."""
        effort.at(lambda: f"{model}: looking for the gain to start from")
        return starting_gain(self.task.servo, model, self.task.options)

    def instead(self, model: Model) -> float | None:
        """Where its cycles begin above the gain that was asked for; None where none is known to."""
        if self.task.start is None:
            return None
        with suppress(NoOrbit):
            start = self.own_start(model)
            return start if start > self.task.start else None
        return None

    def branch(self, model: Model, start: float) -> Branch:
        """Compute the branch of a model from a gain."""
        task = replace(self.task, start=start)
        return _one_branch(task, model, self.make_room, self.out, self.stream)


def _one_branch(
    task: DiagramTask,
    model: Model,
    make_room: Callable[[], None],
    out: Path,
    stream: Progress | None,
) -> Branch:
    """Compute a branch; what is found is on disk before more is computed."""
    found: list[DiagramPoint] = []
    words = Words()
    points = diagram_points(task.servo, model, start=task.start, options=task.options, natural=task.natural)
    lines: list[tuple[Callable[[Progress | None, str], None], str]] = []  # about points that are not on disk yet

    def written() -> None:
        said = [lines.pop(0) for _ in tuple(lines)]  # whatever becomes of it, this is done once
        with held():
            make_room()
            keep(task, model, found, INTERRUPTED, out, words)
        for how, line in said:
            how(stream, line)
        effort.heard()

    try:
        while True:
            point = next(points)
            with held():
                found.append(point)
                lines += [(say, _met(model, special, stream)) for special in point.special if _worth(special, stream)]
                lines.append((tell, orbit_line(stream, point.orbit)))
            if not point.ahead:
                written()
    except StopIteration as end:
        ended = str(end.value)
    except NoOrbit as error:
        if not found:  # nothing is written for a servo that does not hunt
            raise
        ended = str(error)
    finally:
        if lines:
            written()
    beside = _beside(branch_of(task.servo, model, found, ended), task, stream)
    return keep(task, model, found, ended, out, words, beside)


def _worth(special: SpecialPoint[HuntingOrbit], stream: Progress | None) -> bool:
    """Whether a special point is a milestone: where hunting ends is one to everybody."""
    return special.kind == FOLD.kind or stream is not None and stream.every


def _met(model: Model, special: SpecialPoint[HuntingOrbit], stream: Progress | None) -> str:
    """What is said of a special point."""
    if stream is not None and stream.every:
        return f"{model:7s} {special.meaning}"
    return f"{model}: cycles of one kind end at gain {short(special.orbit.gain)} V/rad"


def _beside(branch: Branch, task: DiagramTask, stream: Progress | None) -> Branch:
    """The branch with one cycle of each lopsided pair that branches off from it, followed too."""

    def shown(orbit: HuntingOrbit) -> None:
        tell(stream, f"{orbit_line(stream, orbit)}  lopsided")
        effort.heard()

    return with_lopsided(branch, options=task.options, progress=shown)


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


def _pictures(branches: list[Any], out: Path) -> None:
    from ..pictures.plotting import save

    keep_others(out, dict.fromkeys(PICTURES, PICTURE_SIGN))
    firsts = [branch.orbits[0] for branch in branches]
    for name, picture in PICTURES.items():
        save(drawing(picture)(branches if picture.startswith("branches") else firsts), out / name)
