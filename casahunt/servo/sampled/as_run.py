"""What a drive adds to the loop that it runs: its own remedies and its filter of the derivative, as parts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ..drive import SHARES, Drive
from ..parts.filtered_derivative import DERIVATIVE_FILTER
from ..parts.loop import Loop
from ..parts.lugre import LUGRE
from ..parts.table import remedy_of, with_remedy

DRIVE_PARTS = {
    "dead band": "dead_band", "shifted dead band": "shifted_dead_band", "hysteresis": "hysteresis",
    "error dead band": "error_dead_band", "leak": "leak", "freeze": "dwell", "reset": "reset",
    "reset at a stop": "reset_at_stop", "error filter": "error_filter_time", "feedforward": "compensated",
}  # fmt: skip
"""Remedies that both kinds of controller have, by the key of their size in the table [drive]."""
USUAL_FILTER = 0.1
"""Time of the derivative's filter, in kd/kp, where the drive does not say it."""


def as_run(loop: Loop, drive: Drive) -> Loop:
    """The loop with what its drive adds.  Raises InputError: parts that do not go together."""
    model = "lugre" if LUGRE in loop.present else "switch"
    run = replace(loop, parts=tuple(part.sampled or part for part in loop.parts))
    for name, key in DRIVE_PARTS.items():
        if getattr(drive, key) != getattr(Drive, key):
            run = with_remedy(run, remedy_of(name, model), float(getattr(drive, key)))
    shares = {share: getattr(drive, share) for share, of in SHARES.items() if getattr(drive, of) != getattr(Drive, of)}
    run = run.replace(**shares)
    if drive.derivative != "filtered":
        return run
    filter_time = drive.filter_time
    if filter_time is None:
        nowhere, (mode, *_) = np.zeros((len(loop.system.states), 1)), loop.system.modes
        kp, kd = (float(loop.signal(name, mode.name, nowhere)[0]) for name in ("kp", "kd"))
        filter_time = USUAL_FILTER * kd / kp
    return run.with_parts(DERIVATIVE_FILTER, derivative_filter=filter_time)
