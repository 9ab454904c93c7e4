"""casahunt fold: the largest gain at which the servo can hunt, and the largest one with a stable cycle.

Key `stable` of the JSON object: see views/stability.py; `as_built`: as of orbit; `beyond`: what the drive may do at
higher gains, or null.  Of a loop of parts: the border of hunting in any parameter; `parameters` are those at the fold,
`way` is "up" where the loop hunts below it.
"""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any

from ...checks import to_error
from ...design.sensitivity import fold_sensitivities
from ...orbits import Options
from ...results import tables_of
from ...servo.find_fold import find_fold
from ..answers.answer import short
from ..answers.fold import fold_answer
from ..stability import stability_of
from .arguments import add_command, add_solver, add_vary, how_of, loop_of, model_of, servo_of, vary_of
from .console import orbit_line
from .loops import shared
from .output import give
from .progress import progress, tell
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
    stream = progress(options)
    tell(stream, orbit_line(stream, fold.orbit, mu="+1 (fold)"))
    below, built = seen_by_encoder(options, fold.orbit.amplitude, beyond=True)
    more = {**more, **built}
    value, again = (f"{to_error(gain, fold.gain_error)} V/rad" for gain in (fold.gain, fold.optimised_value))
    answer = fold_answer(
        f"{model} servo: hunting is possible up to gain {short(fold.gain, fold.gain_error)} V/rad", fold, slopes,
        below=below, stable=stable, value=value, again=again, solver=how.solver, tol=how.tol,
    )  # fmt: skip
    give(
        options, fold.to_dict(table=False) | more, answer, table=tables_of([slopes]),
        picture=("fold.elasticities", [fold], [slopes]),
    )  # fmt: skip
    return 0


def _of_a_loop(options: argparse.Namespace, loop: Loop, vary: str, how: Options) -> int:
    """The fold of a loop in one of its parameters; returns the exit code."""
    fold = find_fold(loop, vary=vary, options=how)
    way = shared.way_to(fold, loop)
    slopes, orbit = fold_sensitivities(fold), fold.orbit
    more = {key: getattr(orbit, key) for key in ("amplitude", "amplitude_error", "period", "period_error")}
    more |= {"elasticities": slopes.elasticities, "way": way, "solver": how.solver}
    more |= shared.record_of(loop.replace(**{vary: fold.value}))
    stream = progress(options)
    tell(stream, orbit_line(stream, orbit, mu="+1 (fold)", vary=vary))
    value, again = (
        shared.with_unit(to_error(each, fold.value_error), vary) for each in (fold.value, fold.optimised_value)
    )
    answer = fold_answer(
        f"loop: hunting is possible {way} to {vary} {shared.with_unit(short(fold.value, fold.value_error), vary)}",
        fold, slopes, below=[shared.parts_line(loop)], stable=None, value=value, again=again, solver=how.solver,
        tol=how.tol,
    )  # fmt: skip
    give(
        options, fold.to_dict(table=False) | more, answer, table=tables_of([slopes]),
        picture=("fold.elasticities", [fold], [slopes]),
    )  # fmt: skip
    return 0
