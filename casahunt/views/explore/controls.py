"""What there is to turn: a control for every number of a state, with its unit and the range of its slider.

    logarithmic   from 1/30 to 30 times the value that the control was made with; where zero is allowed, at its left end
    linear        a number between two limits, or of either sign: a factor, a load
    whole         what may be typed is wider: whatever the servo itself accepts
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any, NamedTuple

from ...servo.parts import LOADS
from ...servo.parts.part import Part
from ...servo.parts.table import unit_of as unit_of_a_part
from ...servo.units import PARAMETER_UNITS
from .state import GAIN, SET_POINT, State, own_numbers, remedy_called

SLIDER_DECADE = 30.0
"""A logarithmic slider goes so many times up and down."""
FIRST_AT_ZERO = 1e-3
"""Where a logarithmic slider stands at zero: the middle of its range, in SI units."""
MOST_NEGATIVE_FACTOR = -1.0
"""The left end of the slider of a factor that has no least one: beyond it a reset would wind up."""
HIDDEN = ("friction.stick_band", "friction.stick_rate")
"""Of the report's regularised simulation, which the page does not show; they stay in the file and in the address."""
LUGRE_ALONE = ("friction.stiffness", "friction.damping")
GROUPS = {"gain": "Gain", "step": "Step", "controller": "Controller", "friction": "Friction", "servo": "Motor",
          "load": "Load", "remedy": "Remedy"}  # fmt: skip
ZEROS = ("controller.lead_time", "controller.kd", "friction.viscous", "friction.damping")
"""Numbers of a servo that may be zero."""
LABELS = {GAIN: "gain K", SET_POINT: "step of the set point", "load_torque": "constant torque"}


class Control(NamedTuple):
    """One number: its key, what it is called, its unit, its group, its value, and the range of its slider."""

    key: str
    label: str
    unit: str
    group: str
    value: float
    low: float
    high: float
    log: bool
    zero: bool


def controls_of(state: State) -> list[Control]:
    """The controls of a state, in order."""
    made = _of_a_loop(state) if state.is_loop else _of_a_servo(state)
    order = list(dict.fromkeys([*GROUPS.values(), *(control.group for control in made)]))
    return sorted(made, key=lambda control: order.index(control.group))


def choices_of(state: State) -> dict[str, dict[str, Any]]:
    """What can be chosen of a servo: {what: {"label", "options": {choice: label}, "chosen"}}."""
    from ...servo.parts.table import remedies_for

    if state.is_loop:
        return {}
    form = "gains" if "controller.kp" in state.values else "times"
    return {
        "model": {"label": "friction model", "options": {"switch": "Switch", "lugre": "LuGre"}, "chosen": state.model},
        "controller": {
            "label": "controller given by", "options": {"times": "its times", "gains": "its gains"}, "chosen": form,
        },
        "remedy": {
            "label": "remedy", "options": {"": "none", **{name: name for name in remedies_for(state.model)}},
            "chosen": state.remedy,
        },
    }  # fmt: skip


def _of_a_servo(state: State) -> list[Control]:
    parts: dict[str, Part] = {}
    if state.remedy:
        remedy = remedy_called(state.remedy, state.model)
        assert remedy.part is not None
        parts = dict.fromkeys(own_numbers(remedy), remedy.part)
    made = []
    for key, value in state.values.items():
        if key in HIDDEN or (key in LUGRE_ALONE and state.model != "lugre"):
            continue
        if key in LOADS.parameters:
            made.append(_ranged(key, value, "Load", LOADS, state.values))
        elif key in parts:
            made.append(_ranged(key, value, "Remedy", parts[key], state.values))
        else:
            group = GROUPS[key.partition(".")[0]]
            made.append(_logarithmic(key, value, group, _unit(key), zero=key in ZEROS))
    return made


def _of_a_loop(state: State) -> list[Control]:
    loop = state.problem.loop
    assert loop is not None
    owners = {name: part for part in loop.parts for name in part.parameters}
    made = [_logarithmic(key, state.values[key], GROUPS[key], _unit(key), zero=False) for key in (GAIN, SET_POINT)]
    return made + [
        _ranged(key, value, owners[key].name.capitalize(), owners[key], state.values)
        for key, value in state.values.items()
        if key in owners and key != GAIN
    ]


def _unit(key: str) -> str:
    return "rad" if key == SET_POINT else PARAMETER_UNITS[key] if key in PARAMETER_UNITS else unit_of_a_part(key)


def _label(key: str) -> str:
    return LABELS.get(key, key.rpartition(".")[2].replace("_", " "))


def _ranged(key: str, value: float, group: str, part: Part, values: Mapping[str, float]) -> Control:
    """The control of a number of a part."""
    low, high = part.ranges.get(key, (0.0, math.inf))
    unit = {"load_torque": "N m", "spring": "N m/rad"}.get(key) or _unit(key)
    if math.isinf(low) and math.isinf(high):
        size = 2 * max(abs(value), abs(values.get("friction.static", values.get("static", 1.0))))
        return Control(key, _label(key), unit, group, value, -size, size, False, False)
    if math.isfinite(high):
        low = MOST_NEGATIVE_FACTOR if math.isinf(low) else low
        return Control(key, _label(key), unit, group, value, min(low, value), high, False, False)
    return _logarithmic(key, value, group, unit, zero=low == 0)


def _logarithmic(key: str, value: float, group: str, unit: str, *, zero: bool) -> Control:
    middle = abs(value) if 0 < abs(value) < math.inf else FIRST_AT_ZERO
    low, high = (float(f"{middle * factor:.2g}") for factor in (1 / SLIDER_DECADE, SLIDER_DECADE))
    return Control(key, _label(key), unit, group, value, low, high, True, zero)
