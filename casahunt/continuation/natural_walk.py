"""Natural continuation: orbits at prescribed values of the parameter, up to a fold.

Next to a fold at lambda_f the unit tangent has (dlambda/ds)^2 proportional to lambda_f - lambda: two points tell how
far it is, and no step goes further than most of the way.
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ..orbits.adapt import Options
from ..orbits.orbit import AnyOrbit
from .curve import Point, curve_point, parameter_value, secant
from .walk import EASY_ITERATIONS, FIRST_STEP, step_along, varied

NATURAL_SMALLEST_STEP = 1e-5  # relative change of the parameter at which a natural run gives up
MOST_OF_THE_WAY = 0.8  # part of the way to a fold ahead that one natural step may take


def walk_naturally(
    start: AnyOrbit, *, vary: str | None = None, low: float, high: float, sense: float = 1.0,
    options: Options | None = None, first_step: float = FIRST_STEP, largest_step: float | None = None,
    max_points: int = 2000,
) -> Generator[AnyOrbit, None, str]:  # fmt: skip
    """Orbits at prescribed parameter values, warm-started, until the range or the branch ends.

    Parameters
    ----------
    start, vary, low, high, sense, options, first_step, largest_step, max_points
        as in `walk`; steps are relative changes of the parameter.

    Yields
    ------
    Converged orbit.  At a fold no smaller step helps, and the generator returns the sentence that says so.

    Raises
    ------
    InputError : unknown parameter name.

    Examples
    --------
    >>> from casahunt.continuation.natural_walk import walk_naturally
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import find_cycle
    >>> start = find_cycle(belt, "slip", x=0.0, v=0.0)
    >>> orbits = list(walk_naturally(start, vary="belt", low=0.2, high=0.22))
    >>> orbits[-1].period < start.period
    True
    """
    vary = varied(start, vary)
    options = options or Options(tol=max(start.error_estimate, 1e-6))
    largest_step = largest_step or start.problem.largest_step
    last, step = start, first_step
    before: tuple[float, float] | None = None
    for _ in range(max_points):
        here = parameter_value(last, vary)
        point = curve_point(last, vary, sense=sense)
        if abs(point.row[-1]) < 1e-4:
            return f"the branch ends at {vary} = {here:.8g}: a fold, where the stable and the unstable cycle merge"
        steepness = float(point.row[-1]) ** 2
        if before is not None and steepness < before[1]:
            ahead = steepness * abs(here - before[0]) / (before[1] - steepness) / abs(last.problem.unit(vary))
            if ahead < NATURAL_SMALLEST_STEP:
                return (
                    f"the branch ends at {vary} = {here:.8g}: its tangent shows a fold within a relative step of "
                    f"{ahead:.1g} (half multiplier {last.half_multiplier:.3g}; +1 is a fold)"
                )
            step = min(step, MOST_OF_THE_WAY * ahead)
        before = here, steepness
        while True:
            value = min(max(last.problem.moved(vary, sense * step), low), high)
            orbit = _natural_step(point, last, vary, value, options)
            if not isinstance(orbit, str):
                break
            step *= 0.4
            if step < NATURAL_SMALLEST_STEP:
                return (
                    f"the branch ends at {vary} = {here:.8g}: no cycle follows within a relative step of {step:.1g} "
                    f"(half multiplier {last.half_multiplier:.3g}; +1 is a fold): {orbit}"
                )
        yield orbit
        last = orbit
        if value in (low, high):
            return f"{vary} reached {value:.6g}, the end of the range"
        step = min(step * float(np.clip(EASY_ITERATIONS / max(orbit.iterations, 1), 0.5, 2.0)), largest_step)
    return f"stopped after {max_points} points at {vary} = {parameter_value(last, vary):.6g}"


def _natural_step(point: Point, last: AnyOrbit, vary: str, value: float, options: Options) -> AnyOrbit | str:
    """The orbit at a value: a step along the curve that lands there, on this side of a fold; or what went wrong."""
    ds = last.problem.distance(vary, value) / float(point.row[-1])
    outcome = step_along(point, last, vary, ds, value, value, options)
    if isinstance(outcome, str):
        return outcome
    after = curve_point(outcome[0], vary, like=secant(last, outcome[0], vary))
    if after.row[-1] * (value - parameter_value(last, vary)) <= 0:
        return "the solver converged to the other side of the fold"
    return outcome[0]
