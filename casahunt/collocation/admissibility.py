"""Is a root of the collocation equations a motion of the system?

Solvers converge to wrong roots and call it success: a slip that runs backwards, a stick that holds more
than it can, a phase of negative duration.  Every mode states a condition that must not fall
below minus its slack all along its phase; it is evaluated at the nodes and stages of every interval and
interpolated densely between them.
Inside an interval the polynomial is known to a few times the last Legendre coefficient of the condition:
a violation beyond that is a wrong root; a value that is not clear of zero by as much asks for a shorter
interval.  Without that an interval can step over a whole ring-down and see nothing of it.

Nor may an event of the mode be passed inside the phase: its scalar, counted along the direction of the way out, goes
from below zero to above only at the end.  That needs no condition, and keeps a system without one from roots that go
through a wall.

The same goes for an interval between whose points a feature of the field can hide, such as a sudden drop
at its very end: neither the equations nor the error estimate would ever see it (hybrid.system.Mode).  The march
uses the same look, more strictly.

A phase begins and ends where its condition vanishes by definition.  There the condition is divided by the
distance from that end, so that what must be clear of zero is its slope.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from ..hybrid.system import Exit, Feature
from .joints import event_rate, flow_at, linear_in_time
from .near_events import comes_and_goes
from .scheme import Kind, scheme
from .transcription import Setting, Transcription

Array = np.ndarray
Place = tuple[Transcription, Array, Setting]

RESOLUTION = 3.0
"""A condition is known to this many times its last Legendre coefficient."""
NOISE = 1e-10
PASSED = 1e-6
"""An event is passed where its scalar goes from so far below zero to as far above, relative to its size above one."""
BARELY = 1e-8
"""The same of one that is passed, and passed back, by less than that: a cycle that touches shows no more.  Intervals
that do not resolve as little where one is all but met are unclear, whichever side of zero they show."""
AT_ZERO = 1e-8  # a phase end where the condition vanishes, relative to its largest value
LARGEST_JUMP = 0.5
"""Of a mode's feature between neighbouring collocation points of a march, which has no other look at it."""
NOTHING_LEFT = 0.9
"""The same for a solution: the error estimate looks between the points, but must have something to see."""
BETWEEN = np.linspace(0, 1, 33)
"""Parts of an interval, or of a phase in closed form, at which a condition is looked at."""


MOVES_BELOW = 1e-9
"""States that range over less than this part of their scale do not move: tolerances of cycles are larger."""


@dataclass(frozen=True, eq=False)
class Verdict:
    """What the conditions say.

    Attributes
    ----------
    violated : sentence about the first condition that fails, or "".
    phase : the phase it fails in, or -1.
    unclear : (N,) True for intervals too long to tell.
    barely : the first phase that passes an event by less than a violation, and comes back; -1 for none.
    """

    violated: str
    phase: int
    unclear: Array
    barely: int = -1

    @property
    def admissible(self) -> bool:
        """A motion of the system, without reservation."""
        return not self.violated and not self.unclear.any()


def judge(t: Transcription, u: Array, setting: Setting) -> Verdict:
    """Check whether a converged solution is a motion: all conditions of its phases.

    Returns verdict: the first condition that is violated, and the intervals on which one is not clear.
    """
    nodes = t.nodes_of(u) * setting.scale
    durations = t.durations_of(u)
    inside = _Inside(t, t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n) * setting.scale, nodes, setting.p)
    barely = -1
    for k, phase in enumerate(t.cycle.phases):
        mode = phase.mode
        if not durations[k] > 0:
            sentence = f"phase {k + 1} ({mode.name}) has the duration {durations[k]:.3g} s"
            return Verdict(sentence, k, inside.unclear)
        if phase.direction:
            rate, size = event_rate(phase, nodes[t.phase_end[k]], float(durations[k]), setting.p)
            if phase.direction * rate < -NOISE * size:
                sentence = f"phase {k + 1} ({mode.name}) meets {phase.end.name!r} from the other side"
                return Verdict(sentence, k, inside.unclear)
        if mode.admissible is not None:
            lowest, wrong = inside.of_phase(k) if t.counts[k] else _closed_form(t, k, nodes, durations, setting.p)
            if wrong:
                sentence = f"phase {k + 1} is no {mode.name}: its condition falls to {lowest:.3g}"
                return Verdict(sentence, k, inside.unclear)
        passed, by_little = _passed(t, u, k, setting, inside.unclear) if phase.exits else ("", False)
        if passed:
            return Verdict(f"phase {k + 1} ({mode.name}) passes {passed!r}", k, inside.unclear)
        barely = k if by_little and barely < 0 else barely
    return Verdict("", -1, inside.unclear, barely)


