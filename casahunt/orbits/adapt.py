"""Solve, estimate the error, place the mesh anew, check the phases, until the tolerance holds.

    solve -> judge ------------> estimate -> within tol and clear? -> done
      ^        | not a motion       | no
      |        v                    v
      +-- next phase sequence   better mesh --> Newton --+
      +--------------------------------------------------+

`solve_adaptively` is the loop, the functions after it are its boxes.  It works at a fixed parameter, with the parameter
free under a border row (continuation), or where the parameter is extremal along that row (folds).
"""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..collocation.admissibility import Admissibility, check_admissible, judged_on_halves, stands_still
from ..collocation.error_estimate import Estimate
from ..collocation.ipopt import ipopt_then_newton, solve
from ..collocation.mesh import halved, phase_breaks, quartered_where, shape, transfer
from ..collocation.newton import Solution, Solver, newton, size_of_step
from ..collocation.remesh import COARSENING, better_breaks, shape_limit
from ..collocation.transcription import Setting, Transcription
from ..errors import NoOrbit, Status
from ..hybrid.problem import Problem
from .amplitude import estimated, measured
from .bordering import Options, curve_border, with_other_phases
from .orbit import AnyOrbit, SolvedOrbit, orbit_of, unknowns_of
from .restart import Start
from .sequences import split
from .simulated_phases import expected, marched, other_sequences

Array = np.ndarray

MAX_INTERVALS = 3000
MAX_ROUNDS = 24
MAX_SEQUENCES = 5
AS_WRONG = 0.02
"""Relative change of what a condition falls to, below which other phases have left it as wrong as it was."""
ROUGH_SHAPE = 3.0
"""A mesh is kept while its Legendre coefficients are within this factor of their limit."""
PROVISIONAL = 0.1
"""Part of the tolerance of a provisional orbit that its next Newton step is let to be."""
LEFT_OUT = 0.01
"""Newton leaves out a step smaller than this part of the tolerance; the estimate sees what that leaves."""

GLANCE = 1e-5
"""Linearisations from so close to a solution tell which way a branch goes on, and whether a cycle is clearly stable."""


def solve_adaptively(
    problem: Problem,
    start: Start,
    options: Options,
    *,
    solver: Solver,
    border: Array | None = None,
    bend: float | None = None,
    soft: bool = True,
) -> SolvedOrbit:
    """Solve from `start` and adapt mesh and phase sequence until the tolerance holds.

    problem: whose cycle it is, and whose phase sequences are sought where one stops being a motion; solver: for the
    first solve of `auto`, which takes Newton after that, and the other one where the first fails at a fixed parameter.
    A solver named in `options` makes all the solves, alone; border: weights (n + 2,) of the first node, of ln T_1 and
    of lambda; the correction is orthogonal to them and lambda is free.  None holds lambda at zero; bend: with a border
    row along the curve, sought is the extremum of lambda; about d2 lambda/d a2 there, as of a `Turn`; soft: allow last
    resorts among the phase sequences (other_sequences). Returns Solved, whose status says how it ended. Raises
    ValueError: the cycle of `start` is none of the problem's.
    """
    t = start[0]
    if t.cycle != problem.cycle(t.cycle.signature, t.cycle.repeats):
        raise ValueError(f"the {t.cycle.name} to be solved is no cycle of {problem.title}")
    task, spent = _Adaptation(problem, options, border, bend, soft), _Spent()
    root = _corrected(task, start, solver)
    spent.off = size_of_step(t, start[1], root.solution.u - start[1])
    found = _adapted(task, root, spent)
    while found.status.ok and spent.barely >= 0 and (other := _with_passed_event(task, found, spent)) is not None:
        found = other
    return found


def first_solved(problem: Problem, starts: Iterable[Start], options: Options, **how: Any) -> SolvedOrbit:
    """The solution from the first of some starting points that leads to one; where none does, how that one ended.

    starts: one at least; how: as of `solve_adaptively`.
    """
    failed: SolvedOrbit | None = None
    for start in starts:
        solved = solve_adaptively(problem, start, options, **how)
        if solved.status.ok:
            return solved
        failed = failed or solved
    assert failed is not None
    return failed


def or_expected(problem: Problem, start: Start) -> Iterator[Start]:
    """A starting point, and those with the other phases that the problem expects there."""
    yield start
    for other in expected(problem.asked(), start):
        if other[0].cycle != start[0].cycle:
            yield other


