"""Where a mode ends: the first of its exits whose event h crosses zero, located to rounding.

    in closed form   h(x(T), T) = 0 by the secant method, exact where it is linear in T; elsewhere its first zero is
                     looked for by intervals, as below, and polished
    by intervals     h is beyond zero at a watched time of the interval;  h(end of an interval of length theta) = 0 by
                     Newton's method on true intervals, kept in a bracket

Symbols: n states, d stages, R = n (d + 1); theta, parts of an interval's length.
"""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from ..collocation.admissibility import LARGEST_JUMP, RESOLUTION, hides
from ..collocation.scheme import Kind, scheme
from ..compiled import Caller, caller, kept
from ..hybrid.roots import Bracket, secant
from ..hybrid.system import Exit, Feature, Field, Mode, Reset
from ..hybrid.vector_form import Bound
from .march_step import Foretold, Solved, Stepper

Array = np.ndarray

EVENT_TOLERANCE = 1e-13  # on events scaled to order one
EXIT_ROUNDING = 1e-14
EXACT = 1e-22  # what Newton leaves of an interval's equations where an event is located
EVENT_LIMIT = 1e-10  # an event counts as located
FLOW_LIMIT = 1e-9  # the same at the end of a closed form
EXIT_ROUNDS = 60
EXCURSION = 1e-8  # an event beyond zero by less than this is no crossing
ON_EVENT = EVENT_LIMIT  # a state is on an event, not beside it: where an exit was located to no less
_WATCH = np.linspace(0, 1, 17)  # local times at which an interval is watched for exits


class TooLong(Exception):
    """The interval is too long to tell whether an event crosses zero in it."""


@kept(maxsize=64)
def ends_linear_in_time(mode: Mode, exits: tuple[Exit, ...], n: int, parameters: int) -> bool:
    """Whether the events of all exits of a mode in closed form are linear in the time spent in it.

    Parameters
    ----------
    mode, exits
        a mode with a flow, and its exits.
    n, parameters
        numbers of states and of parameters.

    Returns
    -------
    True where they are.
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

    Parameters
    ----------
    way_out
        the exit.
    end
        (n,) state in front of it.
    p
        parameter vector.

    Returns
    -------
    (n,) state behind it; None where it does not jump.
    """
    if way_out.reset is None:
        return None
    buffers = _reset_map(way_out.reset, end.size, p.size).buffers
    buffers.inputs[0][:], buffers.inputs[1][:] = end, p
    buffers.trigger()
    return buffers.outputs[0].copy()


class _FlowMap:
    """Closed form of a mode and its exits' events, compiled and called through fixed buffers: views into them."""

    def __init__(self, mode: Mode, exits: tuple[Exit, ...], n: int, parameters: int) -> None:
        assert mode.flow is not None
        x, T, p = ca.SX.sym("x", n), ca.SX.sym("T"), ca.SX.sym("p", parameters)
        end = mode.flow(x, T, p)
        events = ca.vertcat(*[way_out.event.function(end, T, p) for way_out in exits])
        function = ca.Function("flow", [x, T, p], [ca.densify(end), ca.densify(events)])
        self._caller = caller(function, [n, 1, parameters], [n, len(exits)])

    def __call__(self, x: Array, T: float, p: Array) -> tuple[Array, Array]:
        """(state after T, value of each exit's event there)."""
        buffers = self._caller.buffers
        state, time, parameters = buffers.inputs
        state[:], time[0], parameters[:] = x, T, p
        buffers.trigger()
        end, events = buffers.outputs
        return end, events


@kept(maxsize=16)
def _flow_map(mode: Mode, exits: tuple[Exit, ...], n: int, parameters: int) -> _FlowMap:
    """Kept for reuse."""
    return _FlowMap(mode, exits, n, parameters)


