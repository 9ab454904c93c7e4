"""casahunt remedies: the smallest size of each remedy that ends hunting, and its price; with a page.

Key `remedies` of the JSON object: the rows, as `Cure.to_dict` gives them; as_built, where the servo file has a table
[drive]: by remedy, what the size to choose does in it (kind, dead_band, sentence), or why it was not checked. The one
beside the page says besides of each row whether it ends hunting (ends_hunting, keeps_it_ended; said: why not), and has
advice (the sentence that names a remedy), limits, task (what the price is of, in words), uncertain, servo {key: value},
command, made {date, casahunt (version), servo_file, set}.
"""

from __future__ import annotations

import json
import math
import shlex
from collections.abc import Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass, field, replace
from typing import Any

from ...axis_units import label, quantity, shown, word
from ...checks import to_absolute_error
from ...design.remedies.cures import MARGIN_TO_CHOOSE, Cure, Cures
from ...design.remedies.price import SETTLED_WITHIN, settled_within
from ...design.remedies.remedies import LARGER_SIZES, cheapest, remedies
from ...errors import InputError, NoOrbit
from ...export import plain
from ...results import tables_of
from ...servo.drive import with_remedy
from ...servo.outcome import SETTLES
from ...servo.parts.loop import Loop
from ...servo.parts.plain_loop import loop_asked
from ...servo.parts.table import remedy_of
from ...servo.sampled.check import AsBuilt, as_built
from ...servo.sampled.plant import DRIVE_PARTS
from ...servo.servo import flatten
from ...servo.simulate import simulate
from ..answers.answer import PLAIN_DIGITS, Answer, at_gain, short
from ..evidence.record import made
from ..evidence.remedies_page import TITLE, remedies_page
from .arguments import Asked, add_command, add_out, positive
from .console import complain, folder
from .output import give
from .output_paths import write_results
from .pool import processes
from .price_options import DEMANDS, add_demands, demands_of
from .progress import tell
from .sampled import checked_lines

FILES = {"remedies.html": TITLE.encode(), "remedies.json": b'"casahunt": "'}
"""What --out writes, and what stands in each."""

PRICE_DIGITS = 4
"""Digits of a price."""
SETTLING_DIGITS = 2
"""Digits of a settling time: it depends on where between two points of the motion the band is left last."""
SURELY_KNOWN = 1e-9
"""Relative error of a size below which no digits are shown."""

OWN = {"gain": "K", "derivative": "kd", "integral": "ki"}
"""Remedies that are numbers of the controller, and which."""
ROW = "  {:17s} {:>5s} {:>8s} {:5s} {:>8s} {:>9s} {:>9s} {:>8s}"
"""A row: remedy, "from" or "up to", size, unit, recommended size, error at rest, torque, settling time."""
DITHER_SIZE = (
    "its size is the root mean square of the velocity that the vibration has at the shaft; the torque for it, root "
    "mean square too, is the inertia times that times 2 pi times its frequency"
)
"""What to set."""
NOT_FOR_THE_WORST = "not found; the size to choose is for the values as given"
"""What is said of the worst servo of a set where no size was found for it."""


def add(commands: Any) -> None:
    """The arguments of the command."""
    about, plot = "what stops the hunting, how large, at what price", "amplitudes against sizes"
    command = add_command(commands, "remedies", about, gain=True, model="", csv="the rows", plot=plot)
    add_demands(command)
    more = f"of what to choose, relative (default {MARGIN_TO_CHOOSE:g})"
    command.add_argument("--margin", default=MARGIN_TO_CHOOSE, help=more)
    command.add_argument("--uncertainty", metavar="U.toml", help="what is uncertain: sizes for the worst servo too")
    add_out(command, lambda _: FILES, help="write the page: remedies.html and remedies.json")


