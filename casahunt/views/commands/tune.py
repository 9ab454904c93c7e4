"""casahunt tune: gain and controller times of least cost that do not hunt, verified; with an evidence page.

Keys of the JSON object beside those of the tuning and of its verification as their classes have them (`Tuning.to_dict`;
rad, s, V, N m; null where there is no number): lead_time, integral_time (kp, ki, kd of a controller by gains);
cost_gain_only: with the times as given; worst {corner {parameter: value}, fold_gain, evaluations};
fold {nominal, error, amplitude, period, linear_low, linear_high}: of the nominal friction, with the linearised range
over the uncertainty set; of the verification stable (up to which gain a cycle is stable, views/answers/fold.py; null
without a fold), set {folds, largest_fold_gain}, loops by "nominal", "worst" (friction) and, of the servos of the set,
the least "phase margin", "gain margin (lowering)", "gain margin (raising)";
elasticities {parameter: per cent of the fold gain at the answer per per cent}; proves_not: what it does not prove;
servo {key: value}: as given; as_built, where the servo file has a table [drive]: what the tuned servo does in it (kind,
dead_band, sentence); tol; made {date, casahunt (version), servo_file (null: the servo built in), set (of --set)}.
"""

from __future__ import annotations

import dataclasses
import json
import math
from collections.abc import Iterator, Sequence
from typing import Any

from ...checks import choice_of
from ...design.tune.demands import COSTS, NUMBERS, Demands
from ...design.tune.tuning import tune
from ...errors import InputError
from ...export import columns_from
from ...servo.sampled.check import as_built
from ...servo.units import GAIN_UNIT, unit_of
from ..answers.tune import known_to, loop_name, numbers_in, tuning_answer
from ..evidence.page import TITLE, evidence_page
from ..evidence.record import evidence_record, made
from .arguments import Asked, add_command, add_out, finite, positive
from .console import complain, folder
from .output import give
from .output_paths import write_results
from .progress import tell, teller
from .sampled import checked_lines

FILES = {"tune.html": TITLE.encode(), "tune.json": b'"casahunt": "'}
"""What --out writes, and what stands in each."""
CSV_COLUMNS = ("quantity", "unit", "value", "error")


def add(commands: Any) -> None:
    """The arguments of the command."""
    about = "the gain of least cost that does not hunt"
    command = add_command(commands, "tune", about, model="", csv="the answer and what was checked")
    command.add_argument("--margin", default=0.1, help="gain above the fold gain, relative (default 0.1)")
    command.add_argument("--uncertainty", metavar="FILE.toml", help="servos that must not hunt either")
    free = f"{', '.join(NUMBERS)}; of a loop of parts a parameter of its controller or of a filter"
    command.add_argument("--free", action="append", default=[], metavar="NAME", help=free)
    command.add_argument(
        "--bounds", action="append", default=[], metavar="NAME=LOW,HIGH", help="of gain and what is free"
    )
    command.add_argument("--cost", default="gain", help=f"{', '.join(COSTS)} (default gain)")
    command.add_argument("--phase-margin", default=30.0, help="of the linear loop, degrees (default 30)")
    command.add_argument("--gain-margin", default=2.0, help="factor, up and down (default 2)")
    command.add_argument("--delay", help="of the loop, s (default that of [drive], or 0)")
    command.add_argument("--sample-time", help="of a zero-order hold, s (default that of [drive], or 0)")
    command.add_argument("--max-torque", metavar="NM", help="on the step, N m")
    command.add_argument("--step", metavar="RAD", help="of the set point (default 1 rad, or one unit of length)")
    add_out(command, lambda _: FILES, help="write the evidence: tune.html and tune.json")


