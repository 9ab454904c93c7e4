"""What a remedy costs, and whether hunting has ended with it: motions of the loop, simulated.

    task        a step of 1 rad from rest: x1 = -1, all other states zero
    peak        the largest |torque| of the motor on it [N m], and the voltage [V]
    settling    the time from which on |x1| stays within the error at rest, or within `SETTLED_WITHIN` of the step and
                half of the amplitude of the hunting that is to end [s]
    verdict     of motions from several starts: they come to rest, decay below the cycle that was, hunt, or grow
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Literal, cast

import numpy as np

from ... import effort
from ...errors import NoOrbit
from ...servo.parts.loop import Loop
from ...servo.parts.verbs import LoopMotion, loop_motion

Array = np.ndarray
Verdict = Literal["rests", "decays", "hunts", "grows", "undecided"]

TASK_STEP, SETTLED_WITHIN = 1.0, 0.02
"""The step [rad], and the part of it within which it has settled."""
LOOKED_PERIODS, MOST_WINDOWS = 2.0, 15
"""Periods of the hunting cycle between two looks at a motion, and looks after which it is taken to hunt on."""
LEFT_BEHIND_AT = 0.5
"""A motion whose swings are smaller than this part of those of the cycle at the border has left it, and decays."""
RESTS_WITHIN = 1e-7
"""A motion that moves by less than this part of the amplitude from one look to the next is at rest."""
BY_SEVERITY: tuple[Verdict, ...] = ("rests", "decays", "undecided", "hunts", "grows")
ENDED: tuple[Verdict, ...] = ("rests", "decays")
"""Verdicts of motions that hunt no more."""
STOOD_PERIODS = 0.5
"""And one of which no state moves for so many periods: where a hunting one is stuck, the integrator winds."""
ROUNDING_OF_A_STATE = 1e-12
"""A state that is so small a part of its largest value is zero."""
SHORTEST_LOOK = 1e-3
"""The shortest look, as a part of the time between two: of a motion that cannot be followed for the whole of it."""
MOST_WORK_OF_A_LOOK = 1e5
"""Work (effort.py) of a look, some four times what one with a bristle takes that hunts."""
OUTGROWN_BY = 2.0
"""A motion that is so many times as large as at its start and as the cycle grows."""
STARTS_BESIDE = (1.0, 3.0)
"""Starts beside the set point, in amplitudes of the cycle."""
MOTION_TOLERANCE = 1e-8
"""Error of an interval, relative to the sizes of the states at first: verdicts and peaks need no more."""


@dataclass(frozen=True)
class Fate:
    """What became of a motion: times and positions (m,) [s], [rad], the largest torque of the motor [N m], its end."""

    verdict: Verdict
    times: Array
    position: Array
    peak_torque: float
    end: dict[str, float]


def fate(
    loop: Loop, start: dict[str, float], amplitude: float, period: float, within: float = math.inf,
    outgrown: float = OUTGROWN_BY,
) -> Fate:  # fmt: skip
    """A motion, followed from look to look until it rests, or is left behind by the cycle and smaller than `within`.

    amplitude, period: of the cycle at the border; outgrown: one that is so many times as large grows.
    """
    state, sizes = loop.state(**start), None
    mode, place = loop.mode_at(**state), loop.system.states.index("x1")
    window, began, peak, verdict = LOOKED_PERIODS * period, 0.0, 0.0, "hunts"
    times, positions = [np.zeros(1)], [np.array([state["x1"]])]
    largest, length = outgrown * max(abs(state["x1"]), amplitude), window
    for _ in range(MOST_WINDOWS):
        try:  # states are measured as at first: of one that has come to rest nothing but rounding is left
            seen, length = _look(loop, length, window, {"start": state, "mode": mode, "sizes": sizes})
        except (NoOrbit, effort.PartGivenUp):
            verdict = "undecided"
            break
        motion, position = seen.motion, seen.states[place]
        peak = max(peak, float(np.abs(seen.torque).max()))
        times.append(began + seen.times)
        positions.append(position)
        began, mode, state, sizes = began + length, motion.phases[-1].mode, motion.end, sizes or motion.sizes
        verdict = "hunts" if length == window else "undecided"
        if length == window and (told := _told(position, amplitude, largest, within)) is not None:
            verdict = told
            break
        if _over(seen, state, sizes, amplitude, period):
            verdict = "rests"
            break
    small = {name: ROUNDING_OF_A_STATE * size for name, size in (sizes or {}).items()}  # of zero, would slip
    end = {name: value if abs(value) > small.get(name, 0.0) else 0.0 for name, value in state.items()}
    return Fate(cast(Verdict, verdict), np.concatenate(times), np.concatenate(positions), peak, end)


def _over(
    seen: LoopMotion, state: dict[str, float], sizes: dict[str, float], amplitude: float, period: float
) -> bool:
    """Whether a motion has come to the set point, or no state of it has moved of late.

    What it does next is rounding, in which events crowd: it takes for ever to follow.
    """
    before = int(np.searchsorted(seen.times, seen.times[-1] - STOOD_PERIODS * period, "right")) - 1
    of_late = seen.states[:, max(before, 0) :]
    stands = np.all(np.ptp(of_late, axis=1) <= RESTS_WITHIN * np.array([sizes[name] for name in state]))
    there = abs(state["x1"]) <= RESTS_WITHIN * amplitude and abs(state["x2"]) <= RESTS_WITHIN * sizes["x2"]
    return bool(stands or there)


def _look(loop: Loop, length: float, window: float, how: dict[str, Any]) -> tuple[LoopMotion, float]:
    """A motion and how long it was followed: where it cannot be for so long, half as long, or half of that.

    A slip that creeps to the set point ends in rounding, in which events can no more be told from one another.
    Raises NoOrbit, effort.PartGivenUp: not even for the shortest time.
    """
    while True:
        try:
            with effort.at_most(MOST_WORK_OF_A_LOOK):
                return loop_motion(loop, length, **how, tol=MOTION_TOLERANCE), length
        except (NoOrbit, effort.PartGivenUp):
            length /= 2
            if length < SHORTEST_LOOK * window:
                raise


def _told(position: Array, amplitude: float, largest: float, within: float) -> Verdict | None:
    """What a look at the position (m,) tells; None where the motion is followed on."""
    size = float(np.abs(position).max())
    if np.ptp(position) <= RESTS_WITHIN * amplitude:
        return "rests"
    if size < LEFT_BEHIND_AT * amplitude and size <= within:
        return "decays"
    return "grows" if size > largest else None


def verdict(loop: Loop, amplitude: float, period: float, starts: Sequence[float] = STARTS_BESIDE) -> Verdict:
    """The worst that becomes of motions from rest beside the set point."""
    return max((fate(loop, loop.at_rest(-start * amplitude), amplitude, period).verdict for start in starts),
               key=BY_SEVERITY.index)  # fmt: skip


def settled_within(hunting: float) -> float:
    """The error within which the step has settled, if it may rest with none [rad]; hunting: the amplitude before."""
    return min(SETTLED_WITHIN * TASK_STEP, LEFT_BEHIND_AT * hunting)


@dataclass(frozen=True)
class Task:
    """The step: its peak torque [N m], nan where it was not followed or grows; settling time [s], nan where it has not
    settled; what became of it."""

    peak_torque: float
    settling: float
    verdict: Verdict


def task(loop: Loop, amplitude: float, period: float, rest_error: float, hunting: float) -> Task:
    """The step of 1 rad from rest; rest_error: the largest at rest; nan where that is not known: then this step's.

    hunting: the amplitude of what is to end [rad]: a servo that still hunts, or has that error, has not settled.
    """
    within = float(np.fmax(rest_error, settled_within(hunting)))
    ended = fate(loop, loop.at_rest(-TASK_STEP), amplitude, period, within)
    if ended.verdict in ("undecided", "grows"):
        return Task(math.nan, math.nan, ended.verdict)
    if math.isnan(rest_error) and ended.verdict == "rests":
        within = max(within, abs(float(ended.position[-1])))
    outside = np.flatnonzero(np.abs(ended.position) > within)
    last = int(outside[-1]) if outside.size else 0
    settled = float(ended.times[last]) if last < ended.times.size - 1 else math.nan
    return Task(ended.peak_torque, settled, ended.verdict)
