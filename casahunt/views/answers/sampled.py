"""What commands say of the loop as built: a sampled controller, an encoder, and what causes its hunting."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from ...axis_units import quantity, shown, word
from ...servo.units import kinds_of
from .answer import Answer, angle, at_gain, called, item, parts_of, position, short
from .simulate import HEADS

if TYPE_CHECKING:
    from ...servo.drive import Drive
    from ...servo.sampled.check import Cause
    from ...servo.sampled.motion import SampledMotion

REMEDIES = {
    "dead_band": "dead band {}", "shifted_dead_band": "shifted dead band {}", "hysteresis": "hysteresis {}",
    "enter_ratio": "its inner edge {} of that", "leak": "leak {}", "dwell": "freeze after {}", "reset": "reset to {}",
    "reset_at_stop": "reset at a stop to {}", "error_dead_band": "error dead band {}",
    "remaining_gain": "in it {} of the error", "error_filter_time": "error filter {}",
    "compensated": "feedforward of {} of the Coulomb friction",
}  # fmt: skip
"""What is said of a remedy in the controller, by its key."""


def sampled_answer(found: SampledMotion, cause: Cause | None) -> Answer:
    """What is said of a sampled motion; cause: why it hunts."""
    return Answer(_plain(found, cause), _details(found))


def _plain(found: SampledMotion, cause: Cause | None) -> Iterator[str]:
    verdict, q = found.verdict, found.drive.count
    name = f"{called(found.loop)} as built {at_gain(found.gain)}"
    where = f"set point {quantity(found.set_point, 'rad', '.10g')}, {found.duration:.10g} s"
    yield f"{name}, {where}: {HEADS[verdict.kind]}"
    yield item("because", verdict.sentence)
    yield from parts_of(found.loop)
    yield item("drive", "; ".join(drive_said(found.drive)))
    if verdict.kind == "hunting":
        low, high = found.readings
        counts = f", {verdict.amplitude / q:.3g} counts; the reading moves over {high - low}" if q else ""
        yield item("amplitude", f"{angle(verdict.amplitude)}, half of its largest swing{counts}")
        of = "mean of two swings" if not verdict.pattern else f"of {verdict.pattern} swings"
        if verdict.pattern > 2:
            of += f", to and fro in {short(verdict.mean_period)} s"
        yield item("period", f"{short(verdict.period)} s ({of}), frequency {short(1 / verdict.period)} Hz")
    if cause is not None:
        yield item("cause", f"{cause.kind}: {cause.sentence}")
        yield item("what ends it", _cure(cause, q))
    x, v = found.states[:2, -1]
    yield item("at the end", f"{position(x)} from the set point, velocity {quantity(v, 'rad/s', short)}")
    by = f", by {short(found.peak_torque / gain)} V" if (gain := found.loop.parameters.get("motor_gain")) else ""
    yield item(word("largest torque"), f"{quantity(found.peak_torque, 'N m', short)}{by}")


def _cure(cause: Cause, count: float) -> str:
    if math.isnan(cause.dead_band):
        return "no dead band of the integrator that was tried"
    counts = f", {cause.dead_band / count:.4g} counts" if count else ""
    beyond = "just enough for this motion; casahunt remedies gives one with a margin, for other starts too"
    return f"a dead band of the integrator of {quantity(cause.dead_band, 'rad')}{counts}, {beyond}"


def drive_said(drive: Drive) -> Iterator[str]:
    """What a drive does, in a few words each."""
    yield f"{drive.sample_time:g} s"
    if drive.delay:
        yield f"delay {drive.delay:g} s"
    if drive.encoder:
        per = "" if shown().linear else f"{drive.encoder:g} "
        yield f"{per}counts of {quantity(drive.count, 'rad')}"
    if drive.quantise_torque:
        yield f"{word('torque')} by {quantity(drive.quantise_torque, 'N m', 'g')}"
    yield f"derivative by {drive.derivative}"
    yield f"integral by {drive.integration}"
    for key, text in REMEDIES.items():
        if (size := getattr(drive, key)) != getattr(type(drive), key):
            yield text.format(quantity(size, kinds_of(key)[0], "g").rstrip())


def _details(found: SampledMotion) -> Iterator[str]:
    verdict = found.verdict
    if verdict.kind == "hunting":
        yield item("amplitude", quantity(verdict.amplitude, "rad", ".6g"))
        yield item("period", f"{verdict.period:.6g} s")
    x, v = found.states[:2, -1]
    at, velocity = quantity(found.set_point + x, "rad", ".10g"), quantity(v, "rad/s", ".6g")
    yield item("at the end", f"position {at}, velocity {velocity}")
    yield item("computed", f"{found.times.size - 1} samples, {found.stops.size} stops, {found.wall_s:.2f} s")
