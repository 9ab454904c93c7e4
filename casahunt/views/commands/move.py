"""The options of a move: by which profile the set point goes where it is to be."""

from __future__ import annotations

import argparse
from typing import Any

from ...errors import InputError
from ...servo.move import Move
from .arguments import positive

PROFILE = {"speed": "rad/s", "acceleration": "rad/s2", "jerk": "rad/s3"}
"""The numbers of a profile, and their units."""


def add_profile(command: Any) -> None:
    """The options of a profile."""
    group = command.add_argument_group("the move (default: a step of the set point)")
    group.add_argument("--speed", metavar="V", help="the largest one of the set point in rad/s")
    group.add_argument("--acceleration", metavar="A", help="the largest one in rad/s2")
    group.add_argument("--jerk", metavar="J", help="the largest one in rad/s3 (default: none is the largest)")


def move_of(options: argparse.Namespace) -> Move | None:
    """The profile that was asked for; None for a step.  Raises InputError: a part of one, or a number out of range."""
    given = {key: positive(key, x, unit) for key, unit in PROFILE.items() if (x := getattr(options, key)) is not None}
    if not given:
        return None
    missing = [key for key in ("speed", "acceleration") if key not in given]
    if missing:
        raise InputError(f"{missing[0]}: must be given too, a move has a speed and an acceleration")
    return Move(**given)
