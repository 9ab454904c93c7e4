"""Another cut for a cycle that is cut by planes (closure.py).

A plane x_i = level is a good place to cut a cycle that meets no event where the cycle crosses it steeply,

    steepness = |x_i'| T / (max x_i - min x_i)        (pi for a sine through its middle, 0 where a plane is grazed)
    T the duration of the phases on both sides

Along a branch the cycle moves and changes its size, and a plane that stays where it was is left behind: then the cycle
is cut by another one, and goes on.  The intervals are those of the orbit, in another order, some of them cut in two.

A cycle that meets events may be cut by a plane besides:

    A | plane | A | event | B      ->      A | event | B

Along a branch the events move past the plane, and the phase between the two shrinks to nothing: no phase of the motion
does.  Or the motion reaches the plane no more: where it grazes that, the curve of the cycle turns round without a fold,
and comes back along itself, cut where the motion falls through the plane instead of where it rises.  Before either the
plane goes, for events are anchors enough.  Only a forced cycle keeps one, at a time in the middle of its longest phase.
Any cycle gets one where two phases are all that it has, one of them may vanish, and the other one can be cut: if its
events vanish with that it is a cycle still, cut by nothing else.

Symbols: n states, d stages, N intervals of the computed piece, tau local time in an interval.
"""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any, NamedTuple, cast

import numpy as np

from ..collocation.interval import field_at
from ..collocation.mesh import evaluate_phase
from ..collocation.scheme import scheme
from ..hybrid.system import Signature
from ..hybrid.vector_form import TURNS
from ..motion.phases import Segment
from ..orbits.adapt import Options
from ..orbits.closure import Section
from ..orbits.family import Cycles
from ..orbits.orbit import AnyOrbit, Orbit, unknowns_of
from ..orbits.restart import Start, from_segments
from ..orbits.sequences import later, part_of, segments_of, start_of, uncut
from ..orbits.simulated_phases import may_vanish, rotated
from ..roots import boundary
from .curve import along, point_at, solved_along, solved_at

Array = np.ndarray

WORTH_ANOTHER = 0.5
"""A plane crossed less steeply than this is left for a better one ..."""
BETTER = 1.5
"""... which must be crossed so many times more steeply."""
ABOUT_AS_STEEP = 0.7
"""Planes crossed with this part of the largest steepness, or more, serve as well."""
TRIED_LEVELS = (0.5, 0.4, 0.6, 0.3, 0.7)
"""Planes that are looked at, as parts of the range of a state."""
PLANE_EDGE = 0.1
"""A plane is left, too, when it is nearer to the ends of the range than this part of it."""
SAME_PERIOD = 1e-3
"""A cycle cut anew has the period that it had, to this; on a steep branch the parameter says less."""
AT_NOTHING = 1e-9
"""A level below this part of the range is zero."""
_WATCHED = np.linspace(0.0, 1.0, 9)
"""Places in an interval at which the sides of a plane are told: no motion that is solved on it swings faster."""
NEXT_TO_IT = 0.2
"""A plane is next to an event when the phase between them is shorter than this part of that on its other side."""


class _Crossing(NamedTuple):
    """Where the computed piece crosses a plane: interval, local time, direction, steepness."""

    interval: int
    tau: float
    rising: bool
    steepness: float


class _Plane(NamedTuple):
    """A plane with its crossings, in the order of time, and the steepness of the flattest."""

    state: int
    level: float
    crossings: tuple[_Crossing, ...]
    steepness: float


def cut_by_planes(orbit: Orbit) -> bool:
    """Whether a cycle is anchored by planes alone, which may be chosen anew."""
    family = orbit.problem
    if not family.sections or any(s.state == TURNS for s in family.sections):
        return False
    return all(arc.event in family.marks and arc.mode == orbit.arcs[0].mode for arc in orbit.arcs)


def section_outgrown(orbit: Orbit) -> bool:
    """Whether a cycle's own plane is not good any more."""
    return _steepness_of_ends(orbit) <= WORTH_ANOTHER


def with_better_section(orbit: AnyOrbit, vary: str, options: Options, *, insist: bool = False) -> AnyOrbit | None:
    """The same cycle, cut by the plane that it crosses most steeply.

    orbit, vary: cut by planes (`cut_by_planes`), and the name of the parameter that is followed; insist: take another
    plane wherever it is better at all; default: where it is much better.
    Returns Orbit; None where no other plane is better, or it did not serve.
    """
    now = _steepness_of_ends(orbit)
    planes = [p for p in _planes(orbit) if p.steepness > (1.0 if insist else BETTER) * now]
    if not planes:
        return None
    # Of planes that are about as steep the one that stays: a state that moves little about a large mean soon leaves it.
    low, high = _ranges(orbit)
    share = (high - low) / np.maximum(np.abs(low), np.abs(high))
    steepest = max(plane.steepness for plane in planes)
    alike = [plane for plane in planes if plane.steepness >= ABOUT_AS_STEEP * steepest]
    return _cut_at(orbit, max(alike, key=lambda plane: (share[plane.state], plane.steepness)), vary, options)


