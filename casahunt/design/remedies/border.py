"""The smallest size of a remedy that ends hunting: where stable cycles end, behind which no motion hunts.

    a little of it -> the cycle on which a motion settles
    hunting handed on from size to size, until a scan of starts sees none (fate.py), and bisected
    the stable cycle of the last size that hunts -> followed on to where stable cycles end
    a scan beyond: where motions hunt there, on other cycles, once more from those

    fold         a stable and an unstable cycle merge (continuation's `largest`, `smallest`), located and confirmed
    Hopf, comes to rest    the cycle shrinks to a point, or to a stop that lasts ever longer
    grazing      the cycle meets an event of the remedy with no speed, or for the first time, and no cycle follows
    instability  the cycle loses its stability and does not win it back, and no motion beyond hunts on another one
    motions      cycles could not be followed: simulated motions hunt up to there, and none does beyond
    none         motions hunt at the last size that is looked at
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Literal, cast

import numpy as np

from ... import effort
from ...continuation import Branch, SpecialPoint, branch_off, follow, largest, smallest
from ...errors import InputError, NoOrbit, Status
from ...orbits import Orbit, SystemOrbit, find_cycle
from ...orbits.adapt import Options
from ...roots import boundary
from ...servo.linear.open_loop import grows_without_friction, linear_stable
from ...servo.parts.fate import LEFT_OF_A_SWING, NEARLY_THERE, Swing
from ...servo.parts.loop import Loop
from ...servo.parts.remedy import Remedy
from ...servo.parts.table import with_remedy
from ...servo.parts.verbs import loop_cycle
from .handed_on import FIRST_MORE, EndOfMotions, end_of_motions
from .scan import scan
from .sizes import more_of, scale_of, sized

Kind = Literal["fold", "grazing", "Hopf", "comes to rest", "instability", "motions", "none", "not found"]
ENDS = ("grazing", "Hopf", "comes to rest")
"""Ends of a branch at which hunting ends."""
BORDERS = ("fold", *ENDS, "instability", "motions")
"""Kinds of a border."""
LOSSES = ("symmetry breaking", "flip", "Neimark-Sacker")
"""Special points at which cycles lose their stability and go on."""

SMALLER_AND_LARGER, VERY_LITTLE = (1.0, 4.0, 0.25, 16.0), (0.05, 0.01, 0.002)
"""First sizes that are tried, in units of the remedy's own: the smallest may be too small to be told from none, or
end hunting already; next to the servo's own fold very little does, which is tried where none took too much work."""
SIZE_KNOWN = 1e-6
"""Relative error above which a size is not told."""
FINER_FOR_GRAZINGS = 0.1
"""Of the tolerance of folds, that of the cycles on the way: their branch may end at an event met for the first time."""
MOST_UNSTABLE, WORK_OF_UNSTABLE = 20, 3e4
"""Cycles that are followed on where they have lost their stability, and the work of that (effort.py): they may win it
back, or come to a fold."""
WORK_OF_SETTLING = 5e4
"""Work (effort.py) of a motion that settles: one that is next to losing its stability comes nearer ever so slowly."""
MOST_CYCLES, MOST_WORK_OF_AN_END = 150, 4e5
"""Orbits, and work (effort.py: ten seconds of a processor or less), after which cycles are followed no further, and
motions tell where hunting ends: where slips all but stop half-way, steps become ever smaller.  Twice as much where
nothing is tried behind it but motions, which know the size to parts of a hundred."""
OUTSIDE_BY = 1e-4
"""A multiplier that is larger than 1 by more makes a cycle unstable."""
NEAR_ENOUGH, MOTIONS_KNOW = 0.06, 5e-3
"""From where cycles are followed; and to what motions alone tell the size, relatively."""
IRREGULAR_KNOWN, WORK_OF_IRREGULAR = 0.1, 2e5
"""The part of a size to which the end of irregular hunting is told; and the work of that: it is told as it is known
then."""
MOTIONS_ERROR = 0.02
"""Relative error that is said of a size, at least: next to a fold motions may leave hunting too soon, or too late."""
LOOKED_AT_BEYOND, MOST_FAMILIES = (1e-3, 0.01, 0.03, 0.1), 6
"""So much beyond a border, relatively, motions are looked at, next to a fold, where they take long to leave, from the
second on; where they hunt, cycles are followed from there, so many times at most."""
LIMIT_KNOWN, BESIDE_UNSTABLE = 1e-4, 0.01
"""Part of a step to which a size is known from which on the loop is unstable; how far in front of it is looked."""
BRIEFLY = LOOKED_AT_BEYOND[0]
"""Cycles that win their stability back for a smaller part of the size than this are no hunting that would be seen; and
what branches off where they lose it may hunt on so far."""
SAME_CYCLE = "the same cycle was not followed so far before"
"""Why it is not followed again, where motions that come nearer to it lead to no other one."""
NO_FIRST = "no cycle with a little of it was found"
"""Where nothing can be followed."""


