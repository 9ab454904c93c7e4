"""A located fold, confirmed: by the turning point (fold.py) on its mesh and on a finer one.

What a coarse mesh does to the place of the fold along the branch, no estimate at a point of the branch can see; the
turning point on the mesh of halved intervals does, and the errors of the result are not less than the distance to it.
Where they are more than the tolerance, the fold is located anew on that mesh.  An extended system (J v = 0, |v| = 1)
and the optimum by IPOPT serve as further opinions in the tests.
"""

from __future__ import annotations

import math
import time
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ..collocation.error_estimate import left_on_halved
from ..collocation.ipopt import solve
from ..collocation.mesh import on_halved_mesh
from ..collocation.newton import Solution, Solver
from ..collocation.transcription import Setting, Transcription
from ..errors import InputError, NoOrbit, Status
from ..orbits.adapt import Options
from ..orbits.amplitude import amplitude_off
from ..orbits.bordering import curve_border, row_along
from ..orbits.orbit import AnyOrbit, unknowns_of
from .curve import parameter_value
from .fold import FREEDOM, Fold, optimal_beside, unknowns_along
from .locating import turned_orbit
from .special_points import FOLD, SpecialPoint, special_point

Array = np.ndarray

SECOND_PLACE = 1e-3
"""Part of the tolerance to which the place of the fold on the halved mesh is known."""
MESH_HALVINGS = 3
"""How often the intervals are halved where the mesh of a fold does not give it to the tolerance; once, as a rule."""


def next_fold(orbit: AnyOrbit, vary: str, options: Options) -> SpecialPoint[AnyOrbit]:
    """The fold right above an orbit, from that orbit alone: where natural continuation ends.

    Parameters
    ----------
    orbit
        next to the fold.
    vary
        name of the parameter, which is largest there.
    options
        `tol` bounds the relative errors.

    Returns
    -------
    SpecialPoint, confirmed.

    Raises
    ------
    NoOrbit : the largest parameter next to the orbit is not found, or not confirmed.

    Examples
    --------
    >>> from casahunt.continuation import largest, next_fold
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import Options, find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> near = largest(orbit, "g", options=Options(tol=1e-4)).orbit
    >>> round(next_fold(near, "g", Options(tol=1e-8)).value, 4)
    13.751
    """
    best = optimal_beside(orbit, vary, options)
    found = confirmed(special_point(FOLD, best, vary), vary, options)
    return special_point(FOLD, found.orbit, vary, found.value_error)


def confirmed(
    special: SpecialPoint[AnyOrbit], vary: str, options: Options, began: float | None = None, sense: float = 1.0
) -> Any:
    """A located fold, checked against its place on its mesh and on a finer one.

    special, vary: the fold, and the name of the parameter; options, began, sense: `tol` bounds the relative errors;
    time.perf_counter() when the search began, default: now; +1 where the parameter is largest, -1 where it is smallest.
    Returns fold, of the class that its problem names. Raises InputError: the special point is no fold; NoOrbit: the
    two values differ by more than the tolerance, an error estimate exceeds it, on finer meshes too, or it is a fold of
    the other kind.
    """
    if special.kind != FOLD.kind:
        raise InputError(f"special point {special.kind!r}: must be a fold")
    began = time.perf_counter() if began is None else began
    try:
        return _on_its_mesh(special, vary, options, began, sense)
    except NoOrbit as refusal:
        if refusal.status is not Status.TOLERANCE_NOT_REACHED:
            raise
        # The fold, located anew on meshes of halved intervals: its place along the branch is known less well than a
        # cycle at a given parameter is, and an estimate for the mesh does not see it
        problem, (t, u, setting) = special.orbit.problem, unknowns_of(special.orbit)
        for _ in range(MESH_HALVINGS):
            t, u, fractions = on_halved_mesh(t, u, setting.fractions)
            setting = replace(setting, fractions=fractions)
            with suppress(NoOrbit):
                found = turned_orbit(problem, (t, u, setting), vary, options, -sense * np.inf)
                if found is not None:
                    return _on_its_mesh(special_point(FOLD, found, vary), vary, options, began, sense)
        raise refusal


