"""Cycles of many problems near one whose cycle is known, all at once, each at its own parameters.

    u(q) ~ u_0 + sum_i du/dl_i (l_i - l_i0),    l = ln q (q itself where q_0 is not positive), ln T for the durations

    expected -> Newton for all, who is done leaves the batch -> judged, error estimated -> "batch"
                        |                                        | other phases, or another mesh
                        | far off, or behind a fold              v
                        |                         solve_adaptively from there (adapt.py) -> "recut"
                        v                                        | behind a fold
     alone, from nothing of the batch  <-------------------------+

The derivatives are those of the equations, exact.  What Newton's method finds far from where it was expected, or on the
other side of a fold than the known cycle (fold_side.py), is not the member's cycle.  A member's numbers depend on the
member and on the known cycle alone (collocation/ensemble.py).

Symbols: B members, k parameters that differ, y unknowns of the node system.

Leading multipliers of the members: one Newton step on the mesh with halved intervals, compared with those of the own
mesh.  Those that are not sure after that, or too large to be, are left to meshes of their own.  One mesh for all takes
1.05 ms a member (7 intervals, 3 states) where meshes of their own take 1.36, and in a batch a member's last bits depend
on the others.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from ..collocation.admissibility import admissible_many
from ..collocation.error_estimate import functional_errors, on_halves
from ..collocation.newton import DIVERGED, LARGEST_MOVE, MOST_NEWTON_STEPS
from ..collocation.transcription import Setting, Transcription, settings_of
from ..effort import MEMBERS_OF_A_PASS, ROWS_OF_A_TASK
from ..errors import NoOrbit, Status
from ..hybrid.problem import Problem
from ..results import Rows, table_of
from . import floquet
from .adapt import LEFT_OUT, Options, finished, refined, solve_adaptively
from .amplitude import goals_of_many
from .fold_side import Side, odd_beyond_one, side_of
from .map_chain import collocation_chain
from .multiplier_mesh import LARGE_MULTIPLIER
from .orbit import Orbit, unknowns_of
from .restart import Start

Array = np.ndarray

ROOM_FOR_KNOWN = 0.1
"""Part of the tolerance that the known cycle's own error may take, so that those of its neighbours fit in."""


def leading_of_many(t: Transcription, u: Array, settings: Setting) -> tuple[Array, Array]:
    """The leading nontrivial multipliers of many cycles.

    t, u, settings: transcription, (B, size) solutions, and settings.
    Returns (B,) complex, as `Multipliers.leading`, and (B,) errors, as `Multipliers.error`; nan where not trusted here.
    """
    B = len(u)
    fine, finer, halves, lin = on_halves(t, u, settings)
    finer = finer + lin.step(np.repeat(fine.system.border(parameter=1.0)[None], B, axis=0))[0]
    lin, own = fine.linearise(finer, halves), t.linearise(u, settings)
    leading, errors = np.full(B, complex(np.nan, np.nan)), np.full(B, np.nan)
    for b in np.flatnonzero(np.isfinite(finer).all(axis=1) & lin.finite()).tolist():
        exact = collocation_chain(fine, finer[b], halves.of(b), lin.one(b))
        found = floquet.chain_multipliers(exact, fine.cycle.repeats)
        rough, _ = floquet.rough_multipliers(collocation_chain(t, u[b], settings.of(b), own.one(b)), found.frame)
        found = floquet.compared(found, rough)
        if found.trusted and abs(found.leading) < LARGE_MULTIPLIER:
            leading[b], errors[b] = found.leading, found.error
    return leading, errors


