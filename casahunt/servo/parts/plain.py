"""The plain remedies: more gain, more derivative action, less integral action."""

from __future__ import annotations

from .remedy import Remedy

REMEDIES = (
    Remedy("gain", "gain", "V/rad", lambda size, p: 0.0, scale="own", first=1.0, last=1e4),
    Remedy("derivative", "kd", "s", lambda size, p: 0.0, scale="own", first=1.0, last=1e4),
    Remedy("integral", "ki", "1/s", lambda size, p: 0.0, sense=-1, scale="own", first=1.0, last=1e-6),
)
