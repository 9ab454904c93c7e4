"""What a drive runs: the parts of a loop that form its torque, as difference equations.

At t_k = k T a drive reads the angle in counts of q = 2 pi/encoder and knows nothing else, theta_d being the set point:

    a_k = q floor(theta/q + 1/2) - theta_d        angle (without an encoder theta - theta_d)
    (a_k - a_{k-1})/T                             rate; it moves where that is not 0, into the direction of its sign
    (e_k - e_{k-1})/T                             error_rate, of whatever error the parts make of the angle

From these the parts have their signals, and each state c of theirs its next value by the backward rule,

    c_k = c_{k-1} + T c'(c_k, signals at t_k)     for all of them at once; it is linear

or by a rule of its own (`Law.sampled`, the integrator).  A part changes its mode where an event of the mode is beyond
zero at a sample, is behind the events "stop", "breakaway+", "breakaway-" where its reading says so, and where the
angle has changed its sign behind "centre"; an event that is crossed either way is met where it has changed its sign.
States jump from what they were at the last sample.  The torque goes out to the nearest multiple of `quantise_torque`.

While the reading stays, nothing but c moves, as long as no mode ends by one linear map: whole sticks are one array.
The torque stays between limits for ever where the map's steady torque and all of what dies out of it are.  So it does
where the reading rings on as what is left alone does, r + sum of z_j, z_j -> exp(lambda_j T) z_j: the last reading and
the z_j are more of what the map takes on.

Symbols: T sample time, q count, Y = (c, e, z) with z what is integrated.
"""

from __future__ import annotations

import math
from collections.abc import Collection, Mapping
from itertools import product
from types import SimpleNamespace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ...compiled import Caller, caller, kept
from ...errors import InputError
from ..drive import Drive
from ..parts.loop import Loop
from ..parts.part import Edge, Function, Part, PartMode
from ..parts.wiring import Numbers, Signals, Wiring
from .steps import Ringing

Array = np.ndarray
Modes = tuple[PartMode, ...]

FROM_READINGS: dict[str, Function] = {
    "angle": lambda x, s, p: p.reading,
    "motor_angle": lambda x, s, p: p.reading,
    "rate": lambda x, s, p: (p.reading - p.last_reading) / p.sample_time,
    "motor_rate": lambda x, s, p: s.rate,
    "moving": lambda x, s, p: p.moved,
    "direction": lambda x, s, p: p.way,
    "error_rate": lambda x, s, p: (s.error - p.last_error) / p.sample_time,
}
"""The signals that a drive has from its readings, in the place of those of the plant."""
READ = ("reading", "last_reading", "moved", "way")
REMEMBERED = ("last_error", "last_integrand")
RUN = ("sample_time", "trapezoid")
"""What these depend on, and the rules of the states, beside the parameters of the loop."""
STUCK_AHEAD = 32, 128, 512
"""Samples of a stick that are looked at at once: at first, then, and from then on."""
NOT_FINITE = "a part of the controller runs away within one sample, which no drive runs; give a shorter sample time"
"""Said where the backward rule has no solution."""
MOST_CHANGES = 8
"""Modes that end at one sample."""
ON_ITS_EDGE = 1e-12
"""An event, of order one, that is no larger is zero: what has two edges stays as it is there, what has one is below."""
EVENTS_SETTLED = 1e-9
"""Events, of order one, that differ by less are where they will be for ever."""
ZERO_ERROR = Edge("centre", lambda x, s, p: s.error, 0, "")
"""Met where the error has changed its sign."""
ONCE_MORE, MAP_CONDITION = 1e-12, 1e10
"""A factor of the linear map that differs from 1 by less keeps what it multiplies; how far its directions may be from
being dependent."""


def _signal(*factors: str) -> Function:
    return lambda x, s, p: math.prod(getattr(s, name) for name in factors)


_error, _integrand = _signal("error"), _signal("integrates", "integrand")


class Sample(NamedTuple):
    """One sample in some modes, compiled: (Y, readings, p) -> Y', torque, events; many in a row; the map's matrices,
    by Y, the reading and the last one; whether it is linear in these two as well, and knows no other."""

    step: ca.Function
    one: Caller
    many: tuple[Caller, ...]
    linear: Caller | None
    by_readings: bool
    edges: tuple[tuple[int, Edge, float], ...]


