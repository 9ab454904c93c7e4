"""The units in which the numbers of an axis are shown; inside all of them are SI.

    5.718e-5 rad  ->  "5.718e-05 rad"    of a rotary axis;    "57.18 um"    of a linear one that is shown in mm

Where a quantity is written its unit is said as that of a rotary axis in SI, in `rad`, `N m` and `kg m2`; of a linear
one it is in `m`, `N` and `kg`: "N m s/rad" is "N s/m".  A gain stays in V/rad or V/m, in which it is given.

`Units` is carried by a servo and by what is found of it, and changes no computation.  What writes a sentence asks
`quantity`, which looks at the units of whoever is answering (`shown_in`).
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import dataclass, field
from functools import wraps
from typing import Any, ParamSpec, TypeVar

import numpy as np

from .checks import choice_of, quoted
from .errors import InputError
from .quantities import COUNTS, in_si, number_in, size_of, unit_of_text

P = ParamSpec("P")
R = TypeVar("R")
UNITS_TABLE = "units"
"""The table of a servo file."""
_PARTS = ("coordinate", "effort", "inertia")
_KEYS = {"rotary": ("angle", "torque", "inertia"), "linear": ("length", "force", "mass")}
"""What the three are called in a file, by motion."""
_SI = {"rotary": ("rad", "N m", "kg m2"), "linear": ("m", "N", "kg")}
_ROTARY = re.compile("N m|kg m2|rad")
_MASS_OR_FORCE = re.compile(r"(?<![A-Za-z])(mass|force)(?![A-Za-z])")
_SAID = re.compile(
    r"(?<![\w/(-])(V(?: s)?/rad|N m(?: s)?(?:/rad|/V|/A)?|kg m(?:2|\$\^2\$)|rad(?: s)?|(?<=velocity \[)rad/s)"
    r"(?![\w/('-])"
)
"""Units of numbers in a sentence; not rad/s, which is a frequency, too, but of a velocity."""
NOT_EXPORTED = {"exported": False}
"""Of a field of a record that is not among what is exported."""
ONE_UNIT_UP_TO = 100.0
"""Numbers of one row whose ratio is smaller have one unit."""
READS_WELL = 0.1, 1e4
"""From and below which a number stays in the unit that was asked for."""
_COLUMNS = ("N m s/rad", "N m/(rad s)", "N m/rad", "V/rad", "rad/s", "rad s", "N m/V", "kg m2", "N m", "rad")
"""Units in the names of columns, such that none is the end of a later one's name."""


