"""The parts of a loop in one of its modes, wired: signals by name, whoever gives them.

    signal  s.name = h(x, s; p) of the part that gives it, evaluated when first asked for
    rate    s.affine_rate(name, by) = (a, b), of a signal along the motion, s.name' = a + b s.by, in another signal

Signals that no part need give have a value of their own (`UNGIVEN`): the controller's torque is that of the motor where
nothing filters or limits it, the error is what is seen of the angle and of what remains of a move, and what is
integrated is the error.

Where a law or a function of a part stands, so that a loop can be sent to another process.

    address    (module, name of the part there, way from it)     or     (maker, its arguments, way from it)

The way leads from attribute to attribute and from entry to entry: "modes", 1, "law".  Functions of parts may then be
lambdas, which cannot be sent; a part (part.py) must be a global of a module, or say how it is made.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, fields, is_dataclass
from functools import cached_property, lru_cache
from types import SimpleNamespace
from typing import Any

import casadi as ca

from ...compiled import Caller, caller, kept
from ...errors import InputError
from .part import Edge, Function, Law, Part, PartMode, part_at

UNGIVEN: dict[str, Function] = {
    "angle": lambda x, s, p: s.motor_angle,
    "rate": lambda x, s, p: s.motor_rate,
    "remaining": lambda x, s, p: 0.0,
    "remaining_rate": lambda x, s, p: 0.0,
    "followed": lambda x, s, p: s.angle + s.remaining,
    "followed_rate": lambda x, s, p: s.rate + s.remaining_rate,
    "seen": lambda x, s, p: s.followed,
    "seen_rate": lambda x, s, p: s.followed_rate,
    "error": lambda x, s, p: s.seen,
    "error_rate": lambda x, s, p: s.seen_rate,
    "derivative": lambda x, s, p: s.error_rate,
    "integrand": lambda x, s, p: s.error,
    "integrates": lambda x, s, p: 1.0,
    "leak_rate": lambda x, s, p: 0.0,
    "unwinding": lambda x, s, p: 0.0,
    "command": lambda x, s, p: s.demand,
    "torque": lambda x, s, p: s.command,
    "compensation": lambda x, s, p: 0.0,
    "external": lambda x, s, p: 0.0,
    "load_external": lambda x, s, p: 0.0,
    "load_friction": lambda x, s, p: 0.0,
    "load_moving": lambda x, s, p: 1.0,
}
"""What a signal is where no part gives it; angles are measured from the set point."""
SPOKEN = {"integrates": "times at which the integrator stands still", "leak_rate": "leak"}
"""What signals are called in a refusal, where their names are none of a controller."""

Active = tuple[tuple[Part, Law, float | None], ...]
"""Each part with the law of its mode, and the sign of that mode where the loop's mode does not carry it."""


class Numbers(SimpleNamespace):
    """The parameters of a loop by name, numbers or symbols."""

    def __getattr__(self, name: str) -> Any:
        raise InputError(f"no part of the loop has the parameter {name!r}")


class SignedParameters:
    """The parameters, with the sign of one part's mode."""

    __slots__ = ("_p", "sign")

    def __init__(self, p: Any, sign: float) -> None:
        self._p, self.sign = p, sign

    def __getattr__(self, name: str) -> Any:
        return getattr(self._p, name)


class Signals:
    """The signals at a state, by name; each is evaluated once."""

    def __init__(self, wiring: Wiring, x: Any, p: Any) -> None:
        self._wiring, self._x, self._p = wiring, x, p
        self._asked: list[str] = []

    def __getattr__(self, name: str) -> Any:
        if name.startswith("_"):
            raise AttributeError(name)
        function, sign = self._wiring.giver(name)
        if name in self._asked:
            raise InputError(f"the signals {', '.join(self._asked)} depend on each other without a state in between")
        self._asked.append(name)
        value = function(self._x, self, self._p if sign is None else SignedParameters(self._p, sign))
        self._asked.pop()
        self.__dict__[name] = value
        return value

    def affine_rate(self, name: str, by: str) -> tuple[Any, Any]:
        """(a, b): along the motion the signal `name` changes at the rate a + b s.by, as what is asked for s.by.

        The sum of the products of its derivatives by the states with their rates: of numbers and of symbols.
        """
        return self._wiring.affine_rate(name, by, self._x, self._p)