def _pieces(orbit: Orbit) -> tuple[Array, Array]:
    """(lengths (N,), states (N, d + 1, n)) of the intervals of the computed piece."""
    lengths = np.concatenate([arc.duration * np.diff(arc.breaks) for arc in orbit.arcs])
    return lengths, np.concatenate([arc.states for arc in orbit.arcs])


def _rates(orbit: Orbit, states: Array, phase: int = 0) -> Array:
    """(m, n) x' at states (m, n) of a phase."""
    mode = orbit.cycle.phases[phase].mode
    p, scale = orbit.problem.vector(), orbit.scale
    return np.array([scale * field_at(mode.field, x / scale, mode.sign, p, scale) for x in states])


def _ranges(orbit: Orbit) -> tuple[Array, Array]:
    """Lowest and highest value of every state over the cycle, (n,) each."""
    states = orbit.sample()[1]
    return states.min(axis=1), states.max(axis=1)


def _steepness_of_ends(orbit: Orbit) -> float:
    """Steepness of the flattest crossing of a plane; 0 where it is next to the end of the range, infinite for none."""
    low, high = _ranges(orbit)
    family, worst = orbit.problem, np.inf
    for k, arc in enumerate(orbit.arcs):
        section = next((s for s in family.sections if arc.event.startswith(f"{s.state} ")), None)
        if arc.event not in family.marks or section is None or section.state == TURNS:
            continue
        i = family.system.names.entries.index(section.state)
        size = high[i] - low[i]
        inside = PLANE_EDGE * size < arc.end[i] - low[i] < (1 - PLANE_EDGE) * size
        both = min(arc.duration + orbit.arcs[(k + 1) % len(orbit.arcs)].duration, orbit.period)
        worst = min(worst, abs(_rates(orbit, arc.end[None], k)[0, i]) * both / size if inside else 0.0)
    return float(worst)


def _planes(orbit: Orbit) -> list[_Plane]:
    """Planes that may serve; those across which an angle turns do not."""
    low, high = _ranges(orbit)
    found = []
    for i, name in enumerate(orbit.problem.system.names.entries):
        if name in orbit.problem.system.angles or not high[i] > low[i]:
            continue
        levels = low[i] + np.array(TRIED_LEVELS) * (high[i] - low[i])
        levels[np.abs(levels) < AT_NOTHING * (high[i] - low[i])] = 0.0  # where a symmetry has it
        found += [_plane(orbit, i, float(level)) for level in levels]
    return [plane for plane in found if plane is not None]


def _plane(orbit: Orbit, i: int, level: float) -> _Plane | None:
    """A plane with the crossings at which it cuts: rising and falling where there are just two, or the steepest one."""
    _, states = _pieces(orbit)
    s = scheme(orbit.degree, orbit.kind)
    low, high = _ranges(orbit)
    values = states[:, :, i] @ s.interpolation(_WATCHED).T - level
    ends = np.append(states[1:, 0, i], orbit.arcs[-1].end[i]) - level
    values[:, -1] = ends
    crossings = []
    for k, j in zip(*np.nonzero((values[:, :-1] < 0) != (values[:, 1:] < 0)), strict=True):
        rising = values[k, j + 1] > values[k, j]

        def beyond(tau: float, k: int = k, rising: bool = rising) -> bool:
            value = float((s.interpolation(np.array([tau])) @ states[k, :, i])[0]) - level
            return (value > 0) == rising

        a, b = _WATCHED[j], _WATCHED[j + 1]
        tau = float(b) if not beyond(float(b)) else boundary(beyond, float(a), float(b), width=1e-15, rounds=60)[1]
        x = (s.interpolation(np.array([tau])) @ states[k])[0]
        rate = abs(float(_rates(orbit, x[None])[0, i]))
        crossings.append(_Crossing(int(k), tau, bool(rising), rate * orbit.period / (high[i] - low[i])))
    if not crossings:
        return None
    if len(crossings) != 2 or orbit.repeats != 1:
        crossings = [max(crossings, key=lambda c: c.steepness)]
    return _Plane(i, float(level), tuple(crossings), min(c.steepness for c in crossings))


