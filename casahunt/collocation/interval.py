"""One collocation interval as a compiled CasADi function, with its exact Jacobian.

For the interval of duration h T (h its fraction of the phase, T the phase duration), start x, stages
X = (X_1, ..., X_d) and next node x+, all divided by the state scale D:

    stage rows     X_j - x - h T sum_l A_jl f(D X_l; p)/D = 0        (n d rows)
    node rows      x+  - x - h T sum_l b_l  f(D X_l; p)/D = 0        (n rows)

The function returns [ residual | d/d(x, X) | d/dT | d/d lambda ] as one dense block of R = n (d + 1)
rows and R + 3 columns, lambda being the direction dp in parameter space; d/dx+ is the identity on the
node rows.  The block is mapped over the mesh, so its size and the time to build it do not depend on the
number of intervals; scalar expressions (SX) inside, never unrolled outside.

Symbols: n states, d stages, R = n (d + 1), N intervals, p parameters.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiled import Caller, caller, caller_by_rows, kept
from ..hybrid.system import Field
from ..hybrid.vector_form import TOGETHER
from .scheme import Kind, scheme

Array = np.ndarray

INPUTS = ("w", "x_next", "duration", "fraction", "sign", "p", "dp", "scale")


@kept(maxsize=64)
def interval_function(field: Field, n: int, parameters: int, degree: int, kind: Kind) -> ca.Function:
    """The function of the module docstring, for one interval.

    field: f(x, p, sign) of the mode. Returns function of `INPUTS`: w = (x, X) of length R, x_next (n), duration T [s],
    fraction h, sign of the mode, p and its direction dp, scale D (n).  Output: dense (R, R + 3).
    """
    s, d = scheme(degree, kind), degree
    w, x_next = ca.SX.sym("w", n * (d + 1)), ca.SX.sym("x_next", n)
    T, h, sign = ca.SX.sym("T"), ca.SX.sym("h"), ca.SX.sym("sign")
    p, dp, scale = ca.SX.sym("p", parameters), ca.SX.sym("dp", parameters), ca.SX.sym("scale", n)

    z = ca.SX.sym("z", n)
    f = field(scale * z, p, sign) / scale
    local = ca.Function("slope", [z, p, dp, scale, sign], [f, ca.jacobian(f, z), ca.jtimes(f, p, dp)])
    x, X = w[:n], ca.reshape(w[n:], n, d)
    slopes, jacobians, changes = zip(*[local(X[:, j], p, dp, scale, sign) for j in range(d)], strict=True)
    weights = np.vstack([s.matrix, s.weights])  # A and b: stage rows and node rows

    step = -h * T
    sums = ca.mtimes(ca.horzcat(*slopes), weights.T)
    residual = ca.vec(ca.horzcat(X, x_next) - ca.repmat(x, 1, d + 1) + step * sums)
    by_stages = ca.horzcat(*[ca.kron(weights[:, j], step * jacobians[j]) for j in range(d)])
    by_stages += np.eye(n * (d + 1), n * d)
    block = ca.horzcat(
        residual, ca.DM(np.tile(-np.eye(n), (d + 1, 1))), by_stages, -h * ca.vec(sums),
        step * ca.vec(ca.mtimes(ca.horzcat(*changes), weights.T)),
    )  # fmt: skip
    return ca.Function("interval", [w, x_next, T, h, sign, p, dp, scale], [ca.densify(block)], list(INPUTS), ["block"])


@kept(maxsize=64)
def point_function(field: Field, n: int, parameters: int) -> ca.Function:
    """The vector field itself, scaled.

    field: f(x, p, sign) of the mode. Returns function (x, sign, p, scale) -> f(D x; p)/D.
    """
    x, sign = ca.SX.sym("x", n), ca.SX.sym("sign")
    p, scale = ca.SX.sym("p", parameters), ca.SX.sym("scale", n)
    return ca.Function("field", [x, sign, p, scale], [ca.densify(field(scale * x, p, sign) / scale)])


@kept(maxsize=64)
def _one_point(field: Field, n: int, parameters: int) -> Caller:
    """`point_function`, called through fixed buffers."""
    return caller(point_function(field, n, parameters), [n, 1, parameters, n], [n])


def field_at(field: Field, x: Array, sign: float, p: Array, scale: Array) -> Array:
    """The scaled field at one scaled state.

    field: f(x, p, sign) of the mode; x, sign: (n,) the state, scaled; sign of the mode; p, scale: parameter vector;
    (n,) state scale D. Returns (n,).
    """
    buffers = _one_point(field, x.size, p.size).buffers
    for store, value in zip(buffers.inputs, (x, sign, p, scale), strict=True):
        store[:] = value
    buffers.trigger()
    return buffers.outputs[0].copy()


LONGEST_PART = 64
"""Intervals of the longest map that is built; longer meshes take several, shorter ones the powers of two below."""


@kept(maxsize=128)
def _part(field: Field, n: int, parameters: int, degree: int, kind: Kind, intervals: int) -> ca.Function:
    """`interval_function` over a number of intervals, all arguments given for each."""
    return interval_function(field, n, parameters, degree, kind).map(intervals)


def sizes_of_parts(intervals: int) -> list[int]:
    """Powers of two, none above `LONGEST_PART`, whose sum is a number of intervals."""
    left = intervals % LONGEST_PART
    powers = [1 << k for k in reversed(range(left.bit_length())) if left >> k & 1]
    return [LONGEST_PART] * (intervals // LONGEST_PART) + powers


class IntervalMap:
    """`interval_function` over N intervals, called through fixed buffers (compiled.py).

    The returned block is a view into the buffer of the calling thread: its next call overwrites it.
    """

    def __init__(self, field: Field, n: int, parameters: int, degree: int, kind: Kind, intervals: int) -> None:
        parts = [(_part(field, n, parameters, degree, kind, size), size) for size in sizes_of_parts(intervals)]
        rows = n * (degree + 1)
        self._caller = caller_by_rows(parts, [rows, n, 1, 1, 1, parameters, parameters, n], [(rows + 3, rows)])

    def __call__(
        self,
        w: Array,
        x_next: Array,
        duration: Array | float,
        fraction: Array | float,
        sign: Array | float,
        p: Array,
        dp: Array,
        scale: Array,
    ) -> Array:
        """Blocks (N, R + 3, R): for each interval the columns of the block of the module docstring."""
        buffers = self._caller.buffers
        w_, x_next_, duration_, fraction_, sign_, p_, dp_, scale_ = buffers.inputs
        w_[:] = w
        x_next_[:] = x_next
        duration_.T[:] = duration
        fraction_.T[:] = fraction
        sign_.T[:] = sign
        p_[:] = p
        dp_[:] = dp
        scale_[:] = scale
        buffers.trigger()
        return buffers.outputs[0]


@kept(maxsize=32)
def interval_map(field: Field, n: int, parameters: int, degree: int, kind: Kind, intervals: int) -> IntervalMap:
    """The compiled map, kept for reuse: the same mesh size of the same system is built once.

    field: f(x, p, sign) of the mode.
    """
    return IntervalMap(field, n, parameters, degree, kind, intervals)


@kept(maxsize=64)
def points_function(field: Field, n: int, parameters: int, points: int) -> ca.Function:
    """The scaled field at several points of one interval: what depends on p alone is computed once for all.

    field: f(x, p, sign) of the mode; n, parameters, points: numbers of states, of parameters and of points.
    Returns function (x (n, points), sign, p, scale) -> f(D x; p)/D (n, points).
    """
    x, sign = ca.SX.sym("x", n, points), ca.SX.sym("sign")
    p, scale = ca.SX.sym("p", parameters), ca.SX.sym("scale", n)
    at_each = point_function(field, n, parameters)
    slopes = ca.horzcat(*(at_each(x[:, k], sign, p, scale) for k in range(points)))
    return ca.Function("fields", [x, sign, p, scale], ca.cse([slopes]))


class PointsMap:
    """`points_function` over N intervals, through fixed buffers."""

    def __init__(self, field: Field, n: int, parameters: int, points: int, intervals: int) -> None:
        function = points_function(field, n, parameters, points)
        parts = [(function.map(size), size) for size in sizes_of_parts(intervals)]
        self._caller = caller_by_rows(parts, [points * n, 1, parameters, n], [(points, n)])

    def __call__(self, x: Array, sign: Array, p: Array, scale: Array) -> Array:
        """Scaled field (N, points, n) at the scaled states x (N, points, n) with the signs (N,)."""
        buffers = self._caller.buffers
        states, signs, parameters, scales = buffers.inputs
        states[:], signs[:, 0], parameters[:], scales[:] = x.reshape(states.shape), sign, p, scale
        buffers.trigger()
        return buffers.outputs[0].copy()


@kept(maxsize=32)
def points_map(field: Field, n: int, parameters: int, points: int, intervals: int) -> PointsMap:
    """The compiled map, kept for reuse.

    field: f(x, p, sign) of the mode.
    """
    return PointsMap(field, n, parameters, points, intervals)


POINTS_AT_ONCE = 128
"""Points of one call of what is compiled."""


class PointMap:
    """`point_function` over any number of points, through fixed buffers for some of them at once."""

    def __init__(self, function: ca.Function, n: int) -> None:
        widths = (n, 1, function.size1_in(2), n)
        self._few, self._many = (
            caller(function.map(count), [(count, width) for width in widths], [(count, n)])
            for count in (TOGETHER, POINTS_AT_ONCE)
        )

    def __call__(self, x: Array, sign: Array, p: Array, scale: Array) -> Array:
        """Scaled field (m, n) at the scaled states x (m, n) with the signs (m,)."""
        few = len(x) <= TOGETHER
        buffers, at_once = (self._few if few else self._many).buffers, TOGETHER if few else POINTS_AT_ONCE
        states, signs, parameters, scales = buffers.inputs
        parameters[:], scales[:] = p, scale
        out = np.empty_like(x)
        for first in range(0, len(x), at_once):
            chunk = slice(first, first + at_once)
            count = len(out[chunk])
            states[:count], signs[:count, 0] = x[chunk], sign[chunk]
            buffers.trigger()
            out[chunk] = buffers.outputs[0][:count]
        return out


@kept(maxsize=16)
def point_map(field: Field, n: int, parameters: int) -> PointMap:
    """The compiled field, kept for reuse.

    field: f(x, p, sign) of the mode.
    """
    return PointMap(point_function(field, n, parameters), n)
