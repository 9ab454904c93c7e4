"""casahunt basin: how near to its set point a servo that stands still comes to rest."""

from __future__ import annotations

import argparse
from typing import Any

from ...results import tables_of
from ...servo.basin import OFFSET, basin
from ..answers.answer import record_of
from ..answers.basin import basin_answer
from .arguments import add_command, asked_of, drive_of, finite, how_of
from .console import complain
from .output import give


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = add_command(
        commands, "basin", "how near to the set point it must stand to come to rest", gain=True, model="",
        csv="the stick positions of the two motions", plot="the motions from both sides",
    )  # fmt: skip
    command.add_argument(
        "--offset", default=OFFSET,
        help=f"of one inertia, relative distance from the border of the two motions (default {OFFSET:g})",
    )


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    how, offset, asked = how_of(options), finite("offset", options.offset), asked_of(options, gain=True)
    found = basin(*asked, options=how, offset=offset)
    drive = drive_of(options)
    answer = basin_answer(found, how.tol, drive.count if drive else 0.0)
    record = found.to_dict(table=False) | record_of(asked[0])
    give(options, record, answer, table=tables_of([found]), picture=("basin.basin", found))
    if not found.confirmed:
        complain(
            "casahunt basin",
            "the motions from the two sides do not confirm the border: from a little inside it the servo should come "
            "to rest, from a little outside it should not; between the cycles it may do either",
        )
        return 1
    return 0
