"""Other phase sequences for a cycle of any hybrid system, where the one at hand has stopped being a motion.

Along a branch phases are born and die.  An event that is grazed, h = 0 and h' = 0, is met twice on the one side of
that and not at all on the other:

    A | B | A  <->  A           a pair of boundaries is born, or vanishes with the phase between them
    A | B | C  <->  A | C       a phase shrinks to nothing between two others, and its first event leads past it

From a root of the wrong sequence, or from a point predicted for it, these functions make starting points for the other
one.  All of them start at the same state as the cycle at hand, so that a branch goes on without a jump.

    split      put boundaries where the root crosses exits of its mode
    with_contact put a boundary where a phase grazes an exit, and the phase that begins there
    with_successor put the phase in that begins where the successor of an event is about to change
    without    take the shortest phase out, with both boundaries, or with the first of them
    unsplit    read a phase of a part of a mode as one of that mode, with kinks inside that are too weak for boundaries
    in_parts   the opposite, once they are strong enough

The phases that the motion itself has: simulated_phases.py.

Symbols: n states, P phases.
"""

from __future__ import annotations

from collections.abc import Callable, Container, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..collocation.interval import field_at
from ..collocation.mesh import evaluate_phase
from ..collocation.successors import DECIDED_BEYOND, around
from ..collocation.transcription import Setting, Transcription
from ..hybrid import system as engine
from ..hybrid.system import Cycle, Signature
from ..motion.march_exits import EXIT_ROUNDING, behind
from ..motion.phases import Segment
from .closure import Closure
from .restart import Start, breaks_of, from_segments, in_scale, piece, relabelled

Array = np.ndarray

VANISHES_BELOW = 0.5
"""A phase may be about to vanish where it is shorter than this part of the longer one of its neighbours."""
BORN_WITH, LEFT_AT_ONCE = 1e-3, 1e-4
"""Part of the computed piece that a phase takes which begins with no duration; and how far the event that ends it may
be from zero where it begins, the contact being known to less."""
CROSSING_LOOKS = 64
"""Parts of an interval, at the ends of which it is looked at for crossings of exits; with 16 a phase just begun
at a grazing is overlooked (test_vanishing.py)."""


@dataclass(frozen=True, eq=False)
class Posed:
    """What must be known of the problem whose cycles these are.

    Attributes
    ----------
    form : the system with all exits, sections among them.
    closure : how its cycles close.
    cycle : signature -> cycle.
    image : (phase, p, state scale) -> mode and event of what it is mapped to one computed piece later, or None.
    alone : another sequence is no answer, even where this one has stopped being a motion.
    """

    form: engine.VectorSystem
    closure: Closure
    cycle: Callable[[Signature], Cycle]
    image: Callable[[Segment, Array, Array], tuple[str, str] | None]
    alone: bool = False

    def exit_of(self, mode: str, event: str) -> engine.Exit:
        """The exit of a mode at an event."""
        return next(e for e in self.form.exits[mode] if e.event.name == event)


def later(closure: Closure, segment: Segment) -> Segment:
    """The image of a segment one computed piece later, under its own name: S^-1 (x + c)."""
    S, shift = np.linalg.inv(np.array(closure.matrix)), np.array(closure.shift)

    def moved(x: Array) -> Array:
        return (x + shift) @ S.T

    w = moved(segment.w.reshape(-1, shift.size)).reshape(segment.w.shape)
    jumped = None if segment.jumped is None else moved(segment.jumped)
    return replace(segment, w=w, end=moved(segment.end), jumped=jumped)


def segments_of(t: Transcription, u: Array, setting: Setting) -> list[Segment]:
    """The phases of a solution, or of what is to become one, as marched ones.

    Returns segments in physical units.
    """
    nodes = t.nodes_of(u) * setting.scale
    w = t.intervals_of(u) * np.tile(setting.scale, t.degree + 1)
    found = []
    for k, phase in enumerate(t.cycle.phases):
        start, end = t.phase_start[k], t.phase_end[k]
        collocated = t.counts[k] > 0
        found.append(
            Segment(
                phase.mode.name, phase.end.name, float(t.durations_of(u)[k]),
                breaks_of(t, setting, k) if collocated else np.array([0.0, 1.0]),
                w[t.phase_intervals(k)] if collocated else nodes[start][None],
                nodes[end], None if phase.reset is None else nodes[end + 1],
            )
        )  # fmt: skip
    return found


