"""The smallest size of a remedy that ends hunting: where the branch of hunting cycles in that size ends.

    fold       a stable and an unstable cycle merge (continuation's `largest`, `smallest`), located and confirmed
    Hopf       the cycle shrinks to a point
    grazing    the cycle meets an event of the remedy with no speed, or for the first time, and no cycle follows
    instability the cycles lose their stability, and motions beyond do not hunt on another one, although unstable cycles
               go on to a fold or beyond
    motions    its branch could not be followed so far: simulated motions hunt up to there, and come to rest beyond
    none       the branch goes on to the last size that is looked at

The branch begins with a small remedy, at the cycle on which a motion of the servo settles that has just stopped.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Literal, cast

import numpy as np

from ... import effort
from ...continuation import FOLD, GRAZING, Branch, follow
from ...errors import NoOrbit
from ...orbits import Orbit, SystemOrbit
from ...orbits.adapt import Options
from ...servo.parts.loop import Loop
from ...servo.parts.part import Part
from ...servo.parts.remedy import Remedy
from ...servo.parts.verbs import fold_in, loop_cycle
from .fate import ENDED, Swing, scan

Kind = Literal["fold", "grazing", "Hopf", "instability", "motions", "none", "not found"]
BORDERS = ("fold", "grazing", "Hopf", "instability", "motions")
"""Kinds of a border."""
EXACT = ("fold", "grazing", "Hopf")
"""Of those, where a branch ends."""
LOSSES = ("symmetry breaking", "flip", "Neimark-Sacker")
"""Special points at which cycles lose their stability and go on."""

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
MOST_CYCLES = 300
"""Orbits after which cycles are followed no further (most borders take 4 to 74): where slips all but stop
half-way, steps become ever smaller, and multipliers 1e20, while motions tell in a second where hunting ends."""
MOST_WORK_OF_A_BORDER = 1e6
"""Work (effort.py), half a minute of a processor or less, after which the same holds: with a bristle a cycle may take
long."""
FIRST_MORE, MOTIONS_KNOW = 0.2, 5e-3
"""By how much more a remedy is at first, relatively, to which a motion that hunts is handed on; and in the end."""
MOTIONS_ERROR = 0.02
"""Relative error that is said of a size: next to a fold motions may leave hunting too soon, or too late."""
BESIDE, MOST_FAMILIES = 0.03, 4
"""So much beyond a border, relatively, motions are looked at, and so much before it hunting was seen; where they hunt
beyond, cycles are followed from there, so many times at most."""
CHOSEN = 0.1
"""What is recommended is so much more than the border, if nothing else is asked for."""
MOST_TO_THE_LOSS = 60
"""Orbits on the way to where cycles lose their stability."""
INSIDE = 1e-6
"""A multiplier that is larger than 1 by more makes a cycle unstable."""
NO_FIRST, NO_FARTHER = "no cycle with a little of it was found", "and could not be farther"
"""Where nothing can be followed, and where it stops."""
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
    evidence : what stopped the search, in the words of the trade; "" where nothing did.
    swing : the last motion that hunts, where motions show it.
    fold : where the branch folds, if hunting ends elsewhere.
    """

    kind: Kind
    size: float
    error: float
    first: SystemOrbit | None
    orbit: SystemOrbit | None
    moves: dict[str, float]
    why: str = ""
    evidence: str = ""
    swing: Swing | None = None
    fold: float = math.nan


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
    """The border of hunting in the size of a remedy, as far as `MOST_WORK_OF_A_BORDER` leads; behind that by motions.

    loop, start: the loop without it, and the state of its cycle when it has just stopped.
    Raises effort.GivenUp: beyond the work that is allowed in all.
    """
    way: list[SystemOrbit] = []
    try:
        with effort.at_most(MOST_WORK_OF_A_BORDER):
            found = _from_a_little(loop, remedy, start, scales, options, way)
    except effort.PartGivenUp:
        found = _given_up(remedy, way, f"given up after the work of {MOST_WORK_OF_A_BORDER:g} intervals")
    except NoOrbit as refusal:
        found = _given_up(remedy, way, str(refusal))
    last = remedy.last * scales.of(remedy, loop)
    if found.kind == "not found" and way:
        found = _by_motions(loop, remedy, last, way, found)
    return _confirmed(loop, remedy, found, last, options, way)


def _given_up(remedy: Remedy, way: list[SystemOrbit], evidence: str) -> Border:
    """How far cycles were followed, and what stopped it."""
    if not way:
        return Border("not found", math.nan, math.nan, None, None, {}, NO_FIRST, evidence)
    values = [orbit.problem.value(remedy.size) for orbit in way]
    farthest = int(np.argmax(remedy.sense * np.array(values)))
    why = f"{_went(values[0], values[farthest], remedy)}, {NO_FARTHER}"
    return Border("not found", values[farthest], math.nan, way[0], way[farthest], {}, why, evidence)


