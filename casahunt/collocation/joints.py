"""The equations at the joints of a cycle: closed-form phases and events, compiled, with their exact Jacobians.

    flow      x+ - flow_k(v, T_k; p)      of every closed-form phase k, from its start node v to the next node x+
    jump      x+ - R_k(v; p)              of every phase k at whose end the state jumps, from v in front to x+ behind
    event     h_k(x(end of k), T_k; p)    of every phase k

Both as columns value, d/dx, d/dT, d/d lambda, lambda being the direction dp in parameter space; all states divided by
the state scale.  They depend on the cycle and not on the mesh.

Symbols: n states, M closed forms (flows and jumps, in the order of time), P phases.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..compiled import Caller, caller, kept
from ..hybrid.system import Cycle, Phase, VectorMode

Array = np.ndarray


@dataclass(frozen=True)
class Joints:
    """Flows and jumps (..., M, n + 3, n) and events (..., n + 3, P); columns value, d/dx, d/dT, d/d lambda."""

    flow: Array
    events: Array


@kept(maxsize=64)
def joint_function(cycle: Cycle) -> ca.Function:
    """Flows, jumps and events with their derivatives, from scaled states.

    Inputs: start nodes v (n, M) of the closed forms, phase-end nodes (n, P), durations T (P), p, dp,
    scale.  Outputs: flows (n, M (n + 3)) and events (P, n + 3); columns value, d/dx, d/dT, d/d lambda.
    """
    n, P = len(cycle.states), len(cycle.phases)
    closed = sum((phase.mode.flow is not None) + (phase.reset is not None) for phase in cycle.phases)
    v, ends = ca.SX.sym("v", n, closed), ca.SX.sym("ends", n, P)
    T, p = ca.SX.sym("T", P), ca.SX.sym("p", len(cycle.parameters))
    dp, scale = ca.SX.sym("dp", len(cycle.parameters)), ca.SX.sym("scale", n)

    def with_derivatives(value: ca.SX, x: ca.SX, duration: ca.SX) -> ca.SX:
        return ca.horzcat(value, ca.jacobian(value, x), ca.jacobian(value, duration), ca.jtimes(value, p, dp))

    flows: list[ca.SX] = []
    events = []
    for k, phase in enumerate(cycle.phases):
        if phase.mode.flow is not None:
            x = v[:, len(flows)]
            flows.append(with_derivatives(phase.mode.flow(scale * x, T[k], p) / scale, x, T[k]))
        if phase.reset is not None:
            x = v[:, len(flows)]
            flows.append(with_derivatives(phase.reset(scale * x, p) / scale, x, T[k]))
        events.append(with_derivatives(phase.end.function(scale * ends[:, k], T[k], p), ends[:, k], T[k]))
    return ca.Function(
        "joints",
        [v, ends, T, p, dp, scale],
        [ca.densify(ca.horzcat(*flows)) if flows else ca.SX(n, 0), ca.densify(ca.vertcat(*events))],
    )


@kept(maxsize=64)
def linear_in_time(mode: VectorMode, n: int, parameters: int) -> bool:
    """Whether a mode in closed form moves along a straight line, its flow being linear in the time."""
    assert mode.flow is not None
    x, T, p = ca.SX.sym("x", n), ca.SX.sym("T"), ca.SX.sym("p", parameters)
    return not any(ca.which_depends(mode.flow(x, T, p), T, 2, False))


@kept(maxsize=32)
def _flow_map(mode: VectorMode, n: int, parameters: int, points: int) -> Caller:
    assert mode.flow is not None
    x, T, p = ca.SX.sym("x", n), ca.SX.sym("T"), ca.SX.sym("p", parameters)
    function = ca.Function("flow", [x, T, p], [ca.densify(mode.flow(x, T, p))])
    return caller(function.map("flows", "serial", points, [0, 2], []), [n, points, parameters], [(points, n)])


def flow_at(mode: VectorMode, x: Array, times: Array, p: Array) -> Array:
    """States of a mode in closed form.

    Parameters
    ----------
    mode
        of a system in vectors (`System.vector_form`), with a flow.
    x, times
        (n,) state at its start, and (m,) times after that.
    p
        (np,) the parameters.

    Returns
    -------
    (m, n) states.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.collocation import flow_at
    >>> from casahunt.hybrid.examples import belt
    >>> stick, p = belt.vector_form.modes["stick"], np.array(list(belt.parameters.values()))
    >>> flow_at(stick, np.array([0.5, 0.2]), np.array([0.0, 1.0]), p).round(3).tolist()
    [[0.5, 0.2], [0.7, 0.2]]
    """
    buffers = _flow_map(mode, x.size, p.size, times.size).buffers
    for store, value in zip(buffers.inputs, (x, times, p), strict=True):
        store[...] = value
    buffers.trigger()
    return buffers.outputs[0].copy()


@kept(maxsize=64)
def _event_rate(phase: Phase, n: int, parameters: int) -> Caller:
    x, T, p = ca.SX.sym("x", n), ca.SX.sym("T"), ca.SX.sym("p", parameters)
    gradient = ca.densify(ca.jacobian(phase.end.function(x, T, p), x))
    f = ca.densify(phase.mode.field(x, p, phase.mode.sign))
    rate = gradient @ f
    moves = ca.fabs(ca.densify(ca.jacobian(rate, x))) @ ca.fabs(x)
    function = ca.Function("rate", [x, T, p], [rate, ca.fabs(gradient) @ ca.fabs(f), moves])
    return caller(function, [n, 1, parameters], [1, 1, 1])


def event_rate(phase: Phase, x: Array, duration: float, p: Array) -> tuple[float, float]:
    """How fast the event at the end of a phase is crossed.

    x, duration, p: (n,) state at its end, its duration, the parameters.
    Returns (h_x . f, |h_x| . |f|): the rate, and the size of what it is the sum of.
    """
    rate, size, _ = _rate_size_moves(phase, x, duration, p)
    return rate, size


def event_rate_moves(phase: Phase, x: Array, duration: float, p: Array) -> float:
    """By how much the rate of an event changes with the states, each by its own size: |(h_x . f)_x| . |x|."""
    return _rate_size_moves(phase, x, duration, p)[2]


def _rate_size_moves(phase: Phase, x: Array, duration: float, p: Array) -> tuple[float, float, float]:
    buffers = _event_rate(phase, x.size, p.size).buffers
    for store, value in zip(buffers.inputs, (x, duration, p), strict=True):
        store[...] = value
    buffers.trigger()
    rate, size, moves = (float(out[0]) for out in buffers.outputs)
    return rate, size, moves


class JointMap:
    """`joint_function` through fixed buffers, mapped over some members; results are copies."""

    def __init__(self, cycle: Cycle, together: int) -> None:
        n, P = len(cycle.states), len(cycle.phases)
        function = joint_function(cycle)
        closed, np_ = function.size2_in(0), len(cycle.parameters)
        inputs = [(together, *shape) for shape in ((closed, n), (P, n), (P,), (np_,), (np_,), (n,))]
        mapped = function if together == 1 else function.map("joints", "serial", together, [], [])
        self._caller = caller(mapped, inputs, [(together, closed, n + 3, n), (together, n + 3, P)])

    def __call__(self, v: Array, ends: Array, T: Array, p: Array, dp: Array, scale: Array) -> Joints:
        """Of one member, or of B of them, whose axis is the first: what is left over in a call is not read."""
        buffers, data = self._caller.buffers, (v, ends, T, p, dp, scale)
        if T.ndim == 1:
            for store, value in zip(buffers.inputs, data, strict=True):
                store[0] = value
            buffers.trigger()
            return Joints(*(out[0].copy() for out in buffers.outputs))
        found = Joints(*(np.empty((len(T), *out.shape[1:])) for out in buffers.outputs))
        together = len(buffers.inputs[0])
        for first in range(0, len(T), together):
            count = min(together, len(T) - first)
            for store, value in zip(buffers.inputs, data, strict=True):
                store[:count] = value[first : first + count]
            buffers.trigger()
            for whole, out in zip((found.flow, found.events), buffers.outputs, strict=True):
                whole[first : first + count] = out[:count]
        return found


@kept(maxsize=64)
def joint_map(cycle: Cycle, together: int = 1) -> JointMap:
    """The compiled map of one member, or of some together, kept for reuse: it does not depend on the mesh."""
    return JointMap(cycle, together)
