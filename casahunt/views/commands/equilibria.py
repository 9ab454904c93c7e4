"""casahunt equilibria: where the servo can stand still, and what linearising there proves."""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from ...results import tables_of
from ...servo.equilibria import PROVES, Equilibria, equilibria
from .arguments import add_command, gain_of, model_of, servo_of
from .output import give


def add(commands: Any) -> None:
    """The arguments of the command."""
    add_command(
        commands, "equilibria", "where the servo can stand still", gain=True, tol=False, model="",
        csv="the limits and conditions", plot="the stick region, or of the eigenvalues",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    model, gain = model_of(options), gain_of(options)
    found = equilibria(servo_of(options), model, gain)
    give(options, found, _lines(found), table=tables_of([found]), picture=("equilibria.equilibria", found))
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
