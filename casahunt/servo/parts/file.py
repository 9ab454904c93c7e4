"""A loop in a file: the parts by their names, and their numbers.

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
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

from ...axis_units import UNITS_TABLE, units_of_table
from ...checks import choice_of
from ...errors import InputError
from ..drive import DRIVE_TABLE, drive_of_table
from ..servo import read_toml
from ..units import check_motor_gain, value_of
from .loop import Loop
from .naming import parts_of


def load_loop(path: str | Path) -> Loop:
    """Read a loop from a TOML file with the tables [loop] and [values].

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
    try:
        for table in tree:
            choice_of("table", table, ("loop", "values", DRIVE_TABLE, UNITS_TABLE))
        units = units_of_table(tree.get(UNITS_TABLE, {}))
        if DRIVE_TABLE in tree:
            drive_of_table(tree[DRIVE_TABLE], units)
        names, values = tree.get("loop", {}).get("parts"), tree.get("values", {})
        if not isinstance(names, list) or not names:
            raise InputError('[loop]: must say parts = ["one inertia", "Switch friction", ...]')
        given = {units.own_name(name): value for name, value in values.items()}
        loop = Loop(parts_of(names), {name: value_of(name, x, units) for name, x in given.items()}, units=units)
        check_motor_gain(given, loop.parameters.get("motor_gain", 1.0))
        return loop
    except InputError as error:
        raise InputError(f"{what}: {error}") from None
