"""Friction compensated by its estimate, alpha Fc sgn(x2), while the servo slips; at a constant set point none is known
while it sticks.

What is left of the friction is Fs - alpha Fc less when it slips: its drop from static friction grows with alpha.
"""

from __future__ import annotations

from .part import Part
from .remedy import Remedy, at_the_set_point

FEEDFORWARD = Part(
    "feedforward", (), {"compensated": 0.0}, size="compensated",
    gives={"compensation": lambda x, s, p: p.compensated * p.coulomb * s.direction},
)  # fmt: skip

REMEDIES = (
    Remedy("feedforward", "compensated", "", at_the_set_point, FEEDFORWARD, first=0.02, last=1.0,
           why_not="it makes the friction of the slipping servo smaller, and not that which it sticks with"),
)  # fmt: skip
