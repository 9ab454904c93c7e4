"""The linear loops of a set of loops of parts, by their response: what loop_set.py has of one inertia in closed form.

    ln kappa(omega) = -ln |L_1|,    phi(omega) = arg L_1 + pi - omega D - omega T,    L_1 at K cm = 1 N m/rad

along omega, for the corners of the box and points inside of it: at ln kappa the loop crosses where ln kappa(omega) is
that, interpolated to 1e-5 rad.  The phase goes on from its principal value where omega is smallest, so that phi > 0 at
every crossover is enough for a stable loop.  A sample time T delays by itself, half of it in the hold, half in a
difference of two readings; the checks have the loop as its drive runs it (check.py).
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping

import numpy as np

from ...servo.linear.margins import frequencies_of
from ...servo.linear.open_loop import either_way, open_loop
from ...servo.linear.sampled_loop import Lag
from ...servo.parts.loop import Loop
from .loop_set import LoopBox, WorstLoop

Array = np.ndarray

CORNERS_SEEN, INSIDE = 64, 32
"""Corners of the box, drawn where there are more, and points inside of it: each costs a response, 2 ms."""


def parts_box(loop: Loop, bounds: Mapping[str, tuple[float, float]], lag: Lag) -> LoopBox:
    """The loops of parts of a loop with some parameters in intervals: at points of them, the motor gain left to kappa.

    bounds: (low, high) by parameter; lag: sampling and delay. Raises InputError: one of them is not linear.
    """

    def told(name: str, end: float) -> list[tuple[list[float], list[float]]]:
        opened = (open_loop(way, 1.0) for way in either_way(loop.replace(**{name: float(end)})).values())
        return [(each.numerator.tolist(), each.denominator.tolist()) for each in opened]

    # Of two points alone it is seen whether a parameter matters to the linear loop at all: friction does not.
    names = [name for name in bounds if name not in ("motor_gain", "gain")]
    names = [name for name in names if told(name, bounds[name][0]) != told(name, bounds[name][1])]
    motor = bounds.get("motor_gain", (loop.parameters.get("motor_gain", 1.0),) * 2)
    low, high = np.array([*(bounds[name] for name in names), motor], float).T
    random = np.random.default_rng(np.random.SeedSequence(2))
    size, own = len(names), [[loop.value(name) for name in names]] if names else [[]]
    if 2**size <= CORNERS_SEEN:
        picks = np.array(list(itertools.product((0.0, 1.0), repeat=size))).reshape(2**size, size)
    else:
        picks = random.integers(0, 2, (CORNERS_SEEN, size)).astype(float)
    picks = np.vstack([picks, random.random((INSIDE if size else 0, size))])
    rows = low[:-1] + (high - low)[:-1] * picks
    if bool(np.all((low[:-1] <= own) & (own <= high[:-1]))):
        rows = np.vstack([own, rows]) if size else rows
    ways = [either_way(loop.replace(**dict(zip(names, row.tolist(), strict=True)))) for row in rows]
    curves: list[tuple[Array, Array]] = []
    at_one = {name: 1.0 for name in ("gain", "motor_gain") if name in loop.parameters}
    for each in (each for way in ways for each in way.values()):
        opened = open_loop(each.replace(**at_one))
        omega = frequencies_of(opened)
        L = opened.response(omega)
        phi = np.unwrap(np.angle(-L)) - omega * (lag.delay + 2 * lag.half)
        curves.append((-np.log(np.abs(L)), phi))
    rows = np.repeat(np.array(rows, float), [len(way) for way in ways], axis=0)

    def worst(gain: float, factors: tuple[float, float]) -> WorstLoop:
        first, last = (math.log(gain * g * cm) for g, cm in zip(factors, motor, strict=True))
        least = math.inf, 0, first
        for i, (kappa, phi) in enumerate(curves):
            inside = np.flatnonzero((first <= kappa) & (kappa <= last))
            found = [(float(phi[k]), i, float(kappa[k])) for k in inside[np.argsort(phi[inside])[:1]]]
            for end in (first, last):
                at = np.flatnonzero((kappa[:-1] < end) != (kappa[1:] < end))
                part = (end - kappa[at]) / (kappa[at + 1] - kappa[at])
                found += [(float(value), i, end) for value in phi[at] + part * (phi[at + 1] - phi[at])]
            least = min([least, *found])
        phase, i, kappa_there = least
        return WorstLoop(phase, dict(zip(names, rows[i].tolist(), strict=True)), math.exp(kappa_there))

    return LoopBox((*names, "motor_gain"), low, high, worst, lambda x: curves)
