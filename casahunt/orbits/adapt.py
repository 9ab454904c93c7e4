"""Solve, estimate the error, place the mesh anew, check the phases, until the tolerance holds.

    solve -> judge ------------> estimate -> within tol and clear? -> done
      ^        | not a motion       | no
      |        v                    v
      +-- next phase sequence   better mesh --> Newton --+
      +--------------------------------------------------+

The loop works at a fixed parameter, or with the parameter free under a border row (continuation).
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ..checks import known, require, shown
from ..collocation.admissibility import judge
from ..collocation.mesh import (
    COARSENING,
    Estimate,
    better_breaks,
    estimate,
    halved,
    phase_breaks,
    quartered_where,
    shape_limit,
    transfer,
)
from ..collocation.newton import Solution, Solver, newton
from ..collocation.scheme import Kind
from ..collocation.solve import ipopt_then_newton, solve
from ..collocation.transcription import Setting, Transcription
from ..errors import InputError, NoOrbit, Status
from ..hybrid.problem import Problem
from .orbit import AnyOrbit, Solved, orbit_of, unknowns_of
from .restart import Start

Array = np.ndarray

TOLERANCE_RANGE = (1e-12, 1e-2)
"""Reachable tolerances: rounding below, meaningless meshes above."""
MAX_INTERVALS = 3000
MAX_ROUNDS = 24
MAX_SEQUENCES = 5
ROUGH = 3.0
"""A mesh is kept while its Legendre coefficients are within this factor of their limit."""
MOTION = 0.1
"""The mesh of a motion that is not yet the orbit aims at this part of the tolerance: over 24 stick-slip cycles
that takes an eighth off the time at 1e-6, and adds a sixteenth at 1e-8; elsewhere it makes no difference."""
LEFT_OUT = 0.01
"""Newton leaves out a step smaller than this part of the tolerance; the estimate sees what that leaves."""

SOLVERS = ("auto", "ipopt", "newton")


@dataclass(frozen=True)
class Options:
    """How orbits are computed; holds no problem data.

    Attributes
    ----------
    tol : relative tolerance of period and amplitude.
    solver : "ipopt" or "newton" makes every solve, alone: of a first cycle, along a branch, after a change of mesh,
        for multipliers.  "auto": Newton where the start is close, IPOPT where it is not or Newton fails, and after a
        change of mesh Newton corrects.
    degree, kind : collocation scheme; None for the default of the problem.
    half : exploit the symmetry x(t + T/2) = -x(t), where a cycle is made from nothing.
    """

    tol: float = 1e-6
    solver: Literal["auto", "ipopt", "newton"] = "auto"
    degree: int | None = None
    kind: Kind | None = None
    half: bool = True

    def __post_init__(self) -> None:
        low, high = TOLERANCE_RANGE
        if not low <= require("tol", self.tol) <= high:
            raise InputError(f"tol = {shown(self.tol)}: must lie between {low:g} and {high:g}")
        known("solver", self.solver, SOLVERS)

    def scheme_of(self, problem: Problem) -> tuple[int, Kind]:
        """(degree, kind) for a problem."""
        degree, kind = problem.scheme
        return self.degree or degree, self.kind or kind


def solve_adaptively(
    problem: Problem,
    start: Start,
    options: Options,
    *,
    solver: Solver,
    border: Array | None = None,
    soft: bool = True,
) -> Solved:
    """Solve from `start` and adapt mesh and phase sequence until the tolerance holds.

    Parameters
    ----------
    problem
        whose cycle it is, and whose phase sequences are sought where one stops being a motion.
    options
        tolerance.
    start
        transcription, unknowns and setting.
    solver
        for the first solve of `auto`, which takes Newton after that, and the other one where the first fails at a fixed
        parameter.  A solver named in `options` makes all the solves, alone.
    border
        weights (n + 2,) of the first node, of ln T_1 and of lambda; the correction is orthogonal to them and
        lambda is free.  None holds lambda at zero.
    soft
        allow last resorts among the phase sequences (Problem.next_sequence).

    Raises
    ------
    ValueError : the cycle of `start` is none of the problem's.
    """
    t, u, setting = start
    if t.cycle != problem.cycle(t.cycle.signature, t.cycle.repeats):
        raise ValueError(f"the {t.cycle.name} to be solved is no cycle of {problem.title}")
    iterations, sequences, changes = 0, 0, 0
    accepted: Solved | None = None
    marched = False
    solution = _correct(t, u, setting, border, solver, 0.0, options)
    for _ in range(MAX_ROUNDS):
        iterations += solution.iterations
        if not solution.status.ok:
            return accepted or Solved(t, solution, setting, None, solution.status, iterations)
        verdict = judge(t, solution.u, setting.moved(solution.parameter))
        if verdict.violated:
            sequences += 1
            found = None
            if sequences <= MAX_SEQUENCES:
                moved = setting.moved(solution.parameter)
                starts = problem.next_sequence(t, solution.u, moved, verdict.phase, soft=soft)
                found = _first_converging(starts, setting, border, solution.parameter, options)
            if found is None:
                return Solved(t, solution, setting, None, Status.INADMISSIBLE, iterations, verdict.violated)
            t, setting, solution = found
            accepted, changes = None, 0
            continue
        row = None if border is None else curve_border(t, solution.u, border)
        e = estimate(t, solution.u, setting.moved(solution.parameter), border=row, believed=options.tol)
        if not np.isfinite(e.error):
            return Solved(t, solution, setting, None, Status.NOT_FINITE, iterations)
        presentable = _presentable(e, options)
        if e.error <= options.tol and verdict.admissible and presentable:
            return Solved(t, solution, setting, e, Status.CONVERGED, iterations)
        note = f"error estimate {e.error:.2g}"
        if verdict.unclear.any():
            note += f"; whether each phase is what it should be is not clear on {verdict.unclear.sum()} intervals"
        accepted = Solved(t, solution, setting, e, Status.TOLERANCE_NOT_REACHED, iterations, note)
        if e.error <= options.tol and presentable:
            breaks = quartered_where(t, setting.fractions, verdict.unclear)
        else:
            breaks = better_breaks(t, setting.fractions, e, options.tol, changes)
            changes += 1
        if sum(b.size - 1 for b in breaks) > MAX_INTERVALS:
            return accepted
        t, setting, solution = _on_mesh(accepted, breaks, border, options)
        if not solution.status.ok:
            # A mesh that moves too much at once can lose the solution; cutting every interval seldom does.
            changes = len(COARSENING)
            breaks = halved(phase_breaks(accepted.t, accepted.setting.fractions))
            t, setting, solution = _on_mesh(accepted, breaks, border, options)
        if not solution.status.ok and not marched:
            # What both meshes show may be too coarse a picture of the motion: look at the motion itself.
            marched = True
            moved = accepted.setting.moved(accepted.solution.parameter)
            again = problem.remarch(accepted.t, accepted.solution.u, moved)
            if again is not None:
                t, u, fresh = again
                setting = replace(fresh, p=accepted.setting.p)
                solution = _correct(t, u, setting, border, "newton", accepted.solution.parameter, options)
    return accepted or Solved(t, solution, setting, None, Status.INADMISSIBLE, iterations)


def remeshed(start: Start, options: Options) -> Start:
    """A marched motion on a mesh for the tolerance, before anything is solved.

    A march solves the equations of every interval; the estimate of what each is to blame for does not need the
    closure to hold.
    """
    t, u, setting = start
    e = estimate(t, u, setting, believed=0.0)
    if not np.isfinite(e.indicators).all() or float(e.indicators.sum()) <= options.tol and _presentable(e, options):
        return start
    t, u, fractions = transfer(t, u, setting.fractions, better_breaks(t, setting.fractions, e, MOTION * options.tol))
    return t, u, replace(setting, fractions=fractions)


def _presentable(e: Estimate, options: Options) -> bool:
    """The solution may be shown between its nodes."""
    return float(e.shape.max()) <= ROUGH * shape_limit(options.tol)


def _on_mesh(
    known: Solved, breaks: list[Array], border: Array | None, options: Options
) -> tuple[Transcription, Setting, Solution]:
    """A solution carried to another mesh and corrected there."""
    t, u, fractions = transfer(known.t, known.solution.u, known.setting.fractions, breaks)
    setting = replace(known.setting, fractions=fractions)
    return t, setting, _correct(t, u, setting, border, "newton", known.solution.parameter, options)


def curve_border(t: Transcription, u: Array, weights: Array) -> Array:
    """The border row of the node system with weights (n + 2,) on (x_0, ln T_1, lambda); see continuation/curve.py."""
    nodes, durations = np.zeros((t.phases + 1, t.n)), np.zeros(t.phases)
    nodes[0] = weights[: t.n]
    durations[0] = weights[t.n] / t.durations_of(u)[0]
    return t.system.border(nodes=nodes, durations=durations, parameter=float(weights[-1]))


def _correct(
    t: Transcription,
    u: Array,
    setting: Setting,
    border: Array | None,
    solver: Solver,
    parameter: float,
    options: Options,
) -> Solution:
    """One solve, by the solver that the user named, alone; by `auto`, with `solver` first and then the other."""
    row = None if border is None else curve_border(t, u, border)
    accuracy = LEFT_OUT * options.tol
    if options.solver != "auto" or row is not None:
        alone: Solver = "newton" if options.solver == "auto" else options.solver
        return solve(t, u, setting, solver=alone, border=row, parameter=parameter, accuracy=accuracy)
    first = ipopt_then_newton(t, u, setting) if solver == "ipopt" else newton(t, u, setting, accuracy=accuracy)
    if not first.status.ok:
        again = ipopt_then_newton(t, u, setting) if solver == "newton" else newton(t, u, setting, accuracy=accuracy)
        if again.status.ok:
            return again
    return first


def _first_converging(
    starts: list[Start], setting: Setting, border: Array | None, parameter: float, options: Options
) -> tuple[Transcription, Setting, Solution] | None:
    """The first of several starting points from which the solver converges, by `auto` Newton's method."""
    solver: Solver = "newton" if options.solver == "auto" else options.solver
    for t, u, moved in starts:
        fresh = replace(moved, p=setting.p)
        row = None if border is None else curve_border(t, u, border)
        solution = solve(
            t, u, fresh, solver=solver, border=row, parameter=parameter, accuracy=LEFT_OUT * options.tol
        )
        if solution.status.ok:
            return t, fresh, solution
    return None


def finished(solved: Solved, problem: Problem, options: Options, began: float, what: str) -> Any:
    """The orbit of a converged `Solved`, or NoOrbit with the advice."""
    if not solved.status.ok or solved.estimate is None:
        alone = "" if options.solver == "auto" else f"; {options.solver} worked alone, the solver auto tries both"
        at = f"{problem.principal} {problem.value(problem.principal):g}"
        sentence = f"{what} of {problem.title} at {at} was not computed: {solved.complaint()}{alone}"
        raise NoOrbit(sentence, solved.status)
    return orbit_of(solved, problem, wall_s=time.perf_counter() - began)


def refined(orbit: AnyOrbit, options: Options) -> AnyOrbit:
    """The same orbit to another tolerance.  Raises NoOrbit where it is not reached."""
    began = time.perf_counter()
    solved = solve_adaptively(orbit.problem, unknowns_of(orbit), options, solver="newton")
    return finished(solved, orbit.problem, options, began, "the cycle")
