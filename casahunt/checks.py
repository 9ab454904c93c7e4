"""Checks at the user's border: one sentence with the key, the value and the allowed range."""

from __future__ import annotations

import difflib
import math
from collections.abc import Iterable
from typing import Any

from .errors import InputError


def number(key: str, value: Any) -> float:
    """`value` as a finite float, or InputError.  Booleans and strings are not numbers."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) and not hasattr(value, "__float__"):
        raise InputError(f"{key} = {value!r}: must be a finite number")
    try:
        result = float(value)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{key} = {value!r}: must be a finite number") from None
    if not math.isfinite(result):
        raise InputError(f"{key} = {value!r}: must be a finite number, not NaN or infinity")
    return result


def require(
    key: str,
    value: Any,
    *,
    above: float | None = None,
    at_least: float | None = None,
    at_most: float | None = None,
    unit: str = "",
) -> float:
    """`value` as a float inside the given range, or InputError naming key, value and range."""
    x = number(key, value)
    named = f" ({unit})" if unit else ""
    if above is not None and not x > above:
        raise InputError(f"{key} = {shown(x)}: must be greater than {shown(above)}{named}")
    if at_least is not None and not x >= at_least:
        raise InputError(f"{key} = {shown(x)}: must be at least {shown(at_least)}{named}")
    if at_most is not None and not x <= at_most:
        raise InputError(f"{key} = {shown(x)}: must be at most {shown(at_most)}{named}")
    return x


def shown(x: float) -> str:
    """A number for a message: short where that is exact, so that no value seems to lie on its own bound."""
    short = f"{x:g}"
    return short if float(short) == x else repr(float(x))


def to_error(x: float, relative_error: float) -> str:
    """A computed number for a person, to the digits that its estimated relative error vouches for (3 to 12)."""
    if not relative_error > 0:
        return f"{x:.12g}"
    return f"{x:.{min(max(math.floor(-math.log10(relative_error)), 3), 12)}g}"


def known(what: str, name: str, allowed: Iterable[str]) -> str:
    """`name` if it is one of `allowed`, or InputError with the nearest spelling."""
    names = list(allowed)
    if name in names:
        return name
    if not isinstance(name, str):
        raise InputError(f"{what} = {name!r}: must be one of {', '.join(names)}")
    # A misspelt key in the right section, or a right key in the wrong one; the shared section name would
    # make every key of a section look alike, so the last parts are compared; so would the dashes of options.
    last = [n.rsplit(".", 1)[-1].lstrip("-") for n in names]
    ends = difflib.get_close_matches(name.rsplit(".", 1)[-1].lstrip("-").lower(), last, n=1, cutoff=0.5)
    near = [n for n, end in zip(names, last, strict=True) if ends and end == ends[0]][:1]
    hint = f"; did you mean {near[0]!r}?" if near else ""
    raise InputError(f"unknown {what} {name!r}{hint} (known: {', '.join(names)})")
