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
from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from ..collocation.scheme import Scheme
from ..compiled import Caller, caller, kept
from ..hybrid.system import Field
from .recursion import coefficients

Array = np.ndarray

ORDER = 24
LOOKS = 25
"""Places of a step, both ends among them, at which it is looked at."""
WITHIN_TOLERANCE = 0.9
"""Length of an interval of a mesh, in units of the one whose last coefficient is the tolerance."""
MONITORED = 9
"""Places of a step, both ends among them, at which the lengths of intervals are chosen."""
MOST_HALVINGS = 40
_POWERS = np.arange(ORDER + 1.0)


class Step(NamedTuple):
    """Where it begins, how long it is, and (P + 1, n) coefficients C, scaled."""

    began: float
    length: float
    C: Array


class Expansion:
    """The series of one mode at any state, compiled."""

    def __init__(self, function: Caller, sign: float, p: Array, scale: Array) -> None:
        self._trigger = function.buffers.trigger
        self._x, signs, parameters, scales, self._unit = function.buffers.inputs
        self._out = function.buffers.outputs[0]
        self._fixed = ((signs, sign), (parameters, p), (scales, scale))

    def __call__(self, x: Array, unit: float) -> Array:
        """(P + 1, n) coefficients at a scaled state, of powers of t/unit."""
        for store, value in self._fixed:
            store[:] = value
        self._x[:], self._unit[0] = x, unit
        self._trigger()
        return self._out.copy()


@kept(maxsize=64)
def _compiled(field: Field, n: int, parameters: int) -> Caller | None:
    function = coefficients(field, n, parameters, ORDER)
    return None if function is None else caller(function, [n, 1, parameters, n, 1], [(ORDER + 1, n)])


def expansion(field: Field, sign: float, p: Array, scale: Array) -> Expansion | None:
    """The series along a field.

    Parameters
    ----------
    field, sign
        of the mode.
    p, scale
        parameter vector; (n,) size of the states.

    Returns
    -------
    Expansion; None where the field has no series.
    """
    function = _compiled(field, scale.size, p.size)
    return None if function is None else Expansion(function, sign, p, scale)


def reach(C: Array, theta: float) -> float:
    """How far a series may be used.

    Parameters
    ----------
    C
        (P + 1, n) coefficients of powers of s.
    theta
        bound of the last terms.

    Returns
    -------
    The largest s; infinite where nothing moves, nan where a coefficient is no number.
    """
    size = np.max(np.abs(C) / np.maximum(1.0, np.abs(C[0])), axis=1)
    size[0] = 0.0
    bound = np.ones(ORDER + 1)
    bound[-2:] = theta / np.maximum(1.0, np.max(np.abs(C[0])))
    with np.errstate(divide="ignore"):
        logarithms = (np.log(bound[1:]) - np.log(size[1:])) / _POWERS[1:]
    return float(np.exp(min(np.min(logarithms), 700.0)))


def stretched(C: Array, factor: float) -> Array:
    """Coefficients of powers of s/factor from those of powers of s.

    Parameters
    ----------
    C
        (P + 1, n) coefficients.
    factor
        the part of s that becomes one.

    Returns
    -------
    (P + 1, n).
    """
    return C * (factor**_POWERS)[:, None]


def at(C: Array, s: float) -> Array:
    """(n,) value of a series at one place."""
    return (s**_POWERS) @ C


@lru_cache(maxsize=8)
def powers(count: int) -> Array:
    """(count, P + 1) powers of so many places of a step."""
    return np.vander(np.linspace(0, 1, count), ORDER + 1, increasing=True)


@lru_cache(maxsize=16)
def _derivative(d: int) -> Array:
    """(MONITORED, P + 1): x^(d)/d! at places of a step from its coefficients."""
    s = np.linspace(0, 1, MONITORED)
    out = np.zeros((MONITORED, ORDER + 1))
    for k in range(d, ORDER + 1):
        out[:, k] = math.comb(k, d) * s ** (k - d)
    return out


def values_at(steps: Sequence[Step], times: Array) -> Array:
    """The motion at times.

    Parameters
    ----------
    steps
        one after the other.
    times
        (m,).

    Returns
    -------
    (m, n) scaled states.
    """
    began = np.array([step.began for step in steps])
    k = np.clip(np.searchsorted(began, times, side="right") - 1, 0, len(steps) - 1)
    s = (times - began[k]) / np.array([step.length for step in steps])[k]
    C = np.array([step.C for step in steps])[k]
    return np.matmul(np.vander(s, ORDER + 1, increasing=True)[:, None], C)[:, 0]


def meshed(
    steps: Sequence[Step], s: Scheme, tol: float, accepted: float, hidden: Callable[[Array], Array]
) -> tuple[Array, Array]:
    """A mesh for a motion, with its stages.

    Parameters
    ----------
    steps
        of the motion, one after the other.
    s
        the scheme.
    tol, accepted
        last Legendre coefficient that intervals are chosen for; the largest that one may have.
    hidden
        (N, d + 2, n) scaled points of intervals to (N,) those that hide something of the field.

    Returns
    -------
    (N + 1,) breaks from the first to the last time, and (N, R) start and stages of each interval.
    """
    d = s.degree
    lengths = np.array([step.length for step in steps])
    kappa = math.factorial(d) ** 2 / math.factorial(2 * d)
    top = np.max(np.abs(_derivative(d) @ np.array([step.C for step in steps])), axis=2)
    density = (kappa * top / tol) ** (1 / d) / WITHIN_TOLERANCE  # intervals in a step, were it like this all along
    parts = (np.maximum(density[:, :-1], density[:, 1:]) / (MONITORED - 1)).ravel()
    count = np.concatenate([[0.0], np.cumsum(parts + 1e-9 * lengths.repeat(MONITORED - 1) / lengths.sum())])
    grid = [step.began + step.length * np.linspace(0, 1, MONITORED)[:-1] for step in steps]
    end = steps[-1].began + steps[-1].length
    breaks = np.interp(
        np.linspace(0, count[-1], max(1, math.ceil(count[-1])) + 1), count, np.append(np.concatenate(grid), end)
    )
    breaks[-1] = end
    for _ in range(MOST_HALVINGS):
        h = np.diff(breaks)
        points = breaks[:-1, None] + h[:, None] * np.append(s.points, 1.0)
        states = values_at(steps, points.ravel()).reshape(h.size, d + 2, -1)
        errors = np.max(np.abs(np.matmul(s.last_mode, states[:, :-1])), axis=1)
        short = (errors > accepted) | hidden(states)
        if not short.any():
            break
        breaks = np.sort(np.concatenate([breaks, (breaks[:-1] + h / 2)[short]]))
    return breaks, states[:, :-1].reshape(len(states), -1)
