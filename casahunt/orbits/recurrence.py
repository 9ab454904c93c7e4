"""When a motion repeats: its last m phases are those before them, as they are or mirrored by a symmetry S.

    x(t) = S x(t + T_m) - c      T_m the time of the last m phases, c whole turns of angles and of the time

A symmetry is accepted where it maps the one half of the motion to the other in every respect: fields, conditions,
events and jumps, at the states of the motion and at others near them.  Without that a mirrored closure would be another
problem, with solutions that are no motions at all.

Symbols: n states.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ..collocation.interval import field_at, point_map
from ..hybrid import system as engine
from ..hybrid.language import System
from ..motion.closed_forms import TRIED_AROUND
from ..motion.march_exits import behind
from ..motion.phases import Segment
from .closure import Closure, Plane, turned, turns

Array = np.ndarray

EQUAL = 1e-12
"""Fields and events that agree to this, relative to their sizes, are the same."""
TRIED = 16
"""Intervals of a phase, or states of a forced motion, at which a symmetry is tried."""
EXACTLY = 1e-8
"""A motion that comes back so near shows no more by going on, in units of the state scale."""
DOUBLINGS = 12
"""Of the number of returns that the norm of `comes_in` sums up."""


@dataclass(frozen=True)
class Recurrence:
    """The last `phases` phases of a motion close, all but for `distance` in units of the state scale."""

    phases: int
    closure: Closure
    distance: float


def recurrences(
    system: System,
    form: engine.VectorSystem,
    segments: Sequence[Segment],
    p: Array,
    scale: Array,
    near: float,
    accepted: Callable[[Recurrence], bool] = lambda r: True,
) -> list[Recurrence]:
    """The ways in which the end of a motion is near an earlier state of it, as far as it has gone away since.

    system, form: the system, and what was marched: with its sections; segments: the motion, phase after phase; all but
    the first start at events; p, scale: parameter vector; (n,) sizes of the states; near: distance of the states, as
    part of how far the motion has gone away between them, and at most that, in units of the scale.
    Returns recurrences, the one with fewest phases first; at most one in which nothing is mirrored.
    """
    states = np.array([segment.behind for segment in segments])
    here, there = states[-1], states[-2::-1]
    found = []
    for k, S in enumerate((np.eye(scale.size), *symmetries(system))):
        plain = k == 0
        image = S @ here
        shifts = turned(system, there, image, parts=1 if plain else 2)
        distances = np.max(np.abs(image - shifts - there) / scale, axis=1)
        for i in np.flatnonzero(distances < near):
            m, distance = int(i) + 1, float(distances[i])
            if plain and not _same(segments[-1], segments[-1 - m]):
                continue
            r = Recurrence(m, Closure.of(S, shifts[i], 1 if plain else 2), distance)
            gone = distance < EXACTLY or distance < near * _excursion(segments[-m:], scale)
            if gone and accepted(r) and (plain or _mirrored(form, segments, r, p, scale)):
                found.append(r)
                break
    return sorted(found, key=lambda r: r.phases)


def _same(one: Segment, other: Segment) -> bool:
    """Whether two phases have the same names."""
    return (one.mode, one.event) == (other.mode, other.event)


def _excursion(segments: Sequence[Segment], scale: Array) -> float:
    """How far some phases go away from their end, in units of the scale."""
    nodes = np.vstack([segment.w[:, : scale.size] for segment in segments])
    return float(np.max(np.abs(nodes - segments[-1].behind) / scale))


def _mirrored(form: engine.VectorSystem, segments: Sequence[Segment], r: Recurrence, p: Array, scale: Array) -> bool:
    """Whether a symmetry maps the last phases of a motion, and the event before them, to what comes after each.

    What comes later is known of the first of them alone, where the motion has not gone on for long enough.
    """
    m, S, shift = r.phases, np.array(r.closure.matrix), np.array(r.closure.shift)
    if len(segments) >= 2 * m:
        return is_symmetry(form, segments[-2 * m :], S, shift, p, scale)
    alike: dict[tuple[str, str], list[Segment]] = {}
    for segment in segments[-m:]:
        alike.setdefault((segment.mode, segment.event), []).append(segment)
    return is_symmetry(form, [segments[-1 - m], segments[-1]], S, shift, p, scale) and all(
        image_of(form, replace(some[0], w=np.vstack([s.w for s in some])), r.closure, p, scale) is not None
        for some in alike.values()
    )


def comes_in(M: Array, before: Array, now: Array) -> bool:
    """Whether one return of a motion shows that it goes to a fixed point of the return map.

        |now - M before| <= (|before| - |M before|) / 2,    |e|^2 = sum over k of |M^k e|^2, so that M contracts

    What the return map does beyond its linearisation there is then less than half of what that contracts, and shrinks
    faster than the distance.

    M: (n, n) linearisation of the return map, with all eigenvalues inside the unit circle; before, now: (n,) distances
    from the fixed point, one return apart.
    """
    weight, power = np.eye(len(M)), M
    for _ in range(DOUBLINGS):
        weight, power = weight + power.T @ weight @ power, power @ power

    def norm(e: Array) -> float:
        return float(np.sqrt(e @ weight @ e))

    return norm(now - M @ before) <= (norm(before) - norm(M @ before)) / 2


def loop_distance(system: System, segments: Sequence[Segment], r: Recurrence, scale: Array) -> float:
    """How far the last loop of a motion is from the loop before, at the ends of its phases.

    scale: (n,) sizes of the states.
    Returns the largest distance, in units of the scale; infinite where there is no loop before.
    """
    if len(segments) < 2 * r.phases:
        return np.inf
    S = np.array(r.closure.matrix)
    far = 0.0
    for later, before in zip(segments[-r.phases :], segments[-2 * r.phases : -r.phases], strict=True):
        image = S @ later.behind
        shift = turned(system, before.behind, image, parts=2)
        far = max(far, float(np.max(np.abs(image - shift - before.behind) / scale)))
    return far


def symmetries(system: System) -> list[Array]:
    """(n, n) candidates S, those of the user and x -> -x; the time goes on."""
    n, whole = len(system.states), len(system.names.entries)
    out = []
    for S in (*system.symmetries, -np.eye(n)):
        extended = np.eye(whole)
        extended[:n, :n] = S
        out.append(extended)
    return out


def is_symmetry(
    form: engine.VectorSystem, segments: Sequence[Segment], S: Array, shift: Array, p: Array, scale: Array
) -> bool:
    """Whether x -> S^-1 (x + shift) maps the first half of `segments`, with all that belongs to it, to the second.

    Fields, conditions, events, also those that are not met, and jumps are compared at states of the motion and at
    others around them, all with the parameters p: the motion may be one with others.

    S, shift: (n, n) and (n,); p, scale: parameter vector; (n,) sizes of the states.
    Returns True where everything agrees.
    """
    m = len(segments) // 2
    inverse = np.linalg.inv(S)
    rng = np.random.default_rng(0)

    def image(x: Array) -> Array:
        return (x + shift) @ inverse.T

    pairs: dict[tuple[str, ...], list[tuple[Segment, Segment]]] = {}
    for a, b in zip(segments[:m], segments[m:], strict=True):
        if (a.jumped is None) != (b.jumped is None):
            return False
        pairs.setdefault((a.mode, a.event, b.mode, b.event), []).append((a, b))
    for alike in pairs.values():
        a, b = alike[0]
        on = np.vstack([one.w[:: max(1, len(one.w) // TRIED), : scale.size] for one, _ in alike])
        x = np.vstack([on, on + TRIED_AROUND * scale * rng.standard_normal(on.shape)])
        y = image(x)
        # The condition and the ways out of the modes of a and b are the same at x and at its image y; not the
        # sections. A stop on one side of a motion that keeps clear of it is no part of the motion, but of its
        # symmetry
        if not (_same_events(form, a, b, x, y, p) and _agree(_limits(form, a.mode, x, p), _limits(form, b.mode, y, p))):
            return False
        first, second = form.modes[a.mode], form.modes[b.mode]
        f = image(scale * _fields(first, x, p, scale) - shift) / scale
        if not np.max(np.abs(f - _fields(second, y, p, scale)) / np.abs(f).max(axis=1, initial=1.0)[:, None]) <= EQUAL:
            return False
        for a, b in alike:
            if a.jumped is not None:
                off = image(_jumped(form, a, a.end, p)) - _jumped(form, b, image(a.end), p)
                if np.max(np.abs(off) / scale) > EQUAL:
                    return False
    return True


def _fields(mode: engine.VectorMode, x: Array, p: Array, scale: Array) -> Array:
    """(m, n) the scaled field of a mode at points x (m, n)."""
    return point_map(mode.field, scale.size, p.size)(x / scale, np.full(len(x), mode.sign), p, scale)


def image_of(
    form: engine.VectorSystem, segment: Segment, closure: Closure, p: Array, scale: Array
) -> tuple[str, str] | None:
    """What a phase is called one computed piece later, where it is mapped by x -> S^-1 (x + c).

    p, scale: parameter vector; (n,) sizes of the states.
    Returns names of mode and event; None where no mode of the system is its image.
    """
    S, shift = np.array(closure.matrix), np.array(closure.shift)
    for mode in sorted(form.exits, key=lambda name: name != segment.mode):
        for way_out in form.exits[mode]:
            candidate = replace(segment, mode=mode, event=way_out.event.name)
            if is_symmetry(form, [segment, candidate], S, shift, p, scale):
                return mode, way_out.event.name
    return None


def turns_over(system: System, mode: str, states: Array, p: Array, scale: Array) -> bool:
    """Whether a symmetry maps the field of a mode of a forced system to what it is half a turn later.

    system, mode: the system and the name of the mode; states: (n, m) states at which it is tried, and beside them; p,
    scale: (np,) parameters; (n,) sizes of the states.
    """
    here = system.vector_form.modes[mode]
    rng = np.random.default_rng(0)
    points = states.T + TRIED_AROUND * scale * rng.standard_normal(states.T.shape)
    later = np.zeros(scale.size)
    later[-1] = 0.5

    def agrees(S: Array) -> bool:
        for x in points:
            f = S @ (scale * field_at(here.field, x / scale, here.sign, p, scale)) / scale
            g = field_at(here.field, (S @ x + later) / scale, here.sign, p, scale)
            if not np.max(np.abs(f - g)) <= EQUAL * max(1.0, float(np.max(np.abs(f)))):
                return False
        return True

    return any(agrees(S) for S in symmetries(system))


def _same_events(form: engine.VectorSystem, a: Segment, b: Segment, x: Array, y: Array, p: Array) -> bool:
    """The events that end a and b are one at points x and at their images y, up to the sign and its direction."""
    ones, others = form.ways_out(a.mode, a.event), form.ways_out(b.mode, b.event)
    if len(ones) != len(others):
        return False
    h, k = (e[0].direction * np.asarray(e[0].event.function(at.T, 0.0, p), float) for e, at in ((ones, x), (others, y)))
    off = np.abs(h - k)
    if len(ones) > 1:
        off = np.minimum(off, np.abs(h + k))  # crossed either way, it has no direction
    return bool(np.all(off <= EQUAL * np.maximum(1.0, np.abs(h))))


def _limits(form: engine.VectorSystem, name: str, x: Array, p: Array) -> Array:
    """What bounds a mode at points x: its condition, and the scalars of its events along their directions, by size."""
    mode = form.modes[name]
    events = [e for e in form.exits[name] if not isinstance(e.event.function, Plane)]
    scalars = [e.direction * np.asarray(e.event.function(x.T, 0.0, p), float) for e in events]
    condition = [] if mode.admissible is None else [np.asarray(mode.admissible(x.T, p, mode.sign), float)]
    by_size = np.sort(np.array(scalars).reshape(len(events), len(x)), axis=0)
    return np.vstack([*condition, by_size]).T


def _agree(one: Array, other: Array) -> bool:
    return one.shape == other.shape and bool(np.all(np.abs(one - other) <= EQUAL * np.maximum(1.0, np.abs(one))))


def _jumped(form: engine.VectorSystem, segment: Segment, x: Array, p: Array) -> Array:
    found = behind(form.ways_out(segment.mode, segment.event)[0], x, p)
    assert found is not None
    return found


def rebased(system: System, segments: Sequence[Segment]) -> list[Segment]:
    """Segments with the whole turns taken off that angles and the time have at the start.

    Returns the same phases, their first state within the first turn.
    """
    turn = turns(system)
    start = segments[0].start
    off = np.where(turn > 0, turn * np.floor(start / np.where(turn > 0, turn, 1.0)), 0.0)
    if not off.any():
        return list(segments)
    return [
        Segment(
            s.mode, s.event, s.duration, s.breaks, s.w - np.tile(off, s.w.shape[1] // off.size), s.end - off,
            None if s.jumped is None else s.jumped - off,
        )
        for s in segments
    ]  # fmt: skip
