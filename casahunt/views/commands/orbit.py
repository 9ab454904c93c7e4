"""casahunt orbit: the hunting cycle at one gain.

Key `as_built` of the JSON object, where the servo file has a table [drive]: what is to be said of the cycle in counts
of its encoder, or null.
"""

from __future__ import annotations

import argparse
import math
import time
from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any, NamedTuple

from ...checks import choice_of, error_text, to_error
from ...export import Columns
from ...orbits import Multipliers, Options, Orbit
from ...orbits.archive import save_orbit
from ...servo.find_orbit import BRANCHES, BranchName, find_orbit
from ...servo.hunting import Model
from ...servo.servo import Servo
from ...servo.units import column
from .arguments import add_command, add_solver, gain_of, how_of, left_out, loop_of, model_of, servo_of
from .console import complex_text, progress, progress_line, say
from .loops import shared
from .output import give
from .sampled import seen_by_encoder

if TYPE_CHECKING:
    from ...servo.parts import Loop

CHECK = "their accuracy   the one that must be 1 is off by"
"""Said of the multipliers by either way."""
SYMMETRY_BROKEN = "  past a symmetry breaking (mu < -1): lopsided cycles may hunt in its place"
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
    model, loop = model_of(options), loop_of(options)
    branch: Any = choice_of("branch", options.branch, BRANCHES)
    route = choice_of("multipliers", options.multipliers, ROUTES)
    gain = gain_of(options)
    how = replace(how_of(options), half=not options.full)
    if loop is not None:
        left_out(options, "a loop's cycle is computed by its symmetry where it has one", "full")
    servo = Servo() if loop is not None else servo_of(options)
    began = time.perf_counter()
    found = _of_a_servo(servo, model, gain, branch, how) if loop is None else _of_a_loop(loop, branch, how)
    if loop is None:
        below, built = seen_by_encoder(options, found.orbit.amplitude)
        found = found._replace(below=(*found.below, *below), record=found.record | built)
    orbit, record = found.orbit, {**found.orbit.to_dict(table=False), **found.record, "branch": branch}
    second = orbit.integrator_multipliers if route == "integrator" else None
    if second is not None:
        record["integrator"] = _second_route(orbit, second)
    record["wall_s"] = time.perf_counter() - began
    say(progress(options.quiet), progress_line(orbit))
    if options.save:
        options.outputs.write(save_orbit, orbit, options.save)
    table, picture = _row(found, branch), ("orbits.time_traces", [orbit])
    give(options, record, _lines(found, record, second), table=table, picture=picture)
    return 0


class _Found(NamedTuple):
    """An orbit, and what is said of whose it is: in the first line, below it, in JSON and in the table."""

    orbit: Orbit
    title: str
    below: tuple[str, ...]
    record: dict[str, Any]
    columns: dict[str, Any]


def _of_a_servo(servo: Servo, model: Model, gain: float, branch: BranchName, how: Options) -> _Found:
    orbit, below = find_orbit(servo, model, gain, branch=branch, options=how), []
    if branch == "lopsided":
        below.append("  one of a pair: the other one is its mirror image")
    if _past_a_symmetry_breaking(orbit):
        below.append(f"{SYMMETRY_BROKEN}; --branch lopsided")
    name = f"{model} servo at gain {gain:.10g} V/rad"
    return _Found(orbit, name, tuple(below), {}, {"model": model, column("gain"): gain})


def _of_a_loop(loop: Loop, branch: str, how: Options) -> _Found:
    orbit = shared.cycle_on(loop, branch, how)
    below = [SYMMETRY_BROKEN] if _past_a_symmetry_breaking(orbit) else []
    parts = shared.parts_line(loop)
    return _Found(orbit, shared.title(loop), (parts, *below), shared.record_of(loop), loop.parameters)


def _past_a_symmetry_breaking(orbit: Orbit) -> bool:
    return orbit.half and orbit.multipliers.leading.real < -1


