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
from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from ...servo.linear.margins import frequencies_of
from ...servo.linear.open_loop import open_loop
from ...servo.linear.sampled_loop import Lag
from ...servo.parts.loop import Loop
from .loop_set import WorstLoop

Array = np.ndarray

CORNERS_SEEN, INSIDE = 64, 32
"""Corners of the box, drawn where there are more, and points inside of it: each costs a response, 2 ms."""


@dataclass(frozen=True, eq=False)
class PartsBox:
    """Loops of parts whose parameters lie in intervals.

    Attributes
    ----------
    names : the parameters that are not the same in all of them, and the motor gain.
    low, high : (names,) bounds.
    points : (m, names) those that are looked at; the motor gain of each is left to kappa.
    curves : (ln kappa, phi) along the frequency, of each.
    """

    names: tuple[str, ...]
    low: Array
    high: Array
    points: Array
    curves: tuple[tuple[Array, Array], ...]

    def worst(self, gain: float, factors: tuple[float, float] = (1.0, 1.0)) -> WorstLoop:
        """The loop of least phase, with the gain [V/rad] multiplied by anything between two factors."""
        low, high = (math.log(gain * g * cm) for g, cm in zip(factors, (self.low[-1], self.high[-1]), strict=True))
        least = math.inf, 0, low
        for i, (kappa, phi) in enumerate(self.curves):
            inside = np.flatnonzero((low <= kappa) & (kappa <= high))
            found = [(float(phi[k]), i, float(kappa[k])) for k in inside[np.argsort(phi[inside])[:1]]]
            for end in (low, high):
                at = np.flatnonzero((kappa[:-1] < end) != (kappa[1:] < end))
                part = (end - kappa[at]) / (kappa[at + 1] - kappa[at])
                found += [(float(value), i, end) for value in phi[at] + part * (phi[at + 1] - phi[at])]
            least = min([least, *found])
        phase, i, kappa_there = least
        values = dict(zip(self.names[:-1], self.points[i, :-1].tolist(), strict=True))
        return WorstLoop(phase, values, math.exp(kappa_there))

    def along(self, x: Array) -> Iterator[tuple[Array, Array]]:
        """The curves, which are known whatever ln kappa (m,) is asked about."""
        yield from self.curves


def parts_box(loop: Loop, bounds: Mapping[str, tuple[float, float]], lag: Lag) -> PartsBox:
    """The loops of parts of a loop with some parameters in intervals.

    bounds: (low, high) by parameter; lag: sampling and delay. Raises InputError: one of them is not linear.
    """
    # Of two points alone it is seen whether a parameter matters to the linear loop at all: friction does not.
    names = [name for name, ends in bounds.items() if name not in ("motor_gain", "gain") and _matters(loop, name, ends)]
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
    motors = np.full((len(rows), 1), motor[1])
    curves = tuple(_curve(loop.replace(**dict(zip(names, row.tolist(), strict=True))), lag) for row in rows)
    return PartsBox((*names, "motor_gain"), low, high, np.hstack([rows, motors]), curves)


def _matters(loop: Loop, name: str, ends: tuple[float, float]) -> bool:
    one, other = (open_loop(loop.replace(**{name: float(end)}), 1.0) for end in ends)
    return not (np.array_equal(one.numerator, other.numerator) and np.array_equal(one.denominator, other.denominator))


def _curve(loop: Loop, lag: Lag) -> tuple[Array, Array]:
    """(ln kappa, phi) along the frequency."""
    at_one = {name: 1.0 for name in ("gain", "motor_gain") if name in loop.parameters}
    opened = open_loop(loop.replace(**at_one))
    omega = frequencies_of(opened)
    L = opened.response(omega)
    return -np.log(np.abs(L)), np.unwrap(np.angle(-L)) - omega * (lag.delay + 2 * lag.half)