def run(options: Asked) -> int:
    """Tune, verify and print; returns the exit code."""
    cost = choice_of("cost", options.cost, COSTS)
    how = options.how()
    demands = _demands(options)
    servo, model = options.subject()
    uncertainty = options.uncertainty_of(servo)
    bounds = bounds_of(options.bounds)
    with folder(options.out, FILES) as out:
        tuning = tune(
            servo, model, demands=demands, uncertainty=uncertainty, free=options.free, bounds=bounds, cost=cost,
            options=how, report=teller(),
        )  # fmt: skip
        drive = options.drive()
        built = None if drive is None else as_built(tuning.servo, tuning.gain, drive)
        record = evidence_record(tuning) | {"tol": how.tol, "made": made(options.servo_file, options.set)}
        record |= {} if built is None else {"as_built": built.to_dict()}
        if out is not None:
            tell("drawing")
            from ..pictures.tune import evidence_images

            texts = evidence_page(record, evidence_images(tuning)), json.dumps(record, indent=1) + "\n"
            options.outputs.write(write_results, out, FILES, dict(zip(FILES, texts, strict=True)))
    where = None if options.out is None or options.outputs.troubles else f"{options.out}/{', '.join(FILES)}"
    answer = tuning_answer(
        record, how.tol, where, checked_lines(built, "motions"), checked_lines(built, "motions", in_full=True)
    )
    table = columns_from(CSV_COLUMNS, list(_rows(record, how.tol))) if options.csv else None
    give(options, record, answer, table=table)
    for sentence in tuning.verification.unverified:
        complain("casahunt tune", f"not verified: {sentence}")
    if tuning.verification.against:
        reasons = "; ".join(tuning.verification.against)
        complain("casahunt tune", f"the verification speaks against this tuning; do not use it: {reasons}")
    hunts_as_built = built is not None and built.goes_on
    if hunts_as_built:
        complain("casahunt tune", "the gain does not do alone in the loop as built: see its lines above, and remedies")
    return 1 if tuning.verification.against or hunts_as_built else 0


def _demands(options: Asked) -> Demands:
    """What is asked for."""
    drive = options.drive()
    times: dict[str, Any] = {}
    for key in ("delay", "sample_time"):
        text = getattr(options, key)
        own = 0.0 if drive is None else getattr(drive, key)
        times[key] = own if text is None else finite(key.replace("_", "-"), text, "s")
    if drive is not None:
        drive = dataclasses.replace(drive, **times) if times["sample_time"] else None
    return Demands(
        margin=finite("margin", options.margin),
        phase_margin=finite("phase-margin", options.phase_margin),
        gain_margin=finite("gain-margin", options.gain_margin),
        drive=drive,
        **times,
        max_torque=math.inf if options.max_torque is None else positive("max-torque", options.max_torque, "N m"),
        step=None if options.step is None else positive("step", options.step, "rad"),
    )


def bounds_of(texts: Sequence[str]) -> dict[str, tuple[float, float]]:
    """`NAME=LOW,HIGH` as numbers; names and order are checked by `tune`.

    Raises InputError: not of this form, or no finite numbers.
    """
    found: dict[str, tuple[float, float]] = {}
    for text in texts:
        name, sign, pair = text.partition("=")
        parts = pair.split(",")
        if not sign or len(parts) != 2:
            raise InputError(f"--bounds {text!r}: must have the form NAME=LOW,HIGH, for example lead_time=0.05,1")
        found[name.strip()] = (finite(f"bounds {name}", parts[0]), finite(f"bounds {name}", parts[1]))
    return found


def _rows(record: dict[str, Any], tol: float) -> Iterator[list[Any]]:
    """The answer and what was checked, a quantity a row; errors in the unit of their number, NaN where unknown."""
    check, fold, error = record["verification"], record["fold"], known_to(record, tol)
    yield ["gain", GAIN_UNIT, record["gain"], tol * record["gain"]]
    for name in numbers_in(record):
        yield [name, unit_of(name), record[name], tol * record[name] if name in record["free"] else 0.0]
    yield [f"cost: {record['cost_meaning']}", record["cost_unit"], _number(record["cost_value"]), math.nan]
    yield ["fold_gain", GAIN_UNIT, record["fold_gain"], error * record["fold_gain"]]
    if fold["nominal"] is not None:
        yield ["nominal_fold_gain", GAIN_UNIT, fold["nominal"], fold["error"] * fold["nominal"]]
    for name, value in record["worst"]["corner"].items():
        yield [f"worst {name}", unit_of(name), value, 0.0]
    yield ["margin_above_fold", "", _number(check["margin"]), math.nan]
    for key, loop in check["loops"].items():
        name = loop_name(key, check["loop_corners"])
        yield [f"phase margin, {name}", "deg", loop["phase_margin"], math.nan]
        yield [f"gain may fall to, {name}", "", _number(loop["lowest_factor"]), math.nan]
        yield [f"gain may rise to, {name}", "", _number(loop["highest_factor"]), math.nan]


def _number(value: float | None) -> float:
    return math.nan if value is None else value
