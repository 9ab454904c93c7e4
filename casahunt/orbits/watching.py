"""A first look at a motion: how large its states are, whether it goes on, and where it is cut if it meets no event.

    watched    the motion, for longer and longer, until it has met events or passed many intervals
    cut        a plane through the middle of a state that swings, x_i = level; or turns of an angle or of the forcing

A motion that is cut by turns is counted: x_i goes from one turn to the next, and each phase ends at the next one.

Symbols: n states, m points.
"""

from __future__ import annotations

from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ..collocation.admissibility import MOVES_BELOW
from ..hybrid import system as engine
from ..hybrid.language import System
from ..hybrid.problem import Kind
from ..hybrid.vector_form import TURNS
from ..motion.phases import MarchFailure, Segment, march
from ..motion.simulation import MARCH_DEGREE, first_sizes, look
from .closure import Section, turns
from .recurrence import TRIED, turns_over

Array = np.ndarray

SEARCH_TOLERANCE = 1e-6  # of a motion that is looked at: Newton's method starts from it
FIRST_LOOK = 20.0
"""Times in which the field moves a state by its size, that a motion is watched at first."""
VERY_LONG = 1e6
"""So many times as long it is watched where nothing happens."""
LOOKED_AT_MOST, LOOK_LONGER = 5, 4
"""Looks, each this much longer than the one before, until there is something to see."""
ENOUGH_EVENTS, ENOUGH_STEPS = 4, 150
"""A motion is watched until there are so many: with ten times as many events the search of a stick-slip cycle does
eight times the work, with ten times as many steps that of the van der Pol oscillator's seven times.  Of a mode with
ways out a look more: a motor that sticks while its load rings takes more steps to its breakaway."""
GREW, LARGER = 1e12, 1e2
"""A state this much larger than all states were at the start, and than 1, grows without bound; it may be growing."""
UNLIKE_ROUNDING = 1e4
"""What becomes so many times as large as it was thought to be, in a look without events, was rounding."""
AS_MUCH = 0.9
"""The motion is cut at the first state whose range, in its size, is this part of the largest one at least: in a
symmetric motion they are all twice their sizes, and which is the largest would be rounding."""
WENT_ROUND = 2.0
"""Turns of an angle that show that it goes round."""


class NotFound(Exception):
    """No cycle is met: why, and how long the motion was followed."""

    def __init__(self, why: str, followed: float) -> None:
        super().__init__(why)
        self.followed = followed


class AtRest(NotFound):
    """The motion comes to rest: what was tried on the way there says nothing of any cycle."""


class Watched(NamedTuple):
    """What a look has shown.

    Attributes
    ----------
    segments : the motion during the last look.
    scale : (n,) sizes of the states then.
    late : (n, m) states then.
    events : how many were met then.
    span : how long it was watched in all.
    """

    segments: list[Segment]
    scale: Array
    late: Array
    events: int
    span: float


def going_on(form: engine.VectorSystem, last: Segment, p: Array) -> tuple[str, Array]:
    """Where a motion goes on behind its last segment, which may or may not have met an event.

    last, p: the segment; (np,) parameters. Returns mode and (n,) state.
    """
    if not last.event:
        return last.mode, last.end.copy()
    return form.ways_out(last.mode, last.event)[0].successor(last.behind, p), last.behind.copy()


class Turning(NamedTuple):
    """The entry of the state that is counted: its number, signed step from plane to plane, planes in a turn."""

    entry: int
    step: float
    parts: int

    @property
    def whole(self) -> float:
        """By how much the entry grows in a turn."""
        return self.step * self.parts

    def wrapped(self, x: Array) -> Array:
        """A state with its whole turns taken off; on the last plane of a turn it is at the start of the next."""
        out = x.copy()
        out[self.entry] -= self.whole * np.floor(x[self.entry] / self.whole + 1e-9)  # rounding is no turn
        return out


def watch_motion(system: System, mode: str, x: Array, p: Array, kind: Kind, least: Array | None = None) -> Watched:
    """Look at a motion, on and on, until there are events or steps enough.

    system, mode: the system and the name of the mode that it starts in; x, p, least: (n,) state at the start; (np,)
    parameters; (n,) sizes that the states are known to have at least.
    Raises NotMet: it comes to rest, or grows without bound; MarchFailure: it cannot be followed.
    """
    form, time, most = system.vector_form, 0.0, ENOUGH_STEPS
    first, counted = max(1.0, float(np.max(np.abs(x)))), turns(system) > 0
    least = np.zeros(x.size) if least is None else least
    span, scale = longest_look(system, mode, x, p, kind, least)
    for _ in range(LOOKED_AT_MOST):
        before = scale
        try:
            scale, seen, (times, states) = look(
                form, mode, x, p, scale, kind, span, ENOUGH_EVENTS, most, least
            )  # fmt: skip
        except MarchFailure as failure:
            i = int(np.argmax(scale))
            if scale[i] > LARGER * first:
                grown = f"{system.names.entries[i]} to {scale[i]:.2g}"
                raise NotFound(f"the motion grows, {grown} and more: {failure}", time) from None
            raise
        time += sum(s.duration for s in seen)
        for k in np.flatnonzero((scale > GREW * first) & ~counted):
            raise NotFound(f"the motion grows without bound: {system.names.entries[k]} to {scale[k]:.2g}", time)
        scale = np.where(counted, np.minimum(scale, turns(system)), scale)
        events = sum(bool(s.event) for s in seen)
        enough = ENOUGH_STEPS * (LOOK_LONGER if form.exits[seen[-1].mode] else 1)
        unlike = bool(np.any(scale > UNLIKE_ROUNDING * before))
        if events >= ENOUGH_EVENTS or events == 0 and sum(s.count for s in seen) >= enough and not unlike:
            break
        (mode, x), most, least = going_on(form, seen[-1], p), most * LOOK_LONGER, scale
    late = states[:, times > times[-1] / 2]
    # Anything moves but the time
    ranges = np.ptp(late, axis=1)[: len(system.states)]
    if not bool(np.any(ranges > MOVES_BELOW * scale[: ranges.size])):
        what = "" if events else ", and meets no event"
        raise AtRest(f"the motion comes to rest{what}", time)
    return Watched(seen, scale, late, events, time)


