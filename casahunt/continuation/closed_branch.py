"""Where a branch closes: it meets its own image (reunion.py), or comes back to where it began, round an isola.

And what a whole branch shows: its parameter turns round at folds and grazings, and nowhere else.
"""

from __future__ import annotations

from typing import cast

import numpy as np

from ..orbits.orbit import AnyOrbit, Orbit, unknowns_of
from .bifurcations import BRANCH_POINT
from .branch import Branch, Run
from .crossings import Passed, special_points_between
from .curve import solved_at
from .reunion import met_at, reunion, short_of
from .special_points import FOLD, GRAZING, Missed
from .terminations import End, ranges

LEAST_ROUND = 6
"""Orbits that a closed branch has at least: round two folds."""
SURELY_MOVED = 10.0
"""A parameter that has moved by more than so many of its errors has moved."""
MET_AGAIN = 100.0
"""Tolerances to which a cycle that is met again is the same: ranges are read off samples."""


def came_round(run: Run[AnyOrbit], after: AnyOrbit) -> End | None:
    """The end of a branch that comes back to where it began.

    Returns end; None where it does not.
    """
    orbits = run.branch.orbits
    if len(orbits) < LEAST_ROUND:
        return None
    first, begun = run.value(orbits[0]), run.value(orbits[1])
    before, value = run.value(run.last), run.value(after)
    if not min(before, value) <= first <= max(before, value) or (value - before) * (begun - first) <= 0:
        return None
    problem = after.problem.with_value(run.branch.vary, first)
    there = cast("AnyOrbit | None", solved_at(problem, unknowns_of(after), run.options))
    if there is None or not _the_same(there, orbits[0], run.options.tol):
        return None
    run.add(there)
    run.add(passed=run.line.past(there))
    run.add(passed=run.line.rest())
    return End("closed", f"at {run.branch.vary} = {first:.8g} the branch comes back to where it began", first)


def _the_same(one: Orbit, other: Orbit, tol: float) -> bool:
    """Whether two cycles at one value of the parameter have the same ranges and the same period."""
    sizes = np.append(ranges(one), one.period), np.append(ranges(other), other.period)
    return bool(np.all(np.abs(sizes[0] - sizes[1]) <= MET_AGAIN * tol * np.abs(sizes[1])))


def met_itself(run: Run[AnyOrbit], after: AnyOrbit) -> End | None:
    """The end of a branch that meets its own image before the next orbit: what follows is what it has passed.

    run, after: the branch, which is told what was missed where that could not be located, and the next orbit.
    Returns end; None where it does not.
    """
    before, vary = run.last, run.branch.vary
    met = reunion(before, after, run.options.tol) if run.looked_for else None
    if met is None:
        return None
    point = met_at(before, after, met, vary, run.options)
    if isinstance(point, Missed):
        run.add(passed=Passed((), (point,)))
        return None
    run.add(passed=run.line.rest())
    kinds = (FOLD.kind, BRANCH_POINT.kind, met.reached.kind)
    others = tuple(monitor for monitor in run.looked_for if monitor.kind not in kinds)
    # Behind the point follow the images: what lies before it is seen between the last orbit and one next to it.
    near = short_of(before, after, met, vary, run.options) or after
    found, missed = special_points_between(before, near, vary=vary, monitors=others, options=run.options)
    special = (*(special for special in found if not met.off(special.orbit) <= 0), point)
    run.add(*([point.orbit] if met.same_period else []), passed=Passed(special, tuple(missed)))
    value = run.value(point.orbit)
    return End(
        "closed", f"at {vary} = {value:.8g} the cycle is its own image; what follows are the images of what was passed",
        value,
    )  # fmt: skip


def unseen_turns(branch: Branch[AnyOrbit]) -> tuple[Missed, ...]:
    """Whether the parameter of a branch has turned round more often than its special points say.

    branch: with all its orbits and special points, and what was missed.
    Returns what is missed besides: a fold, or nothing.
    """
    values = branch.values
    if values.size < 3:
        return ()
    errors = np.array([orbit.error_estimate * orbit.problem.unit(branch.vary) for orbit in branch.orbits])
    sure = np.abs(np.diff(values)) > SURELY_MOVED * (errors[1:] + errors[:-1])
    places = np.flatnonzero(sure)
    turned = places[1:][np.diff(np.sign(np.diff(values)[places])) != 0]
    kinds = [point.kind for point in branch.special] + [point.kind for point in branch.missed]
    said = sum(kind in (FOLD.kind, GRAZING.kind) for kind in kinds)
    if turned.size <= said:
        return ()
    about = " and ".join(f"{values[k]:.6g}" for k in turned[: turned.size - said])
    sentence = f"{branch.vary} turns round {turned.size} times, next to {about} too, and not all its folds were located"
    return (Missed(FOLD.kind, f"{sentence}; smaller steps may show them"),)