def _adapted(task: _Adaptation, root: _Root, spent: _Spent) -> SolvedOrbit:
    """The loop."""
    accepted: SolvedOrbit | None = None
    spent.wrong = "", np.nan
    for _ in range(MAX_ROUNDS):
        spent.iterations += root.solution.iterations
        if not root.solution.status.ok:
            return accepted or root.ended(root.solution.status, spent)
        if stands_still(root.t, root.solution.u):
            return root.ended(Status.INADMISSIBLE, spent, "nothing moves: it is an equilibrium, and no cycle")
        verdict = check_admissible(root.t, root.solution.u, root.moved)
        spent.barely = verdict.barely
        if verdict.violated:
            # A root with other phases, where one of these has stopped being a motion, and what it is a root of
            spent.sequences += 1
            (before, lowest), mode = spent.wrong, root.t.cycle.phases[verdict.phase].mode.name
            as_wrong = mode == before and abs(verdict.lowest - lowest) <= AS_WRONG * abs(lowest)
            # a wrong root stays one, whatever short phase it is relieved of
            if spent.sequences > MAX_SEQUENCES or as_wrong:
                following = None
            else:
                spent.changes, spent.wrong = 0, (mode, verdict.lowest)
                posed, wrong = task.problem.asked(), (root.t, root.solution.u, root.moved)
                starts = other_sequences(posed, wrong, verdict.phase, soft=task.soft)
                following = _first_converging(task, starts, root)
            if following is None:
                return root.ended(Status.INADMISSIBLE, spent, verdict.violated)
            (task, root), accepted = following, None
            continue
        accepted, verdict = _estimated(task, root, verdict, spent)
        if accepted.status is not Status.TOLERANCE_NOT_REACHED:
            return accepted
        # Breaks for the tolerance; where it holds already, shorter intervals where it is not clear what a phase is
        e, tol = accepted.estimate, task.options.tol
        assert e is not None
        if e.error <= tol and presentable(e, task.options):
            breaks = quartered_where(accepted.t, accepted.setting.fractions, verdict.unclear)
        else:
            breaks = better_breaks(accepted.t, accepted.setting.fractions, e, tol, spent.changes)
            spent.changes += 1
        if sum(b.size - 1 for b in breaks) > MAX_INTERVALS:
            return accepted
        root = _on_better_mesh(task, accepted, breaks, spent)
    return accepted or root.ended(Status.INADMISSIBLE, spent)


@dataclass(frozen=True, eq=False)
class _Adaptation:
    """What stays the same in the loop: the arguments of `solve_adaptively`."""

    problem: Problem
    options: Options
    border: Array | None
    bend: float | None
    soft: bool


@dataclass
class _Spent:
    """What the loop has used up: Newton steps, phase sequences, changes of the mesh since the last one, the march.

    And which phase of its last root passes an event by less than counts (Verdict.barely), and the mode whose condition
    failed on the last root that was no motion, with what it fell to.
    """

    iterations: int = 0
    sequences: int = 0
    changes: int = 0
    marched: bool = False
    barely: int = -1
    wrong: tuple[str, float] = "", np.nan
    off: float = np.inf  # as of `SolvedOrbit`


@dataclass(frozen=True, eq=False)
class _Root:
    """Where a solve has ended."""

    t: Transcription
    setting: Setting
    solution: Solution

    @property
    def moved(self) -> Setting:
        """The setting at the parameter that was found."""
        return self.setting.moved(self.solution.parameter)

    def ended(self, status: Status, spent: _Spent, note: str = "") -> SolvedOrbit:
        """The end of the loop, without an error estimate."""
        return SolvedOrbit(self.t, self.solution, self.setting, None, status, spent.iterations, note)


def _with_passed_event(task: _Adaptation, known: SolvedOrbit, spent: _Spent) -> SolvedOrbit | None:
    """A solution that passes an event by little, with boundaries there, where there is such a one.

    By less than counts, so that a grazing contact is not taken for another motion.  But a motion that has passed the
    event goes on in the other mode, and differs from this one by more and more; on a branch the first step that is too
    far would find nothing to go on with.
    """
    spent.sequences += 1
    phase, root, posed = spent.barely, _Root(known.t, known.setting, known.solution), task.problem.asked()
    if spent.sequences > MAX_SEQUENCES or posed is None:
        return None
    for fine in (False, True):  # on shorter intervals the polynomials are cut more exactly
        if fine:
            root = _on_mesh(task, known, halved(phase_breaks(known.t, known.setting.fractions)))
        start = split(posed, (root.t, root.solution.u, root.moved), phase) if root.solution.status.ok else None
        cut = None if start is None else _first_converging(task, [start], root)
        found = None if cut is None else _adapted(*cut, spent)
        if found is not None and found.status.ok:
            return found
    return None


