"""A branch on its way: what it has come to, and what stays the same while it is followed (following.py)."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic

from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit
from .branch import Branch
from .crossings import Crossings, Passed
from .curve import parameter_value
from .special_points import Missed, Monitor, SpecialPoint


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


def special_points_between(
    before: AnyOrbit, after: AnyOrbit, *, vary: str, monitors: Sequence[Monitor], options: Options,
    earlier: AnyOrbit | None = None, inside: bool = False,
) -> tuple[list[SpecialPoint[AnyOrbit]], list[Missed]]:  # fmt: skip
    """The special points between two successive orbits of a walk.

    Parameters
    ----------
    before, after, vary
        the orbits, in the order of the walk, and the name of its parameter.
    monitors, options
        the kinds that are looked for; tolerance and method of the orbits there.
    earlier, inside
        the orbit before the two, where there is one; whether the step is looked at inside, else by what is known at its
        ends.

    Returns
    -------
    Special points in the order of the walk, and those that are there and were not located.

    Examples
    --------
    >>> from casahunt import walk
    >>> from casahunt.continuation import monitors_of, special_points_between
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import Options, find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> after = list(walk(orbit, vary="a", low=0.0119, high=0.027))[-1]
    >>> found, missed = special_points_between(
    ...     orbit, after, vary="a", monitors=monitors_of(orbit), options=Options()
    ... )
    >>> [special.kind for special in found], missed
    (['flip'], [])
    """
    first, *others = [orbit for orbit in (earlier, before, after) if orbit is not None]
    found = Crossings(first, vary=vary, monitors=monitors, options=options, inside=inside).seen(*others)
    return list(found.special), list(found.missed)
