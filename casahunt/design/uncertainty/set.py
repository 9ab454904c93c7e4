"""What is uncertain: intervals of parameters, or a covariance about the servo's own values.

    l_i <= q_i <= h_i,    or    mean q0 and covariance C, whose box is    q0_i +- sigmas sqrt(C_ii)

The parameters are those of the servo file, or of the parts of a loop.  A TOML file has one of two tables:

    [interval]      "friction.static" = [0.52, 0.54], ["0.52 N m", "0.54 N m"], or "2%": l, h = q0 -+ 0.02 |q0|
    [covariance]    names, matrix, sigmas

Where intervals of static and Coulomb friction overlap, the part of the box with static < Coulomb friction is no servo,
and left out: no sample, no corner lies there (`are_servos`).  Intervals found in records may overlap so.

The box of a covariance takes no notice of correlations: its corners are farther out than any likely servo, and normal
samples may lie outside it.

Units: q as in servo/servo.py.  Symbols: k uncertain parameters, l, h (k,) bounds.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from ...checks import LARGEST, choice_of, number, of_kind, quoted, require, shown
from ...errors import InputError
from ...servo.friction import pairs_of
from ...servo.parts.loop import Loop
from ...servo.servo import Servo, read_toml
from ...servo.units import value_of
from ..nearby import are_servos, one_value, servo_at, values_of

Array = np.ndarray

SIGMAS = 3.0
"""Half width of a covariance's box in standard deviations, where none is given: 99.7 % of one parameter."""
LOOKS_LIKE = """[interval], below it lines like '"friction.static" = [0.52, 0.54]' or '"friction.viscous" = "10%"'"""
"""The three lines of an uncertainty file, for who gives another one."""
TYPED_ROUNDING = 1e-10
"""Relative asymmetry, and negative eigenvalue of the correlations, that a typed covariance may have."""


@dataclass(frozen=True, eq=False)
class Uncertainty:
    """What is uncertain: intervals, or a covariance about the servo's own values.

    Attributes
    ----------
    intervals : (low, high) by parameter name, in SI: of a servo as in its file, of a loop as its parts call it.
    names, covariance : k parameter names and their (k, k) covariance, instead of intervals.
    sigmas : half width of a covariance's box, in standard deviations; > 0.

    Raises
    ------
    InputError : nothing or both given, low > high, or a matrix that is no covariance.

    Examples
    --------
    >>> from casahunt import Uncertainty
    >>> Uncertainty({"friction.static": (0.52, 0.54), "friction.viscous": (0.09, 0.11)}).parameters
    ('friction.static', 'friction.viscous')
    >>> Uncertainty(names=("friction.static",), covariance=[[1e-4]]).std.tolist()
    [0.01]
    """

    intervals: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    names: tuple[str, ...] = ()
    covariance: Array | None = None
    sigmas: float = SIGMAS

    def __post_init__(self) -> None:
        of_kind("intervals", self.intervals, Mapping, 'such as {"friction.static": (0.52, 0.54)}')
        if isinstance(self.names, str):
            raise InputError(f"names = {self.names!r}: must be a list of parameters, such as [{self.names!r}]")
        given = len(self.intervals) > 0
        if given == (self.covariance is not None):
            raise InputError("uncertainty: must be either intervals (at least one) or names with a covariance")
        require("sigmas", self.sigmas, above=0)
        if given:
            if len(self.names):
                raise InputError(f"names = {list(self.names)!r}: must be left out where intervals are given")
            object.__setattr__(self, "intervals", {name: _interval(name, i) for name, i in self.intervals.items()})
            return
        object.__setattr__(self, "names", tuple(self.names))
        object.__setattr__(self, "covariance", _covariance(self.names, self.covariance))

    @property
    def parameters(self) -> tuple[str, ...]:
        """The k names of what is uncertain, in the order of every array."""
        return self.names or tuple(self.intervals)

    @property
    def std(self) -> Array:
        """(k,) standard deviations; of an interval those of the uniform distribution."""
        if self.covariance is not None:
            return np.sqrt(np.diag(self.covariance))
        return np.array([high - low for low, high in self.intervals.values()]) / np.sqrt(12)

    def box(self, servo: Any) -> tuple[Array, Array]:
        """(low, high), (k,) each: the intervals, or q0 +- sigmas standard deviations of a servo, loop or problem."""
        if self.covariance is None:
            low, high = np.array(list(self.intervals.values())).T
            return low, high
        q = values_of(servo, self.parameters)
        return q - self.sigmas * self.std, q + self.sigmas * self.std


def _interval(name: str, pair: Any) -> tuple[float, float]:
    if isinstance(pair, str) or not isinstance(pair, Sequence | np.ndarray) or len(pair) != 2:
        raise InputError(f"{name} = {quoted(pair)}: must be an interval [low, high]")
    low, high = number(name, pair[0]), number(name, pair[1])
    if low > high:
        raise InputError(f"{name} = [{shown(low)}, {shown(high)}]: low must not exceed high")
    return low, high


