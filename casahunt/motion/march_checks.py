"""Whether a phase that was followed is a motion of its mode: its condition holds, and no event of its own is passed.

Symbols: n states.
"""

from __future__ import annotations

import numpy as np

from ..collocation.admissibility import PASSED
from ..collocation.joints import flow_at
from ..collocation.scheme import scheme
from ..collocation.successors import at_speed
from ..hybrid.system import Exit, VectorMode, VectorSystem
from .march_exits import behind
from .march_watch import NEAR_EVENT
from .rest import is_noise
from .segment import MarchFailure, Segment

Array = np.ndarray

CROWD, CROWDED, EVER_SHORTER = 100, 1e-7, 8
"""So many phases within this part of the time that has passed are no motion that could be followed (`strict`); nor are
so many of them each of which is shorter than the one before."""
ACCUMULATE = (
    "near {:.6g} events follow each other ever faster: {} of them take no time, as of a ball whose bounces end; a mode "
    "in which it lies should begin there"
)
HIDES = (
    ", or a part of the field that changes suddenly was stepped over: a function that shows it, of order one, is named "
    "as the `feature` of the mode"
)
AT_SPEED = 1.5
"""An event that grows by a lower power of time is left at speed, as by the first one; from rest it is the second."""
FIRST_MOMENTS = np.array([1e-4, 1e-3, 1e-2])
"""Parts of a phase in closed form, or of a unit of time, after which it is seen where it goes."""


def check_phase(
    system: VectorSystem, segments: list[Segment], p: Array, scale: Array, time: float, met: str, clean: bool
) -> None:
    """Whether the last phase, begun at `time`, is a motion of its mode; clean: that is known, and no more is asked than
    whether events follow each other ever faster.  Raises MarchFailure where it is none."""
    last, before = segments[-1], segments[-2] if len(segments) > 1 else None
    if not clean:
        _check_holds(system.modes[last.mode], last, p, time)
        why = _starts_on_its_event(system, last, p, time, before, met)
        if why and (before is None or not is_noise(last, last.start, scale)):
            lasted = np.array([segment.duration for segment in segments[:-1]][-EVER_SHORTER:])
            fades = lasted.size == EVER_SHORTER and (np.diff(lasted) < 0).all() and lasted.sum() <= CROWDED * time
            raise MarchFailure(ACCUMULATE.format(time, EVER_SHORTER) if fades else why)
    time += last.duration
    if len(segments) > CROWD and sum(s.duration for s in segments[-CROWD:]) <= CROWDED * time:
        raise MarchFailure(ACCUMULATE.format(time, CROWD))


def _starts_on_its_event(
    system: VectorSystem, segment: Segment, p: Array, time: float, before: Segment | None, met: str
) -> str:
    """What is said of a mode that starts on an event of its own and goes on through it; "" where it does not.

    No zero of the event is crossed then, and the mode would never end.  An event at which the mode goes on is none,
    with a jump if that changes nothing there and the event counts either way; nor is the one that has just been `met`,
    before or at the end of the phase before, and is left behind at speed, as by a pendulum that is pushed on; or one
    whose own jump leads there, as a walker begins its step where its foot stands.
    """
    x = segment.start
    for way_out in system.exits[segment.mode]:
        begins = way_out.direction * float(way_out.event.function(x, 0.0, p))
        if abs(begins) > NEAR_EVENT or segment.duration == 0:
            continue
        times, values = _next_to_the_start(system, segment, way_out, p)
        if not np.all(values > NEAR_EVENT * NEAR_EVENT + 10 * abs(begins)):
            continue
        either_way = sum(other.event == way_out.event for other in system.exits[segment.mode]) > 1
        jumped = behind(way_out, x, p)
        goes_on = jumped is None or either_way and np.array_equal(jumped, x)
        if goes_on and (way_out.mark or way_out.successor(x, p) == segment.mode):
            continue
        if len(times) > 1:
            left = bool(values[0] > (times[0] / times[-1]) ** AT_SPEED * values[-1])
        else:  # a phase of one step
            left = at_speed(system.modes[segment.mode], way_out.event, way_out.direction, x, p)
        met, modes = (met, list(system.exits)) if before is None else (before.event, [before.mode])
        # modes on both sides of an event may give it one name, and cross it in opposite directions
        crossed = {(met, one.direction) for name in modes for one in system.ways_out(name, met)}
        same = (way_out.event.name, way_out.direction) in crossed
        if not (left and (same or leads_on(system, way_out, x, p))):
            return _on_its_event(system, segment, way_out, p, time, before)
    return ""


