"""The smallest size of a remedy that ends hunting: where the branch of hunting cycles in that size ends.

    fold       a stable and an unstable cycle merge (continuation's `largest`, `smallest`), located and confirmed
    Hopf       the cycle shrinks to a point
    grazing    the cycle meets an event of the remedy with no speed, or for the first time, and no cycle follows
    motions    its branch could not be followed so far: simulated motions hunt up to there, and come to rest beyond
    none       the branch goes on to the last size that is looked at

The branch begins with a small remedy, at the cycle on which a motion of the servo settles that has just stopped.
"""

from __future__ import annotations

import math
from bisect import bisect_left
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
from .price import ENDED, ROUNDING_OF_A_STATE, fate

Kind = Literal["fold", "grazing", "Hopf", "motions", "none", "not found"]
BORDERS = ("fold", "grazing", "Hopf", "motions")
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
MOST_CYCLES = 300
"""Orbits after which cycles are followed no further (most borders take 4 to 74): where slips all but stop
half-way, steps become ever smaller, and multipliers 1e20, while motions tell in a second where hunting ends."""
MOST_WORK_OF_A_BORDER = 1e6
"""Work (effort.py), half a minute of a processor or less, after which the same holds: with a bristle a cycle may take
long."""
MOST_WORK_OF_A_MOTION = 1e6
"""After which a motion is taken to hunt; one that does takes half of it or less."""
FIRST_MORE, MOTIONS_KNOW = 0.2, 1e-3
"""By how much more a remedy is at first, relatively, to which a motion that hunts is handed on; and in the end."""
MOTIONS_ERROR = 0.02
"""Relative error that is said of a size: next to a fold motions may leave hunting too soon, or too late; folds of
Table 1 were met to 3e-4 to 1.2e-3, that of integral action, from far off, to 0.017."""
HUNTS_UP_TO = 50.0
"""So many times as large as before a motion may hunt: next to its border the cycle of another servo may be small."""
NO_FIRST, NO_FARTHER = "no cycle with a little of it was found", "and could not be farther"
"""Where nothing can be followed, and where it stops."""
MOTION_STARTS = (1.0, 0.8, 1.25, 0.5, 3.0)
"""Where they start besides, at rest, in amplitudes of a cycle."""


@dataclass(frozen=True)
class Swing:
    """A state on a motion that hunts, its amplitude [rad] and period [s]."""

    state: dict[str, float]
    amplitude: float
    period: float

    @classmethod
    def of(cls, cycle: Orbit) -> Swing:
        """That of a cycle."""
        return cls(on_the_cycle(cycle), cycle.amplitude, cycle.period)


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
    if found.kind == "not found" and way:
        return _by_motions(loop, remedy, remedy.last * scales.of(remedy, loop), way) or found
    return found


def _given_up(remedy: Remedy, way: list[SystemOrbit], evidence: str) -> Border:
    """How far cycles were followed, and what stopped it."""
    if not way:
        return Border("not found", math.nan, math.nan, None, None, {}, NO_FIRST, evidence)
    values = [orbit.problem.value(remedy.size) for orbit in way]
    farthest = int(np.argmax(remedy.sense * np.array(values)))
    why = f"{_went(values[0], values[farthest], remedy)}, {NO_FARTHER}"
    return Border("not found", values[farthest], math.nan, way[0], way[farthest], {}, why, evidence)


def _by_motions(loop: Loop, remedy: Remedy, last: float, way: list[SystemOrbit]) -> Border | None:
    """The border as motions show it, beyond a stable cycle that is far out on the way; None where they do not."""
    outwards = sorted(way, key=lambda orbit: remedy.sense * orbit.problem.value(remedy.size))
    i = bisect_left(outwards, True, hi=len(outwards) - 1, key=lambda orbit: not orbit.stable)
    cycle = outwards[max(i - 1, 0)]
    at = cycle.problem.value(remedy.size)
    found = end_of_motions(loop, remedy, Swing.of(cycle), at, last)
    if found is None or found[0] == at:
        return None
    size, swing = found
    why = f"{_went(way[0].problem.value(remedy.size), at, remedy)}, on as motions"
    return Border("motions", size, MOTIONS_ERROR * abs(size), way[0], cycle, {}, why, swing=swing)


def end_of_motions(
    loop: Loop, remedy: Remedy, swing: Swing, size: float, last: float, starts: Sequence[float] = MOTION_STARTS
) -> tuple[float, Swing] | None:
    """The size from which on no motion hunts, from one on, which it is if none does there, and the last that does;
    None: one does at the last size, or is too unclear to be handed on.

    A motion that hunts is handed on to the next size, which is as near as it must be: those that start beside it leave
    hunting for good before it ends.  swing: one to begin with; starts: where others start besides, at rest, in
    amplitudes.
    """
    at, rests = size, size
    further = _hunting(with_remedy(loop, remedy, at), swing, starts)
    if further is None:
        return size, swing
    swing = further
    while rests == size or abs(rests - at) > abs(more_of(remedy, at, 1 + MOTIONS_KNOW) - at):
        trial = more_of(remedy, at, 1 + FIRST_MORE) if rests == size else (at + rests) / 2
        further = _hunting(with_remedy(loop, remedy, trial), swing, starts)
        if further is None:
            rests = trial
        elif rests == size and (further is swing or remedy.sense * (trial - last) > 0):
            return None
        else:
            at, swing = trial, further
    return rests, swing


def _hunting(loop: Loop, before: Swing, starts: Sequence[float]) -> Swing | None:
    """The motion that hunts from a state on another one, or from rest beside it; None where all rest or decay.

    One that is unclear is taken to hunt: then it is the one before that is handed on.
    """
    beside = (loop.at_rest(-part * before.amplitude) for part in starts)
    for start in (before.state, *beside):
        with effort.at_most(MOST_WORK_OF_A_MOTION):
            seen = fate(loop, start, before.amplitude, before.period, outgrown=HUNTS_UP_TO)
        if seen.verdict == "hunts":
            late = seen.times >= seen.times[-1] / 2
            t, x = seen.times[late], seen.position[late] - np.ptp(seen.position[late]) / 2 - seen.position[late].min()
            ups = t[1:][(x[:-1] < 0) & (x[1:] >= 0)]
            period = float(np.diff(ups).mean()) if ups.size > 1 else before.period
            return Swing(seen.end, float(np.ptp(x)) / 2, period)
        if seen.verdict not in ENDED:
            return before
    return None


def on_the_cycle(orbit: Orbit) -> dict[str, float]:
    """A state of a cycle away from events: where something has just stopped, or in mid-slip."""
    stuck = next((arc for arc in orbit.arcs if "stick" in arc.mode), None)
    states = (stuck or orbit.arcs[0]).states
    largest = np.max([np.abs(arc.states).max(axis=(0, 1)) for arc in orbit.arcs], axis=0)
    state = states[0, states.shape[1] // 2]
    state = np.where(np.abs(state) > ROUNDING_OF_A_STATE * largest, state, 0.0)  # a rounding of zero would slip
    return dict(zip(orbit.problem.system.states, state.tolist(), strict=True))


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
