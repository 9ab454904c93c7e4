"""What `casahunt fold` says of the largest gain at which the servo can hunt.

Up to which gain a stable cycle exists, beside the largest gain of any cycle: a record for JSON, and its sentence.

Keys of the record: gain [V/rad], the largest one with a stable symmetric cycle; ranges [[low, high], ...] [V/rad], with
a stable symmetric cycle; beyond: "fold" (the gain is that of the fold), "lopsided" (a pair of stable lopsided cycles
branches off there), "none" (no stable cycle does) or "unknown"; seen [V/rad], up to which cycles were looked at;
largest_log10_half_multiplier, of a cycle above `gain`, or null; sentence: what that means, or why it is not known.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ...axis_units import word
from ...checks import error_text, known_decimals, to_error
from ...continuation import Fold
from ...design.sensitivity import Sensitivities
from ...errors import NoOrbit
from ...orbits import Options
from ...servo.problem import HuntingFold
from ...servo.stable_range import StableRange, stable_range
from .answer import Answer, angle, item, known, rhythm, volts_per

MOST_DECIMALS, PLAIN_DECIMALS = 4, 2
"""Of a sensitivity in per cent of the gain, in the details and in a plain line."""
NAMED_FROM = 0.05
"""Per cent of the gain per per cent, below which a parameter is not named in the plain lines."""
WHAT_TO_DO = (
    "choose the gain above that, with a margin (casahunt tune checks it and says what torque it takes), or see what "
    "else ends hunting (casahunt remedies)"
)
ABOVE_THE_STABLE = {
    "lopsided": "from there on swings that reach farther to one side may take its place",
    "none": "from there on motions leave their cycle, and may swing for long before they rest",
    "unknown": "from there on it is not known",
}
"""What is said of gains between the stable cycle and the fold."""


def fold_answer(
    title: str, fold: Fold[Any], slopes: Sensitivities, *, below: Sequence[str], stable: Mapping[str, Any] | None,
    value: str, again: str, solver: str, tol: float,
) -> Answer:  # fmt: skip
    """What is said of a fold.

    title: the first line; below: lines of its own; stable: the record of `stability_of`, None for a loop of parts;
    value, again: the parameter at the fold, and as it was confirmed, in all digits and with the unit.
    """
    orbit, vary = fold.orbit, fold.parameter
    plain = [
        title,
        item("what to do", WHAT_TO_DO) if stable is not None else "",
        item("amplitude there", angle(orbit.amplitude, orbit.amplitude_error)),
        item("period there", rhythm(orbit.period, orbit.period_error)),
        *([item("it hunts", _hunts(stable))] if stable is not None else []),
        *below,
        f"  one per cent more of        changes that {word(vary)} by",
        *_sensitivities(slopes, PLAIN_DECIMALS, NAMED_FROM),
    ]
    return Answer([line for line in plain if line], _details(fold, slopes, stable, value, again, solver, tol))


def _hunts(stable: Mapping[str, Any]) -> str:
    """Up to which gain a motion ends in a cycle."""
    if stable["gain"] is None:
        return "up to which gain motions end in a cycle is not known"
    if stable["beyond"] == "fold":
        (_, first), *others = stable["ranges"]
        if not others:
            return "up to that gain motions end in a cycle"
        between = f"from there to {volts_per(others[-1][0])} swings that reach farther to one side may take its place"
        return f"up to {volts_per(first)} motions end in a cycle; {between}"
    return f"up to {volts_per(stable['gain'])} motions end in a cycle; {ABOVE_THE_STABLE[stable['beyond']]}"


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


def _details(
    fold: Fold[Any], slopes: Sensitivities, stable: Mapping[str, Any] | None, value: str, again: str, solver: str,
    tol: float,
) -> Iterator[str]:  # fmt: skip
    orbit = fold.orbit
    yield item(f"{fold.parameter} there", value)
    yield item("estimated error", f"{error_text(fold.value_error)} (relative, of the {fold.parameter})")
    yield item("amplitude there", known(orbit.amplitude, orbit.amplitude_error))
    yield item("period there", f"{to_error(orbit.period, orbit.period_error)} s")
    if stable is not None:
        yield item("a stable cycle", stable["sentence"])
    way = {"ipopt": "optimum (IPOPT)", "newton": "turning point (Newton)"}.get(solver, "turning point")
    yield item("on a finer mesh", f"{way}: {again}")
    yield "  one per cent more of, to the tolerance"
    yield from _sensitivities(slopes, MOST_DECIMALS, tol=tol)
    yield item("computed in", f"{fold.wall_s:.2f} s")


UP_TO_THE_FOLD = {
    "lopsided": "there it hands its stability to a pair of lopsided ones, which were not followed",
    "none": "above, motions leave it{grows}, and no stable lopsided one branches off",
    "unknown": "above, motions leave it{grows}; whether lopsided ones are stable is not known",
}
"""What is said of the gains between the stable cycle and the fold."""
UNSEEN: dict[str, Any] = {
    "gain": None, "ranges": [], "beyond": "unknown", "seen": None, "largest_log10_half_multiplier": None,
}  # fmt: skip
"""The record where nothing is known."""


def stability_of(fold: HuntingFold, options: Options) -> dict[str, Any]:
    """The record of the stable cycles below a fold.

    fold, options: the fold, and the tolerance of the gains. Returns keys as in the docstring of the module.
    """
    try:
        found = stable_range(fold, options=options)
    except NoOrbit as error:
        return {**UNSEEN, "sentence": f"up to which gain is not known: {error}"}
    return {**found.to_dict(), "sentence": _sentence(found, options.tol)}


def _sentence(found: StableRange, tol: float) -> str:
    """What the engineer has to know of them."""
    ranges = [[to_error(gain, tol) for gain in pair] for pair in found.ranges]
    if found.beyond == "fold":
        (_, first), *others = ranges
        below = "".join(f", from {low} to {high}" for low, high in others[:-1])
        if not others:
            return "up to that gain"
        top = f"from {others[-1][0]} V/rad to that gain"
        return f"up to {first}{below} and {top}; in between lopsided ones may be stable"
    grows = f" (half multipliers to {-(10**found.largest):.0e})" if found.largest > 1 else ""
    return (
        f"up to gain {ranges[-1][1]} V/rad; {UP_TO_THE_FOLD[found.beyond].format(grows=grows)}. Keep above "
        f"{to_error(found.fold.gain, tol)} V/rad all the same: there no cycle is left, while below a motion may swing "
        "for long before it rests"
    )