def _covariance(names: tuple[str, ...], matrix: Any) -> Array:
    """The (k, k) matrix, symmetric to the last bit, or InputError."""
    k = len(names)
    if k == 0 or len(set(names)) < k:
        raise InputError(f"names = {list(names)!r}: must be at least one parameter, each once")
    try:
        c = np.array(matrix, dtype=float)
    except (TypeError, ValueError, OverflowError):  # an integer may be too large for a float
        raise InputError(f"covariance: must be a matrix of numbers, {k} rows of {k}") from None
    if c.shape != (k, k) or not (np.abs(c) <= LARGEST**2).all():
        which = f"one for each of {', '.join(names)}"
        raise InputError(f"covariance: must be {k} rows of {k} finite numbers up to {LARGEST**2:g}, {which}")
    spread = np.sqrt(np.abs(np.diag(c)))
    size = np.outer(spread, spread)
    if (np.abs(c - c.T) > TYPED_ROUNDING * size).any():
        raise InputError("covariance: must be symmetric")
    if (np.diag(c) < 0).any():
        raise InputError("covariance: must have no negative variance on its diagonal")
    correlation = np.divide(c, size, out=np.zeros_like(c), where=size > 0)
    if (np.abs(c[size == 0]) > 0).any() or np.linalg.eigvalsh(correlation)[0] < -TYPED_ROUNDING * k:
        raise InputError("covariance: must be positive semidefinite (some correlations contradict each other)")
    return (c + c.T) / 2


def check_box(servo: Servo | Loop, uncertainty: Uncertainty) -> None:
    """Refuse a box that is no servo's.

    servo, uncertainty: the servo or the loop, and its parameters as they may be.
    Raises InputError: it has no such parameter, a bound is out of its parameter's range, or static < Coulomb friction
    all over the box.
    """
    of_kind("uncertainty", uncertainty, Uncertainty, "such as Uncertainty({'friction.static': (0.52, 0.54)})")
    names = uncertainty.parameters
    values_of(servo, names)
    low, high = uncertainty.box(servo)
    pairs = pairs_of(servo)
    roomy = np.where([name in pairs for name in names], high, low)
    for name, bounds in zip(names, np.column_stack([low, high]), strict=True):
        for bound in bounds:
            try:
                one_value(servo, name, float(bound))
            except InputError as error:
                where = "" if uncertainty.covariance is None else f" (at {uncertainty.sigmas:g} standard deviations)"
                raise InputError(f"{error}{where}") from None
    servo_at(servo, names, roomy)


def part_without_servos(servo: Servo | Loop, uncertainty: Uncertainty) -> str:
    """A sentence on the part of the intervals that is no servo, where there is one; "" else."""
    if uncertainty.covariance is not None:
        return ""
    ends = zip(uncertainty.parameters, *uncertainty.box(servo), strict=True)
    coulomb = pairs_of(servo).values()
    least = np.array([[high if name in coulomb else low for name, low, high in ends]])
    if are_servos(servo, uncertainty.parameters, least).all():
        return ""
    return (
        f"of the uncertainty the part with {' below '.join(next(iter(pairs_of(servo).items())))} is left out, which is "
        "no servo; narrow one of the intervals where that is not meant"
    )


def load_uncertainty(path: str | Path, servo: Servo | Loop) -> Uncertainty:
    """Read an uncertainty from a TOML file.

    Either a table [interval] with ``"friction.static" = [0.52, 0.54]`` in SI, ``["0.52 N m", "0.54 N m"]``, or ``"2%"``
    of the servo's value to both sides; or a table [covariance] with names, matrix and perhaps sigmas, in SI.

    Parameters
    ----------
    path
        the file.
    servo
        the servo or the loop of parts whose parameters they are; per cents are of its values.

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


def _from_tree(tree: dict[str, Any], servo: Servo | Loop) -> Uncertainty:
    for section, table in tree.items():
        try:
            choice_of("section", section, ("interval", "covariance"))
        except InputError as error:
            raise InputError(f"{error}; such a file reads {LOOKS_LIKE}") from None
        if not isinstance(table, dict):
            raise InputError(f"{section} = {quoted(table)}: must be a table [{section}]")
    if len(tree) != 1:
        raise InputError(f"must hold one table, either [interval] or [covariance], such as {LOOKS_LIKE}")
    if "interval" in tree:
        intervals: dict[str, Any] = {}
        for key, value in tree["interval"].items():  # friction.static without quotes is a table in a table
            inner = {f"{key}.{name}": v for name, v in value.items()} if isinstance(value, dict) else {key: value}
            own = {servo.units.own_name(name): v for name, v in inner.items()}
            intervals |= {name: _absolute(name, v, servo) for name, v in own.items()}
        return Uncertainty(intervals)
    table = tree["covariance"]
    for key in table:
        choice_of("key", key, ("names", "matrix", "sigmas"))
    names = table.get("names", [])
    if not isinstance(names, list):
        raise InputError(f"names = {quoted(names)}: must be a list of parameters")
    if "matrix" not in table:
        raise InputError("[covariance]: must have a matrix")
    names = [servo.units.own_name(name) if isinstance(name, str) else name for name in names]
    return Uncertainty(names=tuple(names), covariance=table["matrix"], sigmas=table.get("sigmas", SIGMAS))


def _absolute(name: str, value: Any, servo: Servo | Loop) -> Any:
    """An interval in SI, of numbers that may have their units, or that of "2%"."""
    (q,) = values_of(servo, [name]).tolist()
    if isinstance(value, list):
        return [value_of(name, bound, servo.units) if isinstance(bound, str) else bound for bound in value]
    if not isinstance(value, str):
        return value
    match = re.fullmatch(r"\s*([0-9.]+(?:[eE][+-]?[0-9]+)?)\s*%\s*", value)
    try:
        part = float(match.group(1)) / 100 if match else None
    except ValueError:
        part = None
    if part is None:
        raise InputError(f'{name} = {value!r}: must be [low, high] or a percentage such as "2%"')
    return q - part * abs(q), q + part * abs(q)