def end_of_flow(mode: Mode, exits: tuple[Exit, ...], x: Array, p: Array) -> tuple[float, Exit, Array] | None:
    """The first exit of a mode in closed form.

    Parameters
    ----------
    mode, exits
        the mode and its exits.
    x, p
        (n,) state at its start; parameter vector.

    Returns
    -------
    Duration [s], exit, (n,) state there; None where no exit is met.
    """
    motion = _flow_map(mode, exits, x.size, p.size)
    best: tuple[float, Exit] | None = None
    for i, way_out in enumerate(exits):

        def h(T: float, i: int = i) -> float:
            return float(motion(x, T, p)[1][i])

        T, left = secant(h, 0.0, 1.0, tolerance=EVENT_TOLERANCE)
        if not (abs(left) <= FLOW_LIMIT and T >= 0):
            continue
        rising = (h(T + max(1e-3 * abs(T), 1e-6)) - left) * way_out.direction > 0
        if rising and (best is None or best[0] > T):
            best = (T, way_out)
    return None if best is None else (*best, motion(x, best[0], p)[0].copy())


def flow_to(
    mode: Mode, exits: tuple[Exit, ...], way_out: Exit | None, x: Array, T: float, p: Array
) -> tuple[float, Array]:
    """The end of a phase in closed form that is known nearly.

    Parameters
    ----------
    mode, exits
        a mode with a flow, and its exits.
    way_out
        that of the phase, one of them; None where the time is over.
    x
        (n,) state at its start.
    T
        its duration, nearly [s].
    p
        parameter vector.

    Returns
    -------
    Duration, to rounding, and (n,) state at the end.
    """
    motion = _flow_map(mode, exits, x.size, p.size)
    if way_out is not None:
        i = exits.index(way_out)
        near, left = secant(lambda t: float(motion(x, t, p)[1][i]), T, T * (1 - 1e-6), tolerance=EVENT_TOLERANCE)
        T = near if abs(left) <= FLOW_LIMIT else T
    return T, motion(x, T, p)[0].copy()


class Watch:
    """The events of a mode's exits, each in its direction, and its feature, compiled."""

    def __init__(self, exits: tuple[Exit, ...], feature: Feature | None, stepper: Stepper) -> None:
        s, n, parameters = stepper.scheme, stepper.scale.size, stepper.p.size
        self.exits, self.stepper, self._feature = exits, stepper, feature
        self._here = _events_at(exits, stepper.field, n, parameters) if exits else None
        self._in_numbers = feature is not None and not isinstance(feature, Bound)
        self._along = _looks(exits, feature, n, parameters, s.degree, s.kind)

    def at(self, x: Array) -> tuple[list[float], list[float]]:
        """Each exit's event at a scaled state, and the rate at which it rises there."""
        assert self._here is not None
        buffers = self._here.buffers
        for store, value in zip(
            buffers.inputs, (x, self.stepper.sign, self.stepper.p, self.stepper.scale), strict=True
        ):
            store[:] = value
        buffers.trigger()
        values, rates = buffers.outputs
        return values.tolist(), rates.tolist()

    def crossings(
        self, start: Array, stages: Array, end: Array, ahead: Array | None
    ) -> tuple[list[tuple[Exit, float]], bool]:
        """The exits whose events are beyond zero earliest in an interval; whether it hides something of the field.

        Parameters
        ----------
        start, stages, end
            (n,), (d n,), (n,) states of the interval, in units of the scale.
        ahead
            (n,) state just after `start` on the first interval of a mode, which starts on its last event: it tells the
            side of that zero on which the mode begins; None on the others.

        Returns
        -------
        Each exit with the watched local time (0..1] where it is: one as a rule, none where no event is beyond zero,
        several where only locating them tells which comes first.  And whether the feature jumps between two points of
        the interval.

        Raises
        ------
        TooLong : the polynomial may have strayed across zero: only a shorter interval can tell.
        """
        m = _WATCH.size
        found: list[tuple[int, Exit]] = []
        looked, jump = self._look(start, stages, end, start if ahead is None else ahead)
        for values, way_out in zip(looked, self.exits, strict=True):
            h = values[:m]
            if not (h[0] <= ON_EVENT and (h > 0).any()):
                continue
            inside = h[0] < 0
            if ahead is not None and abs(h[0]) <= ON_EVENT:
                begins = float(values[-1]) - h[0]
                inside = begins < 0 if begins != 0 else h[1] < 0
            if inside:
                k = _first_beyond(h, RESOLUTION * abs(float(self.stepper.scheme.last_mode @ values[m:-1])))
                found += [(k, way_out)] if k else []
        first = min((k for k, _ in found), default=0)
        hidden = self.hides(start, stages, end) if self._in_numbers else float(jump[0]) > LARGEST_JUMP
        return [(way_out, float(_WATCH[k])) for k, way_out in found if k == first], hidden

    def hides(self, start: Array, stages: Array, end: Array) -> bool:
        """Whether the feature jumps between two points (n,), (d n,), (n,) of an interval, so that it is hidden."""
        if self._feature is None:
            return False
        points = np.concatenate([start, stages, end]).reshape(1, -1, start.size) * self.stepper.scale
        return bool(hides(self._feature, points, self.stepper.p)[0])

    def _look(self, start: Array, stages: Array, end: Array, ahead: Array) -> tuple[Array, ...]:
        """(exits, .) events at the watched times, the start and the stages, and ahead; largest jump of the feature."""
        buffers = self._along.buffers
        x, X, end_, ahead_, p, scale = buffers.inputs
        x[:], X[:], end_[:], ahead_[:], p[:], scale[:] = start, stages, end, ahead, self.stepper.p, self.stepper.scale
        buffers.trigger()
        return buffers.outputs


