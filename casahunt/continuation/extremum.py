"""The largest and the smallest value of a parameter along a branch.

The branch is followed to its fold, through changes of its phases; there the turning point is solved for on the mesh of
the orbit and on the mesh with halved intervals (fold_check.py).  Its adjoint gives the derivatives of the value by all
other parameters (fold.py).

The first cycle on the way of a parameter that grazes an event, from one that keeps clear of it.

h(x(t); p) = 0, dh/dt = 0        sought along the cycles of the loose family (grazing_contact.py), which pass the event
"""

from __future__ import annotations

import math
import time
from bisect import bisect_left
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Any

from ..checks import choice_of, number
from ..errors import InputError, NoOrbit, Status
from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit, Orbit
from .branching import as_whole_as_needed
from .curve import parameter_value
from .fold import Fold, at_rest, optimal_beside
from .fold_check import confirmed
from .following import follow
from .grazing_contact import contacts, events_of
from .poincare_section import cut_by_planes
from .special_points import FOLD, GRAZING, SpecialPoint, special_point
from .surface import finer
from .terminations import REST_KIND
from .vanishing import from_strongest, turns_where_it_vanishes

BEST_AT_REST = 1e-8
"""Tolerance to which cycles are known that have shrunk to next to nothing; to less, they are not followed so far."""


def largest(
    start: AnyOrbit | SpecialPoint[AnyOrbit],
    vary: str,
    *,
    to: float = math.inf,
    options: Options | None = None,
    max_points: int = 200,
    progress: Callable[[AnyOrbit], None] | None = None,
) -> Fold[AnyOrbit]:
    """The largest value of a parameter on the branch of a cycle: the first fold on the way up.

    Parameters
    ----------
    start
        a cycle of the branch, or a located fold of it.
    vary
        name of the parameter.
    to
        value beyond which no fold is sought.
    options
        `tol` bounds the relative errors; default the tolerance to which the orbit is known, or 1e-8.
    max_points
        number of orbits after which the search ends.
    progress
        called with every orbit on the way to the fold, and with the first one behind it.

    Returns
    -------
    Fold: value, error, and `sensitivities`, by how much the value moves with every other parameter.

    Raises
    ------
    InputError : unknown parameter, or a special point that is no fold.
    NoOrbit : the branch does not turn back before `to`, or the fold is not confirmed.

    Examples
    --------
    >>> from casahunt.continuation import largest
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> round(largest(orbit, "g").value, 4)  # the same fold, in another parameter
    13.751
    """
    return _extremum(start, vary, 1.0, to, options, max_points, progress)


def smallest(
    start: AnyOrbit | SpecialPoint[AnyOrbit],
    vary: str,
    *,
    to: float = -math.inf,
    options: Options | None = None,
    max_points: int = 200,
    progress: Callable[[AnyOrbit], None] | None = None,
) -> Fold[AnyOrbit]:
    """The smallest value of a parameter on the branch of a cycle: the first fold on the way down.

    Parameters
    ----------
    start, vary, to, options, max_points, progress
        as in `largest`.

    Returns
    -------
    Fold.

    Raises
    ------
    InputError, NoOrbit : as in `largest`.

    Examples
    --------
    >>> from casahunt.continuation import smallest
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> round(smallest(orbit, "a").value, 8)  # g (1 - r) pi/((1 + r) omega^2) is exact
    0.00856084
    """
    return _extremum(start, vary, -1.0, to, options, max_points, progress)


def _extremum(
    start: Any, vary: str, sense: float, to: float, options: Options | None, max_points: int,
    progress: Callable[[Any], None] | None,
) -> Any:  # fmt: skip
    """The fold at which the parameter is largest (sense = +1) or smallest (-1)."""
    began = time.perf_counter()
    special = start if isinstance(start, SpecialPoint) else None
    orbit = start.orbit if isinstance(start, SpecialPoint) else start
    choice_of("parameter", vary, orbit.problem.names)
    options = options or Options(tol=max(orbit.error_estimate, 1e-8))
    if special is None:
        orbit = as_whole_as_needed(orbit, (vary,), (math.copysign(math.inf, sense) if math.isinf(to) else to,), options)
        special = _met(orbit, vary, sense, to, options, max_points, progress)
    if special.kind == REST_KIND:
        return at_rest(special, began, sense)
    return confirmed(special, vary, options, began, sense)


