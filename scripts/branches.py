"""All branches of problems/, by default steps and by steps of a tenth, against what is known of them.

    python scripts/branches.py [--only lorenz gears] [--time-limit 60] [--json FILE]

Every file of problems/ that has `branches` is asked; each branch is followed twice, once with the largest step that is
taken by default and once with a tenth of it, and a row says

    lost, invented     special points that are known and not found, or found and not known (problems/gallery.py)
    differ             those that the run with small steps has and the other has not, or the other way round
    uncounted          steps on which the number of unstable multipliers changes by what the points in it do not explain
    turns              points at which the parameter turns round and no fold is next to them
    end, s             of the branch, beside its true one; seconds

A fold, a flip or a loss of symmetry changes the number of half multipliers outside of the unit circle by one, a
Neimark-Sacker point by two, a grazing by any.  Points lie in the step that is nearest in parameter, period and extrema.

Exit code 1 if anything is lost, invented, different, uncounted or ends in another way, or later than the limit.
"""

from __future__ import annotations

import argparse
import importlib
import json
import math
import pkgutil
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

import problems  # noqa: E402
from casahunt import NoOrbit  # noqa: E402
from casahunt.continuation import Branch, follow  # noqa: E402
from problems.gallery import Course, compared  # noqa: E402

TENTH = 0.1
MOST = 6
"""Points of a row that are printed."""
MANY = 5000
"""Points after which a branch of small steps is given up."""
CHANGES = {"fold": 1, "flip": 1, "symmetry breaking": 1, "branch point": 1, "Neimark-Sacker": 2}
"""By how many the unstable multipliers change at a point of a kind; the others are not counted across."""
SAME = 1e-5
"""Runs of different steps find the same point, in units of the larger of one and the value."""
ON_THE_CIRCLE = 1e-6
"""A multiplier this near to the unit circle is on neither side of it."""
PREFERRED = 6.0
"""Another step has to lead by a point so many times nearer than one that has its value: of the gallery 4 to 16 do."""
STILL = 1e-9
"""What changes by less than this along a branch stands still, relative where it is larger than one."""


@dataclass(frozen=True)
class Row:
    """One branch, followed once."""

    name: str
    steps: str
    points: int
    seconds: float
    found: list[tuple[str, float]]
    missed: list[str]
    lost: list[tuple[str, float]]
    invented: list[tuple[str, float]]
    uncounted: list[str]
    turns: list[float]
    end: str
    ends: tuple[str, ...]

    @property
    def fails(self) -> bool:
        """Whether anything is wrong with it."""
        wrong = self.missed or self.lost or self.invented or self.uncounted or self.turns
        return bool(wrong) or self.end not in self.ends

    def __str__(self) -> str:
        listed = ", ".join(f"{kind} {value:.9g}" for kind, value in self.found[:MOST]) or "-"
        said = [f"{self.name:32} {self.steps:8} {self.points:5} {self.seconds:7.2f} s  {self.end:20} {listed}"]
        for what in ("lost", "invented", "missed", "uncounted", "turns"):
            if there := getattr(self, what):
                said.append(f"    {what}: " + "; ".join(map(str, there[:MOST])) + (" ..." if len(there) > MOST else ""))
        if self.end not in self.ends:
            said.append(f"    end: should be {' or '.join(self.ends)}")
        return "\n".join(said)


def courses(only: Sequence[str] = ()) -> Iterator[Course]:
    """The branches of the files of problems/ of these names, or of all."""
    for module in pkgutil.iter_modules(problems.__path__):
        if not only or module.name in only:
            branches = getattr(importlib.import_module(f"problems.{module.name}"), "branches", None)
            yield from branches() if branches else ()


def row_of(course: Course, orbit: Any, largest_step: float | None, limit: float) -> Row:
    """Follow a branch and hold it against what is known."""
    began = time.perf_counter()
    steps = "default" if largest_step is None else "tenth"
    how = dict(course.how) if largest_step is None else {"max_points": MANY, **course.how}
    try:
        branch: Branch[Any] = follow(
            orbit, course.vary, to=course.to, largest_step=largest_step, time_limit=limit, **how
        )  # fmt: skip
    except NoOrbit as error:
        seconds = time.perf_counter() - began
        lost = list(course.special)
        return Row(course.caption, steps, 0, seconds, [], [], lost, [], [], [], f"NoOrbit: {error}", course.end)
    seconds = time.perf_counter() - began
    found = [(special.kind, float(special.value)) for special in branch.special]
    lost, invented = compared(found, course.special, course.within)
    missed, at = [one.meaning for one in branch.missed], places(branch)
    return Row(
        course.caption, steps, len(branch.orbits), seconds, found, missed, list(lost), list(invented),
        uncounted(branch, at), turns(branch, at), branch.end.kind, course.end,
    )  # fmt: skip


