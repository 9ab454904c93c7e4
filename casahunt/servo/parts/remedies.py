"""Remedies against hunting as parts of a loop.

    dead band   the integrator's input is cut where |e| < delta
    leak        x3' = e - lambda x3
"""

from __future__ import annotations

from .part import Edge, Law, Part, PartMode

DEAD_BAND = Part(
    "dead band", (), {"dead_band": 0.0}, size="dead_band",
    modes=(
        PartMode("", Law(gives={"integrand": lambda x, s, p: s.error}),
                 (Edge("enters", lambda x, s, p: s.error**2 / p.dead_band**2 - 1, -1, "inside"),)),
        PartMode("inside", Law(gives={"integrand": lambda x, s, p: 0.0}),
                 (Edge("leaves", lambda x, s, p: s.error**2 / p.dead_band**2 - 1, +1, ""),)),
    ),
)  # fmt: skip

LEAK = Part("leak", (), {"leak": 0.0}, size="leak", gives={"leak_rate": lambda x, s, p: p.leak})