@dataclass(frozen=True, eq=False)
class Border:
    """Where hunting ends.

    Attributes
    ----------
    kind : how; "none" where it does not up to `size`, "not found" where nobody knows beyond that.
    size, error : the size, and the estimated error of it, in its unit.
    first, orbit : the first and the last cycle; None where none was computed.
    moves : by how much the size moves with other parameters of the loop; {} where it is no fold.
    why : a sentence, where it is no fold.
    evidence : what stopped the search, in the words of the trade; "" where nothing did.
    swing : the last motion that hunts, where motions show it.
    fold : where the branch folds, if hunting ends elsewhere.
    """

    kind: Kind
    size: float
    error: float = math.nan
    first: SystemOrbit | None = None
    orbit: SystemOrbit | None = None
    moves: dict[str, float] = field(default_factory=dict)
    why: str = ""
    evidence: str = ""
    swing: Swing | None = None
    fold: float = math.nan


def border(loop: Loop, remedy: Remedy, before: Swing, options: Options) -> Border:
    """The border of hunting in the size of a remedy.

    loop, before: the loop without it, and its hunting, from where it has just stopped.
    Raises effort.GivenUp: beyond the work that is allowed in all.
    """
    unit = scale_of(remedy, loop, before)
    if before.irregular:
        return _of_irregular(loop, remedy, before, unit)
    first = _with_a_little(loop, remedy, before.state, unit, options)
    if isinstance(first, Border):
        return first
    swing, size = Swing.of(first), first.problem.value(remedy.size)
    limit, last = _of_stable_loops(loop, remedy, size, remedy.last * unit)
    folds, lost, evidence, families, rest = list[float](), list[SystemOrbit](), "", 0, LEFT_OF_A_SWING
    while True:
        begun, seen = (size, swing), end_of_motions(loop, remedy, swing, size, last, NEAR_ENOUGH, rest)
        if seen.swing is None or math.isnan(seen.ended):
            return replace(_without_end(remedy, seen, size, last, limit), first=first, evidence=evidence)
        size, swing, families = seen.hunts, seen.swing, families + 1
        try:
            if families > MOST_FAMILIES:
                raise NoOrbit("one kind of cycles follows the other", Status.NOT_FOUND)
            with effort.at_most(MOST_WORK_OF_AN_END * (2 if rest == NEARLY_THERE else 1)):
                found = _end_of_stable(with_remedy(loop, remedy, size), remedy, swing, last, options, lost)
            if found.kind == "none":
                return replace(found, first=first, why=_unstable_from(remedy, limit))
        except (NoOrbit, effort.PartGivenUp) as refusal:
            evidence = evidence if str(refusal) == SAME_CYCLE else str(refusal)
            if rest != NEARLY_THERE and families <= MOST_FAMILIES:  # it may have left again what it seemed to come to
                (size, swing), rest, families = begun, NEARLY_THERE, families - 1
                continue
            break
        at, beyond = _beyond(loop, remedy, found)
        if beyond is None:
            return replace(found, first=first, fold=next(iter(folds), found.fold))
        folds += [found.size] if found.kind == "fold" else []
        size, swing = at, beyond
    seen = end_of_motions(loop, remedy, swing, size, last, MOTIONS_KNOW, rest)
    if math.isnan(seen.ended):
        return replace(_without_end(remedy, seen, size, last, limit), first=first, evidence=evidence)
    found = _by_motions(remedy, seen, "cycles were not followed to their end")
    return replace(found, first=first, evidence=evidence, swing=seen.swing or swing, fold=next(iter(folds), math.nan))