def _on_its_mesh(special: SpecialPoint[AnyOrbit], vary: str, options: Options, began: float, sense: float) -> Any:
    """`confirmed`, on the mesh of the orbit and that with halved intervals."""
    orbit = special.orbit
    t, u, setting = unknowns_along(orbit, vary, sense)
    here = parameter_value(orbit, vary)
    where = f"the fold of {orbit.problem.title} at {vary} {here:.10g}"
    row = row_along(t, u, setting)
    best = _turning_point(t, u, setting, row, options)
    if not best.status.ok or abs(best.parameter) > options.tol:
        value = orbit.problem.moved(vary, sense * best.parameter)
        found = f"is at {value:.10g}" if best.status.ok else f"was not found ({best.status.advice})"
        status = Status.TOLERANCE_NOT_REACHED if best.status.ok else best.status
        raise NoOrbit(f"{where} is not confirmed: the turning point {found}; try another tolerance", status)
    if best.bend is not None and best.bend > 0:
        word, other = ("largest", "smallest") if sense > 0 else ("smallest", "largest")
        sentence = f"{vary} is not {word} at the fold of {orbit.problem.title} at {here:.10g}: try `{other}`"
        raise NoOrbit(sentence, Status.NOT_FOUND)
    orbit, again = _with_second_place(orbit, t, best, setting, row, options, where)
    if orbit.error_estimate > options.tol:
        raise NoOrbit(
            f"{where} is not known to the tolerance: the error estimate is {orbit.error_estimate:.2g}; ask for "
            "a larger tolerance",
            Status.TOLERANCE_NOT_REACHED,
        )
    kind = orbit.problem.fold_type or Fold
    value, wall_s = orbit.problem.moved(vary, sense * again), time.perf_counter() - began
    return kind(orbit, vary, here, orbit.parameter_error, value, orbit.status, wall_s, sense)


def _turning_point(
    t: Transcription, u: Array, setting: Setting, row: Array, options: Options, bend: float = math.nan
) -> Solution:
    """The extremum of lambda next to a point of a mesh, the largest where IPOPT looks for it.

    bend: d2 lambda/d a2 there, about; NaN where it is not known.
    """
    solvers: tuple[Solver, ...] = ("newton", "ipopt") if options.solver == "auto" else (options.solver,)
    for solver in solvers:
        found = solve(
            t, u, setting, solver=solver, border=curve_border(t, u, row), accuracy=SECOND_PLACE * options.tol,
            bend=-math.inf if solver == "ipopt" else bend,
        )  # fmt: skip
        if found.status.ok and abs(found.parameter) < FREEDOM:
            return found
    return replace(found, status=Status.NOT_CONVERGED) if found.status.ok else found


def _with_second_place(
    orbit: AnyOrbit, t: Transcription, best: Solution, setting: Setting, row: Array, options: Options, where: str
) -> tuple[AnyOrbit, float]:
    """The orbit with the errors that the turning point on the halved mesh shows, and lambda there.

    Raises NoOrbit where that is not found.
    """
    finer, u, fractions = on_halved_mesh(t, best.u, setting.fractions)
    halves, left = replace(setting.moved(best.parameter), fractions=fractions), SECOND_PLACE * options.tol
    found = _turning_point(finer, u, halves, row, options, math.nan if best.bend is None else best.bend)
    if not found.status.ok:
        raise NoOrbit(
            f"{where} is not confirmed: on a mesh of half the intervals' length no turning point was found; try "
            "another tolerance",
            found.status,
        )
    u, moved = found.u, found.parameter
    period = float(np.sum(finer.durations_of(u))) * t.cycle.repeats
    apart = amplitude_off(finer, u, halves.moved(moved), orbit.amplitude)
    off = 1 + float(left_on_halved(t).max(initial=0.0))  # the fold on the halved mesh is not the exact one either
    orbit = replace(
        orbit,
        period_error=max(orbit.period_error, off * abs(period / orbit.period - 1) + left),
        amplitude_error=max(orbit.amplitude_error, off * apart + left),
        parameter_error=max(orbit.parameter_error, abs(best.parameter), off * abs(best.parameter + moved)),
    )
    return orbit, best.parameter + moved
