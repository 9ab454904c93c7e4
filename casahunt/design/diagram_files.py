"""A diagram on the disk: MODEL.npz and MODEL.csv, whole after every point, taken up again where a run was ended.

The npz file holds the orbits and how they were computed; the CSV file is the table of the same points and is made from
it, never read.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from io import StringIO
from pathlib import Path
from typing import Any, NamedTuple

from ..axis_units import shown
from ..continuation import SpecialPoint
from ..errors import InputError
from ..export import table
from ..files import together, whole_text
from ..orbits import Archive, Options
from ..servo.branch import CSV_COLUMNS, Branch, csv_row, pair_rows
from ..servo.friction import Model
from ..servo.problem import HuntingOrbit
from ..servo.saved import load_run, save_branch
from ..servo.servo import Servo
from .diagram import DiagramPoint, branch_of

SIGNS = {".csv": ",".join(("", *CSV_COLUMNS[2:])).encode() + b"\n", ".npz": Archive.SIGN}
"""What stands in a table and in an archive of a diagram, and in no other file."""


@dataclass(frozen=True)
class DiagramTask:
    """What is asked for, of every model.

    Attributes
    ----------
    servo, start, options, natural : as in `diagram`; a start of None is found for each model.
    """

    servo: Servo
    start: float | None
    options: Options
    natural: bool

    @property
    def settings(self) -> dict[str, Any]:
        """By the names of the command line."""
        how = self.options
        return {"from": self.start, "tol": how.tol, "solver": how.solver, "natural": self.natural}


@dataclass(frozen=True)
class Words:
    """What of a diagram was put into words for its files: with a new point the others are written as they were.

    Attributes
    ----------
    orbits, rows : records of orbits, and the lines of points in the table.
    """

    orbits: dict[Any, Any] = field(default_factory=dict)
    rows: dict[DiagramPoint, str] = field(default_factory=dict)

    def of(self, point: DiagramPoint) -> str:
        """The lines of a point."""
        if point not in self.rows:
            rows = [csv_row(found.orbit, found.kind) for found in point.special]
            rows += [] if point.is_special else [csv_row(point.orbit, "")]
            self.rows[point] = _lines(rows)
        return self.rows[point]


def keep(
    task: DiagramTask,
    model: Model,
    points: Sequence[DiagramPoint],
    ended: str,
    out: Path,
    words: Words | None = None,
    beside: Branch | None = None,
) -> Branch:
    """Write the points so far (npz and csv).

    words: what was written of the same points before, to which that of the new ones is added; beside: the branch with
    its lopsided pairs, where these are known. Raises InputError, OSError: as `save_branch`.
    """
    words = words or Words()
    branch = beside or branch_of(task.servo, model, points, ended)
    with together():
        run = {**task.settings, "special_before": [i for i, point in enumerate(points) for _ in point.special]}
        save_branch(branch, out / f"{model}.npz", run=run, said=words.orbits)
        with whole_text(out / f"{model}.csv") as stream:
            table(stream, [*shown().columns({name: () for name in CSV_COLUMNS})])
            stream.writelines(words.of(point) for point in points)
            for number, pair in enumerate(branch.lopsided, 1):
                stream.write(_lines(pair_rows(pair, number)))
    return branch


def _lines(rows: Sequence[Sequence[Any]]) -> str:
    """Rows as the lines of a table."""
    whole = StringIO(newline="")
    columns = shown().columns(dict(zip(CSV_COLUMNS, zip(*rows, strict=True), strict=False)))
    table(whole, [*columns])(zip(*columns.values(), strict=True))
    return whole.getvalue().partition("\n")[2]  # without the header


class Left(NamedTuple):
    """What an earlier run has left: its points, why they end, and its lopsided pairs."""

    points: list[DiagramPoint]
    ended: str
    lopsided: tuple[Branch, ...] = ()


def saved_points(task: DiagramTask, model: Model, out: Path) -> Left:
    """The points that an earlier run of the same task has left; none where there is no file.

    Without a start asked for, it is theirs.
    Raises InputError: the file is damaged, or is of another task.
    """
    path = out / f"{model}.npz"
    if not path.exists():
        return Left([], "")
    branch, run = load_run(path)
    before = run.get("special_before", [])
    asked = {key: value for key, value in task.settings.items() if value is not None}
    another = [f"{key} = {run.get(key)}, not {value}" for key, value in asked.items() if run.get(key) != value]
    another += ["another servo"] * (branch.servo != task.servo) + ["another model"] * (branch.model != model)
    if not branch.orbits or "from" not in run or not isinstance(before, list) or len(before) != len(branch.special):
        another = ["it does not say how it was computed"]
    if another:
        raise InputError(
            f"resume: {str(path)!r} is of another run ({'; '.join(another)}); give what it was computed with, or leave "
            "--resume out for a new start"
        )
    special: dict[int, list[SpecialPoint[HuntingOrbit]]] = {}
    for point, i in zip(branch.special, before, strict=True):
        special.setdefault(i, []).append(point)
    points = [_point(orbit, special.get(i, [])) for i, orbit in enumerate(branch.orbits)]
    points[-1] = replace(points[-1], missed=branch.missed)  # behind which of them is not written, and tells nothing
    return Left(points, branch.ended, branch.lopsided)


def _point(orbit: HuntingOrbit, special: list[SpecialPoint[HuntingOrbit]]) -> DiagramPoint:
    """As it was before it was written: an orbit that is a special point is the same object."""
    same = [found.orbit for found in special if (found.orbit.gain, found.orbit.period) == (orbit.gain, orbit.period)]
    return DiagramPoint(same[0] if same else orbit, tuple(special))
