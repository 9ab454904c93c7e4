"""A branch of cycles in one parameter, as it is handed out: orbits in order, special points, and why it ends."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Generic

import numpy as np

from ..export import Columns
from ..orbits.orbit import AnyOrbit
from ..results import Result
from .special_points import Missed, SpecialPoint
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
        """(m,) bool."""
        return np.array([orbit.stable for orbit in self.orbits])

    def __str__(self) -> str:
        met = [special.meaning for special in self.special] + [missed.meaning for missed in self.missed]
        more = [f"and {len(met) - MOST_SAID} more"] if len(met) > MOST_SAID else []
        return "\n".join([f"{len(self.orbits)} cycles along {self.vary}; {self.ended}", *met[:MOST_SAID], *more])

    def _columns(self) -> Columns:
        here = {id(special.orbit): special.kind for special in self.special}
        known = [orbit.multipliers.trusted for orbit in self.orbits]
        return {
            self.vary: self.values,
            "period": self.periods,
            "amplitude": [orbit.amplitude for orbit in self.orbits],
            "error_estimate": [orbit.error_estimate for orbit in self.orbits],
            "stable": [orbit.stable if trusted else None for orbit, trusted in zip(self.orbits, known, strict=True)],
            "status": [orbit.status for orbit in self.orbits],
            "special": [here.get(id(orbit), "") for orbit in self.orbits],
        }
