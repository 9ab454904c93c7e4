"""A motor whose torque is limited, |m| <= limit, with anti-windup.

    clamping           the integrator stands still while the torque is at its limit, whichever way the error is
    back calculation   x3' is moved by (m_commanded - m)/(ki T): the integrator unwinds with the time T
    none               it winds up
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from ...checks import SMALLEST
from .part import Edge, Function, Law, Part, PartMode
from .wiring import UNGIVEN


def _limited(name: str, at_the_limit: Mapping[str, Function], **more: float) -> Part:
    def upper(x: Any, s: Any, p: Any) -> Any:
        return s.command / p.torque_limit - 1

    def lower(x: Any, s: Any, p: Any) -> Any:
        return s.command / p.torque_limit + 1

    def limit(sign: float) -> Function:
        return lambda x, s, p: sign * p.torque_limit

    free = {signal: UNGIVEN[signal] for signal in at_the_limit}
    return Part(
        name, (), {"torque_limit": math.inf, **more}, ranges={"torque_limit": (SMALLEST, math.inf)},
        size="torque_limit", absent=math.inf,
        modes=(
            PartMode("", Law(gives={"torque": lambda x, s, p: s.command, **free}),
                     (Edge("upper limit", upper, +1, "at upper limit"),
                      Edge("lower limit", lower, -1, "at lower limit")),
                     where=lambda x, s, p: abs(s.command) <= p.torque_limit),
            PartMode("at upper limit", Law(gives={"torque": limit(+1.0), **at_the_limit}),
                     (Edge("leaves upper limit", upper, -1, ""),), where=lambda x, s, p: s.command > 0),
            PartMode("at lower limit", Law(gives={"torque": limit(-1.0), **at_the_limit}),
                     (Edge("leaves lower limit", lower, +1, ""),)),
        ),
    )  # fmt: skip


TORQUE_LIMIT = _limited("torque limit", {})
CLAMPING = _limited("torque limit with clamping", {"integrates": lambda x, s, p: 0.0})
BACK_CALCULATION = _limited(
    "torque limit with back calculation",
    {"unwinding": lambda x, s, p: (s.command - s.torque) / (s.ki * p.unwinding_time)}, unwinding_time=1.0,
)  # fmt: skip
