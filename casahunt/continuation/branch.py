"""A branch of cycles in one parameter: orbits in order, special points, and why it ends; on its way and handed out.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any, Generic

import numpy as np

from ..export import Columns
from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit
from ..results import Result
from .crossings import Crossings, Passed
from .curve import parameter_value
from .special_points import Missed, Monitor, SpecialPoint
from .terminations import End

Array = np.ndarray

MOST_SAID = 8
"""Special points that the text of a branch names."""


@dataclass(frozen=True, eq=False, repr=False)
class Branch(Result, Generic[AnyOrbit]):
    """Cycles along a parameter.

    Attributes
    ----------
    vary : name of the parameter.
    orbits : in the order of computation, the one that it starts at first.
    special : the special points that were located, in the same order.
    missed : those that the branch has, but that were not located.
    end : why the branch ends where it does.

    Examples
    --------
    >>> from casahunt.continuation import follow
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> branch = follow(orbit, "a", to=0.013)
    >>> f"{branch.values[-1]:.4f}", branch.ended
    ('0.0130', 'a reached 0.013, the end of the range')
    """

    _quantities = ("vary", "number_of_points = orbits.size", "ended")
    _details = ("special", "missed", "end")

    vary: str
    orbits: tuple[AnyOrbit, ...]
    special: tuple[SpecialPoint[AnyOrbit], ...]
    missed: tuple[Missed, ...]
    end: End

    @property
    def ended(self) -> str:
        """One sentence that says why the branch ends where it does."""
        return self.end.sentence

    @property
    def values(self) -> Array:
        """(m,) values of the parameter."""
        return np.array([orbit.problem.value(self.vary) for orbit in self.orbits])

    @property
    def periods(self) -> Array:
        """(m,) periods."""
        return np.array([orbit.period for orbit in self.orbits])

    @property
    def amplitudes(self) -> Array:
        """(m,) amplitudes: of the first state that is no angle, or of what the cycles measure."""
        return np.array([orbit.amplitude for orbit in self.orbits])

    @property
    def stable(self) -> Array:
        """(m,) bool: which are known to be."""
        return np.array([orbit.stable is True for orbit in self.orbits])

    def __str__(self) -> str:
        met = [special.meaning for special in self.special] + [missed.meaning for missed in self.missed]
        more = [f"and {len(met) - MOST_SAID} more"] if len(met) > MOST_SAID else []
        return "\n".join([f"{len(self.orbits)} cycles along {self.vary}; {self.ended}", *met[:MOST_SAID], *more])

    def _columns(self) -> Columns:
        here = {id(special.orbit): special.kind for special in self.special}
        return {
            self.vary: self.values,
            "period": self.periods,
            "amplitude": [orbit.amplitude for orbit in self.orbits],
            "error_estimate": [orbit.error_estimate for orbit in self.orbits],
            "stable": [orbit.stable for orbit in self.orbits],
            "status": [orbit.status for orbit in self.orbits],
            "special": [here.get(id(orbit), "") for orbit in self.orbits],
        }


@dataclass
class Run(Generic[AnyOrbit]):
    """A branch on its way: what it has come to, and what stays the same."""

    branch: Branch[AnyOrbit]
    line: Crossings[AnyOrbit]
    looked_for: tuple[Monitor, ...]
    until: Callable[[SpecialPoint[AnyOrbit]], bool] | None
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

    def told_to_end(self) -> End | None:
        """The end at a special point that was to be the last one."""
        last = next((each for each in self.branch.special if self.until is not None and self.until(each)), None)
        return None if last is None else End(last.kind, last.meaning, last.value, last.error)

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
