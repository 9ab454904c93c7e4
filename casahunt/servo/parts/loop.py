"""A loop of parts and their numbers: a system like any user's, and what is asked of it by name.

    x' = product of the parts' fields (product.py),   at the numbers of the parts unless others are given
"""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Collection, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ...axis_units import Units, carried
from ...checks import choice_of, number, require
from ...errors import InputError
from ...hybrid import System
from ...motion import Motion
from ..friction import pairs_of
from .part import Function, Part
from .product import Modes, mode_name, product_of, wiring_of
from .wiring import Numbers, Signals

Array = np.ndarray

OF_MOTION = "x2", "load_rate", "x4"
"""States of plants beside angles, and of bristles: all others are those of the controller and its filters."""
_UNITS = {"x2": "rad/s", "x3": "rad s", "x4": "rad", "load_rate": "rad/s", "filtered": "rad", "clock": "s"}
"""Of states that are no angles."""
BALANCED_TO = 1e-9
"""Part of the load to which the controller holds it; and of rates, to which those of a mirror image are their own."""
MIRRORED_AT = 40
"""States in which the mirror image is looked at."""


@dataclass(frozen=True, eq=False)
class Loop:
    """Parts and their numbers.

    Attributes
    ----------
    parts : the parts, in the order of their states; one whose size is that of its absence is left out.
    values : parameters that differ from the parts' defaults.
    name : what it is called.
    units : how its numbers are shown, and whether the axis is a linear one; nothing that is computed depends on it.

    Raises
    ------
    InputError : parts that do not go together, an unknown parameter, or no number.

    Examples
    --------
    The smallest dead band on the integrator's input that ends hunting.

    >>> from casahunt.continuation import largest
    >>> from casahunt.orbits import find_cycle
    >>> from casahunt.servo.parts import DEAD_BAND, INERTIA, INTEGRATOR, PID_BY_TIMES, SWITCH, Loop
    >>> loop = Loop((INERTIA, SWITCH, PID_BY_TIMES, INTEGRATOR, DEAD_BAND), {"gain": 0.04, "dead_band": 0.01})
    >>> start = loop.state(x1=-0.05)
    >>> cycle = find_cycle(loop.system, loop.mode_at(**start), start=start, follow="dead_band", tol=1e-9)
    >>> round(largest(cycle, "dead_band").value, 8)  # rad
    0.04334572
    """

    parts: tuple[Part, ...]
    values: Mapping[str, float] = field(default_factory=dict)
    name: str = "servo"
    units: Units = carried()

    def __post_init__(self) -> None:
        owners = {name: part for part in self.parts for name in part.parameters}
        for name, value in self.values.items():
            low, high = owners[choice_of("parameter", name, owners)].ranges.get(name, (0.0, math.inf))
            if not low <= number(name, value) <= high:
                allowed = f"at least {low:g}" if math.isinf(high) else f"between {low:g} and {high:g}"
                raise InputError(f"{self.units.word(name)} = {value:g}: must be {allowed} ({owners[name].name})")
        for static, coulomb in pairs_of(self).items():
            name = self.units.word(coulomb)
            require(self.units.word(static), self.value(static), at_least=self.value(coulomb), unit=name)

    @cached_property
    def present(self) -> tuple[Part, ...]:
        """The parts that are there: of size zero, none is."""
        return tuple(part for part in self.parts if not part.size or self.value(part.size) != part.absent)

    @property
    def within_limits(self) -> Loop:
        """The loop as it is where none of its parts is saturated: without those that saturate."""
        parts = tuple(part for part in self.parts if not part.saturates)
        own = {name for part in parts for name in part.parameters}
        values = {name: value for name, value in self.values.items() if name in own}
        return dataclasses.replace(self, parts=parts, values=values) if len(parts) < len(self.parts) else self

    @cached_property
    def parameters(self) -> dict[str, float]:
        """Those of the parts that are there."""
        return {name: self.value(name) for part in self.present for name in part.parameters}

    @property
    def names(self) -> tuple[str, ...]:
        """The names of these parameters, in the order of the parts."""
        return tuple(self.parameters)

    def to_dict(self, **_: Any) -> dict[str, Any]:
        """Parts and parameters, for a file of results.

        Returns
        -------
        Names of the parts that are there, and their parameters.
        """
        return {"parts": [part.name for part in self.present], "parameters": self.parameters}

    @property
    def controller_names(self) -> tuple[str, ...]:
        """The numbers of the parts that demand a torque of the motor."""
        return self._numbers_of({"demand"})

    @property
    def tunable_names(self) -> tuple[str, ...]:
        """The numbers that `tune` may free: those of the controller and of its filters."""
        return tuple(dict.fromkeys((*self.controller_names, *self._numbers_of({"command", "derivative", "seen"}))))

    def _numbers_of(self, signals: set[str]) -> tuple[str, ...]:
        """The parameters of the parts that give one of these signals, but for the gains of loop and motor."""
        found = (name for part in self.present if signals & set(part.gives) for name in part.parameters)
        return tuple(name for name in found if name not in ("gain", "motor_gain"))

    @cached_property
    def _numbers(self) -> dict[str, float]:
        """Those of all parts."""
        defaults = {name: value for part in self.parts for name, value in part.parameters.items()}
        return {name: float(self.values.get(name, value)) for name, value in defaults.items()}

    def value(self, name: str) -> float:
        """One parameter."""
        return self._numbers[choice_of("parameter", name, self._numbers)]

    def replace(self, **values: float) -> Loop:
        """The loop with other numbers."""
        return dataclasses.replace(self, values={**self.values, **values})

    def with_parts(self, *parts: Part, **values: float) -> Loop:
        """The loop with parts more.

        Parameters
        ----------
        *parts
            those that come behind the others.
        **values
            parameters that differ from the parts' defaults.

        Returns
        -------
        Loop.
        """
        return dataclasses.replace(self, parts=(*self.parts, *parts), values={**self.values, **values})

    @cached_property
    def system(self) -> System:
        """The loop as a system."""
        return product_of(self.present, tuple(self.parameters.items()), self.name)

    @property
    def angles(self) -> tuple[str, ...]:
        """The states that are angles from the set point."""
        return tuple(state for part in self.present for state in part.angles)

    def unit_of(self, state: str) -> str:
        """The unit of a state in SI, of a rotary axis; "" where it is not known."""
        stands = any(state in part.stands for part in self.present)  # at an error, which is an angle
        return "rad" if stands or state in self.angles else _UNITS.get(state, "")

    def state(self, **start: float) -> dict[str, float]:
        """Every state: those given, the others zero.

        Returns
        -------
        State by name; what is no state is refused.
        """
        states = tuple(state for part in self.present for state in part.states)
        for name in start:
            choice_of("state", name, states)
        return {state: float(start.get(state, 0.0)) for state in states}

    def at_rest(self, angle: float) -> dict[str, float]:
        """Every state where the servo stands still beside its set point, nothing wound up but what carries the load.

        Parameters
        ----------
        angle
            how far beside it [rad].

        Returns
        -------
        State by name: angles are `angle`, velocities zero, filters of the error have settled, all others are those in
        which the controller, in balance at the set point, holds the load there; zero without a load, or where the
        controller does not integrate.
        """
        return self.settled({**self._under_load, **dict.fromkeys(self.angles, angle)})

    def settled(self, state: Mapping[str, float], given: Collection[str] = ()) -> dict[str, float]:
        """A state with that of the filters for which the servo has stood still.

        Parameters
        ----------
        state, given
            by name; the names of the states that are left as they are.

        Returns
        -------
        State by name.
        """
        found, filters = self.state(**state), [each for part in self.present for each in part.stands.items()]
        for name, signal in filters * len(filters):  # one may be that of what another has filtered
            if name not in given:
                found[name] = self.signal_at(signal, found)
        return found

    @property
    def carrying(self) -> dict[str, float]:
        """The states that carry the load where the loop stands at its set point, by name; none without a load."""
        return {name: x for name, x in self.at_rest(0.0).items() if x}

    @cached_property
    def _under_load(self) -> dict[str, float]:
        """The smallest states c of the controller: at the set point c' = A c + b = 0, torque = T c + m = -external.

        A leak is left out: what it takes from the integral is no matter of where that stands.
        """
        start = self.state()
        names, mode = list(start), self.mode_at(**start)
        at = [i for i, name in enumerate(names) if name not in (*self.angles, *OF_MOTION)]
        nowhere = np.zeros((len(names), 1))
        load = float(self.signal("external", mode, nowhere)[0])
        if not load or not at:
            return start
        field = self.system.vector_form.modes[mode]
        # Affine about the set point: one of each state gives the slopes
        unit = np.hstack([nowhere, np.eye(len(names))[:, at]])
        rates = np.array([np.array(field.field(ca.DM(x), ca.DM(self.system.values(None)), field.sign))[at, 0]
                          for x in unit.T]).T  # fmt: skip
        told = np.vstack([rates[[names[i] != "x3" for i in at]], self.signal("torque", mode, unit)])
        told = told[np.ptp(told, axis=1) > 0]
        A, b = told[:, 1:] - told[:, :1], -told[:, 0]
        b[-1] -= load
        c = np.linalg.lstsq(A, b, rcond=None)[0]
        holds = np.abs(A @ c - b).max() <= BALANCED_TO * abs(load)
        return start | {names[i]: float(value) for i, value in zip(at, c, strict=True) if holds}

    @cached_property
    def ways(self) -> tuple[float, ...]:
        """The signs of the steps that tell what any step does: +1 where the mirror image of each motion is one.

        f(S x) = S f(x), S = -1 but of clocks, is looked at in states of many sizes.
        """
        vector, even = self.system.vector_form, {name for part in self.present for name in part.even}
        mirror = np.array([1.0 if name in even else -1.0 for name in self.system.states])
        random, p = np.random.default_rng(0), ca.DM(self.system.values(None))

        def rate(x: Array) -> Array:
            mode = vector.modes[self.mode_at(**dict(zip(self.system.states, x.tolist(), strict=True)))]
            return np.array(mode.field(ca.DM(x), p, mode.sign))[:, 0]

        for x in 10 ** random.uniform(-6, 2, (MIRRORED_AT, mirror.size)):
            x = np.where(mirror < 0, random.choice([-1.0, 1.0], x.size), 1.0) * x
            f = rate(x)
            if np.abs(rate(mirror * x) - mirror * f).max() > BALANCED_TO * np.abs(f).max():
                return 1.0, -1.0
        return (1.0,)

    def mode_at(self, **start: float) -> str:
        """The mode of a motion that starts at a state: of each part the first that may be there."""
        state, chosen = self.state(**start), [part.modes[0] for part in self.present]
        for _ in self.present:  # of a part it may depend on the modes of others
            before = tuple(chosen)
            for i, part in enumerate(self.present):
                for mode in part.modes:
                    chosen[i] = mode
                    if mode.where is None or self._asked(mode.where, tuple(chosen), i, state):
                        break
            if tuple(chosen) == before:
                break
        return mode_name(tuple(chosen))

    def _asked(self, function: Function, modes: Modes, i: int, state: Mapping[str, float]) -> Any:
        wiring, sign = wiring_of(self.present, modes, None), modes[i].sign
        return wiring.chosen(function, sign, SimpleNamespace(**state), Numbers(**self.parameters))

    def signal(self, name: str, mode: str, x: Array) -> Array:
        """A signal at states of one mode.

        Parameters
        ----------
        name, mode
            the signal, such as "torque", and a mode of the loop's system.
        x
            (n, m) states.

        Returns
        -------
        (m,) values; a signal that no part gives is refused.
        """
        modes = next(m for m in itertools.product(*[part.modes for part in self.present]) if mode_name(m) == mode)
        wiring, states = wiring_of(self.present, modes, None), self.system.states
        named = SimpleNamespace(**dict(zip(states, x, strict=True)))
        value = getattr(Signals(wiring, named, Numbers(**self.parameters)), name)
        return np.broadcast_to(np.asarray(value, float), x.shape[1:])

    def signal_at(self, name: str, state: Mapping[str, float]) -> float:
        """A signal where a motion starts.

        Parameters
        ----------
        name, state
            the signal, such as "torque", and every state by name.

        Returns
        -------
        Its value.
        """
        return float(self.signal(name, self.mode_at(**state), np.array(list(state.values()))[:, None])[0])

    def along(self, name: str, motion: Motion, times: Array) -> Array:
        """A signal along a motion of the loop.

        Parameters
        ----------
        name, motion, times
            the signal, the motion, and (m,) times in it [s].

        Returns
        -------
        (m,) values; at an event those behind it.
        """
        values, states = np.empty(times.size), motion.at(times)
        modes = np.array([phase.mode for phase in motion.phases])[motion.phase_at(times)]
        for mode in dict.fromkeys(modes.tolist()):
            values[modes == mode] = self.signal(name, mode, states[:, modes == mode])
        return values


def static_of(loop: Loop) -> tuple[float, float]:
    """Static and Coulomb friction [N m]: of the load, where the motor has none."""
    at = "" if "static" in loop.parameters else "load_"
    if at + "static" not in loop.parameters:
        raise InputError(f"{loop.name}: has no dry friction, which is what a motion is judged by")
    static = loop.value(at + "static")
    return static, loop.value(at + "coulomb") if at + "coulomb" in loop.parameters else static


def breakaway_of(loop: Loop) -> tuple[float, float]:
    """Static friction [N m] against a pull forwards, and against one back."""
    static, _ = static_of(loop)
    return static, loop.parameters.get("static_back", static)


def torque_gain(loop: Loop, name: str) -> float:
    """The torque gain "kp", "ki" or "kd" of the controller.  Raises InputError: it has no such gain."""
    nowhere, (mode, *_) = np.zeros((len(loop.system.states), 1)), loop.system.modes
    return float(loop.signal(name, mode.name, nowhere)[0])