def _met(
    orbit: AnyOrbit, vary: str, sense: float, to: float, options: Options, max_points: int,
    progress: Callable[[AnyOrbit], None] | None, provisional: bool = True,
) -> SpecialPoint[AnyOrbit]:  # fmt: skip
    """The first fold on the way of a parameter up or down, located; the way itself takes less accuracy.

    From provisional orbits at first; where the fold is not located from these, from others.
    """
    here, way = parameter_value(orbit, vary), "up" if sense > 0 else "down"
    if not (to - here) * sense > 0:
        raise InputError(f"{vary} is {here:.6g} at the start: its way {way} cannot end at {to:g}")
    lowest, highest = orbit.problem.range_of(vary)
    rough = replace(options.rough(), provisional=provisional)
    if not cut_by_planes(orbit):
        orbit, _ = from_strongest(orbit, None, rough)
    branch = follow(
        orbit, vary, to=min(max(to, lowest), highest), options=rough, monitors=(FOLD,), recut=False, progress=progress,
        until=lambda special: special.kind == FOLD.kind, max_points=max_points,
    )  # fmt: skip
    fold = next((special for special in branch.special if special.kind == FOLD.kind), None)
    turned, last = (None, None) if fold is None else (fold.orbit, fold.behind)
    many = 1 + next((k for k, each in enumerate(branch.orbits) if each is last), len(branch.orbits))
    top = max(branch.orbits[:many], key=lambda each: sense * parameter_value(each, vary))
    at_end = abs(top.problem.distance(vary, parameter_value(branch.orbits[-1], vary))) <= rough.tol
    ends = at_end and branch.end.kind == GRAZING.kind
    told = any(missed.kind == FOLD.kind for missed in branch.missed)
    told = told or ends and turns_where_it_vanishes(branch.orbits, vary, rough.tol)
    if at_end and branch.end.kind == REST_KIND:  # whose law is known as well as the cycles are
        how = replace(options, tol=max(options.tol, BEST_AT_REST))
        branch = follow(orbit, vary, to=min(max(to, lowest), highest), options=how, monitors=(), recut=False)
        if branch.end.kind == REST_KIND and math.isfinite(branch.end.value):
            return SpecialPoint(REST_KIND, branch.orbits[-1], branch.ended, branch.end.value, vary, branch.end.error)
    beside = top if told and turned is None else turned
    if beside is not None and sense * beside.problem.distance(vary, parameter_value(top, vary)) <= rough.tol:
        try:
            return special_point(FOLD, optimal_beside(beside, vary, finer(options), sense), vary)
        except NoOrbit:
            if not provisional:
                raise
            return _met(orbit, vary, sense, to, options, max_points, progress, provisional=False)
    word, title = "largest" if sense > 0 else "smallest", orbit.problem.title
    if not at_end:
        at = f"its {word} {vary} = {parameter_value(top, vary):.8g}, about"
        sentence = f"the branch of {title} turns back at {at}, where its phases change: no fold; `follow` locates it"
        raise NoOrbit(sentence, Status.NOT_FOUND)
    where = f"{way} from {here:.6g}" if math.isinf(to) else f"between {here:.6g} and {to:.6g}"
    why = "; ".join([branch.ended, *(missed.meaning for missed in branch.missed)])
    why += left_by_motions(branch.orbits, vary)
    status = Status.NOT_CONVERGED if branch.end.kind == "points" else Status.NOT_FOUND
    raise NoOrbit(f"{title} has no {word} {vary} on this branch {where}: {why}", status)


