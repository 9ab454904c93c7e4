"""Another cut for a cycle that meets events, and is cut by a plane besides.

    A | plane | A | event | B      ->      A | event | B | plane | B

Along a branch the events move past the plane, and the phase between the two shrinks to nothing: no phase of the motion
does.  Then the plane is put into the middle of the longest phase, across the state that moves most steeply there.
"""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np

from ..collocation.interval import field_at
from ..hybrid.vector_form import TURNS
from ..motion.march import Segment
from ..orbits.adapt import Options
from ..orbits.closure import Section
from ..orbits.family import Family
from ..orbits.orbit import AnyOrbit, Orbit, unknowns_of
from ..orbits.sequences import joined, part_of, segments_of, start_of
from ..orbits.starts import may_vanish
from .vanishing import solved_at

Array = np.ndarray


def cut_shrinks(orbit: Orbit) -> bool:
    """Whether the phase of a cycle that may be about to vanish lies between an event and the plane that cuts it."""
    marks = _marks(orbit)
    k = may_vanish([arc.duration for arc in orbit.arcs])
    return k is not None and marks[k] != marks[k - 1]


def cut_elsewhere(orbit: AnyOrbit, options: Options) -> AnyOrbit | None:
    """The same cycle, cut in the middle of its longest phase.

    Parameters
    ----------
    orbit, options
        a cycle that meets events and is cut by a plane (`cut_shrinks`); tolerance and method.

    Returns
    -------
    Orbit; None where it cannot be cut there.
    """
    family, marks = cast(Family, orbit.problem), _marks(orbit)
    first = next(k for k in range(len(marks)) if not marks[k - 1])
    start = family.starting_at(first, *unknowns_of(orbit)) if first else unknowns_of(orbit)
    whole = None if start is None else solved_at(family, start, options)
    if whole is None:
        return None
    start = unknowns_of(whole)
    events = {event.event.name for s in family.sections for event in s.exits(family.system.names.entries)}
    phases: list[list[Segment]] = [[]]
    for segment in segments_of(*start):
        phases[-1].append(segment)
        if segment.event not in events:
            phases.append([])
    plain = replace(family, sections=())
    uncut = solved_at(plain, start_of(plain.asked(), [joined(some) for some in phases if some], start), options)
    return None if uncut is None else _halved(plain, uncut, options)


def _halved(family: Family, orbit: Orbit, options: Options) -> AnyOrbit | None:
    """A cycle that is cut by no plane, cut in the middle of its longest collocated phase."""
    start = unknowns_of(orbit)
    t, segments = start[0], segments_of(*start)
    k = max((k for k in range(t.phases) if t.counts[k]), key=lambda k: segments[k].duration, default=None)
    if k is None:
        return None
    mode, p, scale = t.cycle.phases[k].mode, family.vector(), orbit.scale
    middle = part_of(family.asked(), start, k, segments[k], segments[k].mode, "", 0.0, 0.5).end
    rate = scale * field_at(mode.field, middle / scale, mode.sign, p, scale)
    entries = family.system.names.entries
    if TURNS in entries:
        i = entries.index(TURNS)
    else:
        size = np.ptp(orbit.sample()[1], axis=1)
        steepness = np.divide(np.abs(rate), size, out=np.zeros_like(rate), where=size > 0)
        steepness[[entries.index(name) for name in family.system.angles]] = 0.0
        i = int(np.argmax(steepness))
    section = Section(segments[k].mode, entries[i], float(middle[i]), float(scale[i]))
    event = section.exits(entries)[0 if rate[i] > 0 else 1].event.name
    cut = replace(family, sections=(section,))
    posed = cut.asked()
    parts = [
        part_of(posed, start, k, segments[k], segments[k].mode, name, a, b)
        for name, a, b in ((event, 0.0, 0.5), (segments[k].event, 0.5, 1.0))
    ]
    return solved_at(cut, start_of(posed, [*segments[:k], *parts, *segments[k + 1 :]], start), options)  # type: ignore[return-value]


def _marks(orbit: Orbit) -> list[bool]:
    """Which phases of a cycle of a user's system end at a plane."""
    family = orbit.problem
    if not isinstance(family, Family):
        return [False] * len(orbit.arcs)
    names = {event.event.name for s in family.sections for event in s.exits(family.system.names.entries)}
    return [arc.event in names for arc in orbit.arcs]
