"""A leak in the integrator, x3' = e - lambda x3.

At rest x3 = e/lambda, held by friction where |kp e + ki e/lambda| <= Fs.
"""

from __future__ import annotations

from .part import Part
from .remedy import Remedy

LEAK = Part("leak", (), {"leak": 0.0}, size="leak", gives={"leak_rate": lambda x, s, p: p.leak})

REMEDIES = (
    Remedy("leak", "leak", "1/s", lambda size, p: p["static"] / (p["kp"] + p["ki"] / size), LEAK,
           scale="rate", first=0.05, last=1e3),
)  # fmt: skip
