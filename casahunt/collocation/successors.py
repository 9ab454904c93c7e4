"""Does the event at the end of a phase lead to the mode that the cycle goes on with?

    to(x; p) = m        at x, the state behind the event, after its jump

`to` returns a name, and says nothing of how far it is from returning another.  So it is asked around x too, a little
more than x is known to along each state: where any of the answers is the mode that follows, what decides is
within its error, and that is no contradiction (`undecided`).

A `to` that names its own mode ignores the event: nothing ends.  That goes for a graze, and for a threshold that counts
under some condition only; but not where the motion goes at speed to where another mode lives, which ends as it comes
back over the same place and has not ended otherwise, and nothing but `to` says that it may (`taken_over`).

Symbols: n states.
"""

from __future__ import annotations

import numpy as np

from ..hybrid.system import Exit, Phase, VectorEvent, VectorMode
from .joints import event_rate, event_rate_moves
from .transcription import Setting, Transcription

Array = np.ndarray

DECIDED_BEYOND = 1e-6
"""How far from x `to` is asked, in units of the state scale."""
LEFT_BEHIND = 1e-6
"""An event whose rate is this part of the size of what it is the sum of changes at speed."""
RATE_OF_ROUNDING = 1e-12
"""A rate that changes by as much where the states change by this part of their size is one of rounding, as in a
balance of two that are equal."""
AT_ONE_PLACE = 1e-9
"""Events, of order one, that are both so near zero are zero at once."""


def at_speed(mode: VectorMode, event: VectorEvent, direction: int, x: Array, p: Array) -> bool:
    """Whether a mode passes an event at speed in a direction."""
    rate, size = event_rate(Phase(mode, event), x, 0.0, p)
    if not direction * rate > LEFT_BEHIND * size:
        return False
    return direction * rate > RATE_OF_ROUNDING * event_rate_moves(Phase(mode, event), x, 0.0, p)


def taken_over(mode: VectorMode, way_out: Exit, x: Array, p: Array) -> str:
    """Why a mode cannot go on through an event that says it does; "" where it can.

    mode, way_out: the mode and the event; x, p: (n,) state on the event, parameters.
    """
    if not way_out.others or not at_speed(mode, way_out.event, way_out.direction, x, p):
        return ""
    said = f"the mode {mode.name!r} meets {way_out.event.name!r} at speed, and `to` names {mode.name!r} itself"
    for other, ends in way_out.others:
        values = [direction * float(event.function(x, 0.0, p)) for event, direction in ends]
        lives = other.admissible is None or other.admissible(x, p, other.sign) >= -other.slack - AT_ONE_PLACE
        if not lives or max(values, default=-1.0) > AT_ONE_PLACE:
            continue
        behind_it = [end for end, value in zip(ends, values, strict=True) if value >= -AT_ONE_PLACE]
        if any(at_speed(mode, event, -direction, x, p) for event, direction in behind_it):
            return (
                f"{said}, while beyond it is {other.name!r}, which ends as it comes back there: where neither is the "
                f"motion, a mode that stays there is missing; where {mode.name!r} goes on, its `holds` says so"
            )
    decided = {way_out.successor(y, p) for y in around(x, DECIDED_BEYOND * np.maximum(1.0, np.abs(x)))} - {mode.name}
    return decided and (
        f"{said} there and {sorted(decided)[0]!r} right beside it: rounding decides what it looks at, such as whether "
        "the event is passed, which is so wherever it is asked; let it decide by something else"
    ) or ""


def behind(t: Transcription, u: Array, setting: Setting, k: int) -> Array:
    """(n,) the state behind the event at the end of a phase."""
    after = t.phase_end[k] + (t.cycle.phases[k].reset is not None)
    return np.asarray(t.nodes_of(u)[after] * setting.scale)


def contradicted(t: Transcription, u: Array, setting: Setting, k: int) -> str:
    """Why the event at the end of phase k cannot lead to the mode that follows; "" where it does."""
    phase = t.cycle.phases[k]
    if not phase.follows:
        return ""
    x = behind(t, u, setting, k)
    name = phase.leads_to(x, setting.p)
    if name == phase.mode.name in phase.follows and phase.way_out is not None:
        return taken_over(phase.mode, phase.way_out, x, setting.p)
    if not name or name in phase.follows:
        return ""
    beside = around(x, DECIDED_BEYOND * setting.scale)
    stays = any(phase.leads_to(y, setting.p) in phase.follows for y in beside)
    return "" if stays else f"{phase.end.name!r} leads to {name!r}, not to what follows"


def around(x: Array, reach: Array) -> list[Array]:
    """A state (n,) and those beside it, `reach` (n,) away along each entry."""
    return [x, *(x + way * step for step in np.diag(reach) for way in (1.0, -1.0))]


def undecided(t: Transcription, u: Array, setting: Setting) -> list[int]:
    """The phases whose event leads elsewhere, although by less than its state is known to."""
    return [
        k for k, phase in enumerate(t.cycle.phases)
        if phase.follows and phase.leads_to(behind(t, u, setting, k), setting.p) not in ("", *phase.follows)
    ]  # fmt: skip