def _next_to_the_start(system: VectorSystem, segment: Segment, way_out: Exit, p: Array) -> tuple[Array, Array]:
    """Times of a phase, as parts of something, just behind its start, and how far an event has risen there."""
    mode, x, n = system.modes[segment.mode], segment.start, segment.end.size
    if segment.w.shape[1] > n:
        following = segment.w[0].reshape(-1, n)[1:]
        times = scheme(len(following)).stages
    elif mode.flow is None:
        following, times = segment.nodes[1:4], segment.breaks[1:4]  # the first just behind the event
    else:
        times = FIRST_MOMENTS
        following = flow_at(mode, x, min(segment.duration, 1.0) * times, p)
    return times, way_out.direction * np.asarray(way_out.event.function(following.T, 0.0, p))


def leads_on(system: VectorSystem, way_out: Exit, x: Array, p: Array) -> bool:
    """Whether the jump of an event leads from x to where one is left behind at speed: x may be such a state too."""
    jumped = behind(way_out, x, p)
    if jumped is None:
        return False
    name = way_out.successor(jumped, p)
    return any(
        abs(float(other.event.function(jumped, 0.0, p))) <= NEAR_EVENT
        and at_speed(system.modes[name], other.event, other.direction, jumped, p)
        for other in system.exits[name]
    )


def _on_its_event(
    system: VectorSystem, segment: Segment, way_out: Exit, p: Array, time: float, before: Segment | None
) -> str:
    """What is said of a mode that starts on its own event and moves on through it."""
    name = way_out.event.name
    if before is not None and before.event != name:
        for other in system.ways_out(before.mode, name):
            if abs(float(other.event.function(before.end, 0.0, p))) <= NEAR_EVENT:
                return (
                    f"at {time:.6g} the mode {before.mode!r} meets two events at once, {before.event!r} and {name!r}, "
                    "and which is the first is rounding: state them as one event, casadi.fmin (falling) or fmax "
                    "(rising) of their functions, whose reset and `to` look at which of them are within 1e-9 of zero; "
                    "or start where they do not meet"
                )
    return (
        f"at {time:.6g} the mode {segment.mode!r} starts on its own event {name!r} and moves on through it: another "
        "mode should begin there, one that slides along it where the modes on both sides lead to it; `holds` says "
        "where a mode is a motion"
    )


def _check_holds(mode: VectorMode, segment: Segment, p: Array, time: float) -> None:
    """The condition of a mode at the nodes of a segment of it.  Raises MarchFailure where it does not hold."""
    if mode.admissible is None:
        return
    lasts, first = np.isfinite(segment.duration), np.append(0.0, FIRST_MOMENTS)
    nodes = segment.nodes if lasts else np.array(flow_at(mode, segment.start, first, p))  # for ever: in closed form
    values = np.asarray(mode.admissible(nodes.T, p, mode.sign))
    wrong = np.flatnonzero(values < -mode.slack - PASSED)
    if 0 in wrong:
        where = f"at {time:.6g} the mode {mode.name!r} does not hold where it begins ({values[0]:.3g})"
        raise MarchFailure(f"{where}: start in the mode that does, or let the event before lead there")
    if wrong.size:
        at = time + (segment.duration * segment.breaks if lasts else first)[wrong[0]]
        raise MarchFailure(
            f"at {at:.6g} the mode {mode.name!r} does not hold any more ({values[wrong[0]]:.3g}), and none of its "
            "exits was met: an exit is missing, the modes on both sides of an event lead to it (then one that slides "
            "along it is missing), or events follow each other ever faster until they cannot be told apart"
            f"{'' if mode.feature else HIDES}"
        )
