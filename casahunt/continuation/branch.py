"""A branch of cycles of a user's system in one of its parameters, with what is met on the way.

    for every two orbits of a walk (walk.py)    the monitors that change sign between them (bifurcations.py), located

Where the phases of the cycle change, the walk goes on with those that the motion really has (orbits/family.py).  Where
none continues it, an event being met with no speed, the walk has ended at that grazing, to a step of 1e-10.  On the
other side of the parameter, or on the same one, there may be a cycle that keeps clear of the event: where the motion
settles on one next to the last, the branch goes on with it.
"""

from __future__ import annotations

from collections.abc import Generator
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Generic, cast

import numpy as np

from ..checks import known, number
from ..errors import InputError, NoOrbit, Status
from ..orbits.adapt import Options
from ..orbits.cycle_search import find_cycle
from ..orbits.family import Family
from ..orbits.orbit import AnyOrbit, Orbit
from .bifurcations import monitors_of
from .special_points import GRAZING, Missed, Monitor, SpecialPoint, crossings, special_point
from .walk import walk

Array = np.ndarray

BESIDE_GRAZING = 1e-3
"""How far beside a grazing, in lambda, the motion is looked at."""
NEARLY_THE_SAME = 0.05
"""Cycles on the two sides of a grazing differ by less than this part of their ranges and periods."""


MET_WITHOUT_SPEED = replace(
    GRAZING,
    meaning="grazing at {name} = {value:.8g}: an event is met with no speed, and no cycle with these phases follows",
)


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
    how: dict[str, Any] = {"low": min(to, back), "high": max(to, back), "largest_step": largest_step}
    begun = Branch(vary, (orbit,), (), (), "")
    return _followed(begun, float(np.sign(to - here)), previous, looked_for, options, max_points, how)


def _followed(
    branch: Branch[AnyOrbit],
    sense: float,
    previous: AnyOrbit | None,
    looked_for: tuple[Monitor, ...],
    options: Options,
    max_points: int,
    how: dict[str, Any],
) -> Branch[AnyOrbit]:
    """The branch from its last orbit on, past grazings; `how` goes to the walk."""
    vary = branch.vary
    while True:
        steps = walk(
            branch.orbits[-1], vary=vary, sense=sense, previous=previous, options=options,
            max_points=max_points - len(branch.orbits), **how,
        )  # fmt: skip
        branch, status = _walked(branch, steps, looked_for, options)
        last = branch.orbits[-1]
        if status is not Status.INADMISSIBLE or GRAZING not in looked_for:
            return branch
        branch = replace(branch, special=(*branch.special, special_point(MET_WITHOUT_SPEED, last, vary)))
        following = _clear_of_it(last, vary, options)
        if following is None or len(branch.orbits) + 1 >= max_points:
            return branch
        previous = None
        sense = float(np.sign(following.problem.value(vary) - last.problem.value(vary)))
        branch = replace(branch, orbits=(*branch.orbits, following))


def _walked(
    branch: Branch[AnyOrbit],
    steps: Generator[AnyOrbit, None, str],
    looked_for: tuple[Monitor, ...],
    options: Options,
) -> tuple[Branch[AnyOrbit], Status | None]:
    """The branch with the orbits of a walk, and the status with which that ended."""
    while True:
        try:
            after = next(steps)
        except StopIteration as end:
            return replace(branch, ended=str(end.value)), getattr(end.value, "status", None)
        except NoOrbit as error:
            return replace(branch, ended=str(error)), error.status
        before = branch.orbits[-1]
        found, missed = crossings(before, after, vary=branch.vary, monitors=looked_for, options=options)
        orbits, special = (*branch.orbits, after), (*branch.special, *found)
        branch = replace(branch, orbits=orbits, special=special, missed=(*branch.missed, *missed))


def _clear_of_it(last: AnyOrbit, vary: str, options: Options) -> AnyOrbit | None:
    """The cycle with other phases on which the motion settles next to a grazing one, a little to either side of it."""
    family = last.problem
    if not isinstance(family, Family):
        return None
    arc = max(last.arcs, key=lambda arc: arc.duration)  # from its middle, far from where the event grazes
    for side in (1.0, -1.0):
        value = family.moved(vary, side * BESIDE_GRAZING)
        start = family.system.names.numbers(arc.states[len(arc.states) // 2, 0], family.vector())
        parameters = dict(zip(family.names, family.values, strict=True)) | {vary: value}
        with suppress(NoOrbit):
            other = find_cycle(
                family.system, arc.mode, parameters=parameters, follow=family.followed, measure=family.measured,
                options=options, start=start,
            )  # fmt: skip
            if other.signature != last.signature and _alike(last, other):
                return cast(AnyOrbit, other)
    return None


def _alike(one: Orbit, other: Orbit) -> bool:
    """Whether the ranges of all states and the periods are nearly the same."""
    if abs(one.period - other.period) > NEARLY_THE_SAME * one.period:
        return False
    states = len(one.problem.system.states) if isinstance(one.problem, Family) else one.scale.size
    x, y = one.sample()[1][:states], other.sample()[1][:states]
    size = np.ptp(x, axis=1)
    off = np.maximum(np.abs(x.max(axis=1) - y.max(axis=1)), np.abs(x.min(axis=1) - y.min(axis=1)))
    return bool(np.all(off <= NEARLY_THE_SAME * size))
