"""What `casahunt fold` says of the value of a parameter in which hunting ends.

Keys of `stable`, up to where cycles are stable: value, the last one, that of the fold where it is that, or null where
it is not known; ranges [[from, to], ...], with a stable cycle, from the first one that was looked at on, an end that
was not located null; sentence: what that means.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from typing import Any

from ...axis_units import quantity, word
from ...checks import error_text, known_decimals, to_error
from ...continuation import Fold, Vanishing
from ...design.sensitivity import Sensitivities
from ...orbits import Options
from ...servo.parts.table import unit_of
from ...servo.stable_up_to import SET_TO, Ranges
from .answer import Answer, angle, item, known, rhythm, short

MOST_DECIMALS, PLAIN_DECIMALS = 4, 2
"""Of a sensitivity in per cent of the gain, in the details and in a plain line."""
NAMED_FROM = 0.05
"""Per cent of the gain per per cent, below which a parameter is not named in the plain lines."""
WHAT_TO_DO = (
    "choose the gain above that, with a margin (casahunt tune checks it and says what torque it takes), or see what "
    "else ends hunting (casahunt remedies)"
)


def fold_answer(
    title: str, fold: Fold[Any], slopes: Sensitivities, ranges: Ranges, how: Options, to_do: str, below: Sequence[str]
) -> Answer:
    """What is said of a fold.

    title: the first line; ranges: of stable cycles in front of it; how: it was computed; to_do: what to do; below:
    lines of its own.
    """
    vary = fold.parameter
    plain = [
        title,
        item("what to do", to_do) if to_do else "",
        *_there(fold),
        item("it hunts", hunts(fold, ranges)),
        *below,
        f"  one per cent more of        changes that {word(vary)} by",
        *_sensitivities(slopes, PLAIN_DECIMALS, NAMED_FROM),
    ]
    return Answer([line for line in plain if line], _details(fold, slopes, ranges, how))


def _there(fold: Fold[Any]) -> list[str]:
    """How it hunts where that ends."""
    orbit = fold.orbit
    if isinstance(fold, Vanishing):
        return [item("there", "its swings have shrunk to nothing, and it stands ever longer between them")]
    swings, takes = angle(orbit.amplitude, orbit.amplitude_error), rhythm(orbit.period, orbit.period_error)
    return [item("amplitude there", swings), item("period there", takes)]


def value_of(vary: str, value: float, text: Any = short, *error: float) -> str:
    """A value of a parameter, in the units of the axis."""
    return quantity(value, unit_of(vary), text, *error, of=value).rstrip()


def stability_of(fold: Fold[Any], ranges: Ranges) -> dict[str, Any]:
    """The record of the stable cycles in front of a fold."""
    return {
        "value": ranges[-1][1] if ranges and not math.isnan(ranges[-1][1]) else None,
        "ranges": [[None if math.isnan(end) else end for end in each] for each in ranges],
        "sentence": hunts(fold, ranges, to_error, SET_TO),
    }


def hunts(fold: Fold[Any], ranges: Ranges, text: Any = short, *error: float) -> str:
    """Up to where motions end in the cycle that folds."""
    way, vary = "up" if fold.sense > 0 else "down", word(fold.parameter)
    if not ranges or math.isnan(sum(map(sum, ranges))):
        return f"{way} to which {vary} motions end in a cycle is not known: casahunt simulate looks at one"
    (_, first), *others = ranges
    if first == fold.value:
        return f"{way} to that {vary} motions end in a cycle"
    at = f"{way} to {value_of(fold.parameter, first, text, *error)}"
    if others:
        low, high = others[-1]
        end = "its fold" if high == fold.value else value_of(fold.parameter, high, text, *error)
        at += f", and from {value_of(fold.parameter, low, text, *error)} to {end},"
        return f"{at} motions end in that cycle, elsewhere they may leave it, and rest or end in another one"
    at_last = ": casahunt remedies --only gain says where hunting ends" if fold.parameter == "gain" else ""
    return f"{at} motions end in that cycle, from there on they leave it, and may rest or end in another one{at_last}"


def _sensitivities(slopes: Sensitivities, most: int, least: float = 0.0, tol: float = 0.0) -> Iterator[str]:
    """A line for each parameter, the largest first."""
    for name, value in sorted(slopes.elasticities.items(), key=lambda entry: -abs(entry[1])):
        if abs(value) >= least:
            yield f"    {word(name):26s} {sensitivity_text(value, tol, most):>9s} %"


def sensitivity_text(value: float, tol: float, most: int = MOST_DECIMALS) -> str:
    """Per cent of the fold gain per per cent, to the tolerance, four decimals at most.

    value, tol: the elasticity, and the tolerance: it is known to that much and better.
    """
    return f"{value:+.{known_decimals(tol, most)}f}"


def _details(fold: Fold[Any], slopes: Sensitivities, ranges: Ranges, how: Options) -> Iterator[str]:
    orbit = fold.orbit
    value, again = (
        value_of(fold.parameter, each, to_error, fold.value_error) for each in (fold.value, fold.confirmed_value)
    )
    yield item(f"{fold.parameter} there", value)
    yield item("estimated error", f"{error_text(fold.value_error)} (relative, of the {fold.parameter})")
    yield item("amplitude there", known(orbit.amplitude, orbit.amplitude_error))
    yield item("period there", f"{to_error(orbit.period, orbit.period_error)} s")
    yield item("it hunts", hunts(fold, ranges, to_error, SET_TO))
    way = {"ipopt": "optimum (IPOPT)", "newton": "turning point (Newton)"}.get(how.solver, "turning point")
    yield item("on a finer mesh", f"{way}: {again}")
    yield "  one per cent more of, to the tolerance"
    yield from _sensitivities(slopes, MOST_DECIMALS, tol=how.tol)
    yield item("computed in", f"{fold.wall_s:.2f} s")
