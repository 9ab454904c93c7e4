"""casahunt equilibria: where the servo can stand still, and what linearising there proves."""

from __future__ import annotations

import argparse
import json
import math
from collections.abc import Iterator
from typing import Any

from ...checks import known
from ...servo.equilibria import PROVES, Equilibria, equilibria
from ...servo.hunting import MODELS
from ..units import column
from .arguments import add_common, add_csv, add_gain, csv_of, gain_of, picture_of, servo_of
from .printed import show, write_records


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = commands.add_parser("equilibria", allow_abbrev=False, help="where the servo can stand still")
    add_gain(command)
    add_common(command, tol=False)
    command.add_argument("--model", default="switch", help="switch (default) or lugre")
    add_csv(command, "the limits and conditions")
    command.add_argument("--plot", metavar="F.png", help="write a picture: stick region, or eigenvalues")


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    model = known("model", options.model, MODELS)
    gain = gain_of(options)
    servo = servo_of(options)
    plot, table = picture_of(options), csv_of(options)
    found = equilibria(servo, model, gain)  # type: ignore[arg-type]
    if table:
        options.outputs.write(write_records, table, [_row(found)])
    if plot:
        from ..pictures import equilibria as pictures_equilibria
        from ..pictures import plotting

        options.outputs.draw(lambda: plotting.save(pictures_equilibria.picture(found), plot))
    if options.json:
        print(json.dumps(record_of(found)))
        return 0
    show(_lines(found))
    return 0


def _lines(found: Equilibria) -> Iterator[str]:
    yield f"{found.model} servo at gain {found.gain:.10g} V/rad"
    yield "  state             x1 position from the set point, x2 velocity, x3 integral of x1"
    yield f"  equilibria        x1 = x2 = 0, |x3| <= Fs/ki = {found.integral_limit:.10g} rad s"
    if found.model == "switch":
        yield f"  stick region      x2 = 0, |kp x1 + ki x3| <= Fs: at x3 = 0, |x1| <= {found.position_limit:.10g} rad"
        yield "  elsewhere in it   the integral grows until the servo breaks away, after a finite time"
        yield "  linearising       says nothing here: while it sticks the servo has no other eigenvalues than zero"
        return
    yield f"  bristle           z = -ki x3/sigma0, |z| <= Fs/sigma0 = {found.bristle_limit:.10g} rad"
    yield (
        f"  linearising       friction has a kink at x2 = 0: the generalised Jacobian has one eigenvalue 0; of the "
        f"others, over {found.q.size} x {found.alpha.size} of its members, the largest real part is "
        f"{found.largest.max():.8g} 1/s"
    )
    for name, text, sides, unit, says in (
        ("sharp", "kd + sigma2 > J ki/kp", found.sharp, "N m s/rad", "necessary and sufficient"),
        ("simple", "sigma2/J > ki/kp", found.simple, "1/s", "sufficient, and for all K > 0"),
    ):
        than, holds = (">", "it holds") if sides[0] > sides[1] else ("<=", "it does not hold")
        yield (
            f"  {f'{name} condition':16}  {text}, {says} for all members to be stable but for the zero: "
            f"{sides[0]:.8g} {than} {sides[1]:.8g} {unit}, {holds}"
        )
    if found.threshold:
        yield f"  unstable members 1 - (2 alpha - 1) sigma0 z/Fs < {found.threshold:.4g}, at the ends of the segment"
    for sentence in PROVES.split(". "):
        about, _, text = sentence.rstrip(".").partition(": ")
        yield f"  {'not proved' if 'not' in about else 'proved':16}  {text}"


def _row(found: Equilibria) -> dict[str, Any]:
    lugre = found.model == "lugre"
    return {
        "model": found.model,
        column("gain"): found.gain,
        "integral_limit_rad_s": found.integral_limit,
        "position_limit_rad": found.position_limit,
        "bristle_limit_rad": found.bristle_limit if lugre else math.nan,
        "largest_real_part_per_s": float(found.largest.max()) if lugre else math.nan,
        "sharp_left_Nms_per_rad": found.sharp[0],
        "sharp_right_Nms_per_rad": found.sharp[1],
        "simple_left_per_s": found.simple[0],
        "simple_right_per_s": found.simple[1],
        "threshold": found.threshold if lugre else math.nan,
    }


def record_of(found: Equilibria) -> dict[str, Any]:
    """The JSON object; null for what belongs to LuGre alone."""
    lugre = found.model == "lugre"
    return {
        "model": found.model,
        "gain": found.gain,
        "integral_limit": found.integral_limit,
        "position_limit": found.position_limit,
        "bristle_limit": found.bristle_limit if lugre else None,
        "largest_real_part": float(found.largest.max()) if lugre else None,
        "members": int(found.largest.size),
        "sharp_condition": {"left": found.sharp[0], "right": found.sharp[1], "holds": found.sharp_holds},
        "simple_condition": {"left": found.simple[0], "right": found.simple[1], "holds": found.simple_holds},
        "threshold": found.threshold if lugre else None,
        "proves": PROVES,
    }
