"""The evidence of a tuning as one JSON object; its keys are explained in views/commands/tune.py."""

from __future__ import annotations

import dataclasses
import datetime
import os
import time
from collections.abc import Sequence
from typing import Any

from ...design.tune.tasks import SimulatedTask, regulator_tasks
from ...design.tune.tuning import Tuning
from ...export import plain
from ...orbits import Options
from ..stability import stability_of

GAIN_BEFORE = 0.5
"""Gain of the tasks before, in units of the nominal fold gain, where none is given."""
SHORTER = 1 / 6
"""Length of the tasks before, in units of those after: hunting shows sooner than rest, and costs more to follow."""


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


def before_tasks(tuning: Tuning, gain: float | None) -> tuple[float, tuple[SimulatedTask, ...]]:
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


def evidence_record(
    tuning: Tuning, before: tuple[float, tuple[SimulatedTask, ...]] | None = None, options: Options | None = None
) -> dict[str, Any]:
    """The JSON object of a tuning: its `to_dict`, up to which gain a cycle is stable, and the tasks before.

    before: gain and tasks of `before_tasks`; options: tolerance of the gains that are computed here. Returns numbers,
    texts, lists and tables only; None for what is not finite.
    """
    record, fold = tuning.to_dict(), tuning.verification.fold
    record["verification"]["stable"] = None if fold is None else plain(stability_of(fold, options or Options()))
    gain, tasks = before or (None, ())
    controller = dataclasses.asdict(tuning.before.controller)
    record["before"] = None
    if gain is not None:
        times = {"gain": gain, "times": record["gain"] / gain}
        record["before"] = {**times, **controller, "tasks": plain(tasks)}
    return record
