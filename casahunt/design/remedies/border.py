"""The smallest size of a remedy that ends hunting: where the branch of hunting cycles in that size ends.

    fold       a stable and an unstable cycle merge (continuation's `largest`, `smallest`), located and confirmed
    Hopf       the cycle shrinks to a point
    grazing    the cycle meets an event of the remedy with no speed, or for the first time, and no cycle follows
    unstable   the cycle becomes so unstable that no motion settles on it, and its branch can be followed no further
    none       the branch goes on to the last size that is looked at

The branch begins with a small remedy, at the cycle on which a motion of the servo settles that has just stopped.
"""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np

from ... import effort
from ...continuation import FOLD, GRAZING, Branch, follow
from ...errors import NoOrbit
from ...orbits import SystemOrbit
from ...orbits.adapt import Options
from ...servo.parts.loop import Loop
from ...servo.parts.part import Part
from ...servo.parts.remedy import Remedy
from ...servo.parts.verbs import fold_in, loop_cycle

Kind = Literal["fold", "grazing", "Hopf", "unstable", "none", "not found"]
BORDERS = ("fold", "grazing", "Hopf", "unstable")
"""Kinds of a border."""

SMALLER_AND_LARGER = (1.0, 4.0, 0.25, 16.0)
"""First sizes that are tried, in units of the remedy's own: the smallest may be too small to be told from none, or
end hunting already."""
SIZE_KNOWN = 1e-6
"""Relative error above which a size is not told."""
TURN_KNOWN = 1e-4
"""Relative distance of two cycles above which what lies between them is no border."""
BRANCH_TOLERANCES = (1e-9, 1e-10, 1e-8, 1e-7)
"""Of branches without a fold.  Where one ends at an event that is met for the first time, an independent stick map has
the same size to 1e-12 of it at 1e-9, to 1e-6 at 1e-7."""
STRAYS = 10.0
"""A half multiplier from which no motion settles on a cycle: half a period later it is ten times as far off.  Next to
slips that all but stop half-way multipliers become 1e20, and the branch turns, if at all, where no double shows it."""
MOST_CYCLES = 600
"""Orbits after which a branch is left: next to slips that all but stop half-way it is followed in small steps."""
MOST_WORK_OF_A_BORDER = 1e6
"""Work (effort.py), half a minute of a processor or less, after which a border is given up: with a bristle such steps
become ever smaller, and a branch goes on for minutes without getting on."""


@dataclass(frozen=True, eq=False)
class Border:
    """Where hunting ends.

    Attributes
    ----------
    kind : how; "none" where it does not up to `size`, "not found" where the branch broke off there.
    size, error : the size, and the estimated error of it, in its unit.
    first, orbit : the first and the last cycle; None where not even the first was computed.
    moves : by how much the size moves with other parameters of the loop; {} where it is no fold.
    why : a sentence, where it is no fold.
    """

    kind: Kind
    size: float
    error: float
    first: SystemOrbit | None
    orbit: SystemOrbit | None
    moves: dict[str, float]
    why: str = ""


@dataclass(frozen=True, eq=False)
class Scales:
    """What sizes are measured by: amplitude [rad] and period [s] of the cycle without the remedy."""

    amplitude: float
    period: float

    def of(self, remedy: Remedy, loop: Loop) -> float:
        """The scale of the sizes of a remedy."""
        if remedy.scale == "own":
            return loop.value(remedy.size)
        by_name = {"amplitude": self.amplitude, "rate": 1 / self.period, "period": self.period, "one": 1.0}
        return by_name[remedy.scale] if remedy.scale in by_name else loop.value(remedy.scale)


def with_remedy(loop: Loop, remedy: Remedy, size: float) -> Loop:
    """The loop with a remedy of a size, which it may have already, of another size or none."""
    if remedy.part is None or remedy.part in loop.parts:
        return loop.replace(**{remedy.size: size})
    if not remedy.instead:
        return loop.with_parts(remedy.part, **{remedy.size: size})
    parts: tuple[Part, ...] = tuple(remedy.part if part.name == remedy.instead else part for part in loop.parts)
    return Loop(parts, {**loop.values, remedy.size: size}, loop.name)


def border(loop: Loop, remedy: Remedy, start: dict[str, float], scales: Scales, options: Options) -> Border:
    """The border of hunting in the size of a remedy, as far as `MOST_WORK_OF_A_BORDER` leads.

    loop, start: the loop without it, and the state of its cycle when it has just stopped.
    Raises effort.GivenUp: beyond the work that is allowed in all.
    """
    way: list[SystemOrbit] = []
    try:
        with effort.at_most(MOST_WORK_OF_A_BORDER):
            return _from_a_little(loop, remedy, start, scales, options, way)
    except effort.PartGivenUp:
        spent = f"after the work of {MOST_WORK_OF_A_BORDER:g} intervals"
        if not way:
            why = f"given up before a first cycle was found, {spent}"
            return Border("not found", math.nan, math.nan, None, None, {}, why)
        values = [orbit.problem.value(remedy.size) for orbit in way]
        farthest = int(np.argmax(remedy.sense * np.array(values)))
        why = f"{_went(values[0], values[farthest], remedy)}: given up {spent}"
        return Border("not found", values[farthest], math.nan, way[0], way[farthest], {}, why)