def stands_still(t: Transcription, u: Array) -> bool:
    """Whether a solution is an equilibrium, which solves the equations of any cycle whose events do not mind.

    Returns True where no state moves; never where there are closed forms or jumps.
    """
    if not all(t.counts) or any(phase.reset is not None for phase in t.cycle.phases):
        return False
    states = t.intervals_of(u).reshape(-1, t.n)
    return bool(np.max(np.ptp(states, axis=0)) <= MOVES_BELOW * max(1.0, float(np.max(np.abs(states)))))


def unclear_on_halves(t: Transcription, better: Place | None) -> Array:
    """Where a solution that is a motion is none, or not clearly one, after a Newton step on its halved mesh.

    An interval may be wrong inside by more than a weak reversal is high, and show nothing of it.

    better: the solution after that step (error_estimate.Estimate); None for nothing to look at.
    Returns (N,) bool, for the intervals of t.
    """
    return judged_on_halves(t, Verdict("", -1, np.zeros(t.intervals, dtype=bool)), better).unclear


def judged_on_halves(t: Transcription, verdict: Verdict, better: Place | None) -> Verdict:
    """A solution that is a motion, judged again by what a Newton step on its halved mesh makes of it.

    Where an event is all but met, the solution itself may be known less well than it passes that, or keeps clear.

    t, verdict: transcription of the solution, and the verdict on it; better: as in `unclear_on_halves`.
    Returns verdict, with what is unclear there and what is passed by little.
    """
    if better is None:
        return verdict
    finer = judge(*better)
    unclear: Array = np.asarray(finer.unclear.reshape(-1, 2).any(axis=1))
    if finer.violated and not unclear.any():
        unclear[t.phase_intervals(finer.phase)] = True
    return replace(verdict, unclear=unclear, barely=finer.barely)


def _passed(t: Transcription, u: Array, k: int, setting: Setting, unclear: Array) -> tuple[str, bool]:
    """(the event of a way out that is passed inside a phase, or "", whether one is by less than counts).

    Where one may be passed, intervals become unclear.
    """
    phase, own, p = t.cycle.phases[k], t.phase_intervals(k), setting.p
    if t.counts[k]:
        states = t.intervals_of(u)[own].reshape(-1, t.n) * setting.scale
    else:
        start = t.nodes_of(u)[t.phase_start[k]] * setting.scale
        states = flow_at(phase.mode, start, float(t.durations_of(u)[k]) * BETWEEN, p)
    by_little = False
    for way_out in phase.exits:
        values = way_out.direction * np.asarray(way_out.event.function(states.T, 0.0, p), float)[None]
        doubt: Array | float = 0.0
        if t.counts[k]:
            values = values.reshape(-1, t.degree + 1)
            doubt = RESOLUTION * np.abs(values @ t.scheme.last_mode)[:, None]
            values = values @ dense_rule(t.degree, t.kind)[0]
        size = max(1.0, float(np.abs(values).max()))
        slack = PASSED * size
        beyond = (np.minimum.accumulate(values.ravel()) < -slack).reshape(values.shape) & (values > slack)
        if not beyond.any():
            seen, unknown = comes_and_goes(values, doubt, BARELY * size)
            if (seen.any() or unknown.any()) and _leaves(way_out, phase.mode.name, states, p):
                by_little |= bool(seen.any())
                if t.counts[k] and not seen.any():
                    unclear[own] |= unknown.any(axis=1)
            continue
        if not (beyond & (values > slack + doubt)).any():
            unclear[own] |= beyond.any(axis=1)
        elif way_out.mark or _leaves(way_out, phase.mode.name, states, p):
            return way_out.event.name, False
    return "", by_little


