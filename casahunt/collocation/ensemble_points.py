"""Fields, closed forms and events of many members: one compiled function, mapped over their points or over them.

Chunks have a fixed size; what is left over in the last one is computed and not read.

Symbols: m points or members, n states, P phases, M closed forms.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..compiled import caller, kept
from ..hybrid.system import Cycle, Field
from .interval import point_function
from .joints import joint_function

Array = np.ndarray

POINTS_TOGETHER = 256
"""Points of a mapped call: its inputs and outputs stay in the nearest cache."""
JOINTS_TOGETHER = 16
"""Members of a mapped call for closed forms and events."""


@kept(maxsize=32)
def jet_function(field: Field, n: int, parameters: int, directions: int) -> ca.Function:
    """The scaled vector field at one point with its derivatives.

    Parameters
    ----------
    field
        f(x, p, sign) of the mode.
    n, parameters, directions
        numbers of states, of parameters and of directions.

    Returns
    -------
    Function of x (n), sign, p, Q (np, m) and scale D (n): dense (n, 1 + n + m) of f(D x; p)/D, d/dx and d/dp Q.
    """
    x, sign = ca.SX.sym("x", n), ca.SX.sym("sign")
    p, q, scale = ca.SX.sym("p", parameters), ca.SX.sym("q", parameters, directions), ca.SX.sym("scale", n)
    f = field(scale * x, p, sign) / scale
    block = ca.horzcat(f, ca.jacobian(f, x), ca.mtimes(ca.jacobian(f, p), q))
    return ca.Function("jet", [x, sign, p, q, scale], [ca.densify(block)])


class PointsOfMany:
    """A compiled function over any number of points, whose inputs are arrays with one row a point."""

    def __init__(self, function: ca.Function, shapes: list[tuple[int, ...]], out: tuple[int, ...]) -> None:
        chunk = POINTS_TOGETHER
        inputs = [(chunk, *shape) for shape in shapes]
        self._caller = caller(function.map("points", "serial", chunk, [], []), inputs, [(chunk, *out)])
        self._out = out

    def __call__(self, points: tuple[Array, ...], shared: tuple[Array, ...], each: int) -> Array:
        """Values (m, *out): `points` have a row for each of the m points, `shared` one for `each` points in turn."""
        buffers, total = self._caller.buffers, len(points[0])
        out = np.empty((total, *self._out))
        for first in range(0, total, POINTS_TOGETHER):
            count = min(POINTS_TOGETHER, total - first)
            owner = np.arange(first, first + count) // each
            for store, value in zip(buffers.inputs, points, strict=False):
                store[:count] = value[first : first + count]
            for store, value in zip(buffers.inputs[len(points) :], shared, strict=True):
                store[:count] = value[owner]
            buffers.trigger()
            out[first : first + count] = buffers.outputs[0][:count]
        return out


@kept(maxsize=16)
def jets(field: Field, n: int, parameters: int, directions: int) -> PointsOfMany:
    """`jet_function` over any number of points.

    Parameters
    ----------
    field, n, parameters, directions
        as there.

    Returns
    -------
    PointsOfMany; values (m, 1 + n + directions, n).
    """
    function = jet_function(field, n, parameters, directions)
    return PointsOfMany(function, [(n,), (), (parameters,), (directions, parameters), (n,)], (1 + n + directions, n))


@kept(maxsize=16)
def fields(field: Field, n: int, parameters: int) -> PointsOfMany:
    """`interval.point_function` over any number of points.

    Parameters
    ----------
    field, n, parameters
        as there.

    Returns
    -------
    PointsOfMany; values (m, n).
    """
    return PointsOfMany(point_function(field, n, parameters), [(n,), (), (parameters,), (n,)], (n,))


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