@dataclass(frozen=True, eq=False, repr=False)
class OrbitEnsemble(Rows):
    """The cycles of n problems.

    Attributes
    ----------
    title : of the problem.
    names : the k parameters in which they differ.
    parameters : (n, k) their values.
    periods, period_errors, amplitudes, amplitude_errors : (n,), nan where there is none; errors relative.
    multipliers, multiplier_errors : (n,) complex leading nontrivial multipliers, each that of the map of its computed
        piece as `Orbit.multipliers.leading` (of half a period where half a period was computed), and their estimated
        errors, relative above 1 in size; nan where they are not trusted, or there is no cycle.  (0,) where they were
        not asked for.
    statuses : of each; None where a refusal has none.
    how : "batch"; "recut" where its cycle has other phases, or needs a mesh of its own; "alone" where it was looked for
        without the batch.
    failures : (index, sentence) of every cycle that was not computed.

    Examples
    --------
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle, orbit_ensemble
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> found = orbit_ensemble(orbit, ["a", "r"], [[0.0118, 0.8], [0.012, 0.79]])
    >>> found.how, [f"{period:.6f}" for period in found.periods]
    (('batch', 'batch'), ['0.314159', '0.314159'])
    """

    title: str
    names: tuple[str, ...]
    parameters: Array
    periods: Array
    period_errors: Array
    amplitudes: Array
    amplitude_errors: Array
    multipliers: Array
    multiplier_errors: Array
    statuses: tuple[Status | None, ...]
    how: tuple[str, ...]
    failures: tuple[tuple[int, str], ...]

    def __len__(self) -> int:
        return len(self.periods)

    def __repr__(self) -> str:
        found = self.periods[np.isfinite(self.periods)]
        between = f", periods {found.min():.6g} to {found.max():.6g}" if found.size else ""
        alone, lost = self.how.count("alone"), len(self.failures)
        return f"<cycles of {len(self)} times {self.title}{between}: {alone} alone, {lost} not computed>"


@dataclass(frozen=True, eq=False)
class _OrbitTask:
    """A batch, for whoever computes it."""

    orbit: Orbit
    side: Side
    names: tuple[str, ...]
    rows: Array
    options: Options
    multipliers: bool
    alone: Callable[[Problem, Options], Any] | None


@dataclass(frozen=True, eq=False)
class _OrbitBatch:
    """numbers (4, n): period, amplitude, each with its error; leading (2, n): the multiplier, its error; the words."""

    numbers: Array
    leading: Array
    statuses: list[Status | None]
    how: list[str]
    sentences: list[str]


def orbit_ensemble(
    orbit: Orbit,
    names: Sequence[str],
    rows: Array,
    *,
    options: Options | None = None,
    multipliers: bool = False,
    executor: Executor | None = None,
    report: Callable[[int], None] | None = None,
    alone: Callable[[Problem, Options], Any] | None = None,
) -> OrbitEnsemble:
    """The cycles of problems that differ from one in some parameters.

    Parameters
    ----------
    orbit
        the known cycle.
    names, rows
        k parameters of its problem, and (n, k) values of them.
    options
        `tol` bounds the relative errors of period and amplitude of every cycle.
    multipliers
        the leading multiplier of each as well.
    executor
        any concurrent.futures.Executor, to which batches are handed; default: this process.
    report
        called with the number of cycles computed so far, batch after batch.
    alone
        how the cycle of a problem is found that the batch does not lead to; default from the known cycle.

    Returns
    -------
    OrbitEnsemble; a member's numbers depend neither on the executor nor on the other rows.

    Raises
    ------
    InputError : an unknown parameter, a table of another shape, or values that the problem cannot have.
    NoOrbit : the known cycle is not known to the tolerance, and could not be computed to it.

    Examples
    --------
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle, orbit_ensemble
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> list(orbit_ensemble(orbit, ["r"], [[0.79], [0.81]]).to_dict()["table"])[:3]
    ['r', 'period', 'period_error']
    """
    names, options = tuple(names), options or Options()
    problem = orbit.problem
    table = table_of(names, rows, problem.names, partial(problem.with_values, names))
    fine = options.finer(ROOM_FOR_KNOWN)
    sharp = orbit if orbit.error_estimate <= fine.tol else refined(orbit, fine)
    side = side_of(*unknowns_of(sharp))
    batches = [table[i : i + ROWS_OF_A_TASK] for i in range(0, len(table), ROWS_OF_A_TASK)]
    tasks = [_OrbitTask(sharp, side, names, batch, options, multipliers, alone) for batch in batches]
    parts: list[_OrbitBatch] = []
    for part in map(solve_orbit_task, tasks) if executor is None else executor.map(solve_orbit_task, tasks):
        parts.append(part)
        if report is not None:
            report(sum(len(p.how) for p in parts))
    # The batches as one
    numbers = np.concatenate([np.zeros((4, 0)), *(part.numbers for part in parts)], axis=1)
    leading = np.concatenate([np.zeros((2, 0), complex), *(part.leading for part in parts)], axis=1)
    leading = leading if multipliers else np.zeros((2, 0), complex)
    statuses, how, sentences = (
        tuple(x for part in parts for x in getattr(part, name)) for name in ("statuses", "how", "sentences")
    )
    failures = tuple((i, sentence) for i, sentence in enumerate(sentences) if sentence)
    period, period_error, amplitude, amplitude_error = numbers
    return OrbitEnsemble(
        orbit.problem.title, names, table, period, period_error, amplitude, amplitude_error, leading[0],
        leading[1].real, statuses, how, failures,
    )  # fmt: skip


