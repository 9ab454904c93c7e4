"""casahunt fold: the largest gain at which the servo can hunt."""

from __future__ import annotations

import argparse
import json
from typing import Any

from .adapt import Options
from .checks import known
from .console import add_common, finite, progress, progress_line, say, servo_of
from .fold import find_fold
from .hunting import MODELS


def add(commands: Any) -> None:
    """The arguments of the command."""
    fold = commands.add_parser("fold", allow_abbrev=False, help="the largest gain at which the servo can hunt")
    add_common(fold)
    fold.add_argument("--model", default="switch", help="switch (default) or lugre")


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    model = known("model", options.model, MODELS)
    how = Options(tol=finite("tol", options.tol))
    servo = servo_of(options)
    fold = find_fold(servo, model, options=how)  # type: ignore[arg-type]
    record = {
        "model": model,
        "gain": fold.gain,
        "amplitude": fold.orbit.amplitude,
        "period": fold.orbit.period,
        "error_estimate": fold.error_estimate,
        "optimised_gain": fold.optimised_gain,
        "status": fold.status.name.lower(),
        "wall_s": fold.wall_s,
    }
    say(progress(options.quiet), progress_line(fold.orbit, mu="+1 (fold)"))
    if options.json:
        print(json.dumps(record))
        return 0
    print(f"{model} servo: hunting is possible up to gain {fold.gain:.10g}")
    print(f"  estimated error  {fold.gain_error:.1e} (relative, of the gain)")
    print(f"  amplitude there  {fold.orbit.amplitude:.10g} rad")
    print(f"  period there     {fold.orbit.period:.10g} s")
    print(f"  as the maximum of an optimisation problem (IPOPT): {fold.optimised_gain:.10g}")
    print(f"  {fold.wall_s:.2f} s")
    return 0
