"""The servo: one inertia with friction under a PID controller, as frozen records; TOML in and out.

    m = -(kp x1 + kd x2 + ki x3)         motor torque on the inertia [N m]; kp, kd, ki: controller.py, times K cm
    J x2' = m - F,   x1' = x2,   x3' = x1                             report, section 3.2

x1 = theta - theta_d [rad], x2 = theta' [rad/s], x3 = integral of x1 [rad s].  The gain K is not part
of the servo: it is the argument of every computation.

Numerical modules see a servo as a vector p, the gain last: of `PARAMETERS` where the controller is given by its times,
of `PID_PARAMETERS` by its gains.  The length tells which; what is neither controller nor gain has one place in both.
"""

from __future__ import annotations

import dataclasses
import json
import re
import tomllib
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from ..axis_units import UNITS_TABLE, Units, carried, units_of_table
from ..checks import choice_of, floated, number, of_kind, quoted, require, sensible
from ..errors import InputError
from ..files import bounded
from ..results import html_table
from .controller import BY_GAINS, BY_TIMES, Controller, Pid, controller_of
from .drive import DRIVE_TABLE, drive_of_table
from .friction import BRISTLE, Friction
from .units import assigned, check_motor_gain, numbers_of, unit_of, value_of

LOOP_TABLE = "loop"
"""The table by which a file is one of a loop of parts (parts/file.py)."""
PARAMETERS = (
    "servo.inertia",
    "servo.motor_gain",
    "controller.lead_time",
    "controller.integral_time",
    "friction.static",
    "friction.coulomb",
    "friction.stribeck_velocity",
    "friction.viscous",
    "friction.stiffness",
    "friction.damping",
    "gain",
)
"""Names of the entries of the parameter vector p, in order, for a controller by times."""
PID_PARAMETERS = (
    *PARAMETERS[:2],
    "controller.kp",
    "controller.ki",
    *PARAMETERS[4:10],
    "controller.kd",
    "gain",
)
"""The same for a controller by gains."""
LARGEST_TOML = 5e4
"""Bytes of a TOML file: ten times a covariance of all parameters with all digits.  Python's parser takes 20 s for the
worst text of this size, one name of 25000 parts, and four times as long for one of twice the size."""


@dataclass(frozen=True, kw_only=True)
class Servo:
    """A servo with dry friction; the defaults are Table 1 of the report.

    Attributes
    ----------
    inertia : J [kg m2], > 0.
    motor_gain : cm [N m/V], > 0.
    controller, friction : the records of those names.
    units : how its numbers are shown; of a linear axis inertia is a mass [kg] and torque a force. They stay in SI, and
        nothing that is computed depends on it.

    Examples
    --------
    >>> from casahunt import Friction, Servo
    >>> servo = Servo(inertia=0.03, friction=Friction(static=0.5))
    >>> servo.replace(**{"friction.viscous": 0.2}).friction.viscous
    0.2
    """

    inertia: float = 0.026
    motor_gain: float = 16.0
    controller: Controller | Pid = field(default_factory=Controller)
    friction: Friction = field(default_factory=Friction)
    units: Units = carried()

    def __post_init__(self) -> None:
        sensible("servo.inertia", self.inertia)
        sensible("servo.motor_gain", self.motor_gain)
        if not isinstance(self.controller, Pid):
            of_kind("controller", self.controller, Controller, "such as Controller(lead_time=0.2), or a Pid")
        of_kind("friction", self.friction, Friction, "such as Friction(static=0.5)")
        of_kind("units", self.units, Units, 'such as Units("linear", "mm", "N", "kg")')
        floated(self)

    def _repr_html_(self) -> str:
        """The servo as a table, for notebooks."""
        units, each = self.units, [(key, value, unit_of(key)) for key, value in flatten(self).items()]
        rows = [(units.word(key), f"{units.number(x, unit):g}", units.label(unit)) for key, x, unit in each]
        return html_table("Servo", ("", "value", "unit"), rows)

    @property
    def names(self) -> tuple[str, ...]:
        """`PARAMETERS` or `PID_PARAMETERS`."""
        return PID_PARAMETERS if isinstance(self.controller, Pid) else PARAMETERS

    @property
    def controller_names(self) -> tuple[str, ...]:
        """The numbers of the controller, dotted: its times, or its gains."""
        return tuple(_GAINS if isinstance(self.controller, Pid) else _TIMES)

    @property
    def tunable_names(self) -> tuple[str, ...]:
        """The numbers that `tune` may free."""
        return self.controller_names

    def parameters(self, gain: float) -> np.ndarray:
        """The vector p of `names` for this servo at controller gain `gain` > 0."""
        p = self._parameters.copy()
        p[-1] = require("gain", gain, above=0)
        return p

    @cached_property
    def _parameters(self) -> np.ndarray:
        values = flatten(self) | {"gain": np.nan}
        return np.array([values[name] for name in self.names])

    def value(self, name: str) -> float:
        """One parameter."""
        return float(self._parameters[self.names.index(choice_of("parameter", name, self.names[:-1]))])

    def torque_gains(self, gain: float) -> tuple[float, float, float]:
        """(kp, kd, ki) in N m/rad, N m s/rad and N m/(rad s) at controller gain `gain`."""
        return self.controller.torque_gains(gain * self.motor_gain)

    def replace(self, **changes: float) -> Servo:
        """A copy with values changed by dotted key: ``servo.replace(**{"friction.static": 0.5})``.

        A controller by times becomes one by gains where kp, ki and kd are given, and the other way round.

        Raises
        ------
        InputError : unknown key, controller numbers of both forms or too few of the other one, or a value out of range.
        """
        values = {choice_of("key", k, KEYS): number(k, v) for k, v in changes.items()}
        own = flatten(self)
        others = _TIMES if isinstance(self.controller, Pid) else _GAINS
        asked = [key for key in others if key in values]
        if asked:
            missing = [key for key in others if key not in values]
            if missing:
                raise InputError(
                    f"{asked[0]}: must come with {' and '.join(missing)}, where the servo's controller is given by "
                    f"{' and '.join(key.split('.')[1] for key in own if key.startswith('controller.'))}"
                )
            own = {key: value for key, value in own.items() if not key.startswith("controller.")}
        return dataclasses.replace(unflatten(own | values), units=self.units)


