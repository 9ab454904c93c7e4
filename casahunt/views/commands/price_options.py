"""The options of what a remedy costs: which ones, the step or the move that it is priced by, limits, processes."""

from __future__ import annotations

from typing import Any

from ...errors import InputError
from ...servo.move import Move
from ...servo.parts.table import REMEDY_NAMES, remedy_name
from .arguments import Asked, positive
from .pool import jobs_of

PROFILE = {"speed": "rad/s", "acceleration": "rad/s2", "jerk": "rad/s3"}
"""The numbers of a profile, and their units."""
DEMANDS = {"max_error": ("error at rest", "rad"), "max_torque": ("torque", "N m")}
"""Limits that may be set, what they limit, and the unit."""


def add_profile(command: Any) -> None:
    """The options of a profile."""
    group = command.add_argument_group("the move (default: a step of the set point)")
    group.add_argument("--speed", metavar="V", help="the largest one of the set point in rad/s")
    group.add_argument("--acceleration", metavar="A", help="the largest one in rad/s2")
    group.add_argument("--jerk", metavar="J", help="the largest one in rad/s3 (default: none is the largest)")


def move_of(options: Asked) -> Move | None:
    """The profile that was asked for; None for a step.  Raises InputError: a part of one, or a number out of range."""
    given = {key: positive(key, x, unit) for key, unit in PROFILE.items() if (x := getattr(options, key)) is not None}
    if not given:
        return None
    missing = [key for key in ("speed", "acceleration") if key not in given]
    if missing:
        raise InputError(f"{missing[0]}: must be given too, a move has a speed and an acceleration")
    return Move(**given)


def add_demands(command: Any) -> None:
    """The arguments of which remedies are looked at, and of what they may cost."""
    names = ", ".join(REMEDY_NAMES)
    command.add_argument(
        "--only", action="append", default=[], metavar="NAME",
        help=f"only this remedy; repeat for more, or name several with commas between them: {names}",
    )  # fmt: skip
    command.add_argument("--max-error", metavar="RAD", help="largest error at rest that is allowed [rad]")
    command.add_argument(
        "--max-torque", metavar="NM", help="largest torque on the step, or the move, that is allowed [N m]"
    )
    command.add_argument("--step", metavar="RAD", help="how far (default 1 rad, or one unit of length)")
    add_profile(command)
    command.add_argument("--jobs", metavar="J", help="processes, to which remedies are shared out (default: all cores)")


def demands_of(options: Asked) -> tuple[dict[str, Any], dict[str, Any], int]:
    """Which remedies are looked at, and the step and move of their price, by `remedies`' names; what they may cost;
    and in how many processes."""
    names = [remedy_name(name.strip()) for text in options.only for name in text.split(",")]
    limits = {key: positive(key, x, DEMANDS[key][1]) for key in DEMANDS if (x := getattr(options, key)) is not None}
    step = None if options.step is None else positive("step", options.step, "rad")
    asked = {"only": names, "step": step, "move": move_of(options)}
    return asked, limits, min(jobs_of(options), len(names) or len(REMEDY_NAMES))
