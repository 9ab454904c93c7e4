"""casahunt fold: the largest gain at which the servo can hunt, and the largest one with a stable cycle.

Key `stable` of the JSON object: see views/stability.py; `as_built`: as of orbit.  Of a loop of parts: the border of
hunting in any parameter;
`parameters` are those at the fold, `way` is "up" where the loop hunts below it.
"""

from __future__ import annotations

import argparse
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING, Any

from ...checks import error_text, to_error
from ...continuation import Fold
from ...design.sensitivity import Sensitivities, fold_sensitivities
from ...orbits import Options
from ...results import tables_of
from ...servo.find_fold import find_fold
from ..stability import stability_of
from .arguments import add_command, add_solver, add_vary, how_of, loop_of, model_of, servo_of, vary_of
from .console import progress, progress_line, say, sensitivity_text
from .loops import shared
from .output import give
from .sampled import seen_by_encoder

if TYPE_CHECKING:
    from ...servo.parts import Loop

def add(commands: Any) -> None:
    """The arguments of the command."""
    about = "the largest gain at which the servo can hunt"
    command = add_command(commands, "fold", about, model="", csv="the sensitivities", plot="the sensitivities")
    add_vary(command, "in which hunting ends")
    add_solver(command)


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    model, how = model_of(options), how_of(options)
    loop, vary = loop_of(options), vary_of(options)
    if loop is not None:
        return _of_a_loop(options, loop, vary, how)
    fold = find_fold(servo_of(options), model, options=how)
    slopes, stable = fold_sensitivities(fold), stability_of(fold, how)
    more: dict[str, Any] = {"elasticities": slopes.elasticities, "stable": stable, "solver": how.solver}
    say(progress(options.quiet), progress_line(fold.orbit, mu="+1 (fold)"))
    first = f"{model} servo: hunting is possible up to gain {to_error(fold.gain, fold.gain_error)} V/rad"
    below, built = seen_by_encoder(options, fold.orbit.amplitude)
    more = {**more, **built}
    lines = _lines(fold, slopes, [first, *below], stable["sentence"], how)
    give(
        options, fold.to_dict(table=False) | more, lines, table=tables_of([slopes]),
        picture=("fold.elasticities", [fold], [slopes]),
    )  # fmt: skip
    return 0


def _of_a_loop(options: argparse.Namespace, loop: Loop, vary: str, how: Options) -> int:
    """The fold of a loop in one of its parameters; returns the exit code."""
    fold, way = shared.border_of(loop, vary, how)
    slopes, orbit = fold_sensitivities(fold), fold.orbit
    more = {key: getattr(orbit, key) for key in ("amplitude", "amplitude_error", "period", "period_error")}
    more |= {"elasticities": slopes.elasticities, "way": way, "solver": how.solver}
    more |= shared.record_of(loop.replace(**{vary: fold.value}))
    say(progress(options.quiet), progress_line(orbit, mu="+1 (fold)", vary=vary))
    value = shared.with_unit(to_error(fold.value, fold.value_error), vary)
    first = f"loop: hunting is possible {way} to {vary} {value}", shared.parts_line(loop)
    give(
        options, fold.to_dict(table=False) | more, _lines(fold, slopes, first, "", how), table=tables_of([slopes]),
        picture=("fold.elasticities", [fold], [slopes]),
    )  # fmt: skip
    return 0


def _lines(
    fold: Fold[Any], slopes: Sensitivities, first: Sequence[str], stable: str, how: Options
) -> Iterator[str]:
    """The lines, the first ones given; stable: what is said of a stable cycle."""
    vary = fold.parameter
    yield from first
    yield f"  estimated error  {error_text(fold.value_error)} (relative, of the {vary})"
    yield f"  amplitude there  {to_error(fold.orbit.amplitude, fold.orbit.amplitude_error)} rad"
    yield f"  period there     {to_error(fold.orbit.period, fold.orbit.period_error)} s"
    if stable:
        yield f"  a stable cycle   {stable}"
    way = "turning point of the equations (Newton)" if how.solver == "newton" else "optimisation problem (IPOPT)"
    yield f"  computed twice   as {way}: {shared.with_unit(to_error(fold.optimised_value, fold.value_error), vary)}"
    yield f"  one per cent more of        changes that {vary} by"
    for name, value in sorted(slopes.elasticities.items(), key=lambda item: -abs(item[1])):
        yield f"    {name:26s} {sensitivity_text(value, how.tol):>9s} %"
    yield f"  {fold.wall_s:.2f} s"