def run(options: Asked) -> int:
    """Compute and print; the exit code: 1 where no remedy is within the limits, or does in the loop as built."""
    asked = (servo, model, _) = options.subject(gain=True)
    if model is None:
        options.leave_out("of a loop of parts it is not known", "uncertainty")
    demands, how = demands_of(options), options.how()
    margin, uncertainty = positive("margin", options.margin), options.uncertainty_of(servo)
    with folder(options.out, FILES) as out:
        table = table_of(options, demands, asked, options=how, uncertainty=uncertainty, margin=margin)
        found = table.found
        if out is not None:
            tell("drawing")
            record = _record(table, options, servo.parameters if model is None else flatten(servo))
            from ..pictures import remedies as pictures_remedies

            page = remedies_page(record, pictures_remedies.page_images(found))
            texts = dict(zip(FILES, (page, json.dumps(record, indent=1) + "\n"), strict=True))
            options.outputs.write(write_results, out, FILES, texts)
    result = found.to_dict() | {"as_built": table.built} if table.built else found
    answer = Answer(table_lines(table), table_details(table))
    give(options, result, answer, table=tables_of([found]), picture=("remedies.remedy_sizes", found))
    return judged("casahunt remedies", table) if found.best or table.limits else 0


@dataclass(frozen=True)
class Table:
    """Remedies that were found, and what they are held against.

    limits: of what one may cost; of_a_set: sizes are for the worst servo of a set too; built: what those that end
    hunting do in the loop as built with the size to choose, or why that was not checked, {} where there is none.
    """

    found: Cures
    limits: Mapping[str, float] = field(default_factory=dict)
    of_a_set: bool = False
    built: Mapping[str, AsBuilt | str] = field(default_factory=dict)

    @property
    def resting(self) -> list[str]:
        """Names of the remedies with which every motion of the loop as built comes to rest, or dies out."""
        return [name for name, seen in self.built.items() if not isinstance(seen, str) and seen.ends]


def table_of(
    command: Asked, demands: tuple[dict[str, Any], dict[str, Any], int], asked: Any, **more: Any
) -> Table:
    """The table of what is asked about, its best the cheapest that comes to rest in the loop as built, where one does.

    demands: as of `demands_of`; asked: servo, model and gain; more: arguments of `remedies`.
    """
    (what, limits, jobs), (servo, model, gain) = demands, asked
    with processes(jobs) as pool:
        found = remedies(
            servo, model, gain, executor=pool, **what, **limits, **more,
            progress=lambda row: tell(f"{row.name}: {_exact(row, PLAIN_DIGITS) if row.size < math.inf else row.why}"),
        )  # fmt: skip
    run_by_drive = loop_asked(servo, model and "switch", gain)
    table = Table(found, limits, more["uncertainty"] is not None, remedies_as_built(command, found, run_by_drive))
    does = [row for row in found.remedies if row.name in table.resting]
    best = cheapest(does, limits.get("max_error"), limits.get("max_torque", math.inf), of_a_set=table.of_a_set)
    return replace(table, found=replace(found, best=best or found.best))


def remedies_as_built(options: Asked, found: Cures, loop: Loop) -> dict[str, AsBuilt | str]:
    """Remedies that end hunting, with the size to choose, in the loop as built; {} where the servo file has none.

    loop: which the drive runs. Of those that a drive's controller does not have, or not of this size, a sentence.
    """
    drive = options.drive()
    if drive is None:
        return {}
    checked: dict[str, AsBuilt | str] = {}
    for row in (row for row in found.remedies if row.ends_hunting):
        remedy, size = remedy_of(row.name, "switch"), row.recommended
        try:
            if row.name in DRIVE_PARTS:
                checked[row.name] = as_built(loop, None, with_remedy(drive, DRIVE_PARTS[row.name], size))
            elif remedy.part is None:
                checked[row.name] = as_built(loop.replace(**{remedy.size: size}), None, drive)
            else:  # dither
                fast = "its size is that of a vibration much faster than the samples, which the drive cannot make"
                checked[row.name] = f"not checked: {fast}"
        except InputError as error:
            checked[row.name] = f"not checked: {error}"
    return checked


