"""A branch on its way: what it has come to, and what stays the same while it is followed (following.py)."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Generic

from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit
from .branch import Branch
from .crossings import Crossings, Passed
from .curve import parameter_value
from .special_points import Monitor


@dataclass
class Run(Generic[AnyOrbit]):
    """A branch on its way: what it has come to, and what stays the same."""

    branch: Branch[AnyOrbit]
    line: Crossings[AnyOrbit]
    looked_for: tuple[Monitor, ...]
    options: Options
    max_points: int
    progress: Callable[[AnyOrbit], None] | None
    how: dict[str, Any]

    @property
    def last(self) -> AnyOrbit:
        """The last orbit."""
        return self.branch.orbits[-1]

    def value(self, orbit: AnyOrbit) -> float:
        """The parameter there."""
        return parameter_value(orbit, self.branch.vary)

    def within(self, orbit: AnyOrbit) -> bool:
        """Whether its parameter is within the range."""
        return bool(self.how["low"] <= self.value(orbit) <= self.how["high"])

    def add(self, *orbits: AnyOrbit, passed: Passed[AnyOrbit] | None = None) -> None:
        """Give the branch orbits further on, and what was passed on the way.

        *orbits, passed: in order; default nothing.
        """
        b, p = self.branch, passed or Passed()
        self.branch = replace(
            b, orbits=(*b.orbits, *orbits), special=(*b.special, *p.special), missed=(*b.missed, *p.missed)
        )
        for orbit in orbits:
            if self.progress is not None:
                self.progress(orbit)

    def replaced(self, orbit: AnyOrbit) -> None:
        """The last orbit is another picture of itself, in other coordinates."""
        self.add(passed=self.line.rest())
        self.branch = replace(self.branch, orbits=(*self.branch.orbits[:-1], orbit))
        self.line.go_on_from(orbit, same=True)
