"""A loop of parts: their product, as a system like any user's.

    state   the states of all parts;      mode   one mode of each part, named by those that have a name
    event   of one part: it changes this part's mode, and resets its states and those that other parts reset upon it

The parts exchange signals (wiring.py), and none knows another.  What is linear while the servo sticks, with an
integrator as its only motion, has a closed form, which is found from the parts.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np

from ...checks import choice_of, number
from ...compiled import kept
from ...errors import InputError
from ...hybrid import Event, Mode, System
from .part import Edge, Function, Part, PartMode
from .wiring import Compared, FieldOf, FlowOf, ResetOf, ScalarOf, Signals, SignedParameters, Wiring, nilpotent, wired

Array = np.ndarray
Modes = tuple[PartMode, ...]
Symbols = tuple[SimpleNamespace, SimpleNamespace]
"""CasADi's symbols of states and parameters, by name."""


@dataclass(frozen=True, eq=False)
class Loop:
    """Parts and their numbers.

    Attributes
    ----------
    parts : the parts, in the order of their states; one whose size is that of its absence is left out.
    values : parameters that differ from the parts' defaults.
    name : what it is called.

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

    def __post_init__(self) -> None:
        owners = {name: part for part in self.parts for name in part.parameters}
        for name, value in self.values.items():
            low, high = owners[choice_of("parameter", name, owners)].ranges.get(name, (0.0, math.inf))
            if not low <= number(name, value) <= high:
                allowed = f"at least {low:g}" if math.isinf(high) else f"between {low:g} and {high:g}"
                raise InputError(f"{name} = {value:g}: must be {allowed} ({owners[name].name})")

    @property
    def present(self) -> tuple[Part, ...]:
        """The parts that are there: of size zero, none is."""
        return tuple(part for part in self.parts if not part.size or self.value(part.size) != part.absent)

    @property
    def parameters(self) -> dict[str, float]:
        """Those of the parts that are there."""
        return {name: self.value(name) for part in self.present for name in part.parameters}

    def value(self, name: str) -> float:
        """One parameter."""
        defaults = {name: value for part in self.parts for name, value in part.parameters.items()}
        return float(self.values.get(name, defaults[choice_of("parameter", name, defaults)]))

    def replace(self, **values: float) -> Loop:
        """The loop with other numbers."""
        return Loop(self.parts, {**self.values, **values}, self.name)

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
        return Loop((*self.parts, *parts), {**self.values, **values}, self.name)

    @property
    def system(self) -> System:
        """The loop as a system."""
        return product_of(self.present, tuple(self.parameters.items()), self.name)

    @property
    def angles(self) -> tuple[str, ...]:
        """The states that are angles from the set point."""
        return tuple(state for part in self.present for state in part.angles)

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
        """Every state where the servo stands still beside its set point and nothing has been wound up.

        Parameters
        ----------
        angle
            how far beside it [rad].

        Returns
        -------
        State by name: angles are `angle`, all others zero.
        """
        return self.state(**dict.fromkeys(self.angles, angle))

    def mode_at(self, **start: float) -> str:
        """The mode of a motion that starts at a state: of each part the first that may be there."""
        state, chosen = self.state(**start), [part.modes[0] for part in self.present]
        for i, part in enumerate(self.present):
            for mode in part.modes:
                chosen[i] = mode
                if mode.where is None or self._asked(mode.where, tuple(chosen), i, state):
                    break
        return mode_name(tuple(chosen))

    def _asked(self, function: Function, modes: Modes, i: int, state: Mapping[str, float]) -> Any:
        wiring, sign = _wiring(self.present, modes, None), modes[i].sign
        return wiring.value(function, sign, SimpleNamespace(**state), SimpleNamespace(**self.parameters))

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
        wiring, states = _wiring(self.present, modes, None), self.system.states
        named = SimpleNamespace(**dict(zip(states, x, strict=True)))
        value = getattr(Signals(wiring, named, SimpleNamespace(**self.parameters)), name)
        return np.broadcast_to(np.asarray(value, float), x.shape[1:])


def mode_name(modes: Modes) -> str:
    """The mode of a loop, by those of its parts that have a name."""
    return ", ".join(mode.name for mode in modes if mode.name) or "moves"


@kept(maxsize=64)
def product_of(parts: tuple[Part, ...], values: tuple[tuple[str, float], ...], name: str) -> System:
    """The product of parts at these numbers."""
    modes = modes_of(parts, tuple(parameter for parameter, _ in values))
    even = {state for part in parts for state in part.even}
    states = tuple(state for part in parts for state in part.states)
    mirror = np.diag([1.0 if state in even else -1.0 for state in states])
    return System(name, states, dict(values), modes, symmetries=(mirror,) if even else ())


@kept(maxsize=64)
def modes_of(parts: tuple[Part, ...], parameters: tuple[str, ...]) -> tuple[Mode, ...]:
    """The modes of a product."""
    states = tuple(state for part in parts for state in part.states)
    for kind, names in (("state", states), ("parameter", parameters)):
        if len(set(names)) < len(names):
            twice = next(n for n in names if names.count(n) > 1)
            owners = [p.name for p in parts if twice in (p.states if kind == "state" else p.parameters)]
            raise InputError(f"{' and '.join(owners)} do not go together: both have the {kind} {twice}")
    signed = next((i for i, part in enumerate(parts) if any(m.sign is not None for m in part.modes)), None)
    x, p = (SimpleNamespace(**{name: ca.SX.sym(name) for name in group}) for group in (states, parameters))
    return tuple(
        _mode(parts, modes, signed, (x, p)) for modes in itertools.product(*[part.modes for part in parts])
    )  # fmt: skip


def _wiring(parts: tuple[Part, ...], modes: Modes, signed: int | None) -> Wiring:
    return wired(tuple(
        (part, mode.law, None if i == signed else mode.sign)
        for i, (part, mode) in enumerate(zip(parts, modes, strict=True))
    ))  # fmt: skip


def _mode(parts: tuple[Part, ...], modes: Modes, signed: int | None, symbols: Symbols) -> Mode:
    """One mode of the product."""
    shared = None if signed is None else modes[signed].sign
    wiring = _wiring(parts, modes, signed)
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
    wiring, sign = _wiring(parts, modes, signed), None if i == signed else modes[i].sign
    jumps = tuple(edge.reset.items()) + tuple(jump for part in parts for jump in part.upon.get(edge.name, {}).items())
    behind = [_behind(part, mode, edge.name) for part, mode in zip(parts, modes, strict=True)]
    following = {mode.name: mode_name((*behind[:i], mode, *behind[i + 1 :])) for mode in parts[i].modes}
    to = following[edge.to] if isinstance(edge.to, str) else _To(wiring, edge.to, sign, tuple(following.items()))
    return Event(name, ScalarOf(wiring, edge.function, sign), edge.direction, to,
                 ResetOf(wiring, jumps, sign) if jumps else None)  # fmt: skip


def _behind(part: Part, mode: PartMode, event: str) -> PartMode:
    """The mode of a part behind an event of another one."""
    to = part.follows.get(event)
    return mode if to is None else next(other for other in part.modes if other.name == to)


class _To(Compared):
    """(x, p) of numbers -> the next mode of the loop: that in which one part is in the mode that it chooses."""

    def __init__(self, wiring: Wiring, choice: Any, sign: float | None, following: tuple[tuple[str, str], ...]) -> None:
        self.key = wiring, choice, sign, following

    def __call__(self, x: Any, p: Any) -> str:
        wiring, choice, sign, following = self.key
        return dict(following)[wiring.value(choice, sign, x, p)]


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
