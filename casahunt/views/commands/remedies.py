"""casahunt remedies: the smallest size of each remedy that ends hunting, and its price.

Key `remedies` of the JSON object: the rows, as `Cure.to_dict` gives them.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from typing import Any

from ...checks import choice_of, to_absolute_error
from ...design.remedies.price import TASK_STEP
from ...design.remedies.remedies import REMEDY_NAMES, Cure, Cures, remedies
from ...design.uncertainty.set import load_uncertainty
from ...results import tables_of
from .arguments import add_command, gain_of, how_of, model_of, positive, servo_of
from .console import progress, say
from .output import give

PRICE_DIGITS = 4
"""Digits of a price."""


def add(commands: Any) -> None:
    """The arguments of the command."""
    about, names = "what stops the hunting, how large, at what price", ", ".join(REMEDY_NAMES)
    plot = "amplitudes against sizes"
    command = add_command(commands, "remedies", about, gain=True, model="", csv="the rows", plot=plot)
    command.add_argument("--only", action="append", default=[], metavar="NAME", help=f"one of: {names}")
    command.add_argument("--max-error", metavar="RAD", help="largest error at rest that is allowed [rad]")
    command.add_argument("--max-torque", metavar="NM", help="largest torque on a step of 1 rad that is allowed [N m]")
    command.add_argument("--uncertainty", metavar="U.toml", help="what is uncertain: sizes for the worst servo too")


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    model, gain, how, stream = model_of(options), gain_of(options), how_of(options), progress(options.quiet)
    names = [choice_of("remedy", name.strip(), REMEDY_NAMES) for text in options.only for name in text.split(",")]
    servo = servo_of(options)
    limits = {key: None if getattr(options, key) is None else positive(key, getattr(options, key))
              for key in ("max_error", "max_torque")}  # fmt: skip
    found = remedies(
        servo, model, gain, only=names, options=how,
        uncertainty=None if options.uncertainty is None else load_uncertainty(options.uncertainty, servo),
        progress=lambda row: say(stream, _line(row)), **limits,
    )  # fmt: skip
    give(options, found, _lines(found, limits), table=tables_of([found]), picture=("remedies.remedy_sizes", found))
    return 0


def _line(row: Cure) -> str:
    """A row as it is found."""
    if not math.isfinite(row.size):
        return f"{row.name}: {row.why}"
    return f"{row.name}: {_size(row)}"


def _size(row: Cure) -> str:
    return f"{to_absolute_error(row.size, max(row.size_error, 1e-9 * abs(row.size)))} {row.unit}".rstrip()


def _lines(found: Cures, limits: dict[str, float | None]) -> Iterator[str]:
    yield (
        f"{found.model} servo at gain {found.gain:.10g} V/rad hunts with {found.amplitude:.{PRICE_DIGITS}g} rad and "
        f"{found.period:.{PRICE_DIGITS}g} s"
    )
    yield f"  {_advice(found, limits)}"
    yield "  smallest size that ends it        error at rest  torque on a step  settles in"
    for row in found.remedies:
        if row.ends_hunting:
            settles = f"{row.settling:.{PRICE_DIGITS}g} s" if math.isfinite(row.settling) else "longer"
            yield (
                f"    {row.name:18s} {row.size:9.{PRICE_DIGITS}g} {row.unit:5s} {row.rest_error:8.{PRICE_DIGITS}g} rad "
                f"{row.peak_torque:11.{PRICE_DIGITS}g} N m  {settles:>10s}"
            )
            if math.isfinite(row.worst_size):
                yield f"      for the worst servo {row.worst_size:.{PRICE_DIGITS}g} {row.unit}"
    for row in found.remedies:
        if not row.ends_hunting:
            yield f"  {row.name}  {_why(row)}"
    yield f"  prices are those of a tenth more than that size; the step is {TASK_STEP:g} rad"


def _why(row: Cure) -> str:
    """Why a remedy is none."""
    if not math.isfinite(row.size):
        return {"none": "does not end it: ", "not found": "not found: "}[row.kind] + row.why
    after = ", ".join(dict.fromkeys(row.stays))
    return f"the cycle ends at {_size(row)}, but beyond it the motion {after}: it is no remedy"


def _advice(found: Cures, limits: dict[str, float | None]) -> str:
    """The sentence that names one."""
    demands = " and ".join(
        f"{word} {limits[key]:g} {unit}"
        for key, word, unit in (("max_error", "an error at rest up to", "rad"), ("max_torque", "a torque up to", "N m"))
        if limits[key] is not None
    )
    within = f" within {demands}" if demands else ""
    best = next((row for row in found.remedies if row.name == found.best), None)
    if best is None:
        return f"none of these remedies ends it{within}"
    return f"the cheapest remedy{within} is: {best.name} {best.recommended:.{PRICE_DIGITS}g} {best.unit}".rstrip()
