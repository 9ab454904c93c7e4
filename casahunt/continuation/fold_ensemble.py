"""Folds of many problems near one whose fold is known, all at once.

    expansion of the known fold -> where it is expected -> turning point -> confirmed, judged -> "batch"
                                                               |                 | other phases, or another mesh
                                                               |                 v
                                                               |     solved singly from there -> confirmed -> "recut"
                                                               v                                  |           ^
                     nothing: by way of the fold halfway, which is expanded in turn  <------------+           |
                                                               |   +------------------------------------------+
                                                               v
                                                     nothing: left to the single way

The derivatives of the expansion are differences of folds at l_i +- `NEIGHBOURS_APART` (fold_expansion.py).  A member's
numbers depend on the member and on the known fold alone (collocation/ensemble.py).

A turning point is confirmed as `fold.confirmed` does it: the error of value, period and amplitude by the adjoint, with
what it overlooks (error_estimate.py), plus what the turning point of the mesh with halved intervals has moved along the
curve, and not less than the distance to that turning point:

    one Newton step at fixed a, then a step and da = -g/g' along the tangent.

Parameters move a fold by  d lambda/d q = psi . (rhs of q),  psi the adjoint of lambda with a held.

Symbols: B members, k parameters, n states, P phases, E elements, y unknowns of the node system.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any, Literal

import numpy as np

from ..collocation.admissibility import admissible_many
from ..collocation.error_estimate import Estimate, functional_errors, left_on_halved, on_halves
from ..collocation.newton import Solution as Root
from ..collocation.remesh import better_breaks
from ..collocation.transcription import Setting, Transcription, settings_of
from ..effort import MEMBERS_OF_A_PASS
from ..errors import InputError, NoOrbit, Status
from ..hybrid.problem import Problem
from ..orbits.adapt import Options, on_breaks, solve_adaptively
from ..orbits.amplitude import amplitudes_off, estimated, goals_of_many, row_sums
from ..orbits.bordering import curve_border, row_along
from ..orbits.ensemble import ROOM_FOR_KNOWN, sizes_of_steps
from ..orbits.orbit import Orbit, SolvedOrbit, orbit_of, unknowns_of
from ..orbits.restart import Start
from .curve import along
from .fold import Fold, fold_slopes
from .fold_expansion import Expansion, borders, from_expansion

Array = np.ndarray
How = Literal["batch", "recut", ""]

NEIGHBOURS_APART = 1e-3
"""Distance of the neighbours from which the expansion is made, in logarithms: their differences have ten digits."""
MOST_BETWEEN = 6
"""Folds that are looked for on the way to one that is too far for the known one's expansion; three are enough for five
parameters of 3 to 20 per cent that move a fold by a factor of 1.7."""
FARTHEST_SECOND = 1e-3
"""The fold on the halved mesh lies within this of the one that it confirms, or confirms nothing."""


@dataclass(frozen=True, eq=False)
class FoldSolution:
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
        solved = SolvedOrbit(t, root, self.setting, estimate, Status.CONVERGED, 0)
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

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.continuation import expansion, folds_near, largest
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> known = expansion(largest(orbit, "g"), ("omega",), 1e-6)
    >>> p = np.repeat(known.problem.vector()[None], 2, axis=0)
    >>> p[:, known.problem.names.index("omega")] *= [1.01, 1.02]  # g is in proportion to its square
    >>> found = folds_near(known, p, 1e-6)
    >>> found.how, bool(found.errors.max() < 1e-6)
    (('batch', 'batch'), True)
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
    solutions: tuple[FoldSolution | None, ...]

    @property
    def errors(self) -> Array:
        """(B,) the largest estimated relative error of value, period and amplitude."""
        return np.max([self.value_errors, self.period_errors, self.amplitude_errors], axis=0)


def expansion(fold: Fold[Any], names: tuple[str, ...], tol: float) -> Expansion:
    """A known fold, on a mesh made for it and the tolerance, and its change with parameters.

    Parameters
    ----------
    fold, names
        the fold, where its parameter is largest, and the k parameters that will differ.
    tol
        relative error that its neighbours may have.

    Returns
    -------
    Expansion.

    Raises
    ------
    NoOrbit : the fold could not be solved again.

    Examples
    --------
    >>> from casahunt.continuation import expansion, largest
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> known = expansion(largest(orbit, "g"), ("omega",), 1e-6)
    >>> round(float(known.first[0, -1]), 4)  # d ln g/d ln omega, exactly 2
    2.0
    """
    return expansion_at(fold.orbit, fold.parameter, names, tol)


def expansion_at(orbit: Orbit, vary: str, names: tuple[str, ...], tol: float) -> Expansion:
    """As `expansion`, of the orbit at a fold.

    orbit, vary: the orbit, and the parameter that is largest there; names, tol: as in `expansion`.
    Raises NoOrbit: the fold could not be solved again.
    """
    problem = orbit.problem
    options = Options(tol).finer(ROOM_FOR_KNOWN)
    t, u, setting = unknowns_of(orbit)
    setting = replace(setting, dp=along(problem, vary))
    row = row_along(t, u, setting)
    error = estimated(t, u, setting, border=curve_border(t, u, row), accepted=tol)
    start = t, u, setting
    if np.isfinite(error.error):  # the mesh of the orbit has the history of its walk
        start = on_breaks(start, better_breaks(t, setting.fractions, error, options.tol))
    found = _fold_near(problem, start, vary, row, np.nan, options)
    if found is None:
        raise NoOrbit(f"the known fold of {problem.title} was not solved again", Status.NOT_CONVERGED)
    return _expanded(replace(found, names=tuple(name for name in names if name != vary)), tol)


def _fold_near(
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
    with np.errstate(invalid="ignore"):  # a neighbour that failed may have come to any value: it is left out below
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

    Parameters
    ----------
    known
        a fold that is known.
    p
        (np,) parameters; that of the fold is not read.
    tol
        relative error that its neighbours may have.

    Returns
    -------
    Expansion by the same parameters, on phases and a mesh of its own; None where it was not found so.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.continuation import expansion, expansion_beside, largest
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> known = expansion(largest(orbit, "g"), ("omega",), 1e-6)
    >>> p = np.repeat(known.problem.vector()[None], 2, axis=0)
    >>> p[:, known.problem.names.index("omega")] *= [1.01, 1.02]  # g is in proportion to its square
    >>> beside = expansion_beside(known, p[0], 1e-6)
    >>> round(beside.problem.value("g") / known.problem.value("g"), 6)
    1.0201
    """
    near = _beside(known, p, tol)
    return None if near is None else _expanded(replace(near[0], names=known.names), tol)


