"""An interval watched for the exits of its mode, and for what it hides: compiled, in one call.

Symbols: n states, d stages, m watched times; all states scaled.
"""

from __future__ import annotations

import casadi as ca
import numpy as np

from ..collocation.admissibility import LARGEST_JUMP, hides
from ..collocation.resolution import BARELY, RESOLUTION
from ..collocation.scheme import Kind, scheme
from ..compiled import Caller, caller, kept
from ..hybrid.system import Exit, Feature, Field
from ..hybrid.vector_form import Bound
from ..roots import LOOKED_AT
from .march_step import Stepper

Array = np.ndarray

EVENT_LIMIT = 1e-10  # an event counts as located
ON_EVENT = EVENT_LIMIT  # a state is on an event, not beside it: where an exit was located to no less
NEAR_EVENT = 1e-9  # a mode that starts so near to its own event starts on it


class TooLong(Exception):
    """The interval is too long to tell whether an event crosses zero in it."""


class EventWatch:
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

        start, stages, end: (n,), (d n,), (n,) states of the interval, in units of the scale; ahead: (n,) state just
        after `start` on the first interval of a mode, which starts on its last event: it tells the side of that zero on
        which the mode begins; None on the others. Returns each exit with the watched local time (0..1] where it is: one
        as a rule, none where no event is beyond zero, several where only locating them tells which comes first.  And
        whether the feature jumps between two points of the interval. Raises TooLong: the polynomial may have strayed
        across zero: only a shorter interval can tell.
        """
        m = LOOKED_AT.size
        found: list[tuple[int, Exit]] = []
        looked, tops, highest, jump = self._look(start, stages, end, start if ahead is None else ahead)
        for values, between, top, way_out in zip(looked, tops, highest[:, 0].tolist(), self.exits, strict=True):
            h = values[:m]
            if not (top > 0 and h[0] <= ON_EVENT):
                continue
            inside = h[0] < 0
            if ahead is not None and abs(h[0]) <= ON_EVENT:
                if np.abs(h).max() <= ON_EVENT:  # at rest on it: what changes its sign is rounding
                    continue
                begins = float(values[-1]) - h[0]
                inside = begins < 0 if begins != 0 else h[1] < 0
            if inside:
                stray = RESOLUTION * abs(float(self.stepper.scheme.last_mode @ values[m:-1]))
                k = _first_beyond(h, between > BARELY, stray)
                found += [(k, way_out)] if k else []
        first = min((k for k, _ in found), default=0)
        hidden = self.hides(start, stages, end) if self._in_numbers else float(jump[0]) > LARGEST_JUMP
        return [(way_out, float(LOOKED_AT[k])) for k, way_out in found if k == first], hidden

    def hides(self, start: Array, stages: Array, end: Array) -> bool:
        """Whether the feature jumps between two points of an interval.

        start, stages, end: (n,), (d n,), (n,) states of the interval, in units of the scale.
        Returns True where it hides from the collocation polynomial.
        """
        if self._feature is None:
            return False
        points = np.concatenate([start, stages, end]).reshape(1, -1, start.size) * self.stepper.scale
        return bool(hides(self._feature, points, self.stepper.p)[0])

    def _look(self, start: Array, stages: Array, end: Array, ahead: Array) -> tuple[Array, ...]:
        """(exits, .) events at the watched times, the start and the stages, and ahead; (exits, m - 2) what they come up
        to next to watched times at which they are below zero; (exits, 1) the highest; largest jump of the feature."""
        buffers = self._along.buffers
        x, X, end_, ahead_, p, scale = buffers.inputs
        x[:], X[:], end_[:], ahead_[:], p[:], scale[:] = start, stages, end, ahead, self.stepper.p, self.stepper.scale
        buffers.trigger()
        return buffers.outputs


def _first_beyond(h: Array, hidden: Array, stray: float) -> int:
    """Number of the first watched time at which an event is beyond zero, 0 for none.

    hidden: (m - 2,) where it comes up to more than zero between watched times, and goes back.

    Between the nodes the polynomial may stray across zero by as much as it cannot resolve: then only a shorter interval
    can tell, but where the motion crosses there, from the look before to the one after.  The end of the interval is
    exact, and what comes behind the exit does not matter.

    Raises TooLong: it may have strayed across zero.
    """
    beyond = np.flatnonzero(h[1:] > np.append(np.full(h.size - 2, stray), 0.0))
    k = int(beyond[0]) + 1 if beyond.size else 0
    doubtful = np.flatnonzero(h[: k or h.size - 1] > BARELY)
    if hidden[: max(k - 2, 0) if k else h.size].any():
        raise TooLong
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
    """Events along an interval, what they come up to next to watched times (admissibility.py), the highest of both, and
    the largest jump from one of its points to the next of a feature in symbols."""
    z, p, scale = ca.SX.sym("z", n), ca.SX.sym("p", parameters), ca.SX.sym("scale", n)
    x, X, end, ahead = (ca.SX.sym(name, rows) for name, rows in zip("xXea", (n, degree * n, n, n), strict=True))
    w = ca.horzcat(x, ca.reshape(X, n, degree))
    between = ca.mtimes(w, ca.DM(scheme(degree, kind).interpolation(LOOKED_AT[:-1])).T)
    events = ca.vertcat(*[e.direction * e.event.function(scale * z, 0.0, p) for e in exits])
    along = _at_each(events, z, p, scale, ca.horzcat(between, end, w, ahead))
    left, middle, right = (along[k : k + LOOKED_AT.size - 2, :] for k in range(3))
    bend, tilt = left - 2 * middle + right, left - right
    peaked = ca.logic_and(bend < 0, ca.fabs(tilt) <= -2 * bend)
    tops = middle - ca.if_else(peaked, tilt * tilt / ca.if_else(peaked, bend, 1), 0) / 8
    tops = ca.if_else(middle > 0, -1, tops)
    highest = ca.vertcat(*[ca.mmax(ca.vertcat(along[: LOOKED_AT.size, k], tops[:, k])) for k in range(len(exits))])
    jump = ca.SX(0)
    if isinstance(feature, Bound):
        jump = ca.mmax(ca.fabs(ca.diff(_at_each(feature(scale * z, p), z, p, scale, ca.horzcat(w, end)))))
    function = ca.Function("looks", [x, X, end, ahead, p, scale], [*map(ca.densify, (along, tops, highest, jump))])
    outputs = [(len(exits), along.size1()), (len(exits), tops.size1()), (len(exits), 1), 1]
    return caller(function, [n, degree * n, n, n, parameters, n], outputs)


def _at_each(expression: ca.SX, z: ca.SX, p: ca.SX, scale: ca.SX, points: ca.SX) -> ca.SX:
    """(m, .) an expression of the scaled state z at points (n, m)."""
    function = ca.Function("at", [z, p, scale], [ca.densify(expression)])
    return ca.vertcat(*[function(points[:, k], p, scale).T for k in range(points.size2())])
