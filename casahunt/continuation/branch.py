"""A branch of cycles of a user's system in one of its parameters, with what is met on the way.

    for every two orbits of a walk (walk.py)    the monitors that change sign between them (bifurcations.py), located

Where the phases of the cycle change, as at a grazing, the walk goes on with those that the motion really has
(orbits/family.py); the place is located to the tolerance.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Generic

import numpy as np

from ..checks import known, number
from ..errors import InputError, NoOrbit
from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit
from .bifurcations import monitors_of
from .special_points import GRAZING, Missed, Monitor, SpecialPoint, crossings
from .walk import walk

Array = np.ndarray


@dataclass(frozen=True, eq=False)
class Branch(Generic[AnyOrbit]):
    """Cycles along a parameter.

    Attributes
    ----------
    vary : name of the parameter.
    orbits : in the order of computation, the one that it starts at first.
    special : the special points that were located, in the same order.
    missed : those that the branch has, but that were not located.
    ended : one sentence that says why the branch ends where it does.
    """

    vary: str
    orbits: tuple[AnyOrbit, ...]
    special: tuple[SpecialPoint[AnyOrbit], ...]
    missed: tuple[Missed, ...]
    ended: str

    @property
    def values(self) -> Array:
        """(m,) values of the parameter."""
        return np.array([orbit.problem.value(self.vary) for orbit in self.orbits])

    @property
    def periods(self) -> Array:
        """(m,) periods."""
        return np.array([orbit.period for orbit in self.orbits])

    @property
    def stable(self) -> Array:
        """(m,) bool."""
        return np.array([orbit.stable for orbit in self.orbits])

    def __str__(self) -> str:
        met = [special.meaning for special in self.special] + [missed.meaning for missed in self.missed]
        return "\n".join([f"{len(self.orbits)} cycles along {self.vary}; {self.ended}", *met])


def follow(
    orbit: AnyOrbit,
    vary: str,
    *,
    to: float,
    back: float | None = None,
    previous: AnyOrbit | None = None,
    options: Options | None = None,
    monitors: tuple[Monitor, ...] | None = None,
    largest_step: float | None = None,
    max_points: int = 500,
) -> Branch[AnyOrbit]:
    """Follow a cycle in a parameter, round folds.

    Parameters
    ----------
    orbit
        where the branch starts.
    vary
        name of the parameter.
    to
        value towards which it goes, and at which it ends.
    back
        value at which it ends on the other side, where a fold has turned it round; default the one it starts at.
    previous
        the orbit before, to go on in that direction.
    options
        tolerance and method; default the tolerance to which the orbit is known, or 1e-8.
    monitors
        what is looked for; default fold, flip or symmetry breaking, Neimark-Sacker and changes of the phases.
    largest_step, max_points
        arclength of a step; number of orbits after which it ends.

    Returns
    -------
    Branch.

    Raises
    ------
    InputError : unknown parameter, or `to` and `back` on the same side of the start.
    """
    known("parameter", vary, orbit.problem.names)
    here, to = orbit.problem.value(vary), number("to", to)
    back = here if back is None else number("back", back)
    if to == here or (to - here) * (back - here) > 0:
        raise InputError(f"{vary} is {here:.6g} at the start: it cannot go to {to:.6g} and come back to {back:.6g}")
    options = options or Options(tol=max(orbit.error_estimate, 1e-8))
    looked_for = (*monitors_of(orbit), GRAZING) if monitors is None else monitors
    steps = walk(
        orbit, vary=vary, low=min(to, back), high=max(to, back), sense=float(np.sign(to - here)), previous=previous,
        options=options, largest_step=largest_step, max_points=max_points,
    )  # fmt: skip
    branch = Branch(vary, (orbit,), (), (), "")
    while True:
        try:
            after = next(steps)
        except StopIteration as end:
            return replace(branch, ended=str(end.value))
        except NoOrbit as error:
            return replace(branch, ended=str(error))
        found, missed = crossings(branch.orbits[-1], after, vary=vary, monitors=looked_for, options=options)
        branch = Branch(
            vary, (*branch.orbits, after), (*branch.special, *found), (*branch.missed, *missed), branch.ended
        )
