"""What a remedy costs: a step from rest, or a move by a profile, simulated: x1 = -distance, all other states zero;
where friction or load differ by direction, the worse of both ways.

    peak        the largest |torque| of the motor on it [N m], and the voltage [V]
    settling    the time from which on |x1| stays within the error at rest, and a part of that more, or within as large
                a part of the step and half of the amplitude of the hunting that is to end [s], from the move's start
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...motion import MarchFailure, Motion, follow_for
from ...servo.move import Move, begins_in, moving
from ...servo.outcome import BY_SEVERITY, Kind
from ...servo.parts.fate import ROUNDING_OF_A_STATE, TO_BE_SAMPLED, Points, Swing, fate
from ...servo.parts.loop import Loop

Array = np.ndarray

SETTLED_WITHIN = 0.02
"""Part of the step within which it has settled; and of the error at rest, to which the last of the way may creep."""
TASK_POINTS = 4
"""Of an interval, at which torque and error are looked at."""
HALF_OF_IT = 0.5
"""Part of the hunting before within which a servo that hunts no more is."""


def settled_within(hunting: float, step: float) -> float:
    """The error within which a step has settled, if it may rest with none [rad]; hunting: the amplitude before."""
    return min(SETTLED_WITHIN * step, HALF_OF_IT * hunting)


@dataclass(frozen=True)
class Task:
    """The move: its peak torque [N m], nan where it was not followed or grows; settling time [s], nan where it has not
    settled; what became of it."""

    peak_torque: float
    settling: float
    kind: Kind


def task(loop: Loop, before: Swing, rest_error: float, step: float, move: Move | None = None) -> Task:
    """A step from rest, or a move as far; the worse of both ways, where they differ.

    before: the hunting that is to end: a servo that still hunts, or has that error, has not settled; rest_error: the
    largest at rest [rad]; nan where that is not known: then this step's.
    """
    each = [_one_way(loop, before, rest_error, way * step, move) for way in loop.ways]
    peaks, settling = ([getattr(one, name) for one in each] for name in ("peak_torque", "settling"))
    kind = max((one.kind for one in each), key=BY_SEVERITY.index)
    return Task(float(np.max(peaks)), float(np.max(settling)), kind)  # nan of one is that of both


def _one_way(loop: Loop, before: Swing, rest_error: float, step: float, move: Move | None) -> Task:
    """The task of a step of either sign."""
    start, mode, pieces = loop.at_rest(-step), "", list[tuple[Loop, Motion]]()
    if move is not None:
        try:
            pieces.append(_moved(loop, move, before, step))
        except MarchFailure:
            return Task(math.nan, math.nan, "undecided")
        moved, motion = pieces[0]
        end = motion.phases[-1].behind
        end = np.where(np.abs(end) > ROUNDING_OF_A_STATE * motion.scale, end, 0.0)  # a rounding of zero would slip
        start = {name: x for name, x in zip(moved.system.states, end.tolist(), strict=True) if name in start}
        mode = loop.mode_at(**start)
    ended = fate(loop, start, before, meshed=True, mode=mode)
    if ended.kind in ("undecided", "growing"):
        return Task(math.nan, math.nan, ended.kind)
    pieces.append((loop, ended.motion))
    began, times, x, peak = 0.0, list[Array](), list[Array](), 0.0
    for one, motion in pieces:
        t, states = motion.sample(TASK_POINTS)
        times.append(began + t)
        x.append(states[one.system.states.index("x1")])
        peak, began = max(peak, float(np.abs(one.along("torque", motion, t)).max())), began + float(t[-1])
    error, within = np.abs(np.concatenate(x)), settled_within(before.amplitude, abs(step))
    if math.isnan(rest_error) and ended.kind == "at rest":
        rest_error = float(error[-1])
    within = float(np.fmax((1 + SETTLED_WITHIN) * rest_error, within))
    outside = np.flatnonzero(error > within)
    last = int(outside[-1]) if outside.size else 0
    arrives = within < abs(step) and last < error.size - 1 and ended.kind != "hunting"  # it might not have moved at all
    settled = float(np.concatenate(times)[last]) if arrives else math.nan
    return Task(peak, settled, ended.kind)


def _moved(loop: Loop, move: Move, before: Swing, step: float) -> tuple[Loop, Motion]:
    """The loop with a move, and its motion until that is over.  Raises MarchFailure."""
    at_rest, loop = loop.at_rest(-step), moving(loop, move, step)
    start, system = loop.settled(at_rest), loop.system  # what carries a load knows no move, filters see the error zero
    scale = np.array([before.sizes.get(name) or abs(x) or 1.0 for name, x in start.items()])
    kind: Points = "radau" if any(mode.stiff for mode in system.modes) else "gauss"
    p, x = system.values(None), np.array(list(start.values()))
    begins, time = begins_in(loop, move, start), move.time(step)
    phases = follow_for(system.vector_form, begins, x, p, scale, kind, time, TO_BE_SAMPLED)
    return loop, Motion(system, p, tuple(phases), math.nan, scale, kind)
