"""A part of a loop: a small automaton that reads signals and gives signals.

    x' = f_m(x, s; p) in its mode m,   gives y = h_m(x, s; p),   leaves m where e(x, s; p) = 0

x are its own states, by name (those of other parts are to be had as signals alone), s the signals by name, p the
parameters of the loop.  A part knows of the others nothing but the names of signals.  Where it has modes, what they
give and how its states change stands in their laws; modes that differ in a sign alone share one law, which sees it as
p.sign.

A part is made once, in a module, and compared by identity; numbers are those of the loop (loop.py).
"""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from importlib import import_module
from pickle import PicklingError
from typing import Any

from ...checks import SMALLEST

ABOVE_ZERO = (SMALLEST, math.inf)
"""The range of a parameter that something is divided by."""
Function = Callable[[Any, Any, Any], Any]
"""(x, s, p) -> a scalar: states, signals and parameters by name."""


@dataclass(frozen=True, eq=False)
class Law:
    """How a part behaves in a mode.

    Attributes
    ----------
    rates : state: its derivative; states that are not named stand still.
    gives : signal: its value, beside what the part gives in every mode.
    holds : a scalar of order one, >= 0 where the mode is a motion; None for everywhere.
    feature : a part of the field, of order one, that changes so suddenly that a mesh may step over it.
    stiff : the field has fast decaying directions.
    smooth : the field has no kink.
    slack : how far `holds` may fall below zero without that it is another motion.
    sampled : state: its next value where a drive runs the part by a rule of its own; (x, s, p) with x as it was at the
        last sample, s as it is at this one; any other follows its rate by the backward rule (sampled/controller.py).

    Examples
    --------
    >>> from casahunt.servo.parts import Law
    >>> forgets = Law({"x3": lambda x, s, p: s.error - p.leak * x.x3})  # states of its own, signals, parameters
    >>> sorted(forgets.rates)
    ['x3']
    """

    rates: Mapping[str, Function] = field(default_factory=dict)
    gives: Mapping[str, Function] = field(default_factory=dict)
    holds: Function | None = None
    feature: Function | None = None
    stiff: bool = False
    smooth: bool = True
    slack: float = 0.0
    sampled: Mapping[str, Function] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class Edge:
    """A way out of a mode of a part: where a scalar crosses zero.

    Attributes
    ----------
    name : what the user reads, such as "stop".
    function : (x, s, p) -> a scalar of order one.
    direction : +1 where it rises, -1 where it falls, 0 for either.
    to : the part's next mode, or a function (x, s, p) of numbers that returns its name.
    reset : state: its value behind; what is not named stays.

    Examples
    --------
    >>> from casahunt.servo.parts import Edge
    >>> leaves = Edge("leaves", lambda x, s, p: s.error**2 / p.band**2 - 1, +1, to="outside")
    >>> leaves.direction, leaves.to
    (1, 'outside')
    """

    name: str
    function: Function
    direction: int
    to: str | Callable[[Any, Any, Any], str]
    reset: Mapping[str, Function] = field(default_factory=dict)


@dataclass(frozen=True, eq=False)
class PartMode:
    """A mode of a part: its name, its law, the number that the law sees as p.sign, its ways out.

    Attributes
    ----------
    name : "" for the only mode, or the one that goes without saying.
    unsplit : name of a mode of the part that this one is a part of, as in `hybrid.Mode`.
    where : (x, s, p) of numbers -> whether a motion that starts there may be in this mode; None for anywhere.
    again : (x, s, p) of numbers -> the name of the mode in which the part is behind an event of another part, at which
        states or their rates jump; None where it stays in this one.

    Examples
    --------
    >>> from casahunt.servo.parts import SWITCH
    >>> [mode.name for mode in SWITCH.modes], [edge.name for edge in SWITCH.modes[2].ends]
    (['slip+', 'slip-', 'stick'], ['breakaway+', 'breakaway-'])
    """

    name: str
    law: Law = Law()
    ends: tuple[Edge, ...] = ()
    sign: float | None = None
    unsplit: str | None = None
    where: Function | None = None
    again: Callable[[Any, Any, Any], str] | None = None


@dataclass(frozen=True, eq=False, repr=False)
class Part:
    """A part of a loop.

    Attributes
    ----------
    name : what it is called in sentences.
    states : names of its states.
    parameters : name: default value.
    ranges : (lowest, highest) value of parameters that may be other than zero or more.
    gives : signal: its value in every mode.
    modes : its modes.
    even : states that keep their sign in the mirror image of a motion: a clock, the envelope of something.
    angles : states that are angles from the set point: all of them jump where it does.
    stands : state: the signal that it is equal to where the servo has stood still, of a filter that forgets.
    upon : event of any part: the states that jump there; of another part's, x3 of the integrator alone.
    follows : event of any part: the mode in which this part is behind it.
    made_by : (function, its arguments) of a part that is no global of a module, so that it can be made elsewhere.
    sampled : the part that a drive runs in its place, which decides at its samples alone; None for itself.
    size : the parameter that measures the part, at whose value `absent` the loop is the one without it; "" for none.
    saturates : whether it acts on large signals alone: margins are those of the loop without it.

    Examples
    --------
    >>> from casahunt.servo.parts import Part
    >>> spring = Part("spring", parameters={"stiffness": 0.1}, gives={
    ...     "external": lambda x, s, p: -p.stiffness * s.motor_angle,
    ... })
    >>> spring
    <Part: spring>
    """

    name: str
    states: tuple[str, ...] = ()
    parameters: Mapping[str, float] = field(default_factory=dict)
    gives: Mapping[str, Function] = field(default_factory=dict)
    modes: tuple[PartMode, ...] = (PartMode(""),)
    ranges: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    even: tuple[str, ...] = ()
    angles: tuple[str, ...] = ()
    stands: Mapping[str, str] = field(default_factory=dict)
    upon: Mapping[str, Mapping[str, Function]] = field(default_factory=dict)
    follows: Mapping[str, str] = field(default_factory=dict)
    made_by: tuple[Callable[..., Part], tuple[Any, ...]] | None = None
    sampled: Part | None = None
    size: str = ""
    absent: float = 0.0
    saturates: bool = False

    def __repr__(self) -> str:
        return f"<Part: {self.name}>"

    @property
    def root(self) -> tuple[Any, Any]:
        """Where it stands: (module, name there), or (maker, arguments).

        Raises
        ------
        PicklingError : it is no global of a module, and does not say how it is made.
        """
        if self.made_by is not None:
            return self.made_by
        for module in list(sys.modules.values()):
            for name, value in list(vars(module).items()) if hasattr(module, "__dict__") else ():
                if value is self:
                    return module.__name__, name
        raise PicklingError(f"the part {self.name!r} cannot be sent: it must be a global of a module")

    def __reduce__(self) -> Any:
        return part_at, self.root


def part_at(first: Any, second: Any) -> Any:
    """The part that stands at a root."""
    return getattr(import_module(first), second) if isinstance(first, str) else first(*second)
