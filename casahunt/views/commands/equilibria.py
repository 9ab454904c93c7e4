"""casahunt equilibria: where the servo can stand still, and what linearising there proves."""

from __future__ import annotations

import argparse
from typing import Any

from ...results import tables_of
from ...servo.equilibria import equilibria
from ..answers.answer import record_of
from ..answers.equilibria import equilibria_answer
from .arguments import add_command, asked_of
from .output import give


def add(commands: Any) -> None:
    """The arguments of the command."""
    add_command(
        commands, "equilibria", "where the servo can stand still", gain=True, tol=False, model="",
        csv="the limits and conditions", plot="the places of rest, or of the eigenvalues",
    )  # fmt: skip


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    asked = asked_of(options, gain=True)
    found = equilibria(*asked)
    record = found.to_dict(table=False) | record_of(asked[0])
    give(options, record, equilibria_answer(found), table=tables_of([found]), picture=("equilibria.equilibria", found))
    return 0
