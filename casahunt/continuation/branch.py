"""A branch of cycles of a user's system in one of its parameters, with what is met on the way.

    for every two orbits of a walk (walk.py)    the monitors that change sign between them (bifurcations.py), located

Where the phases of the cycle change, the walk goes on with those that the motion really has (orbits/family.py).  Where
none continues it, an event being met with no speed, the walk has ended at that grazing, to a step of 1e-10.  On the
other side of the parameter, or on the same one, there may be a cycle that keeps clear of the event: where the motion
settles on one next to the last, the branch goes on with it.
"""

from __future__ import annotations

from collections.abc import Generator
from dataclasses import dataclass, replace
from typing import Any, Generic, cast

import numpy as np

from ..checks import known, number, of_kind
from ..errors import InputError, NoOrbit, Status
from ..export import Columns
from ..orbits.adapt import Options
from ..orbits.family import Family
from ..orbits.orbit import AnyOrbit, Complaint, Orbit, unknowns_of
from ..orbits.restart import in_scheme
from ..orbits.starts import may_vanish
from ..results import Result
from .behind_grazing import behind_grazing, from_strongest
from .bifurcations import monitors_of
from .curve import parameter_value
from .recut import cut_alike, cut_by_planes, left_behind, recut
from .reunion import met_at, reunion
from .special_points import FOLD, GRAZING, Missed, Monitor, SpecialPoint, crossings, special_point
from .vanishing import solved_at, vanishing_soon
from .walk import walk
from .ways_to_end import SHRUNK_TO, hopf_point, ranges, runs_out

Array = np.ndarray

SHOWN = 8
"""Special points in the sentences of a branch; `special` and `missed` have them all."""
FIRST_SHRINKS = "the first phase may be about to vanish"
LEFT_BEHIND, NEXT_TO_NOTHING = "the plane that cuts the cycle is left behind", "the cycle has shrunk to nothing"


@dataclass(frozen=True, eq=False, repr=False)
class Branch(Result, Generic[AnyOrbit]):
    """Cycles along a parameter.

    Attributes
    ----------
    vary : name of the parameter.
    orbits : in the order of computation, the one that it starts at first.
    special : the special points that were located, in the same order.
    missed : those that the branch has, but that were not located.
    ended : one sentence that says why the branch ends where it does.

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
    _details = ("special", "missed")

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
    def amplitudes(self) -> Array:
        """(m,) amplitudes: of the first state that is no angle, or of what the cycles measure."""
        return np.array([orbit.amplitude for orbit in self.orbits])

    @property
    def stable(self) -> Array:
        """(m,) bool."""
        return np.array([orbit.stable for orbit in self.orbits])

    def __str__(self) -> str:
        met = [special.meaning for special in self.special] + [missed.meaning for missed in self.missed]
        more = [f"and {len(met) - SHOWN} more"] if len(met) > SHOWN else []
        return "\n".join([f"{len(self.orbits)} cycles along {self.vary}; {self.ended}", *met[:SHOWN], *more])

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
        tolerance and method; default the tolerance to which the orbit is known, or 1e-8.  A scheme that is asked for
        and is not that of the orbit is taken from the first cycle on.
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
    NoOrbit : the cycle could not be computed in the scheme that is asked for.

    Examples
    --------
    >>> from casahunt.continuation import follow
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> branch = follow(orbit, "a", to=0.05)
    >>> [special.kind for special in branch.special]
    ['flip']
    """
    of_kind("orbit", orbit, Orbit)
    known("parameter", vary, orbit.problem.names)
    here, to = orbit.problem.value(vary), number("to", to)
    back = here if back is None else number("back", back)
    if to == here or (to - here) * (back - here) > 0:
        raise InputError(f"{vary} is {here:.6g} at the start: it cannot go to {to:.6g} and come back to {back:.6g}")
    options = options or Options(tol=max(orbit.error_estimate, 1e-8))
    orbit, previous = _in_scheme(orbit, options), None if previous is None else _in_scheme(previous, options)
    looked_for = (*monitors_of(orbit), GRAZING) if monitors is None else monitors
    how: dict[str, Any] = {"low": min(to, back), "high": max(to, back), "largest_step": largest_step}
    if not cut_by_planes(orbit):
        orbit, previous = from_strongest(orbit, previous, options)
    begun = Branch(vary, (orbit,), (), (), "")
    return _followed(begun, float(np.sign(to - here)), previous, looked_for, options, max_points, how)


