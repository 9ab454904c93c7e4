"""What the engine must know of whoever poses a problem: the contract between solver and system.

A problem is a family of cycles, x' = f_k(x; p), h_k(x, T; p) = 0, x(start) = S x(end) (system.py), at one p:

    names, vector         the parameters p, by name and as numbers;  with_value changes one
    cycle                 phase sequence -> the boundary value problem
    asked                 where a sequence has stopped being a motion: how others are found (orbits/sequences.py)
    scheme, largest_step  how it is best computed, where the user does not say
    principal             the parameter that is followed by default, and freed where at fixed p the equations are
                          singular: next to a fold
    title, orbit_type     what refusals call it; the class in which its orbits come back (and fold_type)
    system                what moves so, of which other motions can be asked; None where one cycle is all that is known
    sections, marks, forced
                          where its cycles are cut: of a cycle alone there is nothing to know

A starting point is (transcription, unknowns, setting) of whoever solves (orbits/restart.py); nothing here computes.

A problem is compared by value: two equal ones have the same cycles.
"""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from typing import Any, ClassVar, Literal, Self

import numpy as np

from .system import Cycle, Signature
from .vector_form import Names

Array = np.ndarray

Kind = Literal["gauss", "radau"]
"""Collocation at Gauss points, for smooth fields, or at Radau IIA points, for stiff ones (scheme.py)."""


class Problem(ABC):
    """A family of cycles at one parameter vector.  Frozen; see the module docstring."""

    orbit_type: ClassVar[type | None] = None
    """A subclass of `orbit.Orbit` without fields of its own, or None for `Orbit` itself."""
    fold_type: ClassVar[type | None] = None
    """The same for `continuation.fold.Fold`."""
    beyond_a_fold: ClassVar[str] = "beyond it there is neither"
    """What a user is told of the far side of a fold, where a stable and an unstable cycle meet and are gone."""
    system: Any
    """The system (language.py) whose cycles these are, or None."""
    sections: tuple[Any, ...] = ()
    """Planes at which phases may end besides the events of the system (orbits/closure.py)."""

    @property
    def marks(self) -> frozenset[str]:
        """Names of the events that are planes of `sections`."""
        return frozenset()

    @property
    def forced(self) -> bool:
        """Whether the time enters."""
        return False

    @property
    def scheme(self) -> tuple[int, Kind]:
        """Collocation degree and kind where the user names none."""
        return 7, "radau"

    @property
    def largest_step(self) -> float:
        """Of a walk, in arclength."""
        return 1.0

    @property
    @abstractmethod
    def title(self) -> str:
        """What it is, for the middle of a sentence: "the block on a belt"."""

    @property
    @abstractmethod
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in the order of p."""

    @property
    @abstractmethod
    def principal(self) -> str:
        """Name of the parameter that is followed by default, and freed next to a fold."""

    @abstractmethod
    def vector(self) -> Array:
        """(np,) the parameters p."""

    @abstractmethod
    def with_value(self, name: str, value: float) -> Self:
        """The problem with one parameter changed.

        Parameters
        ----------
        name, value
            one of `names`, and its value.

        Returns
        -------
        The problem there.

        Raises
        ------
        InputError : it cannot have that value.
        """

    def with_values(self, names: tuple[str, ...], values: Array) -> Self:
        """The problem with several parameters changed at once.

        Parameters
        ----------
        names, values
            k of `names`, and (k,) their values.

        Returns
        -------
        The problem there.

        Raises
        ------
        InputError : it cannot have them.
        """
        problem = self
        for name, value in zip(names, values, strict=True):
            problem = problem.with_value(name, float(value))
        return problem

    @abstractmethod
    def cycle(self, signature: Signature, repeats: int) -> Cycle:
        """The cycle with these phases.

        Parameters
        ----------
        signature, repeats
            the phases, (mode, event) each; how often they are passed, mirrored by the closure, in a period.

        Returns
        -------
        Cycle.

        Raises
        ------
        ValueError : the problem has no such cycle.
        """

    def labels(self) -> dict[str, Any]:
        """What a result says of whose cycles these are, by name; nothing but the problem's title where it is empty."""
        return {}

    def record(self) -> dict[str, Any]:
        """The problem as JSON can say it, from which whoever knows it can pose it again."""
        return {"problem": self.title, "parameters": dict(zip(self.names, self.vector().tolist(), strict=True))}

    def vocabulary(self, states: tuple[str, ...]) -> Names:
        """What the entries of x and p are called, where the cycle calls its states so."""
        return Names(states, self.names)

    def value(self, name: str) -> float:
        """One parameter."""
        return float(self.vector()[self.names.index(name)])

    def unit(self, name: str, value: float | None = None) -> float:
        """How far lambda = 1 moves a parameter along a branch: by its value.

        Parameters
        ----------
        name, value
            one of `names`; where it stands, default the problem's own value.

        Returns
        -------
        The unit of the parameter there.
        """
        return self.value(name) if value is None else value

    def moved(self, name: str, lam: float, more: float = 0.0) -> float:
        """Value of a parameter along a branch.

        Parameters
        ----------
        name, lam, more
            one of `names`; lambda, 0 at the problem's own value, in two parts.

        Returns
        -------
        The value.
        """
        return self.value(name) * (1 + lam + more)

    def distance(self, name: str, value: float, here: float | None = None) -> float:
        """The lambda that leads from here to a value of a parameter.

        Parameters
        ----------
        name, value, here
            one of `names`, the value, and where it stands: default the problem's own value.

        Returns
        -------
        lambda, so that `moved(name, lambda)` is the value.
        """
        return value / self.unit(name, here) - 1

    def range_of(self, name: str) -> tuple[float, float]:
        """(lowest, highest) value that a parameter may have: above zero, for what is moved relative to its value."""
        return 0.0, math.inf

    def over(self, span: float) -> Self:
        """The problem where a parameter goes up to this size, from which one that is zero has its unit."""
        return self

    def direction(self, name: str) -> Array:
        """(np,) direction dp in parameter space that moves one parameter; (0,) where there is none to move."""
        dp = np.zeros(len(self.names))
        if self.names:
            dp[self.names.index(name)] = 1.0
        return dp

    def asked(self) -> Any | None:
        """What orbits/sequences.py must know to find other phase sequences; None where there is but one."""
        return None