def _cut_at(orbit: AnyOrbit, plane: _Plane, vary: str, options: Options) -> AnyOrbit | None:
    """The cycle from the first crossing of a plane on, solved."""
    family = cast(Cycles, orbit.problem)
    mode, entries = orbit.arcs[0].mode, family.system.names.entries
    own = Section(mode, entries[plane.state], plane.level, float(orbit.scale[plane.state]))
    last, rising = _closing_section(orbit, plane, own)
    sections = [*(own for _ in plane.crossings[1:]), last]
    ways = [*(c.rising for c in plane.crossings[1:]), rising]
    first = plane.crossings[0]
    places = [*((c.interval, c.tau) for c in plane.crossings), (first.interval + len(_pieces(orbit)[0]), first.tau)]
    segments = []
    for section, up, begin, end in zip(sections, ways, places[:-1], places[1:], strict=True):
        event = section.exits(entries)[0 if up else 1].event.name
        segments.append(_between(orbit, mode, event, begin, end))
    problem = family.closing(family.closure, (last,))
    cycle = problem.cycle(tuple((g.mode, g.event) for g in segments), orbit.repeats)
    t, u, setting = from_segments(
        cycle, [(1.0, g) for g in segments], problem.vector(), along(problem, vary), degree=orbit.degree,
        kind=orbit.kind,
    )  # fmt: skip
    # Where a branch is steep a cycle is known by its place on it, not by the parameter.
    row = point_at(t, u, setting, setting.dp, like=None).row
    found = solved_along(problem, (t, u, setting), vary, row, options)
    if isinstance(found, str) or found.signature != cycle.signature:
        return None
    return cast(AnyOrbit, found) if abs(found.period / orbit.period - 1) <= SAME_PERIOD else None


def _closing_section(orbit: Orbit, plane: _Plane, own: Section) -> tuple[Section, bool]:
    """The plane at the end of the piece, the image of the one that it starts at, and whether it is crossed rising."""
    if np.array_equal(orbit.cycle.closure, np.eye(orbit.scale.size)):
        return own, plane.crossings[0].rising
    first = plane.crossings[0]
    x = (scheme(orbit.degree, orbit.kind).interpolation(np.array([first.tau])) @ _pieces(orbit)[1][first.interval])[0]
    end = orbit.cycle.opened(x)
    return replace(own, level=float(end[plane.state])), bool(_rates(orbit, end[None])[0, plane.state] > 0)


def _between(orbit: Orbit, mode: str, event: str, begin: tuple[int, float], end: tuple[int, float]) -> Segment:
    """The motion from one place (interval, local time) to another; behind the computed piece its image goes on."""
    lengths, states = _pieces(orbit)
    both, twice = np.concatenate([states, orbit.cycle.opened(states)]), np.concatenate([lengths, lengths])
    s = scheme(orbit.degree, orbit.kind)
    (k, tau), (m, until) = begin, end
    parts = [(j, tau if j == k else 0.0, until if j == m else 1.0) for j in range(k, m + 1)]
    parts = [(j, a, b) for j, a, b in parts if b > a]
    w = np.array([(s.interpolation(a + (b - a) * s.points) @ both[j]).ravel() for j, a, b in parts])
    steps = np.array([(b - a) * twice[j] for j, a, b in parts])
    breaks = np.concatenate([[0.0], np.cumsum(steps)]) / steps.sum()
    breaks[-1] = 1.0
    j, _, b = parts[-1]
    return Segment(mode, event, float(steps.sum()), breaks, w, (s.interpolation(np.array([b])) @ both[j])[0])


def badly_cut(orbit: Orbit) -> bool:
    """Whether a cycle that meets events had better be cut by another plane, or by one at all."""
    return beside_the_plane(orbit) < NEXT_TO_IT or any(_marks(orbit)) and section_outgrown(orbit)


def beside_the_plane(orbit: Orbit) -> float:
    """The phase of a cycle that may be about to vanish, if it ends or begins at a plane, in parts of that beyond it.

    Or if it is the only one but for one, and that can be cut and is not, in parts of that.  Infinite elsewhere, and
    where no phase is short.
    """
    marks, durations = _marks(orbit), [arc.duration for arc in orbit.arcs]
    k = may_vanish(durations)
    if k is None:
        return math.inf
    beyond = (k + 1) % len(marks) if marks[k] else k - 1
    alone = len(marks) == 2 and not any(marks) and orbit.problem.system is not None
    if marks[k] == marks[k - 1] and not (alone and orbit.cycle.phases[beyond].mode.flow is None):
        return math.inf
    return durations[k] / durations[beyond]


def same_events(one: Orbit, other: Orbit) -> bool:
    """Whether two cycles meet the same events in the same order, wherever planes cut them and whichever comes first.

    Of a cycle that is computed by half, those of the other half are the images of these.
    """
    if one.signature == other.signature:
        return True
    ours, theirs = _unmarked(one, one.signature), _unmarked(other, other.signature)
    if len(ours) != len(theirs):
        return False
    if any(ours[k:] + ours[:k] == theirs for k in range(max(len(ours), 1))):
        return True
    start: Any = unknowns_of(one)
    posed = one.problem.asked()
    for _ in range(one.repeats * len(one.arcs) - 1):
        start = rotated(posed, start, 1) if posed is not None else None
        if start is None or _unmarked(one, start[0].cycle.signature) == theirs:
            return start is not None
    return False


