"""casahunt fold: the largest gain at which the servo can hunt, and the largest one with a stable cycle.

Key `stable` of the JSON object: see views/stability.py.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator
from typing import Any

from ...checks import error_text, known_decimals, to_error
from ...design.sensitivity import Sensitivities, fold_sensitivities
from ...orbits import Options
from ...results import tables_of
from ...servo.find_fold import find_fold
from ...servo.problem import HuntingFold
from ..stability import stability_of
from .arguments import add_command, add_solver, how_of, model_of, servo_of
from .console import progress, progress_line, say
from .output import give

MOST_DECIMALS = 4
"""Of a sensitivity in per cent of the gain."""


def add(commands: Any) -> None:
    """The arguments of the command."""
    about = "the largest gain at which the servo can hunt"
    add_solver(add_command(commands, "fold", about, model="", csv="the sensitivities", plot="the sensitivities"))


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    model, how = model_of(options), how_of(options)
    fold = find_fold(servo_of(options), model, options=how)
    slopes, stable = fold_sensitivities(fold), stability_of(fold, how)
    more = {"elasticities": slopes.elasticities, "stable": stable, "solver": how.solver}
    say(progress(options.quiet), progress_line(fold.orbit, mu="+1 (fold)"))
    give(
        options, fold.to_dict(table=False) | more, _lines(fold, slopes, stable, how), table=tables_of([slopes]),
        picture=("fold.elasticities", [fold], [slopes]),
    )  # fmt: skip
    return 0


def _lines(fold: HuntingFold, slopes: Sensitivities, stable: dict[str, Any], how: Options) -> Iterator[str]:
    yield f"{fold.orbit.model} servo: hunting is possible up to gain {to_error(fold.gain, fold.gain_error)} V/rad"
    yield f"  estimated error  {error_text(fold.gain_error)} (relative, of the gain)"
    yield f"  amplitude there  {to_error(fold.orbit.amplitude, fold.orbit.amplitude_error)} rad"
    yield f"  period there     {to_error(fold.orbit.period, fold.orbit.period_error)} s"
    yield f"  a stable cycle   {stable['sentence']}"
    way = "turning point of the equations (Newton)" if how.solver == "newton" else "optimisation problem (IPOPT)"
    yield f"  computed twice   as {way}: {to_error(fold.optimised_gain, fold.gain_error)} V/rad"
    yield "  one per cent more of        changes that gain by"
    for name, value in sorted(slopes.elasticities.items(), key=lambda item: -abs(item[1])):
        yield f"    {name:26s} {sensitivity_text(value, how.tol):>9s} %"
    yield f"  {fold.wall_s:.2f} s"


def sensitivity_text(value: float, tol: float) -> str:
    """Per cent of the fold gain per per cent, to the tolerance, four decimals at most.

    value, tol: the elasticity, and the tolerance: it is known to that much and better.
    """
    return f"{value:+.{known_decimals(tol, MOST_DECIMALS)}f}"