def _estimated(
    task: _Adaptation, root: _Root, verdict: Admissibility, spent: _Spent
) -> tuple[SolvedOrbit, Admissibility]:
    """A root with its error: within the tolerance and clear, or what is missing; what its halves say put in."""
    t, u, tol = root.t, root.solution.u, task.options.tol
    row = None if task.border is None else curve_border(t, u, task.border)
    if task.options.provisional and verdict.admissible:
        # What is known of the errors of a solution where they are not estimated
        of_parameter = 0.0 if row is None else np.inf
        e = Estimate(np.inf, np.inf, of_parameter, np.zeros(t.intervals), shape(t, u), measured(t, u, root.moved))
        if presentable(e, task.options):
            return _accepted(task, root, e, spent), verdict
    e = estimated(t, u, root.moved, border=row, accepted=tol)
    if not np.isfinite(e.error):
        return root.ended(Status.NOT_FINITE, spent), verdict
    if e.error <= tol and verdict.admissible and presentable(e, task.options):
        verdict = judged_on_halves(t, verdict, e.better)
        spent.barely = verdict.barely
        if verdict.admissible:
            return _accepted(task, root, e, spent), verdict
    note = f"error estimate {e.error:.2g}"
    if verdict.unclear.any():
        note += f"; whether each phase is what it should be is not clear on {verdict.unclear.sum()} intervals"
    return SolvedOrbit(t, root.solution, root.setting, e, Status.TOLERANCE_NOT_REACHED, spent.iterations, note), verdict


def _accepted(task: _Adaptation, root: _Root, e: Estimate, spent: _Spent) -> SolvedOrbit:
    """A root that is an answer."""
    status, border = Status.CONVERGED, task.border
    return SolvedOrbit(root.t, root.solution, root.setting, e, status, spent.iterations, off=spent.off, border=border)


def _on_better_mesh(task: _Adaptation, known: SolvedOrbit, breaks: list[Array], spent: _Spent) -> _Root:
    """The solution corrected on another mesh, by way of the halved one or of a march where it is lost there."""
    root = _on_mesh(task, known, breaks)
    if not root.solution.status.ok:
        # A mesh that moves too much at once can lose the solution; cutting every interval seldom does.
        spent.changes = len(COARSENING)
        root = _on_mesh(task, known, halved(phase_breaks(known.t, known.setting.fractions)))
    if not root.solution.status.ok and not spent.marched and (posed := task.problem.asked()) is not None:
        # What both meshes show may be too coarse a picture of the motion: look at the motion itself.
        spent.marched = True
        moved = known.setting.moved(known.solution.parameter)
        for t, u, fresh in marched(posed, (known.t, known.solution.u, moved))[:1]:
            root = _corrected(task, (t, u, replace(fresh, p=known.setting.p)), "newton", known.solution)
    return root


def on_breaks(start: Start, breaks: list[Array]) -> Start:
    """A start on another mesh.

    start, breaks: transcription, unknowns and setting; boundaries of each collocated phase.
    """
    t, u, setting = start
    t, u, fractions = transfer(t, u, setting.fractions, breaks)
    return t, u, replace(setting, fractions=fractions)


def presentable(e: Estimate, options: Options) -> bool:
    """Whether a solution may be shown between its nodes.

    Returns True where its last Legendre coefficients are small enough.
    """
    return float(e.shape.max(initial=0.0)) <= ROUGH_SHAPE * shape_limit(options.tol)


def _on_mesh(task: _Adaptation, known: SolvedOrbit, breaks: list[Array]) -> _Root:
    """A solution carried to another mesh and corrected there."""
    found = known.solution
    return _corrected(task, on_breaks((known.t, found.u, known.setting), breaks), "newton", found)


def _corrected(task: _Adaptation, start: Start, solver: Solver, known: Solution | None = None) -> _Root:
    """One solve, by the solver that the user named, alone; by `auto`, with `solver` first and then the other."""
    if task.options.solver != "auto" or task.border is not None:
        return _solved_alone(task, start, known)
    found, accuracy = [], LEFT_OUT * task.options.tol
    for one in (solver, "newton" if solver == "ipopt" else "ipopt"):
        found.append(ipopt_then_newton(*start) if one == "ipopt" else newton(*start, accuracy=accuracy, nearby=GLANCE))
        if found[-1].status.ok:
            return _Root(start[0], start[2], found[-1])
    return _Root(start[0], start[2], found[0])


