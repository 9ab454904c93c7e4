"""What a drive moves: the parts of a loop that are not its controller, under a torque that is held.

    x' = f_m(x), the torque one of the states, which stands still

The plant is a system like any user's, followed by steps of its power series (steps.py), in which an event is a zero of
a polynomial.  Where a field has no series, or an event is not linear, a mode is followed by the engine
(motion/phases.py).

A torque that changes may leave an event beyond its zero: the mode ends there, a stuck mass breaks away.  Of a linear
mode in which the torque moves nothing, as where the motor sticks and its load rings, it is known between which torques
it lasts.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from functools import lru_cache
from typing import Any

import casadi as ca
import numpy as np

from ... import effort
from ...compiled import kept
from ...errors import InputError, NotFollowed, Status
from ...motion import MarchFailure, march
from ...roots import LOOKED_AT, MOST_HALVINGS, Bracket
from ..drive import SHARES, Drive
from ..parts.filtered_derivative import DERIVATIVE_FILTER
from ..parts.loop import Loop, torque_gain
from ..parts.lugre import LUGRE
from ..parts.part import Function, Part
from ..parts.table import remedy_of, with_remedy
from ..parts.wiring import UNGIVEN
from .steps import LAST_COEFFICIENTS, LEAST_SIZE, POWERS_OF_A_STEP, RATE_ROUNDED, STEP_ORDER, PlantMode, Ringing

ON_ITS_ZERO, ROUNDED_SLOPE = 1e-14, 1e-9
"""A polynomial, of order one, that is so near to zero at its start begins on it; its slope there, as a part of its
other coefficients, that may be rounding of forces."""


def first_rise(polynomial: Array) -> float:
    """The first place in [0, 1] at which a polynomial, by its coefficients, goes from below zero to above; inf: none.

    0 where it begins above zero, or on it and rises.  It is looked at in sixteen parts, and at its tops; one that
    begins on zero without that zero, which it may leave and come back to within one of the parts.
    """
    if polynomial[0] > ON_ITS_ZERO:
        return 0.0
    if polynomial[0] >= -ON_ITS_ZERO:
        rest = polynomial[1:]
        return first_rise(rest / np.abs(rest).max()) if rest.any() else math.inf
    values = _places(polynomial.size) @ polynomial
    above = np.flatnonzero(values[1:] >= 0)
    last = 1 + int(above[0]) if above.size else values.size
    inner = values[: last + 1]
    for k in 1 + np.flatnonzero((inner[1:-1] > inner[:-2]) & (inner[1:-1] > inner[2:])):
        top = _top(polynomial, LOOKED_AT[k - 1], LOOKED_AT[k + 1])
        if k < last and _value(polynomial, top) > 0:
            return _zero(polynomial, LOOKED_AT[k - 1], top)
    return math.inf if last == values.size else _zero(polynomial, LOOKED_AT[last - 1], LOOKED_AT[last])


def _without_rounding(polynomial: Array, whole: float) -> Array:
    """One that begins on zero, with a slope that is rounding beside its bend: the bend tells which way it goes.

    whole: so many times as long as the step is what the bend is measured by.
    """
    if abs(polynomial[0]) > ON_ITS_ZERO or abs(polynomial[1]) > ROUNDED_SLOPE * whole * np.abs(polynomial[2:]).max():
        return polynomial
    return np.array([0.0, 0.0, *polynomial[2:]])


@lru_cache(maxsize=64)
def _places(size: int) -> Array:
    return np.vander(LOOKED_AT, size, increasing=True)


def _value(polynomial: Array, place: float) -> float:
    return float(place ** np.arange(polynomial.size) @ polynomial)


def _top(polynomial: Array, low: float, high: float) -> float:
    """Where a polynomial is largest, which rises at the one place and falls at the other."""
    slope = polynomial[1:] * np.arange(1, polynomial.size)
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


Array = np.ndarray

HELD = Part(
    "held torque", ("held",),
    gives={"torque": lambda x, s, p: x.held, "compensation": lambda x, s, p: 0.0, "kp": lambda x, s, p: 1.0},
)  # fmt: skip
"""All that a plant sees of its drive; kp is but the size of an event."""

LEAST_OF_A_STEP, TAKEN_OFF = 0.2, 0.9
"""Factors of a step: at least so much of it when it is tried again, and what its estimate is multiplied by."""
TOO_SMALL_TO_SHOW, SHOWS = 1e-28, 1e-24
"""Of the feature of a field, of order one, that a step may step over: where it is less than the first at the start of a
step it is no more than the second at the end, which no digit of the motion shows; from there it is seen as it grows."""
LOOKED = 256
"""Steps between two reports of the work."""
MOST_AT_ONCE, MORE_AT_ONCE = 20, 10.0
"""Modes one after the other that take no time; so many times as much of a slope counts as rounding with each of them,
as on the verge of breaking away, where forces of 75 N leave 1e-14 N to either side."""
OF_THE_MARCH = 1e-10
"""Error of an interval where there is no series."""


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
    """A loop taken apart at the torque of its motor: (the plant under a held torque, the parts that a drive runs)."""
    parts = _moved(loop.present)
    if not parts:
        raise InputError(f"{loop.name}: no part of it is moved by the motor")
    numbers = {name: loop.value(name) for part in parts for name in part.parameters}
    plant = Loop((*parts, HELD), numbers, loop.name, loop.units)
    return plant, tuple(part for part in loop.present if part not in parts)


@kept(maxsize=64)
def _moved(parts: tuple[Part, ...]) -> tuple[Part, ...]:
    """Those that give the pull on the motor, and whatever that depends on, but for the torque."""
    givers = {name: part for part in parts for name in (*part.gives, *part.modes[0].law.gives)}
    plant, names, seen = list[Part](), ["pull"] * ("pull" in givers), set(HELD.gives)
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
    return tuple(part for part in parts if part in plant)


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
        self._name, self._mode = name, self._modes[name]
        self._limits: tuple[float, float] | None = None

    def _state(self) -> dict[str, float]:
        return dict(zip(self.names, self.x.tolist(), strict=True))

    @property
    def left_alone(self) -> bool:
        """Whether the torque moves nothing, and what moves dies out, as long as the mode lasts."""
        mode = self._mode
        return mode.still or (mode.dying is not None and not mode.dying.A[:, self.held].any())

    def ringing(self, seen: int) -> Ringing | None:
        """Of what is read where it is left alone; None where that rings on for ever."""
        dying = self._mode.dying
        if self._mode.still or dying is None or not (dying.A[seen].any() or dying.b[seen]):
            return Ringing(float(self.x[seen]), np.zeros(0), np.zeros(0))
        rings = (dying.factors != 0) & (dying.directions[seen] != 0)
        parts, rates = (dying.directions[seen] * dying.left(self.x))[rings], dying.factors[rings]
        if np.any(np.real(rates) >= -RATE_ROUNDED * np.abs(dying.factors).max()):
            return None
        return Ringing(float(self.x[seen] - np.real(parts.sum())), parts, rates)

    def ahead(self, T: float, count: int) -> tuple[Array, Array, Array]:
        """Where it is left alone: (count, n) the states after T, 2 T, ...; (2, count) the torques between which the
        mode lasts from 0, T, ... on for ever.

        x' = A x + b, e = a x + c:  e goes to a x_inf + c, and is away from that by no more than the sum over A's
        directions of what is left of each.
        """
        mode, dying = self._mode, self._mode.dying
        last, off = self.x, np.zeros((len(mode.exits), 1))
        states = np.broadcast_to(self.x, (count, self.x.size))
        if mode.still and self._limits is not None:
            return states, np.full(count, self._limits[0]), np.full(count, self._limits[1])
        if not mode.still and dying is not None:
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
        if mode.still:
            self._limits = float(limits[0, 0]), float(limits[1, 0])
        return states, limits[0], limits[1]

    def _event(self, way: Any, x: Array, torque: float) -> float:
        x = x.copy()
        x[self.held] = torque
        return float(way.event.function(x, 0.0, self.p))

    def __call__(self, torque: float, lasts: float) -> list[float]:
        """Go on for `lasts` seconds under a torque; the times [s] of the stops inside."""
        self.x[self.held] = torque
        now, stops, at_once = 0.0, list[float](), 0
        while now < lasts:
            if self._mode.still:
                # the torques between which nothing moves, where nothing does
                if self._limits is None:
                    self.ahead(0.0, 1)
                assert self._limits is not None
                low, high = self._limits
                if low <= torque <= high:
                    break
                self._pass(self._beyond())
                continue
            left, again = lasts - now, lasts * MORE_AT_ONCE ** (at_once - 2) if at_once > 1 else 0.0
            taken, way = self._step(left, again) if self._mode.has_series else self._marched(left)
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

    def _beyond(self) -> Any:
        """The exit that the torque is beyond, of a mode in which nothing moves."""
        return max(self._mode.exits, key=lambda way: way.direction * float(way.event.function(self.x, 0.0, self.p)))

    def _pass(self, way: Any) -> None:
        """Go through an exit."""
        if way.reset is not None:
            self.x = np.array(way.reset(ca.DM(self.x), ca.DM(self.p))).ravel()
        self._enter(way.successor(self.x, self.p))

    def _step(self, longest: float, again: float) -> tuple[float, Any]:
        """(time, exit at its end) of one step, of `longest` seconds at most.

        again: how long all steps together are, or more, where modes have come and gone at this place, 0 elsewhere: the
        rate of an event may be rounding there, by which a motor that breaks away stops at once, and breaks away.
        """
        mode = self._mode
        C, ends, E, seen = mode.found
        h = min(longest, mode.next)
        while True:
            mode.step(self.x, h)
            self._steps += 1
            if self._steps % LOOKED == 0:
                effort.pieces(LOOKED)
            last, before, behind, most = seen.tolist()
            beside = LAST_COEFFICIENTS / max(last, LEAST_SIZE) if last < np.inf else 0.0
            share = TAKEN_OFF * beside ** (1 / STEP_ORDER)
            if not last <= LAST_COEFFICIENTS:  # or it is no number
                h *= max(share, LEAST_OF_A_STEP)
                continue
            hidden, met = before < TOO_SMALL_TO_SHOW, -1
            if most >= 0 and not (hidden and behind > SHOWS):
                rows = [_without_rounding(row, again / h) for row in E] if again else E
                tau, met = min((first_rise(row), i) for i, row in enumerate(rows))
                met = met if tau <= 1 else -1
            if met >= 0:
                ends = tau**POWERS_OF_A_STEP @ C
            if not hidden or self._shown(behind, ends, met) <= SHOWS:
                break
            h /= 2
            ends = mode.found[1]
        longer = h * min(share, 1 / LEAST_OF_A_STEP)
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

    def _marched(self, longest: float) -> tuple[float, Any]:
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


# What a drive adds to the loop that it runs: its own remedies and its filter of the derivative, as parts

DRIVE_PARTS = {
    "dead band": "dead_band", "shifted dead band": "shifted_dead_band", "hysteresis": "hysteresis",
    "error dead band": "error_dead_band", "leak": "leak", "freeze": "dwell", "reset": "reset",
    "reset at a stop": "reset_at_stop", "error filter": "error_filter_time", "feedforward": "compensated",
}  # fmt: skip
"""Remedies that both kinds of controller have, by the key of their size in the table [drive]."""
USUAL_FILTER = 0.1
"""Time of the derivative's filter, in kd/kp, where the drive does not say it."""


def as_run(loop: Loop, drive: Drive) -> Loop:
    """The loop with what its drive adds.  Raises InputError: parts that do not go together."""
    model = "lugre" if LUGRE in loop.present else "switch"
    run = replace(loop, parts=tuple(part.sampled or part for part in loop.parts))
    for name, key in DRIVE_PARTS.items():
        if getattr(drive, key) != getattr(Drive, key):
            run = with_remedy(run, remedy_of(name, model), float(getattr(drive, key)))
    shares = {share: getattr(drive, share) for share, of in SHARES.items() if getattr(drive, of) != getattr(Drive, of)}
    run = run.replace(**shares)
    if drive.derivative != "filtered":
        return run
    filter_time = drive.filter_time
    if filter_time is None:
        filter_time = USUAL_FILTER * torque_gain(loop, "kd") / torque_gain(loop, "kp")
    return run.with_parts(DERIVATIVE_FILTER, derivative_filter=filter_time)
