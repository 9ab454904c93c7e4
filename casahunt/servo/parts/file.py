"""A servo in a file: one inertia, as servo.py has it, or a loop: the parts by their names, and their numbers.

    [loop]
    parts = ["two masses", "Switch friction", "cascade P-PI", "integrator", "dead band"]

    [values]
    load_inertia = 0.01
    dead_band = 0.03

What [values] leaves out has the value that the part itself says.  A table [drive] says how a drive runs the loop, as in
a servo file (drive.py), a table [units] whether the axis is linear, and how its numbers are shown.  A part that is made
of lists is a table of them:

    {part = "transfer function", numerator = [0.16, 2.0, 6.28], denominator = [0.001, 1.0, 0.0]}
    {part = "state space", A = [[0.0]], B = [1.0], C = [6.28], D = 2.0}
    {part = "series", filters = ["notch", "low-pass"]}
    {part = "friction table", velocity = [0.0, 0.02, 0.05, 1.0], torque = [0.5, 0.47, 0.44, 0.54], static = 0.53}

Parts by what a file calls them: a name, or a table of what a part is made of.

"leak"     {part = "transfer function", numerator = [0.16, 2.0, 6.28], denominator = [0.001, 1.0, 0.0]}
"""

from __future__ import annotations

import inspect
import math
from collections.abc import Callable, Collection, Mapping, Sequence
from importlib import import_module
from pathlib import Path
from pkgutil import iter_modules
from typing import Any

from ...axis_units import UNITS_TABLE, Units, units_of_table
from ...checks import choice_of, quoted
from ...errors import InputError
from ..drive import DRIVE_TABLE, Drive, drive_of_table
from ..servo import LOOP_TABLE, Servo, read_toml, servo_of_tables
from ..units import check_motor_gain, value_of
from .filters import series
from .linear_controller import state_space
from .linear_forms import transfer_function
from .loop import Loop
from .part import Part
from .table import check_in_the_model
from .tabulated import friction_table


def load(path: str | Path) -> Servo | Loop:
    """Read a servo from a TOML file: by [servo], [controller] and [friction], or by [loop] of parts and their [values].

    Of a rotary servo, keys that the file leaves out keep the value of Table 1, and of parts that of the part.  A table
    [drive] is checked, and read by `load_drive`.  A table [units] says whether the axis is rotary or linear, and how
    its numbers are shown.

    Parameters
    ----------
    path
        the file; a number is in SI, as in `KEYS`' records, a text has its unit: "30 kg", "3 N s/mm".

    Returns
    -------
    Servo; Loop, of a file of parts.

    Raises
    ------
    InputError : missing file, broken TOML, unknown key or part, a value that is not a number or out of range.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from casahunt import load
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "servo.toml")
    ...     _ = path.write_text("[friction]\\nstatic = 0.5\\n")
    ...     servo = load(path)
    >>> servo.friction.static, servo.friction.coulomb  # what the file leaves out is Table 1
    (0.5, 0.44)
    """
    return _read(path)[0]


def load_drive(path: str | Path) -> Drive | None:
    """Read the drive as built from the table [drive] of a file that `load` reads.

    Parameters
    ----------
    path
        the file.

    Returns
    -------
    Drive; None where the file has no such table.

    Raises
    ------
    InputError : as `load`; no sample time, or a value out of range.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from casahunt import load_drive
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "servo.toml")
    ...     _ = path.write_text("[drive]\\nsample_time = 0.001\\nencoder = 2000\\n")
    ...     load_drive(path).encoder
    2000.0
    """
    servo, tables = _read(path)
    return drive_of_table(tables[DRIVE_TABLE], servo.units) if DRIVE_TABLE in tables else None


def _read(path: str | Path) -> tuple[Servo | Loop, dict[str, Any]]:
    """What a file describes, and its tables."""
    what = f"servo file {str(path)!r}"
    tables = read_toml(path, what)
    return (loop_of_tables if LOOP_TABLE in tables else servo_of_tables)(tables, what), tables


def load_loop(path: str | Path) -> Loop:
    """Read a loop, as `load` does, from a TOML file that must have the table [loop].

    Parameters
    ----------
    path
        the file; a number is in SI, a text has its unit: "30 kg", "3 N s/mm".

    Returns
    -------
    Loop.

    Raises
    ------
    InputError : missing file, broken TOML, an unknown part or parameter, or a value that is no number.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from casahunt.servo.parts import load_loop
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "loop.toml")
    ...     parts = '["one inertia", "Switch friction", "PID by times", "integrator", "leak"]'
    ...     _ = path.write_text(f"[loop]\\nparts = {parts}\\n[values]\\nleak = 0.1\\n")
    ...     load_loop(path).value("leak")
    0.1
    """
    what = f"loop file {str(path)!r}"
    return loop_of_tables(read_toml(path, what), what)