def _built_lines(table: Table, *, in_full: bool = False) -> Iterator[str]:
    """What the checks in the loop as built have found; in_full: with what supports it."""
    if table.built:
        whose = ", of the servo as given" if table.of_a_set and not in_full else ""
        yield f"in the loop as built, with Switch friction and the size to choose{whose}"
    for name, seen in table.built.items():
        yield from checked_lines(seen, name, "", in_full=in_full)


def _record(table: Table, options: Asked, own: dict[str, float]) -> dict[str, Any]:
    """The object beside the page; own: values of the servo or the loop."""
    found, built = table.found, table.built
    record: dict[str, Any] = plain(found)
    for row, cure in zip(record["remedies"], found.remedies, strict=True):
        said = _why_not(cure) if not cure.ends_hunting else "" if cure.keeps_it_ended else _not_kept(cure)
        row |= {"ends_hunting": cure.ends_hunting, "keeps_it_ended": cure.keeps_it_ended, "said": said}
    words = [options.servo_file] if options.servo_file else []
    for name in ("gain", "model", "max_error", "max_torque", "margin", "uncertainty", "only", "set"):
        given = getattr(options, name, None)
        for value in given if isinstance(given, list) else [given]:
            words += [] if value is None else [f"--{name.replace('_', '-')}", str(value)]
    return record | {
        "advice": advice_of(table), "limits": table.limits, "task": found.task,
        "uncertain": table.of_a_set, "parts": [part.name for part in found.loop.present], "servo": own,
        "command": shlex.join(["casahunt", "remedies", *words]), "made": made(options.servo_file, options.set),
        **({"as_built": plain(built)} if built else {}), **({} if shown().plain else {"units": shown().record()}),
    }  # fmt: skip


def judged(program: str, table: Table) -> int:
    """1, with what is said of it, where no remedy is named or the loop as built hunts on with that one; else 0."""
    seen = table.built.get(table.found.best, "")
    if not table.found.best:
        complain(program, none_within(table))
    elif isinstance(seen, str) or not seen.goes_on:
        return 0
    else:
        complain(program, f"{table.found.best} does not do in the loop as built: {seen.plain}")
    return 1


def _exact(row: Cure, most: int = 12) -> str:
    """The size to the digits that its error vouches for, `most` at most."""
    error = max(row.size_error, SURELY_KNOWN * abs(row.size))
    return quantity(row.size, row.unit, lambda x, e: to_absolute_error(x, e, most), error).rstrip()


def _with(number: float, unit: str) -> str:
    """A number and its unit, if it has one."""
    return quantity(number, unit, f".{PRICE_DIGITS}g").rstrip()


def _not_known(found: Cures) -> str:
    """Names of the remedies of which nobody knows whether they end hunting; "" for none."""
    return ", ".join(row.name for row in found.remedies if row.kind == "not found")


def _unpriced(found: Cures) -> str:
    """What is said of remedies that end hunting at a price that nobody knows; "" without them."""
    names = ", ".join(row.name for row in found.remedies if row.ends_hunting and math.isnan(row.peak_torque))
    return f"of {names} the size is known, not what a {'move' if found.move else 'step'} then needs" if names else ""


def none_within(table: Table) -> str:
    """What is said where no remedy is within the limits."""
    found, limits = table.found, table.limits
    now = today(found, limits.get("max_torque"))
    if unknown := _not_known(found):
        return f"no remedy that ends hunting{_within(limits)} was found; of {unknown} the table says why{now}"
    if unpriced := _unpriced(found):
        return f"no remedy is recommended{_within(limits)}: {unpriced}{now}"
    return f"no remedy ends hunting{_within(limits)}; allow more, or look at the table{now}"


def _within(limits: Mapping[str, float]) -> str:
    """The demands, as a part of a sentence."""
    asked = [(what, quantity(limits[key], unit, "g")) for key, (what, unit) in DEMANDS.items() if key in limits]
    said = [f"{word(what)} up to {limit}" for what, limit in asked]
    return f" with {' and '.join(said)}" if said else ""


