"""Turns of a motion and the swings between them: whether they repeat in a pattern, or become ever smaller.

Symbols: m turns.
"""

from __future__ import annotations

from functools import lru_cache

import numpy as np

Array = np.ndarray

DECADE, LEAST_SWINGS = 10.0, 5
"""The way along which swings shrink geometrically, and how many they are at least."""
PATTERN, REPEATS = 8, 1e-6
"""Turns of a pattern at most; how well it repeats."""
RATIO_KNOWN = 0.02
"""Changes shrink geometrically where their ratio r is known to so much of 1 - r."""
GROWS_BY = 0.05
"""Part by which the least and the largest swing of a motion that goes on growing are larger than those before."""


@lru_cache(maxsize=PATTERN + 1)
def _compared(most: int) -> tuple[Array, Array, Array, Array, list[tuple[int, float]]]:
    """Of patterns of up to so many turns, plain and mirrored: the places, from the end, of the turns of their last
    three, and of those that they are compared with; the signs of these, and where each one begins; what each one is."""
    kinds = [(n, mirror) for n in range(1, most + 1) for mirror in (-1.0, 1.0)]
    at = np.concatenate([-1 - np.arange(3 * n) for n, _ in kinds])
    lengths = np.array([n for n, _ in kinds for _ in range(3)])
    back = np.repeat(lengths, lengths)
    signs = np.repeat([mirror for _, mirror in kinds for _ in range(3)], lengths)
    return at, at - back, signs, np.concatenate([[0], np.cumsum(lengths)[:-1]]), kinds


def may_settle(turns: Array) -> list[tuple[int, float]]:
    """Patterns, turns and mirror, in which turns (m,) may repeat, or change by ever less: none other does."""
    most = min(PATTERN, (turns.size - 1) // 4)
    if not most:
        return []
    at, before, signs, begins, kinds = _compared(most)
    moved = np.maximum.reduceat(np.abs(turns[at] - signs * turns[before]), begins).reshape(-1, 3)
    last, earlier, first = moved.T
    repeats = np.maximum(last, earlier) <= 2 * REPEATS * np.abs(turns[-4 * most :]).max()
    with np.errstate(divide="ignore", invalid="ignore"):
        r, r_before = last / earlier, earlier / first
        shrinks = (last > 0) & (r < 1) & (r_before < 1) & (np.abs(r - r_before) <= RATIO_KNOWN * (1 - r))
    return [kinds[k] for k in np.flatnonzero(repeats | shrinks)]


def settles(turns: list[float], n: int, mirror: float, rest: float) -> bool:
    """Whether turns repeat, n by n, or change by ever less, geometrically, towards some as large as they are.

    In plain numbers: arrays of so few cost ten times as much.
    """
    last, *before = ([mirror**k * t for t in turns[len(turns) - (k + 1) * n : len(turns) - k * n]] for k in range(4))
    changes, moved = [a - b for a, b in zip(last, before[0], strict=True)], list[float]()
    for x, y in zip((last, *before), before, strict=False):
        moved.append(max([abs(a - b) for a, b in zip(x, y, strict=True)]))
        if len(moved) == 2 and max(moved) <= REPEATS * width(last, mirror):
            return True
        if len(moved) > 1 and not 0 < moved[-2] < moved[-1]:
            return False
    r, r_before = moved[0] / moved[1], moved[1] / moved[2]
    if abs(r - r_before) > RATIO_KNOWN * (1 - r):
        return False
    left = [change * r / (1 - r) for change in changes]
    size = width([a + b for a, b in zip(last, left, strict=True)], mirror)
    return max(map(abs, left)) <= rest * size


def width(turns: list[float], mirror: float) -> float:
    """Of turns, and of their mirror images where these follow."""
    both = [*turns, *(mirror * t for t in turns)]
    return max(both) - min(both)


def shrinks(swings: Array) -> bool:
    """Whether swings went down their last decade geometrically, towards nothing: towards anything that is left they
    would do so ever more slowly.  Of a lopsided motion every second one is compared."""
    larger = np.flatnonzero(swings >= DECADE * swings[-1])
    if not larger.size or swings.size < LEAST_SWINGS:
        return False
    late = swings[min(larger[-1], swings.size - LEAST_SWINGS) :]
    ratios = late[2:] / late[:-2]
    return bool(np.ptp(ratios) <= RATIO_KNOWN * (1 - ratios.max()))


def grows(swings: Array, many: int) -> bool:
    """Whether the last `many` swings are larger than as many before, and these than those before, the least and the
    largest alike: what neither repeats nor goes anywhere does so now and then in one of them."""
    if swings.size < 3 * many:
        return False
    each = swings[-3 * many :].reshape(3, many)
    ends = np.array([each.min(axis=1), each.max(axis=1)])
    return bool((ends[:, 1:] > (1 + GROWS_BY) * ends[:, :-1]).all())


def drifts(swings: Array) -> int:
    """1 where swings become larger from one to the next of some pattern, all of them, -1 where smaller, else 0: what
    creeps towards its end is not there, and repeats in no pattern meanwhile."""
    for n in range(1, PATTERN + 1):
        ways = np.sign(swings[n:] - swings[:-n])
        if (ways == ways[:1]).all():
            return int(ways[0])
    return 0
