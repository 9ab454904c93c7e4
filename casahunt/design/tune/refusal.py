"""What is in the way of a tuning: which demand stands against which, in gains.

At given times each demand is a set of gains: K >= (1 + margin) K_b of the hunting margin, intervals of each demand on
the linear loops (loop_set.py), the bounds.  The smallest number of them without a gain in common is in the way.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from ...servo.controller import Pid
from ..nearby import said
from ..uncertainty.worst_corner import WorstCase
from .best_gain import Given
from .demands import DEMANDS, Demands, controller_said
from .loop_set import Intervals, Table, allowed, common
from .tasks import TASK_STEPS

Array = np.ndarray

WIDER = 100.0
"""How far beyond the gains that matter the demands are looked at."""


def refusal(
    given: Given, q: Array, worst: WorstCase, *, times: int = 0, missed: float = 0.0, proven: bool = True
) -> str:
    """What cannot be met, or was not found, and which demand stands against which.

    q, worst: ln of the times [s] that come nearest to what is asked for, and the worst servo there; times, missed: with
    free times: how many pairs were looked at, and v at the nearest one; proven: whether they are evidence that there
    are none.
    """
    servo, demands, boxes = given.at(q), given.demands, given.boxes(q)
    needed, bounds = (1 + demands.margin) * worst.gain, given.limits.get("gain")
    low, high = given.gains(needed, servo)
    table = Table(boxes, demands, min(low, needed or math.inf) / WIDER, max(high, needed) * WIDER)
    asked = {
        "hunting margin": (
            [(needed, math.inf)],
            f"the hunting margin of {100 * demands.margin:g} % asks for a gain of at least {needed:.6g} (the fold gain "
            f"is {worst.gain:.6g}{f' at {said(worst.corner)}' if worst.corner else ''})",
        )
    }
    for name in DEMANDS:
        sets = allowed(boxes, demands, table, name)
        asked[name] = sets, _of_a_loop(name, sets, demands, table)
    if math.isfinite(demands.max_torque):
        most = given.largest_gain(servo)
        takes = f"; {needed:.6g} takes {needed * given.first_torque(servo):.4g} N m" if needed > most else ""
        asked["largest torque"] = [(0.0, most)], (
            f"the largest torque of {demands.max_torque:g} N m on a step of {max(TASK_STEPS):g} rad allows gains of at "
            f"most {most:.6g}{takes}, and what ends hunting with less torque is told by casahunt remedies"
        )
    if bounds is not None:
        asked["bounds"] = [bounds], f"the bounds of the gain allow {bounds[0]:g} to {bounds[1]:g}"
    ways = "; ".join(asked[name][1] for name in _against_each_other({name: each[0] for name, each in asked.items()}))
    if not given.free:
        return f"the tuning cannot be met; in the way: {ways}"
    what = "controllers" if isinstance(servo.controller, Pid) else "pairs of controller times"
    evidence = f"{times} {what} between the bounds were tried"
    if proven:
        head = f"the tuning cannot be met: {evidence}, and what is missing is everywhere more than it varies in between"
    else:
        head = f"a tuning that meets the demands was not found: {evidence}"
    amount = ""
    if missed > 0:
        amount = f", where {100 * math.expm1(missed):.3g} % of gain or {math.degrees(missed):.3g} degrees are missing"
    return f"{head}; nearest at {controller_said(servo)}{amount}; there in the way: {ways}"


def _against_each_other(sets: dict[str, Intervals]) -> tuple[str, ...]:
    """Those of the demands that make up the smallest groups without a common gain; all of them where none does."""
    for n in range(1, len(sets) + 1):
        groups = [names for names in itertools.combinations(sets, n) if not common([sets[name] for name in names])]
        if groups:
            return tuple(name for name in sets if any(name in group for group in groups))
    return tuple(sets)


def _of_a_loop(name: str, sets: Intervals, demands: Demands, table: Table) -> str:
    """The gains that one of `DEMANDS` allows, in words."""
    late = {"a delay of": demands.delay, "samples of": demands.sample_time}
    lag = " and ".join(f"{words} {size:g} s" for words, size in late.items() if size)
    lag = f" with {lag}" if lag else ""
    what = f"the gain margin of {demands.gain_margin:g} when the gain {'falls' if name == DEMANDS[1] else 'rises'}{lag}"
    if name == DEMANDS[0]:
        what = f"the phase margin of {demands.phase_margin:g} degrees{lag}"
    if not sets:
        row = table.missed[DEMANDS.index(name)]
        i = int(np.argmin(row))
        best = math.degrees(demands.least(name) - float(row[i]))
        margin = f"the smallest phase margin is {best:.4g} degrees at best, at gain {table.gains[i]:.4g}"
        return f"{what} is kept at no gain ({margin})"
    texts = [
        f"at most {high:.6g}" if low == 0 else f"at least {low:.6g}" if high == math.inf else f"{low:.6g} to {high:.6g}"
        for low, high in sets
    ]
    return f"{what} allows gains of {' or '.join(texts)}"
