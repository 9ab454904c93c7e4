"""What the phases of a cycle say of solutions: their states, and conditions, features and events there.

Of one member by the functions themselves, which take arrays of states; of many, whose parameters differ, operation
after operation at the points of all of them (ensemble_points.py).

Symbols: B members, n states, d stages, N intervals, E elements, P phases, m points.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from ..compiled import kept
from ..hybrid.system import Feature, Phase, VectorEvent, VectorMode
from .ensemble_points import OverArrays
from .joints import event_rate, flow_at
from .transcription import Setting, Transcription

Array = np.ndarray

BETWEEN = np.linspace(0, 1, 33)
"""Parts of an interval, or of a phase in closed form, at which a condition is looked at."""


class NotSymbolic(Exception):
    """A condition works on numbers alone."""


class Conditions:
    """Solutions u (..., size), in physical units, and what is said of them.

    nodes (..., E + 1, n), w (..., N, d + 1, n) starts and stages, durations (..., P).  Asked of many members, a
    function that works on numbers alone raises NotSymbolic.
    """

    def __init__(self, t: Transcription, u: Array, setting: Setting) -> None:
        self.t, self.p, self.lead, scale = t, setting.p, u.shape[:-1], setting.scale
        self.nodes, self.durations = t.nodes_of(u) * scale[..., None, :], t.durations_of(u)
        self.w = t.intervals_of(u).reshape(*self.lead, t.intervals, t.degree + 1, t.n) * scale[..., None, None, :]

    def between(self, members: Array) -> Array:
        """(..., M, m, n) states inside intervals, of the polynomials."""
        to = self.t.scheme.interpolation(BETWEEN)
        return np.asarray(to @ self.w.take(members, axis=-3))

    def condition(self, mode: VectorMode, x: Array) -> Array:
        """(..., m) of a mode at states (..., m, n)."""
        if self.lead:
            return self._over(_condition(mode, self.t.n, self.p.shape[-1]), x)[0]
        assert mode.admissible is not None
        return np.asarray(mode.admissible(x.T, self.p, mode.sign), float)

    def feature(self, feature: Feature, x: Array) -> Array:
        """(..., m) of a mode's feature at states (..., m, n)."""
        if self.lead:
            return self._over(_feature(feature, self.t.n, self.p.shape[-1]), x)[0]
        return np.asarray(feature(x.T, self.p), float)

    def event(self, event: VectorEvent, x: Array) -> Array:
        """(..., m) of an event at states (..., m, n)."""
        if self.lead:
            return self._over(_event(event, self.t.n, self.p.shape[-1]), x)[0]
        return np.asarray(event.function(x.T, 0.0, self.p), float)

    def end_rate(self, k: int) -> tuple[Array, Array]:
        """(..., ) of the event at the end of a phase, as `joints.event_rate`."""
        phase, x, T = self.t.cycle.phases[k], self.nodes[..., self.t.phase_end[k], :], self.durations[..., k]
        if self.lead:
            rate, size = self._over(_rate(phase, self.t.n, self.p.shape[-1]), x[..., None, :], T[..., None])
            return rate[..., 0], size[..., 0]
        rate_, size_ = event_rate(phase, x, float(T), self.p)
        return np.asarray(rate_), np.asarray(size_)

    def along_closed(self, k: int) -> Array:
        """(..., m, n) states along a phase in closed form."""
        mode, start = self.t.cycle.phases[k].mode, self.t.phase_start[k]
        times = self.durations[..., k, None] * BETWEEN
        if not self.lead:
            return flow_at(mode, self.nodes[start], times, self.p)
        x = np.repeat(self.nodes[..., start, None, :], BETWEEN.size, axis=-2)
        return np.stack(self._over(_flow(mode, self.t.n, self.p.shape[-1]), x, times), axis=-1)

    def _over(self, function: OverArrays, x: Array, T: Any = 0.0) -> list[Array]:
        """Values (B, m) at states (B, m, n) and durations (B, m)."""
        p = [self.p[:, i, None] for i in range(self.p.shape[1])]
        found = function([np.ascontiguousarray(x[..., i]) for i in range(x.shape[-1])], [T], p)
        return [np.broadcast_to(value, x.shape[:-1]) for outputs in found for value in outputs]


def _built(n: int, parameters: int, outputs: Callable[[ca.SX, ca.SX, ca.SX], list[Any]]) -> OverArrays:
    """Functions of x, T and p.  Raises NotSymbolic where they take numbers alone."""
    x, T, p = ca.SX.sym("x", n), ca.SX.sym("T"), ca.SX.sym("p", parameters)
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("error", FutureWarning)  # CasADi's, where numpy is asked of its symbols
            found = [ca.densify(ca.SX(value)) for value in outputs(x, T, p)]
    except (TypeError, AttributeError, ValueError, NotImplementedError, RuntimeError, FutureWarning):
        raise NotSymbolic from None
    return OverArrays(ca.Function("condition", [x, T, p], found))


@kept(maxsize=64)
def _condition(mode: VectorMode, n: int, parameters: int) -> OverArrays:
    assert mode.admissible is not None
    admissible = mode.admissible
    return _built(n, parameters, lambda x, T, p: [admissible(x, p, mode.sign)])


@kept(maxsize=64)
def _feature(feature: Feature, n: int, parameters: int) -> OverArrays:
    return _built(n, parameters, lambda x, T, p: [feature(x, p)])


@kept(maxsize=64)
def _flow(mode: VectorMode, n: int, parameters: int) -> OverArrays:
    assert mode.flow is not None
    flow = mode.flow
    return _built(n, parameters, lambda x, T, p: [flow(x, T, p)])


@kept(maxsize=64)
def _event(event: VectorEvent, n: int, parameters: int) -> OverArrays:
    return _built(n, parameters, lambda x, T, p: [event.function(x, 0.0, p)])


@kept(maxsize=64)
def _rate(phase: Phase, n: int, parameters: int) -> OverArrays:
    """As `joints.event_rate`."""

    def outputs(x: ca.SX, T: ca.SX, p: ca.SX) -> list[ca.SX]:
        gradient = ca.densify(ca.jacobian(phase.end.function(x, T, p), x))
        f = ca.densify(phase.mode.field(x, p, phase.mode.sign))
        return [gradient @ f, ca.fabs(gradient) @ ca.fabs(f)]

    return _built(n, parameters, outputs)
