"""Where the multipliers of a cycle meet the unit circle, as monitors (special_points.py).

    fold               d lambda/d s = 0             a multiplier passes +1
    flip               prod (mu_i + 1) = 0          a multiplier -1: a cycle of twice the period branches off
    symmetry breaking  the same of half multipliers of a symmetric cycle: a pair of lopsided cycles branches off
    Neimark-Sacker     prod (mu_i mu_j - 1) = 0     a complex pair on the circle: a torus branches off

The products run over the nontrivial multipliers, i < j; their factors are divided by their sizes, so that multipliers
of 1e10 do not drown the one that counts.  A real pair whose product is 1 is no bifurcation; what is located is looked
at again.  Multipliers that are not trusted have no sign.  Where lambda has come to rest, as it does next to an orbit
that takes for ever, d lambda/d s is rounding and changes its sign at will: without a multiplier that passes +1 that is
no fold.
"""

from __future__ import annotations

from dataclasses import replace
from itertools import combinations

import numpy as np

from ..orbits.orbit import Orbit
from .curve import Point
from .special_points import FOLD, Monitor

Array = np.ndarray

COMPLEX = 1e-6
"""A pair of multipliers with less imaginary part than this is real."""
AT_ONE = 1e-6
"""A multiplier this close to 1 may be on either side of it."""
NOISE_OF_SLOPE = 10.0
"""d lambda/d s is known to so many errors of lambda, a step being of the order of one ..."""
LASTS = 0.01
"""... and is believed below that where the logarithm of the period changes by less than this."""


def _nontrivial(orbit: Orbit) -> Array:
    """Half multipliers but for the trivial one; of a full cycle those of the period."""
    return orbit.multipliers.half[1:] if orbit.multipliers.trusted else np.full(1, np.nan)


def _minus_one(orbit: Orbit, point: Point) -> float:
    mu = _nontrivial(orbit)
    return float(np.prod((mu + 1) / (1 + np.abs(mu))).real)


def _pairs(orbit: Orbit) -> list[tuple[complex, complex]]:
    return list(combinations(_nontrivial(orbit), 2))


def _pair_on_the_circle(orbit: Orbit, point: Point) -> float:
    if not orbit.multipliers.trusted:
        return float("nan")
    products = np.array([a * b for a, b in _pairs(orbit)])
    return float(np.prod((products - 1) / (1 + np.abs(products))).real) if products.size else 1.0


def _is_complex(orbit: Orbit) -> bool:
    if not (pairs := _pairs(orbit)):
        return False
    a, _ = min(pairs, key=lambda pair: abs(pair[0] * pair[1] - 1))
    return abs(a.imag) > COMPLEX


def _one_is_passed(before: Orbit, here: Point, after: Orbit, there: Point) -> bool:
    """Whether a multiplier goes through +1 from one orbit to the next, as far as one can tell."""
    off = [_nontrivial(orbit) - 1 for orbit in (before, after)]
    if all(np.min(np.abs(mu), initial=np.inf) > AT_ONE for mu in off):
        return bool(np.prod([np.prod(mu / np.abs(mu)).real for mu in off]) < 0)
    # Not trusted, or next to the point itself: a slope that is no larger than the error of lambda has no sign.
    known = NOISE_OF_SLOPE * max(before.parameter_error, after.parameter_error)
    sure = min(abs(here.row[-1]), abs(there.row[-1])) > known
    return bool(sure or abs(np.log(after.period / before.period)) < LASTS)


TURN = replace(FOLD, passed=_one_is_passed)
FLIP = Monitor(
    "flip", _minus_one, "flip at {name} = {value:.10g}: a cycle of twice the period branches off", tolerance=1e-9
)
SYMMETRY_LOST = Monitor(
    "symmetry breaking", _minus_one,
    "symmetry breaking at {name} = {value:.10g}: a pair of lopsided cycles branches off",
)  # fmt: skip
NEIMARK_SACKER = Monitor(
    "Neimark-Sacker", _pair_on_the_circle, "Neimark-Sacker at {name} = {value:.10g}: a torus branches off",
    confirmed=_is_complex,
)  # fmt: skip


def monitors_of(orbit: Orbit) -> tuple[Monitor, ...]:
    """What is looked for along a branch of any system: symmetric cycles lose their symmetry, others flip."""
    return TURN, SYMMETRY_LOST if orbit.repeats == 2 else FLIP, NEIMARK_SACKER
