"""Is a root of the collocation equations a motion of the system?

Solvers converge to wrong roots and call it success: a slip that runs backwards, a stick that holds more
than it can, a phase of negative duration.  Every mode states a condition that must not fall
below minus its slack all along its phase; it is evaluated at the nodes and stages of every interval and
interpolated densely between them.
Inside an interval the polynomial is known to a few times the last Legendre coefficient of the condition:
a violation beyond that is a wrong root; a value that is not clear of zero by as much asks for a shorter
interval.  Without that an interval can step over a whole ring-down and see nothing of it.

The same goes for an interval between whose points a feature of the field can hide, such as a sudden drop
at its very end: neither the equations nor the error estimate would ever see it (hybrid.system.Mode).  The march
uses the same look, more strictly.

A phase begins and ends where its condition vanishes by definition.  There the condition is divided by the
distance from that end, so that what must be clear of zero is its slope.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.polynomial import legendre

from ..hybrid.system import Feature
from .joints import event_rate, flow_at, linear_in_time
from .scheme import Kind, Scheme, scheme
from .transcription import Setting, Transcription

Array = np.ndarray

RESOLUTION = 3.0
"""A condition is known to this many times its last Legendre coefficient."""
NOISE = 1e-10
AT_ZERO = 1e-8  # a phase end where the condition vanishes, relative to its largest value
LARGEST_JUMP = 0.5
"""Of a mode's feature between neighbouring collocation points of a march, which has no other look at it."""
NOTHING_LEFT = 0.9
"""The same for a solution: the error estimate looks between the points, but must have something to see."""
_BETWEEN = np.linspace(0, 1, 33)


@dataclass(frozen=True, eq=False)
class Verdict:
    """What the conditions say.

    Attributes
    ----------
    violated : sentence about the first condition that fails, or "".
    phase : the phase it fails in, or -1.
    unclear : (N,) True for intervals too long to tell.
    """

    violated: str
    phase: int
    unclear: Array

    @property
    def admissible(self) -> bool:
        """A motion of the system, without reservation."""
        return not self.violated and not self.unclear.any()


def judge(t: Transcription, u: Array, setting: Setting) -> Verdict:
    """Check whether a converged solution is a motion: all conditions of its phases.

    Parameters
    ----------
    t, u, setting
        the solution: transcription, unknowns, setting.

    Returns
    -------
    Verdict: the first condition that is violated, and the intervals on which one is not clear.
    """
    nodes = t.nodes_of(u) * setting.scale
    durations = t.durations_of(u)
    w = t.intervals_of(u).reshape(t.intervals, t.degree + 1, t.n) * setting.scale
    unclear = np.zeros(t.intervals, dtype=bool)
    for k, phase in enumerate(t.cycle.phases):
        mode = phase.mode
        if t.counts[k] and mode.feature is not None:
            unclear[t.phase_intervals(k)] |= _hides_feature(mode.feature, w[t.phase_intervals(k)], nodes, t, k, setting)
        if not durations[k] > 0:
            return Verdict(f"phase {k + 1} ({mode.name}) has the duration {durations[k]:.3g} s", k, unclear)
        if phase.direction:
            rate, size = event_rate(phase, nodes[t.phase_end[k]], float(durations[k]), setting.p)
            if phase.direction * rate < -NOISE * size:
                return Verdict(f"phase {k + 1} ({mode.name}) meets {phase.end.name!r} from the other side", k, unclear)
        if mode.admissible is None:
            continue
        if t.counts[k]:
            inside = w[t.phase_intervals(k)]
            values = mode.admissible(inside.reshape(-1, t.n).T, setting.p, mode.sign).reshape(inside.shape[:2])
            resolution = RESOLUTION * np.abs(values @ t.scheme.last_mode)
            unclear[t.phase_intervals(k)] |= _not_clear(t.scheme, values, mode.slack)
            values = values @ _dense(t.degree, t.kind)[0]
        else:
            start = t.phase_start[k]
            states = nodes[start : start + 2]
            if not linear_in_time(mode, t.n, setting.p.size):
                states = flow_at(mode, states[0], float(durations[k]) * _BETWEEN, setting.p)
            values = mode.admissible(states.T, setting.p, mode.sign).reshape(1, -1)
            resolution = np.zeros(1)
        lowest = values.min(axis=1) + mode.slack + NOISE * max(1.0, float(np.max(np.abs(values))))
        if np.any(lowest < -resolution):
            return Verdict(
                f"phase {k + 1} is no {mode.name}: its condition falls to {values.min():.3g}", k, unclear
            )
        if t.counts[k]:
            unclear[t.phase_intervals(k)] |= lowest < 0
    return Verdict("", -1, unclear)


def hides(feature: Feature, points: Array, p: Array, *, largest: float = LARGEST_JUMP) -> Array:
    """Where a feature of the field jumps between successive points.

    Parameters
    ----------
    feature
        of the mode: a function of states (n, m) and p.
    points
        (N, m, n) successive states of each interval.
    p
        parameter vector.
    largest
        jump that is not taken for one.

    Returns
    -------
    (N,) bool.
    """
    values = np.asarray(feature(points.reshape(-1, points.shape[-1]).T, p), float).reshape(points.shape[:2])
    return np.max(np.abs(np.diff(values, axis=1)), axis=1) > largest


def _hides_feature(feature: Feature, w: Array, nodes: Array, t: Transcription, k: int, setting: Setting) -> Array:
    ends = nodes[t.phase_end[k] - t.counts[k] + 1 : t.phase_end[k] + 1]
    return hides(feature, np.concatenate([w, ends[:, None]], axis=1), setting.p, largest=NOTHING_LEFT)


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
def _dense(degree: int, kind: Kind) -> tuple[Array, Array]:
    """Interpolation to the times between the points at which conditions are looked at, and to the end."""
    s = scheme(degree, kind)
    return s.interpolation(_BETWEEN).T.copy(), s.interpolation(np.array([1.0]))[0]


def _not_clear(s: Scheme, values: Array, slack: float) -> Array:
    """(N,) True where the condition (N, d + 1) at start and stages is not clear of zero by its resolution."""
    size = float(np.max(np.abs(values)))
    out = np.zeros(len(values), dtype=bool)
    ends = values @ _dense(s.degree, s.kind)[1]
    zero_start = np.abs(values[:, 0]) <= AT_ZERO * size
    zero_end = np.abs(ends) <= AT_ZERO * size
    zero_start[1:], zero_end[:-1] = False, False
    for starts in (False, True):
        for stops in (False, True):
            chosen = (zero_start == starts) & (zero_end == stops)
            if not chosen.any():
                continue
            keep, divisor, top = _slope_of(s.degree, s.kind, starts, stops)
            slope = values[chosen][:, keep] / divisor
            unclear = slope.min(axis=1) + slack < RESOLUTION * np.abs(slope @ top)
            if starts and s.degree == 2:
                # A slip starts with v ~ t^2, whose slope is a straight line: at degree 2 its last coefficient
                # is no smaller on a finer mesh, that of v/t^2 is.
                slope /= s.points[keep]
                unclear &= slope.min(axis=1) + slack < RESOLUTION * np.abs(slope @ top)
            out[chosen] = unclear
    return out
