"""A leak in the integrator, x3' = e - lambda x3.

At rest x3 = x1/lambda, and the torque m = -(kp + ki/lambda) x1, which friction holds where |m| <= Fs.
"""

from __future__ import annotations

from collections.abc import Mapping

from .part import Part
from .remedy import Corners, Remedy

LEAK = Part("leak", (), {"leak": 0.0}, size="leak", gives={"leak_rate": lambda x, s, p: p.leak})


def _rests(size: float, p: Mapping[str, float]) -> Corners:
    largest = p["static"] / (p["kp"] + p["ki"] / size)
    return (-largest, p["static"]), (largest, -p["static"])


REMEDIES = (Remedy("leak", "leak", "1/s", _rests, LEAK, scale="rate", first=0.05, last=1e3),)