def left_by_motions(orbits: Sequence[Orbit], vary: str) -> str:
    """Where the cycles of a branch have lost their stability, if the first one is stable and the last one is not.

    Parameters
    ----------
    orbits, vary
        of the branch, in its order, and the name of its parameter.

    Returns
    -------
    The end of a sentence; "" where they have not.

    Examples
    --------
    >>> from casahunt.continuation import follow, left_by_motions
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle
    >>> branch = follow(find_cycle(belt, "slip", x=0.0, v=0.0), "belt", to=0.21)
    >>> left_by_motions(branch.orbits, "belt")
    ''
    """
    if orbits[-1].seen_stable is not False or not orbits[0].seen_stable:
        return ""
    k = bisect_left(range(len(orbits)), True, key=lambda k: orbits[k].seen_stable is False)
    low, high = (f"{parameter_value(orbit, vary):.6g}" for orbit in orbits[k - 1 : k + 1])
    return f"; between {vary} = {low} and {high} its cycles have become unstable, and motions leave them"


def grazing(
    orbit: AnyOrbit, vary: str, event: str, *, to: float, options: Options | None = None
) -> SpecialPoint[AnyOrbit]:
    """The first cycle on the way of a parameter that grazes an event.

    Parameters
    ----------
    orbit
        a cycle of a user's system that keeps clear of the event, or that ends a phase with it.
    vary
        name of the parameter.
    event
        name of the event.
    to
        value of the parameter at which the search ends.
    options
        tolerance and method; default the tolerance to which the orbit is known, or 1e-8.

    Returns
    -------
    SpecialPoint of the kind "grazing", for `special_curve`.

    Raises
    ------
    InputError : unknown parameter or event, or no cycle of a user's system.
    NoOrbit : the cycle grazes it nowhere on the way.

    Examples
    --------
    >>> import casadi
    >>> from casahunt.continuation import grazing
    >>> from casahunt.hybrid import Event, Mode, System
    >>> from casahunt.orbits import find_cycle
    >>> def free(x, p):
    ...     return {"x": x.v, "v": p.A * casadi.cos(x.t) - 0.1 * x.v - 4 * x.x}
    >>> impact = Event("impact", lambda x, p: x.x - 1, +1, to="free", reset=lambda x, p: {"v": -0.8 * x.v})
    >>> modes, turn = (Mode("free", free, ends=(impact,)),), 2 * casadi.pi
    >>> wall = System("oscillator beside a wall", ("x", "v"), {"A": 1.0}, modes, forcing_period=lambda p: turn)
    >>> grazing = grazing(find_cycle(wall, x=0.0, v=0.0), "A", "impact", to=5.0)
    >>> round(grazing.orbit.problem.value("A"), 6)  # the square root of 9.01
    3.001666
    """
    if orbit.problem.system is None:
        raise InputError(f"a grazing of {orbit.problem.title}: only cycles of a user's system are followed along it")
    choice_of("parameter", vary, orbit.problem.names)
    choice_of("event", event, events_of(orbit))
    options = options or Options(tol=max(orbit.error_estimate, 1e-8))
    orbit = as_whole_as_needed(orbit, (vary,), (number("to", to),), options)
    said = ["the scalar of the event turns inside no phase"]
    for _, contact in contacts(orbit, event):
        branch = follow(contact.loosened(orbit), vary, to=to, monitors=(contact.monitor,), options=options)
        for special in branch.special:
            shown = contact.reported(special.orbit)
            if not isinstance(shown, str):
                return SpecialPoint(special.kind, shown, special.meaning, vary=vary)
            said.append(shown)
        said.append(branch.ended)
    at = f"on the way of {vary} from {parameter_value(orbit, vary):.6g} to {to:.6g}"
    raise NoOrbit(f"no cycle of {orbit.problem.title} grazes {event!r} {at}: {said[-1]}", Status.NOT_FOUND)
