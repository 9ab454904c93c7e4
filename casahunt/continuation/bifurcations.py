"""Where the multipliers of a cycle meet the unit circle, as monitors (special_points.py).

    fold               d lambda/d s = 0             a multiplier passes +1
    branch point       prod (mu_i - 1) = 0          a multiplier +1 where the parameter goes on: branches cross
    flip               prod (mu_i + 1) = 0          a multiplier -1: a cycle of twice the period branches off
    symmetry breaking  the same of half multipliers of a symmetric cycle: a pair of lopsided cycles branches off
    Neimark-Sacker     prod (mu_i mu_j - 1) = 0     a complex pair on the circle: a torus branches off

The products run over the nontrivial multipliers, i < j; their factors are divided by their sizes, so that multipliers
of 1e10 do not drown the one that counts.  A real pair whose product is 1 is no bifurcation; what is located is looked
at again.

The sign of a product is sure where each factor is larger than the error of its multipliers (in units of 1, or of their
size), that of d lambda/d s where it is larger than the error of lambda: next to an orbit that takes for ever, and along
a canard, lambda has come to rest, and its slope is rounding.
"""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import combinations

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


def _product(factors: Array, sizes: Array) -> float:
    return float(np.prod(factors / (1 + sizes)).real) if np.isfinite(sizes).all() else math.nan


def _passes(at: float, kind: str, meaning: str) -> Monitor:
    """The monitor of a multiplier that passes `at`."""

    def value(orbit: Orbit, point: CurvePoint) -> float:
        mu = _nontrivial(orbit)
        return _product(mu - at, np.abs(mu))

    def sure(orbit: Orbit, point: CurvePoint) -> bool:
        return bool(np.all(np.abs(_nontrivial(orbit) - at) > _errors(orbit)))

    sentence = f"{kind} at {{name}} = {{value:.10g}}: {meaning}"
    return Monitor(kind, value, sentence, sure=sure, by_multipliers=True, multiplier=at)


def _pairs(orbit: Orbit) -> list[tuple[complex, complex]]:
    return list(combinations(_nontrivial(orbit), 2))


def _products(orbit: Orbit) -> Array:
    return np.array([a * b for a, b in _pairs(orbit)], complex)


def _pair_on_the_circle(orbit: Orbit, point: CurvePoint) -> float:
    products = _products(orbit)
    return _product(products - 1, np.abs(products))


def _off_the_circle(orbit: Orbit, point: CurvePoint) -> bool:
    sizes = np.maximum(1.0, np.abs(_nontrivial(orbit)))
    errors = np.array([a * e + b * d for (a, b), (d, e) in zip(
        combinations(sizes, 2), combinations(_errors(orbit), 2), strict=True)])  # fmt: skip
    return bool(np.all(np.abs(_products(orbit) - 1) > errors))


def _slope_is_sure(orbit: Orbit, point: CurvePoint) -> bool:
    return abs(float(point.row[-1])) > NOISE_OF_SLOPE * orbit.error_estimate


def pair_of(orbit: Orbit) -> tuple[complex, complex]:
    """The two nontrivial multipliers whose product is nearest to 1; zeros where there are no two."""
    return min(_pairs(orbit), key=lambda pair: abs(pair[0] * pair[1] - 1), default=(0j, 0j))


def _is_complex(orbit: Orbit) -> bool:
    return abs(pair_of(orbit)[0].imag) > COMPLEX


TURN = replace(FOLD, sure=_slope_is_sure)
BRANCH_POINT = _passes(
    1.0, "branch point", "a multiplier passes +1 while {name} goes on, and another branch of cycles crosses this one"
)
FLIP = _passes(-1.0, "flip", "a cycle of twice the period branches off")
SYMMETRY_LOST = _passes(-1.0, "symmetry breaking", "a pair of lopsided cycles branches off")
NEIMARK_SACKER = Monitor(
    "Neimark-Sacker", _pair_on_the_circle, "Neimark-Sacker at {name} = {value:.10g}: a torus branches off",
    sure=_off_the_circle, confirmed=_is_complex, by_multipliers=True,
)  # fmt: skip


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
