"""What a motion of a loop goes on to behind its end: a cycle, rest, smaller and smaller swings, or nobody knows.

    hunting     a cycle was computed to which it goes on, from its end or from a later state
    at rest     nothing moves, no state at all, for as long again, or in the second half of it
    decaying    it comes to rest behind its end; or, with a remedy, its swings shrink towards rest (fate.py)
    growing     it is so far away that a motion as built would be given up (`FAR_AWAY`), and goes ever farther
    undecided   none of these

A servo that is stuck may wind up to its next breakaway: where its position stands, it is not at rest.
"""

from __future__ import annotations

import math
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from ... import effort
from ...checks import to_error
from ...errors import ComesToRest, NoOrbit, NotFollowed
from ...motion import Motion
from ...orbits import Options, Orbit, SystemOrbit, find_cycle
from ...servo.parts.fate import MOVES_NOT, ROUNDING_OF_A_STATE, Swing, fate
from ...servo.parts.loop import Loop
from ...servo.parts.verbs import LoopMotion, loop_motion
from ...servo.sampled.motion import FAR_AWAY
from .price import TASK_STEP

LATE = 0.5
"""Part of the motion behind which nothing moves where it rests."""
WORK_OF_WHAT_STANDS = 2e3
"""Work (effort.py) of looking for a cycle behind a motion in whose second half nothing has moved."""
FARTHER_BY = 2.0
"""Where a motion grows, its second half leads so many times as far as the first."""
STANDS_FOR_GOOD = "it has come to rest, and nothing in the loop moves it again"
COMES_TO_REST = "it is smaller from swing to swing, and comes to rest behind its end"
NOT_FOLLOWED = "neither a cycle nor rest was found to which it goes on behind its end"


class Outcome(NamedTuple):
    """Verdict and reason; the cycle, where it hunts; what stopped the search, where nobody knows."""

    verdict: str
    reason: str
    cycle: SystemOrbit | None = None
    evidence: str = ""


def outcome(loop: Loop, found: LoopMotion, tol: float, bare: Orbit | None) -> Outcome:
    """What a motion goes on to; bare: the cycle of the loop without its remedy, None where there is none."""
    motion = found.motion
    if grows(loop, found):
        far = f"{motion.end['x1']:+.3g} rad beside the set point at {motion.duration:.4g} s"
        return Outcome("growing", f"it grows without bound, and was followed to {far}")
    still = _still(motion, found.states[:, found.times >= LATE * motion.duration])
    if still and _stays(loop, found):
        return Outcome("at rest", STANDS_FOR_GOOD)
    try:
        with effort.at_most(WORK_OF_WHAT_STANDS if still else math.inf):
            return _hunting(_cycle_from(loop, motion.phases[-1].mode, _end(motion), tol))
    except (NoOrbit, effort.PartGivenUp) as why:
        if isinstance(why, ComesToRest) and _stays(loop, found):
            return Outcome("at rest", STANDS_FOR_GOOD)
        if still:
            since = f"since {LATE * motion.duration:.4g} s nothing has moved, and no cycle was found"
            return Outcome("at rest", since)
        if isinstance(why, ComesToRest):
            return Outcome("decaying", COMES_TO_REST)
        if bare is None:
            return Outcome("undecided", NOT_FOLLOWED, evidence=str(why))
        return _followed_on(loop, found, tol, bare, str(why))


def grows(loop: Loop, found: LoopMotion) -> bool:
    """Whether a motion grows without bound: its second half leads far away from where, and from how, it began, and much
    farther than the first."""
    x, late = np.abs(found.states[loop.system.states.index("x1")]), found.times >= LATE * found.motion.duration
    start = max(TASK_STEP, float(np.abs(found.states[:, 0]).max()))
    return bool(x[late].max() > max(FAR_AWAY * start, FARTHER_BY * x[~late].max()))


def followed(loop: Loop, time: float, start: dict[str, float], tol: float) -> LoopMotion:
    """The motion of a loop; of one that grows until it cannot be followed, half of the time that it was.

    Raises NotFollowed: it cannot be, and does not grow.
    """
    try:
        return loop_motion(loop, time, start=start, tol=tol)
    except NotFollowed as refusal:
        if refusal.time > 0:
            with suppress(NotFollowed):
                found = loop_motion(loop, refusal.time / 2, start=start, tol=tol)
                if grows(loop, found):
                    return found
        raise


def _cycle_from(loop: Loop, mode: str, start: dict[str, float], tol: float) -> SystemOrbit:
    """The cycle that a motion goes on to.  Raises ComesToRest, NoOrbit."""
    vary, options = next(iter(loop.parameters)), Options(tol=min(tol, 1e-6))
    return find_cycle(loop.system, mode, start=start, follow=vary, options=options)


def _hunting(cycle: SystemOrbit) -> Outcome:
    amplitude, period = to_error(cycle.amplitude, cycle.amplitude_error), to_error(cycle.period, cycle.period_error)
    return Outcome("hunting", f"it goes on to a cycle of amplitude {amplitude} rad and period {period} s", cycle)


def _followed_on(loop: Loop, found: LoopMotion, tol: float, bare: Orbit, why: str) -> Outcome:
    """What becomes of a motion from whose end no cycle was found: ever smaller swings, or a cycle from later on."""
    seen = fate(loop, _end(found.motion), Swing.of(bare))
    if seen.verdict == "rests":
        return Outcome("decaying", COMES_TO_REST)
    if seen.verdict == "decays":
        size = float(np.abs(np.diff(seen.turns[-3:])).max()) / 2
        return Outcome("decaying", f"followed on, its swings become smaller and smaller, down to {size:.3g} rad")
    if seen.swing is not None:
        with suppress(NoOrbit):
            return _hunting(_cycle_from(loop, loop.mode_at(**seen.swing.state), seen.swing.state, tol))
    return Outcome("undecided", NOT_FOLLOWED, evidence=why)


def _end(motion: Motion) -> dict[str, float]:
    """Every state at the end; nothing, where rounding has left something: that is no size of a state."""
    least = {name: ROUNDING_OF_A_STATE * size for name, size in motion.sizes.items()}
    return {name: value if abs(value) > least[name] else 0.0 for name, value in motion.end.items()}


def _still(motion: Motion, states: np.ndarray) -> bool:
    """Whether no state moves, the sum of an integrator neither: a servo that is stuck may wind up to its breakaway."""
    sizes = np.array([motion.sizes[name] for name in motion.system.states])
    return bool(np.all(np.ptp(states, axis=1) <= MOVES_NOT * sizes))


def _stays(loop: Loop, found: LoopMotion) -> bool:
    """Whether nothing moves for as long again behind the end of a motion."""
    motion = found.motion
    with suppress(NoOrbit):
        mode = motion.phases[-1].mode
        further = loop_motion(loop, motion.duration, start=_end(motion), mode=mode, sizes=motion.sizes)
        return _still(motion, further.states)
    return False
