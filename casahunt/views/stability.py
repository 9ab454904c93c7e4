"""Up to which gain a stable cycle exists, beside the largest gain of any cycle: a record for JSON, and its sentence.

Keys of the record: gain [V/rad], the largest one with a stable symmetric cycle; ranges [[low, high], ...] [V/rad], with
a stable symmetric cycle; beyond: "fold" (the gain is that of the fold), "lopsided" (a pair of stable lopsided cycles
branches off there), "none" (no stable cycle does) or "unknown"; seen [V/rad], up to which cycles were looked at;
largest_log10_half_multiplier, of a cycle above `gain`, or null; sentence: what that means, or why it is not known.
"""

from __future__ import annotations

from typing import Any

from ..checks import to_error
from ..errors import NoOrbit
from ..orbits import Options
from ..servo.problem import HuntingFold
from ..servo.stable_range import StableRange, stable_range

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
