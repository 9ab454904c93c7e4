"""Whether motions that lie side by side part from each other for ever: the largest exponent of hunting.

    exponent = sum of log(d_k/d_0) / sum of T_k    d_k, how far beside another motion is at a stop, d_0 at that before

T_k from stop to stop; then the other one is put back beside it, in the same direction (G. Benettin, L. Galgani, A.
Giorgilli, J.-M. Strelcyn, Meccanica 15 (1980) 9-20 and 21-30).  Both are compared where they stop, each at its own
time, so that a state farther on along the same motion counts for nothing: on a stable cycle the exponent is that of
its leading multiplier m, log|m|/T < 0.
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable

import numpy as np

from ... import effort
from ...errors import HuntsIrregularly
from ...motion import MarchFailure, Segment, march
from .fate import ROUNDING_OF_A_STATE, Swing
from .loop import Loop

Array = np.ndarray

STOP = "stop"
"""The event at which a slip ends."""
BEGINS_BESIDE, PARTED = 1e-6, 1e-2
"""How far beside a motion another one begins, in sizes of the states; farther than the second, as where only one of
them meets an event, they tell no more of each other."""
ERROR_OF_BOTH = 1e-10
"""Of an interval of a motion."""
FORGOTTEN, STRETCHES = 16, 8
"""Stops until the direction is no longer that of the start; parts of the motion whose exponents show the error."""
WORK_OF_AN_EXPONENT, ERRORS_FROM_ZERO = 2e6, 3.0
"""Work (effort.py) allowed; standard errors by which an exponent differs from zero."""


def largest_exponent(loop: Loop, swing: Swing, stops: int = 240) -> tuple[float, float]:
    """The largest exponent of hunting [1/s], and its standard error: of the mean of stretches.

    swing: a state of it, and sizes; stops: how many it is followed for. Both nan where it cannot be followed.
    """
    state = loop.state(**swing.state)
    scale, x = np.array([swing.sizes[name] or 1.0 for name in state]), np.array(list(state.values()))
    try:
        with effort.at_most(WORK_OF_AN_EXPONENT):
            grown = _grown(loop, loop.mode_at(**state), x, scale, FORGOTTEN + stops)[FORGOTTEN:]
    except (MarchFailure, effort.PartGivenUp):
        return math.nan, math.nan
    if len(grown) < 2 * STRETCHES:
        return math.nan, math.nan
    growth, lasted = np.array([part.sum(axis=0) for part in np.array_split(grown, STRETCHES)]).T
    return float(growth.sum() / lasted.sum()), float(np.std(growth / lasted, ddof=1)) / math.sqrt(STRETCHES)


def in_words(exponent: tuple[float, float]) -> str:
    """What an exponent and its error mean; "" where they are not known."""
    mean, error = exponent
    said = f"largest exponent {mean:.3g} 1/s, standard error {error:.1g}"
    if mean > ERRORS_FROM_ZERO * error:
        return f"a small difference grows e-fold every {1 / mean:.3g} s, so that it does not repeat ({said})"
    if mean < -ERRORS_FROM_ZERO * error:
        return f"a small difference dies out, so that it may repeat in a longer pattern ({said})"
    return f"whether a small difference grows was not seen ({said})" if mean == mean else ""


def told(hunting: HuntsIrregularly) -> str:
    """What is said of irregular hunting, and of its exponent."""
    return "; ".join(filter(None, (str(hunting), in_words(hunting.exponent))))


def _grown(loop: Loop, mode: str, x: Array, scale: Array, stops: int) -> list[tuple[float, float]]:
    """log(d_k/d_0) and T_k, from stop to stop.  Raises MarchFailure."""
    phases = _followed(loop, mode, x, scale, stops)
    at = [k for k, phase in enumerate(phases[:-1]) if phase.event == STOP]
    aside, grown = np.random.default_rng(0).standard_normal(x.size), list[tuple[float, float]]()
    for here, there in zip(at, at[1:], strict=False):
        begins, following = phases[here].behind, phases[here + 1]
        aside[np.abs(begins) <= ROUNDING_OF_A_STATE * scale] = 0.0  # what is stuck, or stops, is so in both motions
        beside = begins + BEGINS_BESIDE * scale * aside / np.linalg.norm(aside)
        other = _followed(loop, following.mode, beside, scale, 1)[-1]
        moved = (other.behind - phases[there].behind) / scale
        far = float(np.linalg.norm(moved))
        aside = moved if far > 0 else aside
        if 0 < far < PARTED:
            grown.append((math.log(far / BEGINS_BESIDE), sum(phase.duration for phase in phases[here + 1 : there + 1])))
    return grown


def _followed(loop: Loop, mode: str, x: Array, scale: Array, stops: int) -> list[Segment]:
    """The phases of a motion up to so many stops.  Raises MarchFailure."""
    return march(
        loop.system.vector_form, mode, x, loop.system.values(None), scale=scale, until=_after(stops),
        tol=ERROR_OF_BOTH, strict=True, meshed=False, max_intervals=sys.maxsize,
    )  # fmt: skip


def _after(stops: int) -> Callable[[Segment], bool]:
    """Whether phases have met so many stops."""
    met = 0

    def enough(phase: Segment) -> bool:
        nonlocal met
        met += phase.event == STOP
        return met >= stops

    return enough
