"""The simplest problem that the engine can be given: one cycle, whose phases are always in the same order.

Only what the engine must know of any problem (hybrid/problem.py), without a search of another sequence of phases.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np

from casahunt.hybrid.problem import Kind, Problem
from casahunt.hybrid.system import Cycle, Signature

Array = np.ndarray


@dataclass(frozen=True)
class FixedSequence(Problem):
    """One cycle at one p: the phases are always these.

    Attributes
    ----------
    posed : the cycle.
    values : the parameters, in the order of its names.
    followed : the principal parameter.
    scheme, largest_step : as in `Problem`.
    """

    system: ClassVar[None] = None  # type: ignore[misc]

    posed: Cycle
    values: tuple[float, ...]
    followed: str
    scheme: tuple[int, Kind] = (7, "radau")
    largest_step: float = 1.0

    def __post_init__(self) -> None:
        if len(self.values) != len(self.posed.parameters):
            raise ValueError(f"{len(self.posed.parameters)} parameters are needed, {len(self.values)} given")
        if self.followed not in self.posed.parameters:
            raise ValueError(f"{self.followed!r} is none of the parameters {', '.join(self.posed.parameters)}")

    @property
    def title(self) -> str:
        """The name of its cycle."""
        return self.posed.name

    @property
    def names(self) -> tuple[str, ...]:
        """Those of its cycle."""
        return self.posed.parameters

    @property
    def principal(self) -> str:
        """As given."""
        return self.followed

    def vector(self) -> Array:
        """(np,) the values."""
        return np.array(self.values, float)

    def with_value(self, name: str, value: float) -> FixedSequence:
        """The same cycle at another p.

        name, value: a parameter of the cycle, and its value.
        """
        at = self.names.index(name)
        return replace(self, values=(*self.values[:at], float(value), *self.values[at + 1 :]))

    def cycle(self, signature: Signature, repeats: int) -> Cycle:
        """Its cycle.

        signature, repeats: the sequence of phases, which must be its own, and how often it is run through.
        Raises ValueError: another sequence.
        """
        if (signature, repeats) != (self.posed.signature, self.posed.repeats):
            raise ValueError(f"{self.title} has no cycle with the phases {signature} ({repeats} times)")
        return self.posed
