"""casahunt equilibria: where the servo can stand still, and what linearising there proves."""

from __future__ import annotations

import argparse
from typing import Any

from ...results import tables_of
from ...servo.equilibria import equilibria
from ..answers.equilibria import equilibria_answer
from .arguments import add_command, gain_of, loop_of, model_of, servo_of
from .loops import shared
from .output import give


def add(commands: Any) -> None:
    """The arguments of the command."""
    add_command(
        commands, "equilibria", "where the servo can stand still", gain=True, tol=False, model="",
        csv="the limits and conditions", plot="the places of rest, or of the eigenvalues",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    loop = loop_of(options)
    found = equilibria(loop) if loop else equilibria(servo_of(options), model_of(options), gain_of(options))
    record = found.to_dict(table=False) | (shared.record_of(loop) if loop else {})
    give(options, record, equilibria_answer(found), table=tables_of([found]), picture=("equilibria.equilibria", found))
    return 0
