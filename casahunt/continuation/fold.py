"""The cyclic fold: where a branch turns back in its parameter.

Two ways that share nothing but the collocation equations:

* along the branch: the point where the tangent has no parameter component (special_points.py), the mesh adapted
  and the error of the parameter estimated there by an adjoint;
* as an optimisation problem: maximise lambda subject to the transcription, with the exact Hessian: by Newton's method
  on its conditions (optimum.py); by IPOPT where that is named, or where the conditions are not seen to hold.
  Its multipliers are the adjoint of the fold, d lambda/d q = -nu . dG/dq for every parameter q.  Where Newton is to
  work alone, the turning point of the curve on a fixed mesh takes the place of IPOPT (newton.py).

fold_check.py does both, and refuses where they disagree.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Any, ClassVar, Generic

import numpy as np

from ..checks import to_error
from ..collocation.transcription import Setting, Transcription
from ..errors import NoOrbit, Status
from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit, Orbit, unknowns_of
from ..results import Result
from .curve import along, ends, parameter_value
from .locating import locate_special_point, turned_orbit
from .optimum import data_of, fold_conditions, parameter_slopes
from .special_points import FOLD, SpecialPoint, special_point

Array = np.ndarray

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
    sense : +1 where the parameter is largest there, -1 where it is smallest.

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
    sense: float = 1.0

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
        t, u, setting = unknowns_along(fold.orbit, fold.parameter)
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
    return special_point(FOLD, found.orbit if found else optimal_beside(beside, vary, options, sense), vary)


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


def optimal_beside(orbit: AnyOrbit, vary: str, options: Options, sense: float = 1.0) -> AnyOrbit:
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


def unknowns_along(orbit: Orbit, vary: str, sense: float = 1.0) -> tuple[Transcription, Array, Setting]:
    """The unknowns of an orbit, lambda the relative change of the parameter, times `sense`."""
    t, u, setting = unknowns_of(orbit)
    return t, u, replace(setting, dp=sense * along(orbit.problem, vary))