def _beside(known: Expansion, p: Array, tol: float, slopes_by: tuple[str, ...] = ()) -> tuple[Expansion, _Told] | None:
    """The fold at parameters p (np,) near a known one, on phases and a mesh of its own; None where it was not found."""
    found, settings = from_expansion(known, p[None], tol)
    if found.statuses[0] is not Status.CONVERGED:
        return None
    return _remeshed(known, (known.t, found.u[0], settings.of(0)), tol, slopes_by)


def _led(known: Expansion, p: Array, tol: float, slopes_by: tuple[str, ...]) -> _Told | None:
    """The fold at parameters p (np,) that are too far for one expansion: by way of folds between, each expanded."""
    ahead = [p, known.halfway(p[None])[0]]
    for _ in range(MOST_BETWEEN):
        near = _beside(known, ahead[-1], tol, slopes_by)
        if near is None:
            ahead.append(known.halfway(ahead[-1][None])[0])
        elif len(ahead) == 1:
            return near[1]
        else:
            ahead.pop()
            known = _expanded(replace(near[0], names=known.names), tol)
    return None


@dataclass(frozen=True, eq=False)
class _Told:
    """What became of a member: its (6,) numbers, values and errors in turn, and (k,) slopes."""

    status: Status
    numbers: Array
    slopes: Array
    how: How = ""
    solution: FoldSolution | None = None


