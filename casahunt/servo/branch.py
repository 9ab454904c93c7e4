"""A branch of hunting cycles as data: orbits in order, special points, and why it ends."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..continuation.special_points import Missed, SpecialPoint
from .hunting import Model
from .problem import HuntingOrbit
from .servo import Servo

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Branch:
    """Hunting cycles of one servo along a varied parameter.

    Attributes
    ----------
    model, servo : the problem; `servo` holds the values that are not varied.
    orbits : in the order of computation.
    special : located special points.
    ended : one sentence that says why the branch ends where it does.
    missed : special points that were not located.
    """

    model: Model
    servo: Servo
    orbits: tuple[HuntingOrbit, ...]
    ended: str
    special: tuple[SpecialPoint[HuntingOrbit], ...] = ()
    missed: tuple[Missed, ...] = ()

    @property
    def gains(self) -> Array:
        """(m,) controller gains K."""
        return np.array([orbit.gain for orbit in self.orbits])

    @property
    def amplitudes(self) -> Array:
        """(m,) amplitudes max |x1| [rad]."""
        return np.array([orbit.amplitude for orbit in self.orbits])

    @property
    def periods(self) -> Array:
        """(m,) periods [s]."""
        return np.array([orbit.period for orbit in self.orbits])

    @property
    def half_multipliers(self) -> Array:
        """(m,) leading half multipliers mu; computed now where nobody has read them before."""
        return np.array([orbit.half_multiplier for orbit in self.orbits])

    @property
    def stable(self) -> Array:
        """(m,) bool."""
        return np.array([orbit.stable for orbit in self.orbits])
