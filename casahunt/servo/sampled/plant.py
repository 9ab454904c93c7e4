"""What a drive moves: the parts of a loop that are not its controller, under a torque that is held.

    x' = f_m(x), the torque one of the states, which stands still
    x(t + tau h) = sum over k of C_k tau^k,    e(t + tau h) = sum over k of E_k tau^k,    0 <= tau <= 1

The plant is a system like any user's.  The coefficients of a step follow from its field (motion/recursion.py), and with
them those of an event that is linear in the states.  A step is as long as its last coefficients are below rounding; an
event in it is a zero of a polynomial.  Where a field has no series, or an event is not linear, a mode is followed by
the engine (motion/phases.py).

A torque that changes may leave an event beyond its zero: the mode ends there, a stuck mass breaks away.  Of a mode in
which the torque moves nothing, as where the motor sticks and its load rings, it is known between which torques it lasts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from functools import cached_property
from types import SimpleNamespace
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ... import effort
from ...compiled import Caller, caller, kept
from ...errors import InputError, NotFollowed, Status
from ...hybrid.system import EventFunction, Exit, Feature, Field, VectorMode
from ...motion import MarchFailure, march, taylor_coefficients
from ...roots import LOOKED_AT, MOST_HALVINGS, Bracket
from ..parts.loop import Loop
from ..parts.part import Function, Part
from ..parts.wiring import UNGIVEN

Array = np.ndarray

HELD = Part(
    "held torque", ("held",),
    gives={"torque": lambda x, s, p: x.held, "compensation": lambda x, s, p: 0.0, "kp": lambda x, s, p: 1.0},
)  # fmt: skip
"""All that a plant sees of its drive; kp is but the size of an event."""

ORDER = 20
"""Of the series."""
LAST_COEFFICIENTS, SMALLEST_SIZE = 1e-17, 1e-300
"""Of the last two coefficients, relative to the largest of the state; and of one that is zero and stays so."""
LEAST_SHARE, TAKEN_OFF = 0.2, 0.9
"""Factors of a step: at least so much of it when it is tried again, and what its estimate is multiplied by."""
HIDDEN, SHOWN = 1e-28, 1e-24
"""Of the feature of a field, of order one, that a step may step over: where it is less than the first at the start of a
step it is no more than the second at the end, which no digit of the motion shows; from there it is seen as it grows."""
ON_EVENT = 1e-14
"""An event, of order one, that is so near to zero where a mode begins is what it began with."""
LOOKED = 256
"""Steps between two reports of the work."""
ROUNDED, CONDITION = 1e-12, 1e10
"""Of the rates of a linear mode, in units of the largest: zero; how far its directions may be from being dependent."""
MOST_AT_ONCE = 20
"""Modes one after the other that take no time; more are rounding."""
OF_THE_MARCH = 1e-10
"""Error of an interval where there is no series."""

_PLACES = np.vander(LOOKED_AT, ORDER + 1, increasing=True)
_NUMBERS = np.arange(ORDER + 1.0)


class _Any:
    """Something that has every name."""

    def __init__(self, told: Callable[[str], None] = lambda name: None) -> None:
        self._told = told

    def __getattr__(self, name: str) -> ca.SX:
        self._told(name)
        return ca.SX.sym(name)


def _functions(part: Part) -> Iterator[Function]:
    """All that a part is computed by."""
    yield from part.gives.values()
    for mode in part.modes:
        yield from (*mode.law.rates.values(), *mode.law.gives.values(), *(edge.function for edge in mode.ends))


def plant_of(loop: Loop) -> tuple[Loop, tuple[Part, ...]]:
    """A loop taken apart at the torque of its motor: (the plant under a held torque, the parts that a drive runs).

    The plant is what gives the pull on the motor, and whatever that depends on, but for the torque.
    """
    givers = {name: part for part in loop.present for name in (*part.gives, *part.modes[0].law.gives)}
    if "pull" not in givers:
        raise InputError(f"{loop.name}: no part of it is moved by the motor")
    plant, names, seen = list[Part](), ["pull"], set(HELD.gives)
    while names:
        name = names.pop()
        if name in seen:
            continue
        seen.add(name)
        if name in givers and givers[name] not in plant:
            plant.append(givers[name])
            for function in _functions(givers[name]):
                function(_Any(), _Any(names.append), _Any())
        elif name in UNGIVEN and name not in givers:
            UNGIVEN[name](_Any(), _Any(names.append), _Any())
    parts = tuple(part for part in loop.present if part in plant)
    numbers = {name: loop.value(name) for part in parts for name in part.parameters}
    return Loop((*parts, HELD), numbers, loop.name), tuple(part for part in loop.present if part not in plant)


@kept(maxsize=128)
def step_of(
    field: Field, feature: Feature | None, events: tuple[tuple[EventFunction, int], ...], n: int, parameters: int
) -> tuple[ca.Function, Caller, tuple[int, ...]] | None:
    """One step, and of each event the state that alone is in it, or -1; None without a series.

    events: functions, each with the direction of its exit.
    (x, h, sign, p) -> (ORDER + 1, n) C; (n,) end; (E, ORDER + 1) E, in the direction of the exits; and (4,): the last
    coefficients, relative to the sizes of the states; the feature at the start; what it is at most half-way and at the
    end; what events are at most.
    """
    series = taylor_coefficients(field, n, parameters, ORDER)
    if series is None:
        return None
    x, h, sign, p = ca.SX.sym("x", n), ca.SX.sym("h"), ca.SX.sym("sign"), ca.SX.sym("p", parameters)
    C = ca.densify(series(x, sign, p, ca.DM.ones(n), h))
    at = ca.densify(ca.vertcat(*[direction * event(x, 0.0, p) for event, direction in events], ca.SX(0, 1)))
    slopes = ca.jacobian(at, x)
    if slopes.nnz() and ca.depends_on(ca.vertcat(*slopes.nonzeros()), x):
        return None
    E = ca.densify(ca.horzcat(at, ca.mtimes(slopes, C[:, 1:])))
    end = ca.sum2(C)
    sizes = ca.vertcat(*[ca.fmax(ca.mmax(ca.fabs(C[i, :])), SMALLEST_SIZE) for i in range(n)])
    tails = ca.fmax(ca.fabs(C[:, -1]), ca.fabs(C[:, -2])) / sizes
    halfway = ca.mtimes(C, ca.DM(0.5**_NUMBERS))
    hides = ca.vertcat(*(feature(at, p) for at in (x, halfway, end))) if feature is not None else ca.DM.ones(3)
    most = ca.mmax(ca.vertcat(E[:, 0] + ca.sum2(ca.fabs(E[:, 1:])), -1))
    seen = ca.vertcat(ca.mmax(tails), ca.fabs(hides[0]), ca.mmax(ca.fabs(hides[1:])), most)
    outputs = [C, end, E.T, seen]
    function = ca.Function("step", [x, h, sign, p], [ca.densify(each) for each in outputs])
    many, at_zero = len(events), ca.Function("zero", [x, p], [at])(ca.DM.zeros(n), p)
    rows, columns = slopes.sparsity().get_triplet()
    alone = [columns[rows.index(i)] if rows.count(i) == 1 and at_zero[i].is_zero() else -1 for i in range(many)]
    shapes = [(ORDER + 1, n), (n,), (many, ORDER + 1), (4,)]
    return function, caller(function, [(n,), (1,), (1,), (parameters,)], shapes), tuple(alone)


@kept(maxsize=128)
def _slopes(
    field: Field, feature: Feature | None, events: tuple[tuple[EventFunction, int], ...], n: int, parameters: int
) -> ca.Function | None:
    """(x, sign, p) -> slopes of the field, the field, slopes of the events in the direction of their exits; None where
    any slope changes with x."""
    x, sign, p = ca.SX.sym("x", n), ca.SX.sym("sign"), ca.SX.sym("p", parameters)
    f = ca.densify(ca.SX(field(x, p, sign)))
    at = ca.densify(ca.vertcat(*[direction * event(x, 0.0, p) for event, direction in events], ca.SX(0, 1)))
    A, a = ca.jacobian(f, x), ca.jacobian(at, x)
    if ca.depends_on(ca.vertcat(*A.nonzeros(), *a.nonzeros(), 0 * sign), x):
        return None
    return ca.Function("slopes", [x, sign, p], [ca.densify(A), f, ca.densify(a)])


class Dying(NamedTuple):
    """x' = A x + b of a linear mode, slopes of its events; factors (0 for what stands) and directions of A, their
    inverse, and that times b."""

    A: Array
    b: Array
    slopes: Array
    factors: Array
    directions: Array
    inverse: Array
    drive: Array

    def left(self, x: Array) -> Array:
        """(n,) how much of each direction will have died out: of what stands nothing."""
        moves = self.factors != 0
        return np.where(moves, self.inverse @ x + self.drive / np.where(moves, self.factors, 1), 0)


class PlantMode:
    """A mode of a plant at its numbers."""

    def __init__(self, mode: VectorMode, exits: tuple[Exit, ...], n: int, p: Array) -> None:
        self.mode, self.exits = mode, exits
        self.stepped = mode.field, mode.feature, tuple((way.event.function, way.direction) for way in exits), n, p.size
        found = step_of(*self.stepped)
        self.has_series = found is not None
        self.still, self.next = False, math.inf
        if found is None:
            return
        buffers, self.alone = found[1].buffers, found[2]
        (self._x, self._h, sign, parameters), self.found, self._run = buffers.inputs, buffers.outputs, buffers.trigger
        self._fixed = (sign, mode.sign), (parameters, p)
        moves = ca.SX(mode.field(ca.SX.sym("x", n), ca.DM(p), mode.sign))
        self.still = bool(ca.sparsify(ca.cse(moves)).nnz() == 0)
        """Whether nothing moves in it."""

    @cached_property
    def dying(self) -> Dying | None:
        """How it goes to where it stays; None where the mode is not linear, or something goes on or grows."""
        slopes = _slopes(*self.stepped)
        if slopes is None:
            return None
        A, b, a = (np.array(each) for each in slopes(np.zeros(self.stepped[3]), self.mode.sign, self._fixed[1][1]))
        factors, directions = np.linalg.eig(A)
        largest = np.abs(factors).max()
        if np.linalg.cond(directions) > CONDITION or np.any(np.real(factors) > ROUNDED * largest):
            return None
        inverse, stands = np.linalg.inv(directions), np.abs(factors) <= ROUNDED * largest
        drive = inverse @ b.ravel()
        if np.any(np.abs(drive[stands]) > ROUNDED * np.abs(drive).max()):
            return None
        return Dying(A, b.ravel(), a, np.where(stands, 0, factors), directions, inverse, drive)

    def step(self, x: Array, h: float) -> None:
        """Fill `found`."""
        for store, value in self._fixed:
            store[:] = value
        self._x[:], self._h[0] = x, h
        self._run()


class Plant:
    """A plant that is being moved.

    loop: from `plant_of`; start: its states by name.
    """

    def __init__(self, loop: Loop, start: dict[str, float]) -> None:
        self.loop, self.form, self.p = loop, loop.system.vector_form, loop.system.values(None)
        self.names = self.form.states
        self.x = np.array([start.get(name, 0.0) for name in self.names])
        self.held, self._modes, self._steps, self._sizes = self.names.index("held"), dict[str, PlantMode](), 0, self.x
        self._name = ""
        self._enter(loop.mode_at(**self._state()))

    @property
    def mode(self) -> PlantMode:
        """The mode that it is in."""
        return self._mode

    @property
    def still(self) -> bool:
        """Whether nothing moves, whatever the torque, as long as that lets it."""
        return self._mode.still

    def _enter(self, name: str) -> None:
        """Be in a mode; where it is split at a kink, and has no series itself, in one of its parts."""
        if name not in self._modes:
            exits = tuple(way for way in self.form.exits[name] if not way.mark or way.reset is not None)
            self._modes[name] = PlantMode(self.form.modes[name], exits, len(self.names), self.p)
        pieces = [] if self._modes[name].has_series else [m.name for m in self.form.modes.values() if m.unsplit == name]
        if pieces:  # the zero at which it is split is crossed
            others = [piece for piece in pieces if piece != self._name]
            return self._enter(others[0] if self._name else self.loop.mode_at(**self._state()))
        self._name, self._mode, self._limits = name, self._modes[name], None

    def _state(self) -> dict[str, float]:
        return dict(zip(self.names, self.x.tolist(), strict=True))

    def _between(self) -> tuple[float, float]:
        """The torques between which nothing moves, where nothing does."""
        if self._limits is None:
            _, (low,), (high,) = self.ahead(0.0, 1)
            self._limits = float(low), float(high)
        return self._limits

    def left_alone(self, seen: int) -> bool:
        """Whether the torque moves nothing, what is read stays, and all else dies out, as long as the mode lasts."""
        mode, dying = self._mode, self._mode.dying
        if mode.still or dying is None:
            return mode.still
        return not (dying.A[:, self.held].any() or dying.A[seen].any() or dying.b[seen])

    def ahead(self, T: float, count: int) -> tuple[Array, Array, Array]:
        """Where it is left alone: (count, n) the states after T, 2 T, ...; (2, count) the torques between which the
        mode lasts from 0, T, ... on for ever.

        x' = A x + b, e = a x + c:  e goes to a x_inf + c, and is away from that by no more than the sum over A's
        directions of what is left of each.
        """
        mode, dying = self._mode, self._mode.dying
        last, off = self.x, np.zeros((len(mode.exits), 1))
        states = np.broadcast_to(self.x, (count, self.x.size))
        if not mode.still:
            now = dying.left(self.x)
            left = np.exp(T * np.arange(count + 1)[:, None] * dying.factors) * now
            last = self.x - np.real(dying.directions @ now)
            states = last + np.real(left[1:] @ dying.directions.T)
            off = np.abs(dying.slopes @ dying.directions) @ np.abs(left[:-1]).T
        limits = np.full((2, count), math.inf) * np.array([[-1], [1]])
        for way, more in zip(mode.exits, off, strict=True):
            at, rise = (way.direction * self._event(way, last, torque) for torque in (0.0, 1.0))
            rise -= at
            ends = -(at + more) / rise if rise else np.where(at + more >= 0, -math.inf, math.inf)
            side = int(rise >= 0)
            limits[side] = np.minimum(limits[1], ends) if side else np.maximum(limits[0], ends)
        return states, limits[0], limits[1]

    def _event(self, way: Exit, x: Array, torque: float) -> float:
        x = x.copy()
        x[self.held] = torque
        return float(way.event.function(x, 0.0, self.p))

    def __call__(self, torque: float, lasts: float) -> list[float]:
        """Go on for `lasts` seconds under a torque; the times [s] of the stops inside."""
        self.x[self.held] = torque
        now, stops, at_once = 0.0, list[float](), 0
        while now < lasts:
            if self._mode.still:
                low, high = self._between()
                if low <= torque <= high:
                    break
                self._pass(self._beyond())
                continue
            step = self._step if self._mode.has_series else self._marched
            taken, way = step(lasts - now)
            now = lasts if taken == lasts - now else now + taken
            at_once = at_once + 1 if taken == 0 else 0
            if way is None:
                continue
            if at_once > MOST_AT_ONCE:
                raise NotFollowed(f"the motion of {self.loop.name} cannot be followed", Status.NOT_FOUND,
                                  evidence=f"its modes change without end at one place, as by {way.event.name!r}",
                                  time=math.nan)  # fmt: skip
            if way.event.name.endswith(("stop", "reversal")):
                stops.append(now)
            self._pass(way)
        return stops

    def _beyond(self) -> Exit:
        """The exit that the torque is beyond, of a mode in which nothing moves."""
        return max(self._mode.exits, key=lambda way: way.direction * float(way.event.function(self.x, 0.0, self.p)))

    def _pass(self, way: Exit) -> None:
        """Go through an exit."""
        if way.reset is not None:
            self.x = np.array(way.reset(ca.DM(self.x), ca.DM(self.p))).ravel()
        self._enter(way.successor(self.x, self.p))

    def _step(self, longest: float) -> tuple[float, Exit | None]:
        """(time, exit at its end) of one step, of `longest` seconds at most."""
        mode = self._mode
        C, ends, E, seen = mode.found
        h = min(longest, mode.next)
        while True:
            mode.step(self.x, h)
            self._steps += 1
            if self._steps % LOOKED == 0:
                effort.pieces(LOOKED)
            last, before, behind, most = seen.tolist()
            share = TAKEN_OFF * (LAST_COEFFICIENTS / max(last, SMALLEST_SIZE)) ** (1 / ORDER) if last < np.inf else 0.0
            if not last <= LAST_COEFFICIENTS:  # or it is no number
                h *= max(share, LEAST_SHARE)
                continue
            hidden, met = before < HIDDEN, -1
            if most >= 0 and not (hidden and behind > SHOWN):
                tau, met = min((first_rise(row), i) for i, row in enumerate(E))
                met = met if tau <= 1 else -1
            if met >= 0:
                ends = tau**_NUMBERS @ C
            if not hidden or self._shown(behind, ends, met) <= SHOWN:
                break
            h /= 2
            ends = mode.found[1]
        longer = h * min(share, 1 / LEAST_SHARE)
        mode.next = max(longer, mode.next) if h == longest and mode.next < np.inf else longer
        self.x[:] = ends
        if met < 0:
            return h, None
        if mode.alone[met] >= 0:
            self.x[mode.alone[met]] = 0.0
        return h * tau, mode.exits[met]

    def _shown(self, behind: float, ends: Array, met: int) -> float:
        """The feature of the field at the end of a step, where that is behind or at an event that is met."""
        if met < 0:
            return behind
        self._mode.step(ends, 0.0)
        return float(self._mode.found[3][1])

    def _marched(self, longest: float) -> tuple[float, Exit | None]:
        """The same without a series: of all `longest` seconds."""
        self._sizes = np.maximum(self._sizes, np.abs(self.x))
        mode = self._mode.mode
        try:
            *_, last = march(
                self.form, self._name, self.x, self.p, scale=np.where(self._sizes > 0, self._sizes, 1.0),
                until=lambda _: True, tol=OF_THE_MARCH, kind="radau" if mode.stiff else "gauss", max_time=longest,
                meshed=False,
            )  # fmt: skip
        except MarchFailure as failure:
            raise NotFollowed(f"the motion of {self.loop.name} cannot be followed", Status.NOT_FOUND,
                              evidence=str(failure), time=math.nan) from None  # fmt: skip
        self.x[:] = last.end
        way = next((way for way in self._mode.exits if way.event.name == last.event), None)
        return (longest if way is None else last.duration), way


def first_rise(polynomial: Array) -> float:
    """The first place in [0, 1] at which a polynomial, by its coefficients, goes from below zero to above; inf: none.

    0 where it begins above zero, or on it and rises.  It is looked at in sixteen parts, and at its tops.
    """
    values = _PLACES @ polynomial
    if values[0] > ON_EVENT:
        return 0.0
    begins = 0
    if abs(values[0]) <= ON_EVENT:
        moves = np.flatnonzero(values[1:])
        if not moves.size or values[1 + moves[0]] > 0:
            return 0.0 if moves.size else math.inf
        begins = 1 + int(moves[0])
    above = np.flatnonzero(values[begins + 1 :] >= 0)
    last = begins + 1 + int(above[0]) if above.size else values.size
    inner = values[begins : last + 1]
    for k in begins + 1 + np.flatnonzero((inner[1:-1] > inner[:-2]) & (inner[1:-1] > inner[2:])):
        top = _top(polynomial, LOOKED_AT[k - 1], LOOKED_AT[k + 1])
        if k < last and _value(polynomial, top) > 0:
            return _zero(polynomial, LOOKED_AT[k - 1], top)
    return math.inf if last == values.size else _zero(polynomial, LOOKED_AT[last - 1], LOOKED_AT[last])


def _value(polynomial: Array, place: float) -> float:
    return float(place**_NUMBERS @ polynomial)


def _top(polynomial: Array, low: float, high: float) -> float:
    """Where a polynomial is largest, which rises at the one place and falls at the other."""
    slope = np.append(polynomial[1:] * _NUMBERS[1:], 0.0)
    a, b = _value(slope, low), _value(slope, high)
    return _zero(-slope, low, high) if a > 0 > b else low if a <= 0 else high


def _zero(polynomial: Array, low: float, high: float) -> float:
    """The zero of a polynomial that is below zero at one place and above at the next."""
    f_low, f_high = _value(polynomial, low), _value(polynomial, high)
    if not f_low < 0 < f_high:
        return low if f_low >= 0 else high
    bracket, place = Bracket(low, f_low, high, f_high), low + (high - low) * f_low / (f_low - f_high)
    coefficients = polynomial.tolist()
    for _ in range(MOST_HALVINGS):
        value = slope = 0.0
        for coefficient in reversed(coefficients):
            slope = slope * place + value
            value = value * place + coefficient
        if value == 0:
            break
        bracket = bracket.told(place, value)
        following = bracket.newton(place, value, slope)
        if following == place or bracket.width <= np.spacing(high):
            break
        place = following
    return place
