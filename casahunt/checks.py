"""Checks at the user's border: one sentence with the key, the value and the allowed range.

    0 < SMALLEST <= servo number, gain, time <= LARGEST

Wide enough for every servo in SI units; narrow enough that no product of the few numbers that a formula multiplies
leaves double arithmetic, 2e-308 to 2e308, from where on infinities and zeros would stand for numbers.  Gains, times and
positions that a computation comes upon, such as the gain J/(cm tau^2), may lie in the fourth power of that range.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterable, Mapping
from typing import Any

from .errors import InputError

SMALLEST, LARGEST = 1e-12, 1e12
"""The range of all numbers of a servo, and of gains, times and positions of the command line, in SI units."""
COMPUTED = 4
"""Power of that range in which gains, times and positions may lie that a computation comes upon."""
_QUOTED = 60
"""Characters of a wrong value that a message repeats."""
_MISSPELT, _BEGUN = 3, 3
"""A misspelling has one wrong letter in so many, or one; letters of the beginning of a name that stand for it."""

_SAME = {"breakaway": "static", "stiction": "static", "kinetic": "coulomb", "dynamic": "coulomb", "sliding": "coulomb"}
"""Names that data sheets give to what has another one here."""


def number(key: str, value: Any) -> float:
    """A finite number.

    value: what was given; booleans and strings are not numbers. Raises InputError: it is none.
    """
    truth = type(value).__name__ in ("bool", "bool_")  # of Python and of numpy
    several = getattr(value, "ndim", 0) != 0  # an array of one number is none
    if truth or several or not isinstance(value, (int, float)) and not hasattr(value, "__float__"):
        bare = ", without quotes and unit" if isinstance(value, str) and value[:1].isdigit() else ""
        raise InputError(f"{key} = {quoted(value)}: must be a finite number{bare}")
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{key} = {quoted(value)}: must be a finite number") from None
    if not math.isfinite(result):
        raise InputError(f"{key} = {value!r}: must be a finite number, not NaN or infinity")
    return result


def of_kind(key: str, value: Any, kind: type[Any], hint: str = "") -> Any:
    """A value that must be an instance of a class.

    key, value: what the user calls it, and what was given; hint: how such a value is made, for the message.
    Raises InputError: it is no such instance; says what it is.
    """
    if isinstance(value, kind):
        return value
    article = "an" if kind.__name__[0] in "AEIOU" else "a"
    wanted = f"must be {article} {kind.__name__}{hint and ', '}{hint}"
    what = f"the class {value.__name__} itself" if isinstance(value, type) else f"of type {type(value).__name__}"
    raise InputError(f"{key} = {quoted(value)} ({what}): {wanted}")


def floated(record: Any) -> None:
    """Make the numbers of a frozen record, checked before, Python's own: a float32 would keep seven digits of all."""
    for name, value in vars(record).items():
        if type(value) is not float and hasattr(value, "__float__"):
            object.__setattr__(record, name, float(value))


def given_once(start: Mapping[str, float] | None, keywords: Mapping[str, float]) -> dict[str, float]:
    """Values by name, some of them in a mapping and some as keywords.

    start, keywords: the mapping, or None; the keywords. Raises InputError: a name stands in both.
    """
    if start is not None and not isinstance(start, Mapping):
        raise InputError(f"start = {quoted(start)}: must be a mapping from names to numbers")
    twice = [name for name in keywords if name in (start or {})]
    if twice:
        raise InputError(f"{', '.join(twice)}: given both in start= and as a keyword; leave out one of them")
    return {**(start or {}), **keywords}


def require(
    key: str,
    value: Any,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
    unit: str = "",
) -> float:
    """A number inside a range.

    above, at_least, at_most: bounds; None: no such bound.
    Raises InputError: it is none, or out of the range; names key, value and range.
    """
    x = number(key, value)
    named = f" ({unit})" if unit else ""
    if above is not None and not x > above:
        raise InputError(f"{key} = {shown(x)}: must be greater than {shown(above)}{named}")
    if at_least is not None and not x >= at_least:
        raise InputError(f"{key} = {shown(x)}: must be at least {shown(at_least)}{named}")
    if at_most is not None and not x <= at_most:
        raise InputError(f"{key} = {shown(x)}: must be at most {shown(at_most)}{named}")
    return x