def called(names: Iterable[str]) -> tuple[str, ...]:
    """What the parameters of a servo are called in functions: the last parts of their names."""
    return tuple(name.rsplit(".", 1)[-1] for name in names)


def a_servo(value: Any) -> Servo:
    """What must be a servo.

    Raises InputError: it is none; says what it is, and how one is made.
    """
    servo: Servo = of_kind("servo", value, Servo, "such as Servo(inertia=0.02); load(path) reads one from a file")
    return servo


def _record_keys(section: str, record: type) -> list[str]:
    return [f"{section}.{f.name}" for f in dataclasses.fields(record)]


KEYS = (
    "servo.inertia",
    "servo.motor_gain",
    *_record_keys("controller", Controller),
    *_record_keys("controller", Pid),
    *_record_keys("friction", Friction),
)
"""Every key of a servo file, dotted; a controller has those of one of its two forms."""
NEEDED = (
    "servo.inertia", "servo.motor_gain", "controller", "friction.static", "friction.coulomb",
    "friction.stribeck_velocity", "friction.viscous",
)  # fmt: skip
"""What a servo of one's own must have, and what of the controller is one table; LuGre has more."""
_TIMES, _GAINS = ([f"controller.{name}" for name in names] for names in (BY_TIMES, BY_GAINS))


def flatten(servo: Servo) -> dict[str, float]:
    """The servo as {dotted key: value}."""
    tree = {
        "servo": {"inertia": servo.inertia, "motor_gain": servo.motor_gain},
        "controller": dataclasses.asdict(servo.controller),
        "friction": dataclasses.asdict(servo.friction),
    }
    return {f"{section}.{key}": float(value) for section, table in tree.items() for key, value in table.items()}


def unflatten(values: Mapping[str, float]) -> Servo:
    """The servo of a full or partial {dotted key: value}; what is missing is Table 1."""
    tree: dict[str, dict[str, Any]] = {"servo": {}, "controller": {}, "friction": {}}
    for key, value in values.items():
        choice_of("key", key, KEYS)
        section, name = key.split(".")
        tree[section][name] = number(key, value)
    return Servo(
        **tree["servo"],
        controller=controller_of(tree["controller"]),
        friction=Friction(**tree["friction"]),
    )


def record_of(servo: Servo) -> dict[str, Any]:
    """The servo as a file of results has it: {"servo": as of `flatten`}, and its units where it has some."""
    shown_in = {} if servo.units.plain else {"units": dataclasses.asdict(servo.units)}
    return {"servo": flatten(servo), **shown_in}


def servo_of_record(record: Mapping[str, Any]) -> Servo:
    """The servo of a record that `record_of` has made."""
    return dataclasses.replace(unflatten(record["servo"]), units=Units(**record.get("units", {})))


def read_toml(path: str | Path, what: str) -> dict[str, Any]:
    """The tables of a TOML file.

    what: the beginning of a refusal: what the file is.
    Raises InputError: no such file, not readable, too large, or not valid TOML.
    """
    return toml_tables(bounded(path, what, LARGEST_TOML), what)