class _Numbers:
    """The signals at a state of numbers: those that are known, and others as they are asked for."""

    def __init__(self, known: dict[str, float], others: Signals) -> None:
        self.__dict__.update(known)
        self._others, self._missed = others, list[str]()

    def __getattr__(self, name: str) -> Any:
        self._missed.append(name)
        return getattr(self._others, name)

    def affine_rate(self, name: str, by: str) -> tuple[Any, Any]:
        """As of the signals."""
        return self._others.affine_rate(name, by)


class Wiring:
    """The parts of a loop with their laws, in one mode of each; equal where they are: see `wired`.

    others: signals that come from elsewhere, whatever the parts give.
    """

    def __init__(self, active: Active, others: Mapping[str, Function] | None = None) -> None:
        self.active = active
        self._key: Any = active if others is None else object()
        self._hash = hash(self._key)
        self._affine_rates: dict[tuple[str, str], ca.Function] = {}
        self._givers: dict[str, tuple[Function, float | None]] = {n: (f, None) for n, f in UNGIVEN.items()}
        self._read: dict[Function, tuple[str, ...]] = {}
        taken: dict[str, str] = {}
        for part, law, sign in active:
            for name, function in {**part.gives, **law.gives}.items():
                if name in taken:
                    what = SPOKEN.get(name, name)
                    raise InputError(f"{taken[name]} and {part.name} do not go together: both give the {what}")
                taken[name] = part.name
                self._givers[name] = function, sign
        self._givers.update({name: (function, None) for name, function in (others or {}).items()})

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Wiring) and self._key == other._key

    def __hash__(self) -> int:
        return self._hash

    def __reduce__(self) -> Any:
        return _wired_again, (packed(self.active, self.parts),)

    @property
    def parts(self) -> tuple[Part, ...]:
        """The parts."""
        return tuple(part for part, _, _ in self.active)

    def giver(self, name: str) -> tuple[Function, float | None]:
        """Who gives a signal, and the sign it sees."""
        if name not in self._givers:
            needed = "a loop needs a plant, a friction, a controller and its integrator"
            raise InputError(f"no part of the loop gives the signal {name!r}: {needed}")
        return self._givers[name]

    def value(self, function: Function, sign: float | None, x: Any, p: Any) -> Any:
        """A function of a part."""
        return function(x, Signals(self, x, p), p if sign is None else SignedParameters(p, sign))

    def chosen(self, function: Function, sign: float | None, x: Any, p: Any) -> Any:
        """A function of a part, of numbers, that may branch: what it reads is compiled once that is known."""
        names = self._read.get(function, ())
        known = _read(self, names, x, p) if names else {}
        s = _Numbers(known, Signals(self, x, p))
        value = function(x, s, p if sign is None else SignedParameters(p, sign))
        if s._missed:
            self._read[function] = (*names, *dict.fromkeys(s._missed))
        return value

    def field(self, x: Any, p: Any) -> dict[str, Any]:
        """The derivative of every state."""
        return self._rates(Signals(self, x, p), x, p)

    def read(self, x: Any, p: Any) -> set[str]:
        """The signals that the derivatives depend on, by way of others or not."""
        signals = Signals(self, x, p)
        self._rates(signals, x, p)
        return {name for name in vars(signals) if not name.startswith("_")}

    def affine_rate(self, name: str, by: str, x: Any, p: Any) -> tuple[Any, Any]:
        """As of the signals."""
        if (name, by) not in self._affine_rates:
            of_x, of_p = (SimpleNamespace(**{n: ca.SX.sym(n) for n in names}) for names in self._arguments)
            signals, u = Signals(self, of_x, of_p), ca.SX.sym(by)
            vars(signals)[by] = u
            states, rates = ca.vertcat(*vars(of_x).values()), self._rates(signals, of_x, of_p)
            rate = ca.jtimes(ca.SX(getattr(signals, name)), states, ca.vertcat(*[rates[n] for n in vars(of_x)]))
            arguments = [*vars(of_x).values(), *vars(of_p).values()]
            self._affine_rates[name, by] = ca.Function(
                "rate", arguments, [ca.substitute(rate, u, 0), ca.jacobian(rate, u)]
            )
        states, parameters = self._arguments
        values = [getattr(x, n) for n in states] + [getattr(p, n) for n in parameters]
        a, b = self._affine_rates[name, by](*values)
        return a, b

    @cached_property
    def _arguments(self) -> tuple[list[str], list[str]]:
        """Names of the states, and of the parameters; the sign among these where the mode of the loop carries it."""
        signed = any(
            sign is None and any(mode.law is law and mode.sign is not None for mode in part.modes)
            for part, law, sign in self.active
        )
        parameters = [name for part in self.parts for name in part.parameters]
        return [name for part in self.parts for name in part.states], [*parameters, *(["sign"] if signed else [])]

    def _rates(self, s: Signals, x: Any, p: Any) -> dict[str, Any]:
        rates = {}
        for part, law, sign in self.active:
            seen = p if sign is None else SignedParameters(p, sign)
            for state in part.states:
                rates[state] = law.rates[state](x, s, seen) if state in law.rates else 0.0
        return rates


