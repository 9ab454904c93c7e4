"""An integrator that is frozen while the servo sticks, once it has stuck for a dwell.

    clock' = 1 while stuck; at clock = T the integrator stops until the servo breaks away, and then it never does

At rest m = m0 - ki x1 T, m0 the torque when it stopped: friction has held it all the while where |m0| <= Fs, |m| <= Fs,
so that |x1| <= 2 Fs/(ki T).
"""

from __future__ import annotations

import math
from collections.abc import Mapping

from ...checks import SMALLEST
from .part import Edge, Law, Part, PartMode
from .remedy import Corners, Remedy

OVER_AT_LAST = 1 + 1e-9
"""So that a dwell of n samples is over at the n-th, whatever their sum is rounded to."""
_AWAY = ("breakaway+", "breakaway-")

FREEZE = Part(
    "freeze", ("clock",), {"dwell": math.inf}, even=("clock",), ranges={"dwell": (SMALLEST, math.inf)},
    size="dwell", absent=math.inf,
    upon={name: {"clock": lambda x, s, p: 0.0} for name in _AWAY},
    follows=dict.fromkeys(_AWAY, ""),
    modes=(
        PartMode("", Law({"clock": lambda x, s, p: 1 - s.moving}, {"integrates": lambda x, s, p: 1.0},
                         sampled={"clock": lambda x, s, p: x.clock + (1 - s.moving) * p.sample_time * OVER_AT_LAST}),
                 (Edge("dwells", lambda x, s, p: x.clock / p.dwell - 1, +1, "frozen"),)),
        PartMode("frozen", Law(gives={"integrates": lambda x, s, p: 0.0})),
    ),
)  # fmt: skip


def _rests(size: float, p: Mapping[str, float]) -> Corners:
    static, largest = p["static"], 2 * p["static"] / (p["ki"] * size)
    return (-largest, static), (0.0, static), (largest, -static), (0.0, -static)


REMEDIES = (
    Remedy("freeze", "dwell", "s", _rests, FREEZE, sense=-1, scale="period",
           first=2.0, last=1e-3, needs=("switch",)),
)  # fmt: skip
