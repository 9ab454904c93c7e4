"""casahunt loop: the linear loop without dry friction, at one or more gains."""

from __future__ import annotations

import argparse
from typing import Any

from ...results import tables_of
from ...servo.delayed_loop import margins
from ...servo.linear_loop import linear_loop, lowest_stable_gain, routh_hurwitz_gain
from ..answers.loop import loop_answer
from .arguments import add_command, add_gain, drive_of, positive, servo_of
from .output import give


def add(commands: Any) -> None:
    """The arguments of the command."""
    about, csv = "the linear loop: stability, poles and margins", "poles and margins, a row for each gain"
    loop = add_command(commands, "loop", about, tol=False, csv=csv, plot="controller and loop (Bode)")
    help_text = "controller gain in V/rad; may be given several times"
    add_gain(loop, action="append", example="0.1 --gain 0.4", help=help_text)


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    gains = [positive("gain", text) for text in options.gain]
    servo = servo_of(options)
    loops = [linear_loop(servo, gain) for gain in gains]
    frictionless, viscous = routh_hurwitz_gain(servo), lowest_stable_gain(servo)
    record = {
        "lowest_stable_gain": viscous,
        "lowest_stable_gain_without_viscous_friction": frictionless,
        "loops": loops,
    }
    drive = drive_of(options)
    lag, filter_time, delayed = 0.0, 0.0, []
    if drive is not None:
        lag = drive.delay + drive.sample_time / 2
        filter_time = drive.filter_of(servo.controller)
        delayed = [margins(servo, gain, delay=lag, filter_time=filter_time) for gain in gains]
        record["with_delay"] = {"delay": lag, "filter_time": filter_time, "margins": delayed}
    answer = loop_answer(loops, viscous, frictionless, lag, delayed, filter_time)
    give(options, record, answer, table=tables_of(loops), picture=("loop.bode", servo, loops))
    return 0
