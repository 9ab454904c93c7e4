"""An integrator that is reset to a part of its content: where the error goes through zero, or where the servo stops.

    x3 -> rho x3,     rho = 1 resets nothing
"""

from __future__ import annotations

import math

from .part import Edge, Part, PartMode
from .remedy import Remedy, at_the_set_point

_FACTOR = -math.inf, 1.0
"""Below zero the content is turned round; above one nothing would be reset."""

RESET_AT_ZERO = Part(
    "reset", (), {"reset": 1.0}, ranges={"reset": _FACTOR}, size="reset", absent=1.0,
    modes=(PartMode("", ends=(Edge("zero error", lambda x, s, p: s.error * s.kp / p.static, 0, "",
                                   {"x3": lambda x, s, p: p.reset * x.x3}),)),),
)  # fmt: skip
RESET_AT_CENTRE = Part(
    "reset", (), {"reset": 1.0}, ranges={"reset": _FACTOR}, size="reset", absent=1.0,
    upon={"centre": {"x3": lambda x, s, p: p.reset * x.x3}},
)  # fmt: skip
"""The same where cycles are cut at zero error anyway (lugre.py): two events cannot stand at one place."""
RESET_AT_STOP = Part(
    "reset at a stop", (), {"reset_at_stop": 1.0}, ranges={"reset_at_stop": _FACTOR}, size="reset_at_stop",
    absent=1.0,
    upon={"stop": {"x3": lambda x, s, p: p.reset_at_stop * x.x3}},
)  # fmt: skip

REMEDIES = (
    Remedy("reset", "reset", "", at_the_set_point, RESET_AT_ZERO, sense=-1, first=0.95, last=-1.0,
           needs=("switch",)),
    Remedy("reset", "reset", "", at_the_set_point, RESET_AT_CENTRE, sense=-1, first=0.95, last=-1.0,
           needs=("lugre",)),
    Remedy("reset at a stop", "reset_at_stop", "", at_the_set_point, RESET_AT_STOP, sense=-1, first=0.95, last=-0.9,
           needs=("switch",), why_not="the stuck integrator winds up to breakaway again, from wherever it starts"),
)  # fmt: skip