def folds_near(known: Expansion, p: Array, tol: float, *, slopes_by: tuple[str, ...] = ()) -> Folds:
    """The folds of members near a known one, many at once, confirmed.

    Parameters
    ----------
    known
        the fold that is known.
    p
        (B, np) parameters of the members; that of the fold is not read.
    tol
        relative error of value, period and amplitude.
    slopes_by
        parameters whose d ln value/d ln q are wanted.

    Returns
    -------
    Folds, with nan where there is none.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt.continuation import expansion, folds_near, largest
    >>> from casahunt.hybrid.examples import ball
    >>> from casahunt.orbits import find_cycle
    >>> orbit = find_cycle(ball, x=0.0119, v=1.54, t=0.07, settled=True)
    >>> known = expansion(largest(orbit, "g"), ("omega",), 1e-6)
    >>> p = np.repeat(known.problem.vector()[None], 2, axis=0)
    >>> p[:, known.problem.names.index("omega")] *= [1.01, 1.02]  # g is in proportion to its square
    >>> (folds_near(known, p, 1e-6).values / known.problem.value("g")).round(6).tolist()
    [1.0201, 1.0404]
    """
    passes = (p[i : i + MEMBERS_OF_A_PASS] for i in range(0, len(p), MEMBERS_OF_A_PASS))
    told = [member for some in passes for member in _pass(known, some, tol, slopes_by)]
    numbers = np.array([member.numbers for member in told]).reshape(-1, 6).T
    value, value_error, period, period_error, amplitude, amplitude_error = numbers
    return Folds(
        value, value_error, period, period_error, amplitude, amplitude_error,
        tuple(member.status for member in told), tuple(member.how for member in told),
        np.array([member.slopes for member in told]).reshape(len(told), len(slopes_by)),
        tuple(member.solution for member in told),
    )  # fmt: skip


def _pass(known: Expansion, p: Array, tol: float, slopes_by: tuple[str, ...]) -> list[_Told]:
    """A few members: those that have the phases and the mesh of the known one, what other turning points lead to, and
    what is led to."""
    found, settings = from_expansion(known, p, tol)
    out = [_Told(status, np.full(6, np.nan), np.full(len(slopes_by), np.nan)) for status in found.statuses]
    at = np.array([i for i, s in enumerate(found.statuses) if s is Status.CONVERGED], dtype=int)
    batch = list[_Told]()
    if at.size:
        u, own = found.u[at], settings.of(at)
        batch = _judged(known, u, own, found.bend[at], admissible_many(known.t, u, own), tol, slopes_by, "batch")
    for i, told in zip(at.tolist(), batch, strict=True):
        if told.status is not Status.CONVERGED:
            near = _remeshed(known, (known.t, found.u[i], settings.of(i)), tol, slopes_by)
            told = replace(out[i], status=told.status) if near is None else near[1]
        out[i] = told
    return [told if told.how else _led(known, p[i], tol, slopes_by) or told for i, told in enumerate(out)]


def _judged(
    known: Expansion, u: Array, settings: Setting, bend: Array, admissible: Array, tol: float,
    slopes_by: tuple[str, ...], how: How,
) -> list[_Told]:  # fmt: skip
    """What becomes of turning points: (B, size) unknowns, their settings, (B,) bends, and whether they are motions."""
    numbers, t = confirmed_many(known, u, settings, bend), known.t
    slopes = slopes_of_many(known, u, settings, slopes_by) if slopes_by else np.zeros((len(u), 0))
    statuses = [
        Status.INADMISSIBLE if not motion else Status.CONVERGED if error <= tol else Status.TOLERANCE_NOT_REACHED
        for motion, error in zip(admissible, numbers[1::2].max(axis=0), strict=True)
    ]
    return [
        _Told(
            statuses[i], numbers[:, i], slopes[i], how, FoldSolution(t, u[i], settings.of(i), known.row, float(bend[i]))
        )
        for i in range(len(u))
    ]


