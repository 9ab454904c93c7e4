"""casahunt fold: the largest gain at which the servo can hunt, and the largest one with a stable cycle.

Key `stable` of the JSON object: see views/stability.py.
"""

from __future__ import annotations

import argparse
import json
from collections.abc import Iterator
from typing import Any

from ...checks import error_text, known, known_decimals, to_error
from ...design.sensitivity import Sensitivities, fold_sensitivities
from ...orbits.adapt import Options
from ...servo.find_fold import find_fold
from ...servo.hunting import MODELS
from ...servo.problem import HuntingFold
from ...servo.servo import Servo, flatten
from ..stability import stability_of
from ..units import PARAMETER_UNITS, column
from .arguments import add_common, add_csv, add_solver, csv_of, finite, picture_of, servo_of, solver_of
from .console import progress, progress_line, say
from .printed import show, write_records

MOST_DECIMALS = 4
"""Of a sensitivity in per cent of the gain."""


def add(commands: Any) -> None:
    """The arguments of the command."""
    fold = commands.add_parser("fold", allow_abbrev=False, help="the largest gain at which the servo can hunt")
    add_common(fold)
    fold.add_argument("--model", default="switch", help="switch (default) or lugre")
    add_solver(fold)
    add_csv(fold, "the sensitivities")
    fold.add_argument("--plot", metavar="F.png", help="write a picture of the sensitivities")


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    model = known("model", options.model, MODELS)
    how = Options(tol=finite("tol", options.tol), solver=solver_of(options))
    servo = servo_of(options)
    plot, table = picture_of(options), csv_of(options)
    fold = find_fold(servo, model, options=how)  # type: ignore[arg-type]
    slopes, stable = fold_sensitivities(fold), stability_of(fold, how)
    if table:
        options.outputs.write(write_records, table, _rows(servo, fold, slopes))
    if plot:
        from ..pictures import fold as pictures_fold
        from ..pictures import plotting

        options.outputs.draw(lambda: plotting.save(pictures_fold.elasticities([fold], [slopes]), plot))
    record = {
        "model": model,
        "gain": fold.gain,
        "amplitude": fold.orbit.amplitude,
        "period": fold.orbit.period,
        "error_estimate": fold.error_estimate,
        "optimised_gain": fold.optimised_gain,
        "stable": stable,
        "sensitivities": slopes.derivatives,
        "elasticities": slopes.elasticities,
        "status": fold.status.name.lower(),
        "solver": how.solver,
        "wall_s": fold.wall_s,
    }
    say(progress(options.quiet), progress_line(fold.orbit, mu="+1 (fold)"))
    if options.json:
        print(json.dumps(record))
        return 0
    show(_lines(fold, slopes, stable, how))
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


def _rows(servo: Servo, fold: HuntingFold, slopes: Sensitivities) -> list[dict[str, Any]]:
    values = flatten(servo)
    return [
        {
            "model": fold.orbit.model,
            "parameter": name,
            "unit": PARAMETER_UNITS[name],
            "value": values[name],
            column("fold_gain", "V/rad"): fold.gain,
            column("fold_gain_error", "V/rad"): fold.gain * fold.gain_error,
            "slope_V_per_rad_per_unit": slopes.derivatives[name],
            "elasticity": slopes.elasticities[name],
        }
        for name in slopes.elasticities
    ]
