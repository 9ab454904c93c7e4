"""The equations at the joints of a cycle: closed-form phases and events, compiled, with their exact Jacobians.

    flow      x+ - flow_k(v, T_k; p)      of every closed-form phase k, from its start node v to the next node x+
    event     h_k(x(end of k), T_k; p)    of every phase k

Both as columns value, d/dx, d/dT, d/d lambda, lambda being the direction dp in parameter space; all states divided by
the state scale.  They depend on the cycle and not on the mesh.

Symbols: n states, M closed-form phases, P phases.
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca
import numpy as np

from ..compiled import caller, kept
from ..hybrid.system import Cycle

Array = np.ndarray


@dataclass(frozen=True)
class Joints:
    """Closed-form flows (M, n + 3, n) and events (n + 3, P); columns value, d/dx, d/dT, d/d lambda."""

    flow: Array
    events: Array


@kept(maxsize=64)
def joint_function(cycle: Cycle) -> ca.Function:
    """Closed-form flows and events with their derivatives, from scaled states.

    Inputs: start nodes v (n, M) of the closed-form phases, phase-end nodes (n, P), durations T (P), p, dp,
    scale.  Outputs: flows (n, M (n + 3)) and events (P, n + 3); columns value, d/dx, d/dT, d/d lambda.
    """
    n, P = len(cycle.states), len(cycle.phases)
    closed = [k for k, phase in enumerate(cycle.phases) if phase.mode.flow is not None]
    v, ends = ca.SX.sym("v", n, len(closed)), ca.SX.sym("ends", n, P)
    T, p = ca.SX.sym("T", P), ca.SX.sym("p", len(cycle.parameters))
    dp, scale = ca.SX.sym("dp", len(cycle.parameters)), ca.SX.sym("scale", n)

    def with_derivatives(value: ca.SX, x: ca.SX, duration: ca.SX) -> ca.SX:
        return ca.horzcat(
            value, ca.jacobian(value, x), ca.jacobian(value, duration), ca.jtimes(value, p, dp)
        )

    flows, events = [], []
    for i, k in enumerate(closed):
        flow = cycle.phases[k].mode.flow
        assert flow is not None
        flows.append(with_derivatives(flow(scale * v[:, i], T[k], p) / scale, v[:, i], T[k]))
    for k, phase in enumerate(cycle.phases):
        events.append(with_derivatives(phase.end.function(scale * ends[:, k], T[k], p), ends[:, k], T[k]))
    return ca.Function(
        "joints",
        [v, ends, T, p, dp, scale],
        [ca.densify(ca.horzcat(*flows)) if flows else ca.SX(n, 0), ca.densify(ca.vertcat(*events))],
    )


class JointMap:
    """`joint_function` through fixed buffers; results are copies."""

    def __init__(self, cycle: Cycle) -> None:
        n, P = len(cycle.states), len(cycle.phases)
        function = joint_function(cycle)
        closed = function.size2_in(0)
        np_ = len(cycle.parameters)
        inputs = [(closed, n), (P, n), P, np_, np_, n]
        self._caller = caller(function, inputs, [(closed, n + 3, n), (n + 3, P)])

    def __call__(self, v: Array, ends: Array, T: Array, p: Array, dp: Array, scale: Array) -> Joints:
        buffers = self._caller.buffers
        for store, value in zip(buffers.inputs, (v, ends, T, p, dp, scale), strict=True):
            store[...] = value
        buffers.trigger()
        flow, events = buffers.outputs
        return Joints(flow.copy(), events.copy())


@kept(maxsize=64)
def joint_map(cycle: Cycle) -> JointMap:
    """The compiled map, kept for reuse: it does not depend on the mesh."""
    return JointMap(cycle)
