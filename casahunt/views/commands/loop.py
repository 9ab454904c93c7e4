"""casahunt loop: the linear loop without dry friction, at one or more gains."""

from __future__ import annotations

from typing import Any

from ...results import tables_of
from ...servo.gains import lowest_stable_gain, routh_hurwitz_gain
from ...servo.linear.linear_loop import linear_loop
from ...servo.linear.margins import margins
from ...servo.linear.open_loop import either_way
from ...servo.units import GAIN_UNIT
from ..answers.loop import loop_answer
from .arguments import Asked, add_command, add_gain, positive
from .output import give


def add(commands: Any) -> None:
    """The arguments of the command."""
    about, csv = "the linear loop: stability, poles and margins", "poles and margins, a row for each gain"
    loop = add_command(commands, "loop", about, tol=False, csv=csv, plot="controller and loop (Bode)")
    help_text = "controller gain in V/rad; may be given several times"
    add_gain(loop, action="append", example="0.1 --gain 0.4", help=help_text)


def run(options: Asked) -> int:
    """Compute and print; returns the exit code."""
    gains = [positive("gain", text, GAIN_UNIT) for text in options.gain or ()] or [options.stated_gain()]
    (servo, model), drive = options.subject(), options.drive()
    ways = either_way(servo)
    loops = [linear_loop(servo, gain, back=way == "back") for gain in gains for way in ways]
    built = [margins(ways[loop.direction], loop.gain, drive=drive) for loop in loops] if drive is not None else []
    record: dict[str, Any] = {"loops": loops}
    limits = None
    if model:
        limits = lowest_stable_gain(servo), routh_hurwitz_gain(servo)
        record |= dict(zip(("lowest_stable_gain", "lowest_stable_gain_without_viscous_friction"), limits, strict=True))
    if drive is not None:
        record |= {"as_built": {"drive": drive, "margins": built}}
    within = [] if model else [part.name for part in servo.present if part.saturates]
    picture = "loop.bode", servo, loops, drive
    give(options, record, loop_answer(loops, limits, drive, built, within), table=tables_of(loops), picture=picture)
    return 0