def whole_number(key: str, value: Any, *, at_least: int) -> int:
    """A whole number.

    key, value: what the user calls it, and what was given. Raises InputError: it is none, or smaller.
    """
    x = number(key, value)
    if x != int(x) or x < at_least:
        raise InputError(f"{key} = {quoted(value)}: must be a whole number, at least {at_least}")
    return int(x)


def sensible(key: str, value: Any, *, zero: bool = False, power: int = 1, unit: str = "") -> float:
    """A number from SMALLEST to LARGEST.

    zero: 0 is allowed too; power: widens the range to that power of its ends, for what a computation comes upon.
    Raises InputError: it is none, or out of the range.
    """
    low, high = SMALLEST**power, LARGEST**power
    x = require(key, value, at_least=0, unit=unit) if zero else require(key, value, above=0, unit=unit)
    if not low <= x <= high and not (zero and x == 0):
        raise _beyond(key, x, f"{'0 or ' if zero else ''}between {low:g} and {high:g}")
    return x


def moderate(key: str, value: Any, *, power: int = 1) -> float:
    """A number of any sign, of a size up to LARGEST.

    power: widens the range to that power of its end. Raises InputError: it is none, or larger.
    """
    x, high = number(key, value), LARGEST**power
    if not abs(x) <= high:
        raise _beyond(key, x, f"between {-high:g} and {high:g}")
    return x


def to_and_back(key: str, here: float, to: Any, back: Any | None, *, endless: bool = False) -> tuple[float, float]:
    """The values between which a parameter runs that stands between them: where it goes, and where it ends if it turns.

    here, back: where it starts; None is that; endless: `to` may be infinite.  Raises InputError: both lie on one side
    of it, or `to` is no way off.
    """
    to = to if endless and to in (math.inf, -math.inf) else number("to", to)
    back = here if back is None else number("back", back)
    if to == here or (to - here) * (back - here) > 0:
        raise InputError(f"{key} is {here:.6g} at the start: it cannot go to {to:.6g} and come back to {back:.6g}")
    return to, back


def _beyond(key: str, x: float, allowed: str) -> InputError:
    why = "beyond that, products of such numbers leave the range of double arithmetic"
    return InputError(f"{key} = {shown(x)}: must be {allowed} in SI units ({why})")


def quoted(value: Any) -> str:
    """A wrong value for a message, as Python writes it, but short."""
    try:
        text = repr(value)
    except (ValueError, RecursionError):  # an integer of thousands of digits, or what is nested as deeply
        return "a value too long to be shown"
    return shortened(text)


def typed(key: str, text: Any) -> float:
    """The number of a text as a person types it: of the digits 0 to 9, and nothing between them but a point.

    key: what the user calls it. Raises InputError: it is none.
    """
    try:
        if "_" in str(text) or not str(text).isascii():  # Python's own, which would be other numbers elsewhere
            raise ValueError
        return float(text)
    except ValueError:
        raise InputError(f"{key} = {quoted(text)}: must be a finite number{with_point(text)}") from None


def with_point(text: Any) -> str:
    """What a refused number should read, as the end of a message; "" where a comma is not what is wrong with it."""
    comma = re.fullmatch(r"\s*([-+]?\d+),(\d+)\s*", str(text))
    return f"; decimals take a point, {comma[1]}.{comma[2]}" if comma else ""


def shortened(text: str) -> str:
    """A text for a message, the middle left out where it is long."""
    return text if len(text) <= _QUOTED else f"{text[: _QUOTED - 25]}...{text[-20:]}"


def shown(x: float) -> str:
    """A number for a message: short where that is exact, so that no value seems to lie on its own bound."""
    short = f"{x:g}"
    return short if float(short) == x else repr(float(x))


def to_error(x: float, relative_error: float, most: int = 12) -> str:
    """A computed number for a person, to the digits that its estimated error vouches for.

    The unit of the last digit is the largest power of ten up to twice the error: rounding adds no more than the error.

    relative_error: its estimated relative error; not > 0: unknown; most: digits, at most; at least one is given.
    """
    return f"{x:.{known_digits(x, relative_error, most)}g}"


