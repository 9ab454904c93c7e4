"""casahunt fold: the largest gain at which the servo can hunt."""

from __future__ import annotations

import argparse
import json
from typing import Any

from ...checks import error_text, known, to_error
from ...design.sensitivity import fold_sensitivities
from ...orbits.adapt import Options
from ...servo.find_fold import find_fold
from ...servo.hunting import MODELS
from .arguments import add_common, add_solver, finite, picture_of, servo_of, solver_of
from .console import progress, progress_line, say

MAXIMUM = "the maximum of an optimisation problem (IPOPT)"


def add(commands: Any) -> None:
    """The arguments of the command."""
    fold = commands.add_parser("fold", allow_abbrev=False, help="the largest gain at which the servo can hunt")
    add_common(fold)
    fold.add_argument("--model", default="switch", help="switch (default) or lugre")
    add_solver(fold)
    fold.add_argument("--plot", metavar="F.png", help="write a picture of the sensitivities")


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    model = known("model", options.model, MODELS)
    how = Options(tol=finite("tol", options.tol), solver=solver_of(options))
    servo = servo_of(options)
    plot = picture_of(options)
    fold = find_fold(servo, model, options=how)  # type: ignore[arg-type]
    slopes = fold_sensitivities(fold)
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
    print(f"{model} servo: hunting is possible up to gain {to_error(fold.gain, fold.gain_error)}")
    print(f"  estimated error  {error_text(fold.gain_error)} (relative, of the gain)")
    print(f"  amplitude there  {to_error(fold.orbit.amplitude, fold.orbit.amplitude_error)} rad")
    print(f"  period there     {to_error(fold.orbit.period, fold.orbit.period_error)} s")
    other = "the turning point of the equations (Newton)" if how.solver == "newton" else MAXIMUM
    print(f"  as {other}: {to_error(fold.optimised_gain, fold.gain_error)}")
    print("  one per cent more of      changes the fold gain by")
    for name, value in sorted(slopes.elasticities.items(), key=lambda item: -abs(item[1])):
        print(f"    {name:28s} {value:+9.4f} %")
    print(f"  {fold.wall_s:.2f} s")
    return 0
