"""Up to which value of a parameter, on the way to a fold, the cycle that ends there is stable.

    the branch from a stable cycle to the fold (`follow`); where multipliers leave the unit circle or come back, or the
    phases change, a range of stable cycles ends or begins

Next to a smooth fold mu passes from below 1 to above it, and cycles are stable up to the fold.  Next to a sharp one mu
of half a period falls through -1 before it and goes on to -1e38 and beyond, and comes back to 1 within a part of the
fold gain that no gain is set to.  In between motions may swing for long beside a cycle that is not stable, or settle on
another one.  Beyond the fold there is no such cycle: that is the bound to keep away from.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from itertools import takewhile
from typing import Any

from .. import effort
from ..continuation import FOLD, GRAZING, Branch, Fold, SpecialPoint, Vanishing, follow
from ..errors import NoOrbit, Status
from ..orbits import Options, Orbit
from .find_fold import find_any_orbit
from .parts.loop import Loop
from .parts.verbs import TOLERANCE_ON_THE_WAY, WORK_OF_A_START, beyond_fold, loop_cycle

Ranges = tuple[tuple[float, float], ...]
"""(from, to) on the way to a fold, in order; NaN where that was not located."""

SET_TO = 1e-6
"""Relative width of a range that counts: no gain is set more finely.  By the law 1 - mu ~ sqrt(K_f - K) of a fold that
in front of it has the width (K_f - K) (2/(1 - mu))^2; next to sharp folds of random servos that falls towards it."""
SAME_FOLD = 1e-4
"""Two folds whose parameters differ by no more than this part are one: on the way it is known to less."""
UNSTABLE_AT_ONCE = 8
"""Unstable cycles that are followed before they are looked at."""
SOUGHT_BACK = 0.9
"""Part of the parameter by which a stable cycle is looked for farther from the fold than an unstable one."""
LOSES_STABILITY = ("flip", "symmetry breaking", "Neimark-Sacker", "grazing")
"""Special points at which stability may be lost or won."""


def stable_ranges(fold: Fold[Any], loop: Loop | None = None) -> Ranges:
    """Where the cycles that end at a fold are stable, from the first one that was found up to the fold.

    loop: whose fold it is; None: a servo's. Returns none where it is not known: no stable cycle was found, or those
    found did not lead there; the last range ends with the fold's own value where they are stable up to it.
    """
    name, rough = fold.parameter, Options(tol=TOLERANCE_ON_THE_WAY)
    try:
        with effort.at_most(WORK_OF_A_START):
            if loop is None:
                start: Orbit = find_any_orbit(fold.orbit.servo, fold.orbit.model, options=rough)
            else:
                start = loop_cycle(loop, name, options=rough, or_below=name == "gain")
            orbits, passed = _way(start, fold, rough)
    except (NoOrbit, effort.PartGivenUp):
        return ()
    width = SET_TO * abs(fold.orbit.problem.unit(name))
    ranges = ranges_between(orbits[0].problem.value(name), orbits, passed, fold.value)
    return tuple((low, high) for low, high in ranges if not abs(high - low) < width)


def _left(orbit: Orbit, fold: Fold[Any]) -> float:
    """How far a cycle is from the fold, in units of the parameter."""
    return float(abs(orbit.problem.distance(fold.parameter, fold.value)))


def _way(start: Orbit, fold: Fold[Any], options: Options) -> tuple[list[Orbit], list[SpecialPoint[Any]]]:
    """Cycles from a stable one to next to a fold, and the special points that they pass where they may be stable.

    Raises NoOrbit: none is stable, or stable ones do not lead there.
    """
    name = fold.parameter
    how: dict[str, Any] = {"vary": name, "to": beyond_fold(fold), "options": options, "until": _changes}
    if not start.seen_stable:
        back = start.problem.value(name) - SOUGHT_BACK * fold.sense * abs(start.problem.unit(name))
        start = next((o for o in follow(start, **{**how, "to": back}).orbits if o.seen_stable), start)
    way: list[Orbit] | None = [start]
    orbits, special = list[Orbit](), list[SpecialPoint[Any]]()
    while way is not None:
        leg = follow(way[-1], previous=way[-2] if way[1:] else None, **how)
        way, there = _in_front(leg, fold)
        orbits, special = [*orbits, *way], [*special, *takewhile(lambda s: s.kind != FOLD.kind, leg.special)]
        stable, more = orbits[-1].seen_stable, any(map(_changes, leg.special))
        if stable and not (there or more):
            raise NoOrbit(f"stable cycles do not lead to the fold: {leg.ended}", Status.NOT_FOUND)
        if there or not more:
            break
        way = way if stable else _regained(way, fold, how)
    return orbits, special


def _regained(way: list[Orbit], fold: Fold[Any], how: dict[str, Any]) -> list[Orbit] | None:
    """Cycles on to the last one in front of a stable one, or of the fold; None where no stable ones that count are met.

    way: some that end with an unstable one.
    """

    def too_narrow(orbit: Orbit) -> bool:
        mu = orbit.multipliers.leading.real
        return bool(mu < -1 and _left(orbit, fold) * (2 / (1 - mu)) ** 2 < SET_TO)

    while not too_narrow(way[-1]):
        rest = follow(way[-1], previous=way[-2], monitors=(FOLD,), max_points=UNSTABLE_AT_ONCE, **how)
        before, there = _in_front(rest, fold)
        stable = next((k for k in range(1, len(before)) if before[k].seen_stable), len(before))
        way = [way[-2], *before[:stable]]
        if stable < len(before) or there and not too_narrow(way[-1]):
            return way
        if there or len(before) == 1:
            break
    return None


def _changes(special: SpecialPoint[Any]) -> bool:
    return special.kind in (FOLD.kind, *LOSES_STABILITY)


def _in_front(branch: Branch[Any], fold: Fold[Any]) -> tuple[list[Orbit], bool]:
    """The cycles of a branch that count in front of a fold, and whether it has led there.

    Raises NoOrbit: it turns back elsewhere.
    """
    turned = next((each for each in branch.special if each.kind == FOLD.kind), None)
    if turned is not None and _left(turned.orbit, fold) > SAME_FOLD:
        raise NoOrbit(f"another fold is met: {turned.meaning}", Status.NOT_FOUND)
    found = list[Orbit]()
    for orbit in branch.orbits:
        next_to_nothing = isinstance(fold, Vanishing) and orbit.seen_stable is None
        if _left(orbit, fold) <= SET_TO or next_to_nothing:
            return found, True
        found.append(orbit)
        if turned is not None and orbit is turned.behind:
            return found, True
    return found, False


def ranges_between(begins: float, orbits: Sequence[Any], passed: Sequence[Any], fold: float) -> Ranges:
    """The ranges of stable cycles along a line of them from one value of the parameter to that of the fold.

    passed: the special points between them, and behind the last one.
    """
    turns, place = [(begins, False)], begins  # (where, whether cycles are stable behind it)
    for orbit in orbits:
        if bool(orbit.seen_stable) is not turns[-1][1]:
            turns.append((place, not turns[-1][1]))
        place, lost = math.nan, [s for s in passed if s.behind is orbit and s.kind in LOSES_STABILITY]
        for special in lost[:-1]:  # between two of them there is no cycle whose stability is known
            turns.append((special.value, not turns[-1][1]))
        if lost and (orbit is not orbits[-1] or lost[-1].kind != GRAZING.kind):
            place = lost[-1].value
    if not math.isnan(place):
        turns.append((place, not turns[-1][1]))
    ends = [where for where, _ in turns[1:]] + [fold]
    return tuple((low, high) for (low, stable), high in zip(turns, ends, strict=True) if stable)
