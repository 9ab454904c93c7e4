"""A hybrid system as data, and its periodic orbits: modes, exits, phases with their end events, and a closure.

A system follows a mode until one of its exits; the exit names the next mode.  A cycle is the boundary value problem

    phase k = 1..P:   x' = f_k(x; p) for a free duration T_k,   h_k(x(end of k), T_k; p) = 0,
    x(start of k + 1) = R_k(x(end of k); p), or x itself where it does not jump,   x(start of 1) = S x(behind P) - c.

S = I closes a full period.  A cycle with the symmetry x(t + T/2) = S x(t), often S = -I, is closed after half
a period with half the unknowns; `repeats` = 2 says so.  The shift c is what an angle or a clock has gained.  Each phase
end is anchored by its event, so there are as many equations as unknowns and no other phase condition.

Nothing here computes: fields, flows and events are functions from CasADi symbols to CasADi
expressions, called once by whoever builds a transcription; conditions and features take numpy arrays.

Symbols: n states, P phases, p parameters.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, fields
from typing import Any

import numpy as np

Expression = Any
"""A CasADi SX expression; CasADi carries no useful static types."""

Field = Callable[[Expression, Expression, Expression], Expression]
"""(x, p, sign) -> x'; `sign` is the number of the mode that uses the field."""

Flow = Callable[[Expression, Expression, Expression], Expression]
"""(x, duration, p) -> state after `duration`: the closed form of a mode that has one."""

EventFunction = Callable[[Expression, Expression, Expression], Expression]
"""(x, duration, p) -> scalar that vanishes at the end of the phase; of order one away from it."""

Admissible = Callable[[Any, Any, float], Any]
"""(x, p, sign) -> scalar, >= 0 where the mode is a motion of the system; of order one; (n, m) arrays to (m,)."""


Feature = Callable[[Any, Any], Any]
"""(x, p) -> scalar of order one; (n, m) and (p,) arrays to (m,)."""

Reset = Callable[[Expression, Expression], Expression]
"""(x, p) -> state behind an event at which it jumps."""


class HashedOnce:
    """A frozen record whose hash is computed once: whatever is compiled for it is looked up by it again and again."""

    def __init_subclass__(cls) -> None:
        cls.__hash__ = HashedOnce.__hash__  # type: ignore[method-assign]  # a dataclass keeps one that is there

    def __hash__(self) -> int:
        known = self.__dict__.get("_hash")
        if known is None:
            known = hash(tuple(getattr(self, each.name) for each in fields(self) if each.compare))  # type: ignore[arg-type]
            object.__setattr__(self, "_hash", known)
        return int(known)

    def __getstate__(self) -> dict[str, Any]:
        """Without the hash, which another process computes anew: functions and strings have others there."""
        return {name: value for name, value in self.__dict__.items() if name != "_hash"}


@dataclass(frozen=True)
class VectorMode(HashedOnce):
    """One smooth piece of the dynamics.

    Attributes
    ----------
    name : what the user reads, such as "slip+".
    field : vector field f(x, p, sign).
    sign : the number handed to `field` and `admissible`; modes that share a field differ in it.
    flow : closed-form solution, or None where the phase must be collocated.
    admissible : condition that must be >= -slack all along the phase, or None.
    slack : violation that is still no other motion.
    smooth : the field has no kink along the phase.
    unsplit : name of the mode that this one is a part of: between its parts the field has a kink, and no more; "".
    stiff : the field has fast decaying directions, for which explicit integrators take tiny steps.
    feature : function (x, p) of the field that can hide between collocation points, of order one, or None;
        works on numpy arrays (n, m).  A mesh on which it jumps by more than a half from one point to the next is
        too coarse, however small its error estimate.
    """

    name: str
    field: Field
    sign: float = 0.0
    flow: Flow | None = None
    admissible: Admissible | None = None
    slack: float = 0.0
    smooth: bool = True
    stiff: bool = False
    feature: Feature | None = None
    unsplit: str = ""


@dataclass(frozen=True)
class VectorEvent(HashedOnce):
    """A phase boundary h(x, T; p) = 0, crossed transversally."""

    name: str
    function: EventFunction


@dataclass(frozen=True)
class Exit(HashedOnce):
    """A way out of a mode: where `event` crosses zero in `direction` (+1 rising, -1 falling).

    `successor` maps (x, p) at the crossing to the name of the next mode.  `mark` is True for an event that
    is a phase boundary although the mode goes on.  `reset` is the jump of the state there, or None.  `others` are the
    other modes, each with its events and their directions, where none but `successor` says whether the mode goes on.
    """

    event: VectorEvent
    direction: int
    successor: Callable[[np.ndarray, np.ndarray], str]
    mark: bool = False
    reset: Reset | None = None
    others: tuple[tuple[VectorMode, tuple[tuple[VectorEvent, int], ...]], ...] = ()


