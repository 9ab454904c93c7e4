"""The units of the numbers of a servo, by the names they have in a servo file."""

from __future__ import annotations

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


def unit_of(name: str) -> str:
    """The unit of a parameter, by its key or the last part of it; "" where it has none.

    Raises KeyError: no such parameter.
    """
    if name in PARAMETER_UNITS:
        return PARAMETER_UNITS[name]
    return next(unit for key, unit in PARAMETER_UNITS.items() if key.rpartition(".")[2] == name)


def column(name: str, unit: str | None = None) -> str:
    """The name of a column of a CSV file: `friction.viscous_Nms_per_rad`; the name alone for a plain number.

    name, unit: what it holds, and in which unit; None: that of the parameter of this name.
    Returns A name without spaces and slashes.
    """
    unit = unit_of(name) if unit is None else unit
    above, _, below = unit.partition("/")
    above = above.replace("N m s", "Nms").replace("N m", "Nm").replace(" ", "_").removeprefix("1")
    parts = [name, above, f"per_{below.replace(' ', '_')}" if below else ""]
    return "_".join(part for part in parts if part)
