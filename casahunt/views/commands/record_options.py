"""The options by which commands read a record: its columns, their units, and from when on."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from ...errors import InputError
from .arguments import Asked, Parser, count_of, finite, positive

if TYPE_CHECKING:
    from ...design.record.file import Record

TORQUE_OPTIONS = ("torque_column", "current_column", "torque_constant")
"""How the torque of the motor is read from a record, by the commands that fit it."""


def add_reading(command: Parser) -> None:
    """How a record is read from its file."""
    command.add_argument("--time-unit", metavar="U", help="unit of the times: s, ms, min ... or a number of s")
    command.add_argument("--position-unit", metavar="U", help="unit of the positions: rad, deg ... or a number of rad")
    command.add_argument("--time-column", metavar="C", help="column of the times: its header, or its number from 1")
    command.add_argument("--position-column", metavar="C", help="column of the positions, in the same way")
    command.add_argument("--skip", metavar="N", help="leave out the first N lines, such as a preamble")
    command.add_argument("--from", dest="start", help="leave out what comes before this time in s")


def reading_of(options: Asked) -> dict[str, Any]:
    """How a record is read, as `read_record` takes it."""
    # The columns of the torque, of commands that read it
    given = {name: value for name in TORQUE_OPTIONS if (value := getattr(options, name, None)) is not None}
    if "torque_constant" in given:
        given["torque_constant"] = positive("torque-constant", given["torque_constant"], "N m/A")
    return {
        "time_unit": options.time_unit, "position_unit": options.position_unit, "time_column": options.time_column,
        "position_column": options.position_column,
        "skip": None if options.skip is None else count_of("skip", options.skip, 0),
    } | given  # fmt: skip


def add_torque(command: Parser) -> None:
    """How the torque of the motor is read from a record."""
    command.add_argument("--torque-column", metavar="C", help="column of the torque of the motor, which is fitted too")
    command.add_argument("--current-column", metavar="C", help="column of its current, instead of the torque")
    command.add_argument(
        "--torque-constant", metavar="NM", help="N m of an ampere, or of one of the torque column's unit"
    )


def later_part(record: Record, options: Asked) -> Record:
    """The record from --from on.  Raises InputError: nothing is left of it."""
    if options.start is None:
        return record
    start = finite("from", options.start, "s")
    rest = record.after(start)
    if rest.times.size == 0:
        raise InputError(f"from = {start:g}: must lie before the end of {record.name}")
    return rest
