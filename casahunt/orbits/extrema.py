"""The largest and the smallest value of a state, or of any expression g(x; p), over a cycle, with their errors.

    g_x(x; p) . f(x; p) = 0    inside a phase,  or an end of it

The polynomial of an interval brackets the place; there an interval of its own, from the node before it to the place, is
solved by the equations of collocation, whose end is as accurate as a node.  At such a place g does not change with the
time, so its error is that of the state alone,

    g(exact) - g(found) = g_x A dx_e + g_x (what the step to the place adds),        A = d x(place)/d x_e,

linear functionals of the nodes before and behind it, whose errors the adjoint gives as it gives that of the period
(collocation/error_estimate.py): the node behind holds what a whole step adds, taken back by A B^-1, B the derivative of
the whole step.

Symbols: n states, m points.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ..checks import known
from ..collocation.error_estimate import functional_errors
from ..collocation.joints import flow_at
from ..collocation.transcription import Setting, Transcription
from ..compiled import alone, caller
from ..errors import InputError
from ..hybrid.roots import Bracket
from ..hybrid.system import Cycle, Mode
from ..hybrid.vector_form import Names, Scalar
from ..motion.march_step import Stepper

Array = np.ndarray
Expression = Callable[[Any, Any], Any]
"""(x, p) -> scalar, of CasADi symbols."""

LOOKED_AT = 17
"""Points of an interval, both ends among them, between which the rate of g may change its sign."""
CLOSED_FORM_LOOKS = 129
"""The same for a phase in closed form."""
WORTH_POLISHING = 0.05
"""Places at which g is this part of its range short of the best are polished too."""
PLACED = 1e-13
"""A place is known to this part of its interval: g is flat there."""
SOLVED_TO = 1e-22
INVERTIBLE = 1e8
"""Condition number of a step up to which the error of its end is taken back into it."""
MOST_POLISHING = 60


class Extremum(NamedTuple):
    """A value, the time at which it is taken (from the start of the first phase), and its estimated absolute error."""

    value: float
    time: float
    error: float


class Extrema(NamedTuple):
    """The smallest and the largest value."""

    low: Extremum
    high: Extremum

    @property
    def amplitude(self) -> float:
        """The largest magnitude."""
        return max(-self.low.value, self.high.value)


@dataclass(frozen=True, eq=False)
class _Place:
    """A place where g may be extreme: time, value, and the functionals whose larger error is that of the value.

    `weights` are (node of the chain, (n,) weight).
    """

    time: float
    value: float
    weights: tuple[tuple[int, Array], ...]


def extrema(t: Transcription, u: Array, setting: Setting, g: Expression) -> Extrema:
    """Smallest and largest value over a cycle.

    Parameters
    ----------
    t, u, setting
        a solution.
    g
        (x, p) -> scalar, of CasADi symbols.

    Returns
    -------
    Extrema, in physical units.

    Raises
    ------
    InputError : g is no scalar.
    """
    piece = float(np.sum(t.durations_of(u)))
    found: list[tuple[Extremum, Extremum]] = []
    for k in range(t.cycle.repeats):
        look = _Look(t, u, setting, g if k == 0 else _Later(g, t.cycle, k))
        places = list(look.places())
        best = min(places, key=_value), max(places, key=_value)
        low, high = (Extremum(place.value, k * piece + place.time, look.error(place)) for place in best)
        found.append((low, high))
    return Extrema(min((low for low, _ in found), key=_value), max((high for _, high in found), key=_value))


def _value(found: _Place | Extremum) -> float:
    return found.value


@dataclass(frozen=True, eq=False)
class _Later:
    """g where the motion is k computed pieces later, as a function of where it is now."""

    g: Expression
    cycle: Cycle
    pieces: int

    def __call__(self, x: Any, p: Any) -> Any:
        inverse = np.linalg.inv(self.cycle.closure)
        for _ in range(self.pieces):
            x = ca.mtimes(ca.DM(inverse), x + ca.DM(self.cycle.shift or np.zeros(x.shape[0])))
        return self.g(x, p)


def scalar_of(what: Any, names: Names) -> Scalar:
    """A state, or a function of the user's, as a scalar of the vectors.

    Parameters
    ----------
    what
        name of a state, or a function (x, p) of named states and parameters.
    names
        what the entries of the vectors are called.

    Returns
    -------
    Scalar.

    Raises
    ------
    InputError : it is neither.
    """
    if isinstance(what, str):
        i = names.entries.index(known("state", what, names.states))
        return Scalar(_Coordinate(names.states[i]), names)
    if not callable(what):
        raise InputError(f"{what!r}: must be the name of a state or a function (x, p)")
    return Scalar(what, names)


@dataclass(frozen=True)
class _Coordinate:
    """(x, p) -> one state."""

    name: str

    def __call__(self, x: Any, p: Any) -> Any:
        return getattr(x, self.name)


class _Look:
    """One solution, looked at for the extrema of g."""

    def __init__(self, t: Transcription, u: Array, setting: Setting, g: Expression) -> None:
        self.t, self.u, self.setting, self.g = t, u, setting, g
        self.nodes = t.nodes_of(u)
        self.durations = t.durations_of(u)
        self.w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)

    def places(self) -> Iterator[_Place]:
        """The ends of all phases, and every place inside where g may be extreme."""
        candidates = []
        for k, phase in enumerate(self.t.cycle.phases):
            at = _Values(phase.mode, self.g, self.t.n, self.setting.p.size)
            began = float(np.sum(self.durations[:k]))
            for element in range(int(self.t.phase_start[k]), int(self.t.phase_end[k])):
                candidates.append((at, *self.looked_at(k, element, began)))
        low = min(float(at(points, self.setting.p)[0].min()) for at, points, *_ in candidates)
        high = max(float(at(points, self.setting.p)[0].max()) for at, points, *_ in candidates)
        margin = WORTH_POLISHING * (high - low)
        for at, points, times, element, state_at in candidates:
            g, rate, g_x = at(points, self.setting.p)
            for i in (0, -1):
                weight = g_x[i] * self.setting.scale
                yield _Place(float(times[i]), float(g[i]), ((element if i == 0 else element + 1, weight),))
            extreme = (np.maximum(g[:-1], g[1:]) > high - margin) | (np.minimum(g[:-1], g[1:]) < low + margin)
            for j in np.flatnonzero(((rate[:-1] > 0) != (rate[1:] > 0)) & extreme):
                yield self.polished(at, state_at, element, times, rate, int(j))

    def looked_at(self, k: int, element: int, began: float) -> tuple[Array, Array, int, Callable[[float], Array]]:
        """(states (m, n), times (m,), element, the state at a time after the first of them) of one element."""
        t, scale, mode = self.t, self.setting.scale, self.t.cycle.phases[k].mode
        start = self.nodes[element] * scale
        if t.counts[k] == 0:
            times = np.linspace(0, float(self.durations[k]), CLOSED_FORM_LOOKS)

            def flowed(time: float) -> Array:
                return flow_at(mode, start, np.array([time]), self.setting.p)[0]

            return flow_at(mode, start, times, self.setting.p), began + times, element, flowed
        i = int(np.searchsorted(t.interval_elements, element))
        fractions = self.setting.fractions[t.phase_intervals(k)]
        edges = np.concatenate([[0.0], np.cumsum(fractions)]) / np.sum(fractions) * float(self.durations[k])
        j = i - t.phase_intervals(k).start
        h = float(edges[j + 1] - edges[j])
        tau = np.linspace(0, 1, LOOKED_AT)
        points = (t.scheme.interpolation(tau) @ self.w[i]) * scale
        points[-1] = self.nodes[element + 1] * scale
        stepper = Stepper(mode.field, t.scheme, self.setting.p, scale, mode.sign)

        def stepped(time: float) -> Array:
            guess = (t.scheme.interpolation(t.scheme.stages * (time / h)) @ self.w[i]).ravel()
            solved = stepper(self.nodes[element], guess, time, SOLVED_TO)
            x = (t.scheme.interpolation(np.array([time / h])) @ self.w[i])[0] if solved is None else solved[1]
            return x * scale

        return points, began + edges[j] + h * tau, element, stepped

    def polished(
        self, at: _Values, state_at: Callable[[float], Array], element: int, times: Array, rate: Array, i: int
    ) -> _Place:
        """The place between two points where the rate of g vanishes."""
        first = float(times[0])

        def slope(time: float) -> float:
            return float(at(state_at(time)[None], self.setting.p)[1][0])

        limit = PLACED * float(times[-1] - times[0])
        ends = [(float(times[j]) - first, float(rate[j])) for j in (i, i + 1)]
        time = next((at_end for at_end, f in ends if f == 0), None)
        if time is None:
            bracket = Bracket(*ends[0], *ends[1])
            time = bracket.illinois
            for _ in range(MOST_POLISHING):
                f = slope(time)
                if f == 0 or not np.isfinite(f) or bracket.width <= limit:
                    break
                bracket = bracket.told(time, f)
                time = bracket.illinois
        x = state_at(time)
        g, _, g_x = at(x[None], self.setting.p)
        A = self.through(element, time)
        weight = g_x[0] * self.setting.scale
        weights = [(element, weight @ A)]
        whole = self.through(element, float(times[-1]) - first)
        if np.linalg.cond(whole) < INVERTIBLE:
            weights.append((element + 1, weight @ A @ np.linalg.inv(whole)))
        return _Place(first + time, float(g[0]), tuple(weights))

    def through(self, element: int, time: float) -> Array:
        """(n, n) d x(time)/d x(start of the element), scaled."""
        k = int(self.t.phase_of[element])
        mode, scale = self.t.cycle.phases[k].mode, self.setting.scale
        if self.t.counts[k] == 0:
            return _flow_sensitivity(mode, self.nodes[element] * scale, time, self.setting.p) * scale / scale[:, None]
        stepper = Stepper(mode.field, self.t.scheme, self.setting.p, scale, mode.sign)
        i = int(np.searchsorted(self.t.interval_elements, element))
        h = float(self.setting.fractions[i] * self.durations[k])
        guess = (self.t.scheme.interpolation(self.t.scheme.stages * (time / h)) @ self.w[i]).ravel()
        return stepper.through(self.nodes[element], guess, time)

    def error(self, place: _Place) -> float:
        """Estimated error of the value there."""
        goals = np.zeros((len(place.weights), self.t.system.size))
        for goal, (node, weight) in zip(goals, place.weights, strict=True):
            goal[node * self.t.n : (node + 1) * self.t.n] = weight
        return float(functional_errors(self.t, self.u, self.setting, goals)[0].max())


class _Values:
    """g, its rate along the field of a mode, and its gradient, at numbers."""

    @alone
    def __init__(self, mode: Mode, g: Expression, n: int, parameters: int) -> None:
        x, p = ca.SX.sym("x", n), ca.SX.sym("p", parameters)
        value = ca.SX(g(x, p))
        if value.shape != (1, 1):
            raise InputError(f"the expression must be a scalar, not one of shape {value.shape}")
        gradient = ca.densify(ca.gradient(value, x))
        rate = ca.dot(gradient, mode.field(x, p, mode.sign))
        function = ca.Function("g", [x, p], [ca.densify(value), ca.densify(rate), gradient])
        self._at_one = caller(function, [n, parameters], [1, 1, n])
        self._at_many = caller(
            function.map("many", "serial", LOOKED_AT, [1], []),
            [(LOOKED_AT, n), parameters], [LOOKED_AT, LOOKED_AT, (LOOKED_AT, n)],
        )  # fmt: skip

    def __call__(self, points: Array, p: Array) -> tuple[Array, Array, Array]:
        """(g (m,), its rate (m,), g_x (m, n)) at the states (m, n)."""
        m = len(points)
        buffers = (self._at_one if m == 1 else self._at_many).buffers
        g, rate, g_x = np.empty(m), np.empty(m), np.empty(points.shape)
        for first in range(0, m, LOOKED_AT):
            chunk = slice(first, first + LOOKED_AT)
            count = len(points[chunk])
            buffers.inputs[0].reshape(-1, points.shape[1])[:count], buffers.inputs[1][:] = points[chunk], p
            buffers.trigger()
            for store, out in zip((g, rate, g_x), buffers.outputs, strict=True):
                store[chunk] = out.reshape(-1, *store.shape[1:])[:count]
        return g, rate, g_x


@alone
def _flow_sensitivity(mode: Mode, x: Array, time: float, p: Array) -> Array:
    """(n, n) derivative of a closed form by the state at its start."""
    assert mode.flow is not None
    start, T, q = ca.SX.sym("x", x.size), ca.SX.sym("T"), ca.SX.sym("p", p.size)
    function = ca.Function("sensitivity", [start, T, q], [ca.densify(ca.jacobian(mode.flow(start, T, q), start))])
    return np.array(function(x, time, p))
