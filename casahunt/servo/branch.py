"""A branch of hunting cycles as data: orbits in order, special points, and why it ends."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..continuation import FOLD, Missed, SpecialPoint
from ..export import Columns, columns_from
from ..results import Result
from .friction import Model
from .problem import HuntingOrbit
from .servo import Servo

Array = np.ndarray

CSV_COLUMNS = (
    "gain",
    "amplitude_rad",
    "period_s",
    "half_multiplier",
    "log10_abs_half_multiplier",
    "stable",
    "trivial_multiplier_error",
    "error_estimate",
    "status",
    "unknowns",
    "iterations",
    "special",
    "lopsided",
)
"""Columns of the table of a branch."""


@dataclass(frozen=True, eq=False, repr=False)
class Branch(Result):
    """Hunting cycles of one servo along a varied parameter.

    Attributes
    ----------
    model, servo : the problem; `servo` holds the values that are not varied.
    orbits : in the order of computation.
    special : located special points.
    ended : one sentence that says why the branch ends where it does.
    missed : special points that were not located, and pairs that were not followed.
    lopsided : branches of lopsided cycles, one of each pair that branches off (`with_lopsided`); the other one is its
        mirror image.

    Examples
    --------
    >>> from casahunt import Servo, diagram
    >>> branch = diagram(Servo(), "switch", start=0.6)
    >>> [special.kind for special in branch.special]
    ['superstable', 'fold']
    >>> f"{branch.gains.max():.2f}"  # V/rad
    '0.65'
    """

    _quantities = ("model", "points = orbits.size", "ended")
    _details = ("servo", "gain_range [V/rad]", "missed", "lopsided")

    model: Model
    servo: Servo
    orbits: tuple[HuntingOrbit, ...]
    ended: str
    special: tuple[SpecialPoint[HuntingOrbit], ...] = ()
    missed: tuple[Missed, ...] = ()
    lopsided: tuple[Branch, ...] = ()

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
        """(m,) bool: which are known to be."""
        return np.array([orbit.stable is True for orbit in self.orbits])

    @property
    def gain_range(self) -> tuple[float, ...]:
        """The smallest and the largest gain; empty without orbits."""
        return (float(self.gains.min()), float(self.gains.max())) if self.orbits else ()

    def _columns(self) -> Columns:
        kinds = {id(special.orbit): special.kind for special in self.special}
        rows = [csv_row(orbit, kinds.get(id(orbit), "")) for orbit in self.orbits]
        rows += [row for number, pair in enumerate(self.lopsided, 1) for row in pair_rows(pair, number)]
        return columns_from(CSV_COLUMNS, rows)

    def _more(self) -> dict[str, Any]:
        special = [
            {**s.to_dict(table=False), "gain": s.orbit.gain, "amplitude": s.orbit.amplitude, "period": s.orbit.period}
            for s in self.special
        ]
        return {"special": special}


def pair_rows(pair: Branch, number: int) -> list[list[Any]]:
    """The rows of a branch of lopsided cycles, its special points behind the others; number: which pair, from 1."""
    special = [csv_row(found.orbit, found.kind, number) for found in pair.special]
    return [csv_row(orbit, "", number) for orbit in pair.orbits] + special


def csv_row(orbit: HuntingOrbit, special: str, lopsided: int = 0) -> list[Any]:
    """One row of the CSV file.

    special: kind of the special point; "" for none; lopsided: number of the pair, 0 for a symmetric cycle, as which a
    cycle that a pair meets is told too. Returns values in the order of `CSV_COLUMNS`.
    """
    multipliers = orbit.multipliers
    trusted, symmetric = multipliers.trusted, not lopsided or orbit.half
    return [
        orbit.gain,
        orbit.amplitude,
        orbit.period,
        orbit.half_multiplier if trusted and symmetric else math.nan,
        multipliers.log10_leading if trusted and symmetric and not multipliers.leading_floor else math.nan,
        orbit.stable if trusted and special != FOLD.kind else "",  # at a fold it is neither
        multipliers.trivial_error,
        orbit.error_estimate,
        orbit.status.name.lower(),
        orbit.unknowns,
        orbit.iterations,
        special,
        lopsided,
    ]