def _read(wiring: Wiring, names: tuple[str, ...], x: Any, p: Any) -> dict[str, float]:
    """Signals at a state, by name."""
    compiled, states, parameters = _compiled(wiring, names)
    buffers = compiled.buffers
    buffers.inputs[0][:] = [getattr(x, name) for name in states]
    buffers.inputs[1][:] = [getattr(p, name) for name in parameters]
    buffers.trigger()
    return dict(zip(names, buffers.outputs[0].tolist(), strict=True))


@kept(maxsize=512)
def _compiled(wiring: Wiring, names: tuple[str, ...]) -> tuple[Caller, tuple[str, ...], tuple[str, ...]]:
    """Signals, and the states and parameters that they are compiled for."""
    states = tuple(state for part in wiring.parts for state in part.states)
    values = {name: ca.SX.sym(name) for part in wiring.parts for name in part.parameters} | {"sign": ca.SX.sym("sign")}
    x, p = SimpleNamespace(**{name: ca.SX.sym(name) for name in states}), Numbers(**values)
    s = Signals(wiring, x, p)
    signals = ca.densify(ca.vertcat(*[getattr(s, name) for name in names]))
    needed = tuple(name for name, value in values.items() if ca.depends_on(signals, value))
    given = ca.vertcat(*vars(x).values()), ca.vertcat(*[values[name] for name in needed], ca.SX(0, 1))
    function = ca.Function("signals", [*given], [signals])
    return caller(function, [len(states), len(needed)], [len(names)]), states, needed


@kept(maxsize=512)
def wired(active: Active) -> Wiring:
    """The wiring of these parts, which is made once."""
    return Wiring(active)


def _wired_again(active: Any) -> Wiring:
    return wired(unpacked(active))


Way = tuple[Any, ...]


@dataclass(frozen=True)
class Address:
    """Where something of a part stands: `root` is that of the part."""

    root: tuple[Any, Any]
    way: Way

    def found(self) -> Any:
        """What stands there."""
        place: Any = part_at(*self.root)
        for step in self.way:
            place = getattr(place, step) if isinstance(step, str) and is_dataclass(place) else place[step]
        return place


def packed(value: Any, parts: tuple[Part, ...]) -> Any:
    """What can be sent in the place of a value: of laws and functions of these parts their addresses."""
    places = _places(parts)

    def pack(value: Any) -> Any:
        if isinstance(value, tuple):
            return tuple(map(pack, value))
        return places.get(id(value), value)

    return pack(value)


@lru_cache(maxsize=64)
def _places(parts: tuple[Part, ...]) -> dict[int, Address]:
    """The addresses by identity; what is kept here keeps the parts, so that no other thing gets their identity."""
    return {
        id(thing): Address(root, way)
        for part, root in ((part, part.root) for part in parts)
        for thing, way in _inside(part) if isinstance(thing, Law) or callable(thing)
    }  # fmt: skip


def unpacked(value: Any) -> Any:
    """The value again."""
    if isinstance(value, tuple):
        return tuple(map(unpacked, value))
    return value.found() if isinstance(value, Address) else value


def _inside(thing: Any, way: Way = ()) -> Iterator[tuple[Any, Way]]:
    """All that a part is made of, each with the way to it."""
    yield thing, way
    if isinstance(thing, Part | PartMode | Law | Edge):
        for field in fields(thing):
            yield from _inside(getattr(thing, field.name), (*way, field.name))
    elif isinstance(thing, Mapping):
        for key, value in thing.items():
            yield from _inside(value, (*way, key))
    elif isinstance(thing, tuple):
        for k, value in enumerate(thing):
            yield from _inside(value, (*way, k))
