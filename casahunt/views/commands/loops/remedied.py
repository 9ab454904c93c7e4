"""A servo with remedies given by options, in the continuous loop: as the loop of parts that simulate follows."""

from __future__ import annotations

import argparse
from collections.abc import Mapping
from typing import TYPE_CHECKING

from ....errors import InputError
from ....servo.drive import DRIVE_KEYS, SHARES
from ....servo.friction import Model
from ....servo.sampled.as_run import DRIVE_PARTS
from ....servo.servo import Servo
from ....servo.units import kinds_of
from ..arguments import drive_of, finite, left_out

if TYPE_CHECKING:
    from ....servo.parts import Loop

OF_DRIVE_ALONE = tuple(key for key in DRIVE_KEYS if key not in (*DRIVE_PARTS.values(), *SHARES, "sample_time"))
"""Keys that mean nothing to the continuous loop."""


def remedies_given(options: argparse.Namespace) -> dict[str, float]:
    """The remedies of the options where they are asked of the continuous loop: numbers by key; {} without any.

    What is returned is taken out of the options. Raises InputError: one is no number, or there is something beside it
    that only the loop as built has.
    """
    given = {key: text for key in (*DRIVE_PARTS.values(), *SHARES) if (text := getattr(options, key)) is not None}
    if options.sample_time is None and (not given or drive_of(options) is not None):
        return {}
    if options.sample_time is not None and finite("sample-time", options.sample_time, "s") != 0:
        return {}
    why = "it is of the loop as built, and without a sample time the loop is a continuous one"
    left_out(options, why, *OF_DRIVE_ALONE)
    numbers = {key: finite(key.replace("_", "-"), text, *kinds_of(key)) for key, text in given.items()}
    for key in given:
        setattr(options, key, None)
    return numbers


def with_remedies(servo: Servo, model: Model, gain: float, given: Mapping[str, float]) -> Loop:
    """The continuous loop with remedies; given: as of `remedies_given`.  Raises InputError: one does not go with it."""
    from ....servo.parts import loop_of  # not read for a servo without a remedy
    from ....servo.parts.table import remedies_for, with_remedy

    loop, there = loop_of(servo, model, gain), remedies_for(model)
    for key, of in SHARES.items():
        if key in given and of not in given:
            raise InputError(f"{key.replace('_', '-')}: must be left out without {of.replace('_', '-')}")
    for name, key in DRIVE_PARTS.items():
        if key in given:
            if name not in there:
                only = "in the continuous loop it goes with Switch friction alone"
                raise InputError(f"{key.replace('_', '-')}: must be left out, {only}")
            loop = with_remedy(loop, there[name], given[key])
    return loop.replace(**{key: given[key] for key in SHARES if key in given})
