"""casahunt cure: from records of a hunting servo to what stops it.

    records -> identify -> fold gain, and that of the worst servo -> remedies for the worst servo -> the loop as built

Each step is a command of its own.  Keys of the JSON object: advice (the sentence that names a remedy); doubt, null or a
sentence, where the model does not explain all; suspect, as `identify` gives it; identified, remedies, as_built, as
`identify` and `remedies` give them; fold {gain, worst, refused}: up to which gain the servo as found can hunt, and the
worst one that the records allow, null where it was not computed, and why not; bounded, whether the records bound every
parameter; gain, of the first record, at which remedies are looked for; limits; wall_s.
"""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping
from typing import Any

from ... import effort
from ...checks import to_error
from ...design.identify.identify import BOUND_FACTOR, Identification
from ...design.nearby import upper
from ...design.uncertainty.set import part_without_servos
from ...design.uncertainty.worst_corner import worst_corner
from ...errors import NoOrbit
from ...export import plain
from ...orbits import Options
from ...results import tables_of
from ...servo.find_fold import find_fold
from ..answers.answer import Answer
from ..evidence.cure_page import TITLE, cure_page
from ..evidence.record import made
from . import identify as identification
from .arguments import Asked, add_command, add_out
from .console import complain, folder
from .output import give
from .output_paths import keep_others, write_results
from .price_options import add_demands, demands_of
from .progress import say, tell
from .remedies import Table, advice_of, judged, table_details, table_lines, table_of

FILES = {**identification.FILES, "cure.html": TITLE.encode(), "cure.json": b'"casahunt": "'}
"""What --out writes, and what stands in each."""
MOST_WORK_BESIDE = 2e5
"""Work (effort.py) after which it is left to the commands made for it: it is not what is asked for here, and takes a
quarter of that, or less, where it is found soon."""
FOLD_SHOWN = 1e-4
"""Relative error to which fold gains are shown: friction from a record is known far less."""


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = add_command(
        commands, "cure", "from records of a hunting servo to what stops it",
        records="times and positions; one file for each record", model=", for the fit", csv="the rows of remedies",
        plot="the records laid over the fitted cycle, and what is left",
    )  # fmt: skip
    identification.add_sought(command)
    add_demands(command)
    add_out(command, lambda _: FILES, help="write the page cure.html, cure.json, friction.toml and servo.toml")


def run(options: Asked) -> int:
    """Compute and print; returns the exit code: 1 where the records tell no servo, or no remedy ends its hunting."""
    fit, read = identification.fit_of(options)
    how, demands = options.how(), demands_of(options)
    if options.out is not None:
        keep_others(options.out, FILES)
    found = fit()
    if not found.status.ok:
        complain("casahunt cure", f"the records were not fitted: {found.status.advice}")
        return 1
    gain = found.records[0].gain
    if said := part_without_servos(found.servo, found.uncertainty):
        say(said)
    tell("computing the fold")
    fold = _fold(found, how)
    if found.model is None:  # of a loop of parts sizes are those for the values as found
        table = table_of(options, demands, (found.servo.replace(gain=gain), None, None), options=how, uncertainty=None)
    else:
        asked = found.servo, found.model, gain
        table = table_of(options, demands, asked, options=how, uncertainty=found.uncertainty)
    suspect = identification.suspected(options, found)
    doubt = "" if found.model else "of the values as found: of a loop of parts sizes for the worst ones are not known"
    if not found.judgement.explained:
        doubt = "of a servo that is in doubt, since the model does not explain all of the records: see below"
    record = {
        "suspect": suspect or None, "doubt": doubt or None,
        "advice": advice_of(table), "gain": gain, "limits": table.limits,
        "identified": found.to_dict(table=False), "bounded": found.bounded, "fold": fold,
        "remedies": table.found.to_dict(),
        "as_built": table.built, "wall_s": options.outputs.seconds,
    }  # fmt: skip
    if options.out is not None:
        with folder(options.out, FILES) as out:
            from ..pictures.identify import fitted_records
            from ..pictures.plotting import png

            whole = plain(record) | {"made": made(options.servo_file, options.set)}
            page = cure_page(whole, {"fit": png(fitted_records(found))})
            own = {"cure.html": page, "cure.json": json.dumps(whole, indent=1) + "\n"}
            options.outputs.write(write_results, out, FILES, identification.texts_of(found, options) | own)
    lines = [advice_of(table), *([f"  {doubt}"] if doubt else []),
             *identification.identified_lines(found, suspect, read), *_unbounded(found), *_fold_lines(fold),
             *table_lines(table)]  # fmt: skip
    answer = Answer(lines, [*identification.identified_details(found), *table_details(table)])
    give(options, record, answer, table=tables_of([table.found]), picture=("identify.fitted_records", found))
    return _judged(found, table)


def _judged(found: Identification, table: Table) -> int:
    """The exit code, with what speaks against the answer."""
    if not found.judgement.explained:
        complain("casahunt cure", identification.not_explained(found))
    return judged("casahunt cure", table) or int(not found.judgement.explained)


def _unbounded(found: Identification) -> Iterator[str]:
    """What is meant by the worst servo, where the records do not bound it."""
    for name, (low, high) in found.intervals.items():
        if low <= 0:
            yield f"  {name} may be next to nothing: the worst servo has 1/{BOUND_FACTOR:g} of what was found, no less"
        if high == float("inf"):
            yield f"  {name} has no end: the worst servo has {BOUND_FACTOR:g} times what was found, no more"


def _fold(found: Identification, how: Options) -> dict[str, Any]:
    """The fold gain of the servo as found, and of the worst one that the records allow."""
    said: dict[str, Any] = {"gain": None, "worst": None, "refused": ""}
    try:
        with effort.at_most(MOST_WORK_BESIDE):
            fold: Any = upper(find_fold(found.servo, found.model, options=how))
        said["gain"] = fold.value
        with effort.at_most(MOST_WORK_BESIDE):
            worst = worst_corner(found.servo, found.model, found.uncertainty, options=how, fold=fold)
    except effort.PartGivenUp as refusal:
        longer = "fold" if said["gain"] is None else "uncertainty"
        return said | {"refused": f"{refusal}; casahunt {longer} looks longer"}
    except NoOrbit as refusal:
        return said | {"refused": str(refusal)}
    return said | {"worst": worst.gain, "refused": worst.failures[0] if worst.failures else ""}


def _fold_lines(fold: Mapping[str, Any]) -> Iterator[str]:
    """Where hunting ends if the gain is raised."""
    gain, worst = (None if fold[key] is None else to_error(fold[key], FOLD_SHOWN) for key in ("gain", "worst"))
    if gain is not None:
        yield f"with these values hunting is possible up to gain {gain} V/rad" + (
            "" if worst is None else f", with the worst that the records allow up to {worst}"
        )
    if fold["refused"]:
        yield f"  the fold gain, or its worst: {fold['refused']}"
