"""The product of parts, as a system like any user's.

    state   the states of all parts;      mode   one of each part, that go together, by their names where they have one
    event   of one part: it changes this part's mode, and resets its states and those that other parts reset upon it;
            behind it other parts may ask again where they go on, as one that slides along a limit

The parts exchange signals (wiring.py), and none knows another.  What is linear while the servo sticks, with an
integrator as its only motion, has a closed form, which is found from the parts.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ...compiled import kept
from ...errors import InputError
from ...hybrid import Event, Mode, System
from .functions import Compared, FieldOf, FlowOf, ResetOf, ScalarOf, nilpotent
from .part import Edge, Part, PartMode
from .wiring import Numbers, SignedParameters, Wiring, wired

Modes = tuple[PartMode, ...]
Symbols = tuple[SimpleNamespace, Numbers]
"""CasADi's symbols of states and parameters, by name."""


def mode_name(modes: Modes) -> str:
    """The mode of a loop, by those of its parts that have a name."""
    return ", ".join(mode.name for mode in modes if mode.name) or "moves"


@kept(maxsize=64)
def product_of(parts: tuple[Part, ...], values: tuple[tuple[str, float], ...], name: str) -> System:
    """The product of parts at these numbers: other ones do not make another system, whose functions are looked at."""
    return _product_of(parts, name).with_numbers(dict(values))


@kept(maxsize=64)
def _product_of(parts: tuple[Part, ...], name: str) -> System:
    """The product of parts at the numbers that they come with; an infinite one is of a part that is absent."""
    given = {parameter: value for part in parts for parameter, value in part.parameters.items()}
    values = {parameter: value if math.isfinite(value) else 1.0 for parameter, value in given.items()}
    modes = modes_of(parts, tuple(values))
    even = {state for part in parts for state in part.even}
    states = tuple(state for part in parts for state in part.states)
    mirror = np.diag([1.0 if state in even else -1.0 for state in states])
    return System(name, states, values, modes, symmetries=(mirror,) if even else ())


@kept(maxsize=64)
def modes_of(parts: tuple[Part, ...], parameters: tuple[str, ...]) -> tuple[Mode, ...]:
    """The modes of a product."""
    states = tuple(state for part in parts for state in part.states)
    for kind, names in (("state", states), ("parameter", parameters)):
        if len(set(names)) < len(names):
            twice = next(n for n in names if names.count(n) > 1)
            owners = [p.name for p in parts if twice in (p.states if kind == "state" else p.parameters)]
            raise InputError(f"{' and '.join(owners)} do not go together: both have the {kind} {twice}")
    _check_events(parts)
    signed = next((i for i, part in enumerate(parts) if any(m.sign is not None for m in part.modes)), None)
    x = SimpleNamespace(**{name: ca.SX.sym(name) for name in states})
    p = Numbers(**{name: ca.SX.sym(name) for name in parameters})
    _check_read(parts, (x, p))
    return tuple(
        _mode(parts, modes, signed, (x, p))
        for modes in itertools.product(*[part.modes for part in parts]) if _holds_somewhere(parts, modes, (x, p))
    )  # fmt: skip


def _holds_somewhere(parts: tuple[Part, ...], modes: Modes, symbols: Symbols) -> bool:
    """Whether these modes go together: not where one of them holds at no state, as one that slides along a limit that
    nothing leads back to."""
    wiring = wiring_of(parts, modes, None)
    holds = (ca.SX(wiring.value(m.law.holds, m.sign, *symbols)) for m in modes if m.law.holds is not None)
    return all(not value.is_constant() or float(value) > 0 for value in holds)


def _check_events(parts: tuple[Part, ...]) -> None:
    """Refuse a part that waits for an event that no part has."""
    events = {edge.name for part in parts for mode in part.modes for edge in mode.ends}
    for part in parts:
        for name in (*part.upon, *part.follows):
            if name not in events:
                raise InputError(f"{part.name} does not go with these parts: none has the event {name!r} it waits for")


def _check_read(parts: tuple[Part, ...], symbols: Symbols) -> None:
    """Refuse a part that does nothing here: no motion depends on what it gives."""
    wirings = (wiring_of(parts, modes, None) for modes in itertools.product(*[part.modes for part in parts]))
    read = set[str]().union(*(wiring.read(*symbols) for wiring in wirings))
    for part in parts:
        gives = {*part.gives, *(name for mode in part.modes for name in mode.law.gives)}
        if gives and not gives & read:
            said = ", ".join(sorted(gives))
            raise InputError(f"{part.name} does nothing with these parts: none reads what it gives ({said})")


def wiring_of(parts: tuple[Part, ...], modes: Modes, signed: int | None) -> Wiring:
    """The wiring of parts in these modes; signed: the part whose sign the mode of the loop carries."""
    return wired(tuple(
        (part, mode.law, None if i == signed else mode.sign)
        for i, (part, mode) in enumerate(zip(parts, modes, strict=True))
    ))  # fmt: skip


