"""Where a polynomial on [0, 1] first goes from below zero to above."""

from __future__ import annotations

import math
from functools import lru_cache

import numpy as np

from ...roots import LOOKED_AT, MOST_HALVINGS, Bracket

Array = np.ndarray

ON_ITS_ZERO = 1e-14
"""A polynomial, of order one, that is so near to zero at its start begins on it."""


def first_rise(polynomial: Array) -> float:
    """The first place in [0, 1] at which a polynomial, by its coefficients, goes from below zero to above; inf: none.

    0 where it begins above zero, or on it and rises.  It is looked at in sixteen parts, and at its tops.
    """
    values = _places(polynomial.size) @ polynomial
    if values[0] > ON_ITS_ZERO:
        return 0.0
    begins = 0
    if abs(values[0]) <= ON_ITS_ZERO:
        moves = np.flatnonzero(values[1:])
        if not moves.size or values[1 + moves[0]] > 0:
            return 0.0 if moves.size else math.inf
        begins = 1 + int(moves[0])
    above = np.flatnonzero(values[begins + 1 :] >= 0)
    last = begins + 1 + int(above[0]) if above.size else values.size
    inner = values[begins : last + 1]
    for k in begins + 1 + np.flatnonzero((inner[1:-1] > inner[:-2]) & (inner[1:-1] > inner[2:])):
        top = _top(polynomial, LOOKED_AT[k - 1], LOOKED_AT[k + 1])
        if k < last and _value(polynomial, top) > 0:
            return _zero(polynomial, LOOKED_AT[k - 1], top)
    return math.inf if last == values.size else _zero(polynomial, LOOKED_AT[last - 1], LOOKED_AT[last])


@lru_cache(maxsize=8)
def _places(size: int) -> Array:
    return np.vander(LOOKED_AT, size, increasing=True)


def _value(polynomial: Array, place: float) -> float:
    return float(place ** np.arange(polynomial.size) @ polynomial)


def _top(polynomial: Array, low: float, high: float) -> float:
    """Where a polynomial is largest, which rises at the one place and falls at the other."""
    slope = polynomial[1:] * np.arange(1, polynomial.size)
    a, b = _value(slope, low), _value(slope, high)
    return _zero(-slope, low, high) if a > 0 > b else low if a <= 0 else high


def _zero(polynomial: Array, low: float, high: float) -> float:
    """The zero of a polynomial that is below zero at one place and above at the next."""
    f_low, f_high = _value(polynomial, low), _value(polynomial, high)
    if not f_low < 0 < f_high:
        return low if f_low >= 0 else high
    bracket, place = Bracket(low, f_low, high, f_high), low + (high - low) * f_low / (f_low - f_high)
    coefficients = polynomial.tolist()
    for _ in range(MOST_HALVINGS):
        value = slope = 0.0
        for coefficient in reversed(coefficients):
            slope = slope * place + value
            value = value * place + coefficient
        if value == 0:
            break
        bracket = bracket.told(place, value)
        following = bracket.newton(place, value, slope)
        if following == place or bracket.width <= np.spacing(high):
            break
        place = following
    return place
