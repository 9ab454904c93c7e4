"""A symmetric cycle whose symmetry a parameter breaks: from half a cycle to the whole.

    x(T/2) -> S^-1 (x(0) + c),  half of the phases      ->      x(T) -> x(0) + c',  all of them

A cycle that is found symmetric is computed on half its period.  A parameter along which the system loses the symmetry
takes it from the cycle, too; half of it solves equations that are no longer the system's.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import cast

import numpy as np

from ..errors import NoOrbit, Status
from ..motion.phases import Segment
from ..orbits.adapt import Options
from ..orbits.closure import Closure, Section, turned, with_sections
from ..orbits.family import Cycles
from ..orbits.orbit import AnyOrbit, unknowns_of
from ..orbits.recurrence import image_of
from ..orbits.sequences import later, segments_of, start_of, uncut
from .curve import solved_at

LOOKED_FOR = (1.0, 0.618)
"""Parts of the way that the parameter is to go at which the symmetry is looked for."""
LITTLE = 0.1
"""The way where it has no end, in units of the parameter."""


def as_whole_as_needed(orbit: AnyOrbit, vary: Sequence[str], to: Sequence[float], options: Options) -> AnyOrbit:
    """A cycle whose computed piece stays a part of it along parameters.

    orbit, vary, to: the cycle, names of parameters, and values towards which they go, infinite where that is not known.
    Returns Orbit: the same; or the whole cycle, where a parameter breaks the symmetry by which half of it was computed.
    Raises NoOrbit: the whole cycle was not computed.
    """
    family = orbit.problem
    if family.system is None or orbit.repeats == 1:
        return orbit
    if keeps_symmetry(orbit, vary, to):
        return orbit
    found = _whole(orbit, options)
    if found is None:
        names = " and ".join(vary)
        sentence = f"along {names} the cycle of {family.title} loses its symmetry, and the whole of it was not computed"
        raise NoOrbit(f"{sentence}: start from a cycle at another {names}, where it has none", Status.NOT_CONVERGED)
    return found


def keeps_symmetry(orbit: AnyOrbit, vary: Sequence[str], to: Sequence[float]) -> bool:
    """Whether a cycle that is computed on a part of its period may stay so along parameters.

    orbit, vary, to: as in `as_whole_as_needed`.
    Returns True where the system has its symmetry all along, as far as one looks; and of what is no user's system.
    """
    family = orbit.problem
    if family.system is None or orbit.repeats == 1:
        return True
    places = _looked_at(cast(Cycles, family), vary, to)
    return all(_image(orbit, cast(Cycles, family.with_value(name, value))) is not None for name, value in places)


def _looked_at(family: Cycles, vary: Sequence[str], to: Sequence[float]) -> list[tuple[str, float]]:
    places = []
    for name, end in zip(vary, to, strict=True):
        here = family.value(name)
        way = end - here if math.isfinite(end) else math.copysign(LITTLE * family.unit(name), end)
        places += [(name, here + part * way) for part in LOOKED_FOR]
    return places


def _image(orbit: AnyOrbit, family: Cycles) -> tuple[list[Segment], tuple[Section, ...]] | None:
    """The other half of a cycle by the symmetry at some parameters, and the images of the planes that cut it.

    None where the system has not got that symmetry there.
    """
    own, posed = cast(Cycles, orbit.problem), family.asked()
    entries, found = family.system.names.entries, []
    planes: list[Section] = []
    of_mark = {event.event.name: s for s in own.sections for event in s.exits(entries)}
    segments = segments_of(*unknowns_of(orbit))
    for segment in segments:
        if segment.event in of_mark:
            section, end = of_mark[segment.event], later(posed.closure, segment).end
            level = float(end[entries.index(section.state)])
            planes += [replace(section, mode=mode, level=level) for mode in family.system.vector_form.modes]
    form = with_sections(family.system, (*own.sections, *planes))
    for segment in segments:
        names = image_of(form, segment, family.closure, family.vector(), orbit.scale)
        if names is None:
            return None
        found.append(replace(later(posed.closure, segment), mode=names[0], event=names[1]))
    return found, tuple(planes)


def _whole(orbit: AnyOrbit, options: Options) -> AnyOrbit | None:
    """The whole cycle, cut by no plane if it meets events; else by the image of the one that ended the half of it."""
    family, start = cast(Cycles, orbit.problem), unknowns_of(orbit)
    image = _image(orbit, family)
    if image is None:
        return None
    halves, (others, planes), entries = segments_of(*start), image, family.system.names.entries
    marks = {event.event.name: s for s in (*family.sections, *planes) for event in s.exits(entries)}
    last = others[-1]
    sections = tuple(s for s in planes if last.event in marks and s == replace(marks[last.event], mode=last.mode))
    segments = uncut((*halves, *others), marks)
    closure = Closure.of(np.eye(orbit.scale.size), turned(family.system, segments[0].start, segments[-1].behind), 1)
    whole = family.closing(closure, sections)
    return cast("AnyOrbit | None", solved_at(whole, start_of(whole.asked(), segments, start), options))
