"""Fields of many members, and the stages of their intervals eliminated.

A field is evaluated operation after operation at the points of as many members as stay in the caches,
in the place of a compiled function that goes from point to point: 480 intervals of 8 stages take 0.18 ms so and 0.34 ms
so; 7 intervals 0.11 and 0.008 ms.  What follows is that of elimination.py, by operations on each member alone.

Symbols: B members, n states, N intervals, d points of each, m directions in parameter space.

A function of a point, at many points: its operations in turn, each for all of them.

    y = f(x, p):    instructions  w_k = op(w_i, w_j),  as CasADi has made them of an expression

CasADi carries out all instructions for one point, then for the next; numpy one instruction for all points.  What is the
same at several points, such as an expression of a member's parameters, is one number for them: arrays are broadcast.
Every operation goes element by element, so that what a point gives does not depend on the others.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Sequence
from typing import Any

import casadi as ca
import numpy as np

from ..compiled import kept
from ..hybrid.system import Field
from .elimination import Eliminated, Jet, Stages, jet
from .interval import point_function
from .scheme import Kind


def _number(truth: Callable[..., Any]) -> Callable[..., Array]:
    """A comparison as CasADi means it: 1 or 0."""
    return lambda *values: truth(*values).astype(float)


OPERATIONS: dict[int, Callable[..., Any]] = {
    ca.OP_ASSIGN: lambda x: x, ca.OP_ADD: np.add, ca.OP_SUB: np.subtract, ca.OP_MUL: np.multiply,
    ca.OP_DIV: np.divide, ca.OP_NEG: np.negative, ca.OP_EXP: np.exp, ca.OP_LOG: np.log, ca.OP_POW: np.power,
    ca.OP_CONSTPOW: np.power, ca.OP_SQRT: np.sqrt, ca.OP_SQ: np.square, ca.OP_TWICE: lambda x: x + x,
    ca.OP_INV: lambda x: 1.0 / x, ca.OP_SIN: np.sin, ca.OP_COS: np.cos, ca.OP_TAN: np.tan, ca.OP_ASIN: np.arcsin,
    ca.OP_ACOS: np.arccos, ca.OP_ATAN: np.arctan, ca.OP_SINH: np.sinh, ca.OP_COSH: np.cosh, ca.OP_TANH: np.tanh,
    ca.OP_ASINH: np.arcsinh, ca.OP_ACOSH: np.arccosh, ca.OP_ATANH: np.arctanh, ca.OP_ATAN2: np.arctan2,
    ca.OP_FLOOR: np.floor, ca.OP_CEIL: np.ceil, ca.OP_FMOD: np.fmod, ca.OP_FABS: np.fabs, ca.OP_SIGN: np.sign,
    ca.OP_COPYSIGN: np.copysign, ca.OP_FMIN: np.fmin, ca.OP_FMAX: np.fmax, ca.OP_LOG1P: np.log1p,
    ca.OP_EXPM1: np.expm1, ca.OP_HYPOT: np.hypot, ca.OP_ERF: np.vectorize(math.erf, otypes=[float]),
    ca.OP_LT: _number(np.less), ca.OP_LE: _number(np.less_equal), ca.OP_EQ: _number(np.equal),
    ca.OP_NE: _number(np.not_equal), ca.OP_NOT: _number(np.logical_not), ca.OP_AND: _number(np.logical_and),
    ca.OP_OR: _number(np.logical_or), ca.OP_IF_ELSE_ZERO: lambda truth, x: np.where(truth != 0, x, 0.0),
}  # fmt: skip
"""What numpy calls CasADi's operations; the others (a call that is not inlined) are CasADi's own affair."""


class OverArrays:
    """A function of scalar expressions (SX), evaluated over arrays.

    Parameters
    ----------
    function
        its inputs are dense vectors; its outputs may be sparse.
    """

    def __init__(self, function: ca.Function) -> None:
        self._function = function
        self._places = [function.sparsity_out(i).nnz() for i in range(function.n_out())]
        self._steps: list[tuple[int, Any, Any, Any]] = []
        self._width = function.sz_w()
        for k in range(function.n_instructions()):
            op, into = function.instruction_id(k), function.instruction_output(k)
            if op == ca.OP_CONST:
                self._steps.append((op, into[0], function.instruction_constant(k), None))
            elif op in (ca.OP_INPUT, ca.OP_OUTPUT):
                self._steps.append((op, tuple(into), tuple(function.instruction_input(k)), None))
            else:
                self._steps.append((op, into[0], tuple(function.instruction_input(k)), OPERATIONS.get(op)))
        self.by_numpy = all(
            step[3] is not None or step[0] in (ca.OP_CONST, ca.OP_INPUT, ca.OP_OUTPUT) for step in self._steps
        )

    def __call__(self, *inputs: Sequence[Array]) -> list[list[Any]]:
        """The nonzeros of every output, column after column, as arrays or numbers that can be broadcast.

        `inputs` are the entries of every input: arrays, or numbers, that can be broadcast.
        """
        if not self.by_numpy:
            # The same by CasADi
            shape = np.broadcast_shapes(*(np.shape(entry) for entries in inputs for entry in entries))
            columns = [np.array([np.broadcast_to(e, shape).ravel() for e in entries], float) for entries in inputs]
            found = self._function.map(max(math.prod(shape), 1)).call([ca.DM(column) for column in columns])
            values = [np.array(ca.densify(each).nonzeros()) for each in found]
            return [list(each.reshape(-1, places).T.reshape(places, *shape)) for each, places in
                    zip(values, self._places, strict=True)]  # fmt: skip
        w: list[Any] = [0.0] * self._width
        out: list[list[Any]] = [[0.0] * places for places in self._places]
        with np.errstate(all="ignore"):
            for op, into, of, apply in self._steps:
                if apply is not None:
                    w[into] = apply(*[w[i] for i in of])
                elif op == ca.OP_CONST:
                    w[into] = np.float64(of)
                elif op == ca.OP_INPUT:
                    w[into[0]] = inputs[of[0]][of[1]]
                else:
                    out[into[0]][into[1]] = w[of[0]]
        return out


Array = np.ndarray

POINTS_TOGETHER = 4096
"""Points at which an operation is carried out at once: enough to hide the price of a call, few enough for a cache."""


@kept(maxsize=32)
def _jets(field: Field, n: int, parameters: int, directions: int) -> tuple[Jet, OverArrays]:
    """The jet of a field, over arrays."""
    found = jet(field, n, parameters, directions)
    return found, OverArrays(found.function)


@kept(maxsize=32)
def _field(field: Field, n: int, parameters: int) -> OverArrays:
    """The field alone, over arrays."""
    return OverArrays(point_function(field, n, parameters))


@kept(maxsize=32)
def _stages(field: Field, n: int, parameters: int, degree: int, kind: Kind, directions: int) -> Stages:
    """What numpy does with the jets."""
    return Stages(jet(field, n, parameters, directions), n, degree, kind, directions)


def eliminate_many(
    field: Field, kind: Kind, signs: Array, intervals: Sequence[Array], numbers: Sequence[Array]
) -> Eliminated:
    """The stages of intervals of many members eliminated, NaN for a member with a singular interval.

    signs: (N,) of the modes; intervals: (B, N, d + 1, n) starts and stages, (B, N, n) next nodes, (B, N) durations T of
    the phases [s] and fractions h of them; numbers: (B, np) parameters, (B, m, np) directions, (B, n) scales.
    """
    w, x_next, T, h = intervals
    (B, N, d, n), (p, Q, _) = w[:, :, 1:].shape, numbers
    c, stages = n + 2 + Q.shape[1], _stages(field, n, p.shape[1], d, kind, Q.shape[1])
    out = Eliminated(np.empty((B, N, n * (d + 1))), np.empty((B, N, n * d, c)), np.empty((B, N, n, c)))
    places = out.residual, out.stages, out.maps
    for some in _together(B, N * d):
        for own in (some, *(slice(b, b + 1) for b in range(some.start, some.stop))):
            slopes, rates = _jets_at(field, w[own, :, 1:], signs, (T[own], h[own]), [each[own] for each in numbers])
            flat, members = (w[own].reshape(-1, (d + 1) * n), x_next[own].reshape(-1, n), T[own].ravel()), len(w[own])
            try:
                found = stages(*flat, slopes, rates, members)
            except np.linalg.LinAlgError:  # numpy refuses a whole stack for one matrix: each member by itself
                for place in places:
                    place[own] = np.nan
                continue
            for place, part in zip(places, (found.residual, found.stages, found.maps), strict=True):
                place[own] = part.reshape(members, *place.shape[1:])
            if own is some:
                break
    return out


def _jets_at(
    field: Field, x: Array, signs: Array, lengths: tuple[Array, Array], numbers: list[Array]
) -> tuple[Array, list[Array]]:
    """What `Stages` takes, at the stages x (B, N, d, n); T and h (B, N), and the others as in `eliminate_many`."""
    (B, N, d, n), (T, h), (p, Q, scale) = x.shape, lengths, numbers
    found, over = _jets(field, n, p.shape[1], Q.shape[1])
    directions = _columns(np.ascontiguousarray(Q).reshape(B, -1))
    f, varying, constant = over(_points(x), [_signs(signs, d)], _columns(p), directions, _columns(scale))
    slopes = np.empty((B * N, len(f), d))
    for a, value in enumerate(f):
        slopes[:, a] = np.broadcast_to(value, (B, N * d)).reshape(-1, d)
    slopes *= h.reshape(-1, 1, 1)
    hT = (h * T).reshape(-1, 1, 1)
    rates = [hT * np.broadcast_to(value, (B, N * d)).reshape(-1, 1, d) for value in varying]
    # What is the same at all points of an interval is so at its first one.
    steady = [np.broadcast_to(value, (B, N * d)).reshape(-1, 1, d)[..., :1] for value in constant]
    return slopes, rates + [hT * value for value in steady]


def fields_at(field: Field, x: Array, signs: Array, p: Array, scale: Array) -> Array:
    """The scaled field at points of many members.

    x, signs: (B, N, d, n) scaled states, and (N,) signs of their modes; p, scale: (B, np), (B, n).
    Returns (B, N, d, n).
    """
    out, (B, N, d, n) = np.empty_like(x), x.shape
    over = _field(field, n, p.shape[1])
    for own in _together(B, N * d):
        (f,) = over(_points(x[own]), [_signs(signs, d)], _columns(p[own]), _columns(scale[own]))
        for a in range(n):
            shape = (own.stop - own.start, N * d)
            out[own, :, :, a] = np.broadcast_to(f[a], shape).reshape(-1, N, d)
    return out


def _together(B: int, each: int) -> Iterator[slice]:
    """The members in turn, as many at once as have `POINTS_TOGETHER`."""
    step = max(1, POINTS_TOGETHER // max(each, 1))
    return (slice(first, min(first + step, B)) for first in range(0, B, step))


def _columns(values: Array) -> list[Array]:
    """(B, k) numbers of members as k arrays (B, 1)."""
    return [np.ascontiguousarray(values[:, i : i + 1]) for i in range(values.shape[1])]


def _points(x: Array) -> list[Array]:
    """(B, N, d, n) states as n arrays (B, N d)."""
    return [np.ascontiguousarray(x[..., i]).reshape(len(x), -1) for i in range(x.shape[-1])]


def _signs(signs: Array, d: int) -> Any:
    """The signs of N intervals at their d points, (N d,); one number where all are the same."""
    return float(signs[0]) if (signs == signs[0]).all() else np.repeat(signs, d)
