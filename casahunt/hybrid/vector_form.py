"""Functions of named states and parameters as functions of the vectors x and p, which the engine works with.

    x = (states in the order of their names [, theta]),    p = (parameters in the order of their names)

A forced system says how long one turn of its forcing takes, T_f(p).  Time is then a state like the others, x.t, and in
the vector it is counted in turns,

    theta = t / T_f,    theta' = 1 / T_f,

so that a cycle of m turns is closed by theta(end) - m = theta(start), a number that no parameter moves.

Every function here is compared by value, the user's own inside it by identity: equal systems have equal cycles, in
another process too, where the user's functions are those of a module.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from ..compiled import Caller, caller, kept
from ..errors import InputError

Array = np.ndarray

TIME = "t"
"""Name of the time in a forced system."""
TURNS = "t/turn"
"""Name of the state of the vector form that counts the turns."""
CHUNKS = (1, 32, 128)
"""Numbers of points for which functions are compiled: any other number is taken by parts."""


class Named:
    """The entries of a vector, by name."""

    __slots__ = ("_kind", "_values")

    def __init__(self, kind: str, values: dict[str, Any]) -> None:
        self._kind, self._values = kind, values

    def __getattr__(self, name: str) -> Any:
        if name.startswith("__"):
            raise AttributeError(name)
        try:
            return self._values[name]
        except KeyError:
            timeless = self._kind == "state" and name == TIME
            hint = "; a system has a time where it says its forcing_period" if timeless else ""
            raise InputError(f"there is no {self._kind} {name!r}; there is {listed(self._values)}{hint}") from None


def listed(names: Iterable[str]) -> str:
    """Names in a row, for a sentence."""
    return ", ".join(names) or "none"


@dataclass(frozen=True)
class Names:
    """What the entries of x and p are called.

    Attributes
    ----------
    states, parameters : names, without the time.
    forcing_period : p -> duration of one turn of the forcing, or None where time does not enter.
    """

    states: tuple[str, ...]
    parameters: tuple[str, ...]
    forcing_period: Callable[[Named], Any] | None = None

    @property
    def entries(self) -> tuple[str, ...]:
        """Names of the entries of x."""
        return self.states if self.forcing_period is None else (*self.states, TURNS)

    def p(self, p: Any) -> Named:
        """Parameters by name, from the vector."""
        return Named("parameter", {name: p[i] for i, name in enumerate(self.parameters)})

    def turn(self, p: Any) -> Any:
        """Duration of one turn of the forcing."""
        assert self.forcing_period is not None
        return self.forcing_period(self.p(p))

    def x(self, x: Any, p: Any) -> Named:
        """States by name, from the vectors; and the time in a forced system.

        Parameters
        ----------
        x, p
            (n,) or (n, m), and (np,): numbers or symbols.

        Returns
        -------
        Named; an entry of (n, m) is (m,).
        """
        named = {name: x[i] for i, name in enumerate(self.states)}
        if self.forcing_period is not None:
            named[TIME] = x[len(self.states)] * self.turn(p)
        return Named("state", named)

    def numbers(self, x: Array, p: Array) -> dict[str, float]:
        """Numbers by name; with the time in a forced system.

        Parameters
        ----------
        x, p
            (n,) state and (np,) parameters.

        Returns
        -------
        Name: number.
        """
        found = dict(zip(self.states, map(float, x), strict=False))
        return found if self.forcing_period is None else found | {TIME: float(x[-1]) * float(self.turn(p))}

    def column(self, values: Mapping[str, Any], turns: Any) -> Any:
        """The vector of one value for every state.

        Parameters
        ----------
        values
            state: its entry.
        turns
            the entry of the time in a forced system; left out in any other.

        Returns
        -------
        (n,) of CasADi.
        """
        return ca.vertcat(*[values[name] for name in self.states], *([] if self.forcing_period is None else [turns]))


@dataclass(frozen=True)
class Flow:
    """(x, T, p) -> the state after T, by the closed form of a mode."""

    function: Callable[[Named, Any, Named], Mapping[str, Any]]
    names: Names

    def __call__(self, x: Any, T: Any, p: Any) -> Any:
        turns = None if self.names.forcing_period is None else x[len(self.names.states)] + T / self.names.turn(p)
        return self.names.column(self.function(self.names.x(x, p), T, self.names.p(p)), turns)


@dataclass(frozen=True)
class Field:
    """(x, p, sign) -> x' of a mode."""

    function: Callable[[Named, Named], Mapping[str, Any]]
    names: Names

    def __call__(self, x: Any, p: Any, sign: Any) -> Any:
        turns = None if self.names.forcing_period is None else 1 / self.names.turn(p)
        return self.names.column(self.function(self.names.x(x, p), self.names.p(p)), turns)