def start_of(posed: Posed, segments: Sequence[Segment], like: Start) -> Start:
    """The unknowns of a cycle with these phases.

    like: the starting point whose scheme, parameters and state scale it takes.
    """
    t, _, setting = like
    cycle = posed.cycle(tuple((s.mode, s.event) for s in segments))
    passes = [(1.0, s) for s in segments]
    fresh = from_segments(cycle, passes, setting.p, setting.dp, degree=t.degree, kind=t.kind)
    return in_scale(fresh, setting.scale)


# A phase taken out ---------------------------------------------------------------------------------------------


def without(posed: Posed | None, start: Start) -> Iterator[tuple[int, Start]]:
    """The cycles without a phase that may be about to vanish, the shortest first.

    Between two phases of one mode either both boundaries go, or the event before it leads past it.

    Yields number of the phase, and starting point.
    """
    if posed is None:
        return
    segments = segments_of(*start)
    for k in sorted(range(1, len(segments)), key=lambda j: segments[j].duration):
        neighbours = [s.duration for s in segments[k - 1 : k + 2 : 2]]
        if segments[k].duration > VANISHES_BELOW * max(neighbours):
            continue
        if k + 1 < len(segments) and segments[k - 1].mode == segments[k + 1].mode:
            whole = joined_phases(segments[k - 1 : k + 2])
            yield k, start_of(posed, [*segments[: k - 1], whole, *segments[k + 2 :]], start)
        if _leads_past(posed, segments, k, start[2]):
            yield k, start_of(posed, [*segments[:k], *segments[k + 1 :]], start)


def uncut(segments: Sequence[Segment], marks: Container[str]) -> list[Segment]:
    """The phases between events: those that end at a mark, where a plane cuts, joined with what follows."""
    phases: list[list[Segment]] = [[]]
    for segment in segments:
        phases[-1].append(segment)
        if segment.event not in marks:
            phases.append([])
    return [joined_phases(some) for some in phases if some]


def joined_phases(some: Sequence[Segment]) -> Segment:
    """Successive parts of a phase of one mode, or a phase, one that vanishes and the rest of the first, as one phase.

    Returns segment, which ends as the last part does.
    """
    first, last = some[0], some[-1]
    # The states of one with a negative duration, or in closed form among others, are dropped: its time is nothing.
    spans = np.array([max(s.duration, 0.0) if s.w.shape[1] == first.w.shape[1] else 0.0 for s in some])
    total = float(np.sum(spans))
    if len(first.breaks) == 2 and first.w.shape[1] == first.end.size:  # in closed form
        return replace(last, mode=first.mode, duration=total, w=first.w)
    kept = [(s, span, o) for s, span, o in zip(some, spans, np.cumsum([0.0, *spans[:-1]]), strict=True) if span > 0]
    breaks = np.concatenate([[0.0], *[(o + span * s.breaks[1:]) / total for s, span, o in kept]])
    return replace(last, mode=first.mode, duration=total, breaks=breaks, w=np.vstack([s.w for s, _, _ in kept]))


def _leads_past(posed: Posed, segments: Sequence[Segment], k: int, setting: Setting) -> bool:
    """Whether the event before phase k may lead to the phase behind it: its successor depends on the numbers.

    Where the phase ends may be just where that changes.
    """
    before, beside = posed.exit_of(segments[k - 1].mode, segments[k - 1].event), DECIDED_BEYOND * setting.scale
    places = [segments[k - 1].behind, *around(segments[k].behind, beside)]
    names = {before.successor(x, setting.p) for x in places}
    if k + 1 < len(segments):
        return segments[k + 1].mode in names
    first = posed.image(segments[0], setting.p, setting.scale)
    return first is not None and first[0] in names


# Boundaries put in ----------------------------------------------------------------------------------------------


def split(posed: Posed, start: Start, phase: int) -> Start | None:
    """Boundaries where a phase crosses exits of its mode, and comes back; its polynomials stay what they are.

    posed, start: the problem, and a root that is no motion of it.
    Returns starting point; None where it crosses none, or does not come back.
    """
    t, u, setting = start
    segments = segments_of(*start)
    if not t.counts[phase] or t.cycle.phases[phase].mode.name not in posed.form.exits:
        return None
    times, states = _looked_at(t, u, setting, phase)
    mode, a = segments[phase].mode, 0.0
    parts: list[tuple[str, str, float, float]] = []
    while (crossing := _crossing(posed, mode, times, states, a, setting.p)) is not None:
        at, way_out = crossing
        if way_out.reset is not None or len(parts) > len(times):
            return None
        x = np.array([np.interp(at, times, row) for row in states])
        parts.append((mode, way_out.event.name, a, at))
        mode, a = way_out.successor(x, setting.p), at
    if not parts or mode != segments[phase].mode:
        return None
    parts.append((mode, segments[phase].event, a, 1.0))
    fresh = [part_of(posed, start, phase, segments[phase], *part) for part in parts]
    return start_of(posed, [*segments[:phase], *fresh, *segments[phase + 1 :]], start)