def table_lines(table: Table) -> Iterator[str]:
    """The table as text."""
    found, built = table.found, table.built
    hunts = "hunts with" if found.stable else "has a hunting cycle, which motions leave again, of"
    hunts = "hunts irregularly, with up to" if found.irregular else hunts
    yield (
        f"{found.name} {at_gain(found.gain)} {hunts} {_with(found.amplitude, 'rad')} and "
        f"{found.period:.{PRICE_DIGITS}g} s"
    )
    yield f"  {advice_of(table)}"
    if built:
        # Of those that hold in the loop as built, and of cheaper ones: the sentence below the one that names the best
        does = table.resting
        names = [row.name for row in found.remedies if row.name in built]
        before = names[: names.index(found.best) + 1] if found.best in names else []
        none = "none of those that were checked brings every motion to rest"
        rests = f"every motion comes to rest with {', '.join(does)}" if does else none
        said = f"in the loop as built: {rests} (see below)"
        for name in (name for name in before if name not in does):
            said += f"; {name} {'was not checked' if isinstance(built[name], str) else 'does not do'}"
        yield f"  {said}"
    ending = [row for row in found.remedies if row.ends_hunting]
    if ending:
        yield ""
        task = f"{'move' if found.move else 'step'}, {label('N m')}"
        yield ROW.format("remedy", "", "ends it", "", "choose", "error at", word("torque on"), "settles").rstrip()
        yield ROW.format("", "", "", "", "", f"rest, {label('rad')}", task, "in, s").rstrip()
        for row in ending:
            yield from _row(row, table.of_a_set)
    others = [row for row in found.remedies if not row.ends_hunting]
    if ending and others:
        yield ""
    for row in others:
        yield f"  {row.name:17s}  {_why_not(row)}"
    if ending:
        yield ""
        yield "  what the columns mean, and every digit: --details"
    yield from _built_lines(table)


def table_details(table: Table) -> Iterator[str]:
    """What the columns mean, and the sizes in all digits that are known."""
    yield from columns_meant(table)
    for row in table.found.remedies:
        if math.isfinite(row.size):
            yield f"  {row.name:17s}  {_exact(row)}"
        elif row.why:
            yield f"  {row.name:17s}  {row.why}" + (f" ({row.evidence})" if row.evidence else "")
    yield from _built_lines(table, in_full=True)


def _row(row: Cure, of_a_set: bool) -> Iterator[str]:
    units, named = shown(), shown().near(row.size, row.unit)

    def price(x: float, unit: str, label: str = "") -> str:
        if math.isfinite(x):
            return f"{units.number(x, unit, label):.{PRICE_DIGITS}g}"
        return "unknown" if math.isnan(x) else "any"

    yield ROW.format(
        row.name, "from" if row.recommended > row.size else "up to", price(row.size, row.unit, named), named,
        price(row.recommended, row.unit, named), price(row.recommended_rest_error, "rad"),
        price(row.peak_torque, "N m"), _settles(row.settling),
    ).rstrip()  # fmt: skip
    if not row.keeps_it_ended:
        yield f"    {_not_kept(row)}"
    if row.kind == "motions":
        known = f"to about {100 * row.size_error / abs(row.size):.0f} %"
        yield f"    as simulated motions show it, seen and not proved, {known}; its cycles could not be followed so far"
    if of_a_set:
        worst = _with(row.worst_size, row.unit) if math.isfinite(row.worst_size) else NOT_FOR_THE_WORST
        yield f"    the worst servo of the set: {worst}"


def _settles(time: float) -> str:
    """A settling time, to the digits that it is good for."""
    if not math.isfinite(time):
        return "longer"
    return f"{time:.{SETTLING_DIGITS}g}" if time < 10**SETTLING_DIGITS else f"{time:.0f}"


def _why_not(row: Cure) -> str:
    """Why a remedy is none."""
    if not math.isfinite(row.size):
        return ("not found: " if row.kind == "not found" else "") + row.why
    return f"no remedy: its cycle ends at {_with(row.size, row.unit)}, but the motion beyond {_after(row)}"


def _not_kept(row: Cure) -> str:
    """At which larger sizes hunting has not ended."""
    times = [f"{factor:g}" for factor, seen in zip(LARGER_SIZES, row.stays[1:], strict=True) if seen not in SETTLES]
    return f"with {' or '.join(times)} times as much that is not sure: a motion {_after(row)}"


