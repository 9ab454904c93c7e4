"""Whether more of a remedy than at its border keeps hunting ended.

From the largest size on: what hunts there, on a cycle to which few motions come, is handed on to the smaller ones.
"""

from __future__ import annotations

import math
from contextlib import suppress

from ... import effort
from ...servo.linear.open_loop import grows_without_friction
from ...servo.outcome import Kind
from ...servo.parts.fate import GROWN_BY, Swing, fate
from ...servo.parts.loop import Loop
from ...servo.parts.remedy import Remedy
from ...servo.parts.table import with_remedy
from .scan import Scan, scan

STEPS_DOWN, SMALLEST_STEP_DOWN = 4, 2e-3
"""In which a motion that hunts with more of a remedy is handed on to less, from one of these sizes to the next, or in
smaller ones where it is lost, down to this part of the size: few motions come to it."""
WORK_DOWN_OF_IRREGULAR = 2e4
"""Work (effort.py) of that where hunting is irregular, to which motions come from elsewhere."""


def stays(loop: Loop, remedy: Remedy, sizes: tuple[float, ...], before: Swing) -> tuple[Kind, ...]:
    """What becomes of motions at sizes beyond a border, of each the worst; before: the last hunting in front of it."""
    above, swing, kinds = math.nan, None, list[Kind]()
    for at in reversed(sizes):
        if swing is not None:
            swing = handed_down(loop, remedy, swing, (above, at), before)
        there = with_remedy(loop, remedy, at)
        if grows_without_friction(there):
            seen = Scan("growing")
        else:
            grid = at == sizes[0] or not before.irregular  # to which motions come from anywhere
            seen = scan(there, before, beyond=grid) if swing is None else Scan("hunting", swing)
        kinds.append(seen.kind)
        above, swing = at, seen.swing
    return tuple(reversed(kinds))


def handed_down(
    loop: Loop, remedy: Remedy, swing: Swing, sizes: tuple[float, float], before: Swing
) -> Swing | None:
    """The hunting to which that at the first of two sizes leads at the second.

    None where it ends in between, or becomes larger than any hunting.
    """
    size, last = sizes
    step = longest = (last - size) / STEPS_DOWN
    lost = False  # at twice the step from here, from farther away: it is tried again from next to it
    with suppress(effort.PartGivenUp), effort.at_most(WORK_DOWN_OF_IRREGULAR if before.irregular else math.inf):
        while size != last:
            trial = last if abs(last - size) <= abs(step) * (1 + SMALLEST_STEP_DOWN) else size + step
            found = fate(with_remedy(loop, remedy, trial), swing.state, before).swing
            smallest = abs(step) <= SMALLEST_STEP_DOWN * abs(size)
            if smallest if found is None else found.amplitude > GROWN_BY * before.amplitude:
                return None
            size, swing = (size, swing) if found is None else (trial, found)
            lost = found is None or lost and not smallest
            step = step / 2 if lost else min(2 * step, longest, key=abs)
        return swing
    return None
