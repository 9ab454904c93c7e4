"""The initial value problem of any hybrid system: mode by mode, each to its exit.

    x(t) = x_0 + integral of f_k(x; p),    until h(x, T; p) = 0, then the next mode

recursion.py       the Taylor coefficients of a motion, by a rule for each operation of its field
series.py          steps by power series, and the mesh for what they have shown
interval_newton.py one interval as a compiled function: Newton's step, and chords
march_step.py      one interval: Newton on its stages
segment.py         one phase of a motion, as data
rest.py            where a motion has come to rest, and what it still does is rounding
sensitivity.py     how the end of a phase moves with its start and with parameters
march_watch.py     an interval watched for the exits of its mode
march_exits.py     where a mode ends: its exits watched, and located to rounding
extrapolated_steps.py extrapolated midpoint steps, explicit or implicit, as compiled functions
march_extrapolated.py a mode to its exit, where no mesh is wanted
march_series.py    a smooth mode to its exit, by series
march_intervals.py a stiff mode to its exit, interval by interval
march_checks.py    whether a phase is a motion of its mode
phases.py          phase by phase: by series, or interval by interval; what comes out is a mesh with stages
closed_forms.py  a closed form against the field of its mode
motion.py          a motion as data
simulation.py      the motion of a user's system, with its events and its error
"""

from typing import TYPE_CHECKING

from ..lazy import lazily

if TYPE_CHECKING:
    from .motion import Motion
    from .phases import march
    from .recursion import taylor_coefficients
    from .segment import MarchFailure, Segment
    from .sensitivity import forward_sensitivity
    from .simulation import follow_for, simulate

__all__ = [
    "MarchFailure", "Motion", "Segment", "follow_for", "forward_sensitivity", "march", "simulate",
    "taylor_coefficients",
]  # fmt: skip
__getattr__ = lazily(__name__)
