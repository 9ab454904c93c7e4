"""The evidence of a tuning as one JSON object; its keys are explained in views/commands/tune.py."""

from __future__ import annotations

import dataclasses
import datetime
import os
import time
from collections.abc import Sequence
from typing import Any

from ...checks import finite_or_none
from ...design.sensitivity import fold_sensitivities
from ...design.tune.check import Verification
from ...design.tune.demands import COSTS
from ...design.tune.tasks import Task, regulator_tasks
from ...design.tune.tuning import Tuning
from ...design.uncertainty.linear import linear_range
from ...orbits.adapt import Options
from ...servo.delayed_loop import Margins
from ...servo.servo import flatten
from ..stability import stability_of

GAIN_BEFORE = 0.5
"""Gain of the tasks before, in units of the nominal fold gain, where none is given."""
SHORTER = 1 / 6
"""Length of the tasks before, in units of those after: hunting shows sooner than rest, and costs more to follow."""
PROVES_NOT = (
    "The fold ends the symmetric hunting cycle that was found; the scan of the event map speaks against all cycles "
    "with sticking, lopsided ones too, but not against cycles without.",
    "The scan and the simulated tasks are samples: they find what is there to be found, and prove no absence.",
    "Optimum and worst friction are local; a better tuning, or a worse friction inside the set, may exist.",
    "Friction outside the set, flexibility, noise, backlash and saturation are not in the model.",
)
INSIDE_SENTENCE = (
    "Inside of the uncertainty set the worst servo is searched for, from its corners and from samples; a worse one "
    "that is not near any of them may exist."
)
DELAY = "The delay is in the margins of the linear loop only; fold, scan and simulation are without it."


def made(servo_file: str | None, changes: Sequence[str]) -> dict[str, Any]:
    """When and by what a record is made, and for which servo.

    servo_file, changes: the servo file, None for the servo built in; and what was set beside it, KEY=VALUE.
    Returns date (UTC; that of SOURCE_DATE_EPOCH where that is set, for builds that are to be the same again), casahunt
    (the version), servo_file, set.
    """
    import importlib.metadata  # takes 30 ms

    epoch = os.environ.get("SOURCE_DATE_EPOCH", "")
    seconds = float(epoch) if epoch.isdigit() else time.time()
    date = datetime.datetime.fromtimestamp(seconds, datetime.UTC).date().isoformat()
    try:
        version = importlib.metadata.version("casahunt")
    except importlib.metadata.PackageNotFoundError:  # a checkout that is not installed
        version = "0+uninstalled"
    return {"date": date, "casahunt": version, "servo_file": servo_file, "set": list(changes)}


def before_tasks(tuning: Tuning, gain: float | None) -> tuple[float, tuple[Task, ...]]:
    """The simulated tasks with the controller as given.

    gain: K used before [V/rad]; default: half the fold gain of the nominal friction with the times as given or tuned.
    Returns their gain [V/rad], and the tasks.
    """
    check = tuning.verification
    fold = check.nominal_fold or check.fold
    gain = gain or (GAIN_BEFORE * fold.gain if fold is not None else tuning.gain / 2)
    span = SHORTER * check.span
    tasks = regulator_tasks(tuning.before, tuning.model, gain, span, check.amplitude, "nominal", decide=False)
    return gain, tuple(tasks)


def result_of(check: Verification) -> str:
    """One of "verified", "not everything verified", "speaks against it"."""
    return "speaks against it" if check.against else "not everything verified" if check.unverified else "verified"


def _loop(loop: Margins) -> dict[str, Any]:
    return {
        "crossover": loop.frequency,
        "phase_margin": loop.phase_margin,
        "lowest_factor": finite_or_none(loop.lowest_factor),
        "highest_factor": finite_or_none(loop.highest_factor),
        "stable": loop.stable,
    }


def _task(task: Task) -> dict[str, Any]:
    verdict = task.motion.verdict
    return {
        "friction": task.friction,
        "start": task.start,
        "time": float(task.motion.times[-1]),
        "verdict": verdict.kind,
        "reason": verdict.sentence,
        "status": task.motion.status.name.lower(),
    }


