"""What is uncertain of a servo, from a file: read; and from wherever it is: said, where a part of it is no servo."""

from __future__ import annotations

import argparse

from ...design.uncertainty.set import Uncertainty, load_uncertainty, part_without_servos
from ...servo.parts.loop import Loop
from ...servo.servo import Servo
from .progress import say


def uncertainty_of(options: argparse.Namespace, servo: Servo | Loop) -> Uncertainty | None:
    """What is uncertain by the file of the command line; None without one."""
    if options.uncertainty is None:
        return None
    uncertainty = load_uncertainty(options.uncertainty, servo)
    say_what_is_left_out(servo, uncertainty)
    return uncertainty


def say_what_is_left_out(servo: Servo | Loop, uncertainty: Uncertainty) -> None:
    """Say which part of an uncertainty is left out, where one is."""
    if said := part_without_servos(servo, uncertainty):
        say(said)
