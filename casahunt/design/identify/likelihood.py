"""The likelihood of positions that carry noise and were rounded, and its slopes.

    y_i = q round((x_i + sigma w_i)/q),  w_i standard normal and independent:
    log P_i = log(Phi(b_i) - Phi(a_i)),   a_i, b_i = (y_i - x_i -+ q/2)/sigma

and for q = 0 log P_i = -(y_i - x_i)^2/2 sigma^2 - log sigma.  So the counts of an encoder count for what they say: that
the position lay within them.  As an error of variance q^2/12 the rounding of a position that rests would be taken for
many independent errors, though it is one.  log P is concave in x: Newton's method climbs it.

    s_i = d log P_i/dx,   c_i = -d^2 log P_i/dx^2 >= 0,   s_i = (phi(a) - phi(b))/(sigma P),
    c_i = s_i^2 + (b phi(b) - a phi(a))/(sigma^2 P)

log Phi and its slope are those of a table (cubic Hermite), made of math.erfc.

Symbols: m samples, x positions of the model [rad], y those of the record [rad], q quantum [rad], sigma noise [rad].
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cache
from typing import NamedTuple

import numpy as np

from ...roots import golden

Array = np.ndarray

TABLE_ENDS, TABLE_STEP = (-37.0, 9.0), 0.01
"""erfc underflows below; above, Phi is one.  The interpolation error is step^4/384, 3e-11."""
LEAST_NOISE = 0.005
"""Noise in units of the quantum below which it is not told from none: samples that rest this near to a border of their
count would speak against their model.  Two rests are as near as three times that in 6 % of records without noise."""
FINE_COUNTS = 2.0
"""Noise in units of the quantum from which on rounding is one error more, to 1e-6 of the information: a sum over all
counts that it reaches takes minutes where a file's decimals are the quantum, and what a fit leaves is the noise."""
NOISE_KNOWN, NOISE_SPAN = 1e-3, 1e-3
"""Width in log sigma to which it is known; and the size that is stated, in units of the largest one looked at."""


class Slopes(NamedTuple):
    """Of samples (m,): log P, its derivative by x, and minus the second one."""

    value: Array
    score: Array
    curvature: Array


class Rows(NamedTuple):
    """Values (m,) that are compared with data, and what they add to the deviance: that of their own, its score, which
    is minus half its slope by the values, and half its curvature by each.  J (m, u): derivatives by u unknowns."""

    deviance: float
    values: Array
    score: Array
    weights: Array
    J: Array


@dataclass(frozen=True)
class Noise:
    """Standard deviation sigma of the noise [rad], and the quantum q of the rounding [rad], 0 where there is none."""

    sigma: float
    quantum: float

    @property
    def variance(self) -> float:
        """Of a sample, where rounding is an independent error [rad2]."""
        return self.sigma**2 + self.quantum**2 / 12

    @property
    def plain(self) -> Noise:
        """As if rounding were an independent error: no counts, between whose borders nothing leads anywhere."""
        return Noise(math.sqrt(self.variance), 0.0)

    def slopes(self, y: Array, x: Array) -> Slopes:
        """log P of samples y where the position is x, and its derivatives by x."""
        r = y - x
        if self.quantum == 0:
            value = -0.5 * (r / self.sigma) ** 2 - math.log(self.sigma)
            return Slopes(value, r / self.sigma**2, np.full(r.shape, self.sigma**-2))
        # Mirrored so that the nearer border is b < 0: differences keep their digits.
        side = np.where(r > 0, -1.0, 1.0)
        half, middle = self.quantum / 2 / self.sigma, side * r / self.sigma
        a, b = middle - half, middle + half
        la, lb = log_phi(a), log_phi(b)
        value = lb + np.log(-np.expm1(np.minimum(la - lb, -1e-300)))
        da, db = (np.exp(-0.5 * z**2 - 0.5 * math.log(2 * math.pi) - value) for z in (a, b))
        score = side * (da - db) / self.sigma
        curvature = score**2 + (b * db - a * da) / self.sigma**2
        return Slopes(value, score, np.maximum(curvature, 0.0))

    def deviance(self, y: Array, x: Array) -> float:
        """-2 log P of all samples."""
        return -2 * float(np.sum(self.slopes(y, x).value))

    def information(self, x: Array, offset: float = 0.0) -> Array:
        """(m,) expected squares of the score at positions x, whose counts lie at q k + offset [1/rad2]."""
        if self.quantum == 0:
            return np.full(x.shape, self.sigma**-2)
        if self.sigma > FINE_COUNTS * self.quantum:
            return np.full(x.shape, 1 / self.variance)
        nearest = np.round((x - offset) / self.quantum)
        total = np.zeros(x.shape)
        reach = 1 + math.ceil(5 * self.sigma / self.quantum)
        for k in range(-reach, reach + 1):
            found = self.slopes(offset + (nearest + k) * self.quantum, x)
            total += np.exp(found.value) * found.score**2
        return total


def likeliest(y: Array, x: Array, quantum: float, size: float) -> Noise:
    """The noise under which the samples are likeliest.

    size: [rad] about that of the noise; a factor of a thousand to both sides is looked at.
    """
    if quantum == 0:
        return Noise(math.sqrt(max(float(np.mean((y - x) ** 2)), (1e-6 * size) ** 2)), 0.0)
    low, high = math.log(LEAST_NOISE * quantum), math.log(max(size / NOISE_SPAN, 2 * LEAST_NOISE * quantum))
    about = golden(lambda s: Noise(math.exp(s), quantum).deviance(y, x), low, high, NOISE_KNOWN)
    return Noise(math.exp(sum(about) / 2), quantum)


def log_phi(z: Array) -> Array:
    """log Phi(z) of the normal distribution."""
    values, slopes = _table()
    low, high = TABLE_ENDS
    s = (np.clip(z, low, high) - low) / TABLE_STEP
    i = np.minimum(s.astype(int), values.size - 2)
    u = s - i
    left, right = values[i], values[i + 1]
    found = left + (right - left) * u * u * (3 - 2 * u)
    found += TABLE_STEP * u * (1 - u) * ((1 - u) * slopes[i] - u * slopes[i + 1])
    far = z < low
    if far.any():
        t = z[far]
        found[far] = -0.5 * t * t - np.log(-t) - 0.5 * math.log(2 * math.pi) - 1 / (t * t)
    return np.asarray(found)


@cache
def _table() -> tuple[Array, Array]:
    low, high = TABLE_ENDS
    z = np.linspace(low, high, round((high - low) / TABLE_STEP) + 1)
    values = np.array([math.log(math.erfc(-t / math.sqrt(2)) / 2) for t in z])
    return values, np.exp(-0.5 * z**2 - 0.5 * math.log(2 * math.pi) - values)
