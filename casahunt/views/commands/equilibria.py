"""casahunt equilibria: where the servo can stand still, and what linearising there proves."""

from __future__ import annotations

import argparse
import json
from typing import Any

from ...checks import known
from ...servo.equilibria import PROVES, Equilibria, equilibria
from ...servo.hunting import MODELS
from .arguments import add_common, gain_of, picture_of, servo_of


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = commands.add_parser("equilibria", allow_abbrev=False, help="where the servo can stand still")
    add_common(command, tol=False)
    command.add_argument("--model", default="switch", help="switch (default) or lugre")
    command.add_argument("--gain", help="controller gain K, required")
    command.add_argument("--plot", metavar="F.png", help="write a picture: stick region, or eigenvalues")


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    model = known("model", options.model, MODELS)
    gain = gain_of(options)
    servo = servo_of(options)
    plot = picture_of(options)
    found = equilibria(servo, model, gain)  # type: ignore[arg-type]
    if plot:
        from ..pictures import equilibria as pictures_equilibria
        from ..pictures import plotting

        options.outputs.draw(lambda: plotting.save(pictures_equilibria.picture(found), plot))
    if options.json:
        print(json.dumps(record_of(found)))
        return 0
    print(f"{model} servo at gain {gain:.10g}: equilibria x1 = x2 = 0, |x3| <= Fs/ki = "
          f"{found.integral_limit:.10g} rad s")  # fmt: skip
    if model == "switch":
        print(f"  stick region  x2 = 0, |kp x1 + ki x3| <= Fs: at x3 = 0, |x1| <= {found.position_limit:.10g} rad")
        print("  every other point of it breaks away after a finite time; linearising says nothing here, the stick")
        print("  mode has no other eigenvalues than zero")
        return 0
    print(f"  bristle       z = -ki x3/sigma0, |z| <= Fs/sigma0 = {found.bristle_limit:.10g} rad")
    print(f"  generalised Jacobian: one eigenvalue 0; of the others, over {found.q.size} x {found.alpha.size} members, "
          f"the largest real part is {found.largest.max():.8g} 1/s")  # fmt: skip
    for name, sides, unit in (("sharp ", found.sharp, "N m s/rad"), ("simple", found.simple, "1/s")):
        text = {"sharp ": "kd + sigma2 > J ki/kp", "simple": "sigma2/J > ki/kp"}[name]
        print(f"  {name} condition {text}: {sides[0]:.8g} {'>' if sides[0] > sides[1] else '<='} {sides[1]:.8g} {unit}")
    print("    sharp: all members are stable but for the zero, if and only if; simple: sufficient, and for all K > 0")
    if found.threshold:
        print(f"  unstable members: 1 - (2 alpha - 1) sigma0 z/Fs < {found.threshold:.4g}, at the ends of the segment")
    print(f"  {PROVES}")
    return 0


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
