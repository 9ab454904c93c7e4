"""What `casahunt simulate` says of a motion."""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from ...axis_units import quantity, several, shown, word
from ...checks import error_text, to_absolute_error, to_error
from ...servo.move import told
from ...servo.other_end import OtherEnd
from ...servo.outcome import SETTLES
from ...servo.simulate import NAMED
from ...servo.trajectory import Trajectory
from ...servo.units import kinds_of
from .answer import ENDS, Answer, angle, at_gain, called, item, known, parts_of, position, rhythm, short, within

if TYPE_CHECKING:
    from ...servo.drive import Drive
    from ...servo.sampled.check import Cause
    from ...servo.sampled.motion import SampledMotion

EVENT_WORDS = {
    "stop": "stops", "breakaway+": "breakaways forwards", "breakaway-": "breakaways backwards",
    "reversal": "reversals", "centre": "times the bristle slack",
}  # fmt: skip
"""How many of an event are told."""
NOT_LOOKED_AT = "not looked at: it may hunt from nearer to the set point; casahunt orbit and remedies look there"
"""Said of a loop with other parts than those of a servo that comes to rest."""
OF_A_SWING = ", half of its largest swing"
"""What the amplitude of a motion is: of an orbit it is the largest distance from the set point."""
AT = 1e-6
"""Part of its largest distance from the set point within which a servo is at it."""


def simulation_answer(found: Trajectory, other: OtherEnd | None, wall_s: float) -> Answer:
    """What is said of a motion; other: the cycle that one which rests has not come to."""
    return Answer(_plain(found, other), _details(found, other, wall_s))


def _plain(found: Trajectory, other: OtherEnd | None) -> Iterator[str]:
    seen = found.verdict
    partly = ", but not from every start" if other is not None and other.hunts else ""
    name = f"{called(found.loop)} {at_gain(found.gain)}"
    move = "" if found.move is None else f", {told(found.move, found.distance)}"
    where = f"{_way(found)}{move}, {found.duration:.10g} s"
    waits = "" if seen.kind != "decaying" or math.isnan(seen.waits) else "stuck for now, "
    yield f"{name}, {where}: {waits}{ENDS[seen.kind].state}{', irregularly' if seen.irregular else ''}{partly}"
    stuck = f"; at the end it is stuck {_near(found)} the set point, and the growing integral breaks it away again"
    later = "" if math.isnan(seen.waits) else f"{stuck} about {short(seen.waits)} s later"
    yield item("because", f"{seen.sentence}{later}")
    if seen.kind == "hunting":
        yield item("amplitude", angle(seen.amplitude) + OF_A_SWING)
        yield item("period", rhythm(seen.period))
    if other is not None:
        yield item("other starts", elsewhere(other, found.duration))
    elif seen.kind in SETTLES:
        yield item("other starts", NOT_LOOKED_AT)
    yield from parts_of(found.loop)
    velocity = quantity(found.end[1], "rad/s", within, found.state_errors[1])
    end = [f"{_near(found)} the set point", f"velocity {velocity}"]
    yield item("at the end", ", ".join([*end, *_others(found)]))
    by = "" if math.isnan(found.peak_voltage) else f", by {short(found.peak_voltage)} V"
    yield item(word("largest torque"), f"{quantity(found.peak_torque, 'N m', short)}{by}")


def _way(found: Trajectory | SampledMotion) -> str:
    """The set point, and where it began if that is not zero: a plain number is in rad or m, whatever the axis shows."""
    to = f"set point {quantity(found.set_point, 'rad', '.10g')}"
    began = found.set_point + float(found.states[0, 0])
    at_zero = abs(began) <= AT * abs(found.set_point)
    return to if at_zero else f"from {quantity(began, 'rad', '.10g')} to {to}"


