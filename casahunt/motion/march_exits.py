"""Where a mode ends: the first of its exits whose event h crosses zero, located to rounding.

    in closed form   h(x(T), T) = 0 by the secant method, exact where it is linear in T; elsewhere its first zero is
                     looked for by intervals, as below, and polished
    by intervals     h is beyond zero at a watched time of the interval;  h(end of an interval of length theta) = 0 by
                     Newton's method on true intervals, kept in a bracket

Symbols: n states, d stages, R = n (d + 1); theta, parts of an interval's length.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import casadi as ca
import numpy as np

from ..collocation.admissibility import PASSED
from ..collocation.scheme import Scheme
from ..compiled import Caller, caller, kept
from ..hybrid.system import Exit, Reset, VectorMode
from ..roots import LOOKED_AT, MOST_HALVINGS, Bracket, secant
from .march_step import ExtrapolatedStages, SolvedInterval
from .march_watch import EVENT_LIMIT, NEAR_EVENT, EventWatch

Array = np.ndarray

EVENT_TOLERANCE = 1e-13  # on events scaled to order one
EXIT_ROUNDING = 1e-14  # of an event, in units of its size: some ten times the rounding of the states in it
EXACT = 1e-22  # what Newton leaves of an interval's equations where an event is located
SECANTS_AT_MOST = 12  # secant steps to the end of a closed form: of a slow event the place goes on getting better
FLOW_LIMIT = 1e-9  # the same at the end of a closed form that is known nearly, or as a part of what it was


@kept(maxsize=64)
def ends_linear_in_time(mode: VectorMode, exits: tuple[Exit, ...], n: int, parameters: int) -> bool:
    """Whether the events of all exits of a mode in closed form are linear in the time spent in it.

    mode, exits: a mode with a flow, and its exits.
    """
    assert mode.flow is not None
    x, T, p = ca.SX.sym("x", n), ca.SX.sym("T"), ca.SX.sym("p", parameters)
    end = mode.flow(x, T, p)
    events = ca.vertcat(*[way_out.event.function(end, T, p) for way_out in exits])
    return not any(ca.which_depends(events, T, 2, False)) if exits else True


@kept(maxsize=64)
def _reset_map(reset: Reset, n: int, parameters: int) -> Caller:
    """The state behind an event, compiled."""
    x, p = ca.SX.sym("x", n), ca.SX.sym("p", parameters)
    return caller(ca.Function("reset", [x, p], [ca.densify(reset(x, p))]), [n, parameters], [n])


def behind(way_out: Exit, end: Array, p: Array) -> Array | None:
    """The state behind an exit.

    end: (n,) state in front of it. Returns (n,) state behind it; None where it does not jump.
    """
    if way_out.reset is None:
        return None
    buffers = _reset_map(way_out.reset, end.size, p.size).buffers
    buffers.inputs[0][:], buffers.inputs[1][:] = end, p
    buffers.trigger()
    return buffers.outputs[0].copy()


class _FlowMap:
    """Closed form of a mode and its exits' events, compiled and called through fixed buffers: views into them."""

    def __init__(self, mode: VectorMode, exits: tuple[Exit, ...], n: int, parameters: int) -> None:
        assert mode.flow is not None
        x, T, p = ca.SX.sym("x", n), ca.SX.sym("T"), ca.SX.sym("p", parameters)
        end = mode.flow(x, T, p)
        events = ca.vertcat(*[way_out.event.function(end, T, p) for way_out in exits])
        holds = ca.SX(0) if mode.admissible is None else ca.SX(mode.admissible(end, p, mode.sign))
        outputs = [ca.densify(end), ca.densify(events), ca.densify(holds) + mode.slack + PASSED]
        self._caller = caller(ca.Function("flow", [x, T, p], outputs), [n, 1, parameters], [n, len(exits), 1])

    def __call__(self, x: Array, T: float, p: Array) -> tuple[Array, Array, Array]:
        """(state after T, value of each exit's event there, what is >= 0 where the mode holds)."""
        buffers = self._caller.buffers
        state, time, parameters = buffers.inputs
        state[:], time[0], parameters[:] = x, T, p
        buffers.trigger()
        end, events, holds = buffers.outputs
        return end, events, holds


@kept(maxsize=16)
def _flow_map(mode: VectorMode, exits: tuple[Exit, ...], n: int, parameters: int) -> _FlowMap:
    """Kept for reuse."""
    return _FlowMap(mode, exits, n, parameters)


def end_of_flow(
    mode: VectorMode, exits: tuple[Exit, ...], x: Array, p: Array
) -> tuple[float, Exit, Array, bool] | None:
    """The first exit of a mode in closed form whose events are linear in time.

    x, p: (n,) state at its start; parameter vector.
    Returns duration [s], exit, (n,) state there, and whether the mode holds at both ends, and begins next to none of
    its events; None where no exit is met.
    """
    motion = _flow_map(mode, exits, x.size, p.size)
    best: tuple[float, Exit] | None = None
    (first, begins), (second, _) = ([out.tolist() for out in motion(x, T, p)[1:]] for T in (0.0, 1.0))
    for i, way_out in enumerate(exits):
        if not (second[i] - first[i]) * way_out.direction > 0:
            continue

        def h(T: float, i: int = i) -> float:
            return float(motion(x, T, p)[1][i])

        T, left = secant(h, 0.0, 1.0, tolerance=EVENT_TOLERANCE)
        # It is linear: what is left is rounding of what it was, in whatever unit.
        gone = abs(left) <= FLOW_LIMIT * max(abs(first[i]), abs(second[i]))
        met = T >= 0 and gone and (h(T + max(T, 1.0)) - left) * way_out.direction > 0
        if met and (best is None or best[0] > T):
            best = (T, way_out)
    if best is None:
        return None
    end, _, holds = motion(x, best[0], p)
    clean = begins[0] >= 0 and float(holds[0]) >= 0 and all(abs(event) > NEAR_EVENT for event in first)
    return *best, end.copy(), clean