def _remeshed(
    known: Expansion, start: Start, tol: float, slopes_by: tuple[str, ...] = ()
) -> tuple[Expansion, _Told] | None:
    """The fold that a start leads to which needs other phases or another mesh; None: to none."""
    options = Options(tol).finer(ROOM_FOR_KNOWN)
    local = None
    with suppress(NoOrbit, InputError):
        problem = known.problem.with_values(known.problem.names, start[2].p)
        local = _fold_near(problem, start, known.vary, known.row, known.bend, options)
    if local is None:
        return None
    setting, yes = local.setting(), np.array([True])  # it is a motion: adapt.py has judged it
    own = settings_of(setting, setting.p[None], setting.dp[None])
    (told,) = _judged(local, local.u[None], own, np.array([local.bend]), yes, tol, slopes_by, "recut")
    return (local, told) if told.status is Status.CONVERGED else None


def confirmed_many(known: Expansion, u: Array, settings: Setting, bend: Array) -> Array:
    """Turning points with their errors; see the module docstring.

    u, settings: (B, size) unknowns and settings, at the value that was found; bend: (B,) d2 lambda/d a2.
    Returns (6, B) value, period, amplitude, each followed by its error; infinite where nothing is confirmed.
    """
    t, P = known.t, known.t.phases
    fine, finer, halves, lin = halved = on_halves(t, u, settings)
    goals, period, amplitude = goals_of_many(t, u, settings)
    goals = np.concatenate([np.zeros_like(goals[:, :1]), goals], axis=1)
    goals[:, 0, -1] = 1.0
    border = borders(t, u, known.row)
    first, _, better = functional_errors(t, u, settings, goals, border=border, halved=halved)
    assert better is not None
    motions = admissible_many(*better)
    newton, _ = lin.step_and_tangent(borders(fine, finer, known.row))
    finer = finer + lin.expand(newton, 1.0)
    lam = newton[:, -1]
    lin = fine.linearise(finer, halves.moved(lam))
    newton, tangent = lin.step_and_tangent(borders(fine, finer, known.row))
    with np.errstate(all="ignore"):
        da = -tangent[:, -1] / bend
        step = lin.expand(newton + da[:, None] * tangent, 1.0)
        second = finer + step
        lam = lam + newton[:, -1] + 0.5 * da * tangent[:, -1]
        far = np.maximum(sizes_of_steps(fine, finer, step), np.abs(lam))
        longer = np.abs(row_sums(second[:, -P:]) * t.cycle.repeats / period - 1)
        larger = amplitudes_off(fine, second, halves.moved(lam), amplitude)
        # At another place of the curve everything changes to first order: that is added without regard to signs.
        elsewhere = np.abs(np.matmul(goals, (da[:, None] * _on_coarse(t, fine, tangent))[..., None])[..., 0])
        elsewhere[:, 0] *= 0.5
        second = (1 + left_on_halved(t).max(initial=0.0)) * np.column_stack([np.abs(lam), longer, larger])
        errors = np.maximum(first + elsewhere, second)
        errors[~(far <= FARTHEST_SECOND) | ~lin.finite() | ~motions] = np.inf
    place = known.problem.names.index(known.vary)
    return np.array([settings.p[:, place], errors[:, 0], period, errors[:, 1], amplitude, errors[:, 2]])


def _on_coarse(t: Transcription, fine: Transcription, y: Array) -> Array:
    """(B, y) of the node system of t from that with halved intervals: without the nodes in the middle."""
    lengths = np.ones(t.elements, dtype=int)
    lengths[t.interval_elements] = 2
    kept = np.concatenate([[0], np.cumsum(lengths)])
    nodes = y[:, : (fine.elements + 1) * t.n].reshape(len(y), -1, t.n)[:, kept]
    return np.concatenate([nodes.reshape(len(y), -1), y[:, (fine.elements + 1) * t.n :]], axis=1)


def slopes_of_many(known: Expansion, u: Array, settings: Setting, names: tuple[str, ...]) -> Array:
    """How much folds move with parameters (fold.py).

    known, u, settings: as in `confirmed_many`. Returns (B, k) d ln value/d ln q.
    """
    problem = known.problem
    at = [problem.names.index(name) for name in names]
    ways = np.zeros((len(u), len(at), settings.p.shape[1]))
    ways[:, np.arange(len(at)), at] = settings.p[:, at]
    place = problem.names.index(known.vary)
    relative = settings.dp[:, place] / settings.p[:, place]
    return fold_slopes(known.t, u, settings, known.row, ways) * relative[:, None]
