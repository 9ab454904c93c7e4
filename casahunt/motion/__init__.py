"""The initial value problem of any hybrid system: mode by mode, each to its exit.

    x(t) = x_0 + integral of f_k(x; p),    until h(x, T; p) = 0, then the next mode

recursion.py       the Taylor coefficients of a motion, by a rule for each operation of its field
series.py          steps by power series, and the mesh for what they have shown
march_step.py      one interval: Newton on its stages
march_exits.py     where a mode ends: its exits watched, and located to rounding
march_series.py    a smooth mode to its exit, by series
march.py           phase by phase: by series, or interval by interval; what comes out is a mesh with stages
closed_forms.py  a closed form against the field of its mode
simulation.py      the motion of a user's system, with its events and its error
"""

from typing import TYPE_CHECKING

from ..lazy import lazily

if TYPE_CHECKING:
    from .simulation import Motion, simulate

__all__ = ["Motion", "simulate"]
__getattr__ = lazily(__name__, {"simulation": ("Motion", "simulate")})
