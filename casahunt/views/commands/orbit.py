"""casahunt orbit: the hunting cycle at one gain.

Key `as_built` of the JSON object, where the servo file has a table [drive]: what is to be said of the cycle in counts
of its encoder, or null.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

from ...axis_units import several
from ...checks import choice_of, error_text
from ...errors import HuntsIrregularly, NoOrbit
from ...export import Columns
from ...orbits import Multipliers, Orbit
from ...orbits.archive import save_orbit
from ...servo.find_orbit import BRANCHES, find_orbit
from ...servo.parts.ahead import LOPSIDED_BY
from ...servo.parts.exponent import told
from ...servo.parts.plain_loop import loop_asked
from ...servo.units import column
from ..answers.answer import (
    Answer,
    angle,
    called,
    complex_text,
    exactly,
    item,
    parts_of,
    record_of,
    rhythm,
    runs_away,
    short,
)
from .arguments import Asked, add_command, add_solver
from .console import orbit_line
from .output import give
from .progress import tell
from .sampled import hunts_on, seen_by_encoder


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


def run(options: Asked) -> int:
    """Compute and print; returns the exit code."""
    branch: Any = choice_of("branch", options.branch, BRANCHES)
    route = choice_of("multipliers", options.multipliers, ("collocation", "integrator"))
    asked, gain = options.subject(gain=True), options.at_gain()
    servo, model, how = asked[0], asked[1], replace(options.how(), half=not options.full)
    if model is None:
        options.leave_out("a loop's cycle is computed by its symmetry where it has one", "full")
    try:
        orbit = find_orbit(*asked, branch=branch, options=how)
    except HuntsIrregularly as irregular:
        raise hunts_on(options, NoOrbit(told(irregular), irregular.status), gain) from None
    except NoOrbit as refusal:
        raise hunts_on(options, refusal, gain) from None
    below = [*parts_of(servo), *runs_away(loop_asked(*asked))]
    if branch == "lopsided":
        below.append(item("", "one of a pair: the other one is its mirror image"))
    if bool(orbit.half and orbit.multipliers.leading.real < -1):
        how_to = "; --branch lopsided" if model else ""
        below.append(item("beside it", f"a cycle that reaches farther to one side may hunt in its place{how_to}"))
    record = {**orbit.to_dict(table=False), **record_of(servo), "branch": branch}
    if model:
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
    record["wall_s"] = options.outputs.seconds
    tell(orbit_line(orbit))
    if options.save:
        options.outputs.write(save_orbit, orbit, options.save)
    columns = {"model": model, column("gain"): gain} if model else record["parameters"]
    table, picture = _row(orbit, columns, branch), ("orbits.time_traces", [orbit])
    title = f"{called(servo, model)} at gain {gain:.10g} V/rad"
    stable = orbit.stable
    if branch == "unstable":
        head = f"{title}: the unstable hunting cycle"
        what = "motions near it leave it, so that no servo stays on it; as a rule it is the border of hunting:"
        bounds = "nearer to the set point it comes to rest, farther away it hunts; casahunt basin tries both"
        means = [item("what it is", what), item("", bounds)]
    else:
        said = MEANS.get((branch, stable), "") if stable is not None else ""
        head, means = f"{title}: {HEADS[branch, stable]}", [item("what it means", said)] if said else []
    plain = [
        head,
        item("amplitude", angle(orbit.amplitude, orbit.amplitude_error)),
        *_lopsided(orbit),
        item("period", rhythm(orbit.period, orbit.period_error)),
        *means,
        *below,
    ]
    answer = Answer(plain, _details(orbit, second, record["wall_s"]))
    give(options, record, answer, table=table, picture=picture)
    return 0


def _lopsided(orbit: Orbit) -> list[str]:
    """From where to where a cycle reaches that is not its own mirror image."""
    if orbit.half:
        return []
    ends = orbit.extrema("x1")
    low, high = ends.low.value, ends.high.value
    if abs(high + low) <= LOPSIDED_BY * (high - low):
        return []
    return [item("it reaches", f"from {several((low, high), 'rad', short, ' to ')} beside the set point")]


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


# What `casahunt orbit` says of a hunting cycle

HEADS = {
    ("stable", True): "hunts",
    ("stable", False): "has a hunting cycle that it leaves again",
    ("stable", None): "has a hunting cycle; whether the servo ends in it is not known",
    ("lopsided", True): "hunts, farther to one side than to the other",
    ("lopsided", False): "has a lopsided hunting cycle that it leaves again",
    ("lopsided", None): "has a lopsided hunting cycle; whether the servo ends in it is not known",
}
"""By branch, and by whether the cycle is stable: what is said first."""
MEANS = {
    ("stable", True): "the servo swings like this for ever; what ends it: casahunt fold (a higher gain), casahunt "
    "remedies",
    ("stable", False): "a motion near it swings farther from it each time",
    ("lopsided", True): "the servo swings like this for ever, or in its mirror image",
    ("lopsided", False): "a motion near it swings farther from it each time",
}
"""By the same: what it means, where that is known."""


def _details(orbit: Orbit, second: Multipliers | None, wall_s: float) -> Iterator[str]:
    yield from exactly(orbit)
    yield from _multipliers(orbit.multipliers, half=orbit.half)
    if second is not None:
        yield "  by integrators   (CasADi's forward sensitivities, from event to event)"
        yield from (f"  {line}" for line in _multipliers(second, half=orbit.half))
        if second.trusted and orbit.multipliers.trusted:
            off = f"{difference(orbit.multipliers, second):.1e}"
            yield f"    difference       {off} (of the largest one, relative where it is above 1)"
    yield item(
        "status",
        f"{orbit.status.name.lower()} by {orbit.solver}, {orbit.unknowns} unknowns, {orbit.iterations} iterations, "
        f"{wall_s:.2f} s",
    )  # fmt: skip


def _multipliers(m: Multipliers, *, half: bool) -> Iterator[str]:
    """Multipliers of the whole period, and of half of one where that is what was computed."""
    if not m.trusted:
        why = f"that of a shift in time, which is 1 exactly, was computed with an error of {m.trivial_error:.1e}"
        if m.trivial_trusted:
            why = f"the error of the largest one but the shift in time may be {error_text(m.error)}"
        yield item("multipliers", f"not to be trusted: {why}")
        return
    if half:
        yield item("half multiplier", complex_text(m.leading, m.error, m.leading_floor))
    each = (complex_text(value, m.error, floor) for value, floor in zip(m.full, m.full_floor, strict=True))
    yield item("multipliers", ", ".join(each))
    exact = "the multiplier of a shift in time is 1 exactly, and was computed with an error of"
    yield item("their accuracy", f"{exact} {m.trivial_error:.1e}")


def difference(one: Multipliers, other: Multipliers) -> float:
    """|mu_1 - mu_2| / max(1, |mu_1|) of the leading multipliers: next to a superstable cycle mu itself is 0."""
    return float(abs(one.leading - other.leading) / max(1.0, abs(one.leading)))