def _outermost_stable(way: Sequence[SystemOrbit], remedy: Remedy) -> tuple[float, SystemOrbit] | None:
    """The stable cycle with the most of the remedy among those that were seen, and its size."""
    values = [(orbit.problem.value(remedy.size), orbit) for orbit in way]
    outwards = sorted(values, key=lambda each: -remedy.sense * each[0])
    return next((each for each in outwards if each[1].stable), None)


def _stable_up_to(loop: Loop, found: Border, way: Sequence[SystemOrbit], remedy: Remedy) -> bool:
    """Whether hunting goes on up to a border: no cycle on the way has lost its stability before, as those behind a fold
    do whose multiplier passes +1; and next to it a cycle is stable, or a motion hunts."""
    outermost = _outermost_stable(way, remedy)
    if outermost is None:
        return False
    size, cycle = outermost
    if any(_lost(orbit) for orbit in way if _before(size, orbit.problem.value(remedy.size), remedy)):
        return False
    inside = more_of(remedy, found.size, 1 - BESIDE)
    if not _before(size, inside, remedy):
        return True
    return scan(with_remedy(loop, remedy, inside), Swing.of(cycle)).swing is not None


def _lost(orbit: SystemOrbit) -> bool:
    """Whether a cycle has lost its stability otherwise than behind a fold."""
    mu = orbit.multipliers.half[1:]
    unstable = mu[np.abs(mu) > 1 + INSIDE]
    return bool(unstable.size > 1 or np.any(unstable.real < 0))


def _before(size: float, other: float, remedy: Remedy) -> bool:
    """Whether a size is less of the remedy than another one."""
    return remedy.sense * size < remedy.sense * other


def _by_motions(loop: Loop, remedy: Remedy, last: float, way: Sequence[SystemOrbit], found: Border) -> Border:
    """The border as motions show it, beyond the stable cycle that is farthest out on the way; as it was where they
    do not."""
    outermost = _outermost_stable(way, remedy)
    if outermost is None:
        return found
    at, cycle = outermost
    ended = end_of_motions(loop, remedy, Swing.of(cycle), at, last)
    if ended is None:
        return found
    size, swing = ended
    if size == at:
        return found
    why, fold = f"{_went(way[0].problem.value(remedy.size), at, remedy)}, on as motions", math.nan
    if found.kind == "fold":
        why = f"cycles go on to a fold at {found.size:.6g} {remedy.unit}, but are not stable up to there".strip()
        fold = found.size
    return Border("motions", size, MOTIONS_ERROR * abs(size), way[0], cycle, {}, why, swing=swing, fold=fold)


def _at_the_loss(
    loop: Loop, remedy: Remedy, way: Sequence[SystemOrbit], found: Border, options: Options
) -> Border | None:
    """The border where cycles lose their stability; None where that is not located, or motions hunt beyond."""
    outermost = _outermost_stable(way, remedy)
    if outermost is None:
        return None
    _, cycle = outermost
    with suppress(NoOrbit):
        branch = follow(cycle, remedy.size, to=found.size, options=options, max_points=MOST_TO_THE_LOSS)
        lost = next((special for special in branch.special if special.kind in LOSSES), None)
        if lost is None:
            return None
        beyond = with_remedy(loop, remedy, more_of(remedy, lost.value, 1 + BESIDE))
        if scan(beyond, Swing.of(cycle)).verdict not in ENDED:
            return None
        error = max(lost.orbit.parameter_error, options.tol) * abs(lost.value)
        on = f"unstable cycles go on to {found.size:.6g} {remedy.unit}".rstrip()
        why = f"{lost.meaning}; {on}{', where they fold' if found.kind == 'fold' else ''}"
        fold = found.size if found.kind == "fold" else math.nan
        return Border("instability", lost.value, error, way[0], lost.orbit, {}, why, fold=fold)
    return None


def end_of_motions(loop: Loop, remedy: Remedy, swing: Swing, size: float, last: float) -> tuple[float, Swing] | None:
    """The size from which on no motion hunts, from one on, which it is if none does there, and the last that does;
    None: one does at the last size, or is too unclear to be handed on.

    A motion that hunts is handed on to the next size, which is as near as it must be: those that start beside it leave
    hunting for good before it ends.  swing: one to begin with.
    """
    at, rests = size, size
    seen = scan(with_remedy(loop, remedy, at), swing)
    if seen.verdict in ENDED:
        return size, swing
    swing = seen.swing or swing
    while rests == size or abs(rests - at) > abs(more_of(remedy, at, 1 + MOTIONS_KNOW) - at):
        trial = more_of(remedy, at, 1 + FIRST_MORE) if rests == size else (at + rests) / 2
        seen = scan(with_remedy(loop, remedy, trial), swing)
        if seen.verdict in ENDED:
            rests = trial
        elif rests == size and (seen.swing is None or _before(last, trial, remedy)):
            return None
        else:
            at, swing = trial, seen.swing or swing
    return rests, swing


