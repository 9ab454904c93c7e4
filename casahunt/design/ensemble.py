"""The folds and the cycles of thousands of servos in one call.

    servo, rows of parameter values -> fold gain, period and amplitude of each, with their errors

    folds: rows of parameters -> batches -> folds_near (continuation/fold_ensemble.py) -> fold_near (nearby.py) for the
    rest;    cycles: orbits/ensemble.py

They are computed from the fold or the cycle of one servo, in batches that any executor may share out; what a batch
cannot do is computed alone, as `find_fold` and `find_orbit` do, and says so.  A batch carries the expansion of the
known fold, made once; its results are a function of the batch, and a row's of the row: whoever computes it, in whatever
company.

Units: K in V/rad, amplitude in rad, period in s.  Symbols: n servos, k parameters, j whose elasticities are wanted.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ..continuation import Expansion, folds_near
from ..effort import ROWS_OF_A_TASK
from ..errors import NoOrbit, Status
from ..orbits import Options, Orbit, OrbitEnsemble
from ..orbits import orbit_ensemble as orbits_near
from ..results import Rows, table_of
from ..servo.find_orbit import BranchName, find_orbit
from ..servo.friction import Model
from ..servo.parts.loop import Loop
from ..servo.parts.plain_loop import loop_asked
from ..servo.servo import Servo
from .nearby import AnyFold, check_asked, expected_gains, fold_near, known_fold, nominal_fold, servo_at, vectors
from .sensitivity import fold_sensitivities

Array = np.ndarray

ON_ITS_OWN = "alone"
"""How a fold was computed that no batch did."""


@dataclass(frozen=True, eq=False, repr=False)
class FoldEnsemble(Rows):
    """The folds of n servos.

    Attributes
    ----------
    model : the friction model; None of a loop of parts.
    names : the k parameters in which they differ.
    parameters : (n, k) their values.
    gains, gain_errors : (n,) fold gains, 0 where a proof shows that no gain hunts, nan where the fold was not computed;
        estimated relative errors.
    periods, period_errors, amplitudes, amplitude_errors : (n,) of the cycles at the folds.
    elasticities : (n, k) d ln K/d ln q, where they were asked for, else (n, 0).
    statuses : of each; None where a refusal has none.
    how : "batch"; "recut" where its cycle has other phases, or needs a mesh of its own, than that of the known fold;
        "alone" where it was looked for as `find_fold` does.
    failures : (index, sentence) of every fold that was not computed.

    Examples
    --------
    >>> from casahunt import Servo, fold_ensemble
    >>> found = fold_ensemble(Servo(), "switch", ["friction.static"], [[0.53], [0.54]])
    >>> [f"{gain:.4f}" for gain in found.gains], found.how, found.failures
    (['0.6473', '0.7212'], ('batch', 'batch'), ())
    """

    model: Model | None
    names: tuple[str, ...]
    parameters: Array
    gains: Array
    gain_errors: Array
    periods: Array
    period_errors: Array
    amplitudes: Array
    amplitude_errors: Array
    elasticities: Array
    statuses: tuple[Status | None, ...]
    how: tuple[str, ...]
    failures: tuple[tuple[int, str], ...]

    def __len__(self) -> int:
        return len(self.gains)

    def __repr__(self) -> str:
        n, alone = len(self), self.how.count("alone")
        found = self.gains[self.gains > 0]
        between = f", gains {found.min():.6g} to {found.max():.6g}" if found.size else ""
        none, whose = int((self.gains == 0).sum()), f"{self.model} servos" if self.model else "loops"
        return (
            f"<folds of {n} {whose}{between}: {alone} alone, {none} that cannot hunt, "
            f"{len(self.failures)} not computed>"
        )


def fold_ensemble(
    servo: Servo | Loop,
    model: Model | None,
    names: Sequence[str],
    rows: Array,
    *,
    options: Options | None = None,
    fold: AnyFold | None = None,
    elasticities: bool = False,
    executor: Executor | None = None,
    report: Callable[[int], None] | None = None,
) -> FoldEnsemble:
    """The folds of servos that differ from one in some parameters.

    Parameters
    ----------
    servo, model
        the servo, and "switch" or "lugre"; or a loop of parts, and None.
    names, rows
        k of its parameters, and (n, k) values of them.
    options
        `tol` bounds the relative errors of gain, period and amplitude of every fold.
    fold
        the servo's own fold, or that of one nearby, where it is known already.
    elasticities
        d ln K/d ln q of every servo as well, by the k parameters.
    executor
        any concurrent.futures.Executor, to which batches of servos are handed; default: this process.
    report
        called with the number of folds computed so far, batch after batch.

    Returns
    -------
    FoldEnsemble; a servo's numbers depend neither on the executor nor on the other rows.

    Raises
    ------
    InputError : an unknown model or parameter, a table of another shape, or values that no servo has.

    Examples
    --------
    >>> import numpy as np
    >>> from casahunt import Servo, fold_ensemble
    >>> rows = np.linspace(0.52, 0.54, 5)[:, None]
    >>> found = fold_ensemble(Servo(), "switch", ["friction.static"], rows, elasticities=True)
    >>> bool((np.diff(found.gains) > 0).all()), found.elasticities.shape
    (True, (5, 1))
    """
    check_asked(servo, model)
    names = tuple(names)
    table = table_of(names, rows, [name for name in servo.names if name != "gain"], partial(servo_at, servo, names))
    options = options or Options()
    return folds_of(
        servo, model, names, table, options=options, fold=nominal_fold(servo, model, options, fold), executor=executor,
        report=report, elasticities_by=names if elasticities else (),
    )  # fmt: skip


def folds_of(
    servo: Servo | Loop, model: Model | None, names: Sequence[str], rows: Array, *, options: Options,
    fold: AnyFold | None,
    executor: Executor | None = None, report: Callable[[int], None] | None = None,
    elasticities_by: tuple[str, ...] = (),
) -> FoldEnsemble:  # fmt: skip
    """The folds of servos by the rows of their parameters, as `fold_ensemble`, nothing checked.

    fold: from which the others are predicted, of any servo nearby; None: each is looked for alone; elasticities_by: j
    parameters whose d ln K/d ln q are wanted.
    """
    names, expected = tuple(names), expected_gains(fold, names, rows)
    known = known_fold(servo, names, fold, options.tol) if len(rows) else None
    batches = [slice(i, i + ROWS_OF_A_TASK) for i in range(0, len(rows), ROWS_OF_A_TASK)]
    work: Any = partial(_work, servo, model, options, names, known, elasticities_by)
    tasks, members = ([rows[b] for b in batches], [expected[b] for b in batches]), list[_Member]()
    for part in map(work, *tasks) if executor is None else executor.map(work, *tasks):
        members += part
        if report is not None:
            report(len(members))
    numbers = np.array([member.numbers for member in members]).reshape(len(members), 6 + len(elasticities_by)).T
    failures = tuple((i, member.sentence) for i, member in enumerate(members) if member.sentence)
    statuses, how = tuple(member.status for member in members), tuple(member.how for member in members)
    gain, gain_error, period, period_error, amplitude, amplitude_error = numbers[:6]
    return FoldEnsemble(
        model, names, rows, gain, gain_error, period, period_error, amplitude, amplitude_error, numbers[6:].T, statuses,
        how, failures,
    )  # fmt: skip


class _Member(NamedTuple):
    """(6 + j,) gain, period and amplitude, each with its relative error, elasticities; the words of `FoldEnsemble`."""

    numbers: Array
    status: Status | None
    how: str
    sentence: str = ""


def _work(
    servo: Servo | Loop, model: Model | None, options: Options, names: tuple[str, ...], known: Expansion | None,
    by: tuple[str, ...], rows: Array, expected: Array,
) -> list[_Member]:  # fmt: skip
    """The folds of a batch, by j parameters their elasticities; a function of the batch alone, whoever computes it."""

    def alone(i: int) -> _Member:
        """The fold of one servo, looked for where its gain is expected."""
        nothing = np.full(6 + len(by), np.nan)
        try:
            fold = fold_near(servo_at(servo, names, rows[i]), model, float(expected[i]), options)
        except NoOrbit as error:
            return _Member(nothing, error.status, ON_ITS_OWN, str(error))
        if fold is None:
            nothing[0] = 0.0
            return _Member(nothing, Status.CONVERGED, ON_ITS_OWN)
        of, moves = fold.orbit, fold_sensitivities(fold).elasticities if by else {}
        numbers = fold.value, fold.value_error, of.period, of.period_error, of.amplitude, of.amplitude_error
        return _Member(np.array([*numbers, *(moves[name] for name in by)]), Status.CONVERGED, ON_ITS_OWN)

    if known is None:
        return [alone(i) for i in range(len(rows))]
    folds = folds_near(known, vectors(servo, names, rows), options.tol, slopes_by=by)
    numbers = np.column_stack([
        folds.values, folds.value_errors, folds.periods, folds.period_errors, folds.amplitudes, folds.amplitude_errors,
        folds.slopes,
    ])  # fmt: skip
    return [_Member(numbers[i], folds.statuses[i], how) if how else alone(i) for i, how in enumerate(folds.how)]


def orbit_ensemble(
    servo: Servo | Loop,
    model: Model | None,
    gain: float | None,
    names: Sequence[str],
    rows: Array,
    *,
    options: Options | None = None,
    orbit: Orbit | None = None,
    multipliers: bool = False,
    executor: Executor | None = None,
    report: Callable[[int], None] | None = None,
) -> OrbitEnsemble:
    """The hunting cycles of servos that differ from one in some parameters.

    Parameters
    ----------
    servo, model, gain
        the servo, "switch" or "lugre", and the gain [V/rad]; or a loop of parts, None, and its gain or None.
    names, rows
        k of the servo's parameters, "gain" among them where it differs too, and (n, k) values of them.
    options
        `tol` bounds the relative errors of period and amplitude of every cycle.
    orbit
        the servo's own cycle, or that of one nearby, where it is known already; default the stable one.  One on the
        unstable side of a fold leads to others there, a stable one to stable ones.
    multipliers
        the leading half multiplier of each as well.
    executor, report
        as in `fold_ensemble`.

    Returns
    -------
    OrbitEnsemble.

    Raises
    ------
    InputError : an unknown model or parameter, a table of another shape, or values that no servo has.
    NoOrbit : the servo itself has no such cycle.

    Examples
    --------
    >>> from casahunt import Servo, orbit_ensemble
    >>> found = orbit_ensemble(Servo(), "switch", 0.1, ["friction.viscous"], [[0.1], [0.12]])
    >>> [f"{amplitude:.5f}" for amplitude in found.amplitudes]  # rad
    ['0.01771', '0.01724']
    """
    loop_asked(servo, model, gain)  # refuses what is neither
    at: Any = servo, model, gain
    known_orbit: Any = orbit if orbit is not None else find_orbit(*at, options=options)
    branch: BranchName = "unstable" if known_orbit.multipliers.leading.real > 1 else "stable"
    return orbits_near(
        known_orbit, names, rows, options=options, multipliers=multipliers, executor=executor, report=report,
        alone=partial(_cycle_alone, servo, branch),
    )  # fmt: skip


def _cycle_alone(servo: Servo | Loop, branch: BranchName, problem: Any, options: Options) -> Orbit:
    """The cycle of one servo, from nothing."""
    if isinstance(servo, Loop):
        return find_orbit(servo_at(servo, problem.names, problem.vector()), branch=branch, options=options)
    return find_orbit(problem.servo, problem.model, problem.gain, branch=branch, options=options)
