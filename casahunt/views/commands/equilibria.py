"""casahunt equilibria: where the servo can stand still, and what linearising there proves."""

from __future__ import annotations

import argparse
from typing import Any

from ...results import tables_of
from ...servo.equilibria import equilibria
from ..answers.equilibria import equilibria_answer
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
    give(options, found, equilibria_answer(found), table=tables_of([found]), picture=("equilibria.equilibria", found))
    return 0