@dataclass(frozen=True)
class Units:
    """The units in which the numbers of an axis are shown.

    Attributes
    ----------
    motion : "rotary" or "linear".
    coordinate, effort, inertia : of angles or lengths, of torques or forces, of inertias or masses; "": that in SI.
    counts : the size of a count of the encoder, such as "0.1 um"; "" where it is not stated.

    Examples
    --------
    >>> from casahunt import Units
    >>> axis = Units("linear", "mm")
    >>> axis.label("N m s/rad"), axis.number(0.002, "rad/s")
    ('N s/mm', 2.0)
    """

    motion: str = "rotary"
    coordinate: str = ""
    effort: str = ""
    inertia: str = ""
    counts: str = ""

    def __post_init__(self) -> None:
        choice_of(f"{UNITS_TABLE}.motion", self.motion, _KEYS)
        for key, part, si in zip(_KEYS[self.motion], _PARTS, _SI[self.motion], strict=True):
            unit = getattr(self, part) or si
            in_si(f"{UNITS_TABLE}.{key}", f"1 {unit}", (si,), self.counts)
            object.__setattr__(self, part, unit)
        if self.counts:
            exponents = size_of(f"{UNITS_TABLE}.{COUNTS}", self.counts)[1]
            if exponents != unit_of_text(si := _SI[self.motion][0])[1]:
                raise InputError(
                    f"{UNITS_TABLE}.{COUNTS} = {quoted(self.counts)}: must be in {si}, or in a multiple of that"
                )

    @property
    def plain(self) -> bool:
        """Whether nothing was asked for: a rotary axis in SI."""
        return not self.linear and (self.coordinate, self.effort, self.inertia) == _SI[self.motion]

    @property
    def linear(self) -> bool:
        """Whether the axis is a linear one."""
        return self.motion == "linear"

    @property
    def step(self) -> float:
        """How far a servo goes where that is not stated [rad], [m]: 1 rad, or one unit of length."""
        return float(unit_of_text(self.coordinate, self.counts)[0]) if self.linear else 1.0

    @property
    def si(self) -> Units:
        """The same axis in SI."""
        return _IN_SI[self.motion]

    def label(self, unit: str) -> str:
        """The unit in which a quantity is shown.

        Parameters
        ----------
        unit
            its own in SI, of a rotary axis.

        Returns
        -------
        Such as "N s/mm".
        """
        own = self.si if unit.startswith("V") else self
        names = {"rad": own.coordinate, "N m": own.effort, "kg m2": own.inertia}
        return _ROTARY.sub(lambda found: names[found[0]], unit)

    def number(self, x: Any, unit: str, label: str = "") -> Any:
        """A number in SI, or an array of them, in the unit in which it is shown.

        Parameters
        ----------
        x, unit
            the number, and its own unit in SI, of a rotary axis.
        label
            the unit that is wanted; default: that of `label`.

        Returns
        -------
        A number, or an array of the same shape.
        """
        label = label or self.label(unit)
        if label == self.si.label(unit):
            return x
        if np.ndim(x) == 0:
            return number_in(float(x), label, self.counts)
        return np.asarray(x) / float(unit_of_text(label, self.counts)[0])

    def near(self, size: float, unit: str) -> str:
        """The unit in which numbers of a size are shown: with a prefix that reads well.

        Parameters
        ----------
        size, unit
            in SI, of a rotary axis.

        Returns
        -------
        Such as "um" of what is shown in mm.
        """
        label = self.label(unit)
        shown, first = abs(float(self.number(size, unit))), re.match("([numk]?)(m|N|rad)(?![A-Za-z])", label)
        if self.plain or not first or not 0 < shown < math.inf or READS_WELL[0] <= shown < READS_WELL[1]:
            return label
        wanted = [f"{prefix}{label[first.start(2):]}" for prefix in (*("k" * (first[2] == "N")), "", "m", "u", "n")]
        return next((each for each in wanted if abs(self.number(size, unit, each)) >= 1), wanted[-1])

    def word(self, text: str) -> str:
        """A name, spoken of this kind of axis: of a linear one mass for inertia, force for torque."""
        return text.replace("inertia", "mass").replace("torque", "force") if self.linear else text

    def own_name(self, text: str) -> str:
        """What a person calls mass or force of a linear axis, by its name here.

        Parameters
        ----------
        text
            such as "servo.mass".

        Returns
        -------
        Such as "servo.inertia".
        """
        names = {"mass": "inertia", "force": "torque"}
        return _MASS_OR_FORCE.sub(lambda found: names[found[1]], text) if self.linear else text

    def read(self, key: str, text: str, *kinds: str) -> float:
        """A number with its unit, in SI.

        Parameters
        ----------
        key, text
            what the user calls it, and what was given.
        *kinds
            units in SI, of a rotary axis, that it may have.

        Returns
        -------
        The double that is nearest.

        Raises
        ------
        InputError : a unit of another kind, or an unknown one.
        """
        wanted = [self.si.label(kind) for kind in kinds]
        why = f"; the axis is {self.motion} ([units] motion)"
        return in_si(self.word(key), text, wanted, self.counts, why)

    def relabelled(self, text: str) -> str:
        """A sentence whose numbers are in SI, of a rotary axis, with the units of this one in SI."""
        return _SAID.sub(lambda found: self.si.label(found[0].replace("$^2$", "2")), text) if self.linear else text

    def columns(self, table: Mapping[str, Any]) -> Mapping[str, Any]:
        """A table whose columns say their units in SI, of a rotary axis, in those that are shown."""
        return table if self.plain else dict(self._column(name, values) for name, values in table.items())

    def _column(self, name: str, values: Any) -> tuple[str, Any]:
        if name == "unit":  # of what stands beside it, which stays in SI
            return name, [self.si.label(str(unit)) for unit in values]
        bare = name.removesuffix("_per_unit")
        unit = next((unit for unit in _COLUMNS if bare.endswith(suffix(unit))), "")
        if not unit or "crossover" in name:
            return self.word(name), values
        shown = [self.number(x, unit) if isinstance(x, float | np.floating) else x for x in values]
        named = self.word(bare.removesuffix(suffix(unit))) + suffix(self.label(unit))
        return named + name.removeprefix(bare), shown

    def table(self) -> dict[str, str]:
        """The table [units] of a file."""
        own = dict(zip(_KEYS[self.motion], (self.coordinate, self.effort, self.inertia), strict=True))
        return {"motion": self.motion, **own, **({COUNTS: self.counts} if self.counts else {})}

    def record(self) -> dict[str, str]:
        """For JSON, whose numbers are in SI: in which units."""
        names = dict(zip(_KEYS[self.motion], _SI[self.motion], strict=True))
        return {"motion": self.motion, **names, "gain": self.label("V/rad"), "time": "s"}


_IN_SI = {motion: Units(motion) for motion in _KEYS}
_PLAIN = _IN_SI["rotary"]
_SHOWN: ContextVar[Units] = ContextVar("_SHOWN", default=_PLAIN)


