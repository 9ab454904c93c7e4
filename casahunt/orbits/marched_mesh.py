"""From a motion that has been marched, and is not yet the orbit, to the orbit; the mesh for the tolerance before that.

estimate -> better mesh -> is it clear on every interval what its phase is? -> start of adapt.py
               ^                 | no
               +-- cut in four --+
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from typing import Any, Literal

import numpy as np

from ..collocation.admissibility import check_admissible
from ..collocation.mesh import quartered_where
from ..collocation.remesh import better_breaks, shape_limit
from ..hybrid.system import Signature
from ..motion.segment import Segment
from .adapt import Options, finished, first_solved, on_breaks, or_expected, presentable
from .amplitude import estimated
from .family import Cycles
from .orbit import leading_of
from .restart import Start, from_segments

MOTION = 0.1
"""The mesh of a motion that is not yet the orbit aims at this part of the tolerance: over 24 stick-slip cycles
that takes an eighth off the time at 1e-6, and adds a sixteenth at 1e-8; elsewhere it makes no difference."""
CLEARED = 2
"""How often intervals of a motion on which it is not clear what its phases are may be cut before anything is solved."""


def remeshed(start: Start, options: Options) -> Start:
    """A marched motion on a mesh for the tolerance, before anything is solved.

    A march solves the equations of every interval; the estimate of what each contributes does not need the
    closure to hold.

    Returns the same on another mesh; as it is where its own does.
    """
    t, u, setting = start
    e = estimated(t, u, setting, accepted=0.0)
    if not np.isfinite(e.indicators).all():
        return start
    if not (float(e.indicators.sum()) <= options.tol and presentable(e, options)):
        start = on_breaks(start, better_breaks(t, setting.fractions, e, MOTION * options.tol))
    return cleared(start)


def cleared(start: Start) -> Start:
    """A motion on a mesh cut, by its own polynomials, where it is not clear what its phases are."""
    for _ in range(CLEARED):
        t, u, setting = start
        verdict = check_admissible(t, u, setting)
        if verdict.violated or not verdict.unclear.any():
            break
        start = on_breaks(start, quartered_where(t, setting.fractions, verdict.unclear))
    return start


def orbit_from_motion(
    problem: Cycles, signature: Signature, phases: Sequence[tuple[float, Segment]], options: Options, *,
    solver: Literal["newton", "ipopt"] = "newton", remesh: bool = False, what: str = "the cycle",
) -> Any:  # fmt: skip
    """The periodic orbit next to a motion that comes back close to where it began.

    Parameters
    ----------
    problem
        whose cycle it is, at its parameters.
    signature
        (mode, event) of each phase of the cycle.
    phases
        (factor, segment) of each: its states are `factor` times those of the segment, in the scheme of the options.
    options
        tolerance and method.
    solver
        which makes the first solve, where the options leave that open.
    remesh
        whether the mesh is made for the tolerance before anything is solved: worth it where intervals are many.
    what
        was to be computed, for the refusal.

    Returns
    -------
    Orbit, of the class that the problem names.

    Raises
    ------
    NoOrbit : it was not computed to the tolerance.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.motion import march
    >>> from casahunt.orbits import Options, find_cycle, orbit_from_motion
    >>> known = find_cycle(belt, "slip", x=0.0, v=0.0)  # with the cycle that a motion settles on its problem is at hand
    >>> p = known.problem.vector()
    >>> stick, slip = march(
    ...     belt.vector_form, "stick", np.array([0.0, 0.2]), p,
    ...     scale=np.ones(2), until=lambda segment: segment.mode == "slip", tol=1e-6,
    ... )
    >>> signature = (("stick", "breaks away"), ("slip", "catches up"))
    >>> orbit = orbit_from_motion(known.problem, signature, [(1.0, stick), (1.0, slip)], Options(tol=1e-8))
    >>> abs(orbit.period / known.period - 1) < 1e-8
    True
    """
    began = time.perf_counter()
    start = start_from_motion(problem, signature, phases, options)
    start = remeshed(start, options) if remesh else start
    solved = first_solved(problem, or_expected(problem, start), options, solver=solver)
    orbit = finished(solved, problem, options, began, what)
    if solved.solution.linearisation is not None:
        vars(orbit)["provisional_multiplier"] = leading_of(solved.solution.linearisation)
    return orbit


def start_from_motion(
    problem: Cycles, signature: Signature, phases: Sequence[tuple[float, Segment]], options: Options
) -> Start:
    """A motion as the starting point of the boundary value problem; the tolerance chooses the intervals of series."""
    degree, kind = options.scheme_of(problem)
    cycle = problem.cycle(signature, problem.closure.repeats)
    passes = [(factor, segment.meshed(shape_limit(options.tol))) for factor, segment in phases]
    direction = problem.direction(problem.principal)
    return from_segments(cycle, passes, problem.vector(), direction, degree=degree, kind=kind)
