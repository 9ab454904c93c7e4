"""What `casahunt fold` says of the largest gain at which the servo can hunt."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from ...axis_units import word
from ...checks import error_text, known_decimals, to_error
from ...continuation import Fold
from ...design.sensitivity import Sensitivities
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
    value, again: the parameter at the fold, and by the optimisation problem, in all digits and with the unit.
    """
    orbit, vary = fold.orbit, fold.parameter
    plain = [
        title,
        item("what to do", WHAT_TO_DO) if stable is not None else "",
        item("amplitude there", angle(orbit.amplitude, orbit.amplitude_error)),
        item("period there", rhythm(orbit.period, orbit.period_error)),
        *([item("it hunts", _hunts(stable))] if stable is not None else []),
        *below,
        f"  one per cent more of        changes that {vary} by",
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
    way = "turning point of the equations (Newton)" if solver == "newton" else "optimisation problem (IPOPT)"
    yield item("computed twice", f"as {way}: {again}")
    yield "  one per cent more of, to the tolerance"
    yield from _sensitivities(slopes, MOST_DECIMALS, tol=tol)
    yield item("computed in", f"{fold.wall_s:.2f} s")