def flow_to(
    mode: VectorMode, exits: tuple[Exit, ...], way_out: Exit | None, x: Array, T: float, p: Array
) -> tuple[float, Array]:
    """The end of a phase in closed form that is known nearly.

    mode, exits: a mode with a flow, and its exits; way_out: that of the phase, one of them; None where the time is
    over; x: (n,) state at its start; T: its duration, nearly [s].
    Returns duration, to rounding, and (n,) state at the end.
    """
    motion = _flow_map(mode, exits, x.size, p.size)
    if way_out is not None:
        i = exits.index(way_out)
        value = lambda t: float(motion(x, t, p)[1][i])  # noqa: E731
        near, left = secant(value, T, T * (1 - 1e-6), tolerance=0.0, rounds=SECANTS_AT_MOST)
        T = near if abs(left) <= FLOW_LIMIT else T
    return T, motion(x, T, p)[0].copy()


def _true_value(watch: EventWatch, which: int, start: Array, guess: ExtrapolatedStages, h: float) -> float:
    """An exit's event at the end of an interval of length h; no number where that is not solved."""
    solved = watch.stepper(start, guess, h, EXACT)
    return math.nan if solved is None else watch.at(solved.end)[0][which]


def _begin(
    value: Callable[[Array], tuple[float, float]], s: Scheme, w: Array, beyond: float
) -> tuple[float, Bracket, float]:
    """Where an event vanishes on a polynomial; a bracket of that, with a margin; size of the event there."""
    part = LOOKED_AT[1] - LOOKED_AT[0]
    low, high = beyond - part, beyond
    f_low, f_high = (value(end)[0] for end in s.interpolation(np.array([low, high])) @ w)
    theta = Bracket(low, f_low if f_low < 0 else -np.inf, high, f_high if f_high > 0 else np.inf).illinois
    # The polynomial at hand knows the signs at the ends better than the values, and these not beside a margin.
    margin = Bracket(max(low - part, 0.0), -np.inf, min(high + part, 1.0), np.inf)
    return theta, margin, max(-min(f_low, 0.0), f_high)


def locate_exit(
    watch: EventWatch, way_out: Exit, beyond: float, start: Array, stages: Array, h: float
) -> tuple[float, Array, Array] | None:
    """Shorten an interval until it ends on an event.

    beyond: watched local time (0..1] at which its event is beyond zero; start, stages: (n,), (d n,) states of the
    interval, in units of the scale; h: its length [s]. Returns length [s], (d n,) stages and (n,) end of the interval
    at whose end the event vanishes; None where none is found.  Where it begins on the event, but for rounding, and dips
    away by no more than that, it ends on the way back.
    """
    stepper, which = watch.stepper, watch.exits.index(way_out)
    s = stepper.scheme

    def value(state: Array) -> tuple[float, float]:
        values, rates = watch.at(state)
        return values[which], rates[which]

    w = np.concatenate([start, stages]).reshape(s.degree + 1, -1)
    theta, bracket, size = _begin(value, s, w, beyond)
    # Rounding in the states keeps the event from vanishing better than this.
    tolerance = max(EVENT_TOLERANCE, EXIT_ROUNDING * max(size, stepper.scale_of(way_out)))
    solved: SolvedInterval | None = None
    begins, f, last = value(start)[0], np.inf, np.inf
    reach = 1.0  # local time at the end of the interval whose polynomial w is
    for _ in range(MOST_HALVINGS):
        solved = stepper(start, ExtrapolatedStages(w, 0.0, theta / reach), theta * h, EXACT)
        if solved is None:
            return None
        f, rate = value(solved.end)
        if np.isnan(f):
            return None
        nearer = not f <= begins < 0  # else it has dipped, and is not back
        if nearer:
            w, reach = np.concatenate([start, solved.stages]).reshape(s.degree + 1, -1), theta
        if (nearer and abs(f) <= tolerance) or bracket.width < 1e-15:
            break
        bracket = bracket.told(theta, f)
        rate *= h
        shrinks = rate > 0 and abs(f) < 0.5 * last
        if not shrinks and not (np.isfinite(bracket.f_a) and np.isfinite(bracket.f_b)):
            # Before it is halved to nothing: does the event change its sign on true intervals at all?
            ends = [
                _true_value(watch, which, start, ExtrapolatedStages(w, 0.0, end / reach), end * h)
                for end in (bracket.a, bracket.b)
            ]
            if not ends[0] < 0 < ends[1]:
                break
            bracket = Bracket(bracket.a, ends[0], bracket.b, ends[1])
        theta, last = bracket.newton(theta, f, rate) if shrinks else bracket.middle, abs(f)
    # A crossing that true intervals do not confirm was an artefact of too long an interval.
    return (theta * h, solved.stages, solved.end) if solved is not None and abs(f) <= EVENT_LIMIT else None
