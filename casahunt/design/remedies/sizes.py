"""Sizes of remedies: what they are measured by, and what is more of one."""

from __future__ import annotations

import math

from ...axis_units import quantity
from ...servo.parts.fate import Swing
from ...servo.parts.loop import Loop
from ...servo.parts.remedy import Remedy


def scale_of(remedy: Remedy, loop: Loop, hunting: Swing) -> float:
    """What the sizes of a remedy are measured by: the loop without it, and its hunting."""
    if remedy.scale == "own":
        return loop.value(remedy.size)
    by_name = {"amplitude": hunting.amplitude, "rate": 1 / hunting.period, "period": hunting.period, "one": 1.0}
    return by_name[remedy.scale] if remedy.scale in by_name else loop.value(remedy.scale)


def sized(size: float, remedy: Remedy) -> str:
    """A size of a remedy, as it stands in a sentence."""
    return quantity(size, remedy.unit).rstrip()


def more_of(remedy: Remedy, size: float, factor: float) -> float:
    """More of a remedy: farther from its absence, which may be at infinity or, where less is more, at zero."""
    absent = remedy.part.absent if remedy.part is not None and remedy.part.size else 0.0
    if absent == 0:
        return size * factor if remedy.sense > 0 else size / factor
    return size / factor if math.isinf(absent) else absent + (size - absent) * factor
