"""A located fold, confirmed: on the branch and as an optimum (fold.py), on its mesh and on a finer one.

What a coarse mesh does to the place of the fold along the branch, no estimate at a point of the branch can see; the
turning point on the mesh of halved intervals does, and the errors of the result are not less than the distance to it.
Where they are more than the tolerance, the fold is located anew on that mesh.  An extended system (J v = 0, |v| = 1)
serves as a third opinion in the tests.
"""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ..collocation.error_estimate import left_on_halved
from ..collocation.ipopt import Maximum, maximise_parameter, solve
from ..collocation.mesh import on_halved_mesh
from ..collocation.transcription import Setting, Transcription
from ..errors import InputError, NoOrbit, Status
from ..orbits.adapt import Options
from ..orbits.amplitude import amplitude_off
from ..orbits.bordering import curve_border, row_along
from ..orbits.orbit import AnyOrbit, unknowns_of
from .curve import parameter_value
from .fold import FREEDOM, Fold, optimal_beside, unknowns_along
from .locating import turned_orbit
from .optimum import bend_at, multipliers_at, optimum
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
    """A located fold, checked against the optimisation problem on its mesh and the place of the fold on a finer one.

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
    best = _optimum(t, u, setting, row, options)
    value = orbit.problem.moved(vary, sense * best.parameter)
    if not best.status.ok or abs(best.parameter) > options.tol:
        found = f"gives {value:.10g}" if best.status.ok else f"was not solved ({best.status.advice})"
        status = Status.TOLERANCE_NOT_REACHED if best.status.ok else best.status
        raise NoOrbit(f"{where} is not confirmed: the optimisation problem {found}; try another tolerance", status)
    if best.bend > 0:
        word, other = ("largest", "smallest") if sense > 0 else ("smallest", "largest")
        sentence = f"{vary} is not {word} at the fold of {orbit.problem.title} at {here:.10g}: try `{other}`"
        raise NoOrbit(sentence, Status.NOT_FOUND)
    orbit = _with_second_place(orbit, t, best, setting, row, options, where)
    error = orbit.parameter_error
    if orbit.error_estimate > options.tol:
        raise NoOrbit(
            f"{where} is not known to the tolerance: the error estimate is {orbit.error_estimate:.2g}; ask for "
            "a larger tolerance",
            Status.TOLERANCE_NOT_REACHED,
        )
    kind = orbit.problem.fold_type or Fold
    wall_s = time.perf_counter() - began
    return kind(orbit, vary, here, error, value, sense * best.multipliers, orbit.status, wall_s, sense)


def _optimum(t: Transcription, u: Array, setting: Setting, row: Array, options: Options) -> Maximum:
    """The largest lambda at a located fold u, by Newton's method on the optimality conditions where IPOPT is not named.

    Where they are not seen to hold there, by IPOPT; where Newton is to work alone, the turning point with its adjoint.
    """
    if options.solver != "ipopt":
        best = optimum(t, u, setting, row)
        if best.status.ok:
            return best
    if options.solver != "newton":
        best = maximise_parameter(t, u, setting)
    elif (found := _turned(t, u, setting, row, -np.inf, 0.0)) is not None:
        best = Maximum(*found, multipliers_at(t, *found, setting, row), Status.CONVERGED, 0)
    else:
        return Maximum(u, 0.0, np.full(t.size, np.nan), Status.NOT_CONVERGED, 0)
    if not best.status.ok:
        return best
    return replace(best, bend=bend_at(t, best.u, best.parameter, setting, row, best.multipliers))


def _turned(
    t: Transcription, u: Array, setting: Setting, row: Array, bend: float, accuracy: float
) -> tuple[Array, float] | None:
    """(u, lambda) at the turning point next to a point of the same mesh, by Newton's method; None where it is not."""
    border = curve_border(t, u, row)
    found = solve(t, u, setting, solver="newton", border=border, accuracy=accuracy, bend=bend)
    return (found.u, found.parameter) if found.status.ok and abs(found.parameter) < FREEDOM else None


def _with_second_place(
    orbit: AnyOrbit, t: Transcription, best: Maximum, setting: Setting, row: Array, options: Options, where: str
) -> AnyOrbit:
    """The orbit with the errors that the fold on the halved mesh shows.  Raises NoOrbit where that is not found.

    Its turning point; the optimum where Newton's method does not lead there, or is not to work.
    """
    finer, u, fractions = on_halved_mesh(t, best.u, setting.fractions)
    halves, left = replace(setting.moved(best.parameter), fractions=fractions), SECOND_PLACE * options.tol
    place = None if options.solver == "ipopt" else _turned(finer, u, halves, row, best.bend, left)
    if place is None:
        check = _optimum(finer, u, halves, row, options)
        if not check.status.ok:
            raise NoOrbit(
                f"{where} is not confirmed: on a mesh of half the intervals' length the optimisation problem was not "
                "solved; try another tolerance",
                check.status,
            )
        place = check.u, check.parameter
    u, moved = place
    period = float(np.sum(finer.durations_of(u))) * t.cycle.repeats
    apart = amplitude_off(finer, u, halves.moved(moved), orbit.amplitude)
    off = 1 + float(left_on_halved(t).max(initial=0.0))  # the fold on the halved mesh is not the exact one either
    return replace(
        orbit,
        period_error=max(orbit.period_error, off * abs(period / orbit.period - 1) + left),
        amplitude_error=max(orbit.amplitude_error, off * apart + left),
        parameter_error=max(orbit.parameter_error, abs(best.parameter), off * abs(best.parameter + moved)),
    )
