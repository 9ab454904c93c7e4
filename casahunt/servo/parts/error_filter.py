"""A filter of the error, T f' = x1 - f; the controller sees f and f'.  At rest f = x1: nothing is gained."""

from __future__ import annotations

from .part import Law, Part, PartMode
from .remedy import Remedy, at_the_set_point

ERROR_FILTER = Part(
    "error filter", ("filtered",), {"filter_time": 0.0}, size="filter_time",
    stands={"filtered": "followed"},
    gives={"seen": lambda x, s, p: x.filtered, "seen_rate": lambda x, s, p: (s.followed - x.filtered) / p.filter_time},
    modes=(PartMode("", Law({"filtered": lambda x, s, p: (s.followed - x.filtered) / p.filter_time})),),
)  # fmt: skip

REMEDIES = (
    Remedy("error filter", "filter_time", "s", at_the_set_point, ERROR_FILTER, scale="period", first=1e-3, last=1.0,
           why_not="a delayed error lets the servo overshoot more"),
)  # fmt: skip