def to_error_beside(x: float, relative_error: float, other: float, least: int) -> str:
    """A computed number for a person beside another, in the fewest digits that put it on the right side of that.

    x, relative_error: as of `to_error`; other: the number beside it; least: digits, at least, that x is given.
    """
    texts = [to_error(x, relative_error, digits) for digits in range(least, 13)]
    return next((text for text in texts if (float(text) < other) == (x < other) and float(text) != other), texts[-1])


def known_digits(x: float, relative_error: float, most: int = 12) -> int:
    """How many digits of a computed number its estimated error vouches for; of `to_error`.

    x, relative_error, most: as of `to_error`. Returns 1 to `most`.
    """
    if not relative_error > 0 or x == 0:
        return most
    error = 2 * relative_error * abs(x)
    digits = math.floor(math.log10(abs(x))) - math.floor(math.log10(error)) + 1
    return min(max(digits, 1), most)


def known_decimals(error: float, most: int) -> int:
    """How many decimals an absolute error vouches for: for numbers below each other.

    error, most: the error, not > 0: unknown; and decimals at most. Returns 0 to `most`.
    """
    return min(most, max(0, -math.floor(math.log10(2 * error)))) if error > 0 else most


def to_absolute_error(x: float, error: float, most: int = 12) -> str:
    """As `to_error`, for an error in the unit of the number; "0" where the error is as large as the number.

    x, error: the number, and its estimated error; not > 0: unknown.
    """
    return "0" if abs(x) <= error else to_error(x, error / abs(x) if x else 0.0, most)


def error_text(error: float) -> str:
    """An estimated error for a person: two digits, or "unknown" where there is no estimate (NaN, infinity)."""
    return f"{error:.1e}" if math.isfinite(error) else "unknown"


def finite_or_none(value: float) -> float | None:
    """A number for JSON, which has no NaN and no infinity: None stands for them, and is written null."""
    return float(value) if math.isfinite(value) else None


def choice_of(what: str, name: str, allowed: Iterable[str]) -> str:
    """A name that must be one of several.

    Returns `name`. Raises InputError: it is none of them; says the nearest spelling.
    """
    names = list(allowed)
    if name in names:
        return name
    if not isinstance(name, str):
        raise InputError(f"{what} = {name!r}: must be one of {', '.join(names)}")
    given, *last = (n.rsplit(".", 1)[-1].lstrip("-").lower() for n in (name, *names))  # a section makes all alike
    given = _SAME.get(given, given)
    far, near = min(((_misspelt(given, end), n) for n, end in zip(names, last, strict=True)), default=(math.inf, ""))
    hint = f"; did you mean {near!r}?" if math.isfinite(far) else ""
    section = name.partition(".")[0] + "."
    beside = [n for n in names if n.startswith(section)] if "." in name else []
    known = ", ".join(repr(n) if "," in n else n for n in beside or names)
    raise InputError(f"unknown {what} {name!r}{hint} (known: {known})")


def _misspelt(given: str, name: str) -> float:
    """Letters of `name` that are wrong in `given`; inf where it is another word, and no beginning of it either."""
    if min(len(given), len(name)) >= _BEGUN and (name.startswith(given) or given.startswith(name)):
        return abs(len(given) - len(name))
    wrong, longer = _wrong_letters(given, name), max(len(given), len(name), 1)
    return wrong if wrong <= max(longer > 1, longer // _MISSPELT) else math.inf


def _wrong_letters(a: str, b: str) -> int:
    """Fewest letters left out, added, replaced, or exchanged with their neighbour, that make b of a."""
    before, row = [0] * (len(b) + 1), list(range(len(b) + 1))
    for i, x in enumerate(a, 1):
        two_before, before, row = before, row, [i]
        for j, y in enumerate(b, 1):
            exchanged = two_before[j - 2] + 1 if a[i - 2 : i] == b[j - 2 : j][::-1] and min(i, j) > 1 else len(a + b)
            row.append(min(before[j] + 1, row[-1] + 1, before[j - 1] + (x != y), exchanged))
    return row[-1]