def _from_a_little(
    loop: Loop, remedy: Remedy, start: dict[str, float], scales: Scales, options: Options, way: list[SystemOrbit]
) -> Border:
    """The border, from a cycle with little of the remedy; `way` is told the cycles that lead there."""
    unit = scales.of(remedy, loop)
    last, why = remedy.last * unit, ""
    sizes = [
        unit * (1 - (1 - remedy.first) * factor if remedy.starts_at_one else remedy.first * factor)
        for factor in SMALLER_AND_LARGER
    ]
    for first in sizes:
        mended = with_remedy(loop, remedy, first)
        try:
            cycle = loop_cycle(mended, remedy.size, start=start, options=options)
        except NoOrbit as refusal:
            why = why or str(refusal)
            continue
        way.append(cycle)
        return _along(cycle, remedy, last, options, way)
    tried = ", ".join(f"{size:.4g}" for size in sizes)
    return Border("not found", math.nan, math.nan, None, None, {}, f"no cycle at {remedy.size} = {tried}: {why}")


def _went(first: float, last: float, remedy: Remedy) -> str:
    """From where to where cycles were followed."""
    return f"followed from {first:.4g} to {last:.4g} {remedy.unit}".rstrip()


def _along(
    cycle: SystemOrbit, remedy: Remedy, last: float, options: Options, way: list[SystemOrbit]
) -> Border:
    """The border, from a cycle on."""
    with suppress(NoOrbit):
        fold = fold_in(cycle, remedy.size, sense=remedy.sense, to=last, options=options, max_points=MOST_CYCLES,
                       progress=way.append)  # fmt: skip
        if fold.value_error <= SIZE_KNOWN:
            return Border("fold", fold.value, fold.absolute_error, cycle, fold.orbit, fold.sensitivities)
    before = None
    for tol in BRANCH_TOLERANCES:
        branch = follow(cycle, remedy.size, to=last, monitors=(FOLD, GRAZING), options=replace(options, tol=tol),
                        max_points=MOST_CYCLES, progress=way.append)  # fmt: skip
        if (found := _told(branch, before, last, tol) or _turned(branch, remedy.sense)) is not None:
            return replace(found, first=cycle)
        same = before is not None and abs(branch.values[-1] - before.values[-1]) <= SIZE_KNOWN * abs(branch.values[-1])
        before = branch
        if same or branch.end.kind == "points":
            break
    why = f"{_went(branch.values[0], branch.values[-1], remedy)}: {branch.end}"
    return Border("not found", float(branch.values[-1]), math.nan, cycle, branch.orbits[-1], {}, why)


def _turned(branch: Branch[SystemOrbit], sense: int) -> Border | None:
    """The border where a branch comes back between two of its cycles, where no cycle is computed to its tolerance."""
    values = branch.values
    i = int(np.argmax(sense * values))
    missed = next((each.meaning for each in branch.missed if each.kind == FOLD.kind), "")
    if not missed or not 0 < i < values.size - 1:
        return None
    value, error = float(values[i]), float(np.abs(np.diff(values[i - 1 : i + 2])).max())
    if error > TURN_KNOWN * abs(value):
        return None
    return Border("fold", value, error, None, branch.orbits[i], {}, missed)


def _told(branch: Branch[SystemOrbit], before: Branch[SystemOrbit] | None, last: float, tol: float) -> Border | None:
    """The border at the end of a branch; None where it tells none.

    before: the same branch at another tolerance.
    """
    end, orbit, value = branch.end, branch.orbits[-1], float(branch.values[-1])
    for special in branch.special:
        if special.kind == "fold" and special.orbit.parameter_error < SIZE_KNOWN:
            error = max(special.orbit.parameter_error, tol) * abs(special.value)
            return Border("fold", special.value, error, None, special.orbit, {}, special.meaning)
    if end.kind in ("grazing", "Hopf"):
        error = max(end.error, 10 * tol * abs(end.value))
        return Border(cast(Kind, end.kind), end.value, error, None, orbit, {}, str(end))
    if end.kind == "range" and abs(value - last) <= SIZE_KNOWN * abs(last):
        return Border("none", last, 0.0, None, orbit, {}, "")
    if end.kind == "stuck" and before is not None and before.end.kind == "stuck":
        apart, mu = abs(value - float(before.values[-1])), float(np.abs(orbit.multipliers.half).max())
        if apart <= SIZE_KNOWN * abs(value) and mu > STRAYS:
            why = f"half multiplier {mu:.0e} there: no motion settles on it, and its branch is followed no further"
            return Border("unstable", value, max(apart, 100 * tol * abs(value)), None, orbit, {}, why)
    return None
