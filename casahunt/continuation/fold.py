"""The cyclic fold: where a branch turns back in its parameter.

Two ways that share nothing but the collocation equations:

* along the branch: the point where the tangent has no parameter component (special_points.py), the mesh adapted
  and the error of the parameter estimated there by an adjoint;
* as an optimisation problem: maximise lambda subject to the transcription, with the exact Hessian: by Newton's method
  on its conditions (optimum.py); by IPOPT where that is named, or where the conditions are not seen to hold.
  Its multipliers are the adjoint of the fold, d lambda/d q = -nu . dG/dq for every parameter q.  Where Newton is to
  work alone, the turning point of the curve on a fixed mesh takes the place of IPOPT (fold_system.py).

`confirmed` does both, and refuses where they disagree; and it looks for the turning point on the halved mesh.  What a
coarse mesh does to the place of the fold along the branch, no estimate at a point of the branch can see; that on the
halved mesh does, and the errors of the result are not less than the distance to it.  An extended system (J v = 0,
|v| = 1) serves as a third opinion in the tests.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Generic

import numpy as np

from ..checks import to_error
from ..collocation.error_estimate import left_on_halved
from ..collocation.ipopt import Maximum, maximise_parameter
from ..collocation.mesh import on_halved_mesh
from ..collocation.solve import solve
from ..collocation.transcription import Setting, Transcription
from ..errors import InputError, NoOrbit, Status
from ..orbits.adapt import Options
from ..orbits.amplitude import amplitude_off
from ..orbits.bordering import curve_border, row_along
from ..orbits.orbit import AnyOrbit, Orbit, unknowns_of
from ..results import Result
from .curve import along, ends, parameter_value
from .locating import locate_special_point, turned_orbit
from .optimum import bend_at, data_of, fold_conditions, multipliers_at, optimum, parameter_slopes
from .special_points import FOLD, SpecialPoint, special_point

Array = np.ndarray

SECOND_PLACE = 1e-3
"""Part of the tolerance to which the place of the fold on the halved mesh is known."""
LEAST_LAMBDA = -0.9
"""lambda of a fold as a constraint: the parameter stays above zero."""
FREEDOM = 0.01
"""|lambda| at which an extremum is no longer next to a point."""


@dataclass(frozen=True, eq=False, repr=False)
class Fold(Result, Generic[AnyOrbit]):
    """A cyclic fold in a parameter.

    Attributes
    ----------
    orbit : the orbit at the fold.
    parameter : the name of the parameter.
    value : its value at the fold.
    value_error : estimated relative error of the value.
    optimised_value : that of the optimisation problem on the same mesh; of the turning point there where Newton works
        alone.
    multipliers : (size,) multipliers of the collocation equations, the adjoint of the fold.
    status, wall_s : as everywhere.

    Examples
    --------
    >>> from casahunt.continuation import smallest
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> fold = smallest(orbit, "a")
    >>> round(fold.value, 8), sorted(fold.sensitivities)
    (0.00856084, ['g', 'omega', 'r'])
    """

    _quantities: ClassVar[tuple[str, ...]] = (
        "problem = orbit.problem.title", "parameter", "value +- absolute_error",
        "period = orbit.period ~ orbit.period_error", "status",
    )  # fmt: skip
    _details: ClassVar[tuple[str, ...]] = (
        "value_error", "optimised_value", "error_estimate", "sensitivities", "orbit", "wall_s",
    )  # fmt: skip

    orbit: AnyOrbit
    parameter: str
    value: float
    value_error: float
    optimised_value: float
    multipliers: Array
    status: Status
    wall_s: float

    @property
    def error_estimate(self) -> float:
        """The largest estimated relative error of parameter, amplitude and period."""
        return max(self.value_error, self.orbit.error_estimate)

    @cached_property
    def sensitivities(self) -> dict[str, float]:
        """By how much the value moves with every other parameter, all of them from the multipliers (optimum.py)."""
        problem = self.orbit.problem
        others = tuple(name for name in problem.names if name != self.parameter)
        slopes = parameter_slopes(self.orbit, self.multipliers, others)
        return {name: float(problem.unit(self.parameter) * slope) for name, slope in zip(others, slopes, strict=True)}

    def __str__(self) -> str:
        error = self.value_error * abs(self.orbit.problem.unit(self.parameter))
        value = to_error(self.value, error / abs(self.value)) if abs(self.value) > error else "0"
        moves = ", ".join(f"{name} {slope:.6g}" for name, slope in self.sensitivities.items())
        by = f"; it moves with {moves}" if moves else ""
        return f"fold of {self.orbit.problem.title} at {self.parameter} = {value}{by}"

    @property
    def absolute_error(self) -> float:
        """Estimated error of the value, in its own unit."""
        return float(self.value_error * abs(self.orbit.problem.unit(self.parameter)))


@dataclass(frozen=True, eq=False)
class FoldConstraints:
    """A fold as constraints of a larger optimisation problem, with exact Jacobian: see optimum.py.

    Attributes
    ----------
    equations, jacobian : functions of (q, z, n): q the logarithms of the free parameters, z the unknowns of the cycle
        and lambda (value of the fold = what it is here times 1 + lambda), n the multipliers; and by all three, sparse.
    right : what the equations must be.
    z, lowest, n : where z starts, the smallest it may be, and where n starts.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.continuation import FoldConstraints, largest
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> fold = largest(find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True), "g")
    >>> conditions = FoldConstraints.of(fold, ("omega",))
    >>> q = np.log([fold.orbit.problem.value("omega")])
    >>> left = np.array(conditions.equations(q, conditions.z, conditions.n)).ravel() - conditions.right
    >>> bool(np.abs(left).max() < 1e-5)
    True
    """

    equations: Callable[..., Any]
    jacobian: Callable[..., Any]
    right: Array
    z: Array
    lowest: Array
    n: Array

    @classmethod
    def of(cls, fold: Fold[Any], free: tuple[str, ...]) -> FoldConstraints:
        """The conditions of a fold.

        Parameters
        ----------
        fold, free
            the fold, and the names of the free parameters, all above zero.

        Returns
        -------
        FoldConstraints.
        """
        problem = fold.orbit.problem
        t, u, setting = _along(fold.orbit, fold.parameter)
        equations, jacobian = fold_conditions(t, tuple(problem.names.index(name) for name in free))
        data, S = data_of(setting), float(np.max(np.abs(fold.multipliers)))
        lowest = np.full(t.size + 1, -np.inf)
        lowest[t.size - t.phases : t.size] = 0.0  # durations
        lowest[-1] = LEAST_LAMBDA
        right = np.append(np.zeros(2 * t.size), 1.0)
        return cls(
            lambda q, z, n: equations(q, z, n, data, S), lambda q, z, n: jacobian(q, z, n, data, S),
            right, np.append(u, 0.0), lowest, fold.multipliers / S,
        )  # fmt: skip


def turns_back(before: Orbit, after: Orbit, vary: str, sense: float = 1.0) -> bool:
    """Whether the parameter has a maximum between two successive orbits of a walk, or (sense -1) a minimum.

    before, after: the orbits, in the order of the walk. Returns True where d lambda/d s changes sign from plus (minus).
    """
    here, there = ends(before, after, vary)
    return sense * FOLD.value(after, there) <= 0 < sense * FOLD.value(before, here)


def located(
    before: AnyOrbit, after: AnyOrbit, vary: str, options: Options, sense: float = 1.0
) -> SpecialPoint[AnyOrbit]:
    """The fold between two orbits: on the branch; where it is too sharp for any step along that, as the optimum.

    before, after: the orbits, in the order of the walk; sense: as in `turns_back`. Returns SpecialPoint, not yet
    confirmed. Raises NoOrbit: neither leads there.
    """
    found = locate_special_point(before, after, FOLD, vary=vary, options=options)
    beside = max(before, after, key=lambda orbit: sense * parameter_value(orbit, vary))
    return special_point(FOLD, found or _optimal(beside, vary, options, sense), vary)


def fold_between(
    before: AnyOrbit, after: AnyOrbit, vary: str, options: Options, sense: float = 1.0
) -> SpecialPoint[AnyOrbit] | None:
    """The fold between two successive orbits of a walk.

    Parameters
    ----------
    before, after
        the orbits, in the order of the walk.
    vary
        name of the parameter of the walk.
    options
        tolerance and method; the place of a fold on the branch takes a finer mesh than its parameter, period and
        amplitude: ask for a part of the tolerance.
    sense
        +1 for a largest value of the parameter, -1 for a smallest one.

    Returns
    -------
    SpecialPoint, located and not yet confirmed: `largest` and `smallest` take it and do that; None where the parameter
    has no such extremum between the two.

    Raises
    ------
    NoOrbit : there is one, and it was not located.

    Examples
    --------
    >>> from itertools import pairwise
    >>> from casahunt import walk
    >>> from casahunt.continuation import fold_between
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import Options, find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> way = [orbit, *walk(orbit, vary="a", low=0.008, high=0.013, sense=-1, max_points=8)]
    >>> found = [fold_between(*pair, "a", Options(), sense=-1) for pair in pairwise(way)]
    >>> [round(fold.value, 6) for fold in found if fold]
    [0.008561]
    """
    return located(before, after, vary, options, sense) if turns_back(before, after, vary, sense) else None


def _optimal(orbit: AnyOrbit, vary: str, options: Options, sense: float = 1.0) -> AnyOrbit:
    """The orbit of largest (sense -1: smallest) parameter next to one near the fold, on meshes made for the tolerance.

    Raises NoOrbit: neither Newton's method nor IPOPT leads to one.
    """
    here = parameter_value(orbit, vary)
    for solver in ("newton", "ipopt") if options.solver == "auto" else (options.solver,):
        found = turned_orbit(orbit.problem, unknowns_of(orbit), vary, replace(options, solver=solver), -sense * np.inf)
        if found is not None and abs(orbit.problem.distance(vary, parameter_value(found, vary))) < FREEDOM:
            return found
    raise NoOrbit(
        f"the fold of {orbit.problem.title} next to {vary} {here:.10g} was not located on its branch, and as an "
        "optimisation problem it was not solved to the tolerance; try another tolerance",
        Status.NOT_CONVERGED,
    )


def _along(orbit: Orbit, vary: str, sense: float = 1.0) -> tuple[Transcription, Array, Setting]:
    """The unknowns of an orbit, lambda the relative change of the parameter, times `sense`."""
    t, u, setting = unknowns_of(orbit)
    return t, u, replace(setting, dp=sense * along(orbit.problem, vary))


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
    best = _optimal(orbit, vary, options)
    found = confirmed(special_point(FOLD, best, vary), vary, options)
    return special_point(FOLD, found.orbit, vary, found.value_error)


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


def confirmed(
    special: SpecialPoint[AnyOrbit], vary: str, options: Options, began: float | None = None, sense: float = 1.0
) -> Any:
    """A located fold, checked against the optimisation problem on its mesh and the place of the fold on a finer one.

    special, vary: the fold, and the name of the parameter; options, began, sense: `tol` bounds the relative errors;
    time.perf_counter() when the search began, default: now; +1 where the parameter is largest, -1 where it is smallest.
    Returns fold, of the class that its problem names. Raises InputError: the special point is no fold; NoOrbit: the
    two values differ by more than the tolerance, an error estimate exceeds it, or it is a fold of the other kind.
    """
    if special.kind != FOLD.kind:
        raise InputError(f"special point {special.kind!r}: must be a fold")
    began = time.perf_counter() if began is None else began
    orbit = special.orbit
    t, u, setting = _along(orbit, vary, sense)
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
    return kind(orbit, vary, here, error, value, sense * best.multipliers, orbit.status, time.perf_counter() - began)


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
