"""Folds of many servos near one, in batches that any executor may share out.

    rows of parameters -> batches -> folds_near (continuation/fold_ensemble.py) -> fold_near for the rest

A batch carries the expansion of the known fold, made once; its results are a function of the batch, and a row's of the
row: whoever computes it, in whatever company.

Units: K in V/rad.  Symbols: n servos, k parameters that differ, j parameters whose elasticities are wanted.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import Executor
from dataclasses import dataclass

import numpy as np

from ...continuation.fold_ensemble import Folds, expansion, folds_near
from ...continuation.fold_expansion import Expansion
from ...errors import NoOrbit, Status
from ...orbits import Options
from ...orbits.ensemble import ROWS_OF_A_TASK
from ...servo.hunting import Model
from ...servo.problem import HuntingFold
from ...servo.servo import Servo
from ..sensitivity import fold_sensitivities
from . import nearby
from .set import Array, servo_at

ON_ITS_OWN = "alone"
"""How a fold was computed that no batch did."""


@dataclass(frozen=True, eq=False)
class Task:
    """Everything a worker needs for a batch; small, and pickled once per task."""

    servo: Servo
    model: Model
    options: Options
    names: tuple[str, ...]
    rows: Array
    expected: Array
    known: Expansion | None
    elasticities_by: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Done:
    """Folds of n servos.

    Attributes
    ----------
    numbers : (6, n) gain, period and amplitude, each followed by its estimated relative error; gain 0 and nan where the
        servo cannot hunt, nan where the fold was not computed.
    elasticities : (n, j) d ln K/d ln q.
    statuses, how, sentences : of each; sentences are "" but where a fold was not computed.
    """

    numbers: Array
    elasticities: Array
    statuses: tuple[Status | None, ...]
    how: tuple[str, ...]
    sentences: tuple[str, ...]


def joined(parts: Iterable[Done], count: int) -> Done:
    """Several of them as one."""
    parts = list(parts)
    return Done(
        np.concatenate([np.zeros((6, 0)), *(part.numbers for part in parts)], axis=1),
        np.concatenate([np.zeros((0, count)), *(part.elasticities for part in parts)]),
        *(tuple(x for part in parts for x in getattr(part, name)) for name in ("statuses", "how", "sentences")),
    )


def work(task: Task) -> Done:
    """The folds of a batch; a function of the batch alone, whoever computes it."""
    n, by = len(task.rows), task.elasticities_by
    numbers, elasticities = np.full((6, n), np.nan), np.full((n, len(by)), np.nan)
    statuses: list[Status | None] = [None] * n
    how, sentences = [ON_ITS_OWN] * n, [""] * n
    if task.known is not None:
        folds = in_batch(task, task.known)
        numbers = np.array([
            folds.values, folds.value_errors, folds.periods, folds.period_errors, folds.amplitudes,
            folds.amplitude_errors,
        ])  # fmt: skip
        elasticities, statuses = folds.slopes, list(folds.statuses)
        how = [word or ON_ITS_OWN for word in folds.how]
    for i in [i for i, word in enumerate(how) if word == ON_ITS_OWN]:
        numbers[:, i] = np.nan
        try:
            servo = servo_at(task.servo, task.names, task.rows[i])
            fold = nearby.fold_near(servo, task.model, float(task.expected[i]), task.options)
        except NoOrbit as error:
            statuses[i], sentences[i] = error.status, str(error)
            continue
        statuses[i] = Status.CONVERGED
        if fold is None:
            numbers[0, i] = 0.0
            continue
        orbit = fold.orbit
        numbers[:, i] = (
            fold.gain, fold.gain_error, orbit.period, orbit.period_error, orbit.amplitude, orbit.amplitude_error,
        )  # fmt: skip
        if by:
            moves = fold_sensitivities(fold).elasticities
            elasticities[i] = [moves[name] for name in by]
    return Done(numbers, elasticities, tuple(statuses), tuple(how), tuple(sentences))


def in_batch(task: Task, known: Expansion) -> Folds:
    """The folds of a batch as far as the known one leads to them.

    task, known: the batch, and the fold from which they are predicted. Returns folds; `how` is "" where it does not.
    """
    places = [task.servo.names.index(name) for name in task.names]
    p = np.repeat(task.servo.parameters(known.problem.value("gain"))[None], len(task.rows), axis=0)
    p[:, places] = task.rows
    return folds_near(known, p, task.options.tol, slopes_by=task.elasticities_by)


def known_fold(servo: Servo, names: Sequence[str], fold: HuntingFold | None, tol: float) -> Expansion | None:
    """The expansion from which servos near one are predicted.

    servo, names: the servo, and the parameters that differ from its own; tol: relative error of the folds that are to
    be computed.
    Returns expansion; None where there is no fold, its controller is given otherwise, or it could not be solved again.
    """
    if fold is None or fold.orbit.problem.names != servo.names:
        return None
    own, there = servo.parameters(fold.gain), fold.orbit.problem.vector()
    differ = [name for name, a, b in zip(servo.names, own, there, strict=True) if name in names or a != b]
    try:
        return expansion(fold, tuple(differ), tol)
    except NoOrbit:
        return None


def folds_of(
    servo: Servo,
    model: Model,
    names: Sequence[str],
    rows: Array,
    *,
    options: Options,
    fold: HuntingFold | None,
    executor: Executor | None = None,
    report: Callable[[int], None] | None = None,
    elasticities_by: tuple[str, ...] = (),
) -> Done:
    """The folds of servos by the rows of their parameters.

    servo, model, names, rows: the servo, the names of k of its parameters, and (n, k) values of them; options, fold:
    tolerance of every fold; the fold from which the others are predicted, None: each is looked for alone; executor,
    report: who computes the batches, default this process; called with the number of folds computed so far;
    elasticities_by: parameters whose d ln K/d ln q are wanted. Returns done, in the order of the rows.
    """
    names, rows = tuple(names), np.asarray(rows, float)
    near = fold.orbit.servo if fold is not None else servo
    expected = nearby.prediction(near, fold, names)(rows)
    known = known_fold(servo, names, fold, options.tol) if len(rows) else None
    batches = [slice(i, i + ROWS_OF_A_TASK) for i in range(0, len(rows), ROWS_OF_A_TASK)]
    tasks = [Task(servo, model, options, names, rows[b], expected[b], known, elasticities_by) for b in batches]
    parts: list[Done] = []
    for part in map(work, tasks) if executor is None else executor.map(work, tasks):
        parts.append(part)
        if report is not None:
            report(sum(len(p.how) for p in parts))
    return joined(parts, len(elasticities_by))


def fold_gains(
    servo: Servo,
    model: Model,
    names: Sequence[str],
    rows: Array,
    *,
    options: Options | None = None,
    fold: HuntingFold | None = None,
    report: Callable[[int], None] | None = None,
) -> tuple[Array, dict[int, str]]:
    """Fold gains at given parameter values.

    names, rows: k parameters and (n, k) values of them; fold: a fold from which the others are predicted, of any servo
    nearby; report: called with the number of folds computed so far. Returns (n,) gains; 0 where a proof shows that no
    gain hunts (servo/denial.py), nan where the fold was not computed, and the sentence by index of the latter.
    """
    done = folds_of(servo, model, names, rows, options=options or Options(), fold=fold, report=report)
    return done.numbers[0], {i: said for i, said in enumerate(done.sentences) if said}