def _confirmed(
    loop: Loop, remedy: Remedy, found: Border, last: float, options: Options, way: list[SystemOrbit]
) -> Border:
    """A border as motions on both sides of it show it: where hunting goes on beyond, where that ends."""
    for _ in range(MOST_FAMILIES):
        if found.kind in EXACT and not _stable_up_to(loop, found, way, remedy):
            found = _at_the_loss(loop, remedy, way, found, options) or _by_motions(loop, remedy, last, way, found)
        if found.kind not in BORDERS:
            if found.kind != "none" or found.orbit is None or found.orbit.stable:
                return found
            found = _at_the_loss(loop, remedy, way, found, options) or _by_motions(loop, remedy, last, way, found)
            if found.kind not in BORDERS:
                return found
        before = found.swing or Swing.of(cast(Orbit, found.orbit))
        for factor in (1 + BESIDE, 1 + CHOSEN):
            at = more_of(remedy, found.size, factor)
            seen = scan(with_remedy(loop, remedy, at), before)
            if seen.swing is not None:
                break
        else:
            return found
        ended = found
        found, way = _another_family(loop, remedy, seen.swing, at, last, options)
        if found.kind in BORDERS:
            said = f"{_went(way[0].problem.value(remedy.size), found.size, remedy)}" if way else "motions hunt"
            beyond = f"other cycles go on beyond {ended.size:.6g} {remedy.unit}".rstrip()
            found = replace(found, why=f"{beyond}: {said}", fold=ended.size if ended.kind == "fold" else math.nan)
    return found


def _another_family(
    loop: Loop, remedy: Remedy, swing: Swing, size: float, last: float, options: Options
) -> tuple[Border, list[SystemOrbit]]:
    """The border of the cycles to which a motion that hunts beyond another one's goes on, and those."""
    way: list[SystemOrbit] = []
    found = Border("not found", size, math.nan, None, None, {}, NO_FIRST)
    try:
        with effort.at_most(MOST_WORK_OF_A_BORDER):
            cycle = loop_cycle(with_remedy(loop, remedy, size), remedy.size, start=swing.state, options=options)
            way.append(cycle)
            found = _along(cycle, remedy, last, options, way)
    except (NoOrbit, effort.PartGivenUp) as refusal:
        found = replace(found, evidence=str(refusal))
    if found.kind != "not found":
        return found, way
    if not way:
        ended = end_of_motions(loop, remedy, swing, size, last)
        if ended is not None:
            return Border("motions", ended[0], MOTIONS_ERROR * abs(ended[0]), None, None, {}, swing=ended[1]), way
        return found, way
    return _by_motions(loop, remedy, last, way, found), way


def more_of(remedy: Remedy, size: float, factor: float) -> float:
    """More of a remedy: farther from its absence, which may be at infinity or, where less is more, at zero."""
    absent = remedy.part.absent if remedy.part is not None and remedy.part.size else 0.0
    if absent == 0:
        return size * factor if remedy.sense > 0 else size / factor
    return size / factor if math.isinf(absent) else absent + (size - absent) * factor


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
    stopped = f"no cycle at {remedy.size} = {tried}: {why}"
    return Border("not found", math.nan, math.nan, None, None, {}, NO_FIRST, stopped)


def _went(first: float, last: float, remedy: Remedy) -> str:
    """From where to where cycles were followed."""
    return f"its cycles were followed from {first:.4g} to {last:.4g} {remedy.unit}".rstrip()


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
        if len(way) >= MOST_CYCLES:
            return _given_up(remedy, way, f"given up after {len(way)} cycles")
        branch = follow(cycle, remedy.size, to=last, monitors=(FOLD, GRAZING), options=replace(options, tol=tol),
                        max_points=MOST_CYCLES, progress=way.append)  # fmt: skip
        if (found := _told(branch, last, tol) or _turned(branch, remedy.sense)) is not None:
            return replace(found, first=cycle)
        same = before is not None and abs(branch.values[-1] - before.values[-1]) <= SIZE_KNOWN * abs(branch.values[-1])
        before = branch
        if same or branch.end.kind == "points":
            break
    why, last_cycle = f"{_went(branch.values[0], branch.values[-1], remedy)}, {NO_FARTHER}", branch.orbits[-1]
    return Border("not found", float(branch.values[-1]), math.nan, cycle, last_cycle, {}, why, str(branch.end))


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


def _told(branch: Branch[SystemOrbit], last: float, tol: float) -> Border | None:
    """The border at the end of a branch; None where it tells none."""
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
    return None
