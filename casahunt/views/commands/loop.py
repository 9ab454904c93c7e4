"""casahunt loop: the linear loop without dry friction, at one or more gains."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator, Sequence
from typing import Any

from ...checks import finite_or_none
from ...servo.linear_loop import Crossover, LinearLoop, linear_loop, lowest_stable_gain, routh_hurwitz_gain
from ..units import column
from .arguments import add_common, add_csv, add_gain, csv_of, picture_of, positive, servo_of
from .printed import show, write_records


def add(commands: Any) -> None:
    """The arguments of the command."""
    loop = commands.add_parser("loop", allow_abbrev=False, help="the linear loop: stability, poles and margins")
    help_text = "controller gain in V/rad; may be given several times"
    add_gain(loop, action="append", example="0.1 --gain 0.4", help=help_text)
    add_common(loop, tol=False)
    add_csv(loop, "poles and margins, a row for each gain")
    loop.add_argument("--plot", metavar="F.png", help="write the Bode picture of controller and loop")


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    gains = [positive("gain", text) for text in options.gain]
    servo = servo_of(options)
    plot, table = picture_of(options), csv_of(options)
    loops = [linear_loop(servo, gain) for gain in gains]
    if table:
        options.outputs.write(write_records, table, [_row(found) for found in loops])
    if plot:
        from ..pictures import loop as pictures_loop
        from ..pictures import plotting

        options.outputs.draw(lambda: plotting.save(pictures_loop.bode(servo, loops), plot))
    frictionless, viscous = routh_hurwitz_gain(servo), lowest_stable_gain(servo)
    if options.json:
        record = {
            "lowest_stable_gain": finite_or_none(viscous),
            "lowest_stable_gain_without_viscous_friction": finite_or_none(frictionless),
            "loops": [_record(loop) for loop in loops],
        }
        print(json.dumps(record))
        return 0
    show(_lines(loops, viscous, frictionless))
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


def _row(loop: LinearLoop) -> dict[str, Any]:
    """A loop as a row of a table, with the least of its phase margins."""
    least = min(loop.gain_crossovers, key=lambda c: abs(c.margin), default=None)
    row = {
        column("gain"): loop.gain,
        "stable": bool(loop.stable),
        "phase_margin_deg": least.margin if least else math.nan,
        "crossover_rad_per_s": least.frequency if least else math.nan,
        "lowest_factor": loop.lowest_factor,
        "highest_factor": loop.highest_factor,
        "damping_ratio": loop.damping_ratio,
        "kp_Nm_per_rad": loop.kp,
        "ki_Nm_per_rad_s": loop.ki,
        "kd_Nms_per_rad": loop.kd,
    }
    for i, pole in enumerate(loop.poles, 1):
        row |= {f"pole_{i}_re_per_s": pole.real, f"pole_{i}_im_per_s": pole.imag}
    return row


def _record(loop: LinearLoop) -> dict[str, Any]:
    def crossovers(items: tuple[Crossover, ...], name: str) -> list[dict[str, float]]:
        return [{"frequency": c.frequency, name: c.margin} for c in items]

    return {
        "gain": loop.gain,
        "kp": loop.kp,
        "kd": loop.kd,
        "ki": loop.ki,
        "stable": loop.stable,
        "poles": [[pole.real, pole.imag] for pole in loop.poles],
        "damping_ratio": loop.damping_ratio,
        "gain_crossovers": crossovers(loop.gain_crossovers, "phase_margin_deg"),
        "phase_crossovers": crossovers(loop.phase_crossovers, "gain_factor"),
        "lowest_factor": loop.lowest_factor,
        "highest_factor": finite_or_none(loop.highest_factor),
    }


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
