"""What is measured, how often, and what it is compared with."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from problems import table1

ALONE = ("orbit-stable", "orbit-unstable", "fold", "diagram")
SCENES = (*ALONE, "gains")
"""Of the servo: those with one question, and all."""
GALLERY = ("van-der-pol", "belt", "relay", "gallery")
"""Of the gallery: curves, and the table."""
START = 0.0321
LONG_ENOUGH, MOST_REPEATS = 0.5, 50
"""What takes milliseconds is repeated for so long [s], or so often: the best of a few is chance."""
GAINS = {"orbit-stable": 0.1, "orbit-unstable": 0.4}


@dataclass(frozen=True)
class Row:
    """One measurement; `error` and `seconds` are None where there is only a `note`."""

    scene: str
    model: str
    method: str
    setting: str
    seconds: float | None
    error: float | None
    points: int | None = None
    note: str = ""


def best_of(repeats: int, action: Callable[[], Any]) -> tuple[float, Any]:
    """(least processor time, last result) of so many repeats, and of more where they are short."""
    times: list[float] = []
    result = None
    while len(times) < repeats or (sum(times) < LONG_ENOUGH and len(times) < MOST_REPEATS):
        began = time.process_time()
        result = action()
        times.append(time.process_time() - began)
    return min(times), result


def reference(model: str, scene: str, gain: float | None = None) -> dict[str, float]:
    """The row of the reference table that a scene is compared with, at its gain or another one of the table."""
    if scene in ("fold", "diagram"):
        return table1.REFERENCE[model]["fold"]
    rows = table1.REFERENCE[model]["stable" if scene == "orbit-stable" else "unstable"]
    return next(row for row in rows if row["K"] == (GAINS[scene] if gain is None else gain))


def orbit_error(orbit: Any, row: dict[str, float]) -> float:
    """Largest relative error of amplitude and period."""
    return max(abs(orbit.amplitude / row["amplitude"] - 1), abs(orbit.period / row["period"] - 1))