def _mode(parts: tuple[Part, ...], modes: Modes, signed: int | None, symbols: Symbols) -> Mode:
    """One mode of the product."""
    shared = None if signed is None else modes[signed].sign
    wiring = wiring_of(parts, modes, signed)
    laws = [(mode.law, None if i == signed else mode.sign) for i, mode in enumerate(modes)]
    holds = [ScalarOf(wiring, law.holds, sign) for law, sign in laws if law.holds is not None]
    features = [ScalarOf(wiring, law.feature, sign) for law, sign in laws if law.feature is not None]
    whole = [mode.unsplit or mode.name for mode in modes]
    ends = [
        (i, edge)
        for i, mode in enumerate(modes)
        for edge in mode.ends
        if _can_be_met(wiring, edge, laws[i][1], symbols, shared)
    ]
    called = [edge.name for _, edge in ends]
    return Mode(
        mode_name(modes), FieldOf(wiring), _flow(wiring, symbols, shared),
        holds=holds[0] if len(holds) == 1 else _Least(*holds) if holds else None,
        feature=features[0] if len(features) == 1 else _Sum(*features) if features else None,
        ends=tuple(
            _event(parts, modes, i, edge, signed, f"{edge.name} ({parts[i].name})" if called.count(edge.name) > 1
                   else edge.name)
            for i, edge in ends
        ),
        slack=max(law.slack for law, _ in laws), smooth=all(law.smooth for law, _ in laws),
        stiff=any(law.stiff for law, _ in laws), sign=shared,
        unsplit=", ".join(n for n in whole if n) if any(mode.unsplit for mode in modes) else None,
    )  # fmt: skip


def _can_be_met(wiring: Wiring, edge: Edge, sign: float | None, symbols: Symbols, shared: float | None) -> bool:
    """Whether the scalar of an edge changes with any state: a torque at its limit breaks nothing away."""
    x, p = symbols
    value = ca.SX(wiring.value(edge.function, sign, x, p if shared is None else SignedParameters(p, shared)))
    return not ca.jacobian(value, ca.vertcat(*vars(x).values())).is_zero()


def _event(parts: tuple[Part, ...], modes: Modes, i: int, edge: Edge, signed: int | None, name: str) -> Event:
    wiring, sign = wiring_of(parts, modes, signed), None if i == signed else modes[i].sign
    jumps = tuple(edge.reset.items()) + tuple(jump for part in parts for jump in part.upon.get(edge.name, {}).items())
    behind = [_behind(part, mode, edge.name) for part, mode in zip(parts, modes, strict=True)]
    others = [(j, None) for j in range(len(parts)) if j != i]
    # a reset may lead a part to a mode in which this one goes on otherwise, and where it goes on may lead that part on
    to = _goes_on(parts, _with(behind, i, modes[i]), [*(others if jumps else []), (i, edge.to), *others])
    return Event(name, ScalarOf(wiring, edge.function, sign), edge.direction, to,
                 ResetOf(wiring, jumps, sign) if jumps else None)  # fmt: skip


def _behind(part: Part, mode: PartMode, event: str) -> PartMode:
    """The mode of a part behind an event of another one."""
    to = part.follows.get(event)
    return mode if to is None else _named(part, to)


def _named(part: Part, name: str) -> PartMode:
    """The mode of a part with this name."""
    return next(mode for mode in part.modes if mode.name == name)


def _with(modes: Sequence[PartMode], i: int, mode: PartMode) -> Modes:
    """Modes with another one of the part i."""
    return (*modes[:i], mode, *modes[i + 1 :])


def _goes_on(parts: tuple[Part, ...], modes: Modes, asks: Sequence[tuple[int, Any]]) -> str | _To:
    """The mode of the loop that goes on with these modes of parts, of which some choose another one, in a row.

    asks: which part, and the name of its mode, or what chooses it; None for what its mode asks `again`, if anything.
    """
    if not asks:
        return mode_name(modes)
    (j, choice), *others = asks
    if choice is None and (choice := modes[j].again) is None:
        return _goes_on(parts, modes, others)
    if isinstance(choice, str):
        return _goes_on(parts, _with(modes, j, _named(parts[j], choice)), others)
    following = tuple((mode.name, _goes_on(parts, _with(modes, j, mode), others)) for mode in parts[j].modes)
    return _To(wiring_of(parts, modes, None), choice, modes[j].sign, following)


class _To(Compared):
    """(x, p) of numbers -> the next mode of the loop: that in which one part is in the mode that it chooses."""

    def __init__(
        self, wiring: Wiring, choice: Any, sign: float | None, following: tuple[tuple[str, str | _To], ...]
    ) -> None:
        self.key = wiring, choice, sign, following

    def __call__(self, x: Any, p: Any) -> str:
        wiring, choice, sign, following = self.key
        chosen: str | _To = dict(following)[wiring.chosen(choice, sign, x, p)]
        return chosen if isinstance(chosen, str) else chosen(x, p)


class _Least(Compared):
    """The least of several conditions."""

    def __init__(self, *several: ScalarOf) -> None:
        self.key = several

    def __reduce__(self) -> Any:
        return type(self), self.key

    def __call__(self, x: Any, p: Any) -> Any:
        first, *others = [each(x, p) for each in self.key]
        for other in others:
            first = ca.fmin(first, other)
        return first


class _Sum(Compared):
    """The sum of several features."""

    def __init__(self, *several: ScalarOf) -> None:
        self.key = several

    def __reduce__(self) -> Any:
        return type(self), self.key

    def __call__(self, x: Any, p: Any) -> Any:
        return sum(each(x, p) for each in self.key)


def _flow(wiring: Wiring, symbols: Symbols, shared: float | None) -> FlowOf | None:
    """The closed form of a mode that has one."""
    x, p = symbols
    rates = wiring.field(x, p if shared is None else SignedParameters(p, shared))
    states = tuple(vars(x))
    rate = ca.vertcat(*[rates[state] for state in states])
    return FlowOf(wiring, states) if nilpotent(rate, ca.vertcat(*vars(x).values())) else None
