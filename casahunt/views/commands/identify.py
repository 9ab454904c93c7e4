"""casahunt identify: friction, or other parameters, from records of a hunting servo.

Keys of the JSON object, the `to_dict` of the identification: parameters {name: {value, low, high}}, 95 %, low 0 or high
null where the records do not bound it, both null where status is "fit_not_converged"; misfit, 1 where the model leaves
nothing but noise; explained; scatter, systematic and unsteady (judgement.py); untold, combinations that the records do
not tell, as powers of the parameters; further_gain, of the record that would tell most besides, or null; records;
servo; suspect, null or what to suspect where the first record hunts far from the frequency of the servo as given;
wall_s.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

import numpy as np

from ...axis_units import UNITS_TABLE, label, quantity, shown, word
from ...checks import to_absolute_error
from ...design.identify.axis import rigid, sought
from ...design.identify.identify import FREE, Identification, identify, maybe_cut_off
from ...design.identify.judgement import NEGLIGIBLE
from ...design.identify.suspect import suspicion
from ...design.identify.transient import MORE_AT_FIRST, more_at_first
from ...design.record.file import read_record
from ...errors import InputError, NoOrbit
from ...results import tables_of
from ...servo.drive import DRIVE_KEYS, DRIVE_TABLE, Drive
from ...servo.find_orbit import find_orbit
from ...servo.servo import LOOP_TABLE, flatten, toml_value
from ...servo.units import GAIN_UNIT, unit_of
from ..answers.answer import PLAIN_DIGITS, Answer
from .arguments import Asked, add_command, add_gain, add_out, positive
from .console import complain, folder
from .output import give
from .output_paths import keep_others, write_results
from .progress import tell
from .record_options import add_reading, add_torque, later_part, reading_of

SIGN = "# casahunt identify"
FILES = {"friction.toml": SIGN.encode(), "servo.toml": SIGN.encode()}
"""What --out writes, and what stands in each: the intervals, as `uncertainty`, `tune` and `remedies` take them, and the
servo with the values found."""
FITTED_DIGITS = 6
"""Of a value in the details."""
SHAKEN = 0.02
"""Torque that a count makes by the derivative, as a part of static friction, above which it is told."""
COUNTS_READ = 300.0
"""Of the amplitude, below which a controller that reads them hunts otherwise by more than intervals are wide."""
FILTERS_OF_RATE = ("derivative_filter", "velocity_filter")
"""Of parts, times."""
ROW = "  {:27s} {:>10s} {:>10s} {:>10s}  {}"


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = add_command(
        commands, "identify", "friction from records of a hunting servo",
        records="times and positions; one file for each record", model=", for the fit",
        csv="the parameters with their intervals", plot="the records laid over the fitted cycle, and what is left",
    )  # fmt: skip
    add_sought(command)
    add_out(command, lambda _: FILES, help="write friction.toml, the intervals for --uncertainty, and servo.toml")


def add_sought(command: Any) -> None:
    """The arguments of what is fitted to what."""
    add_gain(command, action="append", help="gain of the records in V/rad; repeat it, one for each, where they differ")
    add_reading(command)
    add_torque(command)
    free = f"parameters that are sought, with commas (default {', '.join(FREE)})"
    command.add_argument("--free", dest="sought", action="append", metavar="NAME", help=free)


def fit_of(options: Asked) -> tuple[Callable[[], Identification], list[str]]:
    """The fit that the command line asks for, to be called, and how its records were read.

    Raises InputError: the command line is wrong, or a record is.
    """
    for path in options.records:
        if path.endswith(".toml"):
            raise InputError(f"record {path!r}: is a servo file by its name; it is given as --servo {path}")
    (servo, model), how, reading = options.subject(), options.how(), reading_of(options)
    drive = options.drive()
    gains = [positive("gain", gain, GAIN_UNIT) for gain in options.gain or ()] or [options.stated_gain()]
    free = tuple(part.strip() for text in options.sought or [",".join(FREE)] for part in text.split(","))
    records = [later_part(read_record(path, **reading), options) for path in options.records]
    built = sought(servo, model, gains, free, drive, records)[2]

    def fit() -> Identification:
        many = f"{len(records)} record{'s' * (len(records) > 1)}"
        tell(f"fitting {len(free)} parameters to {many}")
        try:
            return identify(records, servo, gains, model, free=free, drive=drive, options=how)
        except InputError as refusal:
            if drive is None or built is not None:
                raise
            raise InputError(
                f"{refusal} Or it is what [drive] describes: its delay, filter and counts are not in the model that is "
                "fitted, which is a continuous loop"
            ) from None

    taken = []
    if options.servo_file is None:
        taken.append("without --servo inertia, motor and controller are those of Table 1 of the report; is that yours?")
    taken += [record.reading.sentence for record in records if record.reading is not None]
    if drive is not None:
        one = rigid(servo)
        where = "where friction alone is sought, from positions alone"
        where = where if one is servo else "whose friction is the same both ways"
        left = f"the loop is taken as a continuous one: of [drive] sampling and delay are taken into account {where}"
        taken.append(left if built is None else "sampling, delay and counts of [drive] are taken into account")
        time = drive.sample_time + drive.filter_of(one.controller)
        time += sum(servo.value(name) for name in FILTERS_OF_RATE if name in servo.names)
        shaken = one.torque_gains(max(gains))[1] * drive.count / time / one.friction.static
        if shaken > SHAKEN:
            taken.append(
                f"each count of the encoder makes the derivative's torque jump by {shaken:.2g} of static friction, as "
                "given: that shakes a servo loose, and what is found may be the friction of the shaken one"
            )
    return fit, [f"  {sentence}" for sentence in taken]


def run(options: Asked) -> int:
    """Read, fit and print; returns the exit code."""
    fit, read = fit_of(options)
    if options.out is not None:
        keep_others(options.out, FILES)
    found = fit()
    if options.out is not None and found.status.ok and found.judgement.explained:
        with folder(options.out, FILES) as out:
            options.outputs.write(write_results, out, FILES, texts_of(found, options))
    suspect = suspected(options, found)
    give(
        options,
        {**found.to_dict(table=False), "suspect": suspect or None, "wall_s": options.outputs.seconds},
        Answer(identified_lines(found, suspect, read), identified_details(found)),
        table=tables_of([found]), picture=("identify.fitted_records", found),
    )  # fmt: skip
    if found.status.ok and found.judgement.explained:
        return 0
    kept = "; --out is not written" if options.out is not None else ""
    complain("casahunt identify", f"{not_explained(found) if found.status.ok else found.status.advice}{kept}")
    return 1


def suspected(options: Asked, found: Identification) -> str:
    """What to suspect where the first record hunts at another frequency than the servo that the command line gives."""
    data = found.records[0]
    if found.model is None:
        return ""
    try:
        given = find_orbit(options.servo(), found.model, data.gain, options=options.how())
    except NoOrbit:
        return ""
    step = float(np.median(np.diff(data.times)))
    return suspicion(given, data.period, data.amplitude, data.quantum, step, data.swings, lambda: found)


def whose(found: Identification) -> str:
    """What was fitted."""
    return f"{found.model} model" if found.model else "loop of parts"


def texts_of(found: Identification, options: Asked) -> dict[str, str]:
    """The intervals as an uncertainty file, and the servo with the values found and the drive that it had, by the names
    of `FILES`."""
    uncertainty = found.uncertainty.intervals
    widened = "" if found.bounded else "\n# What the records do not bound ends at a tenth or at ten times its value."
    intervals = "\n".join(f'"{name}" = [{low!r}, {high!r}]' for name, (low, high) in uncertainty.items())
    sections: dict[str, list[str]] = {}
    units = found.servo.units
    if not units.plain:
        sections[UNITS_TABLE] = [f"{key} = {toml_value(unit)}" for key, unit in units.table().items()]
    if found.model is None:
        sections[LOOP_TABLE] = [f"parts = {toml_value(options.tables()[LOOP_TABLE]['parts'])}"]
    own = flatten(found.servo) if found.model else {f"values.{k}": v for k, v in found.servo.parameters.items()}
    for key, value in own.items():
        section, name = units.word(key).split(".") if found.model else key.split(".")
        sections.setdefault(section, []).append(f"{name} = {value!r}")
    if (drive := options.drive()) is not None:
        given = {key: value for key in DRIVE_KEYS if (value := getattr(drive, key)) != getattr(Drive, key, None)}
        if units.linear and drive.encoder:
            given["encoder"] = f"{drive.count!r} m"
        sections[DRIVE_TABLE] = [f"{key} = {toml_value(value)}" for key, value in given.items()]
    servo = "\n\n".join("\n".join([f"[{section}]", *lines]) for section, lines in sections.items())
    texts = (
        f"{SIGN}: 95 % intervals, {whose(found)}, for --uncertainty with the servo in servo.toml{widened}\n"
        f"\n[interval]\n{intervals}\n",
        f"{SIGN}: the servo with the values found, {whose(found)}\n\n{servo}\n",
    )
    return dict(zip(FILES, texts, strict=True))


def not_explained(found: Identification) -> str:
    """What is said of a model that leaves more than noise."""
    judgement = found.judgement
    many, first = "s" * (len(found.records) > 1), more_at_first(found.residuals)  # which may be a transient
    left, likely = (
        f"what is left is {judgement.systematic:.2g} of the amplitude and no noise",
        "try another --model, more --free parameters, or the filter and sampling of the record",
    )
    if not judgement.repeats:
        left = (
            f"its periods differ from one another by {judgement.unsteady:.2g} of the amplitude, which is no noise of "
            "the samples, and not in the model"
        )
        likely = (
            "suspect the encoder's counts in the loop (state sample time and encoder in [drive]: each swing is taken "
            "by itself then; or record more counts of amplitude, at a lower gain), a transient (--from), a disturbance"
        )
    return (
        f"the {whose(found)} does not explain the record{many}: {left}; the values are its nearest, and less "
        f"certain than they look; draw it with --plot, and {likely}"
        + f"; {first:.2g} times as much is left of its first half: leave more out by --from" * (first > MORE_AT_FIRST)
        + "".join(sorted({maybe_cut_off(data) for data in found.records}))
    )


def identified_lines(found: Identification, suspect: str, read: Sequence[str] = ()) -> Iterator[str]:
    """What was found, as text; what is to be suspected; and how the records were read."""
    data, judgement = found.records, found.judgement
    many = f"{len(data)} records" if len(data) > 1 else data[0].name
    does = "explains" if judgement.explained else "does NOT explain"
    said = f"the model {does} what was recorded"
    said = said if found.status.ok else "the search for its numbers stopped short"
    yield f"{f'{found.model} servo' if found.model else 'loop'} from {many}: {said}"
    yield from read
    if found.left_out:
        many = "each record" if len(data) > 1 else "the record"
        yield f"  left out: the first {found.left_out:.0%} of {many}, in which it was still on its way to its cycle"
    yield from _rows(found, PLAIN_DIGITS)
    if not found.status.ok:
        yield "  the values are NOT settled: they are those where the search stopped, and nobody knows how far off"
    elif judgement.explained:
        yield "  from, to: the true value lies there in 95 of 100 cases, if the servo is as the model has it"
    else:
        yield "  from, to: of the nearest servo that the model has; the true values may lie outside"
    yield f"  beside noise it leaves {judgement.systematic:.2g} of the amplitude; {NEGLIGIBLE:g} is next to nothing"
    counts = [each.amplitude / each.quantum for each in data if each.drive is None and each.quantum]
    if counts and min(counts) < COUNTS_READ:
        yield f"  its positions come in counts, {min(counts):.3g} of amplitude: if the controller reads them"
        stated = "state its sample time and encoder in [drive]; without them " if found.model else ""
        yield f"  too, {stated}friction may lie outside"
    for powers in found.untold if found.status.ok else ():
        yield f"  not told by the record: {_combination(powers)}"
    if found.further is not None:
        yield f"  to know more, record at gain {found.further[0]:.3g} V/rad too"
    transient = not judgement.explained and more_at_first(found.residuals) > MORE_AT_FIRST
    if suspect and not transient:  # what is left of it would be taken for a cause
        yield f"  {suspect}"


def _rows(found: Identification, most: int) -> Iterator[str]:
    """The table of the parameters, with so many digits."""
    yield ROW.format("", "value", "from", "to", "unit")
    for name, value in found.values.items():
        unit = unit_of(name)
        value, low, high = (shown().number(x, unit) for x in (value, *found.intervals[name]))
        width = (high - low if math.isfinite(high) else value) / 20
        numbers = (value, low, high)
        ends = {math.inf: "no end"}
        texts = [
            to_absolute_error(each, width, most=most) if math.isfinite(each) else ends.get(each, "") for each in numbers
        ]
        yield ROW.format(word(name), *texts, label(unit)).rstrip()


def identified_details(found: Identification) -> Iterator[str]:
    """What the fit has left, and what another record would tell."""
    judgement = found.judgement
    yield from _rows(found, FITTED_DIGITS)
    for d, noise, torque, orbit in zip(found.records, found.noises, found.torque_noises, found.orbits, strict=True):
        rounded = f", positions in steps of {quantity(noise.quantum, 'rad')}" if noise.quantum else ""
        rounded += "" if torque is None else f", torque with noise {quantity(torque, 'N m', '.2g')}"
        yield (
            f"  gain {d.gain:.6g} V/rad: {d.times.size} samples, noise {quantity(noise.sigma, 'rad', '.2g')}{rounded}; "
            f"fitted amplitude {quantity(orbit.amplitude, 'rad', '.6g')}, period {orbit.period:.6g} s"
        )
    yield f"  misfit {judgement.misfit:.3g} (1 of noise alone)"
    if judgement.factor > 1:
        yield f"  intervals widened by {math.sqrt(judgement.factor):.3g}: the residuals scatter more than noise does"
    if found.further is not None:
        gain, gained = found.further
        yield f"  a record at gain {gain:.3g} V/rad: {gained / math.log(2):.1f} bits"


def _combination(powers: Mapping[str, float]) -> str:
    """A direction in words: what can rise while the others make up for it."""
    names = list(powers)
    if len(names) == 1:
        return names[0]
    first = max(names, key=lambda name: abs(powers[name]))
    others = [
        f"{name} {'rises' if powers[name] * powers[first] > 0 else 'falls'} by {abs(10 * powers[name]):.2g} %"
        for name in names
        if name != first
    ]
    return f"{' and '.join(names)} one by one, only together: {first} may rise by 10 % where {' and '.join(others)}"
