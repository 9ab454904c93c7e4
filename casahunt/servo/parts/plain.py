"""The plain remedies: more gain, more derivative action, less integral action."""

from __future__ import annotations

from .remedy import Remedy, at_the_set_point

REMEDIES = (
    Remedy("gain", "gain", "V/rad", at_the_set_point, scale="own", first=1.0, last=1e4),
    Remedy("derivative", "kd", "s", at_the_set_point, scale="own", first=1.0, last=1e4),
    Remedy("integral", "ki", "1/s", at_the_set_point, sense=-1, scale="own", first=1.0, last=1e-6),
)
