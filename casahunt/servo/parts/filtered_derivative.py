"""The derivative of any PID, filtered: s/(1 + Tf s) in the place of s; its state d is the filtered error.

    Tf d' = e - d,   derivative = (e - d)/Tf

by the time Tf [s], absent at 0, or by N = kd/(kp Tf), absent at infinity.
"""

from __future__ import annotations

import math

from ...checks import SMALLEST
from .part import Function, Law, Part, PartMode


def _filter(name: str, size: str, absent: float, lowest: float, time: Function) -> Part:
    slope: Function = lambda x, s, p: (s.error - x.lagging) / time(x, s, p)  # noqa: E731
    return Part(
        name, ("lagging",), {size: absent}, ranges={size: (lowest, math.inf)}, size=size, absent=absent,
        stands={"lagging": "error"},
        gives={"derivative": slope}, modes=(PartMode("", Law({"lagging": slope})),),
    )  # fmt: skip


DERIVATIVE_FILTER = _filter("derivative filter", "derivative_filter", 0.0, 0.0, lambda x, s, p: p.derivative_filter)
DERIVATIVE_FILTER_BY_N = _filter(
    "derivative filter by N", "derivative_n", math.inf, SMALLEST, lambda x, s, p: s.kd / (s.kp * p.derivative_n)
)
