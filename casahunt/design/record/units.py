"""Units of time, angle, torque and current, as the header of a measured record or a person states them.

    value [s, rad, N m or A] = factor * value in the file

A unit stands in a header in brackets ("Time (ms)", "theta [deg]"), behind a slash or a colon ("angle/deg"), as the last
word ("pos_deg", "t ms", "time in ms"), or is the whole name ("ms").  What is stated and not known is refused; what is
not stated at all stays open (None): whoever reads it must say what it was taken for.
"""

from __future__ import annotations

import math
import re
from dataclasses import dataclass
from typing import Literal

from ...axis_units import shown
from ...errors import InputError
from ...quantities import unit_of_text

Quantity = Literal["time", "angle", "torque", "current"]

_NAMES: dict[Quantity, dict[str, str]] = {
    "time": {
        "s": "s sec secs second seconds",
        "ms": "ms msec msecs millisecond milliseconds",
        "us": "us usec usecs µs μs microsecond microseconds",
        "ns": "ns nsec nanosecond nanoseconds",
        "min": "min mins minute minutes",
        "h": "h hr hrs hour hours",
        "d": "day days",
    },
    "angle": {
        "rad": "rad rads radian radians",
        "mrad": "mrad mrads milliradian milliradians",
        "urad": "urad µrad μrad microradian microradians",
        "deg": "deg degs degree degrees ° º",
        "arcmin": "arcmin arcmins arcminute arcminutes",
        "arcsec": "arcsec arcsecs arcsecond arcseconds",
        "gon": "gon gons grad grads gradian gradians",
        "rev": "rev revs revolution revolutions turn turns",
    },
    "torque": {"N m": "nm n·m n*m", "mN m": "mnm mn·m mn*m", "N cm": "ncm n·cm n*cm"},
    "current": {"A": "a amp amps ampere amperes", "mA": "ma milliamp milliamps"},
}
"""Unit (quantities.py), and how it is written in headers."""
_OF_A_LINEAR_AXIS: dict[Quantity, dict[str, str]] = {
    "angle": {
        "m": "m metre metres meter meters",
        "mm": "mm millimetre millimetres millimeter millimeters",
        "um": "um µm μm micron microns micrometre micrometres micrometer micrometers",
        "nm": "nm nanometre nanometres nanometer nanometers",
        "in": "in inch inches",
    },
    "torque": {"N": "n newton newtons", "kN": "kn kilonewton kilonewtons"},
}
"""What stands in their place where the servo is a linear axis: lengths, in m, and forces, in N."""
_AMBIGUOUS = {"grad": "is degrees in some languages and gon in others; state which, as {option} deg or {option} gon"}
"""Names that are units of the quantity, and not one alone: what is said of them."""
_COUNTED = frozenset(
    "sample samples count counts cts tick ticks step steps pulse pulses increment increments inc index lsb lsbs bit "
    "bits digit digits encoder".split()
)
"""What is counted: its size is known to whoever built the servo only."""
_OTHER = frozenset("nm µm μm um mm cm m km inch inches mil v mv volt volts a ma amp amps hz khz rpm % percent".split())
"""Units of something else; as the last word of a header they are units, not a part of the name."""
_OPTION: dict[Quantity, str] = {
    "time": "--time-unit", "angle": "--position-unit", "torque": "--torque-constant", "current": "--torque-constant",
}  # fmt: skip
BASE: dict[Quantity, str] = {"time": "s", "angle": "rad", "torque": "N m", "current": "A"}


@dataclass(frozen=True)
class Unit:
    """A unit of time, angle, torque or current.

    Attributes
    ----------
    name : as it is shown.
    factor : s, rad, N m or A in one of it.
    """

    name: str
    factor: float


def _names_of(quantity: Quantity) -> dict[str, str]:
    """The units of a quantity, of the axis that is asked about."""
    return (_OF_A_LINEAR_AXIS if shown().linear else _NAMES).get(quantity, _NAMES[quantity])


