"""What lies ahead of a motion of a loop: it is followed on from its end, event by event, until that is seen (fate.py).

    unit      static friction by the loop's torque per rad of error [rad]: the size in which small and large are told
    doubt     the end is known to an error only: it is followed on from the end, and from as far beyond it as it may lie
              where two such motions come to different ends, nobody knows; nor where it has been on a cycle from the
              start, which it leaves when it is pushed off
    at rest   where x1 moves no more by than `REST` units, or by what it is known to: not even on the way ahead
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from ... import effort
from ...axis_units import quantity, several
from ...errors import InputError
from ...motion import MarchFailure, Segment, march
from ..outcome import SETTLES, Outcome
from .fate import (
    FARTHER_BY,
    GROWN_BY,
    LEFT_OF_A_SWING,
    ROUNDING_OF_A_STATE,
    TOLERANCE_OF_A_FATE,
    WORK_OF_A_FATE,
    Fate,
    Swing,
    fate,
)
from .loop import Loop, torque_gain
from .turns import drifts

Array = np.ndarray

REST = 1e-6
"""Part of a unit by which a servo at rest may move."""
PERIOD = 1 / 16
"""Part of the motion by which its first look ahead is measured."""
WORK_AHEAD, WORK_THAT_MEASURES = 3e6, 2e4
"""Work (effort.py) of following a motion on, 240 turns of two masses that ring; and of its first phases."""
LAST_SWINGS, LAST_TURNS = 8, 120
"""Swings of the motion ahead that are told; of irregular hunting, turns of which its range is told."""
STILL_ALIVE = 1e-3
"""Part of its largest value that is the least size of a state."""
PUSHED_OFF = 1e-3
"""Part of a state by which a motion is pushed off a cycle that it has been on from its start, by no more than that."""
LOPSIDED_BY = 0.01
"""Part of a swing by which it lies to one side of the set point, above which both its ends are told."""
OTHERWISE_BY = 2 * LEFT_OF_A_SWING
"""Relative difference of the amplitudes at which two motions hunt in different cycles: of the second one nothing more
than this is asked."""

PHASES_THAT_MEASURE, ROUGHLY, FOR_GOOD = 12, 1e-3, 1e9
"""Phases, and error of an interval in them, that show sizes and times of a motion; a phase as long [s] has no end."""


class Moved(NamedTuple):
    """A motion up to its end: times (m,) [s], states (n, m), what each is known to (n,), and the mode at the end."""

    times: Array
    states: Array
    errors: Array
    mode: str = ""


def ahead(loop: Loop, moved: Moved) -> Outcome:
    """What becomes of a motion behind its end."""
    names, place = loop.system.states, loop.system.states.index("x1")
    # from a mode that two others are parts of it goes on in one of these
    begun = "" if moved.mode in [each.unsplit for each in loop.system.modes] else moved.mode
    error = float(moved.errors[place])
    if not math.isfinite(error):
        return Outcome("undecided", "two computations of the motion do not agree; ask for a larger tolerance")
    largest = np.abs(moved.states).max(axis=1)
    end = np.where(np.abs(moved.states[:, -1]) > ROUNDING_OF_A_STATE * largest, moved.states[:, -1], 0.0)
    static, limited = errors_of(loop)
    if not largest.any():
        return Outcome("at rest", "it stands at the set point, held by static friction", rests_since=0.0)
    unit = static or float(largest[place]) or 1.0
    known = dict(zip(names, end.tolist(), strict=True))
    first = measured(loop, known, max(unit, limited), WORK_THAT_MEASURES)
    # beside a step of 1e4 rad the hunting that it ends in is as small as its error; at rest nothing has a size
    late = np.abs(moved.states[:, moved.times >= moved.times[-1] / 2]).max(axis=1)
    alive = np.maximum(late, STILL_ALIVE * largest)
    sizes = {name: max(first.sizes[name], float(size)) for name, size in zip(names, alive, strict=True)}
    # a look that is shorter than what the servo does would take the verge of a slip for rest
    before = replace(first, period=max(first.period, PERIOD * float(moved.times[-1])), sizes=sizes)
    found = fate(loop, known, before, work=WORK_AHEAD, mode=begun)
    floor = max(REST * unit, error, TOLERANCE_OF_A_FATE * sizes["x1"])
    moves = np.flatnonzero(np.abs(moved.states[place] - end[place]) > floor)
    way = np.concatenate([end[[place]], *(phase.nodes[:, place] for phase in found.motion.phases)])
    if found.kind in SETTLES and min(np.abs(way - end[place]).max(), np.abs(way).max()) <= floor:
        since = float(moved.times[moves[-1]]) if moves.size else 0.0
        said = f"since {since:.4g} s it has not moved by more than {quantity(floor, 'rad', '.2g')}"
        said += ", and when followed on it stays there"
        return Outcome("at rest", said, behind=found.motion.duration, rests_since=since)
    irregular = found.swing is not None and not found.pattern  # for so long that no start would tell another end
    if error > np.finfo(float).eps * unit and not irregular:
        farther = end + np.sign(end) * moved.errors  # of what stands nothing is in doubt
        beyond = dict(zip(names, farther.tolist(), strict=True))
        other = fate(loop, beyond, before, rest=LEFT_OF_A_SWING, work=WORK_AHEAD, mode=begun)
        if other.kind != "undecided" and not _alike(found, other):
            either = f"as far as the motion is known it {_said(found)}, or {_said(other)}"
            return Outcome("undecided", f"{either}; ask for a smaller tolerance")
    if found.kind == "undecided" and _grew(np.abs(moved.states), place, max(unit, limited)):
        far = f"followed to {quantity(end[place], 'rad', '+.3g')} beside the set point"
        return Outcome("growing", f"it grows without bound, and was {far} at {moved.times[-1]:.4g} s")
    if found.pattern and found.swing is not None and _all_along(np.abs(np.diff(found.turns[:-1])), found.pattern):
        off = {name: (1 + PUSHED_OFF) * x for name, x in found.swing.state.items()}
        pushed = fate(loop, off, before, rest=LEFT_OF_A_SWING, work=WORK_AHEAD)
        if not _alike(found, pushed):
            leaves = f"it follows a cycle that is not stable: pushed off by {PUSHED_OFF:g} of it, it {_said(pushed)}"
            return Outcome("undecided", leaves)
    return _outcome(found)


def _grew(sizes: Array, place: int, unit: float) -> bool:
    """Whether states (n, m) led far from where, and from how, they began, and in the second half much farther than
    before: one that is thrown away comes back."""
    before, late = np.split(sizes[place], [sizes.shape[1] // 2])
    return bool(late.max() > max(GROWN_BY * max(unit, sizes[:, 0].max()), FARTHER_BY * before.max(initial=0.0)))


def _all_along(swings: Array, pattern: int) -> bool:
    """Whether swings (m,) have been those of their last pattern from the first on: it need not draw a motion."""
    last = np.resize(swings[-pattern:], swings.size + pattern - swings.size % pattern)[-swings.size :]
    return bool(np.abs(swings - last).max() <= PUSHED_OFF * swings.max())


def measured(
    loop: Loop, start: Mapping[str, float], amplitude: float, work: float = WORK_OF_A_FATE,
    many: int = PHASES_THAT_MEASURE,
) -> Swing:  # fmt: skip
    """What measures a motion of which nothing is known but its start: its sizes and times in its first phases.

    start: its states at the start, by name, all others zero; amplitude: of hunting that is of interest, at most [rad];
    work: allowed (effort.py); many: phases that are looked at.
    """
    state = loop.state(**start)
    x, phases = np.array(list(state.values())), list[Segment]()

    def enough(segment: Segment) -> bool:
        phases.append(segment)
        return len(phases) == many

    with suppress(MarchFailure, effort.PartGivenUp), effort.at_most(work):
        march(
            loop.system.vector_form, loop.mode_at(**state), x, loop.system.values(None), scale=np.where(x, abs(x), 1.0),
            until=enough, tol=ROUGHLY, strict=True, meshed=False, max_time=FOR_GOOD,
        )  # fmt: skip
    largest = np.max([np.abs(x), *(np.abs(segment.nodes).max(axis=0) for segment in phases)], axis=0)
    lasted = sum(segment.duration for segment in phases if segment.event)
    sizes = dict(zip(loop.system.states, largest.tolist(), strict=False))
    return Swing(dict(start), amplitude, lasted or 1.0, sizes)


def errors_of(loop: Loop) -> tuple[float, float]:
    """Errors at which the proportional action is static friction, and the torque's limit [rad]; 0 where there is none,
    or the controller has no such action."""
    with suppress(InputError):
        kp = abs(torque_gain(loop, "kp")) or math.inf
        static = next((loop.value(name) for name in ("static", "load_static") if name in loop.parameters), 0.0)
        return static / kp, loop.parameters.get("torque_limit", 0.0) / kp
    return 0.0, 0.0


def _alike(found: Fate, other: Fate) -> bool:
    """Whether two motions come to the same end."""
    if found.swing is not None and other.swing is not None:
        return abs(other.swing.amplitude / found.swing.amplitude - 1) <= OTHERWISE_BY
    return found.kind == other.kind or (found.kind in SETTLES and other.kind in SETTLES)


def _said(found: Fate) -> str:
    """What was seen of a motion, as a predicate."""
    lasted, turns = f"followed on for {found.motion.duration:.4g} s", found.turns
    swings = np.abs(np.diff(turns))
    if found.kind == "at rest":
        return f"comes to rest, {lasted}"
    if found.kind == "decaying":
        down = quantity(swings[-1] / 2, "rad", ".3g")
        return f"becomes smaller from swing to swing, geometrically, down to {down}, {lasted}"
    if found.kind == "growing":
        return f"grows without bound, to {quantity(abs(turns[-1]), 'rad', '.3g')}, {lasted}"
    if found.still_grows:
        return f"has grown in {turns.size} turns, to {quantity(swings[-2] / 2, 'rad', '.3g')}, and grows on, {lasted}"
    if found.swing is None:
        creeps = drifts(swings[:-1][-LAST_TURNS:]) if turns.size > LAST_TURNS else 0
        way = ("", ", and grows on", ", and becomes smaller from swing to swing")[creeps]
        return f"neither rests nor repeats in {turns.size} turns{way}, {lasted}"
    if not found.pattern:
        return f"hunts irregularly, {ranges(found)[0]}, {lasted}"
    how = "" if found.pattern <= 2 else f", after a pattern of {found.pattern} swings"
    low, high = (end(turns[-1 - found.pattern : -1]) for end in (np.min, np.max))
    far = f"by {quantity(found.swing.amplitude, 'rad')} to either side"
    if abs(high + low) > LOPSIDED_BY * (high - low):
        far = f"from {quantity(float(low), 'rad')} to {quantity(float(high), 'rad')} beside the set point"
    return f"hunts: its swings repeat{how}, {far}, {lasted}"


def ranges(found: Fate) -> tuple[str, tuple[float, float], tuple[float, float]]:
    """Of irregular hunting, in words and numbers: how far from the set point it turns [rad], how long between [s]."""
    values = np.abs(found.turns[-LAST_TURNS:]), np.diff(found.at[-LAST_TURNS:])
    far, between = ((float(x.min()), float(x.max())) for x in values)
    far_said, between_said = several(far, "rad", by=" to "), f"{between[0]:.3g} to {between[1]:.3g} s"
    return f"turning {far_said} from the set point, every {between_said}", far, between


def _outcome(found: Fate) -> Outcome:
    """What was seen of a motion, as an outcome."""
    swings, lasts = np.abs(np.diff(found.turns[:-1])), np.diff(found.at)
    amplitude = period = math.nan
    if found.swing is not None:
        amplitude, period = found.swing.amplitude, found.swing.period
        if not found.pattern:
            late = slice(-LAST_TURNS, None)
            amplitude, period = float(swings[late].max()) / 2, 2 * float(lasts[late].mean())
    phases = found.motion.phases
    waits = phases[0].duration if len(phases) > 1 and "stick" in phases[0].mode else math.nan
    last = slice(-max(LAST_SWINGS, found.pattern), None)
    return Outcome(
        "decaying" if found.kind == "at rest" else found.kind, f"it {_said(found)}", amplitude, period, found.pattern,
        tuple(swings[last].tolist()), tuple(lasts[last].tolist()), found.motion.duration, waits=waits,
    )  # fmt: skip