def _in_scheme(orbit: AnyOrbit, options: Options) -> AnyOrbit:
    """The cycle in the collocation scheme that is asked for; as it is where none is."""
    asked = options.degree or orbit.degree, options.kind or orbit.kind
    if asked == (orbit.degree, orbit.kind):
        return orbit
    found = solved_at(orbit.problem, in_scheme(unknowns_of(orbit), *asked), options)
    if found is None:
        sentence = f"the cycle of {orbit.problem.title} was not found with degree = {asked[0]}, kind = {asked[1]!r}"
        raise NoOrbit(f"{sentence}: leave them out, or ask for another tolerance", Status.NOT_CONVERGED)
    return cast(AnyOrbit, found)


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
    vary, insist, watched = branch.vary, False, True
    while True:
        steps = walk(
            branch.orbits[-1], vary=vary, sense=sense, previous=previous, options=options,
            max_points=max_points - len(branch.orbits), **how,
        )  # fmt: skip
        length = len(branch.orbits)
        branch, end = _walked(branch, steps, looked_for, options, watched)
        last = branch.orbits[-1]
        if isinstance(end, Complaint) and (ended := _run_out(branch)):
            return replace(branch, ended=ended)
        if branch.ended == FIRST_SHRINKS:
            branch, previous = _starting_elsewhere(branch, options)
            continue
        if cut_by_planes(last):
            hopf = _shrunk(branch) if isinstance(end, Complaint) or branch.ended == NEXT_TO_NOTHING else None
            if hopf is not None:
                return replace(branch, special=(*branch.special, hopf), ended=hopf.meaning)
            stuck = isinstance(end, Complaint) and end.status is Status.INADMISSIBLE
            insist = stuck and (len(branch.orbits) > length or not insist)
            if not insist and branch.ended not in (LEFT_BEHIND, NEXT_TO_NOTHING):
                return branch
            again = _cut_anew(branch, options, insist)
            if again is not None:
                (branch, previous, sense), watched = again, True
            elif insist:
                return branch
            else:  # there is no better plane
                previous, watched = branch.orbits[-2], False
            continue
        if end is None or GRAZING not in looked_for or len(branch.orbits) + 1 >= max_points:
            return branch
        if isinstance(end, Complaint):
            branch, following = _grazed(branch, end, options)
            if following is None:
                return branch
            last, end = branch.orbits[-1], following
        previous = None
        sense = float(np.sign(parameter_value(end, vary) - parameter_value(last, vary))) or _sense(branch, sense)
        branch = replace(branch, orbits=(*branch.orbits, end))


def _grazed(
    branch: Branch[AnyOrbit], failure: Complaint, options: Options
) -> tuple[Branch[AnyOrbit], AnyOrbit | None]:
    """The branch up to the grazing that it has come to, if it is one, and the cycle that it goes on with."""
    found = behind_grazing(branch.orbits[-1], branch.vary, failure, options)
    if found.grazing is not None:
        special, ended = (*branch.special, found.grazing), f"no cycle follows the {found.grazing.meaning}"
        branch = replace(branch, orbits=found.reached(branch.orbits), special=special, ended=ended)
    return branch, found.following


def _walked(
    branch: Branch[AnyOrbit],
    steps: Generator[AnyOrbit, None, str],
    looked_for: tuple[Monitor, ...],
    options: Options,
    watched: bool,
) -> tuple[Branch[AnyOrbit], AnyOrbit | Complaint | None]:
    """The branch with the orbits of a walk, and how that ended.

    By the orbit behind a grazing that it came to; by what it has failed by; None where it came to its end.  Early where
    a cycle that is cut by planes has become small or (`watched`) leaves its plane behind.
    """
    by_planes, branch = cut_by_planes(branch.orbits[-1]), replace(branch, ended="")
    largest = np.max([ranges(orbit) for orbit in branch.orbits if by_planes], axis=0, initial=0.0)
    while True:
        try:
            after = next(steps)
        except StopIteration as end:
            return replace(branch, ended=str(end.value)), end.value if isinstance(end.value, Complaint) else None
        except NoOrbit as error:
            return replace(branch, ended=str(error)), Complaint(str(error), error.status)
        before = branch.orbits[-1]
        by_planes = cut_by_planes(before) and cut_by_planes(after)
        if by_planes and before.signature != after.signature and _shrunk(branch) is not None:
            return replace(branch, ended=NEXT_TO_NOTHING), None  # stepped over: the same cycles, half a turn later
        branch = _met_itself(branch, after, looked_for, options)
        if branch.ended:
            return branch, None
        monitors = tuple(m for m in looked_for if m is not GRAZING) if by_planes else looked_for
        found, missed = crossings(before, after, vary=branch.vary, monitors=monitors, options=options)
        orbits, special = (*branch.orbits, after), (*branch.special, *found)
        branch = replace(branch, orbits=orbits, special=special, missed=(*branch.missed, *missed))
        if ended := runs_out(before, after, branch.vary):
            return replace(branch, ended=ended), None
        if by_planes:
            largest = np.maximum(largest, ranges(after))
            if watched and np.all(ranges(after) <= SHRUNK_TO * largest):
                return replace(branch, ended=NEXT_TO_NOTHING), None
            if watched and left_behind(after):
                return replace(branch, ended=LEFT_BEHIND), None
            continue
        if _first_shrinks(before, after):
            return replace(branch, ended=FIRST_SHRINKS), None
        over = vanishing_soon(before, after, branch.vary, options) if GRAZING in looked_for else None
        if over is not None:
            touch = special_point(GRAZING, over[0], branch.vary)
            return replace(branch, special=(*branch.special, touch), ended=""), over[1]


