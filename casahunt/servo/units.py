"""The units of the numbers of a servo, by the names they have in a servo file."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from ..axis_units import Units, shown, suffix
from ..checks import choice_of, number, quoted, typed
from ..errors import InputError
from ..quantities import unit_of_text, with_its_unit

GAIN_UNIT = "V/rad"
PARAMETER_UNITS = {
    "servo.inertia": "kg m2",
    "servo.motor_gain": "N m/V",
    "controller.lead_time": "s",
    "controller.integral_time": "s",
    "controller.kp": "",
    "controller.ki": "1/s",
    "controller.kd": "s",
    "friction.static": "N m",
    "friction.coulomb": "N m",
    "friction.stribeck_velocity": "rad/s",
    "friction.viscous": "N m s/rad",
    "friction.stiffness": "N m/rad",
    "friction.damping": "N m s/rad",
    "friction.stick_band": "rad/s",
    "friction.stick_rate": "1/s",
    "gain": GAIN_UNIT,
}
"""Of every key of a servo file, and of the gain; "" for a number without one."""


_OF_PARTS = {
    "load_inertia": "kg m2",
    "shaft_stiffness": "N m/rad",
    "shaft_damping": "N m s/rad",
    "load_damping": "N m s/rad",
    "load_torque": "N m",
    "torque_limit": "N m",
    "spring": "N m/rad",
    "unwinding_time": "s",
    "position_gain": "1/s",
    "velocity_gain": "s",
    "reset_time": "s",
    "derivative_filter": "s",
    "velocity_filter": "s",
    "sample_time": "s",
    "delay": "s",
    "noise": "rad",
    "quantise_torque": "N m",
    "filter_time": "s",
    "error_filter_time": "s",
    "dwell": "s",
    "leak": "1/s",
    "dead_band": "rad",
    "shifted_dead_band": "rad",
    "hysteresis": "rad",
    "error_dead_band": "rad",
    "dither": "rad/s",
}
"""Of parameters of parts that no plain servo has, and of keys of a drive."""
_FREQUENCIES = "lead_zero", "lead_pole", "notch_frequency", "low_pass", "filter_frequency"
"""Of filters: a plain number is an angular one."""
_GAINS = {
    "kp": ("V/rad", "N m/rad"),
    "ki": ("1/s", "V/(rad s)", "N m/(rad s)"),
    "kd": ("s", "V s/rad", "N m s/rad"),
    "velocity_gain": ("s", "V s/rad", "N m s/rad"),
}
"""Kinds that a number of a controller may have: of itself, of the voltage at K = 1 V/rad, and of the torque."""


def kinds_of(name: str) -> tuple[str, ...]:
    """The units that a number of a file may have, by its key or the name of a parameter; ("",) for a plain number."""
    last = name.rpartition(".")[2]
    bare = last.removeprefix("load_").removesuffix("_back")
    known = {key.rpartition(".")[2]: unit for key, unit in PARAMETER_UNITS.items()} | _OF_PARTS
    if last in _FREQUENCIES:
        return "1/s", "Hz"
    return _GAINS.get(last) or (known.get(last, known.get(bare, "")),)


def value_of(key: str, value: Any, units: Units) -> float:
    """A number of a file: in SI, or a text of it with its unit, such as "30 kg".

    Raises InputError: neither, or a unit of another kind.
    """
    return number(key, value) if with_its_unit(value) is None else units.read(key, value, *kinds_of(key))


def assigned(
    assignments: Iterable[str], what: str, allowed: Iterable[str], form: str, units: Units | None = None
) -> dict[str, str]:
    """{name: text} of texts name=text.

    what, allowed, form: what a name is called, the names that there are, and how a text looks; units: of the axis.
    Raises InputError: no "=", or an unknown name.
    """
    changes: dict[str, str] = {}
    for text in assignments:
        key, sign, value = text.partition("=")
        if not sign:
            raise InputError(f"--set {text!r}: must have the form {form}")
        key = choice_of(what, (units or shown()).own_name(key.strip()), allowed)
        changes[key] = value.strip()
    return changes


def numbers_of(given: Mapping[str, str], units: Units) -> dict[str, float]:
    """The numbers of texts as a person types them, in SI or with their units.

    given: by name; units: of the axis. Raises InputError: one is no number, or has a unit of another kind.
    """
    return {key: value_of(key, text, units) if with_its_unit(text) else typed(key, text) for key, text in given.items()}


def check_motor_gain(given: Mapping[str, Any], motor_gain: float) -> None:
    """Refuse numbers of a controller that are given as those of the torque, where the motor makes another one of them.

    given: as they were given. Raises InputError: there is one, and the motor gain is not 1.
    """
    for key, text in given.items():
        unit = (with_its_unit(text) or ("", "1/s"))[1]
        if key.rpartition(".")[2] in _GAINS and unit_of_text(unit)[1][1] and motor_gain != 1:
            raise InputError(
                f"{key} = {quoted(text)}: must be given in V where motor_gain is {motor_gain:g}; with motor_gain = 1 "
                "the gains of the voltage are those of the motor"
            )


def unit_of(name: str) -> str:
    """The unit of a parameter of a servo or of a part, by its key or the last part of it; "" where it has none."""
    if name in PARAMETER_UNITS:
        return PARAMETER_UNITS[name]
    return "" if name == "kp" else kinds_of(name)[0]


def column(name: str, unit: str | None = None) -> str:
    """The name of a column of a CSV file: `friction.viscous_Nms_per_rad`; the name alone for a plain number.

    name, unit: what it holds, and in which unit; None: that of the parameter of this name.
    Returns A name without spaces and slashes.
    """
    return name + suffix(unit_of(name) if unit is None else unit)
