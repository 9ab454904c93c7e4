"""An uncertainty read from a TOML file.

    [interval]      "friction.static" = [0.52, 0.54], or "2%": l, h = q0 -+ 0.02 |q0|
    [covariance]    names, matrix, sigmas

One of the two tables, not both; q0 is the servo's own value.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from ...checks import known, quoted
from ...errors import InputError
from ...servo.servo import Servo, read_toml
from ..sensitivity import NAMES
from .set import SIGMAS, Uncertainty, check_box, values_of


def load_uncertainty(path: str | Path, servo: Servo) -> Uncertainty:
    """Read an uncertainty from a TOML file.

    Either a table [interval] with ``"friction.static" = [0.52, 0.54]``, or ``"2%"`` of the servo's value to both
    sides; or a table [covariance] with names, matrix and perhaps sigmas.

    Parameters
    ----------
    path
        the file.
    servo
        whose parameters they are; per cents are of its values.

    Returns
    -------
    Uncertainty.

    Raises
    ------
    InputError : missing file, broken TOML, unknown key, or what `Uncertainty` refuses.

    Examples
    --------
    >>> import tempfile
    >>> from pathlib import Path
    >>> from casahunt import Servo, load_uncertainty
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     path = Path(folder, "friction.toml")
    ...     _ = path.write_text('[interval]\\n"friction.static" = [0.52, 0.54]\\n"friction.viscous" = "10%"\\n')
    ...     uncertainty = load_uncertainty(path, Servo())
    >>> low, high = uncertainty.box(Servo())
    >>> low.round(3).tolist(), high.round(3).tolist()
    ([0.52, 0.09], [0.54, 0.11])
    """
    what = f"uncertainty file {str(path)!r}"
    tree = read_toml(path, what)
    try:
        uncertainty = _from_tree(tree, servo)
        check_box(servo, uncertainty)
    except InputError as error:
        raise InputError(f"{what}: {error}") from None
    return uncertainty


def _from_tree(tree: dict[str, Any], servo: Servo) -> Uncertainty:
    for section, table in tree.items():
        known("section", section, ("interval", "covariance"))
        if not isinstance(table, dict):
            raise InputError(f"{section} = {quoted(table)}: must be a table [{section}]")
    if len(tree) != 1:
        raise InputError("must hold one table, either [interval] or [covariance]")
    if "interval" in tree:
        intervals: dict[str, Any] = {}
        for key, value in tree["interval"].items():  # friction.static without quotes is a table in a table
            inner = {f"{key}.{name}": v for name, v in value.items()} if isinstance(value, dict) else {key: value}
            intervals |= {name: _absolute(name, v, servo) for name, v in inner.items()}
        return Uncertainty(intervals)
    table = tree["covariance"]
    for key in table:
        known("key", key, ("names", "matrix", "sigmas"))
    names = table.get("names", [])
    if not isinstance(names, list):
        raise InputError(f"names = {quoted(names)}: must be a list of parameters")
    if "matrix" not in table:
        raise InputError("[covariance]: must have a matrix")
    return Uncertainty(names=tuple(names), covariance=table["matrix"], sigmas=table.get("sigmas", SIGMAS))


def _absolute(name: str, value: Any, servo: Servo) -> Any:
    """An interval as it stands, or that of "2%"."""
    if not isinstance(value, str):
        return value
    known("parameter", name, NAMES)
    match = re.fullmatch(r"\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*%\s*", value)
    try:
        part = float(match.group(1)) / 100 if match else None
    except ValueError:
        part = None
    if part is None:
        raise InputError(f'{name} = {value!r}: must be [low, high] or a percentage such as "2%"')
    q = float(values_of(servo, [name])[0])
    return q - part * abs(q), q + part * abs(q)