def _by_motions(remedy: Remedy, seen: EndOfMotions, why: str) -> Border:
    """A border as motions show it; why: why they do alone."""
    hunt = f"motions hunt up to {sized(seen.hunts, remedy)}"
    error = max(MOTIONS_ERROR * abs(seen.ended), abs(seen.ended - seen.hunts))
    return Border("motions", seen.ended, error, swing=seen.swing,
                  why=f"{why}: {hunt}, and none does at {sized(seen.ended, remedy)}")  # fmt: skip


def _of_irregular(loop: Loop, remedy: Remedy, before: Swing, unit: float) -> Border:
    """The border of hunting that is irregular without the remedy: by motions alone."""
    for size in _first_sizes(remedy, unit)[::2]:  # no larger one: what hunts already hunts on with little of it
        limit, last = _of_stable_loops(loop, remedy, size, remedy.last * unit)
        seen = end_of_motions(loop, remedy, before, size, last, IRREGULAR_KNOWN, work=WORK_OF_IRREGULAR)
        if seen.swing is not None or math.isnan(seen.ended):
            break
    if seen.swing is None or math.isnan(seen.ended):
        return _without_end(remedy, seen, size, last, limit)
    return _by_motions(remedy, seen, "it hunts irregularly, and no cycle of it was followed")


def _with_a_little(
    loop: Loop, remedy: Remedy, start: dict[str, float], unit: float, options: Options
) -> SystemOrbit | Border:
    """The cycle with little of the remedy on which a motion settles; what is known where there is none."""
    sizes, why, spent = _first_sizes(remedy, unit), "", False
    for k, size in enumerate(sizes):
        if spent and k == len(SMALLER_AND_LARGER):
            sizes = sizes[:k]
            break
        try:
            with effort.at_most(MOST_WORK_OF_AN_END):
                return loop_cycle(with_remedy(loop, remedy, size), remedy.size, start=start, options=options)
        except (NoOrbit, effort.PartGivenUp) as refusal:
            why, spent = why or str(refusal), spent or isinstance(refusal, effort.PartGivenUp)
    stopped = f"no cycle at {remedy.size} = {', '.join(f'{size:.4g}' for size in sizes)}: {why}"
    return Border("not found", math.nan, why=NO_FIRST, evidence=stopped)


def _first_sizes(remedy: Remedy, unit: float) -> list[float]:
    """Little of a remedy."""
    first, one, factors = remedy.first, remedy.starts_at_one, SMALLER_AND_LARGER + VERY_LITTLE
    return [unit * (1 - (1 - first) * factor if one else first * factor) for factor in factors]


def _of_stable_loops(loop: Loop, remedy: Remedy, size: float, last: float) -> tuple[float, float]:
    """(size from which on the loop is unstable, last size that is looked at); NaN where it is not, or is not linear.

    Where it is unstable without dry friction, which is bounded, large motions grow, up to a torque limit if there is
    one: such a size ends no hunting.
    """
    loop = loop.within_limits
    if linear_stable(with_remedy(loop, remedy, size)) is not True:
        return math.nan, last
    sizes = [size]
    while remedy.sense * sizes[-1] < remedy.sense * last:
        more = more_of(remedy, sizes[-1], 1 + FIRST_MORE)
        sizes.append(last if remedy.sense * more > remedy.sense * last else more)
    grows = [grows_without_friction(with_remedy(loop, remedy, each)) for each in sizes]
    k = grows.index(True) if True in grows else len(sizes)
    if k == len(sizes) or not all(grows[k:]):  # or more of it makes the loop stable again
        return math.nan, last
    at, more = sizes[k - 1 : k + 1]
    width = LIMIT_KNOWN * abs(more - at)
    _, limit = boundary(lambda x: grows_without_friction(with_remedy(loop, remedy, x)), at, more, width=width)
    return limit, more_of(remedy, limit, 1 - BESIDE_UNSTABLE)


def _unstable_from(remedy: Remedy, limit: float) -> str:
    """What is said of a size from which on the loop is unstable; "" where there is none."""
    return "" if math.isnan(limit) else (
        f"from {sized(limit, remedy)} on the loop itself is unstable, even without dry friction"
    )