def _looked_at(t: Transcription, u: Array, setting: Setting, phase: int) -> tuple[Array, Array]:
    """(m,) fractions of a collocated phase and (n, m) states there."""
    breaks = breaks_of(t, setting, phase)
    times = (breaks[:-1, None] + np.diff(breaks)[:, None] * np.arange(CROSSING_LOOKS) / CROSSING_LOOKS).ravel()
    times = np.append(times, 1.0)
    return times, (evaluate_phase(t, u, setting.fractions, phase, times) * setting.scale).T


def _crossing(
    posed: Posed, mode: str, times: Array, states: Array, a: float, p: Array
) -> tuple[float, engine.Exit] | None:
    """(fraction, exit) of the first exit of a mode that is crossed behind a and before the end."""
    found: list[tuple[float, engine.Exit]] = []
    for way_out in posed.form.exits[mode]:
        h = way_out.direction * np.asarray(way_out.event.function(states, 0.0, p), float)
        h[np.abs(h) <= EXIT_ROUNDING * float(np.max(np.abs(h)))] = -0.0
        beyond = (h[1:] > 0) & (h[:-1] <= 0)
        beyond &= times[:-1] > a
        for i in np.flatnonzero(beyond)[:1]:
            at = times[i] - h[i] * (times[i + 1] - times[i]) / (h[i + 1] - h[i])
            if at < times[-2]:
                found.append((float(at), way_out))
    return min(found, key=lambda crossing: crossing[0]) if found else None


def part_of(posed: Posed, start: Start, k: int, whole: Segment, mode: str, event: str, a: float, b: float) -> Segment:
    """A part of the collocated phase k as a phase of its own; of a mode in closed form its start is enough.

    posed, start, k, whole: the problem, a cycle, number of a phase, and the phase; mode, event, a, b: of the part, and
    where in the phase it begins and ends, as fractions of its duration.
    """
    t, u, setting = start
    breaks, w, duration = piece(t, u, setting, k, a, b)
    w, last = w * np.tile(setting.scale, t.degree + 1), b == 1.0
    if posed.form.modes[mode].flow is not None:
        breaks, w = np.array([0.0, 1.0]), w[:1, : t.n]
    end = evaluate_phase(t, u, setting.fractions, k, np.array([b]))[0] * setting.scale
    return Segment(mode, event, duration, breaks, w, whole.end if last else end, whole.jumped if last else None)


# Kinks too weak for boundaries ------------------------------------------------------------------------------------


def parts_of(form: engine.VectorSystem, mode: str) -> list[engine.VectorMode]:
    """The modes that are parts of one that has them unsplit."""
    return [part for part in form.modes.values() if part.unsplit == mode]


def unsplit(posed: Posed, start: Start, phase: int) -> Start | None:
    """The same unknowns with a part of a mode read as that mode; None where it is a part of none."""
    signature, whole = list(start[0].cycle.signature), start[0].cycle.phases[phase].mode.unsplit
    if not whole:
        return None
    signature[phase] = whole, signature[phase][1]
    return relabelled(posed.cycle(tuple(signature)), *start)


def in_parts(posed: Posed, start: Start) -> Start:
    """The same unknowns with every phase of a mode that has parts read as the part that it mostly is, by its condition.

    posed, start: the problem, and a cycle or a point predicted for one.
    Returns the starting point itself where no phase is unsplit.
    """
    t, u, setting = start
    signature = list(t.cycle.signature)
    for k, (mode, event) in enumerate(signature):
        conditions = {part: part.admissible for part in parts_of(posed.form, mode) if part.admissible is not None}
        if conditions:
            x = t.intervals_of(u)[t.phase_intervals(k)].reshape(-1, t.n).T * setting.scale[:, None]
            held = {part.name: float(np.sum(holds(x, setting.p, part.sign))) for part, holds in conditions.items()}
            signature[k] = max(held, key=held.__getitem__), event
    fresh = tuple(signature)
    return start if fresh == t.cycle.signature else relabelled(posed.cycle(fresh), *start)