def base_of(quantity: Quantity) -> str:
    """The unit in SI of a quantity, of the axis that is asked about."""
    return shown().si.label(BASE[quantity])


def _lookup(quantity: Quantity, text: str) -> Unit | None:
    word = _word(text)
    for name, spellings in _names_of(quantity).items():
        if word in [spelling.casefold() for spelling in spellings.split()]:
            return Unit(name, float(unit_of_text(name)[0]))
    return None


def _one_alone(what: str, quantity: Quantity, text: str) -> Unit | None:
    """As `_lookup`.  Raises InputError: the name stands for two units."""
    if why := _AMBIGUOUS.get(_word(text)):
        raise InputError(f"{what}: {text!r} {why.format(option=_OPTION[quantity])}")
    return _lookup(quantity, text)


def _word(text: str) -> str:
    """A unit as it is compared."""
    return "".join(text.strip(" .").casefold().split())


def _unknown(what: str, quantity: Quantity, text: str) -> InputError:
    base, names = base_of(quantity), ", ".join(_names_of(quantity))
    kind = {"angle": "length", "torque": "force"}.get(quantity, quantity) if shown().linear else quantity
    counted = any(word in _COUNTED for word in re.split(r"\W+|_", text.casefold()))
    why = "is a count, no unit" if counted else f"is no unit of {kind} that is known ({names})"
    noun = "one count" if counted else "one of it"
    return InputError(f"{what}: {text!r} {why}; state how many {base} {noun} is, as {_OPTION[quantity]} NUMBER")


def parsed_unit(quantity: Quantity, text: str, *, what: str = "unit") -> Unit:
    """The unit that a person states: a name, or a number of seconds or radians.

    text: such as "ms", "deg" or "0.00153398". Raises InputError: no finite number > 0, no known name, or that of two.
    """
    found = _one_alone(what, quantity, text)
    if found is not None:
        return found
    try:
        factor = float(text)
    except ValueError:
        raise _unknown(what, quantity, text) from None
    if not (math.isfinite(factor) and factor > 0):
        raise InputError(f"{what}: {text!r} must be a unit's name or a finite number of {base_of(quantity)} above 0")
    return Unit(f"{factor:g} {base_of(quantity)}", factor)


def split_header(cell: str) -> tuple[list[str], str | None]:
    """The words of a column's name, in small letters, and the unit as it is stated; None where none is."""
    text = cell.strip()
    inside = re.search(r"[\[({<]([^\])}>]*)[\])}>]\s*$", text)
    if inside:
        return _words(text[: inside.start()]), inside[1].strip()
    parts = re.fullmatch(r"([^/:]*)[/:](.+)", text)
    if parts and parts[1].strip():
        return _words(parts[1]), parts[2].strip()
    words = _words(text)
    for i, word in enumerate(words):
        alone = len(words) == 1 and (len(word) > 1 or word not in _OTHER)  # a column named a or m is no unit
        unit = word in _COUNTED or word in _OTHER or quantity_of(word) is not None
        if unit and (i > 0 or alone or word in _COUNTED):
            name = words[: i - 1] if i > 1 and words[i - 1] == "in" else words[:i]
            return name, " ".join(words[i:])
    return words, None


def stated_unit(quantity: Quantity, cell: str, *, what: str) -> Unit | None:
    """The unit in a column's header.

    Returns unit; None where the header states none. Raises InputError: a unit is stated, but none of this quantity, or
    two are called so.
    """
    stated = split_header(cell)[1]
    if not stated:
        return None
    named = f"{what}, column {cell.strip()!r}"
    found = _one_alone(named, quantity, stated)
    if found is None:
        raise _unknown(named, quantity, stated)
    return found


def quantity_of(stated: str | None) -> Quantity | None:
    """The quantity that a stated unit measures; None where it is none of these."""
    if stated is not None:
        for quantity in _NAMES:
            if _lookup(quantity, stated):
                return quantity
    return None


def _words(text: str) -> list[str]:
    return [word for word in re.split(r"[\s_\-,;.]+", text.casefold()) if word]
