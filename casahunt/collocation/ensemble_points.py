"""Fields, closed forms and events of many members.

A field is evaluated operation after operation at the points of as many members as stay in the caches (over_arrays.py).
Closed forms and events are one compiled function, mapped over members in chunks of a fixed size; what is left over in
the last one is computed and not read.

Symbols: B members, n states, N intervals, d points of each, P phases, M closed forms, m directions.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..compiled import caller, kept
from ..hybrid.system import Cycle, Field
from .interval import point_function
from .joints import joint_function
from .over_arrays import OverArrays

Array = np.ndarray

POINTS_TOGETHER = 4096
"""Points at which an operation is carried out at once: enough to hide the price of a call, few enough for a cache."""
JOINTS_TOGETHER = 16
"""Members of a mapped call for closed forms and events."""


@dataclass(frozen=True, eq=False)
class Jets:
    """A field and its derivatives at many points.

    Attributes
    ----------
    f : (n, B, N, d) scaled, each state by itself.
    J : (n, n, B, N, d) df_a/dx_c.
    q : (n, m, B, N, d) df_a/dp Q.
    """

    f: Array
    J: Array
    q: Array


@kept(maxsize=32)
def jet_function(field: Field, n: int, parameters: int, directions: int) -> ca.Function:
    """The scaled vector field at one point with its derivatives.

    field: f(x, p, sign) of the mode; n, parameters, directions: numbers of states, of parameters and of directions.
    Returns function of x (n), sign, p, Q (np, m) and scale D (n): f(D x; p)/D, sparse d/dx, d/dp Q (n, m).
    """
    x, sign = ca.SX.sym("x", n), ca.SX.sym("sign")
    p, q, scale = ca.SX.sym("p", parameters), ca.SX.sym("q", parameters, directions), ca.SX.sym("scale", n)
    f = ca.densify(field(scale * x, p, sign) / scale)
    moved = ca.densify(ca.jtimes(f, p, q))
    return ca.Function("jet", [x, sign, p, q, scale], ca.cse([f, ca.jacobian(f, x), moved]))


@kept(maxsize=32)
def jacobian_pattern(field: Field, n: int, parameters: int) -> tuple[tuple[int, int], ...]:
    """The places (a, c) of df/dx that need not be zero, column after column.

    field, n, parameters: as in `jet_function`.
    """
    rows, columns = jet_function(field, n, parameters, 1).sparsity_out(1).get_triplet()
    return tuple(zip(rows, columns, strict=True))


@kept(maxsize=32)
def _over_arrays(field: Field, n: int, parameters: int, directions: int) -> OverArrays:
    """`jet_function` over arrays; with no directions the field alone."""
    return OverArrays(
        jet_function(field, n, parameters, directions) if directions else point_function(field, n, parameters)
    )


def jets_at(field: Field, x: Array, signs: Array, p: Array, directions: Array, scale: Array, out: Jets) -> None:
    """The jets of a field at points of many members.

    field: f(x, p, sign); x, signs: (B, N, d, n) scaled states, and (N,) signs of their modes; p, directions, scale: (B,
    np), (B, m, np), (B, n); out: where they go, zeros where df/dx has none.
    """
    B, N, d, n = x.shape
    m, parameters = directions.shape[1], p.shape[1]
    pattern, over = jacobian_pattern(field, n, parameters), _over_arrays(field, n, parameters, m)
    for own in _members_together(B, N * d):
        of_all = [_columns(p[own]), [directions[own, k, i, None] for k in range(m) for i in range(parameters)]]
        states, sign = _points(x[own]), _signs(signs, d)
        f, J, q = over(states, [sign], *of_all, _columns(scale[own]))
        shape = (own.stop - own.start, N * d)
        for a in range(n):
            _into(out.f[a, own], f[a], shape)
            for k in range(m):
                _into(out.q[a, k, own], q[a + k * n], shape)
        for (a, c), value in zip(pattern, J, strict=True):
            _into(out.J[a, c, own], value, shape)


def fields_at(field: Field, x: Array, signs: Array, p: Array, scale: Array) -> Array:
    """The scaled field at points of many members.

    field, x, signs, p, scale: as in `jets_at`. Returns (B, N, d, n).
    """
    out, (B, N, d, n) = np.empty_like(x), x.shape
    over = _over_arrays(field, n, p.shape[1], 0)
    for own in _members_together(B, N * d):
        (f,) = over(_points(x[own]), [_signs(signs, d)], _columns(p[own]), _columns(scale[own]))
        for a in range(n):
            _into(out[own, :, :, a], f[a], (own.stop - own.start, N * d))
    return out


def _members_together(B: int, each: int) -> list[slice]:
    """The members in turn, as many at once as have `POINTS_TOGETHER`."""
    step = max(1, POINTS_TOGETHER // max(each, 1))
    return [slice(first, min(first + step, B)) for first in range(0, B, step)]


def _columns(values: Array) -> list[Array]:
    """(B, k) numbers of members as k arrays (B, 1)."""
    return [np.ascontiguousarray(values[:, i : i + 1]) for i in range(values.shape[1])]


def _points(x: Array) -> list[Array]:
    """(B, N, d, n) states as n arrays (B, N d)."""
    return [np.ascontiguousarray(x[..., i]).reshape(len(x), -1) for i in range(x.shape[-1])]


def _signs(signs: Array, d: int) -> Any:
    """The signs of N intervals at their d points, (N d,); one number where all are the same."""
    return float(signs[0]) if (signs == signs[0]).all() else np.repeat(signs, d)


def _into(out: Array, value: Any, shape: tuple[int, int]) -> None:
    """Write what can be broadcast to (B, N d) into (B, N, d)."""
    out[...] = np.broadcast_to(value, shape).reshape(out.shape)


class JointsOfMany:
    """`joint_function` for many members."""

    def __init__(self, cycle: Cycle) -> None:
        n, P, chunk, np_ = len(cycle.states), len(cycle.phases), JOINTS_TOGETHER, len(cycle.parameters)
        function = joint_function(cycle)
        closed = function.size2_in(0)
        inputs = [(chunk, closed, n), (chunk, P, n), (chunk, P), (chunk, np_), (chunk, np_), (chunk, n)]
        outputs = [(chunk, closed, n + 3, n), (chunk, n + 3, P)]
        mapped = function.map("joints", "serial", chunk, [], [])
        self._caller = caller(mapped, inputs, outputs)

    def __call__(self, *data: Array) -> tuple[Array, Array]:
        """Flows (B, M, n + 3, n) and events (B, n + 3, P)."""
        buffers, total = self._caller.buffers, len(data[1])
        flow, events = (np.empty((total, *store.shape[1:])) for store in buffers.outputs)
        for first in range(0, total, JOINTS_TOGETHER):
            count = min(JOINTS_TOGETHER, total - first)
            for store, value in zip(buffers.inputs, data, strict=True):
                store[:count] = value[first : first + count]
            buffers.trigger()
            flow[first : first + count] = buffers.outputs[0][:count]
            events[first : first + count] = buffers.outputs[1][:count]
        return flow, events


@kept(maxsize=16)
def joints(cycle: Cycle) -> JointsOfMany:
    """The compiled map, kept for reuse."""
    return JointsOfMany(cycle)