def with_contact(posed: Posed, start: Start, phase: int, event: str) -> Iterator[Start]:
    """A boundary where a phase turns back right in front of an exit, as if that were met with no speed.

    posed, start: the problem, and a cycle that grazes the event; phase, event: number of the phase; name of the event,
    at which the mode must go on, at once or behind a phase that leads back to it.
    Yields starting points: none where the phase does not turn back there, or goes on elsewhere for longer; several
    where what decides on the successor is zero there too, such as a balance of torques at a stop with no speed.
    """
    t, u, setting = start
    segments = segments_of(*start)
    mode = segments[phase].mode
    if not t.counts[phase]:
        return
    times, states = _looked_at(t, u, setting, phase)
    way_out = posed.exit_of(mode, event)
    h = way_out.direction * np.asarray(way_out.event.function(states, 0.0, setting.p), float)
    top = np.flatnonzero((h[1:-1] > h[:-2]) & (h[1:-1] >= h[2:])) + 1
    if not top.size:
        return
    i = int(top[np.argmax(h[top])])
    a, b, _ = np.polyfit(times[i - 1 : i + 2] - times[i], h[i - 1 : i + 2], 2)
    at = float(times[i] - b / (2 * a))
    first = part_of(posed, start, phase, segments[phase], mode, event, 0.0, at)
    first = first if way_out.reset is None else replace(first, jumped=first.end)
    second = part_of(posed, start, phase, segments[phase], mode, segments[phase].event, at, 1.0)
    beside = around(first.behind, LEFT_AT_ONCE * setting.scale)
    for name in dict.fromkeys(way_out.successor(x, setting.p) for x in beside):
        between = [] if name == mode else _born(posed, start, first.behind, name, (mode,))
        if between is not None:
            yield start_of(posed, [*segments[:phase], first, *between, second, *segments[phase + 1 :]], start)


def with_successor(posed: Posed, start: Start, phase: int, name: str) -> Start | None:
    """A phase put in behind another, whose event leads to its mode, and which is left for what follows at once.

    posed, start, phase, name: the problem, a cycle at which `to` is about to change, number of the phase whose event
    that is, and the mode to which it leads beyond.
    Returns starting point; None where that mode is not left at once for the one that follows.
    """
    segments = segments_of(*start)
    between = _born(posed, start, segments[phase].behind, name, start[0].cycle.phases[phase].follows)
    if between is None:
        return None
    return start_of(posed, [*segments[: phase + 1], *between, *segments[phase + 1 :]], start)


def _born(posed: Posed, start: Start, x: Array, name: str, follows: Container[str]) -> list[Segment] | None:
    """A phase of a mode that all but stands at x: an event of it that leads on is met there; None where none is."""
    t, u, setting = start
    mode, p, scale = posed.form.modes[name], setting.p, setting.scale
    met: list[tuple[float, engine.Exit]] = []
    for way_out in posed.form.exits[name]:
        jumped = behind(way_out, x, p)
        if way_out.successor(x if jumped is None else jumped, p) in follows:
            met.append((abs(float(way_out.event.function(x, 0.0, p))), way_out))
    if not met or min(off for off, _ in met) > LEFT_AT_ONCE:
        return None
    way_out = min(met, key=lambda pair: pair[0])[1]
    duration = BORN_WITH * float(np.sum(t.durations_of(u)))
    rate = scale * field_at(mode.field, x / scale, mode.sign, p, scale)
    times = np.zeros(1) if mode.flow is not None else duration * t.scheme.points
    end = x + duration * rate
    w = (x + times[:, None] * rate).ravel()[None]
    return [Segment(name, way_out.event.name, duration, np.array([0.0, 1.0]), w, end, behind(way_out, end, p))]


def nearest_touch(posed: Posed | None, start: Start) -> tuple[float, str, str]:
    """How near a cycle comes to an exit without meeting it, where it turns back in front of it.

    Returns distance in units of the largest distance from that exit, mode, and event; infinite where it comes near
    none.
    """
    t, u, setting = start
    best = (np.inf, "", "")
    for k in range(t.phases if posed is not None else 0):
        assert posed is not None
        mode = t.cycle.phases[k].mode.name
        if not t.counts[k]:
            continue
        _, states = _looked_at(t, u, setting, k)
        for way_out in posed.form.exits[mode]:
            h = way_out.direction * np.asarray(way_out.event.function(states, 0.0, setting.p), float)
            top = np.flatnonzero((h[1:-1] > h[:-2]) & (h[1:-1] >= h[2:])) + 1
            if top.size:
                # The vertex of the parabola through three neighbours, all but equally spaced.
                rise, fall = h[top] - h[top - 1], h[top] - h[top + 1]
                vertex = h[top] + (rise - fall) ** 2 / (8 * np.maximum(rise + fall, 1e-300))
                best = min(best, (float(np.min(np.abs(vertex))) / float(np.ptp(h)), mode, way_out.event.name))
    return best
