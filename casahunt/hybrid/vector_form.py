"""Functions of named states and parameters as functions of the vectors x and p, which the engine works with.

    x = (states in the order of their names [, theta]),    p = (parameters in the order of their names)

A forced system says how long one turn of its forcing takes, T_f(p).  Time is then a state like the others, x.t, and in
the vector it is counted in turns,

    theta = t / T_f,    theta' = 1 / T_f,

so that a cycle of m turns is closed by theta(end) - m = theta(start), a number that no parameter moves.

The sign of a mode is a number that its functions see among the parameters, p.sign.  What is compiled takes it as an
argument of its own, so that modes that share a function and differ in the sign share what is compiled too.

Every function here is compared by value, the user's own inside it by identity: equal systems have equal cycles, in
another process too, where the user's functions are those of a module.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from ..compiled import Caller, caller, kept
from ..errors import InputError
from . import system as engine
from .system import HashedOnce

Array = np.ndarray

TIME = "t"
"""Name of the time in a forced system."""
TURNS = "t/turn"
"""Name of the state of the vector form that counts the turns."""
SIGN = "sign"
"""Name among the parameters of the number that a mode has for itself."""
TOGETHER = 32
"""Points for which a function is compiled besides one: any other number is taken by parts."""


def _entries(vector: Any) -> Any:
    """What can be asked for its entries one by one: of symbols a list, which costs as much as one of them alone."""
    return vector.elements() if isinstance(vector, ca.SX) and vector.is_dense() else vector


class Named:
    """The entries of a vector, by name.

    Parameters
    ----------
    kind
        what they are, for a refusal.
    vector
        (n,) or (n, m).
    places
        name: number of the entry.
    others
        name: value of what is no entry.
    """

    __slots__ = ("_kind", "_others", "_places", "_vector")

    def __init__(self, kind: str, vector: Any, places: Mapping[str, int], others: Mapping[str, Any]) -> None:
        self._kind, self._vector, self._places, self._others = kind, vector, places, others

    def __contains__(self, name: str) -> bool:
        return name in self._places or name in self._others

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        place = self._places.get(name)
        if place is not None:
            return self._vector[place]
        if name in self._others:
            return self._others[name]
        timeless = self._kind == "state" and name == TIME
        hint = "; a system has a time where it says its forcing_period" if timeless else ""
        raise InputError(
            f"there is no {self._kind} {name!r}; there is {listed([*self._places, *self._others])}{hint}"
        )


def listed(names: Iterable[str]) -> str:
    """Names in a row, for a sentence."""
    return ", ".join(names) or "none"


@dataclass(frozen=True)
class Names(HashedOnce):
    """What the entries of x and p are called.

    Attributes
    ----------
    states, parameters : names, without the time.
    forcing_period : p -> duration of one turn of the forcing, or None where time does not enter.
    """

    states: tuple[str, ...]
    parameters: tuple[str, ...]
    forcing_period: Callable[[Named], Any] | None = None
    _state_places: dict[str, int] = field(init=False, repr=False, compare=False)
    _parameter_places: dict[str, int] = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_state_places", {name: i for i, name in enumerate(self.states)})
        object.__setattr__(self, "_parameter_places", {name: i for i, name in enumerate(self.parameters)})

    @property
    def entries(self) -> tuple[str, ...]:
        """Names of the entries of x."""
        return self.states if self.forcing_period is None else (*self.states, TURNS)

    def p(self, p: Any, sign: Any = None) -> Named:
        """Parameters by name.

        p: (np,) numbers or symbols; sign: that of the mode, None where it has none.
        """
        return Named("parameter", _entries(p), self._parameter_places, {} if sign is None else {SIGN: sign})

    def turn(self, p: Any) -> Any:
        """Duration of one turn of the forcing."""
        assert self.forcing_period is not None
        return self.forcing_period(self.p(p))

    def x(self, x: Any, p: Any) -> Named:
        """States by name, from the vectors; and the time in a forced system.

        x, p: (n,) or (n, m), and (np,): numbers or symbols. Returns named; an entry of (n, m) is (m,).
        """
        x = _entries(x)
        time = {} if self.forcing_period is None else {TIME: x[len(self.states)] * self.turn(p)}
        return Named("state", x, self._state_places, time)

    def numbers(self, x: Array, p: Array) -> dict[str, float]:
        """Numbers by name; with the time in a forced system.

        x, p: (n,) state and (np,) parameters. Returns name: number.
        """
        found = dict(zip(self.states, map(float, x), strict=False))
        return found if self.forcing_period is None else found | {TIME: float(x[-1]) * float(self.turn(p))}

    def column(self, values: Mapping[str, Any], turns: Any) -> Any:
        """The vector of one value for every state.

        turns: the entry of the time in a forced system; left out in any other. Returns (n,) of CasADi.
        """
        return ca.vertcat(*[values[name] for name in self.states], *([] if self.forcing_period is None else [turns]))


@kept(maxsize=None)  # never forgotten: what `returned` keeps is written in them
def symbols(names: Names) -> tuple[ca.SX, ca.SX, ca.SX, ca.SX]:
    """(x, T, p, sign): what functions of these names are called with."""
    return ca.SX.sym("x", len(names.entries)), ca.SX.sym("T"), ca.SX.sym("p", len(names.parameters)), ca.SX.sym("sign")


@kept(maxsize=512)
def returned(function: Callable[..., Any], names: Names, signed: bool, timed: bool) -> Any:
    """What a function of the user's returns for the symbols: it is called this once.

    function: of (x, p), or (x, T, p); signed, timed: it sees the sign of a mode; it takes a time.
    """
    x, T, p, sign = symbols(names)
    state, parameters = names.x(x, p), names.p(p, sign if signed else None)
    return function(state, T, parameters) if timed else function(state, parameters)


@dataclass(frozen=True)
class OfUser(HashedOnce):
    """A function of the user's in the terms of the engine.

    Attributes
    ----------
    function : the user's.
    names : what the entries of x and p are called.
    signed : it sees the sign of a mode.
    sign : that sign, where the engine does not hand it over.
    """

    function: Callable[..., Any]
    names: Names
    signed: bool = False
    sign: float = 0.0

    def _expression(self, x: Any, T: Any, p: Any) -> Any:
        """What the engine wants, of the symbols."""
        raise NotImplementedError

    def at(self, x: Any, T: Any, p: Any, sign: Any) -> Any:
        """It of other symbols, or of numbers.

        x, T, p, sign: (n,) state, time in the mode, (np,) parameters, sign of the mode. Returns expression, or numbers.
        """
        return _graph(type(self), self.function, self.names, self.signed)(x, T, p, sign)


@kept(maxsize=512)
def _graph(kind: type[OfUser], function: Callable[..., Any], names: Names, signed: bool) -> ca.Function:
    """A function of (x, T, p, sign): to call it costs less than a tenth of what the user's own does."""
    x, T, p, sign = symbols(names)
    return ca.Function("user", [x, T, p, sign], [kind(function, names, signed)._expression(x, T, p)])


