"""casahunt basin: the amplitude below which the stuck servo settles."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from ...checks import error_text, to_error
from ...results import tables_of
from ...servo.basin import OFFSET, Basin, basin
from .arguments import add_command, finite, gain_of, how_of, model_of, servo_of
from .console import complain, complex_text
from .output import give


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = add_command(
        commands, "basin", "the amplitude below which the servo settles", gain=True, model="",
        csv="the stick positions of the two motions", plot="the motions from both sides",
    )  # fmt: skip
    command.add_argument(
        "--offset", default=OFFSET, help=f"relative distance from the border of the two motions (default {OFFSET:g})"
    )


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    model, gain, how = model_of(options), gain_of(options), how_of(options)
    offset = finite("offset", options.offset)
    found = basin(servo_of(options), model, gain, options=how, offset=offset)
    give(options, found, _lines(found, how.tol), table=tables_of([found]), picture=("basin.basin", found))
    if not found.confirmed:
        complain(
            "casahunt basin",
            "the motions from the two sides do not confirm the border: from a little inside it the servo should come "
            "to rest, from a little outside it should not; between the cycles it may do either",
        )
        return 1
    return 0


def _lines(found: Basin, tol: float) -> Iterator[str]:
    model, border = found.unstable.model, to_error(found.border, found.error_estimate)
    says = f"where it sticks within {border} rad of the set point it comes to rest, a little farther away it does not"
    if not found.confirmed:
        says = f"an unstable hunting cycle stands at {border} rad; that it bounds coming to rest is not confirmed"
    where = "" if model == "switch" else " (x1 at m = 0.9 Fs before breakaway)"
    yield f"{model} servo at gain {found.unstable.gain:.10g} V/rad: {says}{where}"
    amplitude = to_error(found.unstable.amplitude, found.error_estimate)
    yield f"  unstable cycle   amplitude max |x1| = {amplitude} rad"
    yield f"  estimated error  {error_text(found.error_estimate)} (relative, of its amplitude and period)"
    yield f"  {_outer(found)}"
    for name, trial in (("inside", found.inside), ("outside", found.outside)):
        a = [to_error(position, tol, most=4) for position in trial.positions]
        path = ", ".join(a if len(a) <= 6 else [*a[:4], "...", a[-1]])
        yield f"  from {name:8}    {trial.outcome} after {len(a) - 1} swings: {path} rad"


def _outer(found: Basin) -> str:
    """The line of the cycle beyond the border."""
    if found.outer is None:
        return f"stable cycle     {found.why_no_outer}"
    amplitude = f"amplitude max |x1| = {to_error(found.outer.amplitude, found.outer.amplitude_error)} rad"
    if found.outer.stable:
        return f"stable cycle     {amplitude}"
    m = found.outer.multipliers
    mu = complex_text(m.leading, m.error, m.leading_floor)
    return f"symmetric cycle  {amplitude}, not stable (half multiplier {mu}): swings next to it leave it, unevenly"
