"""Where a fit starts: friction from the balances of a cycle, the rest from a few trials.

Antisymmetric cycle, amplitude a, half period H, area A of half a wave, slip x ~ a sin(pi s/t_s) of duration t_s:

    breakaway   Fs = kp a + ki (A/2 - a t_s/pi)                                   torque at the end of a stick
    energy      mean of F over the way = ki (A/2 - (1 - pi/4) a t_s/pi) - kd a pi^2/(4 t_s)     of a whole slip

with A the integral of |x1| over half a period: the integrator goes from -A/2 to A/2.  The mean of F is that of
Fc + (Fs - Fc) exp(-(v/vs)^2) + viscous v over the way, which gives Fc for each trial of vs and viscous.  So the values
that the user states matter for vs and the viscous friction alone, and several of these are tried.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import islice, product

import numpy as np

from ...errors import InputError, NoOrbit
from ...servo.hunting import Model
from ...servo.problem import HuntingOrbit
from ...servo.servo import Servo, flatten
from .fit import ALL_BUT_NOTHING, NEXT_TO_NOTHING, Array, Data, Question, cycle_at

STATIC, COULOMB, VISCOUS, STRIBECK = (
    "friction.static", "friction.coulomb", "friction.viscous", "friction.stribeck_velocity"
)  # fmt: skip
MOTOR_GAIN = "servo.motor_gain"
MOTOR_FACTORS = (1.0, 0.03, 0.1, 0.2, 0.5, 2.0, 5.0, 10.0, 30.0)
"""Of the motor gain that is stated, where it is tried: with it goes all torque, so whoever errs there errs by far."""
INNER, INNER_TIME = 0.8, 2 * math.asin(0.8) / math.pi
"""Part of the amplitude within which a slip is timed, and the part of its duration that it is there."""
FACTORS = (1.0, 0.3, 3.0)
"""Of the values that are stated, where vs and viscous friction are tried."""
OF_PEAK_SPEED = (0.05, 0.2)
"""vs in units of the largest speed of a slip that are tried besides."""
SCALE, LITTLE_VISCOUS = 0.2, 0.005
"""Scale of a parameter in units of its value; share of the friction below which the viscous one is next to nothing."""
VISCOUS_SHARE = 0.1
"""Share of the friction that is tried for the viscous one where the servo states none."""
LEAST_COULOMB, MOST_COULOMB = 0.2, 0.995
"""Coulomb friction in units of the static one, within which a trial lies."""
COMPARED = 512
"""Phases at which a cycle is compared with a waveform."""
STARTS = 3
"""Trials that are climbed from, the best first."""


def scales_of(data: Data, servo: Servo, free: tuple[str, ...]) -> Array:
    """Scales of the free parameters: a part of their values; of viscous friction a small part of all friction."""
    own = flatten(servo)
    a, slip = data.amplitude, _slip(data)
    kp, _, ki = servo.torque_gains(data.gain)
    static = kp * a + ki * data.period / 4 * float(np.mean(np.abs(data.shape)))
    viscous = LITTLE_VISCOUS * static * 4 * slip / (a * math.pi**2)
    guess = {STATIC: static, COULOMB: static, VISCOUS: viscous / SCALE}
    return np.array([SCALE * guess.get(name, own[name]) for name in free])


def lowest_of(servo: Servo, free: tuple[str, ...]) -> Array:
    """How small the unknowns may be: next to none where the servo may do without, viscous friction for one."""
    lowest = np.full(len(free), ALL_BUT_NOTHING)
    for i, name in enumerate(free):
        try:
            servo.replace(**{name: 0.0})
        except InputError:
            lowest[i] = NEXT_TO_NOTHING
    return lowest


def _slip(data: Data) -> float:
    """About the duration of a slip [s]."""
    inside = float(np.mean(np.abs(data.position - data.position.mean()) < INNER * data.amplitude))
    return max(inside, 1 / data.times.size) * data.period / 2 / INNER_TIME


def trials(question: Question) -> Iterator[dict[str, float]]:
    """Values of the free parameters that the balances allow, from the first record."""
    servo = question.servo
    for factor in MOTOR_FACTORS if MOTOR_GAIN in question.free else (1.0,):
        yield from _balanced(question, servo.replace(**{MOTOR_GAIN: factor * servo.motor_gain}))


def _balanced(question: Question, servo: Servo) -> Iterator[dict[str, float]]:
    """Trials at the motor gain of a servo."""
    data, free = question.records[0], question.free
    kp, kd, ki = servo.torque_gains(data.gain)
    a, half = data.amplitude, data.period / 2
    area = half * float(np.mean(np.abs(data.shape)))
    slip = _slip(data)
    static = kp * a + ki * (area / 2 - a * slip / math.pi)
    mean = ki * (area / 2 - (1 - math.pi / 4) * a * slip / math.pi) - kd * a * math.pi**2 / (4 * slip)
    speed, peak = a * math.pi**2 / (4 * slip), a * math.pi / slip
    Fs = static if STATIC in free else servo.friction.static
    stated = flatten(servo)
    own_vs, own_viscous = servo.friction.stribeck_velocity, servo.friction.viscous
    rates = [own_vs * f for f in FACTORS] + [peak * f for f in OF_PEAK_SPEED] if STRIBECK in free else [own_vs]
    shares = [own_viscous * f for f in FACTORS] if own_viscous > 0 else [VISCOUS_SHARE * abs(mean) / speed]
    for vs, viscous in product(rates, shares if VISCOUS in free else [own_viscous]):
        u = np.linspace(-1, 1, 201)
        share = float(np.mean(np.exp(-((peak / vs) ** 2) * (1 - u * u))))
        left = (mean - viscous * speed - Fs * share) / max(1 - share, 0.05)
        own = {STATIC: Fs, COULOMB: float(np.clip(left, LEAST_COULOMB * Fs, MOST_COULOMB * Fs)), VISCOUS: viscous,
               STRIBECK: vs}  # fmt: skip
        yield {name: own.get(name, stated[name]) for name in free}
    yield {name: stated[name] for name in free}


def starts(question: Question) -> list[Array]:
    """Unknowns from which the fit may start, the most promising first; none where no trial hunts.

    Tried as Switch servos, whose cycles are found quickly; what is promising, as the model that is asked for.
    """
    tried = [found for values in trials(question) if (found := _laid(question, values, "switch")) is not None]
    tried.sort(key=lambda each: each[0])
    if question.model == "switch":
        return [z for _, _, z in tried[:STARTS]]
    asked = (_laid(question, values, question.model) for _, values, _ in tried)
    return [laid[2] for laid in islice((one for one in asked if one is not None), STARTS)]


def _laid(question: Question, values: dict[str, float], model: Model) -> tuple[float, dict[str, float], Array] | None:
    """How far the cycles of some values are from the records, and the unknowns; None where there is none."""
    try:
        servo = question.servo.replace(**values)
        orbits = [cycle_at(servo, model, data.gain, question.options.rough()) for data in question.records]
    except (NoOrbit, InputError):
        return None
    z, off = [*question.unknowns(np.array(list(values.values())))], 0.0
    for data, orbit in zip(question.records, orbits, strict=True):
        tau, b, misfit = laid_over(orbit, data)
        z += [tau, b]
        off += misfit + abs(math.log(orbit.period / data.period)) + abs(math.log(orbit.amplitude / data.amplitude))
    return off, values, np.array(z)


def laid_over(orbit: HuntingOrbit, data: Data) -> tuple[float, float, float]:
    """Phase (in periods, of the middle of the record) and offset (in amplitudes) that lay a cycle over a record, and
    the rest of the waveform, relative: the best of all shifts by a part of a period."""
    phase = np.arange(COMPARED) / COMPARED
    times, states = orbit.sample()
    x = np.interp(phase * orbit.period, times, states[0])
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