def _others(found: Trajectory) -> Iterator[str]:
    """The states of other parts than those of a servo, at the end."""
    for state, value, error in zip(found.names, found.end, found.state_errors, strict=True):
        unit = found.loop.unit_of(state)
        if state in found.loop.angles and state != "x1":
            yield f"{quantity(value, unit, within, error)} from the set point ({state})"
        elif state not in ("x1", *NAMED.values()):
            yield f"{state} {quantity(value, unit, within, error)}".rstrip()


def _near(found: Trajectory) -> str:
    """Where it is at the end."""
    x = float(found.end[0])
    if abs(x) <= max(float(found.state_errors[0]), AT * float(np.abs(found.states[0]).max())):
        return "at"
    return f"{quantity(abs(x), 'rad', within, found.state_errors[0])} {'beyond' if x > 0 else 'short of'}"


def elsewhere(other: OtherEnd, duration: float) -> str:
    """What a motion from another start could come to; `duration` is that of the one that rests [s]."""
    orbit = other.orbit
    if orbit is None:
        return "at this gain there is no hunting cycle to end in" if other.none else (
            "whether there is a hunting cycle at this gain is not known (casahunt orbit says what was tried)"
        )  # fmt: skip
    size = f"of amplitude {position(orbit.amplitude, orbit.amplitude_error)} and period {short(orbit.period)} s"
    if not other.hunts:
        return f"there is a cycle {size}, but no motion was found that stays beside it"
    left_out = {"time": duration, "integral": 0.0, "velocity": 0.0}
    words = [f"--{key} {value:.12g}" for key, value in other.start.items() if left_out.get(key) != value]
    ends = f"in a stable cycle {size}" if orbit.stable else f"swinging unevenly beside a cycle {size}"
    return f"let go at rest with {' '.join(words)} it hunts: it ends {ends}"


def _details(found: Trajectory, other: OtherEnd | None, wall_s: float) -> Iterator[str]:
    seen, errors, x = found.verdict, found.state_errors, found.end
    if seen.swings:
        sizes = several(seen.swings, "rad", ".5g")
        yield item("swings ahead", f"{sizes} in {', '.join(f'{value:.5g}' for value in seen.lasts)} s")
    if other is not None and other.orbit is not None:
        orbit = other.orbit
        amplitude = known(orbit.amplitude, orbit.amplitude_error, most=7)
        period = to_error(orbit.period, orbit.period_error, most=7)
        kind = "stable" if orbit.stable else "symmetric"
        yield item("other cycle", f"{kind}, of amplitude {amplitude} and period {period} s")
    if seen.kind == "hunting":
        of = f"repeats after {seen.pattern} swings" if seen.pattern else "repeats in no pattern"
        yield item("hunting", f"{quantity(seen.amplitude, 'rad', '.6g')}, {seen.period:.6g} s; {of}")
    end = (found.set_point + x[0], "rad", errors[0]), (x[1], "rad/s", errors[1])
    at, velocity = (quantity(x, unit, lambda x, e: to_absolute_error(x, e, most=10), e) for x, unit, e in end)
    yield item("at the end", ", ".join([f"position {at}", f"velocity {velocity}", *_others(found)]))
    yield item("events", counted([event.name for event in found.events]))
    times = f"{error_text(found.time_error)} s of event times"
    yield item("error estimate", f"{times}, {error_text(found.end_error)} of the final state")
    yield item("status", f"{found.status.name.lower()}, {found.intervals} intervals, {wall_s:.2f} s")


def counted(names: Sequence[str]) -> str:
    """How many events there were, and of which."""
    listed = ", ".join(f"{names.count(name)} {EVENT_WORDS.get(name, name)}" for name in dict.fromkeys(names))
    return f"{len(names)}{f' ({listed})' if names else ''}"


# What commands say of the loop as built: a sampled controller, an encoder, and what causes its hunting

