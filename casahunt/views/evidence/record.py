"""The evidence of a tuning as one JSON object; its keys are explained in views/commands/tune.py."""

from __future__ import annotations

import datetime
import os
import time
from collections.abc import Sequence
from typing import Any

from ...design.tune.tuning import Tuning
from ...servo.stable_up_to import stable_ranges
from ..answers.fold import stability_of


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


def evidence_record(tuning: Tuning) -> dict[str, Any]:
    """The JSON object of a tuning: its `to_dict`, and up to which gain a cycle is stable.

    Returns numbers, texts, lists and tables only; None for what is not finite.
    """
    record, fold = tuning.to_dict(), tuning.verification.fold
    known = fold if tuning.model is not None else None
    record["verification"]["stable"] = None if known is None else stability_of(known, stable_ranges(known))
    return record