def _met_from(part: Part, edge: Edge) -> float:
    """What an event must be beyond to be met; 0 where it is by a change of its sign."""
    back = next((mode for mode in part.modes if mode.name == edge.to), None)
    one_edge = back is not None and any(other.function is edge.function for other in back.ends)
    return abs(edge.direction) * ON_ITS_EDGE * (1 if edge.direction > 0 or one_edge else -1)


def _solved(J: ca.SX, r: ca.SX) -> ca.SX:
    """J^-1 r, J = 1 - T A, by elimination in the order of the states; `casadi.solve`, which goes by orthogonal columns,
    loses the small rows of slow states beside the large ones of a notch."""
    J, r = ca.SX(J), ca.SX(r)
    for k in range(r.numel()):
        for i in range(k + 1, r.numel()):
            factor = J[i, k] / J[k, k]
            J[i, :], r[i] = J[i, :] - factor * J[k, :], r[i] - factor * r[k]
    for k in reversed(range(r.numel())):
        r[k] = (r[k] - sum(J[k, j] * r[j] for j in range(k + 1, r.numel()))) / J[k, k]
    return r


def _check_finite(value: float) -> None:
    if not math.isfinite(value):
        raise InputError(f"controller: {NOT_FINITE}")


@kept(maxsize=256)
def sample_of(parts: tuple[Part, ...], modes: Modes, numbers: tuple[str, ...]) -> Sample:
    """The sample of parts in these modes; numbers: names of the parameters of the loop."""
    wiring = Wiring(tuple((part, mode.law, mode.sign) for part, mode in zip(parts, modes, strict=True)), FROM_READINGS)
    states = tuple(state for part in parts for state in part.states)
    edges = tuple((i, edge, _met_from(parts[i], edge)) for i, mode in enumerate(modes) for edge in mode.ends)
    n = len(states)
    Y, read, p = ca.SX.sym("Y", n + 2), ca.SX.sym("read", len(READ)), ca.SX.sym("p", len(numbers) + len(RUN))
    c = ca.SX.sym("c", n)
    seen = Numbers(**dict(zip((*REMEMBERED, *READ, *numbers, *RUN),
                              ca.vertsplit(ca.vertcat(Y[n:], read, p)), strict=True)))  # fmt: skip
    before, now = (SimpleNamespace(**dict(zip(states, each.nz, strict=True))) for each in (Y[:n], c))

    signals = Signals(wiring, now, seen)

    def at(function: Function, x: Any = now) -> Any:
        return ca.SX(function(x, signals, seen))

    left = list[Any]()
    for part, mode in zip(parts, modes, strict=True):
        for state in part.states:
            own, last = getattr(now, state), getattr(before, state)
            if state in mode.law.sampled:
                left.append(own - at(mode.law.sampled[state], before))
            else:
                left.append(own - last - seen.sample_time * at(mode.law.rates.get(state, lambda x, s, p: 0.0)))
    equations = ca.densify(ca.vertcat(*left, ca.SX(0, 1)))
    J = ca.jacobian(equations, c)
    if n and ca.depends_on(ca.vertcat(*J.nonzeros()), c):
        named = ", ".join(part.name for part in parts if part.states)
        raise InputError(f"{named}: what one of them does is not linear, and no drive is known that runs it")
    following = Y[:n] - _solved(J, ca.substitute(equations, c, Y[:n]))
    torque = ca.SX(signals.torque + signals.compensation)
    asked = ca.vertcat(torque, at(_error), at(_integrand), *(at(edge.function) for _, edge, _ in edges))
    asked = ca.substitute(asked, c, following)
    out = [ca.densify(each) for each in (ca.vertcat(following, asked[1:3]), asked[0], asked[3:])]
    after = out[0]
    step = ca.Function("sample", [Y, read, p], out)
    sizes, shapes = [n + 2, len(READ), p.numel()], [n + 2, 1, len(edges)]
    many = []
    for count in STUCK_AHEAD:
        inputs = [ca.MX.sym("Y", n + 2), ca.MX.sym("read", len(READ)), ca.MX.sym("p", p.numel())]
        row = step.mapaccum("samples", count)(inputs[0], *(ca.repmat(each, 1, count) for each in inputs[1:]))
        many.append(caller(ca.Function("samples", inputs, row), sizes, [(count, size) for size in shapes]))
    known = ca.vertcat(Y, read[:2])
    matrix, row = ca.jacobian(after, known), ca.jacobian(out[1], known)
    slopes = ca.vertcat(*matrix.nonzeros(), *row.nonzeros(), p[0])
    by_Y = ca.vertcat(*matrix[:, : n + 2].nonzeros(), *row[: n + 2].nonzeros(), p[0])
    linear, by_readings = None, not (ca.depends_on(slopes, known) or ca.depends_on(ca.vertcat(*out), read[2:]))
    if not ca.depends_on(by_Y, Y):
        function = ca.Function("linear", [Y, read, p], [ca.densify(matrix.T), ca.densify(row)])
        linear = caller(function, sizes, [(n + 2, n + 4), n + 4])
    return Sample(step, caller(step, sizes, shapes), tuple(many), linear, by_readings, edges)


