"""casahunt simulate of a loop of parts.

    start   angles: position - set point; velocity x2, integral x3, bristle x4; any other by its name; else zero

Keys of the JSON object: parts, parameters, gain, set_point, time, tol; start, end: states by name; verdict ("hunting",
"at rest", "decaying", "undecided"): what the motion goes on to behind its end, with reason (evidence: what stopped the
search, or null), and amplitude and period of the cycle (null where there is none); peak_torque [N m], peak_voltage [V]
(null without a motor gain); events, a list of [time, name, mode before]; error, of states and times of events, relative
to the sizes of the states and to the duration; status, wall_s.
"""

from __future__ import annotations

import argparse
import time
from collections.abc import Mapping
from contextlib import suppress
from typing import TYPE_CHECKING, Any

import numpy as np

from ....checks import error_text, to_error
from ....design.remedies.price import RESTS_WITHIN, ROUNDING_OF_A_STATE, fate
from ....errors import ComesToRest, NoOrbit, Status
from ....motion import Motion
from ....orbits import Options, Orbit, SystemOrbit, find_cycle
from ....servo.servo import assigned
from ...answers.loops import loop_motion_answer
from ...answers.simulate import HEADS
from ..console import complain
from ..output import give
from .shared import parts_line, record_of, title

if TYPE_CHECKING:
    from ....servo.parts import Loop, LoopMotion

LATE = 0.5
"""Part of the motion behind which nothing moves where it rests."""
STANDS_FOR_GOOD = "it has come to rest, and nothing in the loop moves it again"
"""Where nothing moves behind its end."""
COMES_TO_REST = "it is smaller from swing to swing, and comes to rest behind its end"
HALVED = 3
"""Times that what is left of a motion is seen to become half as large, until it is taken to come to rest."""
NOT_FOLLOWED = "neither a cycle nor rest was found to which it goes on behind its end"
NAMED = {"velocity": "x2", "integral": "x3", "bristle": "x4"}
"""Options that name a state of the servo."""
NAMES = {state: name for name, state in NAMED.items()}
"""What states of the servo are called."""


def of_loop(
    options: argparse.Namespace, loop: Loop, length: float, numbers: Mapping[str, float], called: str = "loop",
    bare: Orbit | None = None,
) -> int:  # fmt: skip
    """Simulate and print; returns the exit code.

    numbers: of the command line: set_point, position, velocity, integral, bristle, tol; called: what the loop is;
    bare: its cycle without a remedy.
    """
    from ....servo.parts import loop_motion

    start = _start(options, loop, numbers)
    began = time.perf_counter()
    found = loop_motion(loop, length, start=start, tol=numbers["tol"])
    verdict, reason, cycle, evidence = _goes_on_to(loop, found, numbers["tol"], bare)
    motion, peak = found.motion, float(np.abs(found.torque).max())
    status = Status.CONVERGED if motion.error <= numbers["tol"] else Status.TOLERANCE_NOT_REACHED
    record = record_of(loop) | {
        "set_point": numbers["set_point"], "time": motion.duration, "tol": numbers["tol"], "start": start,
        "end": motion.end, "verdict": verdict, "reason": reason, "evidence": evidence or None,
        "amplitude": cycle and cycle.amplitude,
        "period": cycle and cycle.period, "peak_torque": peak, "peak_voltage": _voltage(loop, peak),
        "events": [(event.time, event.event, event.mode) for event in motion.events], "error": motion.error,
        "status": status, "wall_s": time.perf_counter() - began,
    }  # fmt: skip
    name = title(loop, called)
    picture = ("simulation.loop_motion", found, numbers["set_point"], f"{name}: {HEADS[verdict]}")
    answer = loop_motion_answer(
        name, parts_line(loop), found, record, cycle, loop.angles, {} if called == "loop" else NAMES
    )
    give(options, record, answer, table=_table(found), picture=picture)
    if not status.ok:
        said = f"known to {error_text(motion.error)} of the sizes of the states and of the time"
        complain("casahunt simulate", f"the motion is {said}; ask for a larger tolerance or a shorter time")
    return 0 if status.ok else 1


def _start(options: argparse.Namespace, loop: Loop, numbers: Mapping[str, float]) -> dict[str, float]:
    """Every state at the start."""
    start = loop.at_rest(numbers["position"] - numbers["set_point"])
    given = {state: numbers[option] for option, state in NAMED.items() if numbers[option]}
    return loop.state(**start | given | assigned(options.state, "state", start, "name=value"))