def _leaves(way_out: Exit, mode: str, states: Array, p: Array) -> bool:
    """Whether one of the states next to which a way out is passed leads to another mode: a touch may lead on."""
    values = way_out.direction * np.asarray(way_out.event.function(states.T, 0.0, p), float)
    below = np.flatnonzero((values[:-1] < 0) & (values[1:] >= 0))
    seen = [way_out.successor(x, p) != mode or way_out.reset is not None for x in states[below + 1]]
    return any(seen) or not seen


def _closed_form(t: Transcription, k: int, nodes: Array, durations: Array, p: Array) -> tuple[float, bool]:
    """(the lowest value of the condition of a phase in closed form, whether that violates it)."""
    mode, start = t.cycle.phases[k].mode, t.phase_start[k]
    assert mode.admissible is not None
    states = nodes[start : start + 2]
    if not linear_in_time(mode, t.n, p.size):
        states = flow_at(mode, states[0], float(durations[k]) * BETWEEN, p)
    values = mode.admissible(states.T, p, mode.sign)
    lowest = float(values.min())
    return lowest, lowest + mode.slack + NOISE * max(1.0, float(np.abs(values).max())) < 0


class _Inside:
    """The conditions and features of all collocated phases, those of one mode together.

    Attributes
    ----------
    unclear : (N,) as of a Verdict.
    """

    def __init__(self, t: Transcription, w: Array, nodes: Array, p: Array) -> None:
        self.unclear = np.zeros(t.intervals, dtype=bool)
        self._t, self._lowest = t, np.zeros(t.intervals)
        self._wrong = np.zeros(t.intervals, dtype=bool)
        if not t.intervals:
            return
        ends = nodes[t.interval_elements + 1]
        values, slack = np.zeros((t.intervals, t.degree + 1)), np.zeros(t.intervals)
        conditioned = np.zeros(t.intervals, dtype=bool)
        for mode, members in t.modes:
            states = w[members]
            if mode.feature is not None:
                points = np.concatenate([states, ends[members][:, None]], axis=1)
                self.unclear[members] = hides(mode.feature, points, p, largest=NOTHING_LEFT)
            if mode.admissible is not None:
                found = mode.admissible(states.reshape(-1, t.n).T, p, mode.sign)
                values[members] = found.reshape(states.shape[:2])
                slack[members], conditioned[members] = mode.slack, True
        if conditioned.any():
            self._conditions(values, slack, conditioned)

    def _conditions(self, values: Array, slack: Array, conditioned: Array) -> None:
        t = self._t
        self.unclear |= conditioned & not_clear(t, values, slack)
        dense = values @ dense_rule(t.degree, t.kind)[0]
        self._lowest = dense.min(axis=1)
        with_noise = self._lowest + slack + NOISE * np.maximum(1.0, largest_of_phase(t, dense))
        below = conditioned & (with_noise < 0)
        if below.any():
            self._wrong = below & (with_noise < -RESOLUTION * np.abs(values @ t.scheme.last_mode))
            self.unclear |= below

    def of_phase(self, k: int) -> tuple[float, bool]:
        """(the lowest value of its condition in a phase, whether that violates it)."""
        own = self._t.phase_intervals(k)
        return float(self._lowest[own].min()), bool(self._wrong[own].any())