def _without_end(remedy: Remedy, seen: EndOfMotions, size: float, last: float, limit: float) -> Border:
    """What is known where no end was seen: hunting goes on, or nobody knows.

    size, last: at which it was begun with, and the last one; limit: from which on the loop is unstable.
    """
    if seen.swing is not None and seen.hunts == last:
        return Border("none", last, swing=seen.swing, why=_unstable_from(remedy, limit))
    if seen.swing is None and math.isfinite(seen.ended):
        why = f"with {sized(size, remedy)} of it no motion hunts on the cycle that was found"
        return Border("not found", size, why=why)
    up = f"motions hunt up to {sized(seen.hunts, remedy)}; whether any hunts beyond is not known"
    why = "; ".join(filter(None, (up, _unstable_from(remedy, limit))))
    return Border("not found", seen.hunts, why=why, swing=seen.swing)


def _end_of_stable(
    loop: Loop, remedy: Remedy, swing: Swing, last: float, options: Options, lost: list[SystemOrbit]
) -> Border:
    """Where the stable cycle on which a motion settles ends, or loses its stability, with more of the remedy.

    loop: with some of it; lost: cycles that were not followed so far, to which this one is added until it is.
    Raises NoOrbit, effort.PartGivenUp: it was not followed so far.
    """
    cycle = _next_to(swing, loop, remedy, options)
    if cycle.seen_stable is False:
        raise NoOrbit("the cycle next to a motion that hunts is not stable", Status.NOT_FOUND)
    if any(_same(cycle, other, remedy) for other in lost):
        raise NoOrbit(SAME_CYCLE, Status.NOT_FOUND)
    lost.append(cycle)
    found = _followed_to_its_end(cycle, remedy, last, options)
    lost.pop()
    return found


def _next_to(swing: Swing, loop: Loop, remedy: Remedy, options: Options) -> SystemOrbit:
    """The cycle on which a motion that hunts settles; of its first return where it takes long.  Raises NoOrbit."""
    try:
        with effort.at_most(WORK_OF_SETTLING):
            return loop_cycle(loop, remedy.size, start=swing.state, options=options)
    except effort.PartGivenUp:
        start, near = loop.state(**swing.state), replace(options, solver="newton")
        mode = loop.mode_at(**start)
        return find_cycle(loop.system, mode, start=start, follow=remedy.size, settled=True, options=near)


def _same(cycle: SystemOrbit, other: SystemOrbit, remedy: Remedy) -> bool:
    """Whether two cycles are one, wherever it is cut, but for what they are known to."""
    one, two = ((each.problem.value(remedy.size), each.period, each.amplitude) for each in (cycle, other))
    return len(cycle.signature) == len(other.signature) and np.allclose(one, two, rtol=SIZE_KNOWN, atol=0)


def _followed_to_its_end(cycle: SystemOrbit, remedy: Remedy, last: float, options: Options) -> Border:
    """The end of a stable cycle.  Raises NoOrbit, effort.PartGivenUp."""
    losses, at, before = list[SpecialPoint[SystemOrbit]](), cycle, None
    while True:
        branch = _further(at, before, remedy, last, options, losses)
        passed = [] if branch is None else [each for each in branch.special if _may_end(each)]
        for special in passed:
            if special.kind == "fold":
                fold = (largest if remedy.sense > 0 else smallest)(special, remedy.size, options=options)
                if not fold.value_error <= SIZE_KNOWN:
                    raise NoOrbit(f"the fold is known to {fold.value_error:.2g} only", Status.NOT_FOUND)
                briefly = len(losses) > 1 and abs(fold.value - losses[-1].value) <= BRIEFLY * abs(fold.value)
                if briefly or _outside(special):
                    return _behind(losses[: len(losses) - briefly], fold.value, remedy, last, options)
                return Border("fold", fold.value, fold.absolute_error, orbit=fold.orbit,
                              moves=fold.sensitivities)  # fmt: skip
            losses += [] if _outside(special) else [special]
        if passed and len(passed[-1].orbit.arcs) < len(at.arcs):  # it meets the cycle that it branches off from
            losses, at, before = [], passed[-1].orbit, None
            continue
        if branch is None or not passed or branch.orbits[-1].problem.value(remedy.size) == last:
            break
        before, at = branch.orbits[-2:]
    if branch is None or (losses and branch.orbits[-1].seen_stable is False):
        return _behind(losses, math.nan, remedy, last, options)
    if branch.orbits[-1].problem.value(remedy.size) == last and branch.orbits[-1].seen_stable:
        return Border("none", last, swing=Swing.of(branch.orbits[-1]))
    if branch.end.kind not in ENDS or not math.isfinite(branch.end.value):
        raise NoOrbit(str(branch.end), Status.NOT_FOUND)
    end = branch.end
    error = max(end.error, 10 * FINER_FOR_GRAZINGS * options.tol * abs(end.value))
    return Border(cast(Kind, end.kind), end.value, error, orbit=branch.orbits[-1], why=str(end))