REMEDIES = {
    "dead_band": "dead band {}", "shifted_dead_band": "shifted dead band {}", "hysteresis": "hysteresis {}",
    "enter_ratio": "its inner edge {} of that", "leak": "leak {}", "dwell": "freeze after {}", "reset": "reset to {}",
    "reset_at_stop": "reset at a stop to {}", "error_dead_band": "error dead band {}",
    "remaining_gain": "in it {} of the error", "error_filter_time": "error filter {}",
    "compensated": "feedforward of {} of the Coulomb friction",
}  # fmt: skip
"""What is said of a remedy in the controller, by its key."""


def plain_as_built(found: SampledMotion, cause: Cause | None) -> Iterator[str]:
    """What is said of a sampled motion; cause: why it hunts."""
    verdict, q = found.verdict, found.drive.count
    name = f"{called(found.loop)} as built {at_gain(found.gain)}"
    where = f"{_way(found)}, {found.duration:.10g} s"
    yield f"{name}, {where}: {ENDS[verdict.kind].state}"
    yield item("because", verdict.sentence)
    yield from parts_of(found.loop)
    yield item("drive", "; ".join(drive_said(found.drive)))
    if verdict.kind == "hunting":
        low, high = found.readings
        counts = f", {verdict.amplitude / q:.3g} counts; the reading moves over {high - low}" if q else ""
        yield item("amplitude", f"{angle(verdict.amplitude)}{OF_A_SWING}{counts}")
        of = "mean of two swings" if not verdict.pattern else f"of {verdict.pattern} swings"
        if verdict.pattern > 2:
            of += f", to and fro in {short(verdict.mean_period)} s"
        yield item("period", f"{short(verdict.period)} s ({of}), frequency {short(1 / verdict.period)} Hz")
    if cause is not None:
        yield item("cause", f"{cause.kind}: {cause.sentence}")
        ends = "no dead band of the integrator that was tried"
        if not math.isnan(cause.dead_band):
            counts = f", {cause.dead_band / q:.4g} counts" if q else ""
            beyond = "just enough for this motion; casahunt remedies gives one with a margin, for other starts too"
            ends = f"a dead band of the integrator of {quantity(cause.dead_band, 'rad')}{counts}, {beyond}"
        yield item("what ends it", ends)
    x, v = found.states[:2, -1]
    yield item("at the end", f"{position(x)} from the set point, velocity {quantity(v, 'rad/s', short)}")
    by = f", by {short(found.peak_torque / gain)} V" if (gain := found.loop.parameters.get("motor_gain")) else ""
    yield item(word("largest torque"), f"{quantity(found.peak_torque, 'N m', short)}{by}")


def drive_said(drive: Drive) -> Iterator[str]:
    """What a drive does, in a few words each."""
    yield f"{drive.sample_time:g} s"
    if drive.delay:
        yield f"delay {drive.delay:g} s"
    if drive.encoder:
        per = "" if shown().linear else f"{drive.encoder:g} "
        yield f"{per}counts of {quantity(drive.count, 'rad')}"
    if drive.noise:
        yield f"noise of {quantity(drive.noise, 'rad', 'g')} in each reading"
    if drive.quantise_torque:
        yield f"{word('torque')} by {quantity(drive.quantise_torque, 'N m', 'g')}"
    yield f"derivative by {drive.derivative}"
    yield f"integral by {drive.integration}"
    for key, text in REMEDIES.items():
        if (size := getattr(drive, key)) != getattr(type(drive), key):
            yield text.format(quantity(size, kinds_of(key)[0], "g").rstrip())


def details_as_built(found: SampledMotion) -> Iterator[str]:
    """Its numbers, in more digits."""
    verdict = found.verdict
    if verdict.kind == "hunting":
        yield item("amplitude", quantity(verdict.amplitude, "rad", ".6g"))
        yield item("period", f"{verdict.period:.6g} s")
    x, v = found.states[:2, -1]
    at, velocity = quantity(found.set_point + x, "rad", ".10g"), quantity(v, "rad/s", ".6g")
    yield item("at the end", f"position {at}, velocity {velocity}")
    yield item("computed", f"{found.times.size - 1} samples, {found.stops.size} stops, {found.wall_s:.2f} s")
