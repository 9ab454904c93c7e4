"""A motion as power series: each valid for a step, whose length its last coefficients tell.

    x(t_0 + h s) = sum over k = 0..P of C_k s^k,    0 <= s <= 1,    max over i of |C_k,i| <= theta for k = P - 1 and P

The last two, because every second one may vanish.  Besides, no term may exceed the size of the states: a step in which
it did would be longer than anything that the states do, and lose digits.  What lies within a step is known as well as
its end, so that an event is a root of a function of s alone, and a mesh is chosen when the motion is known:

    intervals in proportion to    (kappa |x^(d)(t)| / (d! tol))^(1/d),    kappa = (d!)^2/(2d)!

kappa h^d x^(d)/d! is the last Legendre coefficient of a polynomial of degree d on an interval of length h.

Symbols: n states, P order, K steps, d stages, N intervals of a mesh, R = n (d + 1).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import casadi as ca
import numpy as np

from ..collocation.ensemble_points import POINTS_TOGETHER
from ..collocation.interval import point_function
from ..collocation.scheme import Scheme
from ..compiled import Caller, caller, kept
from ..hybrid.system import Field
from ..roots import LOOKED_AT, MOST_HALVINGS
from .recursion import taylor_coefficients

Array = np.ndarray

SERIES_ORDER = 24
IN_A_ROW = 8
"""Steps that are taken before they are looked at: what leads beyond an event costs less than looking at each."""
AT_MOST_LONGER = 100.0
"""A step in units of the one before, at most."""
WITHIN_TOLERANCE = 0.75
"""Length of an interval of a mesh, in units of the one whose last coefficient is the tolerance."""
MOST_OF_STEPS, ONE_STEP = 2.0, 5e-9
"""Length of an interval in steps, at most; tolerance below which it is at most one.  Steps are short where neighbouring
motions part or meet fast, which the motion itself does not show, and where what is small changes fast."""
_PLACES = np.linspace(0, 1, 9)  # of a step, at which the lengths of intervals are chosen
_POWERS = np.arange(SERIES_ORDER + 1.0)


class TooMany(Exception):
    """A mesh needs more intervals than there may be."""


class Piece(NamedTuple):
    """Steps of a motion: (K,) times at which they begin, (K,) lengths, (K, P + 1, n) coefficients C, scaled."""

    began: Array
    lengths: Array
    C: Array


class Steps(NamedTuple):
    """Steps in a row.

    Attributes
    ----------
    h : (K,) lengths.
    C : (K, P + 1, n) coefficients of powers of s, scaled.
    ends : (K, n) states at their ends.
    """

    h: Array
    C: Array
    ends: Array


class Series:
    """The steps of one mode from any state, compiled: `IN_A_ROW` in a row."""

    def __init__(self, steps: Caller, one: Caller, many: Caller, sign: float, p: Array, scale: Array) -> None:
        self._steps, self._one, self._many, self._fixed = steps.buffers, one.buffers, many.buffers, (sign, p, scale)

    def __call__(self, x: Array, unit: float, longest: float, left: float, theta: float) -> Steps:
        """The next steps.

        x: (n,) scaled state; unit: a time that is neither much longer nor much shorter than a step; longest, left:
        longest that the first one may be, and all of them together.
        Returns steps; no number from where on a coefficient is none, of length 0 when the time is over.
        """
        for store, value in zip(self._steps.inputs, (x, (unit, longest, left, theta), *self._fixed), strict=True):
            store[:] = value
        self._steps.trigger()
        return Steps(*(out.copy() for out in self._steps.outputs))

    def defects(self, points: Array, rates: Array) -> Array:
        """By how much series contradict the field.

        points, rates: (K, looks, n) scaled states along steps, and their derivatives by time.
        Returns (K, looks) the largest differences of the states' rates.
        """
        buffers = self._one if len(points) == 1 else self._many
        store, *others = buffers.inputs
        store[: points.size // points.shape[2]] = points.reshape(-1, points.shape[2])
        for store, value in zip(others, self._fixed, strict=True):
            store[:] = value
        buffers.trigger()
        f = buffers.outputs[0][: points.size // points.shape[2]].reshape(rates.shape)
        return np.abs(rates - f).max(axis=2)


def _one_step(field: Field, n: int, parameters: int) -> ca.Function | None:
    """(x, unit, longest, left, theta, sign, p, scale) -> (h, C, end) of one step; None without a series."""
    function = taylor_coefficients(field, n, parameters, SERIES_ORDER)
    if function is None:
        return None
    x, unit, longest, left, theta = (ca.SX.sym(name, rows) for name, rows in zip(
        ("x", "unit", "longest", "left", "theta"), (n, 1, 1, 1, 1), strict=True))  # fmt: skip
    sign, p, scale = ca.SX.sym("sign"), ca.SX.sym("p", parameters), ca.SX.sym("scale", n)
    c = function(x, sign, p, scale, unit)
    sizes = ca.fmax(1, ca.fabs(x))
    largest = [ca.mmax(ca.fabs(c[:, k]) / sizes) for k in range(1, SERIES_ORDER + 1)]
    bounds = [1.0] * (SERIES_ORDER - 2) + [theta / ca.mmax(sizes)] * 2
    logarithm = ca.SX(math.log(sys.float_info.max))
    for k, (size, bound) in enumerate(zip(largest, bounds, strict=True), 1):
        logarithm = ca.fmin(logarithm, (ca.log(bound) - ca.log(size)) / k)
    h = ca.fmin(ca.fmin(unit * ca.exp(logarithm), longest), left)
    factor, columns = h / unit, [x]
    power = ca.SX(1)
    for k in range(1, SERIES_ORDER + 1):
        power = power * factor
        columns.append(c[:, k] * power)
    C = ca.horzcat(*columns)
    end = ca.mtimes(C, ca.DM.ones(SERIES_ORDER + 1))
    return ca.Function("step", [x, unit, longest, left, theta, sign, p, scale], [h, ca.densify(C), ca.densify(end)])


@kept(maxsize=64)
def _compiled(field: Field, n: int, parameters: int) -> tuple[Caller, Caller, Caller] | None:
    """`IN_A_ROW` steps in a row; the field where one step is looked at, and where all of them are."""
    step = _one_step(field, n, parameters)
    if step is None:
        return None
    x, first = ca.MX.sym("x", n), ca.MX.sym("first", 4)
    sign, p, scale = ca.MX.sym("sign"), ca.MX.sym("p", parameters), ca.MX.sym("scale", n)
    end, (unit, longest, left, theta) = x, ca.vertsplit(first)
    found: list[tuple[ca.MX, ...]] = []
    for _ in range(IN_A_ROW):
        h, C, end = step(end, unit, longest, left, theta, sign, p, scale)
        found.append((h, C, end))
        left, unit, longest = left - h, ca.fmax(h, sys.float_info.min), AT_MOST_LONGER * h
    outputs = [ca.horzcat(*columns) for columns in zip(*found, strict=True)]
    function = ca.Function("steps", [x, first, sign, p, scale], outputs)
    shapes = [IN_A_ROW, (IN_A_ROW, SERIES_ORDER + 1, n), (IN_A_ROW, n)]
    fields = []
    for count in (LOOKED_AT.size, IN_A_ROW * LOOKED_AT.size):
        looked_at = point_function(field, n, parameters).map("looks", "serial", count, [1, 2, 3], []).expand()
        fields.append(caller(looked_at, [(count, n), 1, parameters, n], [(count, n)]))
    return caller(function, [n, 4, 1, parameters, n], shapes), fields[0], fields[1]


def series_of(field: Field, sign: float, p: Array, scale: Array) -> Series | None:
    """The series along a field.

    p, scale: parameter vector; (n,) size of the states. Returns series; None where the field has none.
    """
    functions = _compiled(field, scale.size, p.size)
    return None if functions is None else Series(*functions, sign, p, scale)


def cut_off(C: Array, s: float) -> Array:
    """Coefficients of a step that ends at s of the longer one.

    C: (P + 1, n) coefficients; s: the place in the step that becomes its end. Returns (P + 1, n).
    """
    return C * (s**_POWERS)[:, None]


def series_value(C: Array, s: float) -> Array:
    """The value of a series at one place.

    C, s: (P + 1, n) coefficients; the place. Returns (n,) scaled state.
    """
    return (s**_POWERS) @ C


_LOOKED_AT = np.vander(LOOKED_AT, SERIES_ORDER + 1, increasing=True)
_RATES = np.hstack([np.zeros((LOOKED_AT.size, 1)), _LOOKED_AT[:, :-1] * _POWERS[1:]])


def looked_at(C: Array) -> tuple[Array, Array]:
    """Steps, looked at from their starts to their ends.

    C: (K, P + 1, n) coefficients. Returns (K, looks, n) scaled states, and their derivatives by the place s.
    """
    return np.matmul(_LOOKED_AT, C), np.matmul(_RATES, C)


@lru_cache(maxsize=16)
def _derivative(d: int) -> Array:
    """(places, P + 1): x^(d)/d! at places of a step from its coefficients."""
    out = np.zeros((_PLACES.size, SERIES_ORDER + 1))
    for k in range(d, SERIES_ORDER + 1):
        out[:, k] = math.comb(k, d) * _PLACES ** (k - d)
    return out


def most_in_a_step(d: int, tol: float) -> float:
    """A bound of the number of intervals in a step of which no coefficient exceeds one.

    d, tol: degree of the scheme; last Legendre coefficient of an interval.
    Returns as `meshed` has it, were the derivative at its end.
    """
    most = math.factorial(d) ** 2 / math.factorial(2 * d) * float(_derivative(d)[-1].sum()) / tol
    return max(most ** (1 / d) / WITHIN_TOLERANCE, 1.0)


def values_at(motion: Piece, times: Array) -> Array:
    """The motion at times.

    times: (m,). Returns (m, n) scaled states.
    """
    k = np.clip(np.searchsorted(motion.began, times, side="right") - 1, 0, len(motion.began) - 1)
    s = (times - motion.began[k]) / motion.lengths[k]
    out = np.empty((times.size, motion.C.shape[2]))
    for first in range(0, times.size, POINTS_TOGETHER):
        some = slice(first, first + POINTS_TOGETHER)
        powers = np.vander(s[some], SERIES_ORDER + 1, increasing=True)
        out[some] = np.matmul(powers[:, None], motion.C[k[some]])[:, 0]
    return out


def meshed(
    pieces: Sequence[Piece], s: Scheme, tol: float, hidden: Callable[[Array], Array], most: float
) -> tuple[Array, Array]:
    """A mesh for a motion, with its stages.

    hidden: (N, d + 2, n) scaled points of intervals to (N,) those that hide something of the field, and are halved;
    most: intervals that there may be. Returns (N + 1,) breaks from the first to the last time, and (N, R) start and
    stages of each interval. Raises TooMany: more than `most` are needed.
    """
    d = s.degree
    motion = Piece(*map(np.concatenate, zip(*pieces, strict=True)))
    kappa = math.factorial(d) ** 2 / math.factorial(2 * d)
    top = np.max(np.abs(_derivative(d) @ motion.C), axis=2)
    density = (kappa * top / tol) ** (1 / d) / WITHIN_TOLERANCE
    density = np.maximum(density, np.clip((ONE_STEP / tol) ** (1 / d), 1 / MOST_OF_STEPS, 1.0))
    # Intervals in a step, were it like this all along; each part of it as it is where it needs more of them.
    parts = (np.maximum(density[:, :-1], density[:, 1:]) / (_PLACES.size - 1)).ravel()
    count = np.concatenate([[0.0], np.cumsum(parts)])
    if not count[-1] <= most:
        raise TooMany
    grid = (motion.began[:, None] + motion.lengths[:, None] * _PLACES[:-1]).ravel()
    end = float(motion.began[-1] + motion.lengths[-1])
    breaks = np.interp(np.linspace(0, count[-1], max(1, math.ceil(count[-1])) + 1), count, np.append(grid, end))
    breaks[-1] = end
    for _ in range(MOST_HALVINGS):
        h = np.diff(breaks)
        points = breaks[:-1, None] + h[:, None] * np.append(s.points, 1.0)
        states = values_at(motion, points.ravel()).reshape(h.size, d + 2, -1)
        halve = hidden(states)
        if not halve.any():
            break
        breaks = np.sort(np.concatenate([breaks, (breaks[:-1] + h / 2)[halve]]))
    return breaks, states[:, :-1].reshape(len(states), -1)