def _further(
    at: SystemOrbit, before: SystemOrbit | None, remedy: Remedy, last: float, options: Options,
    losses: list[SpecialPoint[SystemOrbit]],
) -> Branch[SystemOrbit] | None:  # fmt: skip
    """The branch up to the next point at which stable cycles may end or begin; losses: of stability, so far.

    None where cycles that have lost their stability could not be followed, or not within the work of an end: where they
    lost it is known.  Raises NoOrbit, effort.PartGivenUp: stable ones could not.
    """
    finer = replace(options, tol=FINER_FOR_GRAZINGS * options.tol)
    most, work = (MOST_UNSTABLE, WORK_OF_UNSTABLE) if losses else (MOST_CYCLES, math.inf)
    try:
        with effort.at_most(work):
            return follow(at, remedy.size, to=last, previous=before, options=finer, until=_may_end, max_points=most)
    except (NoOrbit, effort.PartGivenUp):
        if not losses:
            raise
        return None


def _may_end(special: SpecialPoint[SystemOrbit]) -> bool:
    """Whether stable cycles may end there, or begin anew."""
    return special.kind in (*LOSSES, "fold")


def _outside(special: SpecialPoint[SystemOrbit]) -> bool:
    """Whether multipliers lie outside the unit circle, besides those that pass it: the nearest ones.

    A fold that is known to 1e-9 has one within the root of that.
    """
    sizes = np.abs(special.orbit.multipliers.half[1:])
    others = sizes[np.argsort(np.abs(sizes - 1))][2 if special.kind == "Neimark-Sacker" else 1 :]
    return bool((others > 1 + OUTSIDE_BY).any())


def _behind(
    losses: list[SpecialPoint[SystemOrbit]], fold: float, remedy: Remedy, last: float, options: Options
) -> Border:
    """The last loss of stability, or where the stable cycles end that branch off there with more of the remedy.

    Motions come to those so slowly that none is seen to.  fold: as of `_lost`.
    """
    lost = _lost(losses, fold)
    try:
        cycle = branch_off(losses[-1], remedy.size, options=options)
        if remedy.sense * (cycle.problem.value(remedy.size) - lost.size) > 0 and cycle.seen_stable:
            return replace(_followed_to_its_end(cycle, remedy, last, options), fold=fold)
    except (InputError, NoOrbit, effort.PartGivenUp) as refusal:  # not of these cycles, several, or not followed so far
        return replace(lost, evidence=f"what branches off where it is lost was not followed: {refusal}")
    return lost


def _lost(losses: list[SpecialPoint[SystemOrbit]], fold: float) -> Border:
    """The last loss of stability; fold: that of the branch behind it, nan where it was not found."""
    if not losses:
        raise NoOrbit("cycles are not stable, and where they were was not found", Status.NOT_FOUND)
    special = losses[-1]
    error = max(np.nan_to_num(special.error), BRIEFLY * abs(special.value))
    return Border("instability", special.value, error, orbit=special.orbit, why=special.meaning, fold=fold)


def _beyond(loop: Loop, remedy: Remedy, found: Border) -> tuple[float, Swing | None]:
    """(size, swing): the first size beyond a border at which a motion hunts; the last one and None, where none does."""
    before = Swing.of(cast(Orbit, found.orbit))
    for factor in LOOKED_AT_BEYOND[found.kind == "fold" :]:
        at = more_of(remedy, found.size, 1 + factor)
        swing = scan(with_remedy(loop, remedy, at), before).swing
        if swing is not None:
            break
    return at, swing
