"""The phases that a motion really has, where those of a cycle have stopped being one.

The motion is followed from the start of the cycle, and from the middle of its longest phase: what leaves the cycle does
so elsewhere.  Where it comes back, its phases close a cycle (sequences.py has the other ways to one).

Symbols: n states.

Where a cycle starts: the same one from another of its boundaries.

    x_k, ..., x_P-1, S^-1 (x_0 + c), ..., S^-1 (x_k-1 + c)      closes as x_0 ... x_P-1 does, x_k = S S^-1 (x_k + c) - c

Next to an event that is grazed, the state there moves like a square root of the parameter: a branch is followed from
the boundary that is crossed the fastest.  The first phase lends the branch the logarithm of its duration as a
coordinate, and is never taken out: it is not one that may be about to vanish.

Symbols: P phases.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from contextlib import suppress
from dataclasses import replace
from itertools import islice

import numpy as np

from ..collocation.joints import event_rate, flow_at
from ..collocation.mesh import evaluate_phase
from ..hybrid.system import Signature
from ..motion.phases import MarchFailure, Segment, march
from .restart import Start
from .sequences import (
    VANISHES_BELOW,
    Posed,
    in_parts,
    joined_phases,
    later,
    segments_of,
    split,
    start_of,
    unsplit,
    without,
)
from .watching import SEARCH_TOLERANCE

Array = np.ndarray

RESTART_PERIODS = 2.5
"""A motion is followed for so many of its supposed periods."""
CLOSES, RESTARTS = 0.3, 2
"""How near to its start it must come back, in units of the state scale; so many of the ways are tried."""


def marched(posed: Posed, start: Start) -> list[Start]:
    """The phases that the motion really has, where they lead back to the start.

    posed, start: the problem, and unknowns that are no motion of it.
    Returns starting points, the ones that close best first.
    """
    t, u, setting = start
    x = t.nodes_of(u)[0] * setting.scale
    found: list[tuple[float, int, list[Segment]]] = []
    for segments in _motions(posed, start):
        found += _closing(posed, segments, x, setting.scale)
    starts: dict[Signature, Start] = {}
    for _, _, some in sorted(found, key=lambda way: way[:2]):
        if len(starts) == RESTARTS:
            break
        segments = _as_cut(posed, some, t.cycle.signature)
        label = tuple((s.mode, s.event) for s in segments)
        if label not in starts:
            with suppress(ValueError):  # a stop that is left at once: the system has no phase from event to event
                starts[label] = start_of(posed, segments, start)
    return list(starts.values())


def other_sequences(posed: Posed | None, start: Start, phase: int, *, soft: bool) -> Iterator[Start]:
    """Starting points for other phase sequences, where one has stopped being a motion, most promising first.

    Boundaries put in where the root crosses exits; a short phase taken out; the phases of the motion itself: to follow
    it takes longer than all else, and is not done where a point before it serves.

    posed, start: the problem, and a root that is no motion of it; phase: number of the one that is none any more;
    soft: also the last resort, a part of a mode left unsplit, that converges everywhere, but slowly.
    """
    if posed is None or posed.alone:
        return
    if (more := split(posed, start, phase)) is not None:
        yield more
    yield from (fewer for _, fewer in islice(without(posed, start), 1))
    if soft and (softer := unsplit(posed, start, phase)) is not None:
        yield softer
    yield from marched(posed, start)


def expected(posed: Posed | None, start: Start) -> Iterator[Start]:
    """Starting points to try from a predicted point of a branch, before any last resort.

    The sequence at hand, unsplit phases as the parts that they mostly are by now; then without a phase that is about to
    vanish, and without its image in the other half.
    """
    yield (start := start if posed is None else in_parts(posed, start))
    for _ in range(2):
        if (fewer := next(without(posed, start), None)) is None:
            return
        yield (start := fewer[1])


def _as_cut(posed: Posed, segments: list[Segment], signature: Signature) -> list[Segment]:
    """The phases of a motion that meets events, cut by planes no more often than those of a signature."""
    marks = [posed.exit_of(s.mode, s.event).mark for s in segments]
    left = Counter(label for label in signature if posed.exit_of(*label).mark)
    if all(marks) or not any(marks):
        return segments
    left.subtract([(segments[-1].mode, segments[-1].event)])  # where it closes
    phases: list[list[Segment]] = [[]]
    for segment, mark in zip(segments, marks, strict=True):
        phases[-1].append(segment)
        label = segment.mode, segment.event
        if segment is not segments[-1] and (not mark or left[label] > 0):
            left[label] -= 1
            phases.append([])
    return [joined_phases(some) for some in phases]


def _motions(posed: Posed, start: Start) -> Iterator[list[Segment]]:
    """The motion from the start, and from the middle of the longest phase: what leaves the cycle does so elsewhere."""
    t, u, setting = start
    span = float(np.sum(np.abs(t.durations_of(u))))
    segments = segments_of(*start)
    longest = int(np.argmax([s.duration for s in segments]))
    if t.counts[longest]:
        middle = evaluate_phase(t, u, setting.fractions, longest, np.array([0.5]))[0] * setting.scale
    else:
        whole = segments[longest]
        middle = flow_at(t.cycle.phases[longest].mode, whole.start, np.array([whole.duration / 2]), setting.p)[0]
    for mode, x in ((segments[0].mode, segments[0].start), (segments[longest].mode, middle)):
        try:
            yield march(
                posed.form, mode, x, setting.p, scale=setting.scale, until=lambda segment: False,
                tol=SEARCH_TOLERANCE, degree=t.degree, kind=t.kind, max_time=RESTART_PERIODS * span,
            )  # fmt: skip
        except MarchFailure:
            continue


def _closing(posed: Posed, segments: list[Segment], x: Array, scale: Array) -> list[tuple[float, int, list[Segment]]]:
    """(distance, how many, phases) of the parts of a motion that start at x, or next to it, and close."""
    S, shift = np.array(posed.closure.matrix), np.array(posed.closure.shift)
    found = []
    for first, begun in enumerate(segments):
        if not np.max(np.abs(begun.start - x) / scale) < CLOSES or first and not segments[first - 1].event:
            continue
        for m, segment in enumerate(segments[first:], start=1):
            distance = float(np.max(np.abs(S @ segment.behind - shift - begun.start) / scale))
            if segment.event and distance < CLOSES:
                found.append((distance, m, segments[first : first + m]))
    return found


def speeds_of_starts(start: Start) -> Array:
    """(P,) how fast the boundary is crossed at which each phase starts."""
    t, u, setting = start
    nodes, durations = t.nodes_of(u) * setting.scale, t.durations_of(u)
    rates = [
        abs(event_rate(phase, nodes[t.phase_end[k]], float(durations[k]), setting.p)[0])
        for k, phase in enumerate(t.cycle.phases)
    ]
    return np.roll(rates, 1)


def strongest(start: Start) -> int:
    """The number of the phase whose start is the boundary that is crossed the fastest.

    A phase that may be about to vanish is neither the first nor, among three or more, the last one: it is joined with
    its neighbours.

    Returns the number, 0 where the cycle starts there.
    """
    before, vanishing = speeds_of_starts(start), may_vanish(start[0].durations_of(start[1]))
    if vanishing is not None:
        before[vanishing] = -1.0
        if before.size > 2:
            before[(vanishing + 1) % before.size] = -1.0
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
