"""What is in the way of a tuning: which demand stands against which, in gains.

At given times each demand is a set of gains: K >= (1 + margin) K_b of the hunting margin, intervals of each demand on
the linear loops (loop_set.py), the bounds.  The smallest number of them without a gain in common is in the way.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from ...servo.controller import Pid
from ...servo.servo import Servo
from ..uncertainty.worst_corner import WorstCase
from .demands import DEMANDS, Demands, controller_said
from .loop_set import Intervals, LoopBox, Table, allowed, common

WIDER = 100.0
"""How far beyond the gains that matter the demands are looked at."""

@dataclass(frozen=True, eq=False)
class Nearest:
    """The times that come nearest to what is asked for.

    Attributes
    ----------
    servo : with these times.
    worst : the worst servo for the fold.
    needed : (1 + margin) times its fold gain; 0 without one.
    bounds : of the gain, where given.
    span : gains that were looked at.
    boxes : the linear loops of the set.
    free : names of the free times.
    """

    servo: Servo
    worst: WorstCase
    needed: float
    bounds: tuple[float, float] | None
    span: tuple[float, float]
    boxes: Sequence[LoopBox]
    free: Sequence[str]


def refusal(near: Nearest, demands: Demands, *, times: int = 0, missed: float = 0.0, proven: bool = True) -> str:
    """What cannot be met, or was not found, and which demand stands against which.

    near, demands: the nearest times, and what is asked for; times, missed: with free times: how many pairs were looked
    at, and v at the nearest one; proven: whether they are evidence that there are none.
    """
    low = min(near.span[0], near.needed or math.inf) / WIDER
    high = max(near.span[1], near.needed) * WIDER
    table = Table(near.boxes, demands, low, high)
    sets: dict[str, Intervals] = {"hunting margin": [(near.needed, math.inf)]}
    sets |= {name: allowed(near.boxes, demands, table, name) for name in DEMANDS}
    if near.bounds is not None:
        sets["bounds of the gain"] = [near.bounds]
    names = _against_each_other(sets)
    said = "; ".join(_said(name, sets[name], near, demands, table) for name in names)
    where = ""
    if near.free:
        where = f" at {controller_said(near.servo)}"
    if not near.free:
        return f"the tuning cannot be met; in the way: {said}"
    what = "controllers" if isinstance(near.servo.controller, Pid) else "pairs of controller times"
    evidence = f"{times} {what} between the bounds were tried"
    if proven:
        head = f"the tuning cannot be met: {evidence}, and what is missing is everywhere more than it varies in between"
    else:
        head = f"a tuning that meets the demands was not found: {evidence}"
    amount = ""
    if missed > 0:
        amount = f", where {100 * math.expm1(missed):.3g} % of gain or {math.degrees(missed):.3g} degrees are missing"
    return f"{head}; nearest{where}{amount}; there in the way: {said}"


def _against_each_other(sets: dict[str, Intervals]) -> tuple[str, ...]:
    """Those of the demands that make up the smallest groups without a common gain; all of them where none does."""
    for n in range(1, len(sets) + 1):
        groups = [names for names in itertools.combinations(sets, n) if not common([sets[name] for name in names])]
        if groups:
            return tuple(name for name in sets if any(name in group for group in groups))
    return tuple(sets)


def _said(name: str, allowed: Intervals, near: Nearest, demands: Demands, table: Table) -> str:
    if name == "hunting margin":
        corner = ", ".join(f"{key} = {value:.6g}" for key, value in near.worst.corner.items())
        at = f" at {corner}" if corner else ""
        return (
            f"the hunting margin of {100 * demands.margin:g} % asks for a gain of at least {near.needed:.6g} (the fold "
            f"gain is {near.worst.gain:.6g}{at})"
        )
    if name == "bounds of the gain":
        assert near.bounds is not None
        return f"the bounds of the gain allow {near.bounds[0]:g} to {near.bounds[1]:g}"
    lag = f" with a delay of {demands.lag:g} s" if demands.lag else ""
    what = f"the gain margin of {demands.gain_margin:g} when the gain {'falls' if name == DEMANDS[1] else 'rises'}{lag}"
    if name == DEMANDS[0]:
        what = f"the phase margin of {demands.phase_margin:g} degrees{lag}"
    if not allowed:
        row = table.missed[DEMANDS.index(name)]
        i = int(np.argmin(row))
        best = demands.least(name) - float(row[i])
        margin = f"the smallest phase margin is {math.degrees(best):.4g} degrees at best, at gain {table.gains[i]:.4g}"
        return f"{what} is kept at no gain ({margin})"
    texts = []
    for low, high in allowed:
        if low == 0.0:
            texts.append(f"at most {high:.6g}")
        elif high == math.inf:
            texts.append(f"at least {low:.6g}")
        else:
            texts.append(f"{low:.6g} to {high:.6g}")
    return f"{what} allows gains of {' or '.join(texts)}"