@dataclass(frozen=True)
class FieldOfFlow:
    """(x, p, sign) -> x' of a mode in closed form: the derivative of its flow at T = 0."""

    flow: Flow

    def __call__(self, x: Any, p: Any, sign: Any) -> Any:
        T = ca.SX.sym("T")
        return ca.substitute(ca.jacobian(self.flow(x, T, p), T), T, 0)


@dataclass(frozen=True)
class Reset:
    """(x, p) -> the state behind an event; what the user does not name stays."""

    function: Callable[[Named, Named], Mapping[str, Any]]
    names: Names

    def __call__(self, x: Any, p: Any) -> Any:
        jumps = self.function(self.names.x(x, p), self.names.p(p))
        stays = {name: x[i] for i, name in enumerate(self.names.states)}
        turns = None if self.names.forcing_period is None else x[len(self.names.states)]
        return self.names.column({**stays, **jumps}, turns)


@dataclass(frozen=True)
class Successor:
    """(x, p) -> name of the next mode, where it depends on the numbers; `what` is the event's name for a refusal."""

    function: Callable[[Named, Named], str]
    names: Names
    what: str
    modes: tuple[str, ...]

    def __call__(self, x: Array, p: Array) -> str:
        name = self.function(self.names.x(x, p), self.names.p(p))
        if name not in self.modes:
            raise InputError(f"{self.what}: leads to {name!r}, which is none of the modes {listed(self.modes)}")
        return name


@dataclass(frozen=True)
class Always:
    """(x, p) -> one name, whatever the numbers."""

    name: str

    def __call__(self, x: Array, p: Array) -> str:
        return self.name


@dataclass(frozen=True)
class Scalar:
    """(x, p) -> a scalar of the user's: an expression of symbols, or numbers (m,) at the states (n, m)."""

    function: Callable[[Named, Named], Any]
    names: Names

    def __call__(self, x: Any, p: Any) -> Any:
        if isinstance(x, np.ndarray):
            return _at_points(self, x, p)
        return self.function(self.names.x(x, p), self.names.p(p))


@dataclass(frozen=True)
class EventValue:
    """(x, T, p) -> h."""

    scalar: Scalar

    def __call__(self, x: Any, T: Any, p: Any) -> Any:
        return self.scalar(x, p)


@dataclass(frozen=True)
class Condition:
    """(x, p, sign) -> what must not fall below zero."""

    scalar: Scalar

    def __call__(self, x: Any, p: Any, sign: Any) -> Any:
        return self.scalar(x, p)


@kept(maxsize=256)
def _compiled(scalar: Scalar, points: int) -> Caller:
    """The scalar at so many points, through fixed buffers."""
    n, m = len(scalar.names.entries), len(scalar.names.parameters)
    x, p = ca.SX.sym("x", n), ca.SX.sym("p", m)
    function = ca.Function("scalar", [x, p], [ca.densify(ca.SX(scalar(x, p)))])
    mapped = function.map("scalars", "serial", points, [1], []) if points > 1 else function
    return caller(mapped, [(points, n), m], [points])


def _at_points(scalar: Scalar, x: Array, p: Array) -> Any:
    """Numbers (m,) at the states x (n, m), or one number at x (n,)."""
    points = x.reshape(x.shape[0], -1).T
    out = np.empty(len(points))
    width = next((c for c in CHUNKS if c >= len(points)), CHUNKS[-1])
    for first in range(0, len(points), width):
        chunk = points[first : first + width]
        buffers = _compiled(scalar, width).buffers
        buffers.inputs[0][: len(chunk)], buffers.inputs[1][:] = chunk, p
        buffers.trigger()
        out[first : first + width] = buffers.outputs[0][: len(chunk)]
    return float(out[0]) if x.ndim == 1 else out.reshape(x.shape[1:])