class Flow(OfUser):
    """(x, T, p) -> the state after T, by the closed form of a mode."""

    def __call__(self, x: Any, T: Any, p: Any) -> Any:
        return self.at(x, T, p, self.sign)

    def _expression(self, x: Any, T: Any, p: Any) -> Any:
        """The vector."""
        turns = None if self.names.forcing_period is None else x[len(self.names.states)] + T / self.names.turn(p)
        return self.names.column(returned(self.function, self.names, self.signed, True), turns)


class Field(OfUser):
    """(x, p, sign) -> x' of a mode."""

    def __call__(self, x: Any, p: Any, sign: Any) -> Any:
        return self.at(x, 0.0, p, sign)

    def _expression(self, x: Any, T: Any, p: Any) -> Any:
        """The vector."""
        turns = None if self.names.forcing_period is None else 1 / self.names.turn(p)
        return self.names.column(returned(self.function, self.names, self.signed, False), turns)


class FieldOfFlow(Field):
    """(x, p, sign) -> x' of a mode in closed form: the derivative of its flow at T = 0."""

    def _expression(self, x: Any, T: Any, p: Any) -> Any:
        """The vector."""
        flow = Flow(self.function, self.names, self.signed)._expression(x, T, p)
        return ca.substitute(ca.jacobian(flow, T), T, 0)


class Reset(OfUser):
    """(x, p) -> the state behind an event; what the user does not name stays."""

    def __call__(self, x: Any, p: Any) -> Any:
        return self.at(x, 0.0, p, self.sign)

    def _expression(self, x: Any, T: Any, p: Any) -> Any:
        """The vector."""
        jumps = returned(self.function, self.names, self.signed, False)
        stays = {name: x[i] for i, name in enumerate(self.names.states)}
        turns = None if self.names.forcing_period is None else x[len(self.names.states)]
        return self.names.column({**stays, **jumps}, turns)


class Scalar(OfUser):
    """(x, p, sign) -> a scalar: an expression of symbols, or numbers (m,) at the states (n, m)."""

    def __call__(self, x: Any, p: Any, sign: Any = 0.0) -> Any:
        return _at_points(self, x, p, sign) if isinstance(x, np.ndarray) else self.at(x, 0.0, p, sign)

    def _expression(self, x: Any, T: Any, p: Any) -> Any:
        """The scalar."""
        return ca.densify(ca.SX(returned(self.function, self.names, self.signed, False)))


@dataclass(frozen=True)
class Bound(HashedOnce):
    """(x, p), or (x, T, p) -> a scalar of a mode, with its sign: its feature, or an event at which it ends."""

    scalar: Scalar
    sign: float

    def __call__(self, x: Any, *T_and_p: Any) -> Any:
        return self.scalar(x, T_and_p[-1], self.sign)


