"""Motions that hunt, handed on from size to size of a remedy, up to where none does."""

from __future__ import annotations

import math
from contextlib import suppress
from dataclasses import dataclass, replace

from ... import effort
from ...servo.parts.fate import LEFT_OF_A_SWING, Swing
from ...servo.parts.loop import Loop
from ...servo.parts.remedy import Remedy
from ...servo.parts.table import with_remedy
from .scan import scan
from .sizes import more_of

FIRST_MORE = 0.25
"""By how much more a remedy is at first, relatively, to which a motion that hunts is handed on."""
MORE_OF_IRREGULAR = 3.0
"""The same where hunting is irregular, to which motions come from anywhere."""
MOST_UNCLEAR = 2
"""Sizes one after the other with which nobody knows whether motions hunt, behind which no more is looked at."""


@dataclass(frozen=True, eq=False)
class EndOfMotions:
    """Where motions hunt, handed on from size to size.

    hunts, swing: the last size at which one was seen to, and that; None where none was; ended: the size from which on
    none does, nan where that was not reached; kind: of the motions at the last size that was looked at.
    """

    hunts: float
    swing: Swing | None
    ended: float
    kind: str


def end_of_motions(
    loop: Loop, remedy: Remedy, swing: Swing, size: float, last: float, known: float, rest: float = LEFT_OF_A_SWING,
    work: float = math.inf,
) -> EndOfMotions:  # fmt: skip
    """Between which sizes hunting ends, from one on, known to a part of it.

    A motion that hunts is handed on to the next size.  What is unclear is taken to hunt, but is not handed on.
    swing: one to begin with; rest: how near to a cycle a motion hunts, in its swings; work: after which the end is told
    as it is known (effort.py).
    """
    hunts, low, high, unclear = size, size, math.nan, 0
    trial, found, kind = size, None, "undecided"
    with suppress(effort.PartGivenUp), effort.at_most(work):
        while True:
            seen = scan(with_remedy(loop, remedy, trial), found or swing, rest=rest)
            unclear, kind = unclear + 1 if seen.swing is None and not seen.over else 0, seen.kind
            if seen.over:
                high = trial
            else:
                low = trial
                if seen.swing is not None:
                    hunts, found = trial, replace(seen.swing, irregular=swing.irregular)
            if high == size or (math.isnan(high) and (low == last or unclear > MOST_UNCLEAR)):
                break
            if math.isnan(high):
                more = more_of(remedy, low, 1 + (MORE_OF_IRREGULAR if swing.irregular else FIRST_MORE))
                trial = last if remedy.sense * more > remedy.sense * last else more
            elif abs(high - low) > abs(more_of(remedy, low, 1 + known) - low):
                trial = (low + high) / 2
            else:
                break
    return EndOfMotions(hunts, found, high, kind)