def places(branch: Branch[Any]) -> list[int]:
    """The number i of the step orbits[i] -> orbits[i + 1] of every special point, in their order.

    A step whose values have that of the point between them is preferred: a coarse one bends away from it.  At a fold,
    and in a step that goes round one, they have not.
    """
    orbits = [*branch.orbits, *(special.orbit for special in branch.special)]
    sampled = [orbit.sample(2)[1] for orbit in orbits]
    extrema = np.array([np.concatenate([states.min(axis=1), states.max(axis=1)]) for states in sampled])
    values = np.append(branch.values, [special.value for special in branch.special])
    features = np.column_stack([values, [math.log(orbit.period) for orbit in orbits], extrema])
    spans = np.ptp(features, axis=0)
    moves = spans > STILL * np.maximum(1, np.max(np.abs(features), axis=0))
    features = features[:, moves] / spans[moves]
    path, points = features[: len(branch.orbits)], features[len(branch.orbits) :]
    way = np.diff(path, axis=0)
    squares = np.maximum(np.sum(way**2, axis=1), STILL**2)
    at: list[int] = []
    lows, highs = np.sort([branch.values[:-1], branch.values[1:]], axis=0)
    for point, special in zip(points, branch.special, strict=True):
        first, seen = at[-1] if at else 0, point - path[:-1]
        along = np.clip(np.sum(seen * way, axis=1) / squares, 0, 1)
        inside = (lows <= special.value) & (special.value <= highs)
        off = np.linalg.norm(seen - along[:, None] * way, axis=1)
        off[~inside] *= 1.0 if special.kind == "fold" else PREFERRED
        at.append(first + int(np.argmin(off[first:])))
    return at


def uncounted(branch: Branch[Any], at: Sequence[int]) -> list[str]:
    """The steps on which multipliers cross the unit circle, and no point in them says so.

    A point may as well lie in the step beside the one it was placed in: the two are then looked at together.
    """
    counts = [unstable(orbit) for orbit in branch.orbits]
    kinds: list[list[str]] = [[] for _ in counts]
    for special, j in zip(branch.special, at, strict=True):
        kinds[j].append(special.kind)

    def agree(first: int, last: int) -> bool:
        """Whether the points between two orbits say what the counts do; so, too, where one of these is not known."""
        before, after, here = counts[first], counts[last], sum(kinds[first:last], [])
        alike = len({orbit.repeats for orbit in branch.orbits[first : last + 1]}) == 1
        if before is None or after is None or not alike or any(kind not in CHANGES for kind in here):
            return True
        reach = {0}
        for kind in here:
            reach = {r + change for r in reach for change in (CHANGES[kind], -CHANGES[kind])}
        return after - before in reach

    said = []
    for i in range(len(counts) - 1):
        pairs = [(a, a + 2) for a in (i - 1, i) if 0 <= a and a + 2 < len(counts) and kinds[a] + kinds[a + 1]]
        if not agree(i, i + 1) and not any(agree(*pair) for pair in pairs):
            a, b = branch.values[i : i + 2]
            said.append(f"{a:.8g} -> {b:.8g}: {counts[i]} -> {counts[i + 1]} unstable, {kinds[i] or 'no point'}")
    return said


def unstable(orbit: Any) -> int | None:
    """How many half multipliers are outside of the unit circle; None where they are not known, or one is on it."""
    multipliers = orbit.multipliers
    if not multipliers.trusted:
        return None
    sizes = np.abs(multipliers.half[1:])
    known = np.all(np.abs(sizes - 1) > max(ON_THE_CIRCLE, float(multipliers.error)))
    return int(np.sum(sizes > 1)) if known else None


def turns(branch: Branch[Any], at: Sequence[int]) -> list[float]:
    """Values at which the parameter turns round and no fold, and no grazing, is in the two steps on either side."""
    way = np.diff(branch.values)
    way = np.where(np.abs(way) > STILL * np.maximum(1, np.abs(branch.values[1:])), np.sign(way), 0)
    folds = {j for special, j in zip(branch.special, at, strict=True) if special.kind in ("fold", "grazing")}
    turned = [i for i in range(1, len(way)) if way[i] * way[i - 1] < 0]
    return [float(branch.values[i]) for i in turned if not folds & {i - 2, i - 1, i, i + 1}]


def run(course: Course, limit: float) -> tuple[list[Row], list[tuple[str, float]]]:
    """Both runs of a branch, and the points in which they differ."""
    orbit = course.start()
    rows = [row_of(course, orbit, step, limit) for step in (None, TENTH * orbit.problem.largest_step)]
    differ = compared(rows[0].found, rows[1].found, SAME)
    return rows, [*differ.lost, *differ.invented]


def main(arguments: Sequence[str] | None = None) -> int:
    """Run as a command.  Returns 1 where a branch fails."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--only", nargs="*", default=(), help="files of problems/, such as lorenz; default all")
    parser.add_argument("--time-limit", type=float, default=60.0, help="seconds of one branch")
    parser.add_argument("--json", help="file for all rows")
    chosen = parser.parse_args(arguments)
    rows: list[Row] = []
    failures = 0
    for course in courses(chosen.only):
        both, differ = run(course, chosen.time_limit)
        failures += sum(row.fails for row in both) + bool(differ)
        print(*both, sep="\n")
        if differ:
            print(f"    differ, {len(differ)}: {differ[:MOST]}")
        sys.stdout.flush()
        rows += both
    print(f"{len(rows)} runs, {failures} failures, longest {max((row.seconds for row in rows), default=0.0):.1f} s")
    if chosen.json:
        Path(chosen.json).write_text(json.dumps([asdict(row) for row in rows], indent=1), encoding="utf-8")
    return int(failures > 0)


if __name__ == "__main__":
    sys.exit(main())
