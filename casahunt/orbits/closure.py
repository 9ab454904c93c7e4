"""How a cycle of a user's system closes, and where it is cut if it meets no event.

    x(start) = S x(end) - c,    S^repeats = 1

S is the identity or a symmetry, c the turns that angles and the time have made.  A cycle that meets no event of the
system is anchored by a plane x_i = level that it crosses (`Section`), or by the end of a turn of the forcing.

Symbols: n states.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..hybrid import system as engine
from ..hybrid.language import System
from ..hybrid.vector_form import TURNS, Always

Array = np.ndarray

MAY_BE_ROUNDING = 1e-12
"""A state that is so small beside the largest one all along a motion may be rounding of that."""


@dataclass(frozen=True)
class Plane:
    """(x, T, p) -> (x_i - level) / size."""

    i: int
    level: float
    size: float = 1.0

    def __call__(self, x: Any, T: Any, p: Any) -> Any:
        return (x[self.i] - self.level) / self.size


@dataclass(frozen=True)
class Section:
    """A plane that the motion crosses in `mode`, both ways: the ends of phases where the system has none.

    Attributes
    ----------
    mode : the mode.
    state : name of the state that is constant on it.
    level : its value there.
    size : of the state, for the plane as an event of order one.
    """

    mode: str
    state: str
    level: float
    size: float

    def exits(self, states: tuple[str, ...]) -> tuple[engine.Exit, ...]:
        """The ways through it, marks at which the mode goes on."""
        plane = Plane(states.index(self.state), self.level, self.size)
        return tuple(
            engine.Exit(
                engine.VectorEvent(f"{self.state} {word} {self.level:.6g}", plane), way, Always(self.mode), mark=True
            )
            for way, word in ((1, "rises through"), (-1, "falls through"))
        )


@dataclass(frozen=True)
class Closure:
    """x(start) = S x(end) - c.

    Attributes
    ----------
    matrix : the rows of S.
    shift : c.
    repeats : how often the phases make up the period.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.orbits import Closure
    >>> Closure.of(-np.eye(2), np.zeros(2), 2).matrix
    ((-1.0, -0.0), (-0.0, -1.0))
    """

    matrix: tuple[tuple[float, ...], ...]
    shift: tuple[float, ...]
    repeats: int

    @classmethod
    def of(cls, matrix: Array, shift: Array, repeats: int) -> Closure:
        """The closure of arrays.

        Parameters
        ----------
        matrix, shift, repeats
            S (n, n), c (n,), and how often the phases make up the period.

        Returns
        -------
        Closure.
        """
        return cls(tuple(tuple(map(float, row)) for row in matrix), tuple(map(float, shift)), repeats)


def with_sections(system: System, sections: tuple[Section, ...]) -> engine.VectorSystem:
    """The system for a march that stops at the sections too.

    Returns the system in the terms of the engine, with their exits.
    """
    form = system.vector_form
    exits = dict(form.exits)
    for section in sections:
        exits[section.mode] = (*exits[section.mode], *section.exits(form.states))
    return engine.VectorSystem(form.name, form.states, form.modes, exits)


def turns(system: System) -> Array:
    """(n,) by how much an entry of the state grows in a turn: 2 pi for an angle, 1 for the time; 0 for the others."""
    return np.array(
        [2 * np.pi if name in system.angles else 1.0 if name == TURNS else 0.0 for name in system.names.entries]
    )


def sizes_of(system: System, states: Array, least: Array) -> Array:
    """(n,) the largest magnitudes of states (m, n), no more than a turn; `least` (n,) of those that are rounding."""
    size, turn = np.abs(states).max(axis=0), turns(system)
    return np.where(turn > 0, np.minimum(size, turn), np.where(size > MAY_BE_ROUNDING * size.max(), size, least))


def turned(system: System, x: Array, later: Array, *, parts: int = 1) -> Array:
    """What angles and the time have grown on the way from one state to another.

    x, later: (n,) states; parts: the time is counted in turns divided by this.
    Returns (n,) whole turns of the angles, turns and parts of them of the time; 0 for the other states.
    """
    turn = turns(system)
    if not turn.any():
        return np.zeros(np.broadcast_shapes(x.shape, later.shape))
    unit = np.array([1.0 / parts if name == TURNS else t for name, t in zip(system.names.entries, turn, strict=True)])
    return np.where(turn > 0, unit * np.round((later - x) / np.where(turn > 0, unit, 1.0)), 0.0)
