"""What to suspect where a record hunts at another frequency than the model, by what the record shows.

units       amplitude times period is off by the factor of another one: the integrator winds up by what friction holds
            in a swing, so that it is known as friction is, and each of the two alone is not
encoder     its steps are seen, and the amplitude is less than `ENCODER_BORDER` of them
a pattern   to and fro it takes the time of the model, but repeats only after more swings than two, as counts make it
friction    with other values, which the record tells, the model explains it
the loop    with none it does: a filter or a delay in it, or its sampling
"""

from __future__ import annotations

import math
from collections.abc import Callable

from ...axis_units import shown
from ...errors import InputError, NoOrbit
from ...servo.problem import HuntingOrbit
from ...servo.units import unit_of
from ..record.units import Quantity, parsed_unit
from .identify import Identification
from .suitable import in_a_pattern, of_few_steps

FAR_FREQUENCY = 0.1
"""Relative difference of the frequencies from which something is to be suspected: friction is known no better."""
COARSE_SAMPLES = 0.1
"""Time between two samples, in units of the loop's 1/omega, omega^2 = kp/J, from which on a drive that samples so hunts
otherwise than the continuous loop by some per cent (scripts/as_built.py order)."""
UNITS: tuple[tuple[Quantity, str], ...] = ("time", "ms"), ("time", "us"), ("angle", "deg"), ("angle", "rev")
"""That are taken for s and rad."""
OF_A_LINEAR_AXIS: tuple[tuple[Quantity, str], ...] = (*UNITS[:2], ("angle", "mm"), ("angle", "um"))
"""That are taken for s and m."""
ABOUT_RIGHT, A_COUNT = 0.3, 10.0
"""Of a model, in the logarithm of amplitude times period: friction that is off by 30 % has moved it by 0.28 at most, of
some 180 servos about Table 1 and a smaller one; and positions in whole numbers that are larger by so much are counts.
"""
SHIFTED = 0.25
"""Of the logarithm of a unit's factor: by so much the other one of period and amplitude may be off, 1.0 for degrees;
friction that is off by 30 % moves either by less than 0.7 to 1.3 in 95 of 100 of those servos."""
MOST_SUSPECTS = 2
"""Parameters that are named."""


def suspicion(
    orbit: HuntingOrbit, period: float, amplitude: float, quantum: float, step: float, swings: int,
    fit: Callable[[], Identification],
) -> str:  # fmt: skip
    """The sentence that says what to suspect; "" where the frequency is about that of the model.

    orbit: of the servo as given; period [s], amplitude, quantum [rad] of the record, step [s] between its
    samples, swings in its period; fit: of the model to it.
    """
    ratio = orbit.period / period
    if unit := _unit(orbit, period, amplitude, quantum):
        return unit
    if abs(math.log(ratio)) < math.log1p(FAR_FREQUENCY):
        return ""
    far = f"the frequency is {ratio:.3g} times that of the servo as given, {1 / orbit.period:.4g} Hz: suspect"
    encoder = of_few_steps(amplitude, quantum)
    if not encoder and swings > 2 and abs(math.log(ratio * swings / 2)) < math.log1p(FAR_FREQUENCY):
        mean = 2 * period / swings
        return f"to and fro it takes {mean:.4g} s in the mean, about as predicted, but it {in_a_pattern(swings)}"
    try:
        found: Identification | None = fit()
    except (NoOrbit, InputError):
        found = None
    if found is not None and found.status.ok and found.judgement.explained:
        or_else = f"; or {encoder}" if encoder else ""
        return f"{far} {_others(orbit, found)}: so the {orbit.model} model explains the record{or_else}"
    if encoder:
        return f"{far} {encoder}"
    omega = math.sqrt(orbit.servo.torque_gains(orbit.gain)[0] / orbit.servo.inertia)
    coarse = f", samples are {step:.3g} s apart, {step * omega:.2g}/omega of the loop"
    coarse = coarse if step * omega > COARSE_SAMPLES else ""
    loop = "a filter or a delay in the loop, or its sampling"
    return f"{far} {loop}: no friction was found to explain the record{coarse}"


def _unit(orbit: HuntingOrbit, period: float, amplitude: float, quantum: float) -> str:
    """The sentence on a unit by which the record is off; "" where it is not."""
    if math.isclose(quantum, 1.0) and amplitude > A_COUNT * orbit.amplitude:
        return "the positions look like counts: --position-unit takes the angle of one in rad"
    late, large = math.log(period / orbit.period), math.log(amplitude / orbit.amplitude)
    for quantity, unit in OF_A_LINEAR_AXIS if shown().linear else UNITS:
        factor, other = math.log(parsed_unit(quantity, unit).factor), large if quantity == "time" else late
        if abs(late + large + factor) < ABOUT_RIGHT and abs(other) < SHIFTED * abs(factor):
            what, option = ("times", "--time-unit") if quantity == "time" else ("positions", "--position-unit")
            return f"the {what} look like {unit}: {option} {unit}"
    return ""


def _others(orbit: HuntingOrbit, found: Identification) -> str:
    """The parameters that differ most from those given, of those that the record tells apart from them."""
    given = {name: orbit.servo.value(name) for name in found.intervals}
    apart = [name for name, (low, high) in found.intervals.items() if not low <= given[name] <= high]
    apart.sort(key=lambda name: -abs(math.log(found.values[name] / max(given[name], 1e-6 * found.values[name]))))
    if not apart:
        return "the values given, none of which is the likeliest"
    units = {name: shown().si.label(unit_of(name)) for name in apart[:MOST_SUSPECTS]}
    return " and ".join(
        f"{name}, {found.values[name]:.3g} {unit}, not {given[name]:.3g}" for name, unit in units.items()
    )
