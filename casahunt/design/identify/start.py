"""Where a fit starts: static and Coulomb friction from a swing of the record, the rest from a few trials.

For each trial of vs and viscous friction one static and one Coulomb friction give a swing of the amplitude and period
of the record (matched.py).  So what the user states matters for vs and the viscous friction alone, and several
of these are tried; the shape of the swing tells which are promising.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from itertools import islice, product
from typing import Any, NamedTuple

import numpy as np

from ...errors import InputError, NoOrbit
from ...orbits import Orbit
from ...servo.friction import Model
from ...servo.servo import Servo
from .fit import ALL_BUT_NOTHING, NEXT_TO_NOTHING, Array, Data, Question, cycle_at, seen_by
from .matched import COULOMB, STATIC, matched, static_of

VISCOUS, STRIBECK = "friction.viscous", "friction.stribeck_velocity"
MOTOR_GAIN = "servo.motor_gain"
MOTOR_FACTORS = (1.0, 0.03, 0.1, 0.2, 0.5, 2.0, 5.0, 10.0, 30.0)
"""Of the motor gain that is stated, where it is tried: with it goes all torque, so whoever errs there errs by far."""
INNER, INNER_TIME = 0.8, 2 * math.asin(0.8) / math.pi
"""Part of the amplitude within which a slip is timed, and the part of its duration that it is there."""
FACTORS = (1.0, 0.3, 3.0)
"""Of the values that are stated, where vs and viscous friction are tried."""
OF_PEAK_SPEED = (0.05, 0.2)
"""vs in units of the largest speed of a slip that are tried besides."""
VS_MEASURE = 0.1
"""What vs is measured by, in the same units: by the value that is stated, one that was stated a hundred times too large
would be sought down to twice the true one and no further.  With twice of it narrow peaks are not followed as far as
static friction that is seen is told; with half of it a fit to a record that does not tell vs takes a third longer."""
SCALE, LITTLE_VISCOUS = 0.2, 0.005
"""Scale of a parameter in units of its value; share of the friction below which the viscous one is next to nothing."""
VISCOUS_SHARE = 0.1
"""Share of the friction that is tried for the viscous one where the servo states none."""
COMPARED = 4096
"""Phases at which a cycle is compared with a waveform: a slip may last a thousandth of the period, and a fit does not
lead to it from beside it."""
STARTS = 3
"""Trials that are climbed from, the best first."""


def scales_of(data: Data, servo: Servo, free: tuple[str, ...]) -> Array:
    """Scales of the free parameters: a part of their values; of friction, a part of what the record shows."""
    static = static_of(servo, data)
    guess = {
        STATIC: static, COULOMB: static, VISCOUS: _viscous_of(LITTLE_VISCOUS / SCALE, servo, data),
        STRIBECK: VS_MEASURE * _peak_speed(data),
    }  # fmt: skip
    return np.array([SCALE * (guess[name] if name in guess else servo.value(name)) for name in free])


def lowest_of(servo: Servo, free: tuple[str, ...]) -> Array:
    """How small the unknowns may be: next to none where the servo may do without, viscous friction for one."""
    lowest = np.full(len(free), ALL_BUT_NOTHING)
    for i, name in enumerate(free):
        try:
            servo.replace(**{name: 0.0})
        except InputError:
            lowest[i] = NEXT_TO_NOTHING
    return lowest


def _viscous_of(share: float, servo: Servo, data: Data) -> float:
    """The viscous friction [N m s/rad] that has a share of all friction in a slip."""
    return share * static_of(servo, data) * 4 * _slip(data) / (data.amplitude * math.pi**2)


def _slip(data: Data) -> float:
    """About the duration of a slip [s]."""
    inside = float(np.mean(np.abs(data.position - data.position.mean()) < INNER * data.amplitude))
    return max(inside, 1 / data.times.size) * data.period / 2 / INNER_TIME


def _peak_speed(data: Data) -> float:
    """About the largest speed of a slip [rad/s]."""
    return data.amplitude * math.pi / _slip(data)


def trials(question: Question) -> Iterator[Servo]:
    """Servos with other motor gains, vs and viscous friction, as far as these are free, by the first record."""
    data, free, friction = question.records[0], question.free, question.servo.friction
    rates, viscous = [friction.stribeck_velocity], [friction.viscous]
    if STRIBECK in free:
        rates = [f * rates[0] for f in FACTORS] + [f * _peak_speed(data) for f in OF_PEAK_SPEED]
    for factor in MOTOR_FACTORS if MOTOR_GAIN in free else (1.0,):
        servo = question.servo.replace(**{MOTOR_GAIN: factor * question.servo.motor_gain})
        if VISCOUS in free:
            viscous = [f * friction.viscous for f in FACTORS] if friction.viscous else [
                _viscous_of(VISCOUS_SHARE, servo, data)
            ]  # fmt: skip
        yield from (servo.replace(**{STRIBECK: vs, VISCOUS: each}) for vs, each in product(rates, viscous))


def starts(question: Question) -> list[Array]:
    """Unknowns from which the fit may start, the most promising first; none where no trial hunts.

    Tried as Switch servos, whose cycles are found quickly; what is promising, as the model that is asked for.
    """
    if question.model is None:  # a loop of parts
        laid = (_laid_as_it_is(question, loop, None) for loop in (*question.tried, question.servo))
        return [one.z for one in laid if one is not None]
    tried = [found for servo in trials(question) if (found := _laid(question, servo, "switch")) is not None]
    tried.sort(key=lambda one: one.off)
    if question.model == "lugre":
        asked = (_laid(question, one.servo, question.model) for one in tried)
        tried = list(islice((one for one in asked if one is not None), STARTS))
    return [one.z for one in tried[:STARTS]]


def _like(question: Question, servo: Servo, model: Model) -> Iterator[Servo]:
    """The servo with the static and Coulomb friction of a swing, as far as they are free; and as it is.

    That is where one of them is held, with which the other one of a swing may not go; and with a bristle, whose cycle
    may attract so weakly that a swing next to it says little of it: the servo is then as a swing of Switch has it.
    """
    sought = [name for name in (STATIC, COULOMB) if name in question.free]
    like = matched(servo, model, question.records[0]) if sought else None
    with suppress(InputError):
        if like is not None:
            yield servo.replace(**{name: like.value(name) for name in sought})
    if len(sought) < 2 or model != "switch":
        yield servo


class _Laid(NamedTuple):
    """How far the cycles of a servo are from the records, the servo, and the unknowns."""

    off: float
    servo: Any
    z: Array


def _laid(question: Question, servo: Servo, model: Model) -> _Laid | None:
    """The nearest one of a trial; None where none hunts."""
    laid = (_laid_as_it_is(question, like, model) for like in _like(question, servo, model))
    return min((one for one in laid if one is not None), key=lambda one: one.off, default=None)


def _laid_as_it_is(question: Question, servo: Any, model: Model | None) -> _Laid | None:
    try:
        orbits = [cycle_at(servo, model, data, question.options.rough()) for data in question.records]
    except (NoOrbit, InputError):
        return None
    values = [servo.value(name) for name in question.free]
    z, off = [*question.unknowns(np.array(values))], 0.0
    for data, orbit in zip(question.records, orbits, strict=True):
        tau, b, misfit = laid_over(orbit, data, seen_by(servo))
        z += [tau, b]
        off += misfit + abs(math.log(orbit.period / data.period)) + abs(math.log(orbit.amplitude / data.amplitude))
    return _Laid(off, servo, np.array(z))


def laid_over(orbit: Orbit, data: Data, seen: int = 0) -> tuple[float, float, float]:
    """Phase (in periods, of the middle of the record) and offset (in amplitudes) that lay a cycle over a record, and
    the rest of the waveform, relative: the best of all shifts by a part of a period."""
    phase = (np.arange(COMPARED) + 0.5) / COMPARED
    times, states = orbit.sample()
    x = np.interp(phase * orbit.period, times, states[seen])
    bins = np.floor(data.times / data.period % 1 * COMPARED).astype(int) % COMPARED
    count = np.bincount(bins, minlength=COMPARED)
    means = np.bincount(bins, data.position, COMPARED) / np.maximum(count, 1)
    held = count > 0
    y = np.interp(np.arange(COMPARED), np.flatnonzero(held), means[held], period=COMPARED)
    b = float(y.mean())
    like = np.fft.irfft(np.conj(np.fft.rfft(x)) * np.fft.rfft(y - b), COMPARED)
    shift = int(np.argmax(like))
    rest = float(np.sqrt(np.mean((y - b - np.roll(x, shift)) ** 2))) / data.amplitude
    return shift / COMPARED, b / data.amplitude, rest
