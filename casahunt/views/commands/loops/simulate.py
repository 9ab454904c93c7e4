"""casahunt simulate of a loop of parts.

    start   angles: position - set point; velocity x2, integral x3, bristle x4; any other by its name; else zero

Keys of the JSON object: parts, parameters, gain, set_point, time (reached), tol; start, end: states by name; verdict
("hunting", "at rest", "decaying", "growing", "undecided"): what the motion goes on to behind its end, with reason, and
amplitude, period and pattern (swings after which it repeats, 0: irregularly) of the hunting (null where it does not);
peak_torque [N m], peak_voltage [V] (null without a motor gain); events, a list of [time, name, mode before]; error, of
states and times of events, relative to the sizes of the states and to the duration; status, wall_s.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from ....checks import error_text
from ....errors import NotFollowed, Status
from ....servo.outcome import Outcome
from ....servo.parts.ahead import Moved, ahead
from ....servo.parts.verbs import loop_motion
from ....servo.servo import assigned
from ...answers.loops import loop_motion_answer
from ...answers.simulate import head_of
from ..console import complain
from ..output import give
from .shared import parts_line, record_of, title

if TYPE_CHECKING:
    from ....servo.parts import Loop, LoopMotion

NAMED = {"velocity": "x2", "integral": "x3", "bristle": "x4"}
"""Options that name a state of the servo."""
NAMES = {state: name for name, state in NAMED.items()}
"""What states of the servo are called."""


def of_loop(
    options: argparse.Namespace, loop: Loop, length: float, numbers: Mapping[str, float], called: str = "loop"
) -> int:
    """Simulate and print; returns the exit code.

    numbers: of the command line: set_point, position, velocity, integral, bristle, tol; called: what the loop is.
    """
    start = _start(options, loop, numbers)
    began = time.perf_counter()
    found, seen = _followed(loop, length, start, numbers["tol"])
    motion, peak = found.motion, float(np.abs(found.torque).max())
    status = Status.CONVERGED if motion.error <= numbers["tol"] else Status.TOLERANCE_NOT_REACHED
    record = record_of(loop) | {
        "set_point": numbers["set_point"], "time": motion.duration, "tol": numbers["tol"], "start": start,
        "end": motion.end, "verdict": seen.kind, "reason": seen.sentence, "amplitude": seen.amplitude,
        "period": seen.period, "pattern": seen.pattern if seen.kind == "hunting" else None, "peak_torque": peak,
        "peak_voltage": peak / loop.value("motor_gain") if "motor_gain" in loop.parameters else None,
        "events": [(event.time, event.event, event.mode) for event in motion.events], "error": motion.error,
        "status": status, "wall_s": time.perf_counter() - began,
    }  # fmt: skip
    name = title(loop, called)
    picture = ("simulation.loop_motion", found, numbers["set_point"], f"{name}: {head_of(seen)}")
    answer = loop_motion_answer(
        name, parts_line(loop), found, record, seen, loop.angles, {} if called == "loop" else NAMES
    )
    give(options, record, answer, table=_table(found), picture=picture)
    sure = status.ok or seen.kind == "growing"  # as what errors are relative to, they grow with it
    if not sure:
        known = f"known to {error_text(motion.error)} of the sizes of the states and of the time"
        said = known if math.isfinite(motion.error) else "not the same, event by event, with finer steps"
        complain("casahunt simulate", f"the motion is {said}; ask for a larger tolerance or a shorter time")
    return 0 if sure else 1


def _followed(loop: Loop, time: float, start: dict[str, float], tol: float) -> tuple[LoopMotion, Outcome]:
    """The motion, and what becomes of it; of one that grows until it cannot be followed, half of the time that it was.

    Raises NotFollowed: it cannot be, and does not grow.
    """

    def seen(duration: float) -> tuple[LoopMotion, Outcome]:
        found = loop_motion(loop, duration, start=start, tol=tol)
        motion = found.motion
        errors = motion.error * np.array([motion.sizes[name] for name in motion.system.states])
        return found, ahead(loop, Moved(found.times, found.states, errors, motion.phases[-1].mode))

    try:
        return seen(time)
    except NotFollowed as refusal:
        if refusal.time > 0:
            with suppress(NotFollowed):
                found, outcome = seen(refusal.time / 2)
                if outcome.kind == "growing":
                    return found, outcome
        raise


def _start(options: argparse.Namespace, loop: Loop, numbers: Mapping[str, float]) -> dict[str, float]:
    """Every state at the start."""
    start = loop.at_rest(numbers["position"] - numbers["set_point"])
    given = {state: numbers[option] for option, state in NAMED.items() if numbers[option]}
    return loop.state(**start | given | assigned(options.state, "state", start, "name=value"))


def _table(found: LoopMotion) -> dict[str, Any]:
    """The motion as columns; angles from the set point."""
    states = dict(zip(found.motion.system.states, found.states, strict=True))
    return {"time_s": found.times, **states, "torque_Nm": found.torque, "mode": found.modes}