def record_of(
    tuning: Tuning, before: tuple[float, tuple[Task, ...]] | None = None, options: Options | None = None
) -> dict[str, Any]:
    """The JSON object of a tuning; keys in views/commands/tune.py.

    before: gain and tasks of `before_tasks`; options: tolerance of the gains that are computed here.
    Returns numbers, texts, lists and tables only; None for what is not finite.
    """
    demands = tuning.demands
    what, _, unit = COSTS[tuning.cost].rpartition(" [")
    slopes = fold_sensitivities(tuning.verification.fold) if tuning.verification.fold is not None else None
    return {
        "model": tuning.model,
        "gain": tuning.gain,
        **dataclasses.asdict(tuning.servo.controller),
        "cost": tuning.cost,
        "cost_meaning": what,
        "cost_value": finite_or_none(tuning.cost_value),
        "cost_unit": unit.rstrip("]"),
        "cost_gain_only": tuning.gain_only,
        "fold_gain": tuning.fold_gain,
        "margin": demands.margin,
        "demands": {
            "phase_margin": demands.phase_margin,
            "gain_margin": demands.gain_margin,
            "delay": demands.delay,
            "sample_time": demands.sample_time,
        },
        "free": list(tuning.free),
        "bounds": {name: list(pair) for name, pair in tuning.bounds.items()},
        "worst": {"corner": tuning.corner, "fold_gain": tuning.fold_gain, "evaluations": tuning.evaluations},
        "fold": _fold(tuning),
        "binding": list(tuning.binding),
        "verification": _verification(tuning.verification, options or Options()),
        "elasticities": slopes.elasticities if slopes is not None else {},
        "proves_not": [*PROVES_NOT, *([INSIDE_SENTENCE] if tuning.corner else []), *([DELAY] if demands.lag else [])],
        "before": None if before is None else _before(tuning, *before),
        "servo": flatten(tuning.before),
        "rounds": tuning.rounds,
        "evaluations": tuning.evaluations,
        "status": tuning.status.name.lower(),
        "wall_s": tuning.wall_s,
    }


def _fold(tuning: Tuning) -> dict[str, float | None]:
    """The fold of the nominal friction, with the linearised range over the uncertainty set."""
    nominal = tuning.verification.nominal_fold
    linear: tuple[float | None, float | None] = (None, None)
    if tuning.uncertainty is not None and nominal is not None:
        linear = linear_range(nominal, tuning.uncertainty)
    return {
        "nominal": nominal.gain if nominal is not None else None,
        "error": nominal.gain_error if nominal is not None else None,
        "amplitude": nominal.orbit.amplitude if nominal is not None else None,
        "period": nominal.orbit.period if nominal is not None else None,
        "linear_low": linear[0],
        "linear_high": linear[1],
    }


def _verification(check: Verification, options: Options) -> dict[str, Any]:
    fold, nominal, folds = check.fold, check.nominal_fold, check.set_check
    return {
        "ok": check.ok,
        "result": result_of(check),
        "against": list(check.against),
        "unverified": list(check.unverified),
        "fold_gain": fold.gain if fold is not None else None,
        "fold_error": fold.gain_error if fold is not None else None,
        "nominal_fold_gain": nominal.gain if nominal is not None else None,
        "stable": None if fold is None else stability_of(fold, options),
        "margin": finite_or_none(check.margin),
        "margin_kept": check.margin_kept,
        "scan": check.scan_sentence,
        "scan_clear": check.scan_clear,
        "loops": {name: _loop(loop) for name, loop in check.loops.items()},
        "loops_kept": check.loops_kept,
        "loops_checked": check.loops_checked,
        "loop_corners": check.loop_corners,
        "set": None if folds is None else {"folds": folds.computed, "largest_fold_gain": folds.largest},
        "tasks": [_task(task) for task in check.tasks],
    }


def _before(tuning: Tuning, gain: float, tasks: tuple[Task, ...]) -> dict[str, Any]:
    return {
        "gain": gain,
        **dataclasses.asdict(tuning.before.controller),
        "tasks": [_task(task) for task in tasks],
    }
