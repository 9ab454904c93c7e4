"""What a remedy costs: a step of 1 rad from rest, x1 = -1, all other states zero, simulated.

    peak        the largest |torque| of the motor on it [N m], and the voltage [V]
    settling    the time from which on |x1| stays within the error at rest, or within `SETTLED_WITHIN` of the step and
                half of the amplitude of the hunting that is to end [s]
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from ...servo.outcome import Kind
from ...servo.parts.fate import Swing, fate
from ...servo.parts.loop import Loop

TASK_STEP, SETTLED_WITHIN = 1.0, 0.02
"""The step [rad], and the part of it within which it has settled."""
TASK_POINTS = 4
"""Of an interval, at which torque and error are looked at."""
HALF_OF_IT = 0.5
"""Part of the hunting before within which a servo that hunts no more is."""


def settled_within(hunting: float) -> float:
    """The error within which the step has settled, if it may rest with none [rad]; hunting: the amplitude before."""
    return min(SETTLED_WITHIN * TASK_STEP, HALF_OF_IT * hunting)


@dataclass(frozen=True)
class Task:
    """The step: its peak torque [N m], nan where it was not followed or grows; settling time [s], nan where it has not
    settled; what became of it."""

    peak_torque: float
    settling: float
    kind: Kind


def task(loop: Loop, before: Swing, rest_error: float) -> Task:
    """The step of 1 rad from rest.

    before: the hunting that is to end: a servo that still hunts, or has that error, has not settled; rest_error: the
    largest at rest [rad]; nan where that is not known: then this step's.
    """
    ended = fate(loop, loop.at_rest(-TASK_STEP), before, meshed=True)
    if ended.kind in ("undecided", "growing"):
        return Task(math.nan, math.nan, ended.kind)
    times, states = ended.motion.sample(TASK_POINTS)
    x, within = states[loop.system.states.index("x1")], settled_within(before.amplitude)
    within = float(np.fmax(rest_error, within))
    if math.isnan(rest_error) and ended.kind == "at rest":
        within = max(within, abs(float(x[-1])))
    outside = np.flatnonzero(np.abs(x) > within)
    last = int(outside[-1]) if outside.size else 0
    settled = float(times[last]) if last < times.size - 1 and ended.kind != "hunting" else math.nan
    return Task(float(np.abs(loop.along("torque", ended.motion, times)).max()), settled, ended.kind)
