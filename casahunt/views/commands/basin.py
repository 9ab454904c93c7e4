"""casahunt basin: the amplitude below which the stuck servo settles."""

from __future__ import annotations

import argparse
import json
from typing import Any

from ...checks import error_text, known, to_error
from ...orbits.adapt import Options
from ...servo.basin import OFFSET, Basin, Trial, basin
from ...servo.hunting import MODELS
from .arguments import add_common, finite, gain_of, servo_of
from .console import complain


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = commands.add_parser("basin", allow_abbrev=False, help="the amplitude below which the servo settles")
    add_common(command)
    command.add_argument("--model", default="switch", help="switch (default) or lugre")
    command.add_argument("--gain", help="controller gain K, required")
    command.add_argument(
        "--offset", default=OFFSET, help=f"relative distance from the border of the two motions (default {OFFSET:g})"
    )


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    model = known("model", options.model, MODELS)
    gain = gain_of(options)
    how = Options(tol=finite("tol", options.tol))
    offset = finite("offset", options.offset)
    servo = servo_of(options)
    found = basin(servo, model, gain, options=how, offset=offset)  # type: ignore[arg-type]
    record = {
        "model": model,
        "gain": gain,
        "border": found.border,
        "unstable_amplitude": found.unstable.amplitude,
        "outer_position": found.outer_position if found.outer else None,
        "outer_amplitude": found.outer.amplitude if found.outer else None,
        "outer_half_multiplier": found.outer.half_multiplier if found.outer else None,
        "outer_stable": found.outer.stable if found.outer else None,
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
        says = "where it sticks within {0} rad of the set point it comes to rest, a little farther away it does not"
        if not found.confirmed:
            says = "an unstable hunting cycle stands at {0} rad; that it bounds coming to rest is not confirmed"
        print(f"{model} servo at gain {gain:.10g}: {says.format(to_error(found.border, found.error_estimate))}{where}")
        amplitude = to_error(found.unstable.amplitude, found.error_estimate)
        print(f"  unstable cycle   amplitude max |x1| = {amplitude} rad, estimated error "
              f"{error_text(found.error_estimate)}")  # fmt: skip
        print(f"  {_outer(found)}")
        for name, trial in (("inside", found.inside), ("outside", found.outside)):
            a = [f"{position:.4g}" for position in trial.positions]
            path = ", ".join(a if len(a) <= 6 else [*a[:4], "...", a[-1]])
            print(f"  from {name:8}    {trial.outcome} after {len(a) - 1} swings: {path} rad")
    if not found.confirmed:
        complain(
            "casahunt basin",
            "the motions from the two sides do not confirm the border: from a little inside it the servo should come "
            "to rest, from a little outside it should not; between the cycles it may do either",
        )
        return 1
    return 0


def _outer(found: Basin) -> str:
    """The line of the cycle beyond the border."""
    if found.outer is None:
        return f"stable cycle     {found.why_no_outer}"
    amplitude = f"amplitude max |x1| = {to_error(found.outer.amplitude, found.outer.amplitude_error)} rad"
    if found.outer.stable:
        return f"stable cycle     {amplitude}"
    mu = f"{found.outer.half_multiplier:.6g}"
    return f"symmetric cycle  {amplitude}, not stable (half multiplier {mu}): swings next to it leave it, unevenly"


def _record(trial: Trial) -> dict[str, Any]:
    return {"start": trial.start, "positions": trial.positions.tolist(), "outcome": trial.outcome}
