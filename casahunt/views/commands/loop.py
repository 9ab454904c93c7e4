"""casahunt loop: the linear loop without dry friction, at one or more gains."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator, Sequence
from typing import Any

from ...results import tables_of
from ...servo.linear_loop import LinearLoop, linear_loop, lowest_stable_gain, routh_hurwitz_gain
from .arguments import add_command, add_gain, positive, servo_of
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
    lines = _lines(loops, viscous, frictionless)
    give(options, record, lines, table=tables_of(loops), picture=("loop.bode", servo, loops))
    return 0


def _lines(loops: Sequence[LinearLoop], viscous: float, frictionless: float) -> Iterator[str]:
    yield "linear loop, dry friction left out"
    yield f"  with viscous friction     {_stable_from(viscous)}"
    yield f"  without any friction      {_stable_from(frictionless)}"
    for loop in loops:
        yield f"gain {loop.gain:.10g} V/rad: {'stable' if loop.stable else 'unstable'}"
        yield f"  poles            {', '.join(_pole(pole) for pole in loop.poles)} 1/s"
        for c in loop.gain_crossovers:
            yield f"  phase margin     {c.margin:.8g} degrees at {c.frequency:.8g} rad/s, where |L| = 1"
        yield f"  gain margin      {_gain_margin(loop)}"
    yield "A stable linear loop does not say that the servo does not hunt: dry friction is not in it."


def _stable_from(gain: float) -> str:
    if gain == 0:
        return "stable for every gain K > 0 (Routh-Hurwitz)"
    if not math.isfinite(gain):
        return "stable for no gain"
    return f"stable for every gain K > {gain:.10g} V/rad (Routh-Hurwitz)"


def _pole(pole: complex) -> str:
    return f"{pole.real:.8g}{pole.imag:+.8g}j" if pole.imag else f"{pole.real:.8g}"


def _gain_margin(loop: LinearLoop) -> str:
    becomes = "unstable" if loop.stable else "stable"
    limits = [
        f"{becomes} where K is multiplied by {factor:.8g}"
        for factor in (loop.lowest_factor, loop.highest_factor)
        if 0 < factor < math.inf
    ]
    return "; ".join(limits) or f"none: {'stable' if loop.stable else 'unstable'} at every gain"