def hides(feature: Feature, points: Array, p: Array, *, largest: float = LARGEST_JUMP) -> Array:
    """Where a feature of the field jumps between successive points.

    feature: of the mode: a function of states (n, m) and p; points: (N, m, n) successive states of each interval;
    largest: jump that is not taken for one. Returns (N,) bool.
    """
    values = np.asarray(feature(points.reshape(-1, points.shape[-1]).T, p), float).reshape(points.shape[:2])
    return np.abs(values[:, 1:] - values[:, :-1]).max(axis=1) > largest


@lru_cache(maxsize=256)
def _slope_of(degree: int, kind: Kind, starts: bool, stops: bool) -> tuple[Array, Array, Array]:
    """(kept points, divisor, row of the last Legendre coefficient) of a condition with zeros at its ends divided out.

    Values of the condition at the kept points over the divisor are the slope's; the row gives its resolution.
    """
    points = scheme(degree, kind).points
    keep = np.ones(points.size, dtype=bool)
    keep[0] = not starts
    keep &= ~((points == 1.0) & stops)
    tau = points[keep]
    divisor = (tau if starts else 1.0) * (1 - tau if stops else 1.0) * np.ones(tau.size)
    return keep, divisor, np.linalg.inv(legendre.legvander(2 * tau - 1, tau.size - 1))[-1]


@lru_cache(maxsize=32)
def dense_rule(degree: int, kind: Kind) -> tuple[Array, Array]:
    """How a condition is looked at between the points where it is known.

    Returns interpolation (d + 1, m) to the times between, and (d + 1,) to the end.
    """
    s = scheme(degree, kind)
    return s.interpolation(BETWEEN).T.copy(), s.interpolation(np.array([1.0]))[0]


def largest_of_phase(t: Transcription, values: Array) -> Array:
    """For every interval the largest magnitude of a condition in its phase.

    t, values: the transcription, and (..., N, m) values of the condition. Returns (..., N).
    """
    largest = np.maximum.reduceat(np.abs(values).max(axis=-1), t.first_intervals, axis=-1)
    return np.repeat(largest, t.collocated_counts, axis=-1)


def not_clear(t: Transcription, values: Array, slack: Array) -> Array:
    """Where a condition is not clear of zero by its resolution.

    t, values, slack: the transcription, (..., N, d + 1) values of the condition at start and stages, and (N,) its
    slack. Returns (..., N) bool.
    """
    s, size = t.scheme, largest_of_phase(t, values)
    first, last = t.first_intervals, t.first_intervals + t.collocated_counts - 1
    starts, stops = np.zeros((2, *values.shape[:-1]), dtype=int)
    slack = np.broadcast_to(slack, starts.shape)
    starts[..., first] = np.abs(values[..., first, 0]) <= AT_ZERO * size[..., first]
    stops[..., last] = np.abs(values[..., last, :] @ dense_rule(s.degree, s.kind)[1]) <= AT_ZERO * size[..., last]
    out = values.min(axis=-1) + slack < RESOLUTION * np.abs(values @ s.last_mode)
    kinds = 2 * starts + stops
    for kind in set(kinds[kinds > 0].tolist()):
        chosen = kinds == kind
        keep, divisor, top = _slope_of(s.degree, s.kind, kind > 1, kind % 2 == 1)
        slope = values[chosen][:, keep] / divisor
        unclear = slope.min(axis=1) + slack[chosen] < RESOLUTION * np.abs(slope @ top)
        if kind > 1 and s.degree == 2:
            # A slip starts with v ~ t^2, whose slope is a straight line: at degree 2 its last coefficient
            # is no smaller on a finer mesh, that of v/t^2 is.
            slope /= s.points[keep]
            unclear &= slope.min(axis=1) + slack[chosen] < RESOLUTION * np.abs(slope @ top)
        out[chosen] = unclear
    return out
