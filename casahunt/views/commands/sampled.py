"""casahunt simulate of the loop as built: a sampled controller, an encoder, and what causes its hunting.  And what
other commands say of their answers in it, where the servo file has a table [drive].

Key of the JSON object beside those of the motion (`SampledMotion.to_dict`): cause (null where it does not hunt or
nothing is quantised): kind ("stiction", "quantisation", "not certain"), counts, dead_band [rad], sentence, without (the
verdict without quantisation).
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from ...axis_units import quantity
from ...errors import NoOrbit
from ...servo.drive import Drive, below_border, by_counts
from ...servo.parts.loop import Loop
from ..answers.answer import Answer, item
from ..answers.simulate import details_as_built, plain_as_built
from .arguments import Asked
from .output import give
from .taken import CONTINUOUS

if TYPE_CHECKING:
    from ...servo.sampled.check import AsBuilt

REMEDIES = {
    "shifted_dead_band": ("RAD", "error up to which nothing is integrated, and beyond it only the rest (default 0)"),
    "hysteresis": ("RAD", "error beyond which it is integrated again (default 0)"),
    "enter_ratio": ("PART", f"of it, below which it is not (default {Drive.enter_ratio:g})"),
    "dwell": ("S", "of equal readings, after which nothing is integrated (default: it always is)"),
    "reset": ("FACTOR", "of the integral where the error changes its sign (default 1)"),
    "reset_at_stop": ("FACTOR", "of the integral where the reading stays (default 1)"),
    "error_dead_band": ("RAD", "error that the whole controller takes for none (default 0)"),
    "remaining_gain": ("PART", f"of the error in there that it sees (default {Drive.remaining_gain:g})"),
    "error_filter_time": ("S", "of a filter of the error (default 0)"),
    "compensated": ("PART", "of the Coulomb friction, added while the reading changes (default 0)"),
}
"""Options of remedies in the controller: metavar and help by the key of the table [drive]."""


def of_drive(
    options: Asked, loop: Loop, drive: Drive, length: float, numbers: Mapping[str, Any]
) -> int:
    """Simulate and print; returns the exit code.

    numbers: of the command line: set_point, position, velocity, integral, bristle, start.
    """
    from ...servo.sampled.check import cause_of  # not read for the continuous loop
    from ...servo.sampled.motion import simulate_sampled

    options.leave_out("of the loop as built --csv has a row for each sample", "step")
    start = {key: number for key, number in numbers.items() if key != "tol"}
    found = simulate_sampled(loop, None, drive, time=length, **start)
    cause = cause_of(found)
    record = {**found.to_dict(table=False), "cause": cause}
    answer = Answer(plain_as_built(found, cause), details_as_built(found))
    table = found._columns() if options.csv else None
    give(options, record, answer, table=table, picture=("simulation.sampled_motion", found))
    return 0


def seen_by_encoder(
    options: Asked, amplitude: float, *, beyond: bool = False
) -> tuple[list[str], dict[str, str | None]]:
    """What a command says of a cycle where the servo file describes a drive: lines, and for JSON.

    amplitude: of the cycle [rad]; beyond: also what the drive may do where there is no cycle any more.
    """
    drive = options.drive()
    if drive is None:
        return [], {}
    sentence, further = below_border(amplitude, drive), by_counts(drive) if beyond else ""
    lines = [item("whose answer", CONTINUOUS)]
    lines += [item("as built", f"the amplitude is {sentence}; casahunt simulate shows it")] if sentence else []
    lines += [item("above that gain", f"{further}; casahunt tune looks")] if further else []
    return lines, {"as_built": sentence or None} | ({"beyond": further or None} if beyond else {})


def hunts_on(options: Asked, refusal: NoOrbit, gain: float) -> NoOrbit:
    """The refusal of a cycle that there is not, and what the drive of the servo file may do all the same."""
    drive = options.drive()
    if drive is None:
        return refusal
    sentence = by_counts(drive) if refusal.status is None else ""
    more = f"; {sentence} (casahunt simulate --gain {gain:g})" if sentence else ""
    shown = f"{refusal.plain}; this is {CONTINUOUS}{more}"
    return NoOrbit(shown, refusal.status, evidence=refusal.evidence)


def checked_lines(
    found: AsBuilt | str | None, what: str, heading: str = "in the loop as built", *, in_full: bool = False
) -> list[str]:
    """What a check has found, as a line below a heading; what: its label; in_full: with what supports it."""
    if found is None:
        return []
    text = found if isinstance(found, str) else found.sentence if in_full else found.plain
    if not isinstance(found, str) and not math.isnan(found.dead_band):
        count = found.worst.drive.count
        counts = f" ({found.dead_band / count:.3g} counts)" if count else ""
        band = quantity(found.dead_band, "rad")
        text += f"; with a dead band of the integrator of {band}{counts} every motion comes to rest"
    lines = [f"  {what:16s} {text}"]
    return [f"{heading}, with Switch friction", *lines] if heading else lines