def numbers_of(loop: Loop, drive: Drive) -> dict[str, float]:
    """What a sample depends on: the parameters of the loop, and those of its rules."""
    rules = drive.sample_time, float(drive.integration == "trapezoid")
    return loop.parameters | dict(zip(RUN, rules, strict=True))


class Controller:
    """The controller of a drive, with its memory.

    loop: whose parts it runs; set_point: theta_d [rad]; x: theta - theta_d at the start [rad]; start: states by name.
    """

    def __init__(
        self, loop: Loop, parts: tuple[Part, ...], drive: Drive, set_point: float, x: float, start: dict[str, float]
    ) -> None:
        self.parts, self.names = parts, tuple(state for part in parts for state in part.states)
        self.T, self.q, self.theta_d, self.step = drive.sample_time, drive.count, set_point, drive.quantise_torque
        self._own = numbers_of(loop, drive)
        self._numbers, self.p = tuple(loop.parameters), np.array(list(self._own.values()))
        self.a, self.moved = self.reading(x), False
        self._sides = dict[str, float]()
        self._directions = dict[tuple[Modes, bytes], tuple[Array, Array, Array, Array] | None]()
        self._waited = {name for part in parts for name in (*part.upon, *part.follows)}
        self.waits = bool(self._waited)
        self.Y = np.array([start.get(name, 0.0) for name in self.names] + [0.0, 0.0])
        self._begin(start)
        self._prepare()

    def reading(self, x: float) -> float:
        """a."""
        return self.q * math.floor((self.theta_d + x) / self.q + 0.5) - self.theta_d if self.q else x

    def _begin(self, given: Collection[str]) -> None:
        """The modes at the start; filters of the error are where they stay at this reading."""
        self.modes = tuple(part.modes[0] for part in self.parts)
        for _ in (*self.parts, None):
            for part in self.parts:
                for state, signal in part.stands.items():
                    if state not in given:
                        self.Y[self.names.index(state)] = self._asked(_signal(signal))
            self.Y[-2:] = self._asked(_error), self._asked(_integrand)
            before, chosen = self.modes, list(self.modes)
            for i, part in enumerate(self.parts):
                chosen[i] = next(mode for mode in part.modes if mode.where is None or self._asked(mode.where))
                self.modes = tuple(chosen)
            if self.modes == before:
                break

    def _asked(self, function: Function) -> Any:
        """A function of a part at the last states and the last reading, in these modes."""
        wiring = Wiring(tuple((part, mode.law, mode.sign) for part, mode in zip(self.parts, self.modes, strict=True)),
                        FROM_READINGS)  # fmt: skip
        x = SimpleNamespace(**dict(zip(self.names, self.Y.tolist(), strict=False)))
        read = dict(zip((*READ, *REMEMBERED), (self.a, self.a, 0.0, 0.0, *self.Y[-2:].tolist()), strict=True))
        return wiring.value(function, None, x, Numbers(**self._own, **read))

    def _prepare(self) -> None:
        """Be ready for samples in these modes."""
        self.compiled: Sample = sample_of(self.parts, self.modes, self._numbers)
        buffers = self.compiled.one.buffers
        (self._from, self._read, self._p), self._out, self._run = buffers.inputs, buffers.outputs, buffers.trigger

    def sample(self, x: float) -> float:
        """u of a sample at theta - theta_d = x."""
        a = self.reading(x)
        moved = a != self.a
        way = math.copysign(1.0, a - self.a) if moved else 0.0
        if self._waited and moved != self.moved:
            self._behind("stop" if self.moved else "breakaway+" if way > 0 else "breakaway-")
        seen = set[Modes]()
        for _ in range(MOST_CHANGES):
            out = self._out_at(self.Y, a, self.a, moved, way)
            seen.add(before := self.modes)
            changed = (self.compiled.edges or self._waited) and self._changes()
            if not changed or (self.modes in seen and self._rank(before) > self._rank(self.modes)):
                break
        self.Y[:] = out[0]
        self.a, self.moved = a, moved
        u = float(out[1][0])
        _check_finite(u)
        return self._to_step(u) if self.step else u

    def _rank(self, modes: Modes) -> tuple[int, ...]:
        """Of two modes that lead to each other at a sample the later one of a part holds: the limit, not beyond it."""
        return tuple(part.modes.index(mode) for part, mode in zip(self.parts, modes, strict=True))

    def _changes(self) -> bool:
        """Whether a mode ends at this sample, or a state jumps: then it is to be computed again."""
        values = [*self._out[2].tolist(), float(self._out[0][-2])]
        for (i, edge, beyond), value in zip((*self.compiled.edges, (None, ZERO_ERROR, 0.0)), values, strict=True):
            if edge.direction:
                if edge.direction * (value - beyond) <= 0:
                    continue
            else:
                side, before = math.copysign(1.0, value) if value else 0.0, self._sides.get(edge.name, 0.0)
                self._sides[edge.name] = side or before
                if side * before >= 0:
                    continue
            if i is not None:
                self._jump(edge.reset)
                to = edge.to if isinstance(edge.to, str) else self._asked(edge.to)
                self._follow(i, to)
            self._behind(edge.name)
            return True
        return False

    def _behind(self, event: str) -> None:
        """Let the parts do what they do upon an event."""
        for i, part in enumerate(self.parts):
            self._jump(part.upon.get(event, {}))
            if event in part.follows:
                self._follow(i, part.follows[event])

    def _jump(self, reset: Mapping[str, Function]) -> None:
        values = {state: self._asked(function) for state, function in reset.items()}
        for state, value in values.items():
            self.Y[self.names.index(state)] = value

    def _follow(self, i: int, name: str) -> None:
        """A part's next mode."""
        mode = next(mode for mode in self.parts[i].modes if mode.name == name)
        if mode is not self.modes[i]:
            self.modes = (*self.modes[:i], mode, *self.modes[i + 1 :])
            self._prepare()

    @property
    def sides(self) -> list[float]:
        """The signs that events had which are met where these change: of those of the modes, and of the error."""
        return [self._sides.get(edge.name, 0.0) for _, edge, _ in (*self.compiled.edges, (None, ZERO_ERROR, 0.0))]

    def stays(self, *positions: float) -> bool:
        """Whether the next sample reads what the last one did, and the one before, at each theta - theta_d."""
        return not self.moved and all(self.reading(x) == self.a for x in positions)

    def _directions_of_the_map(self, rates: Array) -> tuple[Array, Array, Array, Array] | None:
        """(factors, directions, their inverse, row of u) of Y -> M Y + c in these modes while the reading stays, or of
        (Y, last reading, z) while it rings at these rates; None where that is not linear, or its directions are nearly
        dependent."""
        if self.compiled.linear is None:
            return None
        buffers = self.compiled.linear.buffers
        for store, value in zip(buffers.inputs, (self.Y, (self.a, self.a, 0.0, 0.0), self.p), strict=True):
            store[:] = value
        buffers.trigger()
        _check_finite(float(buffers.outputs[0].sum()))
        by_Y, by_reading, by_last = np.split(np.vstack(buffers.outputs), [self.Y.size, self.Y.size + 1], axis=1)
        M, row = by_Y[:-1], by_Y[-1]
        if rates.size:
            n, m = self.Y.size, rates.size
            ring, ones = np.diag(np.exp(self.T * rates)), np.ones((1, m))
            M = np.block([[M, by_last[:-1], by_reading[:-1] * ones],
                          [np.zeros((1, n + 1)), ones], [np.zeros((m, n + 1)), ring]])  # fmt: skip
            row = np.concatenate([row, by_last[-1], by_reading[-1] * ones[0]])
        factors, directions = np.linalg.eig(M)
        if np.linalg.cond(directions) > MAP_CONDITION:
            return None
        factors = np.where(np.abs(factors - 1) <= ONCE_MORE, 1.0, factors)
        return factors, directions, np.linalg.inv(directions), row

    def ahead(self, before: int) -> tuple[Array, Array, bool]:
        """(count, n + 2) Y and (count,) u of the next samples if the reading stays, as long as no mode ends; whether
        none does.

        before: how often it was asked in a row.
        """
        buffers = self.compiled.many[min(before, len(STUCK_AHEAD) - 1)].buffers
        for store, value in zip(buffers.inputs, (self.Y, (self.a, self.a, 0.0, 0.0), self.p), strict=True):
            store[:] = value
        buffers.trigger()
        Y, u, events = buffers.outputs
        count = self._ends(events, Y[:, -2])
        complete, u = count == len(u), u[:count, 0]
        return Y[:count].copy(), self.step * np.floor(u / self.step + 0.5) if self.step else u.copy(), complete

    def _ends(self, events: Array, errors: Array) -> int:
        """The first of samples at which a mode ends, or a state jumps; as many as there are where none does."""
        count = len(errors)
        for (_, edge, beyond), values in zip(self.compiled.edges, events.T, strict=True):
            side = edge.direction or -self._sides.get(edge.name, 0.0)
            ends = np.flatnonzero(side * (values - beyond) > 0)
            count = min(count, int(ends[0])) if ends.size else count
        if self.waits:
            ends = np.flatnonzero(self._sides.get(ZERO_ERROR.name, 0.0) * errors < 0)
            count = min(count, int(ends[0])) if ends.size else count
        return count

    def stays_within(self, low: float, high: float, ringing: Ringing | None = None) -> bool:
        """Whether u stays between two limits for ever if the reading stays, or rings on."""
        reading = ringing or Ringing(self.a, *np.zeros((2, 0)))
        last_read, z, rates = reading
        if z.size and (self.waits or not self.compiled.by_readings):
            return False
        at = self.modes, rates.tobytes()
        if at not in self._directions:
            self._directions[at] = self._directions_of_the_map(rates)
        if (known := self._directions[at]) is None:
            return False
        factors, directions, inverse, row = known
        Z = np.concatenate([self.Y, [self.a], z])[: factors.size]
        from_zero = self._out_at(np.zeros(self.Y.size), last_read, 0.0 if z.size else self.a)[0]
        driven = np.concatenate([from_zero, [last_read], 0 * z])[: factors.size]
        there, drive = inverse @ Z, inverse @ driven  # along each direction, and what it is driven by
        stays = factors == 1
        if np.any(stays & (np.abs(drive) > ONCE_MORE * np.abs(drive).max())):
            return False
        now = float(self._out_at(self.Y, reading.now, self.a)[1][0])
        last = np.where(stays, there, drive / np.where(stays, 1, 1 - factors))
        dies = (row @ directions) * (there - last)
        lasting = (np.abs(factors) >= 1) & ~stays & (np.abs(dies) > 0)
        if lasting.any() or not self._same_modes(np.real(directions @ last)[: self.Y.size], reading):
            return False
        one_way = (np.imag(factors) == 0) & (np.real(factors) >= 0)
        parts, steady = np.real(dies), now - float(np.real(dies.sum()))
        up = float(np.where(one_way, np.maximum(parts, 0), np.abs(dies)).sum())
        down = float(np.where(one_way, np.minimum(parts, 0), -np.abs(dies)).sum())
        ends = steady + down, steady + up
        least, most = map(self._to_step, ends) if self.step else ends
        return low <= least and most <= high

    def _out_at(self, Y: Array, *reading: float) -> Any:
        """What a sample gives in these modes; reading: the angle, the last one, whether it moves and which way."""
        self._from[:], self._read[:], self._p[:] = Y, (*reading, 0.0, 0.0)[: len(READ)], self.p
        self._run()
        return self._out

    def _same_modes(self, last: Array, reading: Ringing) -> bool:
        """Whether no event is met on the way to the last Y: it is there already, as far as events see it.

        Of a reading that rings events, convex or concave, differ at its ends from what they are where it goes to by
        less than these are from being met, and so in between.
        """
        to = reading.last
        there, now = (self._out_at(Y, to, to)[2].copy() for Y in (last, self.Y))
        settled = bool(np.all(np.abs(there - now) <= EVENTS_SETTLED * np.maximum(np.abs(now), 1)))
        if not (settled and reading.parts.size):
            return settled
        seen = [self._out_at(last, *two)[2].copy() for two in product((reading.least, reading.most), repeat=2)]
        seen.append(self._out_at(self.Y, reading.now, self.a)[2].copy())
        away = np.all(np.abs(np.array(seen) - there) < np.abs(there) - ON_ITS_EDGE)
        return bool(away) and self._ends(there[None], np.zeros(1)) == 1

    def _to_step(self, u: float) -> float:
        return self.step * math.floor(u / self.step + 0.5)
