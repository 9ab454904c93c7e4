"""The derivative of any PID, filtered: s/(1 + Tf s) in the place of s; its state d is the filtered error.

    Tf d' = e - d,   derivative = (e - d)/Tf

by the time Tf [s], absent at 0, or by N = kd/(kp Tf), absent at infinity.
"""

from __future__ import annotations

import math
from dataclasses import replace

from ...checks import SMALLEST
from .part import Function, Law, Part, PartMode


def lagging(part: Part, time: Function) -> Part:
    """A part that gives the filtered derivative besides, of this time."""
    slope: Function = lambda x, s, p: (s.error - x.lagging) / time(x, s, p)  # noqa: E731
    return replace(
        part, states=("lagging",), stands={"lagging": "error"}, gives={**part.gives, "derivative": slope},
        modes=(PartMode("", Law({"lagging": slope})),),
    )  # fmt: skip


def _filter(name: str, size: str, absent: float, lowest: float, time: Function) -> Part:
    ranges = {size: (lowest, math.inf)}
    return lagging(Part(name, (), {size: absent}, ranges=ranges, size=size, absent=absent), time)


DERIVATIVE_FILTER = _filter("derivative filter", "derivative_filter", 0.0, 0.0, lambda x, s, p: p.derivative_filter)
DERIVATIVE_FILTER_BY_N = _filter(
    "derivative filter by N", "derivative_n", math.inf, SMALLEST, lambda x, s, p: s.kd / (s.kp * p.derivative_n)
)
