"""Motions of a loop from many starts, and the worst of what becomes of them (fate.py)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...servo.outcome import BY_SEVERITY, SETTLES, Kind
from ...servo.parts.fate import NEARLY_THERE, Fate, Swing, fate
from ...servo.parts.loop import Loop
from ...servo.parts.turns import DECADE

Array = np.ndarray

OFF_THE_CYCLE = (0.97, 1.03)
"""Parts of a state on a cycle from which motions begin: on the cycle one stays, whether or not that attracts, and on
the one side of it may be a band in which everything rests."""
LEAST_START, LARGEST_START, NO_GAP, MOST_STARTS = 1e-3, 3.0, 1.6, 30
"""Between so many amplitudes of the hunting no gap as wide as that, as a ratio, is left without a turn of a motion."""
LEAST_SHRINKING = 0.99
"""Of places by which a motion decays on, from one to the next: more slowly is told as well by fewer."""
GRID_BEYOND = np.geomspace(0.2, 8.0, 12).tolist()
"""Starts at rest beside the set point, in amplitudes of the hunting, where that is said to have ended."""
MOST_UNDECIDED, MOST_TURNS_OF_ALL = 2, 1200
"""Motions of which nobody knows what becomes of them, behind which no other one is followed; and turns of all."""


@dataclass(frozen=True, eq=False)
class Scan:
    """What becomes of motions from a scan of starts: the worst of them, the first that hunts, and if any is unclear."""

    kind: Kind
    swing: Swing | None = None
    unclear: bool = False

    @property
    def over(self) -> bool:
        """Whether none hunts: they come to rest, or grow.  One of which nobody knows may hunt, though others grow."""
        return self.kind in (*SETTLES, "growing") and not self.unclear


def scan(loop: Loop, *before: Swing, rest: float = NEARLY_THERE, beyond: bool = False) -> Scan:
    """Motions from states of hunting that was seen at other sizes, and from rest beside the set point.

    beyond: hunting is said to have ended, and starts on a grid are asked first: where the servo may rest in a band,
    whether a motion does changes with its start from one to the next, and what is between two leads anywhere.
    The others begin in the gaps between the places at which any motion has turned, or would do on its way to nothing,
    until there is none left: a cycle that attracts from nowhere but such a gap is not seen.
    """
    seen: list[Kind] = []
    ways: list[tuple[float, float]] = []
    first, turns = before[0], 0
    starts = [{name: off * x for name, x in each.state.items()} for each in before for off in OFF_THE_CYCLE]
    starts += [loop.at_rest(-place * first.amplitude) for place in (LEAST_START, LARGEST_START)]
    starts += [loop.at_rest(-place * first.amplitude) for place in (GRID_BEYOND if beyond else ())]
    while len(seen) < MOST_STARTS and seen.count("undecided") < MOST_UNDECIDED:
        if not starts:
            where = _gap(np.array(ways) / first.amplitude)
            if where is None:
                break
            starts = [loop.at_rest(-where * first.amplitude)]
        start = starts.pop(0)
        found = fate(loop, start, first, rest)
        if found.kind == "hunting":
            return Scan("hunting", found.swing)
        seen.append(found.kind if turns <= MOST_TURNS_OF_ALL else "undecided")
        turns += found.turns.size
        ways += _way(abs(start.get("x1", 0.0)), found)
    return Scan(max(seen, key=BY_SEVERITY.index), unclear="undecided" in seen)


def _way(start: float, found: Fate) -> list[tuple[float, float]]:
    """Places of a motion, and the next one of each: where it rests, that; where it decays towards the set point, those
    of a decade more."""
    places = [start, *np.abs(found.turns).tolist()]
    if found.kind == "decaying" and places[-2] <= abs(found.turns[-2] - found.turns[-3]):
        ratio = min(math.sqrt(places[-2] / places[-4]), LEAST_SHRINKING)
        places += (places[-2] * np.geomspace(ratio, 1 / DECADE, 1 + int(math.log(DECADE) / -math.log(ratio)))).tolist()
    return list(zip(places, [*places[1:], places[-1] if found.kind == "at rest" else math.nan], strict=True))


def _gap(ways: Array) -> float | None:
    """The middle of the widest gap between places (m, 2), in amplitudes; None where none is wide enough.

    Places whose next ones are near to each other, and not between them, leave no gap: what is between leads there too.
    """
    inside = ways[(ways[:, 0] > LEAST_START / 2) & (ways[:, 0] < 2 * LARGEST_START)]
    places, nexts = inside[np.argsort(inside[:, 0])].T
    ratios = places[1:] / places[:-1]
    stay, near = nexts == places, np.abs(np.log(nexts[1:] / nexts[:-1])) <= math.log(NO_GAP)
    between = (nexts[:-1] > places[:-1]) & (nexts[1:] < places[1:])
    open_ = ~(near & ~between | stay[1:] & stay[:-1]) & (ratios > NO_GAP)
    i = int(np.argmax(np.where(open_, ratios, 0.0)))
    return float(np.sqrt(places[i] * places[i + 1])) if open_.any() else None
