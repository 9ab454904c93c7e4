"""All remedies, in the order in which they are told of: one line for each file."""

from __future__ import annotations

import dataclasses

from ...axis_units import shown
from ...checks import choice_of
from ...errors import InputError
from ..units import PARAMETER_UNITS, kinds_of
from . import dead_band, dither, error_filter, feedforward, freeze, leak, reset
from .loop import Loop
from .part import Part
from .remedy import Remedy, at_the_set_point

REMEDIES: tuple[Remedy, ...] = (
    *dead_band.REMEDIES,
    *leak.REMEDIES,
    *freeze.REMEDIES,
    *reset.REMEDIES,
    *error_filter.REMEDIES,
    *feedforward.REMEDIES,
    *dither.REMEDIES,
    # more gain, more derivative action, less integral action
    Remedy("gain", "gain", "V/rad", at_the_set_point, scale="own", first=1.0, last=1e4),
    Remedy("derivative", "kd", "s", at_the_set_point, scale="own", first=1.0, last=1e4),
    Remedy("integral", "ki", "1/s", at_the_set_point, sense=-1, scale="own", first=1.0, last=1e-6),
)
REMEDY_NAMES = tuple(dict.fromkeys(remedy.name for remedy in REMEDIES))
NOT_IN_THE_MODEL = ("backlash", "delay", "noise", "quantisation", "sampling")
"""What a servo has and no part of a loop is."""
AS_BUILT = ("delay", "quantisation", "sampling")
"""What of it a motion of the loop as built has (servo/sampled)."""


def unit_of(parameter: str) -> str:
    """The unit of a parameter: of those that a servo has, by key or name, and of the sizes of remedies; else ""."""
    parameter = parameter.rpartition(".")[2]
    if not shown().plain:
        return kinds_of(parameter)[0] if parameter != "kp" else ""
    units = {key.rpartition(".")[2]: unit for key, unit in PARAMETER_UNITS.items()}
    return (units | {remedy.size: remedy.unit for remedy in REMEDIES}).get(parameter, "")


def remedies_for(model: str) -> dict[str, Remedy]:
    """The remedies that are parts of their own, by name, of those that go with a friction model."""
    return {remedy.name: remedy for remedy in REMEDIES if remedy.part is not None and model in remedy.needs}


def remedy_of(name: str, model: str) -> Remedy:
    """A remedy, by its name, as it goes with a friction model; where it does not, as it goes with another one."""
    known = [remedy for remedy in REMEDIES if remedy.name == name]
    return next((remedy for remedy in known if model in remedy.needs), known[0])


def with_remedy(loop: Loop, remedy: Remedy, size: float) -> Loop:
    """The loop with a remedy of a size, which it may have already, of another size or none."""
    if remedy.part is None or remedy.part in loop.parts:
        return loop.replace(**{remedy.size: size})
    if not remedy.instead:
        return loop.with_parts(remedy.part, **{remedy.size: size})
    parts: tuple[Part, ...] = tuple(remedy.part if part.name == remedy.instead else part for part in loop.parts)
    return dataclasses.replace(loop, parts=parts, values={**loop.values, remedy.size: size})


def remedy_name(name: str) -> str:
    """The name of a remedy.  Raises InputError: it is none; says the nearest, or that the model has no such thing."""
    check_in_the_model(name)
    return choice_of("remedy", name, REMEDY_NAMES)


def check_in_the_model(name: str) -> None:
    """Refuse what a servo has and no part of a loop is.  Raises InputError: it is such a thing."""
    if name.lower() in AS_BUILT:
        raise InputError(
            f"{name}: is no remedy, and no part of a loop; casahunt simulate computes motions with it, of a servo "
            "whose file has a table [drive] (docs/howto/as_built.md)"
        )
    if name.lower() in NOT_IN_THE_MODEL:
        raise InputError(
            f"{name}: is no remedy, and no part of this model of a servo; a loop with it is a system of your own "
            "(docs/engine.md)"
        )
