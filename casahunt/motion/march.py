"""Marching collocation: the initial value problem solved interval by interval, event by event.

The same interval equations as in the boundary value problem (collocation/interval.py), one interval at a time with
adaptive length, each mode followed to its exit and the exit located to rounding.  What comes out is
already a multi-phase mesh with stages: the starting guess of a transcription, and its phase sequence.

The length of an interval is chosen so that the last Legendre coefficient of the collocation polynomial,
in units of the state scale, equals `tol`.  That bounds the polynomial inside the interval; the end of
the interval is superconvergent and far better.

Symbols: n states, d stages, R = n (d + 1), N intervals of a segment.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from .. import effort
from ..collocation.admissibility import hides
from ..collocation.interval import interval_map
from ..collocation.scheme import Kind, Scheme, scheme
from ..compiled import caller, kept
from ..hybrid.system import Exit, Feature, Field, Mode, System

Array = np.ndarray

NEWTON_LIMIT = 12
SMALLEST_STEP = 1e-14  # of the time reached so far, or of one second at the start
EVENT_TOLERANCE = 1e-13  # on events scaled to order one
ROUNDING = 1e-14
GOAL = 1e-7  # of the tolerance: what Newton leaves of an interval's equations
MOST_SLOW = 2  # Newton steps that do not halve before an interval is given up
GROWTH = 2.5  # of an interval's length from one to the next
EXACT = 1e-22  # the same where an event is located: the square of a step times what the curvature makes of it
STALLED = 1e-12  # a Newton step of this relative size that does not shrink any more is rounding
EVENT_LIMIT = 1e-10  # an event counts as located
EXCURSION = 1e-8  # an event beyond zero by less than this is no crossing
RESOLUTION = 3.0  # a polynomial is known to this many times its last Legendre coefficient
EXTRAPOLATED = 1.0  # the longest interval that its predecessor foretells, in units of that one's length
SHORT = 1e-4  # part of an interval over which the rate of an event is measured
ON_EVENT = 1e-12  # a state is on an event, not beside it
_WATCH = np.linspace(0, 1, 17)  # local times at which an interval is watched for exits


@dataclass(frozen=True, eq=False)
class Segment:
    """One phase of a simulated motion.

    Attributes
    ----------
    mode, event : names; event is "" where the march ended without one.
    duration : length of the segment [s].
    breaks : (N + 1,) interval boundaries as fractions of the duration; (2,) for a closed-form mode.
    w : (N, R) start and stages of each interval, unscaled; (1, n) for a closed-form mode.
    end : (n,) state at the end.
    """

    mode: str
    event: str
    duration: float
    breaks: Array
    w: Array
    end: Array

    @property
    def start(self) -> Array:
        """(n,) state at the start."""
        return self.w[0, : self.end.size]


class MarchFailure(Exception):
    """The march could not go on; the message says where."""


class _TooLong(Exception):
    """The interval is too long to tell whether an event crosses zero in it."""


def march(
    system: System,
    mode: str,
    x: Array,
    p: Array,
    *,
    scale: Array,
    until: Callable[[Segment], bool],
    tol: float = 1e-4,
    degree: int = 7,
    kind: Kind = "gauss",
    max_time: float = np.inf,
    max_intervals: int = 20_000,
) -> list[Segment]:
    """Follow the motion from x in `mode` until `until(segment)` holds at a segment's end.

    Parameters
    ----------
    system, mode
        the hybrid system and the mode that it starts in.
    until
        called with every finished segment; True ends the march.
    degree, kind
        collocation scheme.
    x
        (n,) initial state.
    p
        parameter vector.
    scale
        (n,) size of the states, for the tolerance.
    tol
        bound on the last Legendre coefficient of each interval, relative to `scale`.
    max_time
        stop there [s].
    max_intervals
        give up beyond.

    Returns
    -------
    The segments.  Where the motion comes to rest, or `max_time` has passed, they end without `until`.

    Raises
    ------
    MarchFailure : NaN, a step size that vanishes, or too many intervals.
    """
    effort.motion()
    s = scheme(degree, kind)
    segments: list[Segment] = []
    time, used = 0.0, 0
    while True:
        field = system.modes[mode]
        if field.flow is not None:
            segment, mode = _closed_form(system, mode, x, p)
        else:
            stepper = _Stepper(field.field, s, p, scale, field.sign)
            segment, mode = _collocated(
                system, mode, x, p, stepper, tol, max_time - time, max_intervals - used
            )
        segments.append(segment)
        time += segment.duration
        used += len(segment.w)
        if segment.event == "" or until(segment):
            return segments
        if used >= max_intervals:
            raise MarchFailure(f"no end after {time:.3g} s and {used} intervals")
        if time >= max_time:
            return segments
        x = segment.end


def _closed_form(system: System, mode: str, x: Array, p: Array) -> tuple[Segment, str]:
    """A closed-form phase to its first exit; exits are found by the secant method (exact if linear)."""
    exits = system.exits[mode]
    motion = _flow_map(system.modes[mode], exits, x.size, p.size)
    best: tuple[float, Exit] | None = None
    for i, way_out in enumerate(exits):

        def h(T: float, i: int = i) -> float:
            return float(motion(x, T, p)[1][i])

        t0, t1 = 0.0, 1.0
        h0, h1 = h(t0), h(t1)
        for _ in range(50):
            if h1 == h0:
                break
            t0, t1, h0 = t1, t1 - h1 * (t1 - t0) / (h1 - h0), h1
            h1 = h(t1)
            if abs(h1) <= EVENT_TOLERANCE:
                break
        rising = (h(t1 + max(1e-3 * abs(t1), 1e-6)) - h1) * way_out.direction > 0
        if abs(h1) <= 1e-9 and t1 >= 0 and rising and (best is None or t1 < best[0]):
            best = (t1, way_out)
    if best is None:
        return Segment(mode, "", np.inf, np.array([0.0, 1.0]), x[None].copy(), x.copy()), mode
    duration, way_out = best
    end = motion(x, duration, p)[0].copy()
    segment = Segment(mode, way_out.event.name, duration, np.array([0.0, 1.0]), x[None].copy(), end)
    return segment, way_out.successor(end, p)


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


class _Stepper:
    """One interval from x of length h: Newton on its stages."""

    def __init__(self, field: Field, s: Scheme, p: Array, scale: Array, sign: float) -> None:
        self.function = interval_map(field, scale.size, p.size, s.degree, s.kind, 1)
        self.scheme, self.p, self.scale, self.sign = s, p, scale, sign
        self.no_dp, self.no_next = np.zeros(p.size), np.zeros(scale.size)

    def scale_of(self, way_out: Exit) -> float:
        """Size of an event in a motion of the size of the state scale."""
        return abs(float(way_out.event.function(self.scale, 0.0, self.p)))

    def slope(self, x: Array) -> Array:
        """f(x), scaled: minus d(node row)/dT of an interval whose stages all sit at x."""
        rows = x.size * (self.scheme.degree + 1)
        return -self._call(np.tile(x, self.scheme.degree + 1), 0.0)[rows + 1, rows - x.size :]

    def _call(self, w: Array, h: float) -> Array:
        return self.function(w, self.no_next, h, 1.0, self.sign, self.p, self.no_dp, self.scale)[0]

    def __call__(self, x: Array, stages: Array, h: float, goal: float) -> tuple[Array, Array] | None:
        """(stages, end), both scaled, to an error of about `goal`, or None where Newton does not converge."""
        n, rows = x.size, x.size + stages.size
        w = np.concatenate([x, stages])
        last, slow = np.inf, 0
        for _ in range(NEWTON_LIMIT):
            block = self._call(w, h)
            residual, jacobian = block[0], block[n + 1 : rows + 1].T
            try:
                step = np.linalg.solve(jacobian[: rows - n], residual[: rows - n])
            except np.linalg.LinAlgError:
                return None
            size = float(abs(step).max())
            if not size < np.inf:
                return None
            w[n:] -= step
            stalled = size > 0.3 * last and size <= STALLED * max(1.0, float(abs(w).max()))
            if size * size <= goal or stalled:  # the square of a Newton step is what it leaves
                return w[n:], jacobian[rows - n :] @ step - residual[rows - n :]
            slow += size > 0.5 * last
            if slow > MOST_SLOW or size > min(2 * last, 1e6):
                return None
            last = size
        return None


def _collocated(
    system: System,
    mode: str,
    x: Array,
    p: Array,
    stepper: _Stepper,
    tol: float,
    max_time: float,
    max_intervals: int,
) -> tuple[Segment, str]:
    s, scale = stepper.scheme, stepper.scale
    d = s.degree
    lengths: list[float] = []
    pieces: list[Array] = []
    start = x / scale
    t, first = 0.0, True
    slope = stepper.slope(start)
    h = min(1e-2 / max(float(np.max(np.abs(slope))), 1e-300), max_time, 1.0) * tol ** (1 / (d + 1))
    previous: tuple[Array, float] | None = None
    while True:
        if t >= max_time * (1 - 1e-15):  # at rest for ever, or as good as; the rest is rounding
            breaks = np.concatenate([[0.0], np.cumsum(lengths)])
            w = np.array(pieces) * np.tile(scale, d + 1)
            return Segment(mode, "", t, breaks / breaks[-1], w, start * scale), mode
        if len(pieces) >= max_intervals:
            raise MarchFailure(f"mode {mode!r}: no exit after {t:.3g} s and {len(pieces)} intervals")
        effort.interval()
        guess = _predict(s, previous, start, h)
        solved = stepper(start, guess, h, GOAL * tol)
        if solved is None and _reaches(previous, h):
            solved = stepper(start, np.tile(start, d), h, GOAL * tol)
        error = np.inf if solved is None else _last_mode(s, start, solved[0])
        if error > 4 * tol:
            h *= 0.3 if not np.isfinite(error) else max(0.2, 0.8 * (tol / error) ** (1 / d))
            if h < SMALLEST_STEP * max(t, 1.0):
                raise MarchFailure(f"mode {mode!r}: the step size vanished at {t:.6g} s")
            continue
        assert solved is not None
        stages, end = solved
        ahead = start + 1e-6 * h * slope if first else None
        try:
            crossing = _first_crossing(system.exits[mode], stepper, start, stages, end, ahead)
        except _TooLong:
            h *= 0.5
            if h < SMALLEST_STEP * max(t, 1.0):
                raise MarchFailure(f"mode {mode!r}: an exit grazes zero at {t:.6g} s") from None
            continue
        if crossing is not None:
            # A look at the polynomial saves locating an exit only to find that the interval hides something.
            rough = s.interpolation(crossing[1] * s.points) @ np.concatenate([start, stages]).reshape(d + 1, -1)
            hidden = _hidden(system.modes[mode].feature, start, rough[1:].ravel(), rough[-1], scale, p)
            located = None if hidden else _locate(*crossing, stepper, start, stages, h)
            if located is None:
                h *= 0.5
                if h < SMALLEST_STEP * max(t, 1.0):
                    raise MarchFailure(f"mode {mode!r}: exit {crossing[0].event.name!r} cannot be located")
                continue
            full, (h, stages, end) = h, located
        if _hidden(system.modes[mode].feature, start, stages, end, scale, p):
            # Whatever the step shows of the motion, it has stepped over something.
            h = 0.5 * (full if crossing is not None else h)
            if h < SMALLEST_STEP * max(t, 1.0):
                raise MarchFailure(f"mode {mode!r}: the step size vanished at {t:.6g} s")
            continue
        pieces.append(np.concatenate([start, stages]))
        lengths.append(h)
        t += h
        if crossing is not None:
            way_out = crossing[0]
            successor = way_out.successor(end * scale, p)
            # An event that leads back into its own mode was touched, not crossed: the motion goes on.
            if successor != mode or way_out.mark:
                breaks = np.concatenate([[0.0], np.cumsum(lengths)])
                w = np.array(pieces) * np.tile(scale, d + 1)
                return Segment(mode, way_out.event.name, t, breaks / breaks[-1], w, end * scale), successor
        previous, start, first = (pieces[-1], h), end, crossing is not None
        # The last interval ends at max_time itself, as accurate as any other end of an interval.
        h = min(h * min(GROWTH, max(0.3, 0.9 * (tol / max(error, 1e-300)) ** (1 / d))), max(max_time - t, 0.0))


def _hidden(feature: Feature | None, start: Array, stages: Array, end: Array, scale: Array, p: Array) -> bool:
    if feature is None:
        return False
    points = np.concatenate([start, stages, end]).reshape(1, -1, start.size) * scale
    return bool(hides(feature, points, p)[0])


def _predict(s: Scheme, previous: tuple[Array, float] | None, start: Array, h: float) -> Array:
    """Stages extrapolated from the previous interval; constant where that reaches too far."""
    d, n = s.degree, start.size
    if not _reaches(previous, h):
        return np.tile(start, d)
    assert previous is not None
    w, last = previous
    return (s.interpolation(1 + s.stages * (h / last)) @ w.reshape(d + 1, n)).ravel()


def _reaches(previous: tuple[Array, float] | None, h: float) -> bool:
    """Whether the previous interval may be extrapolated to one of length h."""
    return previous is not None and h <= EXTRAPOLATED * previous[1]


def _last_mode(s: Scheme, start: Array, stages: Array) -> float:
    return float(np.max(np.abs(s.last_mode @ np.concatenate([start, stages]).reshape(s.degree + 1, -1))))


@lru_cache(maxsize=32)
def _watch_matrix(degree: int, kind: Kind) -> Array:
    """Interpolation to the watched local times but the last, which is the end."""
    return scheme(degree, kind).interpolation(_WATCH[:-1])


def _first_crossing(
    exits: tuple[Exit, ...], stepper: _Stepper, start: Array, stages: Array, end: Array, ahead: Array | None
) -> tuple[Exit, float] | None:
    """The exit whose event is beyond zero earliest, with the watched local time (0..1] where it is.

    `ahead` is a state just after `start` on the first interval of a mode, which starts on its last event:
    it tells the side of that zero on which the mode begins.
    """
    p = stepper.p
    s, w = stepper.scheme, np.concatenate([start, stages]).reshape(-1, start.size)
    points = np.vstack([_watch_matrix(s.degree, s.kind) @ w, end[None]]).T * stepper.scale[:, None]
    found: tuple[int, Exit] | None = None
    for way_out in exits:

        def value(states: Array, way_out: Exit = way_out) -> Array:
            return way_out.direction * np.asarray(way_out.event.function(states, 0.0, p), float)

        h = value(points)
        inside = h[0] < 0
        if ahead is not None and abs(h[0]) <= ON_EVENT:
            begins = float(value(ahead * stepper.scale)) - h[0]
            inside = begins < 0 if begins != 0 else h[1] < 0
        # Between the nodes the polynomial may stray across zero by as much as it cannot resolve: then only
        # a shorter interval can tell.  The end of the interval is exact.
        stray = np.full(h.size, RESOLUTION * abs(float(s.last_mode @ value((w * stepper.scale).T))))
        stray[-1] = 0.0
        if inside and np.any((h > EXCURSION) & (h <= stray)):
            raise _TooLong
        beyond = np.flatnonzero(h[1:] > stray[1:])
        if inside and beyond.size and (found is None or beyond[0] < found[0]):
            found = (int(beyond[0]), way_out)
    return None if found is None else (found[1], float(_WATCH[found[0] + 1]))


def _locate(
    way_out: Exit, beyond: float, stepper: _Stepper, start: Array, stages: Array, h: float
) -> tuple[float, Array, Array] | None:
    """Interval length at which the event vanishes at its end: Newton on true intervals, kept in a bracket."""
    s = stepper.scheme

    def value(state: Array) -> float:
        return way_out.direction * float(way_out.event.function(state * stepper.scale, 0.0, stepper.p))

    w = np.concatenate([start, stages]).reshape(s.degree + 1, -1)
    low, high = beyond - (_WATCH[1] - _WATCH[0]), beyond
    ends = s.interpolation(np.array([low, high])) @ w
    f_low, f_high = min(value(ends[0]), 0.0), value(ends[1])
    # Rounding in the states keeps the event from vanishing better than this.
    size = max(abs(f_low), f_high, stepper.scale_of(way_out))
    tolerance = max(EVENT_TOLERANCE, ROUNDING * size)
    theta = high - f_high * (high - low) / (f_high - f_low) if f_low < 0 < f_high else (low + high) / 2
    solved: tuple[Array, Array] | None = None
    f = last = np.inf
    reach = 1.0  # local time at the end of the interval whose polynomial w is
    for _ in range(60):
        guess = (s.interpolation(s.stages * (theta / reach)) @ w).ravel()
        solved = stepper(start, guess, theta * h, EXACT)
        if solved is None:
            return None
        w, reach = np.concatenate([start, solved[0]]).reshape(s.degree + 1, -1), theta
        f = value(solved[1])
        if abs(f) <= tolerance or high - low < 1e-15:
            break
        low, high = (low, theta) if f > 0 else (theta, high)
        # The event is nearly linear over so short a way: its rate is that of the motion at the end.
        ahead = SHORT * stepper.slope(solved[1]) * h
        rate = (value(solved[1] + ahead) - value(solved[1] - ahead)) / (2 * SHORT)
        newton = theta - f / rate if rate > 0 and abs(f) < 0.5 * last else np.inf
        theta, last = newton if low < newton < high else (low + high) / 2, abs(f)
    # A crossing that true intervals do not confirm was an artefact of too long an interval.
    confirmed = solved is not None and abs(f) <= EVENT_LIMIT
    return (theta * h, *solved) if solved is not None and confirmed else None
