"""Quantities with their units, as text: a table of units and their exponents.

    "3 N s/mm"  ->  3000 N s/m        in exact fractions, rounded once: the double that is nearest to it
"""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from fractions import Fraction
from functools import lru_cache
from typing import Any

from .checks import choice_of, quoted
from .errors import InputError

Exponents = tuple[int, ...]
"""Of m, kg, s, rad, V, A."""
_NONE: Exponents = (0, 0, 0, 0, 0, 0)
_PREFIX_POWERS = {"n": -9, "u": -6, "µ": -6, "μ": -6, "m": -3, "c": -2, "": 0, "k": 3, "M": 6}
_BASES: dict[str, tuple[Any, Exponents]] = {
    "m": (1, (1, 0, 0, 0, 0, 0)), "g": (Fraction(1, 1000), (0, 1, 0, 0, 0, 0)), "s": (1, (0, 0, 1, 0, 0, 0)),
    "rad": (1, (0, 0, 0, 1, 0, 0)), "V": (1, (0, 0, 0, 0, 1, 0)), "A": (1, (0, 0, 0, 0, 0, 1)),
    "N": (1, (1, 1, -2, 0, 0, 0)), "Nm": (1, (2, 1, -2, 0, 0, 0)),
}  # fmt: skip
"""What takes a prefix: its size in SI, and its exponents."""
_OTHERS: dict[str, dict[str, Any]] = {
    "m": {"in": "0.0254", "ft": "0.3048"},
    "s": {"min": "60", "h": "3600", "d": "86400"},
    "kg": {"lb": "0.45359237", "oz": "0.028349523125", "t": "1000"},
    "N": {"lbf": "4.4482216152605", "kgf": "9.80665"},
    "rad": {
        "deg": math.pi / 180, "°": math.pi / 180, "arcmin": math.pi / 10800, "arcsec": math.pi / 648000,
        "gon": math.pi / 200, "rev": 2 * math.pi,
    },
    "rad/s": {"rpm": math.pi / 30, "Hz": 2 * math.pi, "kHz": 2000 * math.pi},
}  # fmt: skip
"""What takes none, by the SI unit of the same kind: its size in that (NIST SP 811, appendix B)."""
COUNTS = "counts"
"""The unit of a length or an angle that is one count of the encoder."""
KNOWN = "um mm cm m in ft urad mrad rad deg rev rpm Hz kHz ms s min mN N kN lbf Nm g kg lb mV V mA A".split()
"""Those that are told to who asks for another one."""
_VALUE = re.compile(
    r"\s*+([-+]?(?:\d++\.?+\d*+|\.\d++)(?:[eE][-+]?\d++)?)\s*+((?![eE](?:[-+\d]|$))(?:[A-Za-zµμ°]|1\s*/).*)"
)
_TOKEN = re.compile(r"\s*(?:([A-Za-zµμ]+|°)(?:\^|\*\*)?(-?[1-9](?!\d)|[²³])?|([/()*·])|1(?=\s*/))")


@lru_cache(maxsize=256)
def unit_of_text(text: str, counts: str = "") -> tuple[Any, Exponents]:
    """What one of a unit is in SI, an exact fraction where there is no pi in it, and its exponents.

    text: such as "N s/mm" or "N/(mm s)"; counts: the size of a count, such as "1 um"; "" where it is not known.
    Raises InputError: no unit, or an unknown one; says the nearest.
    """
    factor, exponents, at, below, inside = Fraction(1), _NONE, 0, False, False
    while at < len(text.rstrip()):
        token = _TOKEN.match(text, at)
        name, power, sign = token.groups() if token else (None, None, None)
        if token is None or (sign == "(") > (not inside) or (sign == ")") > inside or (sign == "/" and below):
            raise InputError(f"unit {quoted(text)}: must be written as N s/mm or N/(mm s) are")
        at, below = token.end(), below or sign == "/"
        inside = sign == "(" or (inside and sign != ")")
        if name:
            n = (-1 if below else 1) * int({"²": 2, "³": 3}.get(power or "", power or 1))
            one, of = _named(name) if name != COUNTS or not counts else size_of(COUNTS, counts)
            factor, exponents = factor * one**n, tuple(a + n * b for a, b in zip(exponents, of, strict=True))
    if inside:
        raise InputError(f"unit {quoted(text)}: must end in a bracket")
    return factor, exponents


def size_of(key: str, text: Any) -> tuple[Any, Exponents]:
    """As `unit_of_text`, of a number of a unit.  Raises InputError: it is none, not above zero, or an unknown unit."""
    number, unit = with_its_unit(text) or ("0", "1/s")
    if not 0 < float(number) < math.inf:
        raise InputError(f"{key} = {quoted(text)}: must be a number above 0 with its unit, such as '0.1 um'")
    factor, exponents = unit_of_text(unit)
    return _exactly(number) * Fraction(factor), exponents


def _exactly(number: str) -> Fraction:
    """A decimal as a fraction; 0 where it is nothing in double arithmetic, of which a fraction may have any size."""
    return Fraction(number) if float(number) else Fraction(0)


def _named(name: str) -> tuple[Any, Exponents]:
    """Size and exponents of one name, with its prefix."""
    for of, others in _OTHERS.items():
        if name in others:
            return Fraction(others[name]) if isinstance(others[name], str) else others[name], unit_of_text(of)[1]
    for prefix, power in _PREFIX_POWERS.items():
        base = name.removeprefix(prefix)
        if name.startswith(prefix) and base in _BASES and len(name) == len(prefix) + len(base):
            return _BASES[base][0] * Fraction(10) ** power, _BASES[base][1]
    if name == COUNTS:
        raise InputError("the size of a count is not known; [units] says it, such as counts = '0.1 um'")
    choice_of("unit", name, KNOWN)
    raise AssertionError(name)


def with_its_unit(text: Any) -> tuple[str, str] | None:
    """The number and the unit of a text; None where it is not a text of both."""
    found = _VALUE.fullmatch(text) if isinstance(text, str) else None
    return found and (found[1], found[2].strip())


def in_si(key: str, text: str, wanted: Sequence[str], counts: str = "", why: str = "") -> float:
    """A number with its unit, in SI.

    key: what the user calls it; text: as of `with_its_unit`; wanted: units of the kinds that it may have, in SI;
    counts: as of `unit_of_text`; why: the end of the refusal of another kind.
    Raises InputError: an unknown unit, or one of another kind.
    """
    number, unit = with_its_unit(text) or ("", "")
    try:
        factor, exponents = unit_of_text(unit, counts)
    except InputError as error:
        raise InputError(f"{key} = {quoted(text)}: {error}") from None
    if not any(wanted):
        raise InputError(f"{key} = {quoted(text)}: must be a number without a unit")
    kinds = [each for each in wanted if each]
    if exponents not in [unit_of_text(each)[1] for each in kinds]:
        raise InputError(f"{key} = {quoted(text)}: must be in {' or '.join(kinds)}, or in a multiple of that{why}")
    if not math.isfinite(float(number)):
        raise InputError(f"{key} = {quoted(text)}: must be a finite number")
    return float(_exactly(number) * Fraction(factor))


def number_in(x: float, unit: str, counts: str = "") -> float:
    """A number in SI, as its shortest decimal says it, in another unit, rounded once: 5e-6 m are 5 um."""
    return float(Fraction(repr(x)) / Fraction(unit_of_text(unit, counts)[0])) if math.isfinite(x) else x