def _solved_alone(task: _Adaptation, start: Start, known: Solution | None) -> _Root:
    """One solve by one solver, under the border row: the one that the user named, by `auto` Newton's method.

    known: of another mesh, with lambda and, of an extremum, how the curve bends.
    """
    t, u, setting = start
    row = None if task.border is None else curve_border(t, u, task.border)
    solver, tol = "newton" if task.options.solver == "auto" else task.options.solver, task.options.tol
    parameter, bend = (0.0, task.bend) if known is None else (known.parameter, known.bend)
    found = solve(
        t, u, setting, solver=solver, border=row, parameter=parameter, accuracy=LEFT_OUT * tol,
        rough=PROVISIONAL * tol if task.options.provisional else 0.0, nearby=GLANCE, bend=bend,
    )  # fmt: skip
    return _Root(t, setting, found)


def _first_converging(task: _Adaptation, starts: Iterable[Start], known: _Root) -> tuple[_Adaptation, _Root] | None:
    """The root from the first of several starting points from which the solver converges, and the task for them."""
    first = float(known.t.durations_of(known.solution.u)[0])
    for t, u, moved in starts:
        there = task
        if task.border is not None:
            there = replace(task, border=with_other_phases(task.border, first, float(t.durations_of(u)[0])))
        root = _solved_alone(there, (t, u, replace(moved, p=known.setting.p)), known.solution)
        if root.solution.status.ok:
            return there, root
    return None


def finished(solved: SolvedOrbit, problem: Problem, options: Options, began: float, what: str) -> Any:
    """The orbit of a converged solution.

    problem: with the parameters at which the equations were solved; began: time.perf_counter() at that time; what: what
    was to be computed, for the message. Returns Orbit, of the class that the problem names. Raises NoOrbit: it has not
    converged; the message says what to do.
    """
    if not solved.status.ok or solved.estimate is None:
        alone = "" if options.solver == "auto" else f"; {options.solver} worked alone, the solver auto tries both"
        at = f" at {problem.principal} {problem.value(problem.principal):g}" if problem.names else ""
        sentence = f"{what} of {problem.title}{at} was not computed: {solved.complaint()}{alone}"
        raise NoOrbit(sentence, solved.status)
    return orbit_of(solved, problem, wall_s=time.perf_counter() - began)


def refined(orbit: AnyOrbit, options: Options, *, at: Mapping[str, float] | None = None) -> AnyOrbit:
    """The same orbit to another tolerance, or the one that it becomes where parameters change a little.

    Parameters
    ----------
    orbit
        the orbit.
    options
        the tolerance, and the method.
    at
        new values of some parameters; Newton's method starts from where the derivatives of the orbit by them lead, and
        where that fails from the orbit as it is.

    Returns
    -------
    Orbit, of the class of the given one.

    Raises
    ------
    NoOrbit : the tolerance is not reached.
    InputError : the problem cannot have these values.

    Examples
    --------
    >>> from casahunt.hybrid.examples import belt
    >>> from casahunt.orbits import Options, find_cycle, refined
    >>> orbit = find_cycle(belt, "slip", x=0.0, v=0.0)
    >>> refined(orbit, Options(tol=1e-10)).error_estimate < 1e-10
    True
    >>> round(refined(orbit, Options(), at={"belt": 0.21}).period, 3)
    11.712
    """
    began, values = time.perf_counter(), dict(at or {})
    problem = orbit.problem.with_values(tuple(values), np.array(list(values.values()))) if values else orbit.problem
    t, u, setting = unknowns_of(orbit)
    there = replace(setting, p=problem.vector())
    if values:
        way = replace(setting, dp=problem.vector() - setting.p)
        ahead = u + t.linearise(u, way).tangent(t.system.border(parameter=1.0))[0]
        with suppress(NoOrbit):
            solved = first_solved(problem, or_expected(problem, (t, ahead, there)), options, solver="newton")
            return finished(solved, problem, options, began, "the cycle")
    solved = solve_adaptively(problem, (t, u, there), options, solver="newton")
    return finished(solved, problem, options, began, "the cycle")