def _first_beyond(h: Array, stray: float) -> int:
    """Number of the first watched time at which an event is beyond zero, 0 for none.

    Between the nodes the polynomial may stray across zero by as much as it cannot resolve: then only a shorter interval
    can tell, but where the motion crosses there, from the look before to the one after.  The end of the interval is
    exact, and what comes behind the exit does not matter.

    Raises
    ------
    TooLong : it may have strayed across zero.
    """
    beyond = np.flatnonzero(h[1:] > np.append(np.full(h.size - 2, stray), 0.0))
    k = int(beyond[0]) + 1 if beyond.size else 0
    doubtful = np.flatnonzero(h[: k or h.size - 1] > EXCURSION)
    if doubtful.size and not (doubtful.size == 1 and 0 < doubtful[0] == k - 1 and h[k - 2] < -stray and h[k] > stray):
        raise TooLong
    return k


@kept(maxsize=64)
def _events_at(exits: tuple[Exit, ...], field: Field, n: int, parameters: int) -> Caller:
    """Events, each in its direction, and their rates along a field, at a scaled state."""
    z, sign = ca.SX.sym("z", n), ca.SX.sym("sign")
    p, scale = ca.SX.sym("p", parameters), ca.SX.sym("scale", n)
    events = ca.vertcat(*[e.direction * e.event.function(scale * z, 0.0, p) for e in exits])
    rates = ca.jtimes(events, z, field(scale * z, p, sign) / scale)
    function = ca.Function("here", [z, sign, p, scale], [ca.densify(events), ca.densify(rates)])
    return caller(function, [n, 1, parameters, n], [len(exits), len(exits)])


@kept(maxsize=64)
def _looks(
    exits: tuple[Exit, ...], feature: Feature | None, n: int, parameters: int, degree: int, kind: Kind
) -> Caller:
    """Events along an interval, and the largest jump from one of its points to the next of a feature in symbols."""
    z, p, scale = ca.SX.sym("z", n), ca.SX.sym("p", parameters), ca.SX.sym("scale", n)
    x, X, end, ahead = (ca.SX.sym(name, rows) for name, rows in zip("xXea", (n, degree * n, n, n), strict=True))
    w = ca.horzcat(x, ca.reshape(X, n, degree))
    between = ca.mtimes(w, ca.DM(scheme(degree, kind).interpolation(_WATCH[:-1])).T)
    events = ca.vertcat(*[e.direction * e.event.function(scale * z, 0.0, p) for e in exits])
    along = _at_each(events, z, p, scale, ca.horzcat(between, end, w, ahead))
    jump = ca.SX(0)
    if isinstance(feature, Bound):
        jump = ca.mmax(ca.fabs(ca.diff(_at_each(feature(scale * z, p), z, p, scale, ca.horzcat(w, end)))))
    function = ca.Function("looks", [x, X, end, ahead, p, scale], [ca.densify(along), ca.densify(jump)])
    return caller(function, [n, degree * n, n, n, parameters, n], [(len(exits), along.size1()), 1])


