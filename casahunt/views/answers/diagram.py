"""What `casahunt diagram` says of branches of cycles."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

from ...axis_units import label
from ...continuation import FOLD, SYMMETRY_BREAKING, Branch
from ...servo.units import GAIN_UNIT
from .answer import Answer, item, position, short, volts_per


def diagram_answer(branches: Sequence[Branch[Any]], parts: list[str], out: str) -> Answer:
    """What is said of the branches of a servo.

    parts: the line of its parts; out: where they are written, "" where they are not.
    """
    written = [f"written to {out}"] if out and branches else []
    return Answer([*(line for branch in branches for line in _plain(branch, parts)), *written], _details(branches))


def _plain(branch: Branch[Any], parts: list[str]) -> Iterator[str]:
    if not hasattr(branch, "model"):
        yield f"loop: {len(branch.orbits)} cycles along {branch.vary}; {branch.ended}"
        yield from parts
        for special in branch.special:
            if special.kind == FOLD.kind:
                yield item("they turn back at", f"{branch.vary} = {short(special.value)}")
        return
    folds = [special.orbit for special in branch.special if special.kind == FOLD.kind]
    gains = branch.values
    last = max(folds, key=lambda orbit: orbit.gain, default=None)
    if last is not None and last.gain >= gains.max():
        yield f"{branch.model}: the servo can hunt up to gain {volts_per(last.gain)}, and not above it"
        yield item("there", f"amplitude {position(last.amplitude)}, period {short(last.period)} s")
    else:
        yield f"{branch.model}: the servo can hunt; where that ends was not met ({branch.ended})"
    first = branch.orbits[0]
    size = f"amplitude {position(first.amplitude)}, period {short(first.period)} s"
    yield item(f"at {volts_per(first.gain)}", size)
    broken = [short(special.orbit.gain) for special in branch.special if special.kind == SYMMETRY_BREAKING.kind]
    if broken:
        yield item("uneven swings", f"begin or end at gain {', '.join(broken)} {label(GAIN_UNIT)}")
    yield item("computed", f"{len(branch.orbits)} cycles from gain {short(gains.min())} to {volts_per(gains.max())}")


def _details(branches: Sequence[Branch[Any]]) -> Iterator[str]:
    for branch in branches:
        if hasattr(branch, "model"):
            yield f"{branch.model}: {len(branch.orbits)} points; {branch.ended}"
        for special in branch.special:
            yield f"  {special.meaning}"
        for pair in branch.lopsided:
            yield (
                f"  lopsided, one of a pair whose other is its mirror image: {len(pair.orbits)} points from gain "
                f"{pair.values[0]:.8g}; {pair.ended}"
            )
            for special in pair.special:
                yield f"    {special.meaning}"
