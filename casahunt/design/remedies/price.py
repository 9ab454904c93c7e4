"""What a remedy costs, and whether hunting has ended with it: motions of the loop, simulated.

    task        a step of 1 rad from rest: x1 = -1, all other states zero
    peak        the largest |torque| of the motor on it [N m], and the voltage [V]
    settling    the time from which on |x1| stays within the error at rest, or within `SETTLED_WITHIN` of the step [s]
    verdict     of motions from several starts: they come to rest, decay below the cycle that was, hunt, or grow
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from ...errors import NoOrbit
from ...motion import simulate
from ...motion.simulation import Motion, sampled
from ...servo.parts.loop import Loop

Array = np.ndarray
Verdict = Literal["rests", "decays", "hunts", "grows", "undecided"]

TASK_STEP, SETTLED_WITHIN = 1.0, 0.02
"""The step [rad], and the part of it within which it has settled."""
FOLLOWED_PERIODS = 20.0
"""Periods of the hunting cycle for which motions are followed."""
LEFT_BEHIND_AT = 0.5
"""A motion whose swings are smaller than this part of those of the cycle at the border has left it."""
RESTS_WITHIN = 1e-7
"""A motion that moves by less than this part of the amplitude in the last third of its time is at rest."""
STARTS_BESIDE = (1.0, 3.0)
"""Starts beside the set point, in amplitudes of the cycle."""
MOTION_TOLERANCE = 1e-6
"""Error of an interval: verdicts and peaks need no more."""


@dataclass(frozen=True)
class Task:
    """The step: its peak torque [N m], settling time [s] (nan where it has not settled), and what became of it."""

    peak_torque: float
    settling: float
    verdict: Verdict


def motion_of(loop: Loop, start: dict[str, float], duration: float) -> Motion:
    """A motion of the loop.  Raises NoOrbit: it cannot be followed."""
    state = loop.state(**start)
    return simulate(loop.system, loop.mode_at(**state), start=state, duration=duration, tol=MOTION_TOLERANCE)


def verdict_of(times: Array, position: Array, amplitude: float) -> Verdict:
    """What becomes of a motion, by the last third of its time.

    times, position: (m,) [s], [rad]; amplitude: of the cycle at the border [rad].
    """
    late = times >= times[-1] * 2 / 3
    swing, size = float(np.ptp(position[late])), float(np.abs(position[late]).max())
    if swing <= RESTS_WITHIN * amplitude:
        return "rests"
    if size < LEFT_BEHIND_AT * amplitude:
        return "decays"
    early = float(np.abs(position[times <= times[-1] / 3]).max())
    return "grows" if size > 2 * max(early, amplitude) else "hunts"


def verdicts(
    loop: Loop, amplitude: float, period: float, starts: Sequence[float] = STARTS_BESIDE
) -> tuple[Verdict, ...]:
    """What becomes of motions from rest beside the set point."""
    found: list[Verdict] = []
    for start in starts:
        try:
            motion = motion_of(loop, {"x1": -start * amplitude}, FOLLOWED_PERIODS * period)
        except NoOrbit:
            found.append("undecided")
            continue
        times, states = motion.sample(4)
        found.append(verdict_of(times, states[0], amplitude))
    return tuple(found)


def task(loop: Loop, amplitude: float, period: float, rest_error: float) -> Task:
    """The step of 1 rad from rest."""
    try:
        motion = motion_of(loop, {"x1": -TASK_STEP}, FOLLOWED_PERIODS * period)
    except NoOrbit:
        return Task(float("nan"), float("nan"), "undecided")
    form, peak, times, position = motion.system.vector_form, 0.0, [], []
    start = 0.0
    for phase in motion.phases:
        t, x = sampled(form, (phase,), motion.p, motion.kind, 8)
        peak = max(peak, float(np.abs(loop.signal("torque", phase.mode, x)).max()))
        times.append(start + t)
        position.append(x[0])
        start += phase.duration
    t, x1 = np.concatenate(times), np.concatenate(position)
    outside = np.flatnonzero(np.abs(x1) > max(rest_error, SETTLED_WITHIN * TASK_STEP))
    settled = 0.0 if not outside.size else float(t[outside[-1]]) if outside[-1] < len(t) - 1 else np.nan
    return Task(peak, settled, verdict_of(t, x1, amplitude))