def solve_orbit_task(task: _OrbitTask) -> _OrbitBatch:
    """The cycles of a batch; a function of the batch alone, whoever computes it."""
    n = len(task.rows)
    unknown = complex(np.nan, np.nan)
    done = _OrbitBatch(np.full((4, n), np.nan), np.full((2, n), unknown), [None] * n, ["alone"] * n, [""] * n)
    for first in range(0, n, MEMBERS_OF_A_PASS):
        _pass(task, np.arange(first, min(first + MEMBERS_OF_A_PASS, n)), done)
    return done


def _pass(task: _OrbitTask, rows: Array, done: _OrbitBatch) -> None:
    """The cycles of a few rows, written into `done`."""
    problem, tol = task.orbit.problem, task.options.tol
    t, u, setting = unknowns_of(task.orbit)
    p = np.repeat(setting.p[None], rows.size, axis=0)
    p[:, [problem.names.index(name) for name in task.names]] = task.rows[rows]
    settings = settings_of(setting, p, np.zeros_like(p))
    start = _expected(task, p)
    u, converged = newton_of_many(t, start, settings, tol, task.side)
    there = np.flatnonzero(converged)
    if there.size:
        own, x = settings.of(there), u[there]
        goals, period, amplitude = goals_of_many(t, x, own)
        errors, _, better = functional_errors(t, x, own, goals)
        assert better is not None
        motions = admissible_many(t, x, own) & admissible_many(*better)
        for i in np.flatnonzero((errors.max(axis=1) <= tol) & motions):
            row = rows[there[i]]
            done.numbers[:4, row] = period[i], errors[i, 0], amplitude[i], errors[i, 1]
            done.statuses[row], done.how[row] = Status.CONVERGED, "batch"
        kept = [i for i, b in enumerate(there.tolist()) if done.how[rows[b]] == "batch"]
        if task.multipliers and kept:
            done.leading[:, rows[there[kept]]] = leading_of_many(t, x[kept], settings.of(there[kept]))
    for b, row in enumerate(rows):
        left_over = task.multipliers and np.isnan(done.leading[0, row])
        if done.how[row] == "alone" or left_over:
            _one(task, row, (t, u[b], settings.of(b)) if converged[b] else None, done)


def _one(task: _OrbitTask, row: int, root: Any, done: _OrbitBatch) -> None:
    """The cycle of one row, from the batch's root where it has one, or alone."""
    problem = task.orbit.problem.with_values(task.names, task.rows[row])
    orbit, how = None, done.how[row]
    if root is not None:
        with suppress(NoOrbit):
            orbit = _on_its_side(task, problem, root)
            how = "batch" if how == "batch" else "recut"
    if orbit is None:
        if how == "batch":
            return  # its multipliers alone are not known
        try:
            orbit = (task.alone or _from_known(task))(problem, task.options)
        except NoOrbit as error:
            done.statuses[row], done.sentences[row] = error.status, str(error)
            return
    if how != "batch":
        done.numbers[:, row] = orbit.period, orbit.period_error, orbit.amplitude, orbit.amplitude_error
    if task.multipliers and orbit.multipliers.trusted:
        done.leading[:, row] = orbit.multipliers.leading, orbit.multipliers.error
    done.statuses[row], done.how[row] = Status.CONVERGED, how


