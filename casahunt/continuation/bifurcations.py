"""Where the multipliers of a cycle meet the unit circle, as monitors (special_points.py).

    fold               d lambda/d s = 0        a multiplier passes +1
    branch point       x_k = 1, x = Re mu      a multiplier +1 where the parameter goes on: branches cross
    flip               x_k = 1, x = -Re mu     a multiplier -1: a cycle of twice the period branches off
    symmetry breaking  the same of half multipliers of a symmetric cycle: a pair of lopsided cycles branches off
    Neimark-Sacker     x_k = 1, x = |mu|       a complex pair on the circle: a torus branches off

x_k is the k-th largest x of the nontrivial multipliers.  Sorted, they are continuous along a branch whatever the
multipliers do, and where r more of them are beyond 1 than before, r of the x_k have passed it: two that do so at once
are seen as one is, and of |mu| none leaves the circle unseen.  One that leaves while another one enters at the same
real place makes x_k turn back next to 1: lines from both sides show it (stations.py); where both do so at one place, or
two pairs, that is missed, and said.

The value is (x - 1)/(1 + |x|), which does not drown in multipliers of 1e10.  Re mu of a complex pair passes 1 where
nothing happens, |mu| of a real one where another monitor does: what is located is looked at again.  Along a curve in
two parameters nobody need count, and a smooth function serves: prod (mu_i + 1), or mu_i mu_j - 1 of the nearest pair,
which goes on where the two become real.

The sign of a value is sure where it is larger than the error of its multiplier (in units of 1, or of its size), that of
d lambda/d s where it is larger than the error of lambda: next to an orbit that takes for ever, and along a canard,
lambda has come to rest, and its slope is rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace
from functools import lru_cache
from itertools import combinations
from typing import NamedTuple

import numpy as np

from ..orbits.orbit import Orbit
from .curve import CurvePoint
from .special_points import FOLD, Monitor

Array = np.ndarray

COMPLEX = 1e-6
"""A pair of multipliers with less imaginary part than this is real."""
NOISE_OF_SLOPE = 100.0
"""d lambda/d s is known to so many errors of lambda, a step being of the order of one."""


def _nontrivial(orbit: Orbit) -> Array:
    """Half multipliers but for the trivial one; of a full cycle those of the period."""
    return orbit.multipliers.half[1:]


def _errors(orbit: Orbit) -> Array:
    """Of the nontrivial multipliers: that of the leading one, relative above 1, or the bound that stands for one."""
    known = orbit.multipliers
    return np.maximum(known.error * np.maximum(1.0, np.abs(_nontrivial(orbit))), known.floor[1:])


class Ranked(NamedTuple):
    """The nontrivial multipliers mu (m,) by decreasing x (m,), and their errors (m,)."""

    x: Array
    errors: Array
    mu: Array

    def values(self) -> Array:
        """(m,) what vanishes where x passes 1."""
        return np.asarray((self.x - 1) / (1 + np.abs(self.x)))


@lru_cache(maxsize=64)  # each of them is asked for by the monitor of every rank
def _ranked(orbit: Orbit, x: Callable[[Array], Array]) -> Ranked:
    mu, errors = _nontrivial(orbit), _errors(orbit)
    order = np.argsort(-x(mu), kind="stable")
    return Ranked(x(mu)[order], errors[order], mu[order])


def _passes(
    kind: str, meaning: str, x: Callable[[Array], Array], *, turns: bool = False, at: float = math.nan
) -> Monitor:
    """The monitor of the multipliers whose x passes 1: real ones, which are `at` that place then, or pairs that turn.

    Its own value is that of the one that is nearest.
    """

    def of_rank(k: int | None) -> Monitor:
        def ranked(orbit: Orbit) -> tuple[float, float, float]:
            """The value, its error, and the imaginary part of the multiplier."""
            found = _ranked(orbit, x)
            if not found.x.size:
                return 1.0, 0.0, 0.0
            values = found.values()
            one = int(np.argmin(np.where(np.isnan(values), np.inf, np.abs(values)))) if k is None else k
            error = 2 * found.errors[one] / (1 + abs(found.x[one])) ** 2
            return float(values[one]), float(error), float(found.mu[one].imag)

        return Monitor(
            kind, lambda orbit, point: ranked(orbit)[0], f"{kind} at {{name}} = {{value:.10g}}: {meaning}",
            noise=lambda orbit: ranked(orbit)[1], confirmed=lambda orbit: turns == (abs(ranked(orbit)[2]) > COMPLEX),
            by_multipliers=True, multiplier=at, each=each if k is None else lambda orbit: (),
        )  # fmt: skip

    def each(orbit: Orbit) -> tuple[Monitor, ...]:
        return tuple(of_rank(k) for k in range(orbit.scale.size - 1))

    return of_rank(None)


def _slope_is_sure(orbit: Orbit, point: CurvePoint) -> bool:
    return abs(float(point.row[-1])) > NOISE_OF_SLOPE * orbit.error_estimate


def pair_of(orbit: Orbit) -> tuple[complex, complex]:
    """The two nontrivial multipliers whose product is nearest to 1; zeros where there are no two."""
    pairs = combinations(_nontrivial(orbit), 2)
    return min(pairs, key=lambda pair: abs(pair[0] * pair[1] - 1), default=(0j, 0j))


def _product(orbit: Orbit, point: CurvePoint) -> float:
    mu = _nontrivial(orbit)
    return float(np.prod((mu + 1) / (1 + np.abs(mu))).real)


def _of_a_pair(orbit: Orbit, point: CurvePoint) -> float:
    a, b = pair_of(orbit)
    return float(((a * b - 1) / (1 + abs(a * b))).real)


def _is_complex(orbit: Orbit) -> bool:
    return abs(pair_of(orbit)[0].imag) > COMPLEX


TURN = replace(FOLD, sure=_slope_is_sure)
BRANCH_POINT = _passes(
    "branch point", "a multiplier passes +1 while {name} goes on, and another branch of cycles crosses this one",
    np.real, at=1.0,
)  # fmt: skip
FLIP = replace(
    _passes("flip", "a cycle of twice the period branches off", lambda mu: -mu.real, at=-1.0), value=_product
)
SYMMETRY_LOST = replace(
    _passes("symmetry breaking", "a pair of lopsided cycles branches off", lambda mu: -mu.real, at=-1.0), value=_product
)
NEIMARK_SACKER = replace(
    _passes("Neimark-Sacker", "a torus branches off", np.abs, turns=True), value=_of_a_pair, confirmed=_is_complex
)


def monitors_of(orbit: Orbit) -> tuple[Monitor, ...]:
    """What is looked for along a branch of any system: symmetric cycles lose their symmetry, others flip.

    Examples
    --------
    >>> from casahunt.continuation import monitors_of
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> [monitor.kind for monitor in monitors_of(orbit)]
    ['fold', 'branch point', 'flip', 'Neimark-Sacker']
    """
    return TURN, BRANCH_POINT, SYMMETRY_LOST if orbit.repeats == 2 else FLIP, NEIMARK_SACKER
