"""casahunt orbit: the hunting cycle at one gain.

Key `as_built` of the JSON object, where the servo file has a table [drive]: what is to be said of the cycle in counts
of its encoder, or null.
"""

from __future__ import annotations

import argparse
import math
import time
from dataclasses import replace
from typing import Any

from ...checks import choice_of
from ...errors import NoOrbit
from ...export import Columns
from ...orbits import Orbit
from ...orbits.archive import save_orbit
from ...servo.find_orbit import BRANCHES, find_orbit
from ...servo.linear.open_loop import open_loop
from ...servo.servo import Servo
from ...servo.units import column
from ..answers.answer import called, item, parts_of, record_of
from ..answers.orbit import RUNS_AWAY, SYMMETRY_BROKEN, difference, orbit_answer, past_a_symmetry_breaking
from .arguments import add_command, add_solver, asked_of, gain_of, how_of, left_out
from .console import orbit_line
from .output import give
from .progress import progress, tell
from .sampled import hunts_on, seen_by_encoder

ROUTES = ("collocation", "integrator")
"""Ways to the multipliers; the second comes on top of the first."""


def add(commands: Any) -> None:
    """The arguments of the command."""
    orbit = add_command(
        commands, "orbit", "the hunting cycle at one gain", gain=True, model="", csv="the numbers of the cycle",
        plot="one period",
    )  # fmt: skip
    orbit.add_argument("--branch", default="stable", help="stable (default), unstable or lopsided")
    orbit.add_argument("--full", action="store_true", help="solve the full cycle, without using its symmetry")
    add_solver(orbit)
    orbit.add_argument(
        "--multipliers", default="collocation", metavar="WAY",
        help="collocation (default), or integrator: by CasADi's integrators too, with the difference",
    )  # fmt: skip
    orbit.add_argument("--save", metavar="F.npz", help="write the orbit")


def run(options: argparse.Namespace) -> int:
    """Compute and print; returns the exit code."""
    branch: Any = choice_of("branch", options.branch, BRANCHES)
    route = choice_of("multipliers", options.multipliers, ROUTES)
    asked, gain = asked_of(options, gain=True), gain_of(options)
    servo, model, how = asked[0], asked[1], replace(how_of(options), half=not options.full)
    if model is None:
        left_out(options, "a loop's cycle is computed by its symmetry where it has one", "full")
    began = time.perf_counter()
    try:
        orbit = find_orbit(*asked, branch=branch, options=how)
    except NoOrbit as refusal:
        raise hunts_on(options, refusal, gain) from None
    below = parts_of(servo)
    if branch == "lopsided":
        below.append(item("", "one of a pair: the other one is its mirror image"))
    if past_a_symmetry_breaking(orbit):
        below.append(item("beside it", SYMMETRY_BROKEN + ("; --branch lopsided" if model else "")))
    record = {**orbit.to_dict(table=False), **record_of(servo), "branch": branch}
    if isinstance(servo, Servo):
        below += [] if open_loop(servo, gain).stable else [item("farther away", RUNS_AWAY)]
        seen, built = seen_by_encoder(options, orbit.amplitude)
        below, record = below + seen, record | built
    second = orbit.integrator_multipliers if route == "integrator" else None
    if second is not None:
        # What the integrators say, for JSON; None where it is not to be trusted
        trusted = second.trusted and orbit.multipliers.trusted
        record["integrator"] = {
            "half_multiplier": second.leading.real if second.trusted and orbit.half else None,
            "multipliers": [[value.real, value.imag] for value in second.full] if second.trusted else None,
            "trivial_multiplier_error": second.trivial_error,
            "difference": difference(orbit.multipliers, second) if trusted else None,
        }
    record["wall_s"] = time.perf_counter() - began
    stream = progress(options)
    tell(stream, orbit_line(stream, orbit))
    if options.save:
        options.outputs.write(save_orbit, orbit, options.save)
    columns = {"model": model, column("gain"): gain} if model else record["parameters"]
    table, picture = _row(orbit, columns, branch), ("orbits.time_traces", [orbit])
    title = f"{called(servo, model)} at gain {gain:.10g} V/rad"
    answer = orbit_answer(title, orbit, branch, below, second, record["wall_s"])
    give(options, record, answer, table=table, picture=picture)
    return 0


def _row(orbit: Orbit, columns: dict[str, Any], branch: str) -> Columns:
    """The cycle as a row of a table, beside that of its motion (`to_csv`); errors in the unit of their number."""
    m = orbit.multipliers
    row = {
        **columns,
        "branch": branch,
        "amplitude_rad": orbit.amplitude,
        "amplitude_error_rad": orbit.amplitude * orbit.amplitude_error,
        "period_s": orbit.period,
        "period_error_s": orbit.period * orbit.period_error,
        "half_multiplier": orbit.half_multiplier if m.trusted and orbit.half else math.nan,
        "half_multiplier_error": m.error * max(1.0, abs(m.leading)) if m.trusted and orbit.half else math.nan,
        "trivial_multiplier_error": m.trivial_error,
        "stable": orbit.stable,
        "status": orbit.status.name.lower(),
    }
    for i, value in enumerate(m.full, 1):
        row[f"multiplier_{i}_re"] = value.real if m.trusted else math.nan
        row[f"multiplier_{i}_im"] = value.imag if m.trusted else math.nan
    return {name: [value] for name, value in row.items()}
