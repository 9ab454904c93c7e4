"""The cyclic fold: where a branch turns back in its parameter.

    d lambda/d s = 0        the point of the branch whose tangent has no parameter component (special_points.py)

located between two orbits, on a mesh adapted to the tolerance, where the error of the parameter is estimated by an
adjoint, and confirmed by the turning point on the mesh of halved intervals (fold_check.py); where IPOPT is named, and
where Newton's method does not lead there, as next to the end of a phase, as the optimum of

    maximise lambda   subject to  G(u, lambda) = 0        with the exact Hessian (collocation/ipopt.py).

How it moves with a parameter q, a the way along the curve by a row w:  psi [G_u, G_lambda; w] = e_lambda  is the
adjoint of lambda at a fixed a, which at a fold is the fold,

    d lambda/d q = -psi . dG/dq        of all parameters at once.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from functools import cached_property
from typing import ClassVar, Generic

import numpy as np

from ..checks import to_error
from ..collocation.transcription import Setting, Transcription, settings_of
from ..errors import NoOrbit, Status
from ..orbits.adapt import Options
from ..orbits.bordering import row_along
from ..orbits.orbit import AnyOrbit, Orbit, unknowns_of
from ..results import Result
from .curve import along, ends, parameter_value
from .fold_expansion import borders
from .locating import locate_special_point, turned_orbit
from .special_points import FOLD, SpecialPoint, special_point

Array = np.ndarray

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
    confirmed_value : the value again, of the turning point on the mesh of halved intervals, or of the optimum there.
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
        "value_error", "confirmed_value", "error_estimate", "sensitivities", "orbit", "wall_s",
    )  # fmt: skip

    orbit: AnyOrbit
    parameter: str
    value: float
    value_error: float
    confirmed_value: float
    status: Status
    wall_s: float
    sense: float = 1.0

    @property
    def error_estimate(self) -> float:
        """The largest estimated relative error of parameter, amplitude and period."""
        return max(self.value_error, self.orbit.error_estimate)

    @cached_property
    def sensitivities(self) -> dict[str, float]:
        """By how much the value moves with every other parameter."""
        problem, (t, u, setting) = self.orbit.problem, unknowns_along(self.orbit, self.parameter)
        names = [name for name in problem.names if name != self.parameter]
        sizes = [problem.unit(name) or 1.0 for name in names]
        if not names:
            return {}
        one = settings_of(setting, setting.p[None], setting.dp[None])
        ways = np.array([[problem.direction(name) * size for name, size in zip(names, sizes, strict=True)]])
        slopes = problem.unit(self.parameter) * fold_slopes(t, u[None], one, row_along(t, u, setting), ways)[0]
        return {name: 0.0 + float(slope) / size for name, slope, size in zip(names, slopes, sizes, strict=True)}

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


class Vanishing(Fold[AnyOrbit]):
    """The end of a branch at which its cycle stands ever longer and moves ever less, in the place of a fold.

    Attributes
    ----------
    orbit : the last one that was computed, next to nothing.
    value, value_error : where the power law of the last cycles leads to, and how far two of them differ, relative.
    parameter, confirmed_value, status, wall_s, sense : as of a `Fold`.

    Examples
    --------
    >>> from casahunt.continuation import smallest
    >>> from casahunt.hybrid import Event, Mode, System
    >>> from casahunt.orbits import find_cycle
    >>> def until_one(to, left):
    ...     return Event(to, lambda x, p: x.z - 1, +1, to=to, reset=lambda x, p: {"x": left * x.x, "z": 0 * x.z})
    >>> move = Mode("move", lambda x, p: {"x": x.x * (p.p - x.x), "z": 1.0}, ends=(until_one("wait", 0.9),))
    >>> wait = Mode("wait", lambda x, p: {"x": 0 * x.x, "z": x.x}, ends=(until_one("move", 1.0),))
    >>> system = System("moves and waits", ("x", "z"), {"p": 0.5}, (move, wait))
    >>> end = smallest(find_cycle(system, "move", x=0.5, z=0.0), "p")  # x lasts for ever where 0.9 exp(p) = 1
    >>> type(end).__name__, round(end.value, 8)
    ('Vanishing', 0.10536052)
    """

    def __str__(self) -> str:
        return super().__str__().replace("fold of", "no fold: cycles vanish of", 1)


def at_rest(special: SpecialPoint[AnyOrbit], began: float, sense: float) -> Vanishing[AnyOrbit]:
    """The end of a branch whose cycle comes to rest, as the answer to where a parameter is largest."""
    orbit, vary = special.orbit, special.vary
    error = special.error / abs(orbit.problem.unit(vary))
    return Vanishing(
        orbit, vary, special.value, error, special.value, orbit.status, time.perf_counter() - began, sense
    )


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


def fold_slopes(t: Transcription, u: Array, settings: Setting, row: Array, ways: Array) -> Array:
    """How much the folds of many members move.

    t, u, settings: transcription, (B, size) unknowns at their folds, their settings; row: (n + 2,) weights along the
    curve; ways: (B, k, np) directions of p. Returns (B, k) d lambda/d q.
    """
    lin = t.linearise(u, replace(settings, others=ways))
    goal = np.zeros((len(u), 1, t.system.size))
    goal[:, 0, -1] = 1.0
    psi = t.system.solve_transposed(lin.matrix(borders(t, u, row)), goal)[:, 0]
    columns = [np.matmul(psi[:, None], lin.rhs(direction=1 + k)[:, :, None])[:, 0, 0] for k in range(ways.shape[1])]
    return np.stack(columns, axis=1)
