"""Folds of many problems near one whose fold is known, all at once.

    expansion of the known fold -> where it is expected -> turning point -> confirmed, judged -> "batch"
                                                               |                 | other phases, or another mesh
                                                               |                 v
                                                               |     solved singly from there -> confirmed -> "recut"
                                                               v                                  |
                                                     nothing: left to the single way  <-----------+

The derivatives of the expansion are differences of folds at l_i +- `NEIGHBOURS_APART` (fold_expansion.py).  A member's
numbers depend on the member and on the known fold alone (collocation/ensemble.py).

Symbols: B members, k parameters that differ, n states, P phases.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ..collocation.admissibility import admissible_many
from ..collocation.error_estimate import Estimate
from ..collocation.newton import Solution as Root
from ..collocation.remesh import better_breaks
from ..collocation.transcription import Setting, Transcription, settings_of
from ..errors import InputError, NoOrbit, Status
from ..hybrid.problem import Problem
from ..orbits.adapt import Options, on_breaks, solve_adaptively
from ..orbits.amplitude import estimated
from ..orbits.border import curve_border, row_along
from ..orbits.ensemble import MEMBERS_OF_A_PASS, ROOM_FOR_KNOWN
from ..orbits.options import TOLERANCE_RANGE
from ..orbits.orbit import Orbit, Solved, orbit_of, unknowns_of
from ..orbits.restart import Start
from .curve import along
from .fold import Fold
from .fold_confirmation import confirmed_many, slopes_of_many
from .fold_expansion import Expansion, from_expansion

Array = np.ndarray
How = Literal["batch", "recut", ""]

NEIGHBOURS_APART = 1e-3
"""Distance of the neighbours from which the expansion is made, in logarithms: their differences have ten digits."""


@dataclass(frozen=True, eq=False)
class Solution:
    """A fold as the solution of its equations, on a mesh of its own or on that of others.

    Attributes
    ----------
    t, u, setting : transcription, unknowns, setting.
    row, bend : of a, the way along the curve, and d2 lambda/d a2.
    """

    t: Transcription
    u: Array
    setting: Setting
    row: Array
    bend: float

    def orbit(self, problem: Problem, numbers: Array) -> tuple[Any, float]:
        """The cycle there, and phi_s = d2 lambda/d s2 by the arclength s of curve.py.

        problem, numbers: the problem there, and its (6,) numbers: value, period, amplitude, each with its error.
        Returns Orbit, of the class that the problem names, and phi_s.
        """
        t, u, n = self.t, self.u, self.t.n
        lin = t.linearise(u, self.setting)
        du, y = lin.tangent(curve_border(t, u, self.row))
        of_s = np.append(y[:n], t.durations_of(du)[0] / t.durations_of(u)[0])
        _, parameter, _, period, measured, amplitude = map(float, numbers)
        nothing = np.zeros(t.intervals)
        estimate = Estimate(period, amplitude, parameter, nothing, nothing, measured)
        root = Root(u, 0.0, Status.CONVERGED, 0, lin.residual_norm(), None)
        solved = Solved(t, root, self.setting, estimate, Status.CONVERGED, 0)
        return orbit_of(solved, problem, wall_s=0.0), float(self.bend / (of_s @ of_s))


@dataclass(frozen=True, eq=False)
class Folds:
    """Folds of B members.

    Attributes
    ----------
    values, value_errors : (B,) of the parameter, errors relative to its unit.
    periods, period_errors, amplitudes, amplitude_errors : (B,) of the cycles there.
    statuses : one of each; only what is CONVERGED is to be trusted.
    how : "batch"; "recut" where other phases or another mesh were needed; "" where there is none.
    slopes : (B, k) d ln value/d ln q for the parameters asked for; (B, 0) where none are.
    solutions : those of the equations; None where there is none.
    """

    values: Array
    value_errors: Array
    periods: Array
    period_errors: Array
    amplitudes: Array
    amplitude_errors: Array
    statuses: tuple[Status, ...]
    how: tuple[How, ...]
    slopes: Array
    solutions: tuple[Solution | None, ...]

    @property
    def errors(self) -> Array:
        """(B,) the largest estimated relative error of value, period and amplitude."""
        return np.max([self.value_errors, self.period_errors, self.amplitude_errors], axis=0)


def expansion(fold: Fold[Any], names: tuple[str, ...], tol: float) -> Expansion:
    """A known fold, on a mesh made for it and the tolerance, and its change with parameters.

    fold, names: the fold, where its parameter is largest, and the k parameters that will differ; tol: relative error
    that its neighbours may have. Raises NoOrbit: the fold could not be solved again.
    """
    return expansion_at(fold.orbit, fold.parameter, names, tol)


def expansion_at(orbit: Orbit, vary: str, names: tuple[str, ...], tol: float) -> Expansion:
    """As `expansion`, of the orbit at a fold.

    orbit, vary: the orbit, and the parameter that is largest there; names, tol: as in `expansion`.
    Raises NoOrbit: the fold could not be solved again.
    """
    problem = orbit.problem
    options = Options(tol=max(ROOM_FOR_KNOWN * tol, TOLERANCE_RANGE[0]))
    t, u, setting = unknowns_of(orbit)
    setting = replace(setting, dp=along(problem, vary))
    row = row_along(t, u, setting)
    error = estimated(t, u, setting, border=curve_border(t, u, row), believed=tol)
    start = t, u, setting
    if np.isfinite(error.error):  # the mesh of the orbit has the history of its walk
        start = on_breaks(start, better_breaks(t, setting.fractions, error, options.tol))
    found = _known(problem, start, vary, row, np.nan, options)
    if found is None:
        raise NoOrbit(f"the known fold of {problem.title} was not solved again", Status.NOT_CONVERGED)
    return _expanded(replace(found, names=tuple(name for name in names if name != vary)), tol)


def _known(
    problem: Problem, start: Start, vary: str, row: Array, bend: float, options: Options
) -> Expansion | None:
    """The fold next to a start, on a mesh and with phases made for it; None where there is none."""
    solved = solve_adaptively(problem, start, options, solver="newton", border=row, bend=bend, soft=False)
    if not solved.status.ok:
        return None
    t, u, setting, lam = solved.t, solved.solution.u, solved.setting, solved.solution.parameter
    there = problem.with_value(vary, problem.moved(vary, lam))
    setting = replace(setting.moved(lam), dp=along(there, vary))
    own = row_along(t, u, setting, solved.solution.linearisation)
    assert solved.border is not None and solved.solution.bend is not None
    # Where the slope vanishes, another measure of the way changes the bend by the square of its rate alone.
    bend = solved.solution.bend * float(solved.border @ own) ** 2 * problem.unit(vary) / there.unit(vary)
    return Expansion(
        there, vary, t.cycle.signature, t.cycle.repeats, t.counts, t.degree, t.kind, u, setting.fractions,
        setting.scale, own, bend,
    )  # fmt: skip


def _expanded(known: Expansion, tol: float) -> Expansion:
    """With the derivatives by the parameters it names; zero by one that is not positive, or whose neighbours fail."""
    t, own, P = known.t, known.problem.vector(), known.t.phases
    at = [known.problem.names.index(name) for name in known.names]
    p = np.repeat(own[None], 2 * len(at), axis=0)
    for i, place in enumerate(at):
        p[2 * i, place] *= np.exp(NEIGHBOURS_APART)
        p[2 * i + 1, place] *= np.exp(-NEIGHBOURS_APART)
    flat = replace(known, first=np.zeros((len(at), t.size + 1)), second=np.zeros((len(at), t.size + 1)))
    if not at:
        return flat
    found, settings = from_expansion(flat, p, tol, stations=0)
    values = settings.p[:, known.problem.names.index(known.vary)]
    z = np.column_stack([found.u, np.log(values / known.problem.value(known.vary))])
    with np.errstate(invalid="ignore", divide="ignore"):  # of a neighbour that failed
        z[:, -1 - P : -1] = np.log(z[:, -1 - P : -1])
    z_0 = np.append(known.u, 0.0)
    z_0[-1 - P : -1] = np.log(z_0[-1 - P : -1])
    up, down = z[::2], z[1::2]
    good = np.array([s is Status.CONVERGED for s in found.statuses]).reshape(-1, 2).all(axis=1) & (own[at] > 0)
    first = np.where(good[:, None], (up - down) / (2 * NEIGHBOURS_APART), 0.0)
    second = np.where(good[:, None], (up - 2 * z_0 + down) / NEIGHBOURS_APART**2, 0.0)
    return replace(known, first=first, second=second)


def expansion_beside(known: Expansion, p: Array, tol: float) -> Expansion | None:
    """The fold of a problem near a known one, from which others are predicted in turn.

    p: (np,) its parameters; that of the fold is not read; tol: relative error that its neighbours may have.
    Returns expansion by the same parameters, on phases and a mesh of its own; None where it was not found so.
    """
    found, settings = from_expansion(known, p[None], tol)
    if found.statuses[0] is not Status.CONVERGED:
        return None
    recut = _recut(known, (known.t, found.u[0], settings.of(0)), tol)
    return None if recut is None else _expanded(replace(recut[0], names=known.names), tol)


def folds_near(known: Expansion, p: Array, tol: float, *, slopes_by: tuple[str, ...] = ()) -> Folds:
    """The folds of members, confirmed.

    p: (B, np) their parameters; that of the fold is not read; tol: relative error of value, period and amplitude;
    slopes_by: parameters whose d ln value/d ln q are wanted. Returns folds, with nan where there is none.
    """
    parts = [_pass(known, p[i : i + MEMBERS_OF_A_PASS], tol, slopes_by) for i in range(0, len(p), MEMBERS_OF_A_PASS)]
    numbers = np.concatenate([np.zeros((6, 0)), *(part.numbers for part in parts)], axis=1)
    value, value_error, period, period_error, amplitude, amplitude_error = numbers
    statuses = tuple(status for part in parts for status in part.statuses)
    how = tuple(word for part in parts for word in part.how)
    slopes = np.concatenate([np.zeros((0, len(slopes_by))), *(part.slopes for part in parts)])
    solutions = tuple(solution for part in parts for solution in part.solutions)
    return Folds(value, value_error, period, period_error, amplitude, amplitude_error, statuses, how, slopes, solutions)


@dataclass(frozen=True, eq=False)
class _Tried:
    """What became of B members: (6, B) values with errors, statuses, how, (B, k) slopes.

    `roots` are the turning points, (unknowns, setting) by member, that are no folds as they stand.
    """

    numbers: Array
    statuses: list[Status]
    how: list[How]
    slopes: Array
    roots: dict[int, tuple[Array, Setting]]
    solutions: list[Solution | None]

    def take(self, member: int, numbers: Array, slopes: Array, how: How, solution: Solution) -> None:
        """The fold of a member."""
        self.numbers[:, member], self.slopes[member], self.how[member] = numbers, slopes, how
        self.solutions[member] = solution
        self.statuses[member] = Status.CONVERGED


def _pass(known: Expansion, p: Array, tol: float, slopes_by: tuple[str, ...]) -> _Tried:
    """`folds_near` for a few members: in the batch, then by what a turning point leads to."""
    out = _attempt(known, p, tol, slopes_by)
    for member, (u, setting) in out.roots.items():
        found = _recut(known, (known.t, u, setting), tol)
        if found is not None:
            local, numbers = found
            own = _settings_of_known(local)
            slopes = slopes_of_many(local, local.u[None], own, slopes_by)[0] if slopes_by else np.zeros(0)
            solution = Solution(local.t, local.u, local.setting(), local.row, local.bend)
            out.take(member, numbers, slopes, "recut", solution)
    return out


def _attempt(known: Expansion, p: Array, tol: float, slopes_by: tuple[str, ...]) -> _Tried:
    """The folds of members, as far as they have the phases and the mesh of a known one."""
    B, t = len(p), known.t
    found, settings = from_expansion(known, p, tol)
    out = _Tried(np.full((6, B), np.nan), list(found.statuses), [""] * B, np.full((B, len(slopes_by)), np.nan), {},
                 [None] * B)  # fmt: skip
    there = np.array([i for i, s in enumerate(found.statuses) if s is Status.CONVERGED], dtype=int)
    if not there.size:
        return out
    own, u = settings.of(there), found.u[there]
    confirmed = confirmed_many(known, u, own, found.bend[there])
    slopes = slopes_of_many(known, u, own, slopes_by) if slopes_by else np.zeros((there.size, 0))
    admissible = admissible_many(t, u, own)
    for i, member in enumerate(there.tolist()):
        out.statuses[member] = _verdict(bool(admissible[i]), confirmed[:, i], tol)
        if out.statuses[member] is Status.CONVERGED:
            solution = Solution(t, u[i], own.of(i), known.row, float(found.bend[there[i]]))
            out.take(member, confirmed[:, i], slopes[i], "batch", solution)
        else:
            out.roots[member] = u[i], own.of(i)
    return out


def _verdict(admissible: bool, numbers: Array, tol: float) -> Status:
    """What becomes of a turning point whose (6,) numbers are these."""
    if not admissible:
        return Status.INADMISSIBLE
    return Status.CONVERGED if numbers[1::2].max() <= tol else Status.TOLERANCE_NOT_REACHED


def _recut(known: Expansion, start: Start, tol: float) -> tuple[Expansion, Array] | None:
    """The fold that a start leads to which needs other phases or another mesh, and its (6,) numbers; None: to none."""
    options = Options(tol=max(ROOM_FOR_KNOWN * tol, TOLERANCE_RANGE[0]))
    try:
        problem = known.problem.with_values(known.problem.names, start[2].p)
        local = _known(problem, start, known.vary, known.row, known.bend, options)
    except (NoOrbit, InputError):
        return None
    if local is None:
        return None
    own = _settings_of_known(local)
    numbers = confirmed_many(local, local.u[None], own, np.array([local.bend]))[:, 0]
    return (local, numbers) if _verdict(True, numbers, tol) is Status.CONVERGED else None  # adapt.py has judged it


def _settings_of_known(known: Expansion) -> Setting:
    setting = known.setting()
    return settings_of(setting, setting.p[None], setting.dp[None])