def longest_look(
    system: System, mode: str, x: Array, p: Array, kind: Kind, least: Array | float = 0.0
) -> tuple[float, Array]:
    """How long a motion is watched at most, very long beside what happens at first, and (n,) supposed sizes.

    Of a forced system some turns; sizes are those at the start and at the first event, if one is met at once, and no
    smaller than they are known to be: at rest they are rounding, which no interval is short enough for.
    """
    scale = size = first_sizes(system.vector_form.modes[mode], x, p, least=least)
    probe = march(
        system.vector_form, mode, x, p, scale=scale, until=lambda s: True, tol=1e-3, degree=MARCH_DEGREE,
        kind=kind, max_intervals=10**6, max_time=1e-3,
    )[-1]  # fmt: skip
    if probe.event:
        scale = np.where(probe.end != 0, np.maximum(np.maximum(np.abs(x), least), np.abs(probe.end)), scale)
    if system.forcing_period is not None:
        return FIRST_LOOK * float(system.names.turn(p)), scale
    moved = np.max(np.abs(probe.end - x) / size) / max(probe.duration, 1e-300)
    return FIRST_LOOK * VERY_LONG / max(float(moved), 1e-3), scale


def section_of(system: System, seen: Watched, p: Array) -> tuple[tuple[Section, ...], Turning | None]:
    """Where to cut a motion that meets no event.

    system, seen, p: the system, what was seen of the motion, (np,) parameters.
    Returns sections, and what is counted from one to the next, if anything is.
    """
    names, late, mode = system.names.entries, seen.late, seen.segments[-1].mode
    if system.forcing_period is not None:
        some = late[:, :: max(1, late.shape[1] // TRIED)]
        parts = 2 if turns_over(system, mode, some, p, seen.scale) else 1
        return _by_turns(system, mode, Turning(len(names) - 1, 1.0 / parts, parts))
    low, high = late.min(axis=1), late.max(axis=1)
    moves, angles = (high - low) / seen.scale, turns(system) > 0
    moves[angles] = -1.0  # an angle that turns passes a plane once
    i = int(np.flatnonzero(moves >= min(AS_MUCH * moves.max(), moves.max()))[0])
    level = (low[i] + high[i]) / 2
    swings = np.count_nonzero(np.diff(late[i] > level)) > 1 and moves[i] > MOVES_BELOW
    if not swings and angles.any():
        turned = (late[:, -1] - late[:, 0]) / (2 * np.pi)
        round_ = int(np.argmax(np.where(angles, np.abs(turned), -1.0)))
        if abs(turned[round_]) > WENT_ROUND:
            return _by_turns(system, mode, Turning(round_, float(np.copysign(2 * np.pi, turned[round_])), 1))
        if moves[i] <= MOVES_BELOW:  # an angle that swings
            i, level = round_, (low[round_] + high[round_]) / 2
    if abs(level) < 0.05 * (high[i] - low[i]):
        level = 0.0  # where a symmetry would have it
    return (Section(mode, names[i], float(level), float(seen.scale[i])),), None


def _by_turns(system: System, mode: str, turning: Turning) -> tuple[tuple[Section, ...], Turning]:
    name = system.names.entries[turning.entry]
    size = 1.0 if name == TURNS else abs(turning.step)
    levels = [(k + 1) * turning.step for k in range(turning.parts)]
    return tuple(Section(mode, name, level, size) for level in levels), turning


def counted_on(
    turning: Turning, section: Section, passes: list[Segment], states: tuple[str, ...]
) -> tuple[tuple[Section, ...], list[Segment]]:
    """Phases of a motion that is cut by turns, counted on from each to the next, with planes of their own.

    turning, section: what is counted, and one of its planes; passes: the phases, each of which starts within the first
    turn.
    """
    i, step = turning.entry, turning.step
    began = round(float(passes[0].start[i]) / step) * step
    sections, counted = [], []
    for k, s in enumerate(passes):
        level = began + (k + 1) * step
        sections.append(replace(section, level=level))
        way_out = sections[-1].exits(states)[0 if step > 0 else 1]
        ahead = round((began + k * step - float(s.start[i])) / turning.whole) * turning.whole
        w, end = s.w.copy(), s.end.copy()
        w[:, i :: end.size] += ahead
        end[i] += ahead
        counted.append(Segment(s.mode, way_out.event.name, s.duration, s.breaks, w, end))
    return tuple(sections), counted
