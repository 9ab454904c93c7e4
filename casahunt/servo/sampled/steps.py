"""A mode of a plant: its steps as power series, and where it goes if it is linear and left alone.

    x(t + tau h) = sum over k of C_k tau^k,    e(t + tau h) = sum over k of E_k tau^k,    0 <= tau <= 1

The coefficients of a step follow from its field (motion/recursion.py), and with them those of an event that is linear
in the states.  A step is as long as its last coefficients are below rounding.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ...compiled import Caller, caller, kept
from ...motion import taylor_coefficients

Array = np.ndarray

STEP_ORDER = 20
"""Of the series."""
LAST_COEFFICIENTS, LEAST_SIZE = 1e-17, 1e-300
"""Of the last two coefficients, relative to the largest of the state; and of one that is zero and stays so."""
RATE_ROUNDED, CONDITION = 1e-12, 1e10
"""Of the rates of a linear mode, in units of the largest: zero; how far its directions may be from being dependent."""
Expression = Callable[..., Any]
Stepped = tuple[Expression, Expression | None, tuple[tuple[Expression, int], ...], int, int]
"""What a step is compiled from: field, feature, events with their directions, numbers of states and parameters."""
POWERS_OF_A_STEP = np.arange(STEP_ORDER + 1.0)


@kept(maxsize=128)
def step_of(
    field: Expression, feature: Expression | None, events: tuple[tuple[Expression, int], ...], n: int, parameters: int
) -> tuple[ca.Function, Caller, tuple[int, ...]] | None:
    """One step, and of each event the state that alone is in it, or -1; None without a series.

    events: functions, each with the direction of its exit.
    (x, h, sign, p) -> (P + 1, n) C; (n,) end; (E, P + 1) E, in the direction of the exits; and (4,): the last
    coefficients, relative to the sizes of the states; the feature at the start; what it is at most half-way and at the
    end; what events are at most. P: the order.
    """
    series = taylor_coefficients(field, n, parameters, STEP_ORDER)
    if series is None:
        return None
    x, h, sign, p = ca.SX.sym("x", n), ca.SX.sym("h"), ca.SX.sym("sign"), ca.SX.sym("p", parameters)
    C = ca.densify(series(x, sign, p, ca.DM.ones(n), h))
    at = ca.densify(ca.vertcat(*[direction * event(x, 0.0, p) for event, direction in events], ca.SX(0, 1)))
    slopes = ca.jacobian(at, x)
    if slopes.nnz() and ca.depends_on(ca.vertcat(*slopes.nonzeros()), x):
        return None
    E = ca.densify(ca.horzcat(at, ca.mtimes(slopes, C[:, 1:])))
    end = ca.sum2(C)
    sizes = ca.vertcat(*[ca.fmax(ca.mmax(ca.fabs(C[i, :])), LEAST_SIZE) for i in range(n)])
    tails = ca.fmax(ca.fabs(C[:, -1]), ca.fabs(C[:, -2])) / sizes
    halfway = ca.mtimes(C, ca.DM(0.5**POWERS_OF_A_STEP))
    hides = ca.vertcat(*(feature(at, p) for at in (x, halfway, end))) if feature is not None else ca.DM.ones(3)
    most = ca.mmax(ca.vertcat(E[:, 0] + ca.sum2(ca.fabs(E[:, 1:])), -1))
    seen = ca.vertcat(ca.mmax(tails), ca.fabs(hides[0]), ca.mmax(ca.fabs(hides[1:])), most)
    outputs = [C, end, E.T, seen]
    function = ca.Function("step", [x, h, sign, p], [ca.densify(each) for each in outputs])
    many, at_zero = len(events), ca.Function("zero", [x, p], [at])(ca.DM.zeros(n), p)
    rows, columns = slopes.sparsity().get_triplet()
    alone = [columns[rows.index(i)] if rows.count(i) == 1 and at_zero[i].is_zero() else -1 for i in range(many)]
    shapes = [(STEP_ORDER + 1, n), (n,), (many, STEP_ORDER + 1), (4,)]
    return function, caller(function, [(n,), (1,), (1,), (parameters,)], shapes), tuple(alone)


@kept(maxsize=128)
def _slopes(
    field: Expression, feature: Expression | None, events: tuple[tuple[Expression, int], ...], n: int, parameters: int
) -> ca.Function | None:
    """(x, sign, p) -> slopes of the field, the field, slopes of the events in the direction of their exits; None where
    any slope changes with x."""
    x, sign, p = ca.SX.sym("x", n), ca.SX.sym("sign"), ca.SX.sym("p", parameters)
    f = ca.densify(ca.SX(field(x, p, sign)))
    at = ca.densify(ca.vertcat(*[direction * event(x, 0.0, p) for event, direction in events], ca.SX(0, 1)))
    A, a = ca.jacobian(f, x), ca.jacobian(at, x)
    if ca.depends_on(ca.vertcat(*A.nonzeros(), *a.nonzeros(), 0 * sign), x):
        return None
    return ca.Function("slopes", [x, sign, p], [ca.densify(A), f, ca.densify(a)])


class Dying(NamedTuple):
    """x' = A x + b of a linear mode, slopes of its events; factors (0 for what stands) and directions of A, their
    inverse, and that times b."""

    A: Array
    b: Array
    slopes: Array
    factors: Array
    directions: Array
    inverse: Array
    drive: Array

    def left(self, x: Array) -> Array:
        """(n,) how much of each direction will have died out: of what stands nothing."""
        moves = self.factors != 0
        return np.where(moves, self.inverse @ x + self.drive / np.where(moves, self.factors, 1), 0)


class Ringing(NamedTuple):
    """What is read of a plant that is left alone: x(t) = last + sum of parts exp(rates t)."""

    last: float
    parts: Array
    rates: Array

    @property
    def now(self) -> float:
        """x(0)."""
        return self.last + float(np.real(self.parts.sum()))

    @property
    def least(self) -> float:
        """What x(t) is never below."""
        return self.last - float(np.abs(self.parts).sum())

    @property
    def most(self) -> float:
        """What x(t) is never above."""
        return self.last + float(np.abs(self.parts).sum())


class PlantMode:
    """A mode of a plant at its numbers."""

    def __init__(self, mode: Any, exits: tuple[Any, ...], n: int, p: Array) -> None:
        self.mode, self.exits = mode, exits
        self.stepped = mode.field, mode.feature, tuple((way.event.function, way.direction) for way in exits), n, p.size
        found = step_of(*self.stepped)
        self.has_series = found is not None
        self.still, self.next = False, math.inf
        if found is None:
            return
        buffers, self.alone = found[1].buffers, found[2]
        (self._x, self._h, sign, parameters), self.found, self._run = buffers.inputs, buffers.outputs, buffers.trigger
        self._fixed = (sign, mode.sign), (parameters, p)
        moves = ca.SX(mode.field(ca.SX.sym("x", n), ca.DM(p), mode.sign))
        self.still = bool(ca.sparsify(ca.cse(moves)).nnz() == 0)
        """Whether nothing moves in it."""

    @cached_property
    def dying(self) -> Dying | None:
        """How it goes to where it stays; None where the mode is not linear, or something goes on or grows."""
        slopes = _slopes(*self.stepped)
        if slopes is None:
            return None
        A, b, a = (np.array(each) for each in slopes(np.zeros(self.stepped[3]), self.mode.sign, self._fixed[1][1]))
        factors, directions = np.linalg.eig(A)
        largest = np.abs(factors).max()
        if np.linalg.cond(directions) > CONDITION or np.any(np.real(factors) > RATE_ROUNDED * largest):
            return None
        inverse, stands = np.linalg.inv(directions), np.abs(factors) <= RATE_ROUNDED * largest
        drive = inverse @ b.ravel()
        if np.any(np.abs(drive[stands]) > RATE_ROUNDED * np.abs(drive).max()):
            return None
        return Dying(A, b.ravel(), a, np.where(stands, 0, factors), directions, inverse, drive)

    def step(self, x: Array, h: float) -> None:
        """Fill `found`."""
        for store, value in self._fixed:
            store[:] = value
        self._x[:], self._h[0] = x, h
        self._run()