def _goes_on_to(
    loop: Loop, found: LoopMotion, tol: float, bare: Orbit | None
) -> tuple[str, str, SystemOrbit | None, str]:
    """Verdict, reason, cycle, and what stopped the search for it: of the motion as it goes on behind its end.

    bare: the cycle without a remedy.
    """
    motion = found.motion
    try:
        return _hunting(_cycle_from(loop, motion.phases[-1].mode, motion.end, tol))
    except ComesToRest:
        stays = _stays(loop, found)
        return "at rest" if stays else "decaying", STANDS_FOR_GOOD if stays else COMES_TO_REST, None, ""
    except NoOrbit as why:
        late = found.times >= LATE * motion.duration
        if _still(motion, found.states[:, late]):
            since = f"since {LATE * motion.duration:.4g} s nothing has moved, and no cycle was found"
            return "at rest", since, None, ""
        if bare is None:
            return "undecided", NOT_FOLLOWED, None, str(why)
        return _followed_on(loop, found, tol, bare, str(why))


def _cycle_from(loop: Loop, mode: str, start: dict[str, float], tol: float) -> SystemOrbit:
    """The cycle that a motion goes on to.  Raises ComesToRest, NoOrbit."""
    vary, options = next(iter(loop.parameters)), Options(tol=min(tol, 1e-6))
    return find_cycle(loop.system, mode, start=start, follow=vary, options=options)


def _hunting(cycle: SystemOrbit) -> tuple[str, str, SystemOrbit, str]:
    amplitude, period = to_error(cycle.amplitude, cycle.amplitude_error), to_error(cycle.period, cycle.period_error)
    return "hunting", f"it goes on to a cycle of amplitude {amplitude} rad and period {period} s", cycle, ""


def _followed_on(
    loop: Loop, found: LoopMotion, tol: float, bare: Orbit, why: str
) -> tuple[str, str, SystemOrbit | None, str]:
    """What becomes of a motion from whose end no cycle was found: smaller and smaller, or a cycle from a later state.

    Smaller than half of the hunting is no rest: the cycle with a remedy may be so small, and half of that is asked for.
    """
    motion, size = found.motion, bare.amplitude
    small = {name: ROUNDING_OF_A_STATE * value for name, value in motion.sizes.items()}
    state = {name: value if abs(value) > small[name] else 0.0 for name, value in motion.end.items()}
    for _ in range(HALVED):
        seen = fate(loop, state, size, bare.period)
        state, late = seen.end, seen.times >= seen.times[-1] - 2 * bare.period
        if seen.verdict == "rests":
            return "decaying", COMES_TO_REST, None, ""
        if seen.verdict != "decays":
            with suppress(NoOrbit):
                return _hunting(_cycle_from(loop, loop.mode_at(**state), state, tol))
            return "undecided", NOT_FOLLOWED, None, why
        size = float(np.abs(seen.position[late]).max())
    return "decaying", COMES_TO_REST, None, ""


def _still(motion: Motion, states: np.ndarray) -> bool:
    """Whether no state moves, the sum of an integrator neither: a servo that is stuck may wind up to its breakaway."""
    sizes = np.array([motion.sizes[name] for name in motion.system.states])
    return bool(np.all(np.ptp(states, axis=1) <= RESTS_WITHIN * sizes))


def _stays(loop: Loop, found: LoopMotion) -> bool:
    """Whether nothing moves for as long again behind the end of a motion."""
    from ....servo.parts import loop_motion

    motion = found.motion
    with suppress(NoOrbit):
        further = loop_motion(loop, motion.duration, start=motion.end, mode=motion.phases[-1].mode)
        return _still(motion, further.states)
    return False


def _voltage(loop: Loop, torque: float) -> float | None:
    """That of a torque [V], where the motor has a gain."""
    return torque / loop.value("motor_gain") if "motor_gain" in loop.parameters else None


def _table(found: LoopMotion) -> dict[str, Any]:
    """The motion as columns; angles from the set point."""
    states = dict(zip(found.motion.system.states, found.states, strict=True))
    return {"time_s": found.times, **states, "torque_Nm": found.torque, "mode": found.modes}