def loop_of_tables(tree: Mapping[str, Any], what: str) -> Loop:
    """The loop of the tables of a file.

    what: the beginning of a refusal. Raises InputError: as `load_loop`.
    """
    units = Units()
    try:
        for table in tree:
            choice_of("table", table, (LOOP_TABLE, "values", DRIVE_TABLE, UNITS_TABLE))
        units = units_of_table(tree.get(UNITS_TABLE, {}))
        if DRIVE_TABLE in tree:
            drive_of_table(tree[DRIVE_TABLE], units)
        names, values = tree.get(LOOP_TABLE, {}).get("parts"), tree.get("values", {})
        if not isinstance(names, list) or not names:
            raise InputError('[loop]: must say parts = ["one inertia", "Switch friction", ...]')
        given = {units.own_name(name): value for name, value in values.items()}
        if units.linear:
            _check_complete([name for name in names if isinstance(name, str)], given)
        loop = Loop(parts_of(names), {name: value_of(name, x, units) for name, x in given.items()}, units=units)
        check_motor_gain(given, loop.parameters.get("motor_gain", 1.0))
        return loop
    except InputError as error:
        raise InputError(f"{what}: {units.word(str(error))}") from None


def _check_complete(names: Sequence[str], given: Collection[str]) -> None:
    """Refuse a linear axis of which something is left to its parts, whose numbers are those of a rotary one."""
    usual = {name: value for part in parts_of(names) for name, value in part.parameters.items()}
    given = {*given, *SHAPES_OF_ANY}
    missing = [name for name, value in usual.items() if name not in given and value not in DOES_NOTHING]
    if missing:
        raise InputError(f"{', '.join(missing)}: must be given, of a linear axis nothing is taken from Table 1")


SHAPES_OF_ANY, DOES_NOTHING = ("enter_ratio", "stribeck_exponent"), (0.0, 1.0, math.inf)
"""Shapes that are those of any axis; and values with which a part does nothing."""
MAKERS: dict[str, Callable[..., Part]] = {
    "friction table": friction_table,
    "series": series,
    "state space": state_space,
    "transfer function": transfer_function,
}
"""What is made of numbers that are no parameters; the keys of its table are the arguments."""


def named_parts() -> dict[str, list[Part]]:
    """The parts of this room by their names: of one name all that there are."""
    package = __name__.rpartition(".")[0]
    named: dict[str, list[Part]] = {}
    for module in iter_modules(import_module(package).__path__, f"{package}."):
        for part in vars(import_module(module.name)).values():
            if isinstance(part, Part) and part not in named.setdefault(part.name, []):
                named[part.name].append(part)
    return named


def parts_of(entries: Sequence[Any]) -> tuple[Part, ...]:
    """The parts of these names and tables.  Raises InputError: there is none, with what there is instead."""
    several = [_parts(entry) for entry in entries]
    events = {edge.name for one in several for part in one[:1] for mode in part.modes for edge in mode.ends}
    # best where it waits for events of others that there are, worst where there are none such
    return tuple(
        max(one, key=lambda part: 0 if not part.upon else 1 if events >= set(part.upon) else -1) for one in several
    )


def _parts(entry: Any) -> list[Part]:
    """All parts that this may be."""
    tabled = isinstance(entry, Mapping) and isinstance(entry.get("part"), str)
    if not tabled and not isinstance(entry, str):
        raise InputError(f'parts: {quoted(entry)}: must be the name of a part, or a table {{part = "...", ...}}')
    name = entry["part"] if tabled else entry
    given = {key: value for key, value in entry.items() if key != "part"} if tabled else {}
    check_in_the_model(name)
    if name in MAKERS:
        return [_made(name, given)]
    named = named_parts()
    choice_of("part", name, [*named, *MAKERS])
    if given:
        raise InputError(f"{name}: {next(iter(given))}: its numbers stand in the table [values]")
    return named[name]


def _made(name: str, given: Mapping[str, Any]) -> Part:
    """A part that is made of arguments.  Raises InputError: of others, not all of them, or no lists of numbers."""
    arguments = inspect.signature(MAKERS[name]).parameters.values()
    for key in given:
        choice_of(f"entry of {name}", key, [argument.name for argument in arguments])
    for argument in arguments:
        if argument.default is argument.empty and argument.name not in given:
            needed = ", ".join(f"{a.name} = ..." for a in arguments if a.default is a.empty)
            raise InputError(f'{name}: must say {argument.name}: {{part = "{name}", {needed}}}')
    several = [given[argument.name] for argument in arguments if argument.kind is argument.VAR_POSITIONAL]
    rest = {key: value for key, value in given.items() if not any(value is each for each in several)}
    try:
        return MAKERS[name](*(item for each in several for item in each), **rest)
    except InputError:
        raise
    except (TypeError, ValueError):
        raise InputError(f"{name}: must be made of lists: {', '.join(given)}") from None
