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

Quantity = Literal["time", "angle", "torque", "current"]

_NAMES: dict[Quantity, dict[str, tuple[float, str]]] = {
    "time": {
        "s": (1.0, "s sec secs second seconds"),
        "ms": (1e-3, "ms msec msecs millisecond milliseconds"),
        "us": (1e-6, "us usec usecs µs μs microsecond microseconds"),
        "ns": (1e-9, "ns nsec nanosecond nanoseconds"),
        "min": (60.0, "min mins minute minutes"),
        "h": (3600.0, "h hr hrs hour hours"),
        "d": (86400.0, "day days"),
    },
    "angle": {
        "rad": (1.0, "rad rads radian radians"),
        "mrad": (1e-3, "mrad mrads milliradian milliradians"),
        "urad": (1e-6, "urad µrad μrad microradian microradians"),
        "deg": (math.pi / 180, "deg degs degree degrees ° º"),
        "arcmin": (math.pi / 10800, "arcmin arcmins arcminute arcminutes"),
        "arcsec": (math.pi / 648000, "arcsec arcsecs arcsecond arcseconds"),
        "gon": (math.pi / 200, "gon gons grad grads gradian gradians"),
        "rev": (2 * math.pi, "rev revs revolution revolutions turn turns"),
    },
    "torque": {"N m": (1.0, "nm n·m n*m"), "mN m": (1e-3, "mnm mn·m mn*m"), "N cm": (1e-2, "ncm n·cm n*cm")},
    "current": {"A": (1.0, "a amp amps ampere amperes"), "mA": (1e-3, "ma milliamp milliamps")},
}
"""Unit, its factor to s, rad, N m or A, and how it is written."""
_OF_A_LINEAR_AXIS: dict[Quantity, dict[str, tuple[float, str]]] = {
    "angle": {
        "m": (1.0, "m metre metres meter meters"),
        "mm": (1e-3, "mm millimetre millimetres millimeter millimeters"),
        "um": (1e-6, "um µm μm micron microns micrometre micrometres micrometer micrometers"),
        "nm": (1e-9, "nm nanometre nanometres nanometer nanometers"),
        "in": (0.0254, "in inch inches"),
    },
    "torque": {"N": (1.0, "n newton newtons"), "kN": (1e3, "kn kilonewton kilonewtons")},
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


def _names_of(quantity: Quantity) -> dict[str, tuple[float, str]]:
    """The units of a quantity, of the axis that is asked about."""
    return (_OF_A_LINEAR_AXIS if shown().linear else _NAMES).get(quantity, _NAMES[quantity])


def base_of(quantity: Quantity) -> str:
    """The unit in SI of a quantity, of the axis that is asked about."""
    return shown().si.label(BASE[quantity])


def _lookup(quantity: Quantity, text: str) -> Unit | None:
    word = _word(text)
    for name, (factor, spellings) in _names_of(quantity).items():
        if word in [spelling.casefold() for spelling in spellings.split()]:
            return Unit(name, factor)
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
