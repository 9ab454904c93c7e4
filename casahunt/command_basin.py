"""casahunt basin: the amplitude below which the stuck servo settles."""

from __future__ import annotations

import argparse
import json
from typing import Any

from .adapt import Options
from .basin import OFFSET, Trial, basin
from .checks import known
from .console import add_common, complain, finite, positive, servo_of
from .errors import InputError
from .hunting import MODELS


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = commands.add_parser("basin", allow_abbrev=False, help="the amplitude below which the servo settles")
    add_common(command)
    command.add_argument("--model", default="switch", help="switch (default) or lugre")
    command.add_argument("--gain", help="controller gain K, to be given")
    command.add_argument(
        "--offset", default=OFFSET, help=f"relative distance from the border of the two motions (default {OFFSET:g})"
    )


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    model = known("model", options.model, MODELS)
    if options.gain is None:
        raise InputError("gain: must be given, for example --gain 0.1")
    gain = positive("gain", options.gain)
    how = Options(tol=finite("tol", options.tol))
    offset = finite("offset", options.offset)
    servo = servo_of(options)
    found = basin(servo, model, gain, options=how, offset=offset)  # type: ignore[arg-type]
    record = {
        "model": model,
        "gain": gain,
        "border": found.border,
        "unstable_amplitude": found.unstable.amplitude,
        "stable_position": found.stable_position,
        "stable_amplitude": found.stable.amplitude,
        "error_estimate": found.error_estimate,
        "offset": offset,
        "inside": _record(found.inside),
        "outside": _record(found.outside),
        "confirmed": found.confirmed,
    }
    if options.json:
        print(json.dumps(record))
    else:
        where = "" if model == "switch" else " (x1 at m = 0.9 Fs before breakaway)"
        print(f"{model} servo at gain {gain:.10g}: stuck nearer than {found.border:.10g} rad it settles{where}")
        print(f"  unstable cycle   amplitude max |x1| = {found.unstable.amplitude:.10g} rad, estimated error "
              f"{found.error_estimate:.1e}")  # fmt: skip
        print(f"  stable cycle     amplitude max |x1| = {found.stable.amplitude:.10g} rad")
        for name, trial in (("inside", found.inside), ("outside", found.outside)):
            last = ", ".join(f"{a:.4g}" for a in trial.positions[:6])
            more = ", ..." if trial.positions.size > 6 else ""
            print(f"  from {name:8}    {trial.outcome} after {trial.positions.size - 1} swings: {last}{more} rad")
    if not found.confirmed:
        complain("casahunt basin", "the motions from the two sides do not confirm the border")
        return 1
    return 0


def _record(trial: Trial) -> dict[str, Any]:
    return {"start": trial.start, "positions": trial.positions.tolist(), "outcome": trial.outcome}