def _on_its_side(task: _OrbitTask, problem: Problem, start: Start) -> Any:
    """The cycle that a start leads to, on the known cycle's side of a fold.

    Raises NoOrbit: none, or one on the other side.
    """
    solved = solve_adaptively(problem, start, task.options, solver="newton")
    orbit = finished(solved, problem, task.options, 0.0, "the cycle")
    if odd_beyond_one(solved.t, solved.solution.u, solved.setting, solved.solution.linearisation) != task.side.odd:
        sentence = f"the cycle of {problem.title} that was found lies on the other side of a fold than the known one"
        raise NoOrbit(sentence, Status.FAR_FROM_GUESS)
    return orbit


def _from_known(task: _OrbitTask) -> Callable[[Problem, Options], Any]:
    """Finds a cycle from the known one, whatever solver it takes."""

    def find(problem: Problem, options: Options) -> Any:
        t, u, setting = unknowns_of(task.orbit)
        return _on_its_side(task, problem, (t, u, replace(setting, p=problem.vector())))

    return find


def _expected(task: _OrbitTask, p: Array) -> Array:
    """(B, size) unknowns expected at parameters p (B, np), by the exact derivatives of the known cycle."""
    t, u, setting = unknowns_of(task.orbit)
    at = [task.orbit.problem.names.index(name) for name in task.names]
    own = setting.p[at]
    units = np.where(own > 0, own, 1.0)
    along = np.zeros((len(at), setting.p.size))
    along[np.arange(len(at)), at] = units
    logarithmic = (own > 0) & (p[:, at] > 0)
    ratios = np.where(logarithmic, p[:, at], units) / units
    ways = np.where(logarithmic, np.log(ratios), (p[:, at] - own) / units)
    change = np.zeros((len(p), t.size))
    for way, response in zip(ways.T, t.responses(u, setting, along), strict=True):
        change += way[:, None] * response  # in turn, so that no sum depends on how many members there are
    out = u + change
    longer = change[:, -t.phases :] / u[-t.phases :]
    out[:, -t.phases :] = u[-t.phases :] * np.exp(np.clip(longer, -1.0, 1.0))
    return out


def newton_of_many(t: Transcription, u: Array, settings: Setting, tol: float, side: Side) -> tuple[Array, Array]:
    """Newton's method for many members at fixed parameters; who is done leaves the batch.

    t, u, settings: the equations, and (B, size) starts; tol: relative error that is wanted; what a next step would
    bring is a small part of it; side: the side of a fold on which they must lie.
    Returns ((B, size) unknowns, (B,) whether they solve the equations, close to their start and on that side).
    """
    start, u, active = u, u.copy(), np.arange(len(u))
    converged, last = np.zeros(len(u), dtype=bool), np.full(len(u), np.inf)
    for iteration in range(MOST_NEWTON_STEPS):
        if not active.size:
            break
        lin = t.linearise(u[active], settings.of(active))
        rhs = np.stack([lin.rhs(), np.broadcast_to(side.right, (active.size, t.system.size))], axis=1)
        fixed = np.repeat(t.system.border(parameter=1.0)[None], active.size, axis=0)  # rows that hold lambda
        y = t.system.solve(lin.matrix(fixed), rhs)
        du = lin.expand(y[:, 0], 1.0)
        with np.errstate(all="ignore"):
            size = sizes_of_steps(t, u[active], du)
            u[active] += du
            foreseen = np.where(last[active] < np.inf, size * (size / last[active]), np.inf)
        sound = np.isfinite(size) & lin.finite() & (size <= DIVERGED) & (u[active][:, -t.phases :] > 0).all(axis=1)
        done = sound & (foreseen <= LEFT_OUT * tol)
        grows = (iteration > 2) & (size > 2 * last[active])
        last[active] = size
        near = np.abs(t.nodes_of(u[active] - start[active])).reshape(active.size, -1).max(axis=1) <= LARGEST_MOVE
        converged[active[done & near & side.holds(y[:, 1])]] = True
        active = active[sound & ~done & ~grows]
    return u, converged


def sizes_of_steps(t: Transcription, u: Array, du: Array) -> Array:
    """How large updates of the unknowns are, as `newton.size_of_step`.

    u, du: (B, size) unknowns and their updates. Returns (B,) the largest; NaN stays NaN.
    """
    relative = np.abs(du[:, -t.phases :]) / np.maximum(np.abs(u[:, -t.phases :]), 1e-300)
    return np.maximum(np.abs(du[:, : -t.phases]).max(axis=1), relative.max(axis=1))
