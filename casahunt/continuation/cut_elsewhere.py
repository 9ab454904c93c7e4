"""Another cut for a cycle that meets events, and is cut by a plane besides.

    A | plane | A | event | B      ->      A | event | B

Along a branch the events move past the plane, and the phase between the two shrinks to nothing: no phase of the motion
does.  Then the plane goes, for events are anchors enough.  Only a forced cycle keeps one, at a time in the middle of
its longest phase: if its events vanish it is a cycle still, cut by nothing else.  It gets one where two phases are
all that it has, and one of them may vanish.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, cast

from ..hybrid.vector_form import TURNS
from ..motion.phases import Segment
from ..orbits.adapt import Options
from ..orbits.closure import Section
from ..orbits.family import Cycles
from ..orbits.orbit import AnyOrbit, Orbit, unknowns_of
from ..orbits.sequences import joined, part_of, segments_of, start_of
from ..orbits.starts import may_vanish
from .vanishing import solved_at

NEXT_TO_IT = 0.2
"""A plane is next to an event when the phase between them is shorter than this part of its longer neighbour."""


def beside_the_plane(orbit: Orbit) -> float:
    """The phase of a cycle that may be about to vanish, in parts of its neighbour, if it ends or begins at a plane.

    Or if it is the only one of a forced cycle but for one, which is then cut by nothing.  Infinite elsewhere, and where
    no phase is short.
    """
    marks, durations = _marks(orbit), [arc.duration for arc in orbit.arcs]
    k = may_vanish(durations)
    family = orbit.problem
    alone = len(marks) == 2 and family.forced
    if k is None or marks[k] == marks[k - 1] and not (alone and not any(marks)):
        return math.inf
    return durations[k] / max(durations[k - 1], durations[(k + 1) % len(durations)])


def same_events(one: Orbit, other: Orbit) -> bool:
    """Whether two cycles meet the same events in the same order, wherever planes cut them and whichever comes first."""
    if one.signature == other.signature:
        return True
    a, b = (
        [label for label, mark in zip(orbit.signature, _marks(orbit), strict=True) if not mark]
        for orbit in (one, other)
    )
    return len(a) == len(b) and (not a or any(a[k:] + a[:k] == b for k in range(len(a))))


def apart_by_kinks(one: Orbit, other: Orbit) -> bool:
    """Whether two cycles differ in phases, and only in those between which the field has a kink and no more."""
    a, b = one.cycle.without_kinks, other.cycle.without_kinks
    if one.signature == other.signature or len(a) == len(one.signature) or len(a) != len(b):
        return False
    return not a or any(a[k:] + a[:k] == b for k in range(len(a)))


def cut_elsewhere(orbit: AnyOrbit, options: Options) -> AnyOrbit | None:
    """The same cycle, cut in the middle of its longest phase.

    orbit, options: a cycle that meets events and is cut by a plane (`beside_the_plane`); tolerance and method.
    Returns Orbit; None where it cannot be cut there.
    """
    family, marks = cast(Cycles, orbit.problem), _marks(orbit)
    first = next(k for k in range(len(marks)) if not marks[k - 1])
    start = family.starting_at(first, *unknowns_of(orbit)) if first else unknowns_of(orbit)
    whole = None if start is None else solved_at(family, start, options)
    if whole is None:
        return None
    start = unknowns_of(whole)
    phases: list[list[Segment]] = [[]]
    for segment in segments_of(*start):
        phases[-1].append(segment)
        if segment.event not in family.marks:
            phases.append([])
    plain = family.closing(family.closure)
    uncut = solved_at(plain, start_of(plain.asked(), [joined(some) for some in phases if some], start), options)
    forced = TURNS in family.system.names.entries
    return cast("AnyOrbit | None", _halved(plain, uncut, options) if uncut is not None and forced else uncut)


def _halved(family: Cycles, orbit: Orbit, options: Options) -> Any:
    """A forced cycle that is cut by nothing, from the middle of its longest collocated phase to the image of that."""
    like, posed = unknowns_of(orbit), family.asked()
    k = max((k for k in range(like[0].phases) if like[0].counts[k]), key=lambda k: orbit.arcs[k].duration, default=None)
    if k is None or (start := family.starting_at(k, *like) if k else like) is None:
        return None
    whole, *others = segments_of(*start)
    names = posed.image(whole, family.vector(), orbit.scale)
    if names is None:
        return None
    behind, before = (part_of(posed, start, 0, whole, whole.mode, whole.event, a, b) for a, b in ((0.5, 1), (0, 0.5)))
    last = posed.later(before)
    entries = family.system.names.entries
    i = entries.index(TURNS)
    section = Section(names[0], TURNS, float(last.end[i]), float(orbit.scale[i]))
    last = replace(last, mode=names[0], event=section.exits(entries)[0].event.name)
    cut = family.closing(family.closure, (section,))
    return solved_at(cut, start_of(cut.asked(), [behind, *others, last], start), options)


def _marks(orbit: Orbit) -> list[bool]:
    """Which phases of a cycle end at a plane."""
    marks = orbit.problem.marks
    return [arc.event in marks for arc in orbit.arcs]