def _after(row: Cure) -> str:
    """What motions do beyond the border that have not ended."""
    does = {"hunting": "hunts on", "growing": "grows without bound", "undecided": "could not be followed to its end"}
    return " or ".join(does[verdict] for verdict in dict.fromkeys(row.stays) if verdict not in SETTLES)


def advice_of(table: Table) -> str:
    """The sentence that names one."""
    found, limits, within = table.found, table.limits, _within(table.limits)
    best = next((row for row in found.remedies if row.name == found.best), None)
    if best is None:
        unknown, unpriced = _not_known(found), _unpriced(found)
        if unpriced:
            return f"none is recommended{within}: {unpriced}{today(found, limits.get('max_torque'))}"
        none = f"no remedy that ends it{within} was found" if unknown else f"none of these remedies ends it{within}"
        return none + today(found, limits.get("max_torque"))
    on = f"on a {'move' if found.move else 'step'}"
    prices = (best.recommended_rest_error, "rad", "at rest"), (best.peak_torque, "N m", on)
    costs = [f"{_with(price, unit)} {what}" for price, unit, what in prices if not math.isnan(price)]
    if math.isfinite(best.settling):
        costs.append(f"settles in {_settles(best.settling)} s")
    alone = table.of_a_set and math.isnan(best.worst_size)
    named = f"{best.name}, {_with(best.recommended, best.unit)} ({', '.join(costs)})" + (
        "; what the worst servo of the set needs was not found" if alone else ""
    )
    if best.name in table.resting:
        return f"cheapest remedy that holds in the loop as built{within}: {named}"
    if isinstance(table.built.get(best.name), AsBuilt):
        return f"no remedy{within} that holds in the loop as built was found; of the continuous loop: {named}"
    return f"cheapest remedy{within}: {named}"


def columns_meant(table: Table) -> Iterator[str]:
    """What the columns of the table mean."""
    found, of_a_set = table.found, table.of_a_set
    names = [row.name for row in found.remedies if row.ends_hunting]
    if not names:
        return
    set_too, as_given = (", the worst servo of the set too", ", of the servo as given") if of_a_set else ("", "")
    more = ", or than the worst servo of the set needs" if of_a_set else ""
    yield "  ends it        the smallest size that does, or where less is more the largest"
    yield f"  choose         {100 * found.margin:g} % more of the remedy than that{more}"
    yield f"  error at rest  the largest at which the servo may stand still, with the size to choose{set_too}"
    yield f"  {word('torque'):13s}  the largest on a {found.task}, with that size{as_given}"
    small = settled_within(found.amplitude, found.step) < SETTLED_WITHIN * found.step
    within = "half of the amplitude of the hunting" if small else f"{100 * SETTLED_WITHIN:g} % of the way"
    since = "" if found.move is None else ", since its start,"
    yield f"  settles in     from then on{since} the error stays within {within}, or the error at rest"
    yield f"                 and {100 * SETTLED_WITHIN:g} % of that, along which it may creep"
    yield "  order          the cheapest first: error at rest, torque and settling time together"
    if numbers := [f"{name}: {OWN[name]}" for name in names if name in OWN]:
        yield f"  sizes          of the controller's own numbers, in place of the present ones: {', '.join(numbers)}"
    if "dither" in names:
        yield f"  dither         {DITHER_SIZE}"


def today(found: Cures, most: float | None) -> str:
    """What the present controller asks for on the step, where a torque is the limit; "" where that is not known."""
    if most is None:
        return ""
    loop = found.loop
    with suppress(NoOrbit):
        time = found.period + (0.0 if found.move is None else found.move.time(found.step))
        peak = max(
            simulate(loop, set_point=way * found.step, time=time, start=loop.carrying, move=found.move).peak_torque
            for way in loop.ways
        )
        already = ", which is above that limit already" if peak > most else ""
        return f"; the present controller asks for {quantity(peak, 'N m', short)} on a {found.task}{already}"
    return ""
