"""How the page says what was computed: numbers to the digits that their errors vouch for, and the sentences.

    number   {"value", "error", "text"}: error absolute, null where none is estimated; text without the unit
    why      {"why", "evidence"}: in the place of what was not found, and what supports it, where that is known
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...checks import finite_or_none, to_error
from ...errors import NoOrbit
from ..answers.answer import PLAIN_DIGITS

MARGIN_DIGITS = 3
"""Of a ratio, and of numbers in sentences."""
CURVE_DIGITS = 6
"""Of the points of curves: a pixel is 1e-3 of a picture."""
MOST_CURVE_POINTS = 2000


def shown_number(value: float, relative_error: float = math.nan) -> dict[str, Any]:
    """A number with its error."""
    error = abs(value) * relative_error
    return {
        "value": finite_or_none(float(value)), "error": finite_or_none(error),
        "text": to_error(value, relative_error, PLAIN_DIGITS),
    }  # fmt: skip


def seen_number(value: float) -> dict[str, Any]:
    """A number that was read off a motion: it has no estimated error, and few digits."""
    return {"value": finite_or_none(float(value)), "error": None, "text": brief(value)}


def brief(value: float) -> str:
    """A number in a sentence."""
    return f"{value:.{MARGIN_DIGITS}g}"


def refused(why: Exception) -> dict[str, Any]:
    """The sentence of a refusal, its evidence apart from it."""
    if not isinstance(why, NoOrbit):
        return {"why": str(why)}
    return {"why": why.plain} | ({"evidence": why.evidence} if why.evidence else {})


def curve(**columns: Any) -> dict[str, list[float | None]]:
    """The points of a curve, thinned where there are too many; gaps (nan) stay."""
    arrays = {name: np.asarray(column, float) for name, column in columns.items()}
    step = max(1, math.ceil(max(a.size for a in arrays.values()) / MOST_CURVE_POINTS))
    return {name: [_short(x) for x in a[::step].tolist()] for name, a in arrays.items()}


def _short(x: float) -> float | None:
    return float(f"{x:.{CURVE_DIGITS}g}") if math.isfinite(x) else None


def hunts(amplitude: float, period: float, stable: bool | None) -> str:
    """The sentence of a cycle that was found."""
    degrees = math.degrees(amplitude)
    swings = f"{brief(amplitude)} rad ({brief(degrees)}°) to either side, once every {brief(period)} s"
    if stable:
        return f"It hunts: the servo swings by {swings}."
    if stable is None:
        return f"It can hunt: it can swing by {swings}; whether motions come to this swing is not known."
    return f"It may swing unevenly: there is an even swing of {swings}, which motions leave."


def ends_at(what: str, unit: str, border: float, present: float, sense: int = 1) -> str:
    """The sentence of where hunting ends; sense: -1 where less of it ends hunting."""
    size = f"{brief(border)} {unit}".rstrip()
    if present * border <= 0:
        return f"Hunting ends at {what} {size}."
    ratio = border / present
    away = f"{brief(ratio)} times the present one"
    if ratio < 1:
        away = f"the present one is {brief(1 / ratio)} times that"
    return f"Hunting ends {'above' if sense > 0 else 'below'} {what} {size}: {away}."


SAID_ABOVE = {"rests": ": it does not hunt", "unknown": ": no hunting was found"}
"""What is said of a gain above the one at which hunting ends, by the verdict there."""


def ratio_shown(border: float, present: float, relative_error: float, verdict: str) -> dict[str, Any]:
    """The number by which the gain at which hunting ends is above the present one, or that by which it is below."""
    shown = shown_number(border / present, relative_error)
    if border >= present:
        return shown | {"said": f"{shown['text']} times the present gain"}
    above = to_error(present / border, relative_error, PLAIN_DIGITS)
    return shown | {"said": f"the present gain is {above} times that{SAID_ABOVE.get(verdict, '')}"}


def sentence_of(parts: Sequence[str]) -> str:
    """Sentences in a row."""
    return " ".join(part for part in parts if part)