def _unmarked(orbit: Orbit, signature: Signature) -> Signature:
    """The phases of a sequence but those that end at a plane."""
    return tuple(label for label in signature if label[1] not in orbit.problem.marks)


def apart_by_kinks(one: Orbit, other: Orbit) -> bool:
    """Whether two cycles differ in phases, and only in those between which the field has a kink and no more."""
    a, b = one.cycle.without_kinks, other.cycle.without_kinks
    if one.signature == other.signature or len(a) == len(one.signature) or len(a) != len(b):
        return False
    return not a or any(a[k:] + a[:k] == b for k in range(len(a)))


def cut_elsewhere(orbit: AnyOrbit, options: Options) -> AnyOrbit | None:
    """The same cycle, cut in its longest phase, or by nothing where its events are anchors enough.

    orbit, options: a cycle that meets events (`beside_the_plane`); tolerance and method.
    Returns Orbit; None where it cannot be cut there.
    """
    family, marks = cast(Cycles, orbit.problem), _marks(orbit)
    first = next(k for k in range(len(marks)) if not marks[k - 1])
    start = rotated(family.asked(), unknowns_of(orbit), first) if first else unknowns_of(orbit)
    whole = None if start is None else solved_at(family, start, options)
    if whole is None:
        return None
    start = unknowns_of(whole)
    plain = family.closing(family.closure)
    found = solved_at(plain, start_of(plain.asked(), uncut(segments_of(*start), family.marks), start), options)
    if found is None or len(found.arcs) > 2 and not family.forced:
        return cast("AnyOrbit | None", found)
    return cast("AnyOrbit | None", _halved(plain, found, options))


def _halved(family: Cycles, orbit: Orbit, options: Options) -> Any:
    """A cycle that is cut by nothing, from a place in its longest collocated phase to the image of that.

    A forced one from the middle, by the time; else from where a state moves fastest, in parts of its range.
    """
    like, posed = unknowns_of(orbit), family.asked()
    k = max((k for k in range(like[0].phases) if like[0].counts[k]), key=lambda k: orbit.arcs[k].duration, default=None)
    if k is None or (start := rotated(posed, like, k) if k else like) is None:
        return None
    whole, *others = segments_of(*start)
    names = posed.image(whole, family.vector(), orbit.scale)
    if names is None:
        return None
    i, at, up = _steepest(family, orbit, start)
    behind, before = (part_of(posed, start, 0, whole, whole.mode, whole.event, a, b) for a, b in ((at, 1), (0, at)))
    last, entries = later(posed.closure, before), family.system.names.entries
    section = Section(names[0], entries[i], float(last.end[i]), float(orbit.scale[i]))
    last = replace(last, mode=names[0], event=section.exits(entries)[0 if up else 1].event.name)
    cut = family.closing(family.closure, (section,))
    return solved_at(cut, start_of(cut.asked(), [behind, *others, last], start), options)


def _steepest(family: Cycles, orbit: Orbit, start: Start) -> tuple[int, float, bool]:
    """(entry of the state, part of the first phase, whether it rises) at which the image of that phase is best cut."""
    (t, u, setting), entries = start, family.system.names.entries
    forced = TURNS in entries
    places = np.array([0.5]) if forced else np.array(TRIED_LEVELS)
    phase, scale = t.cycle.phases[0], setting.scale
    x = evaluate_phase(t, u, setting.fractions, 0, places)
    rates = np.array([scale * field_at(phase.mode.field, y, phase.mode.sign, setting.p, scale) for y in x])
    rates = rates @ np.linalg.inv(np.array(family.closure.matrix)).T
    low, high = _ranges(orbit)
    serves = [name == TURNS if forced else name not in family.system.angles for name in entries]
    if not forced:  # well inside the range
        serves = serves & (np.minimum(x * scale - low, high - x * scale) > 2 * PLANE_EDGE * (high - low))
    steepness = np.where(serves & (high > low), np.abs(rates) / np.where(high > low, high - low, 1.0), 0.0)
    j, i = np.unravel_index(int(np.argmax(steepness)), steepness.shape)
    return int(i), float(places[j]), bool(rates[j, i] > 0)


def _marks(orbit: Orbit) -> list[bool]:
    """Which phases of a cycle end at a plane."""
    marks = orbit.problem.marks
    return [arc.event in marks for arc in orbit.arcs]