def _first_shrinks(before: Orbit, after: Orbit) -> bool:
    """Whether the first phase has become one that may vanish, so that a branch had better start with another one."""
    first = [may_vanish([arc.duration for arc in orbit.arcs]) == 0 for orbit in (before, after)]
    return isinstance(after.problem, Family) and before.signature == after.signature and first == [False, True]


def _starting_elsewhere(branch: Branch[AnyOrbit], options: Options) -> tuple[Branch[AnyOrbit], AnyOrbit | None]:
    """The branch with its last cycle from another phase on, where one serves, and the cycle before it alike."""
    *others, last = branch.orbits
    turned, before = from_strongest(last, others[-1], options)
    return replace(branch, orbits=(*others, turned)), before


def _run_out(branch: Branch[AnyOrbit]) -> str:
    """Why no step leads on, where that is because the cycles end; "" where it is not."""
    many = len(branch.orbits) > 1
    return runs_out(branch.orbits[-2], branch.orbits[-1], branch.vary, stuck=True) if many else ""


def _shrunk(branch: Branch[AnyOrbit]) -> SpecialPoint[AnyOrbit] | None:
    """The Hopf bifurcation that the last cycles lead to."""
    return hopf_point(branch.orbits[-2], branch.orbits[-1], branch.vary) if len(branch.orbits) > 1 else None


def _cut_anew(
    branch: Branch[AnyOrbit], options: Options, insist: bool
) -> tuple[Branch[AnyOrbit], AnyOrbit | None, float] | None:
    """(the branch with its last cycle cut by another plane, the cycle before it cut alike or None, sense), or None."""
    *others, last = branch.orbits
    fresh = recut(last, branch.vary, options, insist=insist) if cut_by_planes(last) else None
    if fresh is None:
        return None
    before = cut_alike(others[-1], fresh, branch.vary, options) if others and cut_by_planes(others[-1]) else None
    sense = float(np.sign(branch.values[-1] - branch.values[-2])) if others else 1.0
    return replace(branch, orbits=(*others, fresh)), before, sense or 1.0


def _sense(branch: Branch[AnyOrbit], sense: float) -> float:
    """Which way the parameter went last."""
    ways = np.sign(np.diff(branch.values))
    return float(ways[np.flatnonzero(ways)[-1]]) if ways.any() else sense


def _met_itself(
    branch: Branch[AnyOrbit], after: AnyOrbit, looked_for: tuple[Monitor, ...], options: Options
) -> Branch[AnyOrbit]:
    """The branch, ended where it meets its own image before the next orbit: what follows is what it has passed already.

    As it is where it does not; with what was missed where that could not be located.
    """
    before, vary = branch.orbits[-1], branch.vary
    met = reunion(before, after, options.tol) if looked_for else None
    if met is None:
        return branch
    point = met_at(before, after, met, vary, options)
    if isinstance(point, Missed):
        return replace(branch, missed=(*branch.missed, point))
    others = tuple(monitor for monitor in looked_for if monitor.kind not in (FOLD.kind, met.reached.kind))
    found, missed = crossings(before, after, vary=vary, monitors=others, options=options)
    found = [special for special in found if not met.off(special.orbit) <= 0]
    value = parameter_value(point.orbit, vary)
    return Branch(
        vary, (*branch.orbits, *([point.orbit] if met.same_period else [])),
        (*branch.special, *found, point), (*branch.missed, *missed),
        f"at {vary} = {value:.8g} the cycle is its own image; what follows are the images of what was passed",
    )  # fmt: skip
