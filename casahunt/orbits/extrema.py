"""The largest and the smallest value of a state, or of any expression g(x; p), over a cycle, with their errors.

    g_x(x; p) . f(x; p) = 0    inside a phase,  or an end of it

The polynomial of an interval brackets the place; there an interval of its own, from the node before it to the place, is
solved by the equations of collocation, whose end is as accurate as a node.  At such a place g does not change with the
time, so its error is that of the state alone,

    g(exact) - g(found) = g_x (A dx_e + (s/h)^2d (dx_f - B dx_e - B' dh)),    A = d x(place)/d x_e,  B = d x_f/d x_e,

a linear functional of the nodes x_e before it and x_f behind and of the duration, B' = d x_f/dh, whose error the
adjoint gives as it gives that of the period (collocation/error_estimate.py).  What a whole step h adds to the error is
dx_f - B dx_e - B' dh; the step s to the place adds the less the shorter it is.  Where the parameter is free, lambda
moves g and the states at the place and at the end besides.

A maximum between two points, at which g has the rates r_a > 0 > r_b, lies below where the two tangents meet.  Only what
may exceed everything seen so far is solved for.

Symbols: n states, m points, N intervals.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ..collocation.error_estimate import Functional, functional_errors
from ..collocation.joints import flow_at
from ..collocation.mesh import sizes_of_states
from ..collocation.transcription import Setting, Transcription
from ..hybrid.system import VectorMode
from ..motion.march_exits import EXACT
from ..motion.march_step import ExtrapolatedStages, Stepper
from ..results import Result
from ..roots import CLOSED, LOOKED_AT, MOST_HALVINGS, Bracket, boundary
from .observables import Expression, Later, Values, flow_sensitivity, is_mirrored, kept_values

Array = np.ndarray

CONCAVE = 2.0
"""A maximum is at most this much higher, over the points beside it, than where their tangents meet."""
MOST_PLACES = 12
"""So many maxima are solved for, the most promising first: where g is constant but for rounding, any of them serves."""
Made = Callable[[VectorMode, Expression, int, int], Values]
"""Whoever compiles an expression in a mode of so many states and parameters."""


class _Extremum(NamedTuple):
    value: float
    time: float
    error: float


class Extremum(Result, _Extremum):
    """A value, the time at which it is taken (from the start of the first phase), and its estimated absolute error."""

    _quantities = ("value +- error", "time")


class _Extrema(NamedTuple):
    low: Extremum
    high: Extremum


class Extrema(Result, _Extrema):
    """The smallest and the largest value."""

    _quantities = ("smallest = low.value +- low.error", "largest = high.value +- high.error")
    _details = ("low", "high")

    @property
    def amplitude(self) -> float:
        """The largest magnitude."""
        return max(-self.low.value, self.high.value)


@dataclass(frozen=True, eq=False)
class _Candidate:
    """A place where g may be extreme: time, value, and of what the error is made.

    (node of the chain, (n,) weight) of states, the weight of lambda, and (phase, weight) of a duration.
    """

    time: float
    value: float
    weights: tuple[tuple[int, Array], ...]
    parameter: float
    duration: tuple[int, float] = (0, 0.0)


class _Seen(NamedTuple):
    """g on some elements: their phases (N,), their numbers in these and in the chain; times (N, m); g_x (N, m, n)."""

    phase: Array
    number: Array
    element: Array
    times: Array
    g: Array
    rate: Array
    g_x: Array


class _Rise(NamedTuple):
    """A maximum of sign * g between the points j and j + 1 of interval i, and what it may be at most."""

    most: float
    look: SampledPiece
    sign: int
    seen: _Seen
    i: int
    j: int


def extrema(t: Transcription, u: Array, setting: Setting, g: Expression) -> Extrema:
    """Smallest and largest value over a cycle.

    g: (x, p) -> scalar, of CasADi symbols. Returns extrema, in physical units. Raises InputError: g is no scalar.
    """
    looks = _looks(t, u, setting, g, Values, t.cycle.repeats)

    def found(sign: int) -> Extremum:
        look, place = _largest([(look, sign) for look in looks])
        piece = float(np.sum(t.durations_of(u)))
        error = float(functional_errors(t, u, setting, look.row(place)[None])[0][0])
        return Extremum(place.value, look.piece * piece + place.time, error)

    return Extrema(found(-1), found(+1))


def largest_magnitude(t: Transcription, u: Array, setting: Setting, g: Expression) -> Functional:
    """The largest |g| over a cycle as a functional of the node system, whose error the adjoint gives.

    g: (x, p) -> scalar, of CasADi symbols. Returns functional: the magnitude, its row, and by how much g changes where
    all states change by their sizes. Raises InputError: g is no scalar.
    """
    looks = _looks(t, u, setting, g, kept_values, 1 if is_mirrored(g, t.cycle) else t.cycle.repeats)
    look, place = _largest([(look, sign) for look in looks for sign in (+1, -1)])
    sizes = sizes_of_states(t, u, setting) * setting.scale
    change = max(float(np.max(np.abs(seen.g_x) @ sizes)) for look in looks for seen in look.seen)
    sign = -1.0 if place.value < 0 else 1.0
    return Functional(abs(place.value), sign * look.row(place), change)


def _looks(
    t: Transcription, u: Array, setting: Setting, g: Expression, values: Made, pieces: int
) -> list[SampledPiece]:
    """One look for each of some computed pieces of the period: g, and what it is where the motion is pieces later."""
    return [SampledPiece(t, u, setting, g if k == 0 else Later(g, t.cycle, k), k, values) for k in range(pieces)]


def _largest(looks: Sequence[tuple[SampledPiece, int]]) -> tuple[SampledPiece, _Candidate]:
    """The place where sign * g is largest in any of the looks."""
    ends = [(sign * place.value, look, place) for look, sign in looks for place in [look.best_node(sign)]]
    best, look, place = max(ends, key=lambda end: end[0])
    rises = sorted((rise for look, sign in looks for rise in look.rises(sign)), key=lambda rise: -rise.most)
    for rise in rises[:MOST_PLACES]:
        if not rise.most > best:
            break
        polished = rise.look.polished(rise.seen, rise.i, rise.j)
        if rise.sign * polished.value > best:
            best, look, place = rise.sign * polished.value, rise.look, polished
    return look, place


class SampledPiece:
    """One solution, looked at for the extrema of g, `piece` computed pieces after the first."""

    def __init__(self, t: Transcription, u: Array, setting: Setting, g: Expression, piece: int, values: Made) -> None:
        self.t, self.u, self.setting, self.piece = t, u, setting, piece
        self.nodes = t.nodes_of(u)
        self.durations = t.durations_of(u)
        self.w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n)
        modes = {phase.mode for phase in t.cycle.phases}
        self._values = {mode: values(mode, g, t.n, setting.p.size) for mode in modes}
        self.seen = self._seen()
        """Every element at many points."""

    def values(self, phase: int) -> Values:
        """g in the mode of a phase."""
        return self._values[self.t.cycle.phases[phase].mode]

    def _seen(self) -> list[_Seen]:
        """All intervals, and every phase in closed form."""
        t, scale, p = self.t, self.setting.scale, self.setting.p
        ends, seen = np.cumsum(self.durations), []
        if t.intervals:
            tau = LOOKED_AT
            points = (t.scheme.interpolation(tau) @ self.w) * scale
            points[:, -1] = self.nodes[t.behind_intervals] * scale
            phase, (begins, lengths) = t.phase_of_intervals, self._begins_and_lengths()
            at = ((ends - self.durations)[phase] + begins)[:, None] + lengths[:, None] * tau
            g, rate, g_x = np.empty(at.shape), np.empty(at.shape), np.empty(points.shape)
            for mode, own in t.modes:
                of_mode = self._values[mode](points[own].reshape(-1, t.n), p)
                for whole, part in zip((g, rate, g_x), of_mode, strict=True):
                    whole[own] = part.reshape(own.size, *whole.shape[1:])
            first = np.repeat(t.first_intervals, t.collocated_counts)
            seen.append(_Seen(phase, np.arange(t.intervals) - first, t.interval_elements, at, g, rate, g_x))
        for k in np.flatnonzero(np.array(t.counts) == 0).tolist():
            element, duration = t.phase_start[k : k + 1], float(self.durations[k])
            times = np.linspace(0, duration, 8 * (LOOKED_AT.size - 1) + 1)
            points = flow_at(t.cycle.phases[k].mode, self.nodes[element[0]] * scale, times, p)
            found = (part[None] for part in self.values(k)(points, p))
            seen.append(_Seen(np.array([k]), np.array([0]), element, (ends[k] - duration + times)[None], *found))
        return seen

    def of_phase(self, k: int) -> _Seen:
        """What is seen of one phase."""
        seen, own = next((seen, own) for seen in self.seen if (own := seen.phase == k).any())
        return _Seen(*(part[own] for part in seen))

    def _begins_and_lengths(self) -> tuple[Array, Array]:
        """(N,) times from the start of its phase at which each interval begins, and how long it lasts."""
        t, lengths = self.t, self.setting.fractions
        begins = np.cumsum(lengths) - lengths
        begins = begins - np.repeat(begins[t.first_intervals], t.collocated_counts)
        whole = np.repeat(np.add.reduceat(lengths, t.first_intervals), t.collocated_counts)
        unit = self.durations[t.phase_of_intervals] / whole
        return begins * unit, lengths * unit

    def edges(self, phase: int) -> Array:
        """(N + 1,) times from the start of a collocated phase at which its intervals begin and end."""
        fractions = self.setting.fractions[self.t.phase_intervals(phase)]
        return np.concatenate([[0.0], np.cumsum(fractions)]) / np.sum(fractions) * float(self.durations[phase])

    def best_node(self, sign: int) -> _Candidate:
        """The start or the end of an interval where sign * g is largest."""
        nodes = [(seen, sign * seen.g[:, [0, -1]]) for seen in self.seen]
        seen, values = max(nodes, key=lambda node: float(node[1].max()))
        i, behind = divmod(int(np.argmax(values)), 2)
        at, node = (i, -behind), int(seen.element[i]) + behind
        x, weights = self.nodes[node] * self.setting.scale, ((node, seen.g_x[at] * self.setting.scale),)
        return _Candidate(float(seen.times[at]), float(seen.g[at]), weights, self._by_parameter(int(seen.phase[i]), x))

    def _by_parameter(self, phase: int, x: Array) -> float:
        """dg/dlambda at a state."""
        return float(self.values(phase).by_parameters(x, self.setting.p) @ self.setting.dp)

    def rises(self, sign: int) -> Iterator[_Rise]:
        """The maxima of sign * g between two points."""
        for seen in self.seen:
            h, rate = sign * seen.g, sign * seen.rate
            for i, j in np.argwhere((rate[:, :-1] > 0) & (rate[:, 1:] <= 0)):
                a, b, r_a, r_b = h[i, j], h[i, j + 1], rate[i, j], rate[i, j + 1]
                dt = seen.times[i, j + 1] - seen.times[i, j]
                top, meet = max(a, b), a + r_a * np.clip((b - a - r_b * dt) / (r_a - r_b), 0.0, dt)
                yield _Rise(float(top + CONCAVE * max(meet - top, 0.0)), self, sign, seen, int(i), int(j))

    def polished(self, seen: _Seen, i: int, j: int) -> _Candidate:
        """The place between two points of an interval where the rate of g vanishes.

        seen, i, j: some elements, which of them, and the first of the two points.
        Returns the place, with g there and what its error needs.
        """
        t, p, element, phase, number = self.t, self.setting.p, *(int(part[i]) for part in (seen.element, *seen[:2]))
        times, rate = seen.times[i] - seen.times[i, 0], seen.rate[i]
        at, state_at = self.values(phase), self.followed(phase, number, float(times[-1]))

        def slope(time: float) -> float:
            return float(at(state_at(time)[None], p)[1][0])

        limit = CLOSED * float(times[-1])
        ends = [(float(times[k]), float(rate[k])) for k in (j, j + 1)]
        time = next((at_end for at_end, f in ends if f == 0), None)
        if time is None:
            bracket = Bracket(*ends[0], *ends[1])
            time = bracket.illinois
            for _ in range(MOST_HALVINGS):
                f = slope(time)
                if f == 0 or not np.isfinite(f) or bracket.width <= limit:
                    break
                bracket = bracket.told(time, f)
                time = bracket.illinois
        x = state_at(time)
        g, _, g_x = at(x[None], p)
        weight = g_x[0] * self.setting.scale
        share = (time / float(times[-1])) ** (2 * t.degree)
        here, whole = (weight @ self._through(phase, number, span) for span in (time, float(times[-1])))
        before = here - share * whole
        weights = ((element, before[: t.n]), (element + 1, share * weight))
        longer = -share * float(whole[t.n]) * float(times[-1]) / float(self.durations[phase])
        by_parameter = float(before[t.n + 1]) + self._by_parameter(phase, x)
        return _Candidate(float(seen.times[i, 0]) + time, float(g[0]), weights, by_parameter, (phase, longer))

    def crossed(self, seen: _Seen, i: int, j: int) -> tuple[float, Array, float]:
        """Time, state and rate of g where it goes through zero between two points of an interval, as of `polished`."""
        at, times = self.values(int(seen.phase[i])), seen.times[i] - seen.times[i, 0]
        state_at = self.followed(int(seen.phase[i]), int(seen.number[i]), float(times[-1]))
        rises = bool(seen.g[i, j] < seen.g[i, j + 1])

        def beyond(time: float) -> bool:
            return bool(at(state_at(time)[None], self.setting.p)[0][0] >= 0) is rises

        # Where it is zero at a point but for the error of the polynomial, it may be so beyond that point
        low = j - 1 if j > 0 and beyond(float(times[j])) else j
        high = j + 2 if j + 2 < times.size and not beyond(float(times[j + 1])) else j + 1
        time = boundary(beyond, float(times[low]), float(times[high]))[1]
        x = state_at(time)
        return float(seen.times[i, 0]) + time, x, float(at(x[None], self.setting.p)[1][0])

    def followed(self, phase: int, i: int, h: float) -> Callable[[float], Array]:
        """The state at a time after the start of interval i of a phase, of length h."""
        t, scale = self.t, self.setting.scale
        mode, start = t.cycle.phases[phase].mode, self.nodes[int(t.phase_start[phase]) + i]
        if t.counts[phase] == 0:
            return lambda time: flow_at(mode, start * scale, np.array([time]), self.setting.p)[0]
        w, stepper = self.w[t.phase_intervals(phase)][i], self.stepper(mode)

        def stepped(time: float) -> Array:
            solved = stepper(start, ExtrapolatedStages(w, 0.0, time / h), time, EXACT)
            x = (t.scheme.interpolation(np.array([time / h])) @ w)[0] if solved is None else solved.end
            return x * scale

        return stepped

    def stepper(self, mode: VectorMode) -> Stepper:
        """Intervals of a mode."""
        return Stepper(mode.field, self.t.scheme, self.setting.p, self.setting.scale, mode.sign, self.setting.dp)

    def _through(self, phase: int, i: int, time: float) -> Array:
        """(n, n + 2) d x(time)/d (x(start of interval i), time, lambda), scaled."""
        t, scale = self.t, self.setting.scale
        mode, start = t.cycle.phases[phase].mode, self.nodes[int(t.phase_start[phase]) + i]
        if t.counts[phase] == 0:
            found = flow_sensitivity(mode, start * scale, time, self.setting.p, self.setting.dp)
            return found * np.append(scale, [1.0, 1.0]) / scale[:, None]
        h = float(np.diff(self.edges(phase))[i])
        w = self.w[t.phase_intervals(phase)][i]
        guess = (t.scheme.interpolation(t.scheme.stages * (time / h)) @ w).ravel()
        return self.stepper(mode).through(start, guess, time)

    def row(self, place: _Candidate) -> Array:
        """(y,) the functional of the node system whose error is that of g at a place."""
        goal, n = np.zeros(self.t.system.size), self.t.n
        for node, weight in place.weights:
            goal[node * n : (node + 1) * n] += weight
        k, longer = place.duration
        goal[(self.t.elements + 1) * n + k] = longer
        goal[-1] = place.parameter
        return goal
