"""Are the solutions of many members motions of the system?  admissibility.py with members in front.

The same conditions are evaluated operation after operation at the points of all members (over_arrays.py).  What is
admitted here is so without reservation and without a mode's slack: within its slack a phase may do for a moment what
another mode would, without that any estimate of an error knows it.  A member that is not admitted is left to whoever
solves it alone.

Symbols: B members, n states, d stages, N intervals, P phases.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import Any

import casadi as ca
import numpy as np

from ..compiled import kept
from ..hybrid.system import Mode, Phase
from .admissibility import (
    BARELY,
    BETWEEN,
    NOISE,
    NOTHING_LEFT,
    PASSED,
    RESOLUTION,
    dense_rule,
    judge,
    largest_of_phase,
    not_clear,
)
from .joints import linear_in_time
from .near_events import comes_and_goes
from .over_arrays import OverArrays
from .transcription import Setting, Transcription

Array = np.ndarray


def admissible_many(t: Transcription, u: Array, settings: Setting) -> Array:
    """Whether converged solutions are motions, without reservation and without slack.

    t, u, settings: transcription, (B, size) unknowns, and settings. Returns (B,) bool.
    """
    try:
        with np.errstate(all="ignore"):
            return _Solutions(t, u, settings).verdicts()
    except NotSymbolic:
        return np.array([judge(t, u[b], settings.of(b)).admissible for b in range(len(u))], dtype=bool)


class NotSymbolic(Exception):
    """A condition works on numbers alone."""


class _Solutions:
    """The solutions of B members as arrays."""

    def __init__(self, t: Transcription, u: Array, s: Setting) -> None:
        self.t, self.u, self.s, B = t, u, s, len(u)
        self.nodes = t.nodes_of(u) * s.scale[:, None]
        self.T = u[:, -t.phases :]
        w = u[:, : t.intervals * t.rows].reshape(B, t.intervals, t.degree + 1, t.n)
        self.w = w * s.scale[:, None, None]

    def verdicts(self) -> Array:
        """(B,) bool."""
        good: Array = np.asarray((self.T > 0).all(axis=1))
        if self.t.intervals:
            good &= self._inside()
        asked = np.zeros(len(good), dtype=bool)
        for k, phase in enumerate(self.t.cycle.phases):
            if phase.direction:
                good &= self._ends_that_way(k, phase)
            if phase.mode.admissible is not None and not self.t.counts[k]:
                good &= self._closed_form(k, phase.mode)
            for way_out in phase.exits:
                asked |= self._may_pass(k, way_out.event.function, way_out.direction)
        for b in np.flatnonzero(good & asked).tolist():
            verdict = judge(self.t, self.u[b], self.s.of(b))
            good[b] = verdict.admissible and verdict.barely < 0
        return good

    def _ends_that_way(self, k: int, phase: Phase) -> Array:
        """(B,) whether the event at the end of a phase is not met from the other side."""
        rate, size = self._at(_rate(phase, self.t.n, self.s.p.shape[1]), self.nodes[:, self.t.phase_end[k]], k)
        return np.asarray(phase.direction * rate >= -NOISE * size)

    def _closed_form(self, k: int, mode: Mode) -> Array:
        """(B,) whether the condition of a phase in closed form holds."""
        assert mode.admissible is not None
        (values,) = self._at(_condition(mode, self.t.n, self.s.p.shape[1]), self._states_of_closed(k, mode))
        return np.asarray(values.min(axis=1) + NOISE * np.maximum(1.0, np.abs(values).max(axis=1)) >= 0)

    def _states_of_closed(self, k: int, mode: Mode) -> Array:
        """(B, m, n) states along a phase in closed form."""
        start, n, parameters = self.t.phase_start[k], self.t.n, self.s.p.shape[1]
        if linear_in_time(mode, n, parameters):
            return self.nodes[:, start : start + 2]
        return self._flown(k, mode)

    def _flown(self, k: int, mode: Mode) -> Array:
        """(B, 33, n) states along a phase in closed form, at equal steps."""
        x = np.repeat(self.nodes[:, self.t.phase_start[k], None], BETWEEN.size, axis=1)
        found = self._at(_flow(mode, self.t.n, self.s.p.shape[1]), x, self.T[:, k, None] * BETWEEN)
        return np.stack(found, axis=-1)

    def _may_pass(self, k: int, event: Callable[..., Any], direction: int) -> Array:
        """(B,) whether a way out may be passed inside a phase: another look will tell."""
        t, B = self.t, len(self.u)
        own = t.phase_intervals(k)
        x = self.w[:, own].reshape(B, -1, t.n) if t.counts[k] else self._flown(k, t.cycle.phases[k].mode)
        (values,) = self._at(_event(event, t.n, self.s.p.shape[1]), x)
        values, doubt = direction * values[:, None], np.zeros((B, 1, 1))
        if t.counts[k]:
            values = values.reshape(B, -1, t.degree + 1)
            doubt = RESOLUTION * np.abs(values @ t.scheme.last_mode)[:, :, None]
            values = np.matmul(values, dense_rule(t.degree, t.kind)[0])
        size = np.maximum(1.0, np.abs(values).max(axis=(1, 2)))[:, None, None]
        perhaps = np.logical_or(*comes_and_goes(values, doubt, BARELY * size)).any(axis=(1, 2))
        values, slack = values.reshape(B, -1), PASSED * size[:, :, 0]
        passed = (np.minimum.accumulate(values, axis=1) < -slack) & (values > slack)
        return np.asarray(perhaps | passed.any(axis=1))

    def _inside(self) -> Array:
        """(B,) whether the conditions of all collocated phases hold and nothing hides in an interval."""
        t, (B, N, _, n), parameters = self.t, self.w.shape, self.s.p.shape[1]
        good, values = np.ones(B, dtype=bool), np.zeros(self.w.shape[:3])
        slack, conditioned = np.zeros(N), np.zeros(N, dtype=bool)
        ends = self.nodes[:, t.interval_elements + 1]
        for mode, members in t.modes:
            states = self.w[:, members]
            if mode.feature is not None:
                x = np.concatenate([states, ends[:, members, None]], axis=2)
                (found,) = self._at(_feature(mode, n, parameters), x.reshape(B, -1, n))
                jumps = np.abs(np.diff(found.reshape(B, members.size, -1), axis=2))
                good &= ~(jumps > NOTHING_LEFT).any(axis=(1, 2))
            if mode.admissible is not None:
                (found,) = self._at(_condition(mode, n, parameters), states.reshape(B, -1, n))
                values[:, members] = found.reshape(B, members.size, -1)
                slack[members], conditioned[members] = mode.slack, True
        if not conditioned.any():
            return good
        dense = np.matmul(values, dense_rule(t.degree, t.kind)[0])
        below = dense.min(axis=2) + NOISE * np.maximum(1.0, largest_of_phase(t, dense)) < 0
        return np.asarray(good & ~(conditioned & (below | not_clear(t, values, slack))).any(axis=1))

    def _at(self, function: OverArrays, x: Array, T: Array | int = 0) -> list[Array]:
        """Values (B, m) at states (B, m, n), or (B,) at (B, n); `T` are durations, or the number of a phase."""
        many = x.ndim == 3
        times = self.T[:, T] if isinstance(T, int) else T
        shape = x.shape[:-1]
        p = [self.s.p[:, i, None] if many else self.s.p[:, i] for i in range(self.s.p.shape[1])]
        times = times[:, None] if many and times.ndim == 1 else times
        found = function([np.ascontiguousarray(x[..., i]) for i in range(x.shape[-1])], [times], p)
        return [np.broadcast_to(value, shape) for outputs in found for value in outputs]


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
def _condition(mode: Mode, n: int, parameters: int) -> OverArrays:
    assert mode.admissible is not None
    admissible = mode.admissible
    return _built(n, parameters, lambda x, T, p: [admissible(x, p, mode.sign)])


@kept(maxsize=64)
def _feature(mode: Mode, n: int, parameters: int) -> OverArrays:
    assert mode.feature is not None
    feature = mode.feature
    return _built(n, parameters, lambda x, T, p: [feature(x, p)])


@kept(maxsize=64)
def _flow(mode: Mode, n: int, parameters: int) -> OverArrays:
    assert mode.flow is not None
    flow = mode.flow
    return _built(n, parameters, lambda x, T, p: [flow(x, T, p)])


@kept(maxsize=64)
def _event(event: Callable[..., Any], n: int, parameters: int) -> OverArrays:
    return _built(n, parameters, lambda x, T, p: [event(x, 0.0, p)])


@kept(maxsize=64)
def _rate(phase: Phase, n: int, parameters: int) -> OverArrays:
    """As `joints.event_rate`."""

    def outputs(x: ca.SX, T: ca.SX, p: ca.SX) -> list[ca.SX]:
        gradient = ca.densify(ca.jacobian(phase.end.function(x, T, p), x))
        f = ca.densify(phase.mode.field(x, p, phase.mode.sign))
        return [gradient @ f, ca.fabs(gradient) @ ca.fabs(f)]

    return _built(n, parameters, outputs)