@dataclass(frozen=True)
class Phase(HashedOnce):
    """One mode, followed until its event.

    Attributes
    ----------
    mode, end : the mode, and the event at its end.
    reset : the jump of the state there, or None.
    direction : +1 where the event rises through zero at the end, -1 where it falls; 0 where nobody asks.
    exits : ways out of the mode, none of which may be passed inside the phase.
    follows : names of the modes to which the event at the end may lead, as `successor` says; () where nobody asks.
    """

    mode: VectorMode
    end: VectorEvent
    reset: Reset | None = None
    direction: int = 0
    exits: tuple[Exit, ...] = ()
    follows: tuple[str, ...] = ()

    def leads_to(self, x: np.ndarray, p: np.ndarray) -> str:
        """The mode to which the event at the end leads from a state x (n,) behind it; "" where that is not known."""
        return "" if self.way_out is None else self.way_out.successor(x, p)

    @property
    def way_out(self) -> Exit | None:
        """The exit at the end; None where none of `exits` is it."""
        return next((e for e in self.exits if e.event == self.end), None)


@dataclass(frozen=True)
class VectorSystem:
    """A hybrid automaton: what simulation needs beyond the modes of a cycle.

    Attributes
    ----------
    name : what it is called.
    states : names of the n states.
    modes, exits : by mode name.
    """

    name: str
    states: tuple[str, ...]
    modes: Mapping[str, VectorMode]
    exits: Mapping[str, tuple[Exit, ...]]

    def ways_out(self, mode: str, event: str) -> tuple[Exit, ...]:
        """The exits of a mode through one event: two, the same but for the direction, where it is crossed either way.

        Returns None, one or two.
        """
        return tuple(way_out for way_out in self.exits.get(mode, ()) if way_out.event.name == event)


Signature = tuple[tuple[str, str], ...]
"""((mode name, end event name), ...) of one cycle."""


@dataclass(frozen=True, eq=False)
class Cycle:
    """A periodic orbit as data.  Compared by value, so that compiled forms can be kept by it: functions by identity.

    Attributes
    ----------
    name : what it is, such as "block on a belt, full cycle".
    states, parameters : names, in the order of x and p.
    phases : the P phases in order.
    closure : (n, n) matrix S with x(start) = S x(end) - c; must be an involution-like symmetry, S^repeats = I.
    repeats : how often the computed piece makes up the period (2 for a half cycle).
    measured : what the amplitude is: the number of a state, whose largest magnitude at the phase ends it is then, or a
        function (x, p) -> scalar, whose largest magnitude it is over the whole cycle.
    shift : (n,) the shift c; () for none.
    """

    name: str
    states: tuple[str, ...]
    parameters: tuple[str, ...]
    phases: tuple[Phase, ...]
    closure: np.ndarray
    repeats: int
    measured: int | Feature = 0
    shift: tuple[float, ...] = ()
    _key: tuple[int, tuple[Any, ...]] = field(init=False, repr=False)

    def __post_init__(self) -> None:
        n = len(self.states)
        if isinstance(self.repeats, bool) or not isinstance(self.repeats, int) or self.repeats < 1:
            raise ValueError(f"repeats = {self.repeats!r}: must be 1, 2, ...")
        if not isinstance(self.closure, np.ndarray) or self.closure.shape != (n, n):
            raise ValueError(f"closure: expected an array of shape {(n, n)}, got one of {np.shape(self.closure)}")
        if not np.allclose(np.linalg.matrix_power(self.closure, self.repeats), np.eye(n)):
            raise ValueError(f"closure to the power {self.repeats} must be the identity; a jump is a phase's reset")
        if len(self.shift) not in (0, n):
            raise ValueError(f"shift: {n} numbers are needed, {len(self.shift)} given")
        if not self.phases:
            raise ValueError("a cycle needs at least one phase")
        if not callable(self.measured) and not 0 <= self.measured < n:
            raise ValueError(f"measured = {self.measured}: must be the number of one of {n} states")
        closure = self.closure.tobytes()
        key = (self.name, self.states, self.parameters, self.phases, closure, self.repeats, self.measured, self.shift)
        object.__setattr__(self, "_key", (hash(key), key))

    def __hash__(self) -> int:
        return self._key[0]

    def __eq__(self, other: object) -> bool:
        return self is other or isinstance(other, Cycle) and self._key == other._key

    def opened(self, x: np.ndarray) -> np.ndarray:
        """States (..., n) one computed piece later, S^-1 (x + c): where the motion is that closes at x."""
        shift = np.array(self.shift) if self.shift else np.zeros(len(self.states))
        return (x + shift) @ np.linalg.inv(self.closure).T

    @property
    def signature(self) -> Signature:
        """((mode name, event name), ...): what tells two phase sequences of one system apart."""
        return tuple((phase.mode.name, phase.end.name) for phase in self.phases)

    def at_a_kink(self, k: int) -> bool:
        """Whether phase k ends where the field has a kink and no more: what follows is a part of the same mode."""
        here, behind = self.phases[k].mode, self.phases[(k + 1) % len(self.phases)].mode
        whole = {mode.unsplit or mode.name for mode in (here, behind)}
        return len(whole) == 1 and bool(here.unsplit or behind.unsplit) and self.phases[k].reset is None

    @property
    def without_kinks(self) -> Signature:
        """The signature with all parts of a mode as that mode: what changes there changes the motion."""
        return tuple(
            (phase.mode.unsplit or phase.mode.name, phase.end.name)
            for k, phase in enumerate(self.phases) if not self.at_a_kink(k)
        )  # fmt: skip