def toml_tables(text: bytes, what: str) -> dict[str, Any]:
    """The tables of the text of a TOML file.

    what: the beginning of a refusal. Raises InputError: too large, or not valid TOML.
    """
    if len(text) > LARGEST_TOML:
        raise InputError(f"{what}: must have at most {LARGEST_TOML:g} bytes")
    try:
        return tomllib.loads(text.decode("utf-8-sig"))  # Windows editors put a byte order mark
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        comma = re.search(rb"^[^#\n]*=\s*([-+]?\d+),(\d+)\s*(#.*)?$", text, re.MULTILINE)
        why = f"; decimals take a point, {(comma[1] + b'.' + comma[2]).decode()}" if comma else ""
        raise InputError(f"{what}: not valid TOML: {error}{why}") from None
    except RecursionError:
        raise InputError(f"{what}: cannot be read: its brackets are nested too deeply") from None
    except ValueError:  # Python's limit for the digits of an integer
        raise InputError(f"{what}: cannot be read: it holds a number of too many digits") from None


def toml_value(value: Any) -> str:
    """A text, a number, or a list or a table of such, as TOML has it in one line."""
    if isinstance(value, Mapping):
        return "{" + ", ".join(f"{key} = {toml_value(each)}" for key, each in value.items()) + "}"
    if isinstance(value, list | tuple):
        return "[" + ", ".join(map(toml_value, value)) + "]"
    return json.dumps(value) if isinstance(value, str | bool) else str(value)


def servo_of_tables(tree: Mapping[str, Any], what: str) -> Servo:
    """The servo of the tables of a file.

    what: the beginning of a refusal. Raises InputError: as `load`.
    """
    values: dict[str, float] = dict.fromkeys(KEYS, 0.0)
    units = Units()
    try:
        units = units_of_table(tree.get(UNITS_TABLE, {}))
        given = _given(tree, units)
        values = {key: value_of(key, value, units) for key, value in given.items()}
        if units.linear:
            _check_complete(given)
        servo = dataclasses.replace(unflatten(values), units=units)
        check_motor_gain(given, servo.motor_gain)
        return servo
    except InputError as error:
        missing = [key for key in KEYS if key in str(error) and key not in values and not units.linear]
        taken = f"; {missing[0]} is not in the file, and taken from Table 1 of the report" if missing else ""
        raise InputError(f"{what}: {units.word(str(error))}{taken}") from None


def _check_complete(given: Mapping[str, Any]) -> None:
    """Refuse a linear axis of which something is left to Table 1, which is a rotary one."""
    own = {key.partition(".")[0] if key.startswith("controller") else key for key in given}
    missing = [key for key in NEEDED if key not in own]
    if missing:
        raise InputError(f"{', '.join(missing)}: must be given, of a linear axis nothing is taken from Table 1")


def check_bristle(tree: Mapping[str, Any], changed: Iterable[str]) -> None:
    """Refuse LuGre friction of a linear axis whose bristle is left to Table 1.

    tree, changed: the tables of its file, and what is given besides, as "friction.stiffness=1e6". Raises InputError.
    """
    given = [*(f"friction.{name}" for name in tree.get("friction", {})), *changed]
    missing = [key for key in BRISTLE if not any(text.partition("=")[0].strip() == key for text in given)]
    if missing and units_of_table(tree.get(UNITS_TABLE, {})).linear:
        raise InputError(
            f"{', '.join(missing)}: must be given for the lugre model, of a linear axis nothing is taken from Table 1; "
            "--model switch needs no bristle"
        )


def _given(tree: Mapping[str, Any], units: Units) -> dict[str, Any]:
    """{dotted key: what is given} of a parsed servo file."""
    given: dict[str, Any] = {}
    sections = sorted({key.split(".")[0] for key in KEYS} | {DRIVE_TABLE, UNITS_TABLE})
    for section, table in tree.items():
        if section == DRIVE_TABLE:
            drive_of_table(table, units)
        if section in (DRIVE_TABLE, UNITS_TABLE):
            continue
        owner = [key.split(".")[0] for key in KEYS if key.split(".")[1] == section]
        if owner:
            raise InputError(f"{section} = {quoted(table)}: must stand in its table [{owner[0]}]")
        choice_of("section", section, sections)
        if not isinstance(table, dict):
            raise InputError(f"{section} = {quoted(table)}: must be a table [{section}]")
        for name, value in table.items():
            key = choice_of("key", units.own_name(f"{section}.{name}"), KEYS)
            if key in given:
                raise InputError(f"{section}.{name}: is given twice, as {key} too")
            given[key] = value
    return given


def with_overrides(servo: Servo, assignments: Iterable[str]) -> Servo:
    """Apply texts as the command line's --set gives them.

    assignments: ``section.key=value`` texts. Returns servo with these values. Raises InputError: no "=", unknown key,
    or a value that is not a number or out of range.
    """
    given = assigned(assignments, "key", KEYS, "section.key=value", servo.units)
    changed = servo.replace(**numbers_of(given, servo.units))
    check_motor_gain(given, changed.motor_gain)
    return changed