@dataclass(frozen=True)
class Successor:
    """(x, p) -> name of the next mode, where it depends on the numbers; `what` is the event's name for a refusal."""

    function: Callable[[Named, Named], str]
    names: Names
    what: str
    modes: tuple[str, ...]
    sign: float | None = None

    def __call__(self, x: Array, p: Array) -> str:
        name = self.function(self.names.x(x, p), self.names.p(p, self.sign))
        if name not in self.modes:
            raise InputError(f"{self.what}: leads to {name!r}, which is none of the modes {listed(self.modes)}")
        return name


@dataclass(frozen=True)
class Always:
    """(x, p) -> one name, whatever the numbers."""

    name: str

    def __call__(self, x: Array, p: Array) -> str:
        return self.name


@kept(maxsize=512)
def _compiled(scalar: Scalar, points: int) -> Caller:
    """The scalar at so many points, through fixed buffers; spelt out, which is ten times as fast as called in turn."""
    n, m = len(scalar.names.entries), len(scalar.names.parameters)
    function = _graph(Scalar, scalar.function, scalar.names, scalar.signed)
    if points > 1:
        function = function.map("scalars", "serial", points, [1, 2, 3], []).expand()
    return caller(function, [(points, n), 1, m, 1], [points])


def _at_points(scalar: Scalar, x: Array, p: Array, sign: float) -> Any:
    """Numbers (m,) at the states x (n, m), or one number at x (n,)."""
    if x.ndim == 1:
        return float(_some(_compiled(scalar, 1), x[None], p, sign)[0])
    compiled, m = _compiled(scalar, TOGETHER), x.shape[1]
    if m <= TOGETHER:
        return _some(compiled, x.T, p, sign)
    return np.concatenate([_some(compiled, x[:, i : i + TOGETHER].T, p, sign) for i in range(0, m, TOGETHER)])


def _some(compiled: Caller, points: Array, p: Array, sign: float) -> Array:
    """Numbers at no more points (m, n) than compiled for."""
    buffers, m = compiled.buffers, len(points)
    states, _, parameters, of_mode = buffers.inputs
    states[:m], parameters[:], of_mode[0] = points, p, sign
    buffers.trigger()
    return buffers.outputs[0][:m].copy()


# A system as its user writes it (language.py) in the terms of the engine (system.py): functions of vectors

@kept(maxsize=64)
def vector_form_of(system: Any) -> engine.VectorSystem:
    """The system in the terms of the engine."""
    modes = {mode.name: _engine_mode(mode, system.names) for mode in system.modes}
    exits = {mode.name: tuple(_exits(mode, system)) for mode in system.modes}
    return engine.VectorSystem(system.name, system.names.entries, modes, exits)


def _engine_mode(mode: Any, names: Names) -> engine.VectorMode:
    signed, sign = mode.sign is not None, mode.sign or 0.0
    if mode.field is not None:
        vector_field = Field(mode.field, names, signed)
    else:
        assert mode.flow is not None
        vector_field = FieldOfFlow(mode.flow, names, signed)
    return engine.VectorMode(
        mode.name,
        vector_field,
        sign,
        flow=None if mode.flow is None else Flow(mode.flow, names, signed, sign),
        admissible=None if mode.holds is None else Scalar(mode.holds, names, signed),
        slack=mode.slack,
        smooth=mode.smooth,
        stiff=mode.stiff,
        feature=None if mode.feature is None else Bound(Scalar(mode.feature, names, signed), sign),
        unsplit=mode.unsplit or "",
    )


def _boundary(event: Any, mode: Any, names: Names) -> engine.VectorEvent:
    scalar = Scalar(event.function, names, mode.sign is not None)
    return engine.VectorEvent(event.name, Bound(scalar, mode.sign or 0.0))


def _exits(mode: Any, system: Any) -> Iterator[engine.Exit]:
    """The ways out of a mode; two for an event that is crossed either way."""
    names, signed, sign = system.names, mode.sign is not None, mode.sign or 0.0
    known_modes = tuple(m.name for m in system.modes)
    for event in mode.ends:
        what = f"event {event.name!r} of mode {mode.name!r}"
        boundary = _boundary(event, mode, names)
        asked = mode.holds is None and event.reset is None and not isinstance(event.to, str)
        others = tuple(
            (_engine_mode(m, names), tuple((_boundary(e, m, names), e.direction) for e in m.ends))
            for m in system.modes if asked and m is not mode
        )  # fmt: skip
        next_mode = (
            Always(event.to) if isinstance(event.to, str) else Successor(event.to, names, what, known_modes, mode.sign)
        )
        mark = event.to == mode.name or event.reset is not None
        reset = None if event.reset is None else Reset(event.reset, names, signed, sign)
        for direction in (event.direction,) if event.direction else (+1, -1):
            yield engine.Exit(boundary, direction, next_mode, mark, reset, others)
