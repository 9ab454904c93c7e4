"""Where a cycle starts: the same one from another of its boundaries.

    x_k, ..., x_P-1, S^-1 (x_0 + c), ..., S^-1 (x_k-1 + c)      closes as x_0 ... x_P-1 does, x_k = S S^-1 (x_k + c) - c

Next to an event that is grazed, the state there moves like a square root of the parameter: a branch is followed from
the boundary that is crossed the fastest.  The first phase lends the branch the logarithm of its duration as a
coordinate, and is never taken out: it is not one that may be about to vanish.

Symbols: P phases.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ..collocation.joints import event_rate
from .restart import Start
from .sequences import VANISHES_BELOW, Posed, later, segments_of, start_of


def strongest(start: Start) -> int:
    """The number of the phase whose start is the boundary that is crossed the fastest.

    A phase that may be about to vanish is neither the first nor, among three or more, the last one: it is joined with
    its neighbours.

    Returns the number, 0 where the cycle starts there.
    """
    t, u, setting = start
    nodes, p = t.nodes_of(u) * setting.scale, setting.p
    durations = t.durations_of(u)
    rates = [
        abs(event_rate(phase, nodes[t.phase_end[k]], float(durations[k]), p)[0])
        for k, phase in enumerate(t.cycle.phases)
    ]
    before = np.roll(rates, 1)
    vanishing = may_vanish(durations)
    if vanishing is not None:
        before[vanishing] = -1.0
        if t.phases > 2:
            before[(vanishing + 1) % t.phases] = -1.0
    return int(np.argmax(before))


def may_vanish(durations: Sequence[float] | np.ndarray) -> int | None:
    """The number of the shortest phase of a cycle where it may be about to vanish; None where it is not short."""
    many, k = len(durations), int(np.argmin(durations))
    neighbours = max(durations[k - 1], durations[(k + 1) % many])
    return k if many > 1 and durations[k] <= VANISHES_BELOW * neighbours else None


def rotated(posed: Posed, start: Start, k: int) -> Start | None:
    """The same cycle, from the start of another phase on.

    k: number of the phase that becomes the first one.
    Returns starting point; None where the image of a phase is not known.
    """
    segments, setting = segments_of(*start), start[2]
    moved = []
    for segment in segments[:k]:
        names = posed.image(segment, setting.p, setting.scale)
        if names is None:
            return None
        moved.append(replace(later(posed.closure, segment), mode=names[0], event=names[1]))
    return start_of(posed, [*segments[k:], *moved], start)
