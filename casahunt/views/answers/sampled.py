"""What commands say of the loop as built: a sampled controller, an encoder, and what causes its hunting."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import TYPE_CHECKING

from .answer import Answer, angle, called, item, parts_of, short
from .simulate import HEADS

if TYPE_CHECKING:
    from ...servo.drive import Drive
    from ...servo.sampled.cause import Cause
    from ...servo.sampled.motion import SampledMotion

REMEDIES = {
    "dead_band": "dead band {:g} rad", "shifted_dead_band": "shifted dead band {:g} rad",
    "hysteresis": "hysteresis {:g} rad", "enter_ratio": "its inner edge {:g} of that", "leak": "leak {:g} 1/s",
    "dwell": "freeze after {:g} s", "reset": "reset to {:g}", "reset_at_stop": "reset at a stop to {:g}",
    "error_dead_band": "error dead band {:g} rad", "remaining_gain": "in it {:g} of the error",
    "error_filter_time": "error filter {:g} s", "compensated": "feedforward of {:g} of the Coulomb friction",
}  # fmt: skip
"""What is said of a remedy in the controller, by its key."""


def sampled_answer(found: SampledMotion, cause: Cause | None) -> Answer:
    """What is said of a sampled motion; cause: why it hunts."""
    return Answer(_plain(found, cause), _details(found))


def _plain(found: SampledMotion, cause: Cause | None) -> Iterator[str]:
    verdict, q = found.verdict, found.drive.count
    name = f"{called(found.loop)} as built at gain {found.gain:.10g} V/rad"
    yield f"{name}, set point {found.set_point:.10g} rad, {found.duration:.10g} s: {HEADS[verdict.kind]}"
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
    yield item("at the end", f"{short(x)} rad from the set point, velocity {short(v)} rad/s")
    by = f", by {short(found.peak_torque / gain)} V" if (gain := found.loop.parameters.get("motor_gain")) else ""
    yield item("largest torque", f"{short(found.peak_torque)} N m{by}")


def _cure(cause: Cause, count: float) -> str:
    if math.isnan(cause.dead_band):
        return "no dead band of the integrator that was tried"
    counts = f", {cause.dead_band / count:.4g} counts" if count else ""
    beyond = "just enough for this motion; casahunt remedies gives one with a margin, for other starts too"
    return f"a dead band of the integrator of {cause.dead_band:.4g} rad{counts}, {beyond}"


def drive_said(drive: Drive) -> Iterator[str]:
    """What a drive does, in a few words each."""
    yield f"{drive.sample_time:g} s"
    if drive.delay:
        yield f"delay {drive.delay:g} s"
    if drive.encoder:
        yield f"{drive.encoder:g} counts of {drive.count:.4g} rad"
    if drive.quantise_torque:
        yield f"torque by {drive.quantise_torque:g} N m"
    yield f"derivative by {drive.derivative}"
    yield f"integral by {drive.integration}"
    for key, text in REMEDIES.items():
        if (size := getattr(drive, key)) != getattr(type(drive), key):
            yield text.format(size)


def _details(found: SampledMotion) -> Iterator[str]:
    verdict = found.verdict
    if verdict.kind == "hunting":
        yield item("amplitude", f"{verdict.amplitude:.6g} rad")
        yield item("period", f"{verdict.period:.6g} s")
    x, v = found.states[:2, -1]
    yield item("at the end", f"position {found.set_point + x:.10g} rad, velocity {v:.6g} rad/s")
    yield item("computed", f"{found.times.size - 1} samples, {found.stops.size} stops, {found.wall_s:.2f} s")
