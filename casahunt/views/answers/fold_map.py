"""What `casahunt fold-map` says: where hunting ends, over two parameters."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ...checks import to_error
from ...design.fold_map import FoldMap
from .answer import Answer, called, item, short


def fold_map_answer(found: FoldMap) -> Answer:
    """What is said of a map of fold gains."""
    return Answer(_plain(found), _details(found))


def _plain(found: FoldMap) -> Iterator[str]:
    (m, n), (q, r) = found.gains.shape, found.values
    extremes = _extremes(found)
    ends = " and ".join(short(float(found.gains[place]), found.tolerance) for place, _ in extremes)
    head = f"hunting ends between gain {ends} V/rad" if extremes else "no gain was found at which hunting ends"
    yield f"{called(found.servo, found.model)}: {head}, over {m} x {n} values of {found.names[0]} and {found.names[1]}"
    for (i, j), text in extremes:
        yield item(text, f"at {found.names[0]} = {q[i]:.6g}, {found.names[1]} = {r[j]:.6g}")
    missing = list(found.failures.values())
    for sentence in dict.fromkeys(missing):
        yield f"  {missing.count(sentence)} without a gain: {sentence}"
    if (found.gains == 0).any():
        yield f"  {int((found.gains == 0).sum())} of the servos hunt at no gain"


def _details(found: FoldMap) -> Iterator[str]:
    for place, text in _extremes(found):
        yield item(text, f"{to_error(float(found.gains[place]), found.tolerance, most=8)} V/rad")
    yield f"  relative error of every gain below {found.tolerance:g}; {found.wall_s:.1f} s"


def _extremes(found: FoldMap) -> list[tuple[tuple[int, int], str]]:
    """Places of the smallest and the largest fold gain."""
    gains = np.where(found.gains > 0, found.gains, np.nan)
    if not np.isfinite(gains).any():
        return []
    low, high = (np.unravel_index(int(pick(gains)), gains.shape) for pick in (np.nanargmin, np.nanargmax))
    return [((int(low[0]), int(low[1])), "smallest"), ((int(high[0]), int(high[1])), "largest")]
