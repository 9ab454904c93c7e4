"""casahunt basin: how near to its set point a servo that stands still comes to rest."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any

from ...axis_units import shown
from ...checks import error_text, to_error
from ...results import tables_of
from ...servo.basin import OFFSET, Basin, basin
from ..answers.answer import ENDS, Answer, angle, at_gain, called, complex_text, item, known, parts_of, record_of, short
from .arguments import Asked, add_command, finite
from .console import complain
from .output import give


def add(commands: Any) -> None:
    """The arguments of the command."""
    command = add_command(
        commands, "basin", "how near to the set point it must stand to come to rest", gain=True, model="",
        csv="the stick positions of the two motions", plot="the motions from both sides",
    )  # fmt: skip
    command.add_argument(
        "--offset",
        default=OFFSET,
        help=f"of one inertia, relative distance from the border of the two motions (default {OFFSET:g})",
    )


def run(options: Asked) -> int:
    """Compute and print; returns the exit code."""
    how, offset, asked = options.how(), finite("offset", options.offset), options.subject(gain=True)
    found = basin(*asked, options=how, offset=offset)
    drive = options.drive()
    answer = basin_answer(found, how.tol, drive.count if drive else 0.0)
    record = found.to_dict(table=False) | record_of(asked[0])
    give(options, record, answer, table=tables_of([found]), picture=("event_map.basin", found))
    if not found.confirmed:
        complain(
            "casahunt basin",
            "the motions from the two sides do not confirm the border: from a little inside it the servo should come "
            "to rest, from a little outside it should not; between the cycles it may do either",
        )
        return 1
    return 0


# What `casahunt basin` says of the border between coming to rest and hunting

POSITIONS_SHOWN = 6
"""Positions of a motion that are shown, at most."""


def basin_answer(found: Basin, tol: float, count: float = 0.0) -> Answer:
    """What is said of a border.

    tol: to which the positions of the two motions are known; count: of the encoder [rad], 0 without one.
    """
    title, border = f"{called(found.loop)} {at_gain(found.gain)}", angle(found.border, found.error_estimate)
    unseen = found.border < count
    if found.confirmed:
        head = f"{title}: where it sticks within {border} of the set point it comes to rest, a little farther away it "
        head += "does not"
        way = "end its hunting" if unseen else "bring it to rest within that distance, or end its hunting"
        means = item("what to do", f"{way}: casahunt remedies")
    else:
        head = f"{title}: an unstable hunting cycle stands at {border}; that it bounds coming to rest is not confirmed"
        means = item("what it means", "nearer and farther the servo may come to rest or hunt")
    plain = [head, *parts_of(found.loop), means]
    if found.model != "switch":
        wound = "the controller's torque has come up to nine tenths of static friction"
        plain.append(item("where", f"as it stands when {wound}; let go with none it may rest from farther away"))
    inside, outside = (ENDS[trial.outcome].did for trial in (found.inside, found.outside))
    tried = f"from just inside {inside}, from just outside {outside}"
    tried += "" if found.unstable else f"; {found.motions} motions from rest, on both sides of the set point"
    beyond = "irregular hunting" if found.irregular else "no hunting cycle was found"
    if found.outer is not None:
        beyond = f"a hunting cycle of amplitude {angle(found.outer.amplitude, found.outer.amplitude_error)}"
        beyond += "" if found.outer.stable else ", which motions leave again, unevenly"
    plain += [item("farther away", beyond), item("tried", tried)]
    if unseen:
        counts = f"that distance is {short(found.border / count)} counts of the encoder"
        plain.append(item("as built", f"{counts}: the drive cannot tell whether it is within it"))
    return Answer(plain, _details(found, tol))


def _details(found: Basin, tol: float) -> Iterator[str]:
    if found.model != "switch":
        yield item("border", "x1 at m = 0.9 Fs before breakaway")
    side = "below" if found.side < 0 else "above"
    yield item("border", f"{known(found.border, found.error_estimate)}, {side} the set point")
    if found.unstable is not None:
        amplitude = known(found.unstable.amplitude, found.error_estimate)
        yield item("unstable cycle", f"amplitude max |x1| = {amplitude}")
        what = "of its amplitude and period"
    else:
        yield item("unstable cycle", "not computed: the border is where motions part")
        what = "half of what is between the two motions"
    yield item("estimated error", f"{error_text(found.error_estimate)} (relative, {what})")
    if found.outer is None:
        yield item("stable cycle", found.why_no_outer)
    else:
        amplitude, m = known(found.outer.amplitude, found.outer.amplitude_error), found.outer.multipliers
        mu = complex_text(m.leading, m.error, m.leading_floor)
        leaves = "" if found.outer.stable else f", not stable (half multiplier {mu}): swings next to it leave it"
        kind = "stable cycle" if found.outer.stable else "symmetric cycle"
        yield item(kind, f"amplitude max |x1| = {amplitude}{leaves}")
    for name, trial in (("inside", found.inside), ("outside", found.outside)):
        named = shown().near(max(map(abs, trial.positions), default=0.0), "rad")
        a = [to_error(shown().number(position, "rad", named), tol, most=4) for position in trial.positions]
        path = ", ".join(a if len(a) <= POSITIONS_SHOWN else [*a[: POSITIONS_SHOWN - 2], "...", a[-1]])
        yield item(f"from {name}", f"{trial.outcome} after {len(a) - 1} turns: {path} {named}")