def suffix(unit: str) -> str:
    """A unit as the end of the name of a column: `_Nms_per_rad`; "" for none."""
    above, _, below = unit.replace("(", "").replace(")", "").partition("/")
    above = above.replace("N m s", "Nms").replace("N m", "Nm").removeprefix("1")
    return "".join(f"_{part}" for part in (above, below and f"per_{below}") if part).replace(" ", "_")


def units_of_table(table: Any) -> Units:
    """The units of the table [units] of a file.

    Raises InputError: no table, an unknown key, a unit of another kind, or one of the other kind of axis.
    """
    if not isinstance(table, Mapping):
        raise InputError(f"{UNITS_TABLE} = {quoted(table)}: must be a table [{UNITS_TABLE}]")
    motion = choice_of(f"{UNITS_TABLE}.motion", table.get("motion", "rotary"), _KEYS)
    for name in table:
        other = next((kind for kind, keys in _KEYS.items() if name in keys and kind != motion), "")
        if other:
            raise InputError(f'{UNITS_TABLE}.{name}: is of a {other} axis, and [units] says motion = "{motion}"')
        keys = ("motion", *_KEYS[motion], COUNTS)
        choice_of("key", f"{UNITS_TABLE}.{name}", [f"{UNITS_TABLE}.{key}" for key in keys])
    own = {part: table.get(key, "") for part, key in zip(_PARTS, _KEYS[motion], strict=True)}
    return Units(motion, **own, counts=table.get(COUNTS, ""))


def shown() -> Units:
    """The units in which numbers are shown just now."""
    return _SHOWN.get()


@contextmanager
def shown_in(units: Units) -> Iterator[None]:
    """Show the numbers of a block in these units."""
    before = _SHOWN.set(units)
    try:
        yield
    finally:
        _SHOWN.reset(before)


def show_in(units: Units) -> None:
    """Show numbers in these units from now on, up to the end of the `shown_in` around it."""
    _SHOWN.set(units)


def units_of(thing: Any) -> Units:
    """The units that something carries, as a servo, or a result of one does; those of SI where it carries none."""
    for _ in range(4):
        if isinstance(thing, list | tuple) and not hasattr(thing, "_fields"):
            thing = thing[0] if thing else None
        if isinstance(found := getattr(thing, "units", None), Units):
            return found
        thing = next((each for name in _CARRIERS if (each := getattr(thing, name, None)) is not None), None)
    return _PLAIN


_CARRIERS = ("servo", "loop", "problem", "orbit", "fold", "orbits", "motion", "worst", "without")
"""By which attribute a result holds another one that carries units."""


def carried() -> Any:
    """The field of a frozen record that carries units: those in which numbers are shown where it is made.

    Records that differ in them alone are equal, and what is exported says them once for all.
    """
    return field(default_factory=shown, compare=False, repr=False, metadata=NOT_EXPORTED)


def in_its_units(function: Callable[P, R]) -> Callable[P, R]:
    """Let a function write its sentences in the units of what it is given."""

    @wraps(function)
    def inner(*arguments: P.args, **keywords: P.kwargs) -> R:
        carried = (units_of(each) for each in (*arguments, *keywords.values()))
        with shown_in(next((units for units in carried if not units.plain), shown())):
            return function(*arguments, **keywords)

    return inner


def quantity(x: float, unit: str, text: str | Callable[..., str] = ".4g", *more: float, of: float = math.nan) -> str:
    """A quantity, as it stands in a sentence: number and unit.

    x, unit: in SI, of a rotary axis; text: its format, or a function of it and of `more`, what is in the same unit, as
    its error; of: the number by whose size the unit is chosen, where it is not its own.
    """
    units = shown()
    named = units.near(x if math.isnan(of) else of, unit)
    first, *others = (units.number(each, unit, named) for each in (x, *more))
    number = format(first, text) if isinstance(text, str) else text(first, *others)
    return f"{number} {named if number != '0' else units.label(unit)}"


def several(numbers: Sequence[float], unit: str, text: str | Callable[..., str] = ".4g", by: str = ", ") -> str:
    """Quantities of one kind, with one unit behind the last of them, or each its own where they differ widely.

    numbers, unit, text: as of `quantity`; by: what stands between them.
    """
    units, sizes = shown(), [abs(x) for x in numbers if x]
    if not units.plain and sizes and max(sizes) > ONE_UNIT_UP_TO * min(sizes):
        return by.join(quantity(x, unit, text) for x in numbers)
    named = units.near(max(map(abs, numbers), default=0.0), unit)
    each = (units.number(x, unit, named) for x in numbers)
    return f"{by.join(format(x, text) if isinstance(text, str) else text(x) for x in each)} {named}"


def label(unit: str) -> str:
    """The unit in which a quantity is shown; of a column or an axis."""
    return shown().label(unit)


def word(text: str) -> str:
    """As `Units.word`."""
    return shown().word(text)
