"""A hybrid system as its user writes it: named states and parameters, everything about one mode together.

    Mode("slip", field=lambda x, p: {"x": x.v, "v": (force(x, p) - p.stiffness * x.x) / p.mass},
         holds=lambda x, p: p.belt - x.v,
         ends=(Event("catches up", lambda x, p: x.v - p.belt, +1, to="stick"),))

Functions are written with arithmetic and CasADi's functions (casadi.sin and so on) of the states x.name and the
parameters p.name.  They are called with symbols, once; whatever else they use is a constant.

`System.vector_form` is the same for the engine (system.py): functions of vectors, in the order of the names.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from keyword import iskeyword
from numbers import Real
from types import MappingProxyType
from typing import Any

import numpy as np

from ..checks import choice_of, number, quoted, require
from ..errors import InputError
from . import system as engine
from .expressions import check_functions
from .vector_form import SIGN, TIME, Named, Names, listed, vector_form_of

Array = np.ndarray
Function = Callable[[Named, Named], Any]
Values = Callable[[Named, Named], Mapping[str, Any]]


@dataclass(frozen=True)
class Event:
    """A way out of a mode: where h(x; p) crosses zero.

    Attributes
    ----------
    name : what the user reads, such as "catches up".
    function : (x, p) -> h, a scalar of order one away from the event.
    direction : +1 where h rises through zero, -1 where it falls, 0 for either way.
    to : name of the next mode, or a function (x, p) of numbers that returns it, of the state after the reset.  The name
        of the mode itself makes the event a boundary between two phases although the mode goes on; where a function
        returns it, the event is ignored, and the phase goes on: refused where another mode lives beyond, and no `holds`
        of this one says that it goes on.
    reset : (x, p) -> the states that jump, by name; what is not named stays.  None where nothing jumps.

    Examples
    --------
    >>> from casahunt.hybrid import Event
    >>> Event("catches up", lambda x, p: x.v - p.belt, direction=+1, to="stick").name
    'catches up'
    """

    name: str
    function: Function
    direction: int
    to: str | Callable[[Named, Named], str]
    reset: Values | None = None


@dataclass(frozen=True)
class Mode:
    """One smooth piece of the dynamics, by its vector field or in closed form.

    Attributes
    ----------
    name : what the user reads, such as "slip".
    field : (x, p) -> the derivative of every state, by name.  May be left out where there is a `flow`.
    flow : (x, t, p) -> every state a time t later, by name: the closed form of a mode that has one.
    holds : (x, p) -> a scalar of order one, >= 0 where the mode is a motion of the system; None for everywhere.
    ends : the ways out.
    slack : how far `holds` may fall below zero without that it is another motion.
    smooth : the field has no kink along the phase.
    stiff : the field has fast decaying directions.
    feature : (x, p) -> a part of the field, of order one, that changes so suddenly that a mesh may step over it.
    unsplit : name of a mode with the same field that this one is a part of.  Where an event leads from one part to
        another the field has a kink, and no more: that a phase comes or goes there hardly changes the motion, and
        `follow` says between which cycles it does, without a search for the contact unless its `monitors` ask for it.
        Where the kinks of a phase are too weak for boundaries, it is computed in one, as of that mode.
    sign : a number of the mode's own, p.sign in its functions and in those of its events: modes that differ in it alone
        share their functions, and what is compiled of them.

    Examples
    --------
    >>> from casahunt.hybrid import Mode
    >>> Mode("turns", field=lambda x, p: {"angle": x.rate, "rate": p.torque - x.rate}).name
    'turns'
    """

    name: str
    field: Values | None = None
    flow: Callable[[Named, Any, Named], Mapping[str, Any]] | None = None
    holds: Function | None = None
    ends: tuple[Event, ...] = ()
    slack: float = 0.0
    smooth: bool = True
    stiff: bool = False
    feature: Function | None = None
    sign: float | None = None
    unsplit: str | None = None


@dataclass(frozen=True, eq=False)
class System:
    """A hybrid system with named states and parameters.  Compared by value, functions by identity.

    Attributes
    ----------
    name : what it is called, such as "block on a belt".
    states : names of the n states.
    parameters : name: value.
    modes : the modes.
    forcing_period : p -> duration of one turn of the forcing, or None for a system that time does not enter.  Where it
        is given, x.t is the time, in fields, events and resets.
    symmetries : (n, n) matrices S, states in the order of the names, under which the system may be the same; x -> -x
        is always looked at.
    angles : names of states that are the same after a turn of 2 pi.

    Raises
    ------
    InputError : something does not fit; the sentence names the mode, event, state or parameter.

    Examples
    --------
    >>> from casahunt.hybrid import Mode, System
    >>> def runs(x, p):
    ...     return {"x": x.v, "v": p.mu * (1 - x.x**2) * x.v - x.x}
    >>> System("van der Pol", ("x", "v"), {"mu": 1.0}, (Mode("runs", runs),)).states
    ('x', 'v')
    """

    name: str
    states: tuple[str, ...]
    parameters: Mapping[str, float]
    modes: tuple[Mode, ...]
    forcing_period: Callable[[Named], Any] | None = None
    symmetries: tuple[Any, ...] = ()
    angles: tuple[str, ...] = ()
    names: Names = field(init=False, repr=False)
    _key: tuple[int, tuple[Any, ...]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        _check_shapes(self)
        values = {name: number(f"parameter {name!r}", value) for name, value in self.parameters.items()}
        object.__setattr__(self, "parameters", MappingProxyType(values))
        matrices = tuple(tuple(tuple(map(float, row)) for row in np.asarray(S)) for S in self.symmetries)
        object.__setattr__(self, "symmetries", matrices)
        object.__setattr__(self, "names", Names(self.states, tuple(self.parameters), self.forcing_period))
        self._identify()
        check_functions(self)
        self.values()

    def _identify(self) -> None:
        """What systems are compared by."""
        numbers = tuple(self.parameters.items())
        key = (self.name, self.states, numbers, self.modes, self.forcing_period, self.symmetries, self.angles)
        object.__setattr__(self, "_key", (hash(key), key))

    def with_numbers(self, parameters: Mapping[str, float]) -> System:
        """The system with other numbers of its parameters.

        Parameters
        ----------
        parameters
            by name, those that change; whether its functions jump is not looked at again.

        Returns
        -------
        System.

        Raises
        ------
        InputError : as of `values`.
        """
        numbers = dict(zip(self.parameters, self.values(parameters).tolist(), strict=True))
        other = object.__new__(System)
        other.__dict__.update(self.__dict__, parameters=MappingProxyType(numbers))
        other._identify()
        return other

    def __hash__(self) -> int:
        return self._key[0]

    def __eq__(self, other: object) -> bool:
        return self is other or isinstance(other, System) and self._key == other._key

    def __reduce__(self) -> Any:
        given = (self.name, self.states, dict(self.parameters), self.modes)
        return System, (*given, self.forcing_period, self.symmetries, self.angles)

    @property
    def vector_form(self) -> engine.VectorSystem:
        """The system in the terms of the engine."""
        return vector_form_of(self)

    def mode(self, name: str) -> Mode:
        """The mode of that name.  Raises InputError where there is none."""
        choice_of("mode", name, [mode.name for mode in self.modes])
        return next(mode for mode in self.modes if mode.name == name)

    def values(self, parameters: Mapping[str, float] | None = None) -> Array:
        """(np,) the parameter vector, some of them changed.

        Raises
        ------
        InputError : an unknown name, no number, or a forcing whose turns take no time then.
        """
        changed = dict(self.parameters)
        for name, value in (parameters or {}).items():
            changed[choice_of("parameter", name, self.parameters)] = number(name, value)
        p = np.array(list(changed.values()), float)
        if self.forcing_period is not None:
            require(f"system {self.name!r}: forcing_period", float(self.names.turn(p)), above=0.0)
        return p

    def state(self, values: Mapping[str, float], parameters: Mapping[str, float] | None = None) -> Array:
        """The state vector of the engine.

        Parameters
        ----------
        values
            all states by name; in a forced system t is the time, default 0.
        parameters
            those that differ from the system's, by name: a turn of the forcing may last longer with them.

        Returns
        -------
        (n,) vector.

        Raises
        ------
        InputError : a state is missing or unknown, or no finite number.
        """
        allowed = (*self.states, TIME) if self.forcing_period else self.states
        for name in values:
            choice_of("state", name, allowed)
        missing = [name for name in self.states if name not in values]
        if missing:
            raise InputError(f"{self.name}: no value is given for the state {listed(missing)}")
        x = [number(f"state {name}", values[name]) for name in self.states]
        if self.forcing_period:
            x.append(number(TIME, values.get(TIME, 0.0)) / float(self.names.turn(self.values(parameters))))
        return np.array(x)


# What the user wrote, checked: one sentence with the mode, event, state or parameter -------------------------------


def _check_shapes(system: System) -> None:
    """Names, types and numbers."""
    if not isinstance(system.name, str) or not system.name:
        raise InputError(f"the name of a system must be a text, not {quoted(system.name)}")
    what = f"system {system.name!r}"
    _check_names(what, "states", system.states)
    _check_names(what, "angles", system.angles, empty=True)
    if not isinstance(system.parameters, Mapping):
        raise InputError(f"{what}: parameters must be a mapping from names to numbers")
    _check_names(what, "parameters", tuple(system.parameters), empty=True)
    _check_structure(what, system)
    if system.forcing_period is not None:
        _check_callable(what, "forcing_period", system.forcing_period)
        if TIME in system.states:
            raise InputError(f"{what}: a forced system has its time as x.{TIME} already; take it from the states")
    if not isinstance(system.modes, tuple) or not system.modes:
        raise InputError(f"{what}: modes must be a tuple of at least one Mode")
    for mode in system.modes:
        if not isinstance(mode, Mode):
            raise InputError(f"{what}: {quoted(mode)} among the modes is no Mode")
        _check_mode(mode, [m.name for m in system.modes if isinstance(m, Mode)])
    if SIGN in system.parameters and any(mode.sign is not None for mode in system.modes):
        raise InputError(f"{what}: p.{SIGN} is the sign of a mode, and a parameter; give the parameter another name")
    repeated = {m.name for m in system.modes if [n.name for n in system.modes].count(m.name) > 1}
    if repeated:
        raise InputError(f"{what}: more than one mode is called {listed(sorted(repeated))}")


def _check_structure(what: str, system: System) -> None:
    """Angles and symmetries."""
    for angle in system.angles:
        if angle not in system.states:
            raise InputError(f"{what}: the angle {angle!r} is none of the states {listed(system.states)}")
    n = len(system.states)
    if not isinstance(system.symmetries, tuple):
        raise InputError(f"{what}: symmetries must be a tuple of matrices, such as (numpy.diag([1, -1]),)")
    for S in system.symmetries:
        try:
            matrix = np.asarray(S, float)
        except (TypeError, ValueError):
            matrix = np.zeros(0)
        if matrix.shape != (n, n) or not np.allclose(matrix @ matrix, np.eye(n)):
            raise InputError(
                f"{what}: a symmetry must be a matrix S of shape ({n}, {n}) with S S = 1; where a "
                "state jumps, its event has a reset"
            )


def _check_names(what: str, which: str, names: Any, *, empty: bool = False) -> None:
    if isinstance(names, str) or not isinstance(names, tuple) or not (names or empty):
        raise InputError(f"{what}: {which} must be a tuple of names, such as ('x', 'v')")
    for name in names:
        if not isinstance(name, str) or not name.isidentifier() or iskeyword(name) or name[0] == "_":
            raise InputError(f"{what}: {quoted(name)} among its {which} is no name that can be written as x.name")
    if len(set(names)) < len(names):
        raise InputError(f"{what}: one of its {which} stands there twice: {listed(names)}")


def _check_callable(what: str, which: str, function: Any) -> None:
    if not callable(function):
        raise InputError(f"{what}: {which} must be a function, not {quoted(function)}")


def _check_mode(mode: Mode, modes: list[str]) -> None:
    if not isinstance(mode.name, str) or not mode.name:
        raise InputError(f"the name of a mode must be a text, not {quoted(mode.name)}")
    what = f"mode {mode.name!r}"
    if mode.field is None and mode.flow is None:
        raise InputError(f"{what}: needs a field, or a flow")
    for which in ("field", "flow", "holds", "feature"):
        if getattr(mode, which) is not None:
            _check_callable(what, which, getattr(mode, which))
    if not isinstance(mode.ends, tuple) or not all(isinstance(event, Event) for event in mode.ends):
        raise InputError(f"{what}: ends must be a tuple of Events, such as (Event(...),)")
    if mode.sign is not None:
        number(f"{what}: {SIGN}", mode.sign)
    if mode.unsplit is not None and (mode.unsplit not in modes or mode.unsplit == mode.name):
        raise InputError(f"{what}: unsplit = {quoted(mode.unsplit)}: must be another of the modes {listed(modes)}")
    if number(f"{what}: slack", mode.slack) < 0:
        raise InputError(f"{what}: slack = {mode.slack:g}: must not be negative")
    for event in mode.ends:
        _check_event(event, what, modes)
        if [e.name for e in mode.ends].count(event.name) > 1:
            raise InputError(f"event {event.name!r} of {what}: the events of a mode need different names")


def _check_event(event: Event, mode: str, modes: list[str]) -> None:
    if not isinstance(event.name, str) or not event.name:
        raise InputError(f"{mode}: the name of an event must be a text, not {quoted(event.name)}")
    what = f"event {event.name!r} of {mode}"
    _check_callable(what, "function", event.function)
    if isinstance(event.direction, bool) or not isinstance(event.direction, Real) or event.direction not in (1, -1, 0):
        raise InputError(
            f"{what}: direction = {quoted(event.direction)}: must be +1 (rising), -1 (falling) or 0 (either way)"
        )
    if isinstance(event.to, str) and event.to not in modes:
        raise InputError(f"{what}: leads to {event.to!r}, which is none of the modes {listed(modes)}")
    if not isinstance(event.to, str):
        _check_callable(what, "to", event.to)
    if event.reset is not None:
        _check_callable(what, "reset", event.reset)
