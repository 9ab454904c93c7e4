"""casahunt diagram: both branches, the fold, pictures and files; points are on disk before the next ones begin.

The table grows with the points, those together whose multipliers were computed in one batch, and a point is announced
when it is on disk; the archive is written once, when the branch has ended, however that was.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, cast

from ... import effort
from ...axis_units import label
from ...continuation import FOLD, SYMMETRY_BREAKING, Branch
from ...design.diagram import diagram, starting_gain
from ...errors import NoOrbit
from ...export import MAKER
from ...files import drop_replaced, set_aside
from ...interrupts import held, word
from ...orbits import Archive, Options, Orbit
from ...servo.friction import Model
from ...servo.lopsided import with_lopsided
from ...servo.parts.loop import Loop
from ...servo.saved import save_branch
from ...servo.servo import Servo
from ...servo.units import GAIN_UNIT, kinds_of
from ..answers.answer import Answer, item, parts_of, position, record_of, short, volts_per
from .arguments import Asked, add_command, add_models, add_out, add_solver, add_vary, finite, positive
from .console import complain, folder, orbit_line
from .output import draw, give
from .output_paths import keep_others
from .progress import each_stays, say, tell

PICTURES = {
    "diagram.png": "branches.diagram",
    "multipliers.png": "branches.multipliers",
    "time_traces.png": "orbits.time_traces",
    "phase_portrait.png": "orbits.phase_portrait",
}
"""What `casahunt diagram` draws, and by which function of views/pictures: of the branches, or of their first orbits."""
SIGNS = {".csv": b",error_estimate,", ".npz": Archive.SIGN}
"""What stands in a table and in an archive of a branch, and in no other file."""
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
    picture.add_argument("--to", metavar="X", help="where the branch ends that does not turn back (default: far up)")
    add_out(picture, _results, default="casahunt-diagram", help="folder to write into")


def _results(options: Asked) -> dict[str, bytes]:
    """The files that are written into --out, and what stands in each."""
    tables = {f"{model or 'loop'}{end}": sign for model in options.friction_models() for end, sign in SIGNS.items()}
    return dict.fromkeys(PICTURES, PICTURE_SIGN) | tables


def run(options: Asked) -> int:
    """Compute, write and print; returns the exit code."""
    models, loop, vary, how = options.friction_models(), options.loop(), options.varied(), options.how()
    servo = loop or options.servo()

    def number(key: str, text: str | None) -> float | None:
        if text is None:
            return None
        return positive(key, text, GAIN_UNIT) if loop is None else finite(key, text, *kinds_of(vary))

    start, to = number("from", options.start), number("to", options.to)
    results, out = _results(options), Path(options.out)
    with folder(options.out, results):
        found = _Branches(options, servo, vary, start, to, how, out, dict(results))
        try:
            for model in models:
                found.add(model)
            if found.branches:
                options.outputs.write(_pictures, found.branches, out)
                for aside in drop_replaced(found.moved):
                    complain("casahunt diagram", f"{aside} is of an earlier run, which this one has not replaced")
        except KeyboardInterrupt:
            where = "no point was computed" if found.stale else f"the points computed so far are in {out}"
            raise KeyboardInterrupt(f"{word()}; {where}") from None
    summary = {
        "out": str(out) if found.branches else None,
        "continuation": "natural" if options.natural else "pseudo-arclength",
        "solver": how.solver,
        **record_of(servo),
        "branches": found.branches,
        "failures": found.failures,
        "wall_s": options.outputs.seconds,
    }
    every = [one for branch in found.branches for one in (branch, *branch.lopsided)]
    said = {special.kind for branch in every for special in branch.special}
    written = "" if options.outputs.troubles else str(out)  # "" where something is missing in it
    give(options, summary, diagram_answer(found.branches, parts_of(servo), written), said=said)
    return 1 if found.failures else 0


@dataclass
class _Branches:
    """The branches of a run, and what is missing of them; what is asked for, as in `diagram`, comes first."""

    asked: Asked
    servo: Servo | Loop
    vary: str
    start: float | None
    to: float | None
    options: Options
    out: Path
    stale: dict[str, bytes]
    """Files that an earlier run may have left, and what stands in each."""
    branches: list[Branch[Any]] = field(default_factory=list)
    failures: list[str] = field(default_factory=list)
    moved: dict[Path, Path] = field(default_factory=dict)

    def add(self, model: Model | None) -> None:
        """Compute the branch of a model, or of a loop of parts, and say what is missing of it."""
        try:
            branch = self.branch(model, self.start if model is None else self.start or self.own_start(model))
        except NoOrbit as error:
            start = None if model is None else self.instead(model)
            if start is None:
                self.lacks(error)
                return
            self.lacks(NoOrbit(f"{error.plain}; it is drawn from gain {start:g}", evidence=error.evidence))
            branch = self.branch(model, start)
        self.branches.append(branch)
        if failure := _shortfall(branch, self.to, natural=self.asked.natural):
            self.lacks(failure)
        for gap in (*branch.missed, *(gap for pair in branch.lopsided for gap in pair.missed)):
            complain("casahunt diagram", f"{model}: {gap.meaning}" if model else gap.meaning)
            if model and gap.kind == FOLD.kind and gap in branch.missed:  # what the diagram is there for
                self.failures.append(gap.meaning)

    def lacks(self, failure: str | NoOrbit) -> None:
        """Say what is missing."""
        self.failures.append(str(failure))
        complain("casahunt diagram", failure, details=self.asked.details)

    def own_start(self, model: Model) -> float:
        """The gain that the servo has for itself."""
        effort.at(lambda: f"{model}: looking for the gain to start from")
        return starting_gain(cast(Servo, self.servo), model, self.options)

    def instead(self, model: Model) -> float | None:
        """Where its cycles begin above the gain that was asked for; None where none is known to."""
        with suppress(NoOrbit):
            if self.start is not None and (start := self.own_start(model)) > self.start:
                return start
        return None

    def branch(self, model: Model | None, start: float | None) -> Branch[Any]:
        """Compute a branch; its table is on disk before more is computed, its archive when it ends, however that is."""
        files = {end: self.out / f"{model or 'loop'}{end}" for end in SIGNS}
        so_far: list[Branch[Any]] = []

        def report(branch: Branch[Any]) -> None:
            with held():
                if not so_far:  # what an earlier run has left makes room
                    keep_others(self.out, self.stale)  # looked at long ago, perhaps
                    self.moved.update(set_aside(self.out / name for name in self.stale))
                    self.stale.clear()
                if not so_far or len(branch.orbits) > len(so_far[-1].orbits) or branch.lopsided:
                    branch.to_csv(files[".csv"])
                so_far.append(branch)
                _tell_news(branch, so_far[-2:-1], model)
            effort.heard()

        asked: Any = {"to": self.to, "options": self.options, "natural": self.asked.natural, "report": report}
        whose: tuple[Any, Any] = self.servo, model
        try:
            branch: Branch[Any] = diagram(*whose, vary=self.vary, start=start, **asked)
            report(branch)
            if model:
                branch = with_lopsided(branch, options=self.options, progress=self.lopsided)
                report(branch)
            return branch
        finally:
            if so_far:
                with held():
                    save_branch(so_far[-1], files[".npz"])

    def lopsided(self, orbit: Orbit) -> None:
        """Say that a cycle of a lopsided pair is there."""
        tell(f"{orbit_line(orbit)}  lopsided")
        effort.heard()


def _tell_news(branch: Branch[Any], before: list[Branch[Any]], model: Model | None) -> None:
    """Say how a branch has grown; before: what it was, or nothing."""
    orbits, special = max(((len(each.orbits), len(each.special)) for each in before), default=(0, 0))
    met = {id(one.orbit): one for one in branch.special[special:]}
    new = {id(orbit) for orbit in branch.orbits[orbits:]}
    every, name = each_stays(), model or "loop"
    for orbit, _ in branch.along():
        one = met.get(id(orbit))
        if one is not None and (every or one.kind == FOLD.kind):  # where hunting ends is a milestone to everybody
            at = f"gain {short(one.value)} V/rad" if model else f"{branch.vary} {short(one.value)}"
            say(f"{name:7s} {one.meaning}" if every else f"{name}: cycles of one kind end at {at}")
        if id(orbit) in new:
            tell(orbit_line(orbit, vary=branch.vary))


def _shortfall(branch: Branch[Any], to: float | None, *, natural: bool) -> str:
    """What is missing of a branch that does not come back to the value where it began; "" where nothing is.

    Natural continuation is to end at a fold; the branch of a loop of parts may end where its cycles do.
    """
    model, start, end = getattr(branch, "model", None), branch.values[0], branch.values[-1]
    if model is None:
        return branch.ended if branch.end.kind in BROKEN_OFF else ""
    whose = f"the branch of the {model} servo was followed"
    if natural:
        if branch.special and branch.special[-1].orbit is branch.orbits[-1]:
            return ""
        return (
            f"{whose} by natural continuation from gain {start:g} to gain {end:.10g}, but not to a fold: "
            f"{branch.ended}; without --natural it may lead further"
        )
    if len(branch.orbits) > 1 and end in (start, to):
        return ""
    return (
        f"{whose} from gain {start:g} to gain {end:.6g}, but not back to where it began: {branch.ended}; "
        "another --tol or --from may lead further"
    )


def _pictures(branches: list[Any], out: Path) -> None:
    keep_others(out, dict.fromkeys(PICTURES, PICTURE_SIGN))
    firsts = [branch.orbits[0] for branch in branches]
    for name, picture in PICTURES.items():
        draw(out / name, picture, branches if picture.startswith("branches") else firsts)


# What `casahunt diagram` says of branches of cycles


def diagram_answer(branches: Sequence[Branch[Any]], parts: list[str], out: str) -> Answer:
    """What is said of the branches of a servo.

    parts: the line of its parts; out: where they are written, "" where they are not.
    """
    written = [f"written to {out}"] if out and branches else []
    return Answer([*(line for branch in branches for line in _plain(branch, parts)), *written], _details(branches))


def _plain(branch: Branch[Any], parts: list[str]) -> Iterator[str]:
    if not hasattr(branch, "model"):
        yield f"loop: {len(branch.orbits)} cycles along {branch.vary}; {branch.ended}"
        yield from parts
        for special in branch.special:
            if special.kind == FOLD.kind:
                yield item("they turn back at", f"{branch.vary} = {short(special.value)}")
        return
    folds = [special.orbit for special in branch.special if special.kind == FOLD.kind]
    gains = branch.values
    last = max(folds, key=lambda orbit: orbit.gain, default=None)
    if last is not None and last.gain >= gains.max():
        yield f"{branch.model}: the servo can hunt up to gain {volts_per(last.gain)}, and not above it"
        yield item("there", f"amplitude {position(last.amplitude)}, period {short(last.period)} s")
    else:
        yield f"{branch.model}: the servo can hunt; where that ends was not met ({branch.ended})"
    first = branch.orbits[0]
    size = f"amplitude {position(first.amplitude)}, period {short(first.period)} s"
    yield item(f"at {volts_per(first.gain)}", size)
    broken = [short(special.orbit.gain) for special in branch.special if special.kind == SYMMETRY_BREAKING.kind]
    if broken:
        yield item("uneven swings", f"begin or end at gain {', '.join(broken)} {label(GAIN_UNIT)}")
    yield item("computed", f"{len(branch.orbits)} cycles from gain {short(gains.min())} to {volts_per(gains.max())}")


def _details(branches: Sequence[Branch[Any]]) -> Iterator[str]:
    for branch in branches:
        if hasattr(branch, "model"):
            yield f"{branch.model}: {len(branch.orbits)} points; {branch.ended}"
        for special in branch.special:
            yield f"  {special.meaning}"
        for pair in branch.lopsided:
            yield (
                f"  lopsided, one of a pair whose other is its mirror image: {len(pair.orbits)} points from gain "
                f"{pair.values[0]:.8g}; {pair.ended}"
            )
            for special in pair.special:
                yield f"    {special.meaning}"