def _at_each(expression: ca.SX, z: ca.SX, p: ca.SX, scale: ca.SX, points: ca.SX) -> ca.SX:
    """(m, .) an expression of the scaled state z at points (n, m)."""
    function = ca.Function("at", [z, p, scale], [ca.densify(expression)])
    return ca.vertcat(*[function(points[:, k], p, scale).T for k in range(points.size2())])


def _true_value(watch: Watch, which: int, start: Array, guess: Foretold, h: float) -> float:
    """An exit's event at the end of an interval of length h; no number where that is not solved."""
    solved = watch.stepper(start, guess, h, EXACT)
    return math.nan if solved is None else watch.at(solved.end)[0][which]


def locate(
    watch: Watch, way_out: Exit, beyond: float, start: Array, stages: Array, h: float
) -> tuple[float, Array, Array] | None:
    """Shorten an interval until it ends on an event.

    Parameters
    ----------
    watch, way_out
        of the mode; the exit.
    beyond
        watched local time (0..1] at which its event is beyond zero.
    start, stages
        (n,), (d n,) states of the interval, in units of the scale.
    h
        its length [s].

    Returns
    -------
    Length [s], (d n,) stages and (n,) end of the interval at whose end the event vanishes; None where none is found.
    """
    stepper, which = watch.stepper, watch.exits.index(way_out)
    s = stepper.scheme

    def value(state: Array) -> tuple[float, float]:
        values, rates = watch.at(state)
        return values[which], rates[which]

    w = np.concatenate([start, stages]).reshape(s.degree + 1, -1)
    part = _WATCH[1] - _WATCH[0]
    before, low, high = s.interpolation(np.array([beyond - 2 * part, beyond - part, beyond])) @ w
    f_low, f_high = value(low)[0], value(high)[0]
    low, high = beyond - part, beyond
    if f_low > EXCURSION:  # it strays across zero there, and was seen to cross from the look before
        low, f_low = low - part, value(before)[0]
    # Rounding in the states keeps the event from vanishing better than this.
    size = max(-min(f_low, 0.0), f_high, stepper.scale_of(way_out))
    tolerance = max(EVENT_TOLERANCE, EXIT_ROUNDING * size)
    # The polynomial at hand knows the signs at the ends better than the values.
    theta = Bracket(low, f_low if f_low < 0 else -np.inf, high, f_high if f_high > 0 else np.inf).illinois
    bracket = Bracket(low - part if low > part else low, -np.inf, min(high + part, 1.0), np.inf)
    solved: Solved | None = None
    f = last = np.inf
    reach = 1.0  # local time at the end of the interval whose polynomial w is
    for _ in range(EXIT_ROUNDS):
        solved = stepper(start, Foretold(w, 0.0, theta / reach), theta * h, EXACT)
        if solved is None:
            return None
        w, reach = np.concatenate([start, solved.stages]).reshape(s.degree + 1, -1), theta
        f, rate = value(solved.end)
        if np.isnan(f):
            return None
        if abs(f) <= tolerance or bracket.width < 1e-15:
            break
        bracket = bracket.told(theta, f)
        rate *= h
        shrinks = rate > 0 and abs(f) < 0.5 * last
        if not shrinks and not (np.isfinite(bracket.f_a) and np.isfinite(bracket.f_b)):
            # Before it is halved to nothing: does the event change its sign on true intervals at all?
            ends = [
                _true_value(watch, which, start, Foretold(w, 0.0, end / reach), end * h)
                for end in (bracket.a, bracket.b)
            ]
            if not ends[0] < 0 < ends[1]:
                break
            bracket = Bracket(bracket.a, ends[0], bracket.b, ends[1])
        theta, last = bracket.newton(theta, f, rate) if shrinks else bracket.middle, abs(f)
    # A crossing that true intervals do not confirm was an artefact of too long an interval.
    return (theta * h, solved.stages, solved.end) if solved is not None and abs(f) <= EVENT_LIMIT else None
