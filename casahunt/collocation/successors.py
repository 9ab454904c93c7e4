"""Does the event at the end of a phase lead to the mode that the cycle goes on with?

    to(x; p) = m        at x, the state behind the event, after its jump

`to` returns a name, and says nothing of how far it is from returning another.  So it is asked around x too, a little
more than x is known to along each state: where any of the answers is the mode that follows, what decides is
within its error, and that is no contradiction (`undecided`).

Symbols: n states.
"""

from __future__ import annotations

import numpy as np

from .transcription import Setting, Transcription

Array = np.ndarray

DECIDED_BEYOND = 1e-6
"""How far from x `to` is asked, in units of the state scale."""


def behind(t: Transcription, u: Array, setting: Setting, k: int) -> Array:
    """(n,) the state behind the event at the end of a phase."""
    after = t.phase_end[k] + (t.cycle.phases[k].reset is not None)
    return np.asarray(t.nodes_of(u)[after] * setting.scale)


def contradicted(t: Transcription, u: Array, setting: Setting, k: int) -> str:
    """The other mode to which the event at the end of phase k leads; "" where it leads to the one that follows."""
    phase = t.cycle.phases[k]
    if not phase.follows:
        return ""
    x = behind(t, u, setting, k)
    name = phase.leads_to(x, setting.p)
    if not name or name in phase.follows:
        return ""
    beside = around(x, DECIDED_BEYOND * setting.scale)
    return "" if any(phase.leads_to(y, setting.p) in phase.follows for y in beside) else name


def around(x: Array, reach: Array) -> list[Array]:
    """A state (n,) and those beside it, `reach` (n,) away along each entry."""
    return [x, *(x + way * step for step in np.diag(reach) for way in (1.0, -1.0))]


def undecided(t: Transcription, u: Array, setting: Setting) -> list[int]:
    """The phases whose event leads elsewhere, although by less than its state is known to."""
    return [
        k for k, phase in enumerate(t.cycle.phases)
        if phase.follows and phase.leads_to(behind(t, u, setting, k), setting.p) not in ("", *phase.follows)
    ]  # fmt: skip