def _lines(found: _Found, record: Mapping[str, Any], second: Multipliers | None) -> Iterator[str]:
    orbit, m = found.orbit, found.orbit.multipliers
    what = "lopsided hunting cycle" if record["branch"] == "lopsided" else "hunting cycle"
    kind = {True: f"stable {what}", False: f"unstable {what}", None: f"{what} of unknown stability"}
    yield f"{found.title}: {kind[record['stable']]}"
    yield from found.below
    yield f"  amplitude        {to_error(orbit.amplitude, orbit.amplitude_error)} rad"
    yield f"  period           {to_error(orbit.period, orbit.period_error)} s"
    if m.trusted:
        if orbit.half:
            yield f"  half multiplier  {complex_text(m.leading, m.error, m.leading_floor)}"
        yield f"  multipliers      {_full_text(m)}"
        yield f"  {CHECK} {m.trivial_error:.1e}"
    else:
        yield f"  multipliers      not to be trusted: {_doubt(m)}"
    if second is not None:
        yield from _second_lines(orbit, second)
    yield f"  error estimate   {error_text(orbit.error_estimate)} (relative, of period and amplitude)"
    yield (
        f"  status           {orbit.status.name.lower()} by {orbit.solver}, {orbit.unknowns} unknowns, "
        f"{orbit.iterations} iterations, {record['wall_s']:.2f} s"
    )


def _full_text(m: Multipliers) -> str:
    """The multipliers of the whole period in a row."""
    return ", ".join(complex_text(value, m.error, floor) for value, floor in zip(m.full, m.full_floor, strict=True))


def _doubt(m: Multipliers) -> str:
    """Why they are not trusted."""
    if m.trivial_trusted:
        return f"the error of the largest one but the shift in time may be {error_text(m.error)}"
    return f"the one that must be 1 is off by {m.trivial_error:.1e}"


def _difference(one: Multipliers, other: Multipliers) -> float:
    """|mu_1 - mu_2| / max(1, |mu_1|) of the leading multipliers: next to a superstable cycle mu itself is 0."""
    return float(abs(one.leading - other.leading) / max(1.0, abs(one.leading)))


def _second_route(orbit: Orbit, m: Multipliers) -> dict[str, Any]:
    """What the integrators say, for JSON; None where it is not to be trusted."""
    trusted = m.trusted and orbit.multipliers.trusted
    return {
        "half_multiplier": m.leading.real if m.trusted and orbit.half else None,
        "multipliers": [[value.real, value.imag] for value in m.full] if m.trusted else None,
        "trivial_multiplier_error": m.trivial_error,
        "difference": _difference(orbit.multipliers, m) if trusted else None,
    }


def _second_lines(orbit: Orbit, m: Multipliers) -> Iterator[str]:
    yield "  by integrators   (CasADi's forward sensitivities, from event to event)"
    if not m.trusted:
        yield f"    multipliers      not to be trusted: {_doubt(m)}"
        return
    if orbit.half:
        yield f"    half multiplier  {complex_text(m.leading, m.error, m.leading_floor)}"
    yield f"    multipliers      {_full_text(m)}"
    yield f"    {CHECK} {m.trivial_error:.1e}"
    if orbit.multipliers.trusted:
        off = _difference(orbit.multipliers, m)
        yield f"    difference       {off:.1e} (of the largest one, relative where it is above 1)"


def _row(found: _Found, branch: str) -> Columns:
    """The cycle as a row of a table, beside that of its motion (`to_csv`); errors in the unit of their number."""
    orbit, m = found.orbit, found.orbit.multipliers
    row = {
        **found.columns,
        "branch": branch,
        "amplitude_rad": orbit.amplitude,
        "amplitude_error_rad": orbit.amplitude * orbit.amplitude_error,
        "period_s": orbit.period,
        "period_error_s": orbit.period * orbit.period_error,
        "half_multiplier": orbit.half_multiplier if m.trusted and orbit.half else math.nan,
        "half_multiplier_error": m.error * max(1.0, abs(m.leading)) if m.trusted and orbit.half else math.nan,
        "trivial_multiplier_error": m.trivial_error,
        "stable": bool(orbit.stable) if m.trusted else None,
        "status": orbit.status.name.lower(),
    }
    for i, value in enumerate(m.full, 1):
        row[f"multiplier_{i}_re"] = value.real if m.trusted else math.nan
        row[f"multiplier_{i}_im"] = value.imag if m.trusted else math.nan
    return {name: [value] for name, value in row.items()}
